"""Parse formulas: atoms with their names, connectives, and quantifiers with their numbers and binders.

Every malformed form is reported, and parsing continues behind it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Literal, TypeAlias

from bddl.ast import FORMS, QUANTIFIER_WORDS, Atom, Binder, Formula, Span, is_name
from bddl.diagnostics import Code, Reporter, one_line
from bddl.dialects import (
    ABSENT_CONNECTIVES,
    COUNTING_WORDS,
    FORM_SHAPES,
    ROOM,
    VAGUE_PREDICATES,
    PredicateSpec,
    Profile,
    near_names,
    operand_count,
)
from bddl.lexer import Group, Item, Word, is_call, to_prefix, words_in, words_of
from bddl.problem import ROOT_CATEGORY, WILDCARD
from bddl.terminal import pluralize

Role: TypeAlias = Literal["object", "variable", "category"]

# Limit of the names compared in a search for near names.
_MOST_COMPARED = 2_000
# The name of one object of a category ends in a number or a star; that of a variable does not.
_INSTANCE = re.compile(r".*_(\d+|\*)")


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
        if not profile.free_marks or not (known or _INSTANCE.fullmatch(name)):
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


# A longer number is a slip or an attack; no scene has as many objects.
_MOST_DIGITS = 9


@dataclass(frozen=True, slots=True)
class Prefix:
    """Number and variables of a quantifier, which stand before its formula.

    Attributes:
        binders: Its variables.
        spans: Where they stand.
        number: The number N of `forn` and `fornpairs`.
        scope: Names that its formula may use as variables, those that a wrong binder seems to mean included.
        rest: The items behind it.
        legal: False when a mistake was reported.
    """

    binders: tuple[Binder, ...]
    spans: tuple[Span, ...]
    number: int | None
    scope: tuple[str, ...]
    rest: Sequence[Item]
    legal: bool


class BinderReader:
    """Parser of the number and the variables of one quantifier."""

    def __init__(self, terms: TermReader, head: Word, reporter: Reporter) -> None:
        self._terms = terms
        self._profile = terms.profile
        self._head = head
        self._shape = FORM_SHAPES[head.key]
        self._reporter = reporter

    def read(self, operands: Sequence[Item]) -> Prefix:
        """Return the prefix of the quantifier, after reporting the mistakes in it."""
        number: int | None = None
        legal = True
        if "(N)" in self._shape:
            number, taken = self._number(operands[0] if operands else None)
            legal = number is not None
            operands = operands[taken:]
        binders: list[Binder] = []
        spans: list[Span] = []
        scope: list[str] = []
        wanted = self._shape.count("CATEGORY")
        for position in range(wanted):
            item = operands[0] if operands else None
            if position and _opens_formula(item, self._profile):
                item = None
            binder = self._binder(item, loose=wanted > 1)
            if binder is not None and isinstance(item, Group):
                binders.append(binder)
                spans.append(item.items[0].span)
                scope.append(binder.variable)
            else:
                legal = False
                if item is None or _opens_formula(item, self._profile):
                    break
                loose = [item]
                if isinstance(item, Word) and item.kind == "VARIABLE":
                    loose = list(takewhile(lambda one: isinstance(one, Word), operands))
                scope += [name for word in loose for name in intended_variables(word, self._profile)]
                operands = operands[len(loose) - 1 :]
            operands = operands[1:]
        return Prefix(tuple(binders), tuple(spans), number, tuple(scope), operands, legal)

    def _number(self, item: Item | None) -> tuple[int | None, int]:
        """Return the number of a quantifier, None when it is wrong, and the count of items it takes."""
        words = item.items if isinstance(item, Group) else (item,)
        first = words[0] if words else None
        if not isinstance(first, Word) or not first.text.isdecimal() or len(first.text) > _MOST_DIGITS:
            self._report_number(item, "")
            looks_like_one = isinstance(item, Group) and len(item.items) == 1 and isinstance(first, Word)
            return None, int(isinstance(item, Word) or (looks_like_one and not _opens_formula(item, self._profile)))
        if isinstance(item, Word):
            # The reference takes the first letter of the word for the list's first element.
            return (int(first.text[0]) if self._report_number(item, "loose") else None), 1
        if len(words) > 1:
            return (int(first.text) if self._report_number(item, "surplus") else None), 1
        return int(first.text), 1

    def _report_number(self, item: Item | None, case: str) -> bool:
        return self._reporter.add(
            "bad-count",
            self._head.span if item is None else item.span,
            f"`{self._head.key}` begins with one whole number in parentheses.",
            expected=("(N)",),
            hint=f"write {self._shape.replace('(N)', '(2)')}",
            case=case,
        )

    def _binder(self, item: Item | None, loose: bool) -> Binder | None:
        if isinstance(item, Group) and len(item.items) == 3:
            variable, hyphen, category = item.items
            if isinstance(variable, Word) and isinstance(hyphen, Word) and isinstance(category, Word):
                if hyphen.kind == "HYPHEN" or (loose and self._report(item, "hyphen")):
                    name = self._terms.legal_name(variable, "variable")
                    kind = self._terms.legal_name(category, "category")
                    if kind is not None:
                        self._terms.check_category(category, kind)
                    return None if name is None or kind is None else Binder(name, kind)
                if loose:
                    return None
        self._report(item, "")
        return None

    def _report(self, item: Item | None, case: str) -> bool:
        word, two = f"`{self._head.key}`", self._shape.count("CATEGORY") > 1
        message = f"{word} begins with one variable and its category in parentheses."
        if two:
            message = f"{word} has two variables, each with its category in parentheses of its own."
        elif "(N)" in self._shape:
            message = f"In {word} the number is followed by one variable and its category in parentheses."
        return self._reporter.add(
            "bad-binder",
            self._head.span if item is None else item.span,
            message,
            expected=("(?x - CATEGORY)",),
            hint=f"write {self._shape}" + ("" if two else "; for two variables, nest two quantifiers"),
            case=case,
        )


def _opens_formula(item: Item | None, profile: Profile) -> bool:
    return isinstance(item, Group) and item.head is not None and item.head.key in profile.words


def is_binder(item: Item) -> bool:
    """Decide whether an item has the form `(?x - CATEGORY)`."""
    kinds = [word.kind for word in item.items if isinstance(word, Word)] if isinstance(item, Group) else []
    return kinds == ["VARIABLE", "HYPHEN", "NAME"]


def intended_variables(item: Item, profile: Profile) -> list[str]:
    """Return the names in a malformed binder, so that their uses in the formula are not reported, too."""
    words = item.items if isinstance(item, Group) else (item,)
    return [profile.name_of(word.text) for word in words if isinstance(word, Word)]


@dataclass(slots=True, eq=False)
class _Step:
    """The state of parsing one form; `formula` stays None where the form is wrong.

    Attributes:
        item: The form.
        reported: True when the form was reported and is skipped.
        word: The connective or quantifier, once it is known to be well formed.
        prefix: Number and variables of a quantifier.
        operands: The forms inside, in order.
        formula: The result.
    """

    item: Item
    reported: bool = False
    word: str = ""
    prefix: Prefix | None = None
    operands: list[_Step] = field(default_factory=list)
    formula: Formula | None = None


class FormulaReader:
    """Parser of the formulas of one text; without objects, their names are not checked."""

    def __init__(self, profile: Profile, objects: Mapping[str, str] | None, reporter: Reporter) -> None:
        self._profile = profile
        self._reporter = reporter
        self._terms = TermReader(profile, objects, reporter)

    def read(self, item: Item, section: str = "") -> Formula | None:
        """Return the formula of a form."""
        self._terms.section = section
        if isinstance(item, Group):
            head = item.head
            if head is not None and head.key in self._profile.predicates:
                return self._terms.read_atom(item, head)
        root = _Step(item)
        entered: list[_Step] = []
        # A name on the stack marks the end of the scope of that variable.
        pending: list[_Step | str] = [root]
        while pending:
            step = pending.pop()
            if isinstance(step, str):
                self._terms.unbind(step)
                continue
            entered.append(step)
            if not step.reported:
                self._enter(step)
            for variable in step.prefix.scope if step.prefix is not None else ():
                self._terms.bind(variable)
                pending.append(variable)
            pending.extend(reversed(step.operands))
        # A form is entered before its operands, so the reverse order builds from the inside out.
        for step in reversed(entered):
            if step.word:
                step.formula = _build(step)
        return root.formula

    def _enter(self, step: _Step) -> None:
        """Classify a form; set its operands, or its formula when it is an atom."""
        item = step.item
        if isinstance(item, Word):
            self._report_word(item)
            return
        head = item.head
        if head is None:
            self._report_headless(step, item)
        elif head.key in self._profile.forms:
            self._enter_form(step, item, head)
        elif head.key in self._profile.absent_forms:
            legal = sorted(self._profile.forms)
            message = f"The profile `{self._profile.name}` has no form `{head.key}`."
            hint = f"the forms are: {', '.join(legal)}"
            self._reporter.add("unsupported-form", head.span, message, expected=legal, hint=hint)
        elif head.key == "define":
            message, hint = (
                "A problem cannot stand inside a formula.",
                "give the problem alone, as (define (problem NAME) ...)",
            )
            self._reporter.add("wrong-kind", head.span, message, expected=self._profile.words, hint=hint)
        elif head.key not in self._profile.predicates and any(map(is_binder, item.items[1:])):
            self._enter_unknown_quantifier(step, item, head)
        else:
            step.formula = self._terms.read_atom(item, head)
            if head.key not in self._profile.predicates:
                # An unknown word may be a misspelt connective: what it holds is read for further mistakes.
                step.operands = [_Step(operand) for operand in item.items[1:] if isinstance(operand, Group)]

    def _enter_unknown_quantifier(self, step: _Step, group: Group, head: Word) -> None:
        self._terms.report_predicate(group, head)
        binders = [item for item in group.items[1:] if is_binder(item)]
        scope = tuple(name for binder in binders for name in intended_variables(binder, self._profile)[:1])
        step.prefix = Prefix((), (), None, scope, (), False)
        inner = (item for item in group.items[1:] if isinstance(item, Group) and item not in binders)
        step.operands = [_Step(item) for item in inner if item.head is None or not item.head.text.isdecimal()]

    def _enter_form(self, step: _Step, group: Group, head: Word) -> None:
        operands: Sequence[Item] = group.items[1:]
        legal = True
        if head.key in QUANTIFIER_WORDS:
            step.prefix = BinderReader(self._terms, head, self._reporter).read(operands)
            legal, operands = step.prefix.legal, step.prefix.rest
        step.operands = self._operand_steps(group, head, operands)
        wanted = operand_count(head.key)
        if wanted is not None and len(step.operands) != wanted:
            if head.key == "not" and step.operands and self._reporter.tolerates("wrong-arity", "surplus"):
                self._report_count(group, head, step.operands, wanted)
                step.operands, step.word = step.operands[:1], head.key
                return
            if legal:
                self._report_count(group, head, step.operands, wanted)
        elif legal:
            step.word = head.key

    def _operand_steps(self, group: Group, head: Word, operands: Sequence[Item]) -> list[_Step]:
        """Return a step for each operand; operands without their parentheses are reported here, as one."""
        if len(operands) > 1 and all(isinstance(item, Word) for item in operands):
            first = operands[0]
            if isinstance(first, Word) and first.key in self._profile.words:
                self._report_loose(group, head, words_of(operands))
                return [_Step(first, reported=True)]
        steps: list[_Step] = []
        position = 0
        while position < len(operands):
            call = operands[position : position + 2]
            if is_call(call):
                self._report_call(call)
            steps.append(_Step(operands[position], reported=is_call(call)))
            position += 2 if is_call(call) else 1
        return steps

    def _report_word(self, word: Word) -> None:
        spec = self._profile.predicates.get(word.key)
        shape = spec.shape if spec is not None else f"(open {word.text})"
        self._reporter.add(
            "not-a-formula",
            word.span,
            f"A formula in parentheses belongs here, not the word `{word.text}`.",
            expected=("(",),
            hint=f"write a formula, such as {shape}" if word.kind == "NAME" else "",
        )

    def _report_headless(self, step: _Step, group: Group) -> None:
        if not group.items:
            self._reporter.add(
                "empty-form",
                group.span,
                "These parentheses hold nothing.",
                expected=self._profile.words,
                hint="remove them, or write a formula such as (open refrigerator_0)",
            )
            return
        alone = self._reporter.quote(group.items[0].span) if len(group.items) == 1 else ""
        self._reporter.add(
            "not-a-name",
            group.items[0].span,
            "A connective or a predicate belongs here, not another form.",
            expected=self._profile.words,
            hint=f"remove the outer parentheses: {alone}" if alone else "join formulas with (and ...)",
            replacement=self._reporter.replacement_for(group.span, alone),
        )
        step.operands = [_Step(operand) for operand in group.items if isinstance(operand, Group)]

    def _report_count(self, group: Group, head: Word, operands: Sequence[_Step], wanted: int) -> None:
        if group.closed.invented:
            return
        surplus = operands[wanted:]
        parts = [self._reporter.quote(step.item.span) for step in operands]
        hint, joined = f"write {FORM_SHAPES[head.key]}", ""
        if surplus and wanted == 1 and all(parts) and head.key == "not":
            joined = f"(not (and {' '.join(parts)}))"
            hint = f"write {joined}, or negate each of them: " + " ".join(f"(not {part})" for part in parts)
        self._reporter.add(
            "wrong-arity",
            surplus[0].item.span if surplus else head.span,
            f"`{head.key}` takes {wanted} formula{'' if wanted == 1 else 's'}, here it has {len(operands) or 'none'}.",
            expected=(FORM_SHAPES[head.key],),
            hint=hint,
            case="surplus" if surplus and head.key == "not" else "",
            replacement=self._reporter.replacement_for(group.span, joined),
        )

    def _report_loose(self, group: Group, head: Word, words: Sequence[Word]) -> None:
        inner = f"({' '.join(word.text for word in words)})"
        plain = head.key not in QUANTIFIER_WORDS
        self._reporter.add(
            "no-parentheses",
            self._reporter.place(words[0].offset, words[-1].end - words[0].offset),
            f"The formula inside `{head.key}` lacks its own parentheses.",
            expected=("(",),
            hint=f"write ({head.key} {inner})",
            replacement=self._reporter.replacement_for(group.span, f"({head.key} {inner})") if plain else None,
        )

    def _report_call(self, call: Sequence[Item]) -> None:
        place = self._reporter.place(call[0].offset, call[1].end - call[0].offset)
        converted = one_line(" ".join(word.text for word in to_prefix(words_of(call))))
        self._reporter.add(
            "function-notation",
            place,
            "In BDDL the predicate stands inside the parentheses.",
            expected=("(",),
            hint=f"write {converted}",
            replacement=self._reporter.replacement_for(place, converted),
        )


def _build(step: _Step) -> Formula | None:
    parts = tuple(operand.formula for operand in step.operands if operand.formula is not None)
    if len(parts) != len(step.operands):
        return None
    make: Callable[..., Formula] = FORMS[step.word]
    if step.prefix is None:
        return make(parts, span=step.item.span) if step.word in ("and", "or") else make(*parts, span=step.item.span)
    names = (name for binder in step.prefix.binders for name in binder)
    count = {} if step.prefix.number is None else {"count": step.prefix.number}
    return make(*names, parts[0], span=step.item.span, variable_spans=step.prefix.spans, **count)
