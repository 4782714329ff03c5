"""From the section `:objects`, or another one of the same form, to declared objects."""

from __future__ import annotations

from collections.abc import Sequence

from bddl.reading.formulas.terms import TermReader
from bddl.reading.words.forest import Group, Item, Word
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.names import near_names
from bddl.syntax.problem import ROOT_CATEGORY, TypedObject
from bddl.syntax.profiles import Profile


class ObjectsReader:
    """Reads the objects that a problem declares; where a section is repeated, sections must be given last one first.

    Args:
        profile: The dialect.
        terms: Reads the names; its objects are those that may be declared, or None for any.
        reporter: Receives the diagnostics.
    """

    def __init__(self, profile: Profile, terms: TermReader, reporter: Reporter) -> None:
        self._terms = terms
        self._reporter = reporter
        self._profile = profile
        self._synsets = "instances" in profile.rules
        self._example = "apple.n.01_1 - apple.n.01" if self._synsets else "glass_0 - glass"
        self._section = ":objects"
        self._declared: dict[str, TypedObject] = {}
        # Objects as they are listed; where names follow categories, one list for each category.
        self._lists: dict[str | int, list[TypedObject]] = {}

    @property
    def objects(self) -> tuple[TypedObject, ...]:
        """The objects read so far, in order."""
        return tuple(item for listed in self._lists.values() for item in listed)

    def read(self, section: Group) -> None:
        """Reads one section; what is wrong in it is reported."""
        items = section.items
        self._section = section.head.key if section.head is not None else self._section
        self._declared = {}
        first_lines: dict[str, Word] = {}
        start = 1
        while start < len(items):
            hyphen = start
            while hyphen < len(items) and not _is_hyphen(items[hyphen]):
                hyphen += 1
            names = self._names_only(items[start:hyphen])
            if hyphen < len(items):
                self._read_line(names, items[hyphen : hyphen + 2], first_lines)
            else:
                self._read_untyped(names)
            start = hyphen + 2

    def _read_line(self, names: Sequence[Word], pair: Sequence[Item], first_lines: dict[str, Word]) -> None:
        """Reads names with their category; the pair is the hyphen and what follows it."""
        word = pair[1] if len(pair) == 2 else None
        category: str | None = ROOT_CATEGORY
        named = True
        if not names or not isinstance(word, Word) or _is_hyphen(word):
            self._reporter.add(
                "bad-objects",
                pair[0].span,
                "Names belong before this hyphen, and one category behind it.",
                expected=("NAME ... - CATEGORY",),
                hint=f"write ({self._section} {self._example})",
            )
        else:
            category = self._terms.legal_name(word, "category")
            if self._synsets and category is not None and category in first_lines:
                self._report_repeated_category(word, category, first_lines[category])
            if category is not None:
                first_lines.setdefault(category, word)
                if self._synsets:
                    named = self._check_instances(names, word, category)
        self._list(names, category or ROOT_CATEGORY, replaces=True)
        if not named and category is not None and not self._reporter.tolerates("wrong-category"):
            self._declare_as_meant(names, category)

    def _declare_as_meant(self, names: Sequence[Word], category: str) -> None:
        """Declares objects that are not named after their category by their right names, too.

        They have been reported, and whatever names them rightly shall not be reported as well.
        """
        for word in names:
            stem, _, number = word.text.lower().rpartition("_")
            meant = f"{category}_{number}"
            if stem != category and number.isdecimal() and meant not in self._declared:
                self._declared[meant] = TypedObject(meant, category, span=word.span)
                self._lists[category].append(self._declared[meant])

    def _read_untyped(self, names: Sequence[Word]) -> None:
        if self._synsets and names:
            self._reporter.add(
                "bad-objects",
                names[0].span,
                f"`{names[0].text}` has no category.",
                expected=("- CATEGORY",),
                hint="write a hyphen and the category behind the names, as in apple.n.01_1 apple.n.01_2 - apple.n.01",
                case="untyped",
            )
        self._list(names, ROOT_CATEGORY, replaces=False)

    def _list(self, names: Sequence[Word], category: str, replaces: bool) -> None:
        found = [item for item in (self._declare(word, category) for word in names) if item is not None]
        key: str | int = category if self._synsets else len(self._lists)
        if replaces or key not in self._lists:
            self._lists[key] = found
        else:
            self._lists[key] += found

    def _declare(self, word: Word, category: str) -> TypedObject | None:
        name = self._terms.legal_name(word, "object")
        if name is None:
            return None
        span = word.span
        if name in self._declared:
            tolerated = self._reporter.add(
                "repeated-object",
                span,
                f"The object `{name}` is declared twice.",
                hint="declare it once, with one category",
                related=self._declared[name].span,
            )
            if not tolerated:
                return None
        self._terms.check_known(word, name)
        declared = TypedObject(name, category, span=span)
        self._declared[name] = declared
        return declared

    def _check_instances(self, names: Sequence[Word], word: Word, category: str) -> bool:
        """Reports the first object of a line that is not named after the line's category; True when there is none."""
        for item in names:
            name = item.text.lower()
            stem, _, number = name.rpartition("_")
            named = stem == category and (number.isdecimal() or number == "*")
            if named or not self._profile.object_name.fullmatch(name):
                continue
            near = near_names(stem, (category,))
            self._reporter.add(
                "wrong-category",
                item.span,
                f"`{item.text}` is not named after its category `{word.text}`.",
                expected=(f"{category}_1",),
                hint=f"did you mean {near[0]}_{number}?"
                if near
                else f"an object of this category is called {category}_1, {category}_2 and so on",
                related=word.span,
            )
            return False
        return True

    def _report_repeated_category(self, word: Word, category: str, first: Word) -> None:
        self._reporter.add(
            "repeated-category",
            word.span,
            f"The category `{category}` has a line of its own already.",
            hint="put all its objects before one hyphen; the reference implementation forgets those of the first line",
            related=first.span,
        )

    def _names_only(self, items: Sequence[Item]) -> list[Word]:
        for item in items:
            if isinstance(item, Group):
                self._reporter.add(
                    "not-a-name",
                    item.span,
                    "The name of an object belongs here, not a form in parentheses.",
                    expected=("NAME",),
                    hint=f"write ({self._section} {self._example})",
                )
        return [item for item in items if isinstance(item, Word)]


def _is_hyphen(item: Item) -> bool:
    return isinstance(item, Word) and item.kind == "HYPHEN"
