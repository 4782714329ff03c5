"""Atoms and binders: the predicate's name and arity, and whether each name in them is legal, bound and known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bddl.codes import Code
from bddl.diagnostics import Reporter
from bddl.forest import Group, Item, Word
from bddl.names import near_names
from bddl.profiles import Profile
from bddl.syntax import Atom, Span
from bddl.truth import ROOT_CATEGORY
from bddl.vocabulary import REWRITES, ROOM, PredicateSpec


class TermReader:
    """Reads the atoms and binders of one text, and knows which variables are bound where it reads.

    Args:
        profile: The dialect.
        objects: Category of each known object, or None when objects are not checked.
        reporter: Receives the diagnostics.
    """

    def __init__(self, profile: Profile, objects: Mapping[str, str] | None, reporter: Reporter) -> None:
        self._profile = profile
        # The scene's own objects come first, so that a message lists them first.
        self._objects = None if objects is None else {**objects, **profile.builtin_objects, **objects}
        self._reporter = reporter
        self._bound: dict[str, int] = {}

    def bind(self, variable: str) -> None:
        """Begins the scope of a variable."""
        self._bound[variable] = self._bound.get(variable, 0) + 1

    def unbind(self, variable: str) -> None:
        """Ends the innermost scope of a variable."""
        self._bound[variable] -= 1

    def read_atom(self, group: Group, head: Word) -> Atom | None:
        """Returns the atom that a form says, or None when it is wrong, which is reported."""
        spec = self._profile.predicates.get(head.key)
        arguments = group.items[1:]
        legal = spec is not None
        if spec is None:
            self._report_predicate(group, head)
        elif len(arguments) != spec.arity:
            legal = False
            self._report_arity(group, head, spec)
        names: list[str] = []
        for position, argument in enumerate(arguments):
            parameter = spec.parameters[position] if spec is not None and position < spec.arity else ""
            name = self._read_argument(argument, parameter, nested_is_reported=spec is not None)
            if name is None:
                legal = False
            else:
                names.append(name)
        if not legal:
            return None
        spans = (head.span, *(argument.span for argument in arguments))
        return Atom(head.key, tuple(names), span=group.span, word_spans=spans)

    def read_binder(self, item: Item | None, quantifier: Word) -> tuple[str, str] | None:
        """Returns the variable and the category of a quantifier, or None when they are wrong, which is reported."""
        if isinstance(item, Group) and len(item.items) == 3:
            variable, hyphen, category = item.items
            if (
                isinstance(variable, Word)
                and isinstance(hyphen, Word)
                and isinstance(category, Word)
                and hyphen.kind == "HYPHEN"
            ):
                name = self._legal_name(variable, "variable")
                kind = self._legal_name(category, "category")
                if kind is not None:
                    self._check_category(category)
                return None if name is None or kind is None else (name, kind)
        self._reporter.add(
            "bad-binder",
            quantifier.span if item is None else item.span,
            f"`{quantifier.key}` begins with one variable and its category in parentheses.",
            expected=("(?x - CATEGORY)",),
            hint=f"write ({quantifier.key} (?x - CATEGORY) FORMULA); for two variables, nest two quantifiers",
        )
        return None

    def declare(self, word: Word) -> str | None:
        """Returns the name that a problem declares, or None when it is not legal, which is reported."""
        return self._legal_name(word, "object")

    def category(self, word: Word) -> str | None:
        """Returns the category that a declaration names, or None when it is not legal, which is reported."""
        return self._legal_name(word, "category")

    def check_known(self, name: str, span: Span) -> None:
        """Reports a declared object that the caller's objects do not have."""
        if self._objects is not None and name not in self._objects:
            self._report_object(Word("NAME", name, span), name)

    def _read_argument(self, item: Item, parameter: str, nested_is_reported: bool) -> str | None:
        if isinstance(item, Group):
            if nested_is_reported:
                self._reporter.add(
                    "not-a-name",
                    item.span,
                    "A name belongs here, not a form in parentheses.",
                    expected=("the name of an object",),
                    hint="a predicate takes names only; join formulas with (and ...)",
                )
            return None
        name = self._legal_name(item, "object")
        if name is None or self._bound.get(name):
            return name
        if item.kind == "VARIABLE":
            self._report_unbound(item, name)
            return None
        if parameter != ROOM and self._objects is not None and name not in self._objects:
            self._report_object(item, name)
        return name

    def _legal_name(self, word: Word, role: str) -> str | None:
        """Returns the name that a word says, or None when the profile does not allow it, which is reported."""
        name = word.text[1:] if word.kind == "VARIABLE" and role != "category" else word.text
        # An object of the scene may have an unusual name; whoever named it so has to be able to speak of it.
        known = role == "object" and word.kind == "NAME" and self._objects is not None and name in self._objects
        if known or (word.kind in ("NAME", "VARIABLE") and self._profile.object_name.fullmatch(name)):
            return name
        cleaned = name.strip(",.:\"'`").replace(",", " ")
        self._reporter.add(
            "bad-name",
            word.span,
            f"`{word.text}` cannot be the name of {'an' if role == 'object' else 'a'} {role}: "
            f"{self._profile.object_name_rule}.",
            expected=(f"the name of {'an' if role == 'object' else 'a'} {role}",),
            hint=f"write {cleaned}" if cleaned and cleaned != name else "",
        )
        return None

    def _check_category(self, word: Word) -> None:
        if self._objects is None or word.text == ROOT_CATEGORY or word.text in self._objects.values():
            return
        legal = sorted({*self._objects.values(), ROOT_CATEGORY})
        sentence = f"No object has the category `{word.text}`."
        self._report_unknown("unknown-category", word, word.text, sentence, "categories", legal)

    def _report_predicate(self, group: Group, head: Word) -> None:
        names = [item.text for item in group.items[1:] if isinstance(item, Word)]
        flat = len(names) == len(group.items) - 1
        near = near_names(head.text, self._profile.words)
        hint = ""
        if flat and head.key in REWRITES and REWRITES[head.key][0] == len(names):
            hint = f"write {REWRITES[head.key][1].format(*names)}"
        elif near and near[0] in self._profile.predicates and flat:
            spec = self._profile.predicates[near[0]]
            written = f"({' '.join([near[0], *names])})"
            hint = f"write {written}" if spec.arity == len(names) else f"`{near[0]}` takes {spec.shape}"
        elif near:
            hint = _suggestion(near)
        self._reporter.add(
            "unknown-predicate",
            head.span,
            f"The profile `{self._profile.name}` has no predicate `{head.text}`."
            if flat
            else f"`{head.text}` is neither a connective nor a predicate.",
            expected=near or self._profile.words,
            hint=hint or f"the predicates are: {_listed(self._profile.predicates)}",
        )

    def _report_arity(self, group: Group, head: Word, spec: PredicateSpec) -> None:
        if group.closed.invented:
            return
        count = len(group.items) - 1
        surplus = group.items[spec.arity + 1 :]
        place = head.span if not surplus else surplus[0].span
        self._reporter.add(
            "wrong-arity",
            place,
            f"`{spec.name}` takes {_counted(spec.arity, 'name')}, here it has {count if count else 'none'}.",
            expected=spec.parameters,
            hint=f"write {spec.shape}: {spec.meaning}",
        )

    def _report_unbound(self, word: Word, name: str) -> None:
        bound = [variable for variable, depth in self._bound.items() if depth]
        near = near_names(name, bound)
        if near or len(bound) == 1:
            hint = f"did you mean ?{(near or bound)[0]}?"
        elif self._objects is None or name in self._objects:
            hint = f"for the object of that name write {name}, without the question mark"
        else:
            hint = f"bind it: (exists ({word.text} - CATEGORY) ...)"
        self._reporter.add(
            "unbound-variable",
            word.span,
            f"No quantifier around this place binds the variable `{word.text}`.",
            expected=[f"?{variable}" for variable in bound],
            hint=hint,
        )

    def _report_object(self, word: Word, name: str) -> None:
        legal = list(self._objects or ())
        self._report_unknown("unknown-object", word, name, f"There is no object `{name}`.", "objects", legal)

    def _report_unknown(
        self, code: Code, word: Word, name: str, sentence: str, kinds: str, legal: Sequence[str]
    ) -> None:
        """Reports a name that is none of the legal ones, with the near ones or else all of them."""
        near = near_names(name, legal)
        listed = f"the {kinds} are: {_listed(legal)}"
        self._reporter.add(code, word.span, sentence, expected=near or legal, hint=_suggestion(near) or listed)


def _suggestion(near: tuple[str, ...]) -> str:
    return f"did you mean {' or '.join(near)}?" if near else ""


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _listed(names: Mapping[str, object] | Sequence[str], most: int = 30) -> str:
    shown = list(names)[:most]
    return ", ".join(shown) + (", ..." if len(names) > most else "")
