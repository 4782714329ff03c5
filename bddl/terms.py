"""Parse atoms and their names; report unknown predicates, objects, categories and rooms with those that are near."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias

from bddl.ast import Atom, is_name
from bddl.diagnostics import Code, Reporter
from bddl.dialects import (
    ABSENT_CONNECTIVES,
    COUNTING_WORDS,
    FORM_SHAPES,
    ROOM,
    VAGUE_PREDICATES,
    PredicateSpec,
    Profile,
    near_names,
)
from bddl.lexer import Group, Item, Word, words_in
from bddl.problem import ROOT_CATEGORY, WILDCARD
from bddl.terminal import pluralize

Role: TypeAlias = Literal["object", "variable", "category"]

# Limit of the names compared in a search for near names.
_MOST_COMPARED = 2_000
# The name of one object of a category ends in a number or a star; that of a variable does not.
INSTANCE = re.compile(r".*_(\d+|\*)")


class TermReader:
    """Parser of the atoms of one text, which tracks the variables bound in the current scope.

    Without objects, the names of objects are not checked.
    """

    def __init__(self, profile: Profile, objects: Mapping[str, str] | None, reporter: Reporter) -> None:
        self.profile = profile
        # The scene's own objects come first, so that a message lists them first.
        self.objects = None if objects is None else {**objects, **profile.builtin_objects, **objects}
        self._reporter = reporter
        self._bound: dict[str, int] = {}
        # The section that is being read, which some predicates and spellings depend on.
        self.section = ""

    def bind(self, variable: str) -> None:
        """Begin the scope of a variable."""
        self._bound[variable] = self._bound.get(variable, 0) + 1

    def unbind(self, variable: str) -> None:
        """End the innermost scope of a variable."""
        self._bound[variable] -= 1

    def read_atom(self, group: Group, head: Word) -> Atom | None:
        """Return the atom of a form, or None after reporting a mistake."""
        predicate = head.key
        spec = self.profile.predicates.get(predicate)
        if spec is None:
            self.report_predicate(group, head)
            for argument in group.items[1:]:
                self._read_argument(argument, "", "", nested_is_reported=False)
            return None
        elsewhere = bool(spec.section) and self.section not in ("", spec.section)
        misplaced = elsewhere and "sections" in self.profile.rules
        # Atoms about rooms have a case of their own: simulators read them, formulas do not.
        case = "inroom" if ROOM in spec.parameters and not misplaced else ""
        legal = len(group.items) == len(spec.parameters) + 1 or self._report_arity(group, head, spec, case)
        if misplaced:
            tolerated = self._reporter.add(
                "misplaced-predicate",
                head.span,
                f"`{spec.name}` belongs in the section {spec.section} only.",
                expected=(spec.section,),
                hint=f"move it there: {spec.shape} says that {spec.meaning}",
            )
            legal = tolerated and legal
        names: list[str] = []
        for position, argument in enumerate(group.items[1:]):
            parameter = spec.parameters[position] if position < len(spec.parameters) else ""
            if misplaced and parameter == ROOM and not legal:
                continue
            name = self._read_argument(argument, parameter, case)
            if name is None:
                legal = False
            else:
                names.append(name)
        if not legal:
            return None
        spans = tuple([item.span for item in group.items])
        return Atom(predicate, tuple(names), span=group.span, word_spans=spans)

    def legal_name(self, word: Word, role: Role) -> str | None:
        """Return the name in a word, or None after reporting that the profile does not allow it."""
        profile, text = self.profile, word.text
        if role == "category":
            # A question mark belongs to variables; in front of a category it is a letter like any other.
            name = text.lower() if profile.folds_case else text
            pattern = profile.category_name or profile.object_name
            rule = profile.category_name_rule or profile.object_name_rule
        else:
            name = profile.name_of(text)
            pattern, rule = profile.object_name, profile.object_name_rule
            # An object of the scene may have an unusual name, and formulas must be able to name it.
            named = word.kind == "NAME" or (profile.free_marks and word.kind == "VARIABLE")
            if role == "object" and named and self.objects is not None and name in self.objects:
                return name
        if word.kind in ("NAME", "VARIABLE") and pattern.fullmatch(name):
            return name
        return self._report_bad_name(word, name, role, rule)

    def check_category(self, word: Word, name: str) -> None:
        """Report a category that no known object has."""
        if self.objects is None or name in self._categories():
            return
        sentence = f"No object has the category `{word.text}`."
        self._report_unknown("unknown-category", word, name, sentence, "categories", sorted(self._categories()))

    def _categories(self) -> set[str]:
        known = {*(self.objects or {}).values(), *self.profile.types}
        return known if self.profile.folds_case else known | {ROOT_CATEGORY}

    def _read_argument(self, item: Item, parameter: str, case: str, nested_is_reported: bool = True) -> str | None:
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
        name = self.legal_name(item, "object")
        if name is None or self._bound.get(name):
            return name
        if item.kind == "VARIABLE" and not self._may_be_constant(item, name):
            return None
        if parameter == ROOM and case:
            return self._room(item, name)
        if self.objects is not None and name not in self.objects and not self.report_object(item, name, case):
            return None
        return name

    def _may_be_constant(self, word: Word, name: str) -> bool:
        profile = self.profile
        known = self.objects is not None and name in self.objects
        if not profile.free_marks or not (known or INSTANCE.fullmatch(name)):
            self._report_unbound(word, name)
            return False
        if self.section == ":init" and "marks" in profile.rules:
            return self._reporter.add(
                "bad-init",
                word.span,
                f"In the section :init nothing is variable, and `{word.text}` has a question mark.",
                expected=(name,),
                hint=f"write {name}",
                case="mark",
                replacement=self._reporter.replacement_for(word.span, name),
            )
        return True

    def _room(self, word: Word, name: str) -> str | None:
        rooms = self.profile.rooms
        if rooms and name not in rooms:
            sentence = f"There is no type of room `{word.text}`."
            if not self._report_unknown("unknown-room", word, name, sentence, "rooms", sorted(rooms)):
                return None
        return name

    def _report_bad_name(self, word: Word, name: str, role: Role, rule: str) -> str | None:
        article = "an" if role == "object" else "a"
        stripped = name if role == "category" else name.strip("?")
        case = "odd" if self.profile.free_marks and is_name(stripped) else ""
        near = self._near_category(name) if role == "category" else ""
        cleaned = "" if near else name.strip(",.:\"'`?").replace(",", " ")
        cleaned = "" if cleaned == name else cleaned
        tolerated = self._reporter.add(
            "bad-name",
            word.span,
            f"`{word.text}` cannot be the name of {article} {role}: {rule}.",
            expected=(near or f"the name of {article} {role}",),
            hint=f"did you mean {near}?" if near else f"write {cleaned}" if cleaned else "",
            case=case,
            replacement=self._reporter.replacement_for(word.span, cleaned),
        )
        return stripped if tolerated else None

    def _near_category(self, name: str) -> str:
        """Return the known category whose word, without the number of its sense, is near a name, or ""."""
        words = {category.partition(".n.")[0]: category for category in sorted(self._categories())[:_MOST_COMPARED]}
        word = name.lstrip("?").partition(".")[0]
        return words.get(word) or next((words[near] for near in near_names(word, words)), "")

    def report_predicate(self, group: Group, head: Word) -> None:
        """Report a word that is neither a predicate nor a connective."""
        profile = self.profile
        names, flat = [word.text for word in words_in(group.items[1:])], group.is_flat
        near = near_names(head.text, profile.words)
        if not near:
            near = tuple(word for word in VAGUE_PREDICATES.get(head.key, ()) if word in profile.predicates)
        written = profile.rewrite(head.key, names) if flat else ""
        hint = f"write {written}" if written else ""
        if head.key in ABSENT_CONNECTIVES and profile.forms >= {"and", "or", "not", "imply"}:
            hint, written = f"write {ABSENT_CONNECTIVES[head.key]}", ""
        elif head.key in COUNTING_WORDS and "forn" in profile.forms:
            hint, written = f"to count, write {FORM_SHAPES['forn']} or {FORM_SHAPES['fornpairs']}", ""
        if not hint and near and near[0] in profile.predicates and flat and head.key not in VAGUE_PREDICATES:
            spec = profile.predicates[near[0]]
            written = f"({' '.join([near[0], *names])})" if spec.arity == len(names) else ""
            hint = f"write {written}" if written else f"`{near[0]}` takes {spec.shape}"
        elif not hint and near:
            hint = _suggestion(near)
        self._reporter.add(
            "unknown-predicate",
            head.span,
            f"The profile `{profile.name}` has no predicate `{head.text}`."
            if flat
            else f"`{head.text}` is neither a connective nor a predicate.",
            expected=near or profile.words,
            hint=hint or f"the predicates are: {_listed(profile.predicates)}",
            replacement=self._reporter.replacement_for(group.span, written),
        )

    def _report_arity(self, group: Group, head: Word, spec: PredicateSpec, case: str) -> bool:
        if group.closed.invented:
            return False
        count = len(group.items) - 1
        surplus = group.items[spec.arity + 1 :]
        place = head.span if not surplus else surplus[0].span
        return self._reporter.add(
            "wrong-arity",
            place,
            f"`{spec.name}` takes {pluralize(spec.arity, 'name')}, here it has {count if count else 'none'}.",
            expected=spec.parameters,
            hint=f"write {spec.shape}" + (f": {spec.meaning}" if spec.meaning else ""),
            case=case,
        )

    def _report_unbound(self, word: Word, name: str) -> None:
        bound = [variable for variable, depth in self._bound.items() if depth]
        near = near_names(name, bound)
        if near or len(bound) == 1:
            hint = f"did you mean ?{(near or bound)[0]}?"
        elif self.objects is None or name in self.objects:
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

    def report_object(self, word: Word, name: str, case: str = "") -> bool:
        """Report an object that the caller does not have; a wildcard stands for objects that have no names."""
        legal = [known for known in self.objects or () if not known.endswith(WILDCARD)]
        sentence = f"There is no object `{name}`."
        return self._report_unknown("unknown-object", word, name, sentence, "objects", legal, case)

    def _report_unknown(
        self, code: Code, word: Word, name: str, sentence: str, kinds: str, legal: Sequence[str], case: str = ""
    ) -> bool:
        legal = legal[:_MOST_COMPARED]
        near = near_names(name, legal)
        listed = f"the {kinds} are: {_listed(legal)}" if legal else f"there are no {kinds}"
        hint = _suggestion(near) or listed
        return self._reporter.add(code, word.span, sentence, expected=near or legal, hint=hint, case=case)


def _suggestion(near: tuple[str, ...]) -> str:
    return f"did you mean {' or '.join(near)}?" if near else ""


def _listed(names: Mapping[str, object] | Sequence[str], most: int = 30) -> str:
    shown = list(names)[:most]
    return ", ".join(shown) + (", ..." if len(names) > most else "")
