"""Domains read from mappings; the first mistake is refused with its place."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from typing import Any

import bddl
from oag.model.domain import (
    ANY_WORD,
    KINDS,
    ROBOT_WORDS,
    THING,
    WITH_INVARIANTS,
    DomainError,
    Row,
    Span,
    dialect,
    marked,
)
from oag.model.symbols import GRIPPER, HAND, ROBOT_FACTS, Primitive

MOST_NUMBER = 1e300
_KEYWORDS = frozenset(("and", "or", "not", "imply", "forall", "exists", "when", "forn", "forpairs", "fornpairs"))


# The checker of certificates reads domains, and shares no codec with the verifier.
def _expected(what: str, value: object) -> str:
    return f"expected {what}, got {value!r:.60}"


def _near(name: str, legal: Iterable[str], otherwise: str = "") -> str:
    near = bddl.near_names(name, tuple(legal))
    return f"did you mean {' or '.join(near)}?" if near else otherwise


class Reading:
    """The reading of a domain from a mapping; a mistake ends it."""

    def __init__(self, data: object, source: str) -> None:
        self._source = source
        self._data = self._table(data, "", "name inherits predicates kinds types primitives")

    def parts(self) -> dict[str, Any]:
        """Return the fields of the domain."""
        data = self._data
        name, inherits = data.get("name"), data.get("inherits", True)
        if not isinstance(name, str) or not _is_name(name):
            raise self._fail(_expected("a name, such as pushing", name), "name")
        if not isinstance(inherits, bool):
            raise self._fail(_expected("true or false", inherits), "inherits")
        own = {key: self._predicate(key, names, inherits) for key, names in self._part(data, "predicates").items()}
        types = {key: self._word(what, f"types.{key}") for key, what in self._part(data, "types").items()}
        kinds = {}
        for key, word in self._part(data, "kinds").items():
            if not isinstance(word, str) or word not in KINDS:
                raise self._fail(_expected(f"one of {', '.join(KINDS)}", word), f"kinds.{key}")
            kinds[key] = KINDS[word]
        named = {
            key: bddl.PredicateSpec(key, names, "")
            for key, names in {
                **({key: spec.parameters for key, spec in bddl.PREDICATES.items()} if inherits else {}),
                **({key: ("x",) * count for key, (count, _, _) in ROBOT_WORDS.items()} if inherits else {}),
                **own,
            }.items()
        }
        self._profile, self._robot, self._categories = dialect(name, named), inherits, {*kinds, *types, *types.values()}
        self._words = {*self._part(data, "primitives"), *(Primitive.__members__ if inherits else ())}
        rows = {key: self._row(key, row) for key, row in self._part(data, "primitives").items()}
        return {"name": name, "inherits": inherits, "own_predicates": own, "kinds": kinds, "types": types, "rows": rows}

    def _fail(self, problem: str, place: str, hint: str = "") -> DomainError:
        return DomainError(problem, source=self._source, place=place, hint=hint)

    def _table(self, given: object, place: str, legal: str = "") -> Mapping[str, Any]:
        if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
            raise self._fail(_expected("a table", given), place)
        for key in given if legal else ():
            if key not in legal.split():
                at = f"{place}.{key}" if place else key
                raise self._fail("there is no such field", at, _near(key, legal.split(), f"fields are {legal}"))
        return given

    def _part(self, data: Mapping[str, Any], name: str, place: str = "") -> Mapping[str, Any]:
        return self._table(data.get(name, {}), f"{place}{name}")

    def _word(self, given: object, place: str) -> str:
        if not isinstance(given, str) or not given:
            raise self._fail(_expected("a word", given), place)
        return given

    def _texts(self, given: object, place: str) -> list[str]:
        if not isinstance(given, list | tuple):
            raise self._fail(_expected("a list of texts", given), place)
        return [self._word(one, f"{place}[{index}]") for index, one in enumerate(given)]

    def _predicate(self, name: str, names: object, inherits: bool) -> tuple[str, ...]:
        place = f"predicates.{name}"
        if not _is_name(name) or name != name.lower():
            raise self._fail(f"{name!r:.60} is no name of a predicate: lower case, a letter first", place)
        if name in _KEYWORDS:
            raise self._fail(f"{name} is a word of formulas", place, "name it otherwise")
        taken = {*bddl.PREDICATES, *ROBOT_WORDS} if inherits else {*WITH_INVARIANTS}
        taken |= {"holding"} if inherits else set()
        taken |= {fact[0] for fact in ROBOT_FACTS}
        if name in taken:
            why = "is part of what is inherited" if inherits else "has a meaning that rows cannot give it"
            raise self._fail(f"{name} {why}", place, "name it otherwise")
        return tuple(self._texts(names, place))

    def _row(self, name: str, given: object) -> Row:
        place = f"primitives.{name}"
        data = self._table(given, place, "objects needs writes unknown number failures flow")
        if not name.isidentifier() or name != name.upper() or (self._robot and name in Primitive.__members__):
            raise self._fail("expected a name in capitals, none of the 21, such as PUSH", place)
        objects = self._objects(data.get("objects"), f"{place}.objects")
        variables = [variable for variable, _ in objects]
        needs = tuple(self._formulas(data, place, "needs", variables))
        writes = list(self._formulas(data, place, "writes", [*variables, ANY_WORD]))
        unknown = list(self._formulas(data, place, "unknown", [*variables, ANY_WORD]))
        for part, formulas in (("writes", writes), ("unknown", unknown)):
            for formula in formulas:
                self._check_write(formula, part == "unknown", f"{place}.{part}")
        self._check_together(writes, unknown, place)
        flow = data.get("flow", ())
        if not isinstance(flow, list | tuple):
            raise self._fail(_expected('a list, such as [17, "PUSH", 6]', flow), f"{place}.flow")
        for index, step in enumerate(flow):
            self._check_step(step, f"{place}.flow[{index}]")
        return Row(
            name,
            objects,
            needs,
            # Denials first, as they are written.
            tuple(sorted((each for one in writes for each in bddl.literals(one) or ()), key=lambda each: each.value)),
            tuple(formula for formula in unknown if isinstance(formula, bddl.Atom)),
            self._number(data.get("number"), f"{place}.number"),
            tuple(self._texts(data.get("failures", ()), f"{place}.failures")),
            tuple(flow),
            self._robot,
        )

    def _objects(self, given: object, place: str) -> tuple[tuple[str, str], ...]:
        pairs: Any = list(given.items()) if isinstance(given, Mapping) else given
        if not isinstance(pairs, list | tuple) or not pairs:
            raise self._fail(_expected('at least the target, as in [["?puck", "item"]]', given), place)
        found: list[tuple[str, str]] = []
        for index, pair in enumerate(pairs):
            at = f"{place}[{index}]"
            if not isinstance(pair, list | tuple) or len(pair) != 2:
                raise self._fail(_expected('a variable and what it is, as in ["?puck", "item"]', pair), at)
            variable = self._word(pair[0], at).removeprefix("?")
            if not _is_name(variable) or variable in (ANY_WORD, GRIPPER, *(name for name, _ in found)):
                raise self._fail(f"?{variable} cannot name an object here", at)
            found.append((variable, self._what(pair[1], at)))
        return tuple(found)

    def _what(self, given: object, place: str) -> str:
        """Return a kind or a category; what is nearly a kind's name, and no category of the domain, is refused."""
        word = self._word(given, place)
        if word not in (THING, *KINDS, *self._categories) and (hint := _near(word, (THING, *KINDS))):
            raise self._fail(f"{word!r:.60} is no kind", place, f"{hint} A category of this name is listed in kinds")
        return word

    def _check_step(self, step: object, place: str) -> None:
        key: object = step
        if isinstance(step, Mapping):
            numbers = list(step.values())
            pair = len(numbers) == 1 and isinstance(numbers[0], list | tuple) and len(numbers[0]) == 2
            numbers = list(numbers[0]) if pair else numbers
            key = next(iter(step)) if step and all(type(each) in (int, float) for each in numbers) else None
        if isinstance(key, str) and key.isdecimal() and len(key) < 4:
            key = int(key)
        numbered = type(key) is int and self._robot and 1 <= key <= len(Primitive)
        if not numbered and not (isinstance(key, str) and key.split()[:1] and key.split()[0] in self._words):
            raise self._fail(_expected('a step, such as 17, "PUSH" or { 8 = 0.05 }', step), place)

    def _formulas(self, data: Mapping[str, Any], place: str, part: str, variables: list[str]) -> Iterator[bddl.Formula]:
        texts = self._texts(data.get(part, ()), f"{place}.{part}")
        return (self._formula(text, f"{place}.{part}", variables) for text in texts)

    def _formula(self, text: object, place: str, variables: list[str]) -> bddl.Formula:
        try:
            formula = bddl.parse_formula(self._word(text, place).replace("?", ""), self._profile)
        except bddl.BDDLError as problem:
            raise self._fail(problem.first_messages, place, problem.first_hint) from problem
        if bddl.literals(formula) is None or isinstance(formula, bddl.And):
            parts = formula.parts if isinstance(formula, bddl.Or) else ()
            if not parts or any(isinstance(part, bddl.And) or bddl.literals(part) is None for part in parts):
                hint = "write a conjunction as several literals"
                raise self._fail(f"{text!r:.60} is no literal and no choice of literals", place, hint)
        for atom in bddl.atoms(formula):
            for name in atom.args:
                if name == GRIPPER and (not self._robot or atom.predicate != "inside" or atom.args[0] == GRIPPER):
                    raise self._fail(f"{marked(atom)} is no fact about the gripper", place, "write (inside ?a gripper)")
                if name not in variables and name != GRIPPER:
                    named = ", ".join(f"?{each}" for each in variables)
                    raise self._fail(f"?{name} is none of the objects {named}", place, _near(name, variables))
        return formula

    def _check_write(self, formula: bddl.Formula, unknown: bool, place: str) -> None:
        literals = bddl.literals(formula)
        if literals is None or (unknown and not isinstance(formula, bddl.Atom)):
            raise self._fail(f"{marked(formula)} is no {'atom' if unknown else 'literal'}", place)
        for atom, value in ((each.atom, each.value) for each in literals):
            if value and not unknown and ANY_WORD in atom.args:
                raise self._fail(f"{marked(atom)} would hold for every object", place, "?any is for denials")
            if len(atom.args) > 2 and 0 < atom.args.count(ANY_WORD) < len(atom.args):
                raise self._fail(f"{marked(atom)} has ?any in some places", place, "write ?any in all, or in none")
            about_robot = self._robot and (atom.predicate in ROBOT_WORDS or GRIPPER in atom.args)
            if about_robot and (unknown or not value):
                raise self._fail(f"{marked(formula)} leaves the robot open", place, "write what is so: (handempty)")

    def _check_together(self, writes: list[bddl.Formula], unknown: list[bddl.Formula], place: str) -> None:
        """Refuse two values of one fact, and two things put somewhere by one row, which may make a circle."""
        literals = [each for formula in writes for each in bddl.literals(formula) or ()]
        affirmed = [each.atom for each in literals if each.value]
        denied = [each.atom for each in literals if not each.value]
        opened = [each for each in unknown if isinstance(each, bddl.Atom)]
        for atom in affirmed:
            if atom in denied or atom in opened:
                raise self._fail(f"{marked(atom)} has two values", f"{place}.writes", "write one of them")
        for one, other in product(denied, opened):
            if _clash(one, other):
                problem = f"(not {marked(one)}) and the unknown {marked(other)} have a fact in common"
                raise self._fail(problem, f"{place}.unknown", "write one of them")
        robot = [ROBOT_WORDS[each.predicate][1] for each in affirmed if self._robot and each.predicate in ROBOT_WORDS]
        robot += [HAND for each in affirmed if self._robot and GRIPPER in each.args]
        for variable in robot:
            if robot.count(variable) > 1:
                raise self._fail(f"the {variable[0]} has two values", f"{place}.writes", "write one of them")
        put = {each.args[0] for each in affirmed if each.predicate in WITH_INVARIANTS[1:] and each.args[-1] != GRIPPER}
        if self._robot and len(put) > 1:
            problem = f"it puts {' and '.join(f'?{name}' for name in sorted(put))} somewhere"
            raise self._fail(problem, f"{place}.writes", "one row puts one thing somewhere; write two rows")

    def _number(self, given: object, place: str) -> Span | None:
        if given is None:
            return None
        if isinstance(given, list | tuple) and len(given) == 3 and isinstance(given[2], str):
            low, high = given[0], given[1]
            legal = all(type(each) in (int, float) and -MOST_NUMBER <= each <= MOST_NUMBER for each in (low, high))
            if legal and low <= high:
                return Span(float(low), float(high), given[2])
        raise self._fail(_expected('[least, most, "unit"], such as [0.01, 0.5, "m"]', given), place)


def _clash(one: bddl.Atom, other: bddl.Atom) -> bool:
    """Decide whether two atoms with `?any` have an instance in common, and neither is an exception to the other."""
    if one.predicate != other.predicate or len(one.args) != len(other.args):
        return False
    unlike = [(a, b) for a, b in zip(one.args, other.args, strict=True) if a != b]
    if not all(ANY_WORD in pair for pair in unlike):
        return False
    return not unlike or len({a == ANY_WORD for a, _ in unlike}) > 1


def _is_name(text: str) -> bool:
    return text.replace("-", "_").isidentifier() and text.isascii()
