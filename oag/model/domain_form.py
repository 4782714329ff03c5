"""Domains read from mappings; the first mistake is refused with its place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import bddl
from oag.model.domain import ANY_WORD, KINDS, ROBOT_WORDS, WITH_INVARIANTS, DomainError, Row, Span, dialect, marked
from oag.model.symbols import GRIPPER, ROBOT_FACTS, Primitive


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
            if word not in KINDS:
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
        self._profile, self._robot, self._named = dialect(name, named), inherits, named
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
        needs = tuple(self._formula(text, f"{place}.needs", variables) for text in data.get("needs", ()))
        writes = [self._formula(text, f"{place}.writes", [*variables, ANY_WORD]) for text in data.get("writes", ())]
        unknown = [self._formula(text, f"{place}.unknown", [*variables, ANY_WORD]) for text in data.get("unknown", ())]
        for part, formulas in (("writes", writes), ("unknown", unknown)):
            for formula in formulas:
                self._check_write(formula, part == "unknown", f"{place}.{part}")
        flow = data.get("flow", ())
        if not isinstance(flow, list | tuple):
            raise self._fail(_expected('a list, such as [17, "PUSH", 6]', flow), f"{place}.flow")
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
            found.append((variable, self._word(pair[1], at)))
        return tuple(found)

    def _formula(self, text: object, place: str, variables: list[str]) -> bddl.Formula:
        try:
            formula = bddl.parse_formula(self._word(text, place).replace("?", ""), self._profile)
        except bddl.BDDLError as problem:
            raise self._fail(problem.first_messages, place) from problem
        if bddl.literals(formula) is None or isinstance(formula, bddl.And):
            parts = formula.parts if isinstance(formula, bddl.Or) else ()
            if not parts or any(isinstance(part, bddl.And) or bddl.literals(part) is None for part in parts):
                hint = "write a conjunction as several literals"
                raise self._fail(f"{text!r:.60} is no literal and no choice of literals", place, hint)
        for atom in bddl.atoms(formula):
            for name in atom.args:
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
            about_robot = self._robot and (atom.predicate in ROBOT_WORDS or GRIPPER in atom.args)
            if about_robot and (unknown or not value):
                raise self._fail(f"{marked(formula)} leaves the robot open", place, "write what is so: (handempty)")

    def _number(self, given: object, place: str) -> Span | None:
        if given is None:
            return None
        if isinstance(given, list | tuple) and len(given) == 3 and isinstance(given[2], str):
            low, high = given[0], given[1]
            if all(type(each) in (int, float) and math.isfinite(each) for each in (low, high)) and low <= high:
                return Span(float(low), float(high), given[2])
        raise self._fail(_expected('[least, most, "unit"], such as [0.01, 0.5, "m"]', given), place)


def _is_name(text: str) -> bool:
    return text.replace("-", "_").isidentifier() and text.isascii()
