"""Parse the sections of a form `(define ...)`: their names, declared objects, and the sections of LIBERO.

LIBERO adds sections for the instruction, regions, fixtures, objects of interest and styles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeAlias

from bddl.ast import Formula, Span, is_name
from bddl.diagnostics import Code, Reporter
from bddl.dialects import Profile, near_names
from bddl.formulas import FormulaReader
from bddl.lexer import Group, Item, Word, words_in
from bddl.problem import (
    ROOT_CATEGORY,
    ROWS,
    SECTION_START,
    STYLE_ATTRIBUTES,
    Rectangle,
    Region,
    SceneStyle,
    TypedObject,
    read_number,
)
from bddl.terms import TermReader

# Placeholder for a name that was reported.
UNNAMED = "unnamed"


@dataclass(frozen=True, slots=True)
class SectionNames:
    """Names of the sections of one kind of file.

    Attributes:
        owner: What defines them, for messages, such as "profile `scene`".
        subject: What the file defines: "problem" or "domain".
        legal: The legal sections, in the order in which they are read.
    """

    owner: str
    subject: str
    legal: Sequence[str]
    required: Sequence[str]
    ignored: Sequence[str] = ()
    repeatable: Sequence[str] = ()


def collect_sections(group: Group, names: SectionNames, reporter: Reporter) -> Mapping[str, Sequence[Group]]:
    """Return the sections of a definition by name, each as often as it occurs, in the order of the names.

    Unknown, repeated and missing sections are reported, and so is whatever is no section. A misspelt section is read as
    the one that it resembles, so that what depends on it is not reported, too.
    """
    found: dict[str, list[Group]] = {}
    misspelt: dict[str, Group] = {}
    strange: list[Group] = []
    for item in _with_bare_sections(group.items[1:], names, reporter):
        head = item.head if isinstance(item, Group) else None
        if not isinstance(item, Group) or head is None:
            _report_stray(item, names, reporter)
        elif head.key in names.ignored:
            continue
        elif head.key not in names.legal:
            message = f"The {names.owner} has no section `{head.text}`."
            near = report_unknown(reporter, "unknown-section", head.span, message, head.key, names.legal)
            if near and not reporter.tolerates("unknown-section"):
                misspelt.setdefault(near[0], item)
            elif not near and not reporter.tolerates("unknown-section"):
                strange.append(item)
        else:
            if head.key in found and head.key not in names.repeatable:
                reporter.add(
                    "repeated-section",
                    head.span,
                    f"The section `{head.key}` is there twice.",
                    hint="put everything into one of them",
                    related=found[head.key][0].span,
                )
            found.setdefault(head.key, []).append(item)
    for name, item in misspelt.items():
        found.setdefault(name, [item])
    missing = [name for name in names.required if name not in found]
    if len(missing) == len(strange) == 1:
        # A single missing section can only be the single unknown one.
        found[missing.pop()] = strange
    for name in missing:
        reporter.add(
            "missing-section",
            group.opened.span,
            f"The {names.subject} has no section `{name}`.",
            expected=(name,),
            hint=f"add ({name} ...)",
            case=name,
        )
    return {name: found[name] for name in names.legal if name in found}


def _with_bare_sections(items: Sequence[Item], names: SectionNames, reporter: Reporter) -> list[Item]:
    """Return the items, the words of a section without parentheses as one form; such a section is reported once."""
    if reporter.tolerates("bad-section", "stray"):
        return list(items)
    found: list[Item] = []
    position = 0
    while position < len(items):
        first = items[position]
        end = position + 1
        if isinstance(first, Word) and first.key in names.legal:
            while end < len(items) and isinstance(items[end], Word):
                end += 1
            if end > position + 1:
                first = _bare_section(words_in(items[position:end]), reporter)
        found.append(first)
        position = end
    return found


def _bare_section(words: Sequence[Word], reporter: Reporter) -> Group:
    first, last = words[0], words[-1]
    reporter.add(
        "bad-section",
        reporter.place(first.offset, last.end - first.offset),
        f"The section `{first.text}` lacks its parentheses.",
        expected=(f"({first.text} ...)",),
        hint=f"write ({' '.join(word.text for word in words)})" if len(words) < 4 else f"write ({first.text} ...)",
    )
    opened = Word("OPEN", "(", first.offset, first.source, invented=True)
    return Group(words, opened, Word("CLOSE", ")", last.end, last.source, invented=True))


def read_name(section: Group, reporter: Reporter) -> Word | None:
    """Return the one name in a section, or None after reporting other content."""
    last = section.items[-1] if len(section.items) > 1 else None
    if isinstance(last, Word) and last.kind == "NAME" and len(section.items) == 2:
        return last
    head = section.head
    # Where such a section is tolerated at all, its last word is the name.
    usable = isinstance(last, Word) and is_name(last.text)
    tolerated = reporter.add(
        "bad-section",
        section.span,
        "One name belongs here.",
        expected=("NAME",),
        hint=f"write ({head.text if head else 'problem'} NAME)",
        case="name" if usable else "",
    )
    return last if tolerated and isinstance(last, Word) else None


def _report_stray(item: Item, names: SectionNames, reporter: Reporter) -> None:
    reporter.add(
        "bad-section",
        item.span,
        f"A section belongs here, not `{item.text}`." if isinstance(item, Word) else "A section belongs here.",
        expected=names.legal,
        hint=f"the sections are: {', '.join(f'({word} ...)' for word in names.legal)}",
        # Only empty parentheses hold nothing that could be the name of a section.
        case="" if isinstance(item, Group) and not item.items else "stray",
    )


def report_unknown(
    reporter: Reporter, code: Code, place: Span, message: str, name: str, legal: Sequence[str]
) -> tuple[str, ...]:
    """Report a name that is none of the legal ones, and returns those that are near."""
    near = near_names(name, legal)
    kinds = "categories" if code == "unknown-category" else f"{code.removeprefix('unknown-')}s"
    hint = f"did you mean {near[0]}?" if near else f"the {kinds} are: {', '.join(legal)}"
    reporter.add(code, place, message, expected=near or legal, hint=hint)
    return near


@dataclass(slots=True)
class ProblemDraft:
    """A problem under construction.

    Attributes:
        profile: The dialect; from the section `:domain` on with the predicates of that domain.
        scene: Objects that exist besides those declared, or None; when given, declared ones must be among them.
        terms: Further names that formulas may use as objects, with their categories, such as regions.
        goal: The goal, once it was read without a mistake.
        fields: Values of the sections that one dialect adds, by attribute of its class of problems.
    """

    profile: Profile
    reporter: Reporter
    scene: Mapping[str, str] | None
    name: str = UNNAMED
    domain: str = UNNAMED
    objects: tuple[TypedObject, ...] = ()
    terms: dict[str, str] = field(default_factory=dict)
    init: tuple[Formula, ...] = ()
    goal: Formula | None = None
    fields: dict[str, Any] = field(default_factory=dict)

    def formulas(self) -> FormulaReader:
        """Return a reader that knows every object named so far."""
        known = {**(self.scene or {}), **{item.name: item.category for item in self.objects}, **self.terms}
        return FormulaReader(self.profile, known, self.reporter)


# A section may be there several times where that is tolerated; its reader gets all of them, in the order of the text.
SectionReader: TypeAlias = Callable[[ProblemDraft, Sequence[Group]], None]


class ObjectsReader:
    """Parser of the objects that a problem declares; repeated sections must be given last one first."""

    def __init__(self, draft: ProblemDraft) -> None:
        self._terms = TermReader(draft.profile, draft.scene, draft.reporter)
        self._reporter = draft.reporter
        self._profile = draft.profile
        self._synsets = "instances" in draft.profile.rules
        self._example = "apple.n.01_1 - apple.n.01" if self._synsets else "glass_0 - glass"
        self._section = ":objects"
        self._declared: dict[str, TypedObject] = {}
        # Objects as they are listed; where names follow categories, one list for each category.
        self._lists: dict[str | int, list[TypedObject]] = {}

    @property
    def objects(self) -> tuple[TypedObject, ...]:
        return tuple(item for listed in self._lists.values() for item in listed)

    def read(self, section: Group) -> None:
        """Read one section; mistakes in it are reported."""
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
        """Read names with their category; the pair is the hyphen and what follows it."""
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
                self._reporter.add(
                    "repeated-category",
                    word.span,
                    f"The category `{category}` has a line of its own already.",
                    hint="put all its objects before one hyphen; the reference implementation forgets those of the "
                    "first line",
                    related=first_lines[category].span,
                )
            if category is not None:
                first_lines.setdefault(category, word)
                if self._synsets:
                    named = self._check_instances(names, word, category)
        self._list(names, category or ROOT_CATEGORY, replaces=True)
        if not named and category is not None and not self._reporter.tolerates("wrong-category"):
            self._declare_intended(names, category)

    def _declare_intended(self, names: Sequence[Word], category: str) -> None:
        """Declare objects that are not named after their category by their right names, too.

        They have been reported, and uses of the right names are not to be reported again.
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
        if self._terms.objects is not None and name not in self._terms.objects:
            self._terms.report_object(word, name)
        declared = TypedObject(name, category, span=span)
        self._declared[name] = declared
        return declared

    def _check_instances(self, names: Sequence[Word], word: Word, category: str) -> bool:
        """Report the first object of a line that is not named after the line's category; True when there is none."""
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
        return words_in(items)


def _is_hyphen(item: Item) -> bool:
    return isinstance(item, Word) and item.kind == "HYPHEN"


# The category of regions, for quantifiers and messages.
REGION = "region"


def _read_language(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    section = sections[0]
    if section.head is None:
        return
    start = section.head.span.offset + section.head.span.length
    # The words were hidden from the grammar; the reporter's text has them.
    instruction = draft.reporter.text[start : section.span.offset + section.span.length - 1]
    inner = SECTION_START.search(instruction)
    if inner is not None:
        instruction = instruction[: inner.start()]
        draft.reporter.add(
            "missing-parenthesis",
            draft.reporter.place(start + len(instruction.rstrip())),
            "The instruction does not end before the next section begins.",
            expected=(")",),
            hint="add ) here",
            related=section.opened.span,
        )
    draft.fields["language"] = instruction.strip()


def _read_regions(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    found: dict[str, Region] = {}
    for item in sections[0].items[1:]:
        region = _region(item, draft.reporter)
        if region is not None and region.key in found:
            earlier = found[region.key]
            hint = (
                f"`{earlier.target}` + `{earlier.name}` and `{region.target}` + `{region.name}` read alike: rename one"
            )
            if (earlier.name, earlier.target) == (region.name, region.target):
                hint = "keep one of them, or give the second another name"
            draft.reporter.add(
                "repeated-object",
                item.span,
                f"The region `{region.key}` is defined twice.",
                hint=hint,
                related=earlier.span,
            )
        elif region is not None:
            found[region.key] = region
    draft.fields["regions"] = tuple(found.values())
    draft.terms.update(dict.fromkeys(found, REGION))


def _read_fixtures(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    reader = ObjectsReader(draft)
    reader.read(sections[0])
    draft.fields["fixtures"] = reader.objects
    draft.terms.update({fixture.name: fixture.category for fixture in reader.objects})


def _read_objects_of_interest(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    """Read the names; this section is read after the objects, so that all names are known."""
    known = {**{thing.name: thing.category for thing in draft.objects}, **draft.terms}
    names: list[str] = []
    for item in sections[0].items[1:]:
        if not isinstance(item, Word) or item.kind != "NAME":
            draft.reporter.add("not-a-name", item.span, "The name of an object or a region belongs here.", hint="")
            continue
        name = draft.profile.name_of(item.text)
        if name not in known:
            near = near_names(name, known)
            draft.reporter.add(
                "unknown-object",
                item.span,
                f"There is no object, fixture or region `{name}`.",
                expected=near or tuple(known),
                hint=f"did you mean {' or '.join(near)}?" if near else "",
            )
        names.append(name)
    draft.fields["objects_of_interest"] = tuple(names)


def _read_styles(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    styles = [_style(draft, item) for item in sections[0].items[1:]]
    draft.fields["styles"] = tuple(style for style in styles if style is not None)


def _style(draft: ProblemDraft, item: Item) -> SceneStyle | None:
    head = item.head if isinstance(item, Group) else None
    if isinstance(item, Group) and head is not None and head.kind == "NAME":
        styles: dict[str, str] = {}
        for part in item.items[1:]:
            words = part.items if isinstance(part, Group) else ()
            if len(words) == 2 and isinstance(words[0], Word) and isinstance(words[1], Word):
                styles[words[0].key] = words[1].text
        if len(styles) == len(item.items) - 1 and styles.keys() <= set(STYLE_ATTRIBUTES):
            return SceneStyle(head.text, styles.get(":floor"), styles.get(":wall"))
    draft.reporter.add(
        "bad-section",
        item.span,
        "A part of the scene belongs here, with the style of its floor or wall.",
        expected=("(NAME (:floor STYLE) (:wall STYLE))",),
        hint="write (NAME (:floor STYLE) (:wall STYLE))",
    )
    return None


LIBERO_READERS: Mapping[str, SectionReader] = MappingProxyType(
    {
        ":language": _read_language,
        ":regions": _read_regions,
        ":fixtures": _read_fixtures,
        ":obj_of_interest": _read_objects_of_interest,
        ":scene_properties": _read_styles,
    }
)

_SHAPES = {
    ":target": "(:target NAME)",
    ":ranges": "(:ranges ((X_MIN Y_MIN X_MAX Y_MAX) ...))",
    ":yaw_rotation": "(:yaw_rotation ((LEAST GREATEST)))",
    ":rgba": "(:rgba (RED GREEN BLUE ALPHA))",
}


def _region(item: Item, reporter: Reporter) -> Region | None:
    head = item.head if isinstance(item, Group) else None
    if not isinstance(item, Group) or head is None or head.kind != "NAME":
        _report(reporter, item.span, "A region belongs here.", "(NAME (:target NAME) (:ranges ...))")
        return None
    attributes = _attributes(item, reporter)
    given = attributes.get(":target")
    if given is None:
        message = f"The region `{head.text}` says of no object that it is a part."
        _report(reporter, head.span, message, _SHAPES[":target"])
        return None
    target = given.items[1] if len(given.items) == 2 else None
    if not isinstance(target, Word) or target.kind != "NAME":
        _report(reporter, given.span, "The name of one object belongs here.", _SHAPES[":target"])
        return None
    yaw = _rows(attributes, ":yaw_rotation", 2, reporter)
    colour = _rows(attributes, ":rgba", 4, reporter)
    return Region(
        head.text.lower(),
        target.text.lower(),
        tuple(Rectangle(*row) for row in _rows(attributes, ":ranges", 4, reporter)),
        # With several ranges of yaw the last one counts, as in LIBERO.
        (yaw[-1][0], yaw[-1][1]) if yaw else None,
        (colour[0][0], colour[0][1], colour[0][2], colour[0][3]) if colour else None,
        span=item.span,
    )


def _attributes(region: Group, reporter: Reporter) -> dict[str, Group]:
    found: dict[str, Group] = {}
    for item in region.items[1:]:
        head = item.head if isinstance(item, Group) else None
        if not isinstance(item, Group) or head is None or head.key not in _SHAPES:
            near = near_names(head.key, _SHAPES) if head is not None else ()
            place = item.span if head is None else head.span
            hint = f"did you mean {near[0]}?" if near else f"the attributes are: {', '.join(_SHAPES.values())}"
            reporter.add(
                "bad-section", place, "A region has no such attribute.", expected=near or tuple(_SHAPES), hint=hint
            )
        elif head.key in found:
            reporter.add(
                "repeated-section",
                head.span,
                f"The region has `{head.key}` twice.",
                hint="keep one of them",
                related=found[head.key].span,
            )
        else:
            found[head.key] = item
    return found


def _rows(attributes: Mapping[str, Group], name: str, width: int, reporter: Reporter) -> list[tuple[float, ...]]:
    attribute = attributes.get(name)
    if attribute is None:
        return []
    inside = attribute.items[1] if len(attribute.items) == 2 else None
    if not isinstance(inside, Group):
        _report(reporter, attribute.span, "Numbers in parentheses belong here.", _SHAPES[name])
        return []
    found: list[tuple[float, ...]] = []
    for row in inside.items if name in ROWS else (inside,):
        if not isinstance(row, Group) or len(row.items) != width:
            _report(reporter, row.span, f"{width} numbers in parentheses belong here.", _SHAPES[name])
            continue
        numbers = [read_number(part.text) if isinstance(part, Word) else None for part in row.items]
        for part, number in zip(row.items, numbers, strict=True):
            if number is None:
                _report(reporter, part.span, "A number belongs here, such as 0.25 or -pi/2.", "a number")
        known = tuple(number for number in numbers if number is not None)
        found += [known] if len(known) == width else []
    return found


def _report(reporter: Reporter, place: Span, message: str, shape: str) -> None:
    reporter.add("bad-section", place, message, expected=(shape,), hint=f"write {shape}")
