"""Domains as data: predicates, kinds of things, and primitives as rows, beside the 21 primitives or without them.

A row states what a primitive needs and writes, as literals over its objects. The first object is the target of the
subtask, the second its goal support; a flow names further ones behind the primitive: `"SLIDE table_0"`.

The built-in domain has no rows of its own: those of the 21 primitives depend on more than their objects, and stand in
`oag.primitives.table`. A scene carries the domain that it is described in.

Source: docs/semantics.md, Own domains.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from itertools import product
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import bddl
from bddl.errors import Scene2DemoError
from oag.model.symbols import (
    ANY,
    EEF,
    EMPTY,
    FREE,
    GRIPPER,
    HAND,
    HOME,
    NEAR,
    ROBOT_FACTS,
    Condition,
    Fact,
    Kind,
    Parameter,
    ParameterKind,
    Primitive,
    Value,
    condition_of,
    gripping,
    has_inside,
)

Clause = tuple[Condition, ...]
Effect = tuple[tuple[Fact, Value], ...]
TARGET, SUPPORT, THING = "target", "support", "object"
KINDS = {"item": Kind.ITEM, "support": Kind.SUPPORT, "fixture": Kind.ARTICULATED}
"""Words for kinds in a domain's data."""
LAST_BUILT_IN = len(Primitive)
"""Primitives of own domains have larger numbers."""
MOST_BOUND = 5_000
"""Choices of objects that a search may try for one subtask."""
_ANY_WORD = "any"
# The robot's variables as predicates of rows: number of names, fact, and value.
_ROBOT: Mapping[str, tuple[int, Fact, str]] = {
    "near": (1, NEAR, "{}"),
    "before": (1, EEF, "before {}"),
    "at": (1, EEF, "at {}"),
    "gripping": (1, HAND, gripping("{}")),
    "home": (0, EEF, HOME),
    "free": (0, EEF, FREE),
    "handempty": (0, HAND, EMPTY),
}
# Predicates with a meaning beyond what rows write of them: invariants, cargo, kinds.
WITH_INVARIANTS = ("open", "ontop", "inside")


class DomainError(Scene2DemoError):
    """A domain cannot be used: a name, a row or a kind is not as documented.

    Attributes:
        source: The file's name, or "(mapping)".
        place: Where in it, such as `primitives.PUSH.needs`.
    """

    def __init__(self, problem: str, *, source: str = "(mapping)", place: str = "", hint: str = "") -> None:
        self.source, self.place, self.problem, self.hint = source, place, problem, hint
        where = f"{source}: {place}" if place else source
        super().__init__(f"domain {where}: {problem}" + (f" ({hint})" if hint else ""))


# The checker of certificates reads domains, and shares no codec with the verifier.
def _expected(what: str, value: object) -> str:
    return f"expected {what}, got {value!r:.60}"


def _near(name: str, legal: Iterable[str], otherwise: str = "") -> str:
    near = bddl.near_names(name, tuple(legal))
    return f"did you mean {' or '.join(near)}?" if near else otherwise


@dataclass(frozen=True, slots=True)
class Span:
    """The range of a primitive's number.

    Attributes:
        least: Smallest value, in `unit`.
        most: Largest value, in `unit`.
        unit: Such as "m", "deg" or "s".
    """

    least: float
    most: float
    unit: str

    def problem(self, parameter: Parameter) -> str | None:
        """Decide whether a number is in the range: None when it is, else what is wrong."""
        if isinstance(parameter, float | int) and self.least <= parameter <= self.most:
            return None
        return f"takes one number from {self.least:g} to {self.most:g} {self.unit}, got {parameter!r:.60}"


@dataclass(frozen=True, slots=True)
class Row:
    """One primitive of an own domain.

    Attributes:
        objects: Variables with what each stands for: a kind, a category, or "object". The first is the target.
        needs: Literals that must hold before it, or alternatives such as `(or (open ?a) (not (inside ?b ?a)))`.
        writes: Literals that hold after it; `?any` in a denial stands for every object.
        unknown: Atoms that are unknown after it.
        number: Range of the number that it takes, or None.
        failures: How it can fail, in words.
        flow: Steps that usually contain it, in the JSON form of flows; () for itself alone.
        robot: True when its literals may be about the robot: `near`, `before`, `at`, `gripping`, `handempty`, ...
    """

    name: str
    objects: tuple[tuple[str, str], ...]
    needs: tuple[bddl.Formula, ...]
    writes: tuple[bddl.Literal, ...]
    unknown: tuple[bddl.Atom, ...] = ()
    number: Span | None = None
    failures: tuple[str, ...] = ()
    flow: tuple[Any, ...] = ()
    robot: bool = True

    def __hash__(self) -> int:
        return hash(self.name)

    def to_json(self) -> dict[str, object]:
        """Return the row as domain files have it."""
        span = self.number
        return {
            "objects": [[f"?{variable}", what] for variable, what in self.objects],
            "needs": [marked(each) for each in self.needs],
            "writes": [marked(each.formula) for each in self.writes],
            "unknown": [marked(each) for each in self.unknown],
            "number": None if span is None else [span.least, span.most, span.unit],
            "failures": list(self.failures),
            "flow": list(self.flow),
        }


def marked(formula: bddl.Formula) -> str:
    """Return a formula's text with a question mark before each name but the gripper."""
    if isinstance(formula, bddl.Atom):
        return f"({' '.join((formula.predicate, *(n if n == GRIPPER else f'?{n}' for n in formula.args)))})"
    if isinstance(formula, bddl.Not):
        return f"(not {marked(formula.body)})"
    parts = formula.parts if isinstance(formula, bddl.Or) else ()
    return f"(or {' '.join(map(marked, parts))})"


class Own(NamedTuple):
    """A primitive of an own domain with the objects that a flow names behind it."""

    row: Row
    args: tuple[str, ...] = ()

    @property
    def parameter_kind(self) -> ParameterKind:
        """Which kind of parameter it takes."""
        return ParameterKind.NONE if self.row.number is None else ParameterKind.OWN

    def primitive(self) -> Primitive:
        """Return it as a primitive."""
        return _primitive(self)

    def names(self, target: str, support: str | None) -> dict[str, str]:
        """Return the objects of its variables in a subtask."""
        roles = (target, *(() if support is None else (support,)))[: len(self.row.objects)]
        return dict(zip((variable for variable, _ in self.row.objects), (*roles, *self.args), strict=False))


@lru_cache(maxsize=65536)
def _primitive(own: Own) -> Primitive:
    # A member beyond the 21, as combinations of flags are: it is listed by its domain alone.
    name = " ".join((own.row.name, *own.args))
    text = json.dumps([name, own.row.to_json()], sort_keys=True)
    number = LAST_BUILT_IN + 1 + int(hashlib.sha256(text.encode()).hexdigest()[:13], 16)
    made = int.__new__(Primitive, number)
    made.__dict__.update(_name_=name, _value_=number, own=own)
    return made


def own_of(primitive: Primitive) -> Own | None:
    """Return the row and the objects of an own domain's primitive; None for one of the 21."""
    own: Own | None = primitive.__dict__.get("own")
    return own


class Bound(NamedTuple):
    """A row with objects in place of its variables."""

    needs: tuple[Clause, ...]
    writes: Effect

    @property
    def facts(self) -> tuple[Fact, ...]:
        """The facts of the world that it reads or writes, without patterns."""
        read = (condition.fact for clause in self.needs for condition in clause)
        found = dict.fromkeys((*read, *(fact for fact, _ in self.writes)))
        return tuple(fact for fact in found if fact not in ROBOT_FACTS and ANY not in fact)


@lru_cache(maxsize=65536)
def bound(own: Own, target: str, support: str | None) -> Bound:
    """Return what a primitive needs and writes in a subtask; of writes to one fact the affirmed one counts."""
    names = own.names(target, support)
    row, names = own.row, own.names(target, support)
    needs = tuple(
        tuple(_condition(literal, names, row.robot) for literal in _alternatives(formula)) for formula in row.needs
    )
    writes: dict[Fact, Value] = {_fact(atom, names): None for atom in row.unknown}
    for literal in row.writes:
        condition = _condition(literal, names, row.robot)
        writes[condition.fact] = condition.value if condition.positive else False
        if literal.value and row.robot and condition.fact[0] in WITH_INVARIANTS[1:] and len(condition.fact) == 3:
            # The converse cannot hold as well.
            relation, thing, place = condition.fact
            writes[relation, place, thing] = False
    return Bound(needs, tuple(writes.items()))


def _alternatives(formula: bddl.Formula) -> tuple[bddl.Literal, ...]:
    parts = formula.parts if isinstance(formula, bddl.Or) else (formula,)
    return tuple(literal for part in parts for literal in bddl.literals(part) or ())


def _fact(atom: bddl.Atom, names: Mapping[str, str]) -> Fact:
    return (atom.predicate, *(ANY if name == _ANY_WORD else names.get(name, name) for name in atom.args))


def _condition(literal: bddl.Literal, names: Mapping[str, str], robot: bool) -> Condition:
    fact = _fact(literal.atom, names)
    if robot and fact[0] in _ROBOT:
        _, variable, value = _ROBOT[fact[0]]
        return Condition(variable, value.format(*fact[1:]), literal.value)
    if ANY in fact:
        return Condition(fact, True, literal.value)
    return condition_of(bddl.Atom(fact[0], fact[1:]), literal.value)


@dataclass(frozen=True)
class Domain:
    """What a scene and its plans are described in.

    Attributes:
        inherits: True when the 21 primitives, their predicates and the kinds of household nouns are part of it.
        own_predicates: Its own predicates with the names of their arguments.
        kinds: Its own categories with their kinds; they come before the household nouns.
        types: The category that a category is one of.
        rows: Its own primitives by name.
        digest: SHA-256 of all this; certificates carry it, with the table of the 21 primitives, as `library_sha`.
    """

    name: str
    inherits: bool = True
    own_predicates: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    kinds: Mapping[str, Kind] = field(default_factory=dict)
    types: Mapping[str, str] = field(default_factory=dict)
    rows: Mapping[str, Row] = field(default_factory=dict)

    def __hash__(self) -> int:
        return hash(self.name)

    def __getstate__(self) -> dict[str, object]:
        """Return what is sent to other processes; the rest is computed again."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def __repr__(self) -> str:
        base = "the 21 primitives and " if self.inherits else ""
        return f"<Domain {self.name!r}: {base}{', '.join(self.rows) or 'nothing of its own'}>"

    @classmethod
    def from_toml(cls, path: str | PathLike[str]) -> Self:
        """Return the domain of a TOML file; raises DomainError for anything that is not as documented."""
        import tomllib

        try:
            data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as problem:
            raise DomainError(f"cannot be read: {problem}", source=str(path)) from problem
        return cls.from_json(data, str(path))

    @classmethod
    def from_json(cls, data: Mapping[str, Any], source: str = "(mapping)") -> Self:
        """Return the domain of a mapping of the form that `to_json` writes; `source` is for messages.

        Raises:
            DomainError: The first thing that is not as documented, with its place.

        Example:
            >>> row = {"objects": {"?lamp": "item"}, "needs": ["(near ?lamp)"], "writes": ["(lit ?lamp)"]}
            >>> Domain.from_json({"name": "lamps", "predicates": {"lit": ["lamp"]}, "primitives": {"LIGHT": row}})
            <Domain 'lamps': the 21 primitives and LIGHT>
        """
        return cls(**_Reading(data, source).parts())

    def to_json(self) -> dict[str, object]:
        """Return the mapping that `from_json` reads back into an equal domain."""
        words = {kind: word for word, kind in KINDS.items()}
        return {
            "name": self.name,
            "inherits": self.inherits,
            "predicates": {name: list(names) for name, names in self.own_predicates.items()},
            "kinds": {category: words[kind] for category, kind in self.kinds.items()},
            "types": dict(self.types),
            "primitives": {name: row.to_json() for name, row in self.rows.items()},
        }

    @cached_property
    def digest(self) -> str:
        """SHA-256 of what the domain adds to the 21 primitives, or has without them."""
        return hashlib.sha256(json.dumps(self.to_json(), sort_keys=True).encode()).hexdigest()

    @property
    def built_in(self) -> bool:
        """True when it is the domain without anything of its own."""
        return self is BUILT_IN or self == BUILT_IN

    @property
    def binary(self) -> bool:
        """True when no row has objects beyond a target and a support."""
        return all(len(row.objects) <= 2 for row in self.rows.values())

    @cached_property
    def predicates(self) -> Mapping[str, bddl.PredicateSpec]:
        """All predicates that facts, conditions and goals may have."""
        own = {
            name: bddl.PredicateSpec(name, tuple(f"?{each}" for each in names), "")
            for name, names in self.own_predicates.items()
        }
        return MappingProxyType({**(bddl.PREDICATES if self.inherits else {}), **own})

    @cached_property
    def profile(self) -> str | bddl.Profile:
        """The dialect of its formulas."""
        if self.built_in:
            return "scene"
        return _dialect(self.name, self.predicates)

    def formula(self, text: str) -> bddl.Formula:
        """Return the formula of a text in the domain's predicates; raises `bddl.BDDLError`."""
        return bddl.parse_formula(text, self.profile)

    def kind_of(self, category: str) -> Kind | None:
        """Return the kind that the domain gives a category, or None."""
        return next((self.kinds[each] for each in self.line(category) if each in self.kinds), None)

    def line(self, category: str) -> tuple[str, ...]:
        """Return a category and all that it is one of."""
        found = [category]
        while (above := self.types.get(found[-1])) is not None and above not in found:
            found.append(above)
        return tuple(found)

    def fits(self, what: str, category: str, kind: Kind) -> bool:
        """Decide whether an object of a category and kind can be what a row asks for."""
        return what == THING or KINDS.get(what) is kind or what in self.line(category)

    def primitive(self, written: str) -> Primitive | None:
        """Return the own primitive of a flow's word, such as `SLIDE table_0`; None when there is no such row."""
        name, *args = written.split()
        row = self.rows.get(name) or self.rows.get(name.upper().replace("-", "_"))
        return None if row is None else Own(row, tuple(args)).primitive()

    def problem(self, own: Own, target: str, support: str | None, things: Mapping[str, tuple[str, Kind]]) -> str | None:
        """Decide whether a primitive can act in a subtask: None when it can, else what is wrong.

        Args:
            own: The row, and the objects that the flow names.
            target: The subtask's target, and `support` its goal support.
            things: Category and kind of each object.
        """
        row = own.row
        if self.rows.get(row.name) != row:
            return f"is no primitive of the domain {self.name}"
        wanted, names = [what for _, what in row.objects], own.names(target, support)
        if self.inherits and support == target:
            return f"has {target} as its target and as its support"
        if len(wanted) > 1 and support is None:
            return f"is about {_list(f'?{variable}' for variable, _ in row.objects)}, and support_goal is null"
        if len(own.args) != max(0, len(wanted) - 2):
            further = _list(f"?{variable} ({what})" for variable, what in row.objects[2:]) or "no further object"
            return f"takes {further}, got {_list(own.args) or 'none'}"
        for name, what in zip(names.values(), wanted, strict=True):
            if name not in things:
                return f"is about {name}, which the scene does not have"
            if not self.fits(what, *things[name]):
                return f"takes {what} there, and {name} is {things[name][0]} ({things[name][1].value})"
        for fact, value in bound(own, target, support).writes if self.inherits else ():
            thing = things.get(fact[-1])
            if value is True and thing is not None and fact[0] in ("open", "inside"):
                if fact[0] == "open" and thing[1] is not Kind.ARTICULATED:
                    return f"opens {fact[-1]}, which has no joint"
                if fact[0] == "inside" and not has_inside(thing[0]):
                    return f"puts something inside {fact[-1]}, which has no inside"
        return None

    @cached_property
    def written(self) -> frozenset[str]:
        """The predicates that its own primitives write."""
        return frozenset(literal.atom.predicate for row in self.rows.values() for literal in row.writes)

    def arguments(
        self, row: Row, things: Mapping[str, tuple[str, Kind]]
    ) -> Iterator[tuple[str, str | None, tuple[str, ...]]]:
        """Yield target, support and further objects of a row by their kinds; raises DomainError for too many."""
        legal = [[name for name, thing in things.items() if self.fits(what, *thing)] for _, what in row.objects]
        if math.prod(map(len, legal)) > MOST_BOUND:
            problem = f"{row.name} has more than {MOST_BOUND} choices of objects in this scene"
            raise DomainError(problem, source=self.name, hint="give the subtasks their flows")
        for target, *rest in product(*legal):
            yield target, rest[0] if rest else None, tuple(rest[1:])

    def choices(self, target: str, support: str | None, things: Mapping[str, tuple[str, Kind]]) -> Iterator[Primitive]:
        """Yield the own primitives that can act in a subtask, with every choice of further objects.

        Raises DomainError where these are more than `MOST_BOUND`.
        """
        for row in self.rows.values():
            for args in dict.fromkeys(args for _, _, args in self.arguments(row, things)):
                own = Own(row, args)
                if self.problem(own, target, support, things) is None:
                    yield own.primitive()


def _list(names: Iterable[str]) -> str:
    return ", ".join(names)


def _dialect(name: str, predicates: Mapping[str, bddl.PredicateSpec]) -> bddl.Profile:
    profile = bddl.PROFILES["scene"]
    return replace(profile, name=f"{profile.name} of the domain {name}", predicates=predicates)


class _Reading:
    """The reading of a domain from a mapping; a mistake ends it."""

    def __init__(self, data: object, source: str) -> None:
        self._source = source
        self._data = self._table(data, "", "name inherits predicates kinds types primitives")

    def parts(self) -> dict[str, Any]:
        """Return the fields of the domain."""
        data = self._data
        name, inherits = data.get("name"), data.get("inherits", True)
        if not isinstance(name, str) or not bddl_name(name):
            raise self._fail(_expected("a name, such as pushing", name), "name")
        if not isinstance(inherits, bool):
            raise self._fail(_expected("true or false", inherits), "inherits")
        own = {key: self._predicate(key, names, inherits) for key, names in self._part(data, "predicates").items()}
        types = {key: self._word(what, f"types.{key}") for key, what in self._part(data, "types").items()}
        kinds = {}
        for key, word in self._part(data, "kinds").items():
            if word not in KINDS:
                raise self._fail(_expected(f"one of {_list(KINDS)}", word), f"kinds.{key}")
            kinds[key] = KINDS[word]
        named = {
            key: bddl.PredicateSpec(key, names, "")
            for key, names in {
                **({key: spec.parameters for key, spec in bddl.PREDICATES.items()} if inherits else {}),
                **({key: ("x",) * count for key, (count, _, _) in _ROBOT.items()} if inherits else {}),
                **own,
            }.items()
        }
        self._profile, self._robot, self._named = _dialect(name, MappingProxyType(named)), inherits, named
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
        if not bddl_name(name) or name != name.lower():
            raise self._fail(f"{name!r:.60} is no name of a predicate: lower case, a letter first", place)
        taken = {*bddl.PREDICATES, *_ROBOT} if inherits else {*WITH_INVARIANTS}
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
        writes = [self._formula(text, f"{place}.writes", [*variables, _ANY_WORD]) for text in data.get("writes", ())]
        unknown = [self._formula(text, f"{place}.unknown", [*variables, _ANY_WORD]) for text in data.get("unknown", ())]
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
        found = []
        for index, pair in enumerate(pairs):
            at = f"{place}[{index}]"
            if not isinstance(pair, list | tuple) or len(pair) != 2:
                raise self._fail(_expected('a variable and what it is, as in ["?puck", "item"]', pair), at)
            variable = self._word(pair[0], at).removeprefix("?")
            if not bddl_name(variable) or variable in (_ANY_WORD, GRIPPER, *(name for name, _ in found)):
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
                    problem = f"?{name} is none of the objects {_list(f'?{each}' for each in variables)}"
                    raise self._fail(problem, place, _near(name, variables))
        return formula

    def _check_write(self, formula: bddl.Formula, unknown: bool, place: str) -> None:
        literals = bddl.literals(formula)
        if literals is None or (unknown and not isinstance(formula, bddl.Atom)):
            raise self._fail(f"{marked(formula)} is no {'atom' if unknown else 'literal'}", place)
        for atom, value in ((each.atom, each.value) for each in literals):
            if value and not unknown and _ANY_WORD in atom.args:
                raise self._fail(f"{marked(atom)} would hold for every object", place, "?any is for denials")
            about_robot = self._robot and (atom.predicate in _ROBOT or GRIPPER in atom.args)
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


def bddl_name(text: str) -> bool:
    """Decide whether a text can name a predicate or a domain."""
    return text.replace("-", "_").isidentifier() and text.isascii()


BUILT_IN = Domain("household")
"""The domain without anything of its own: the 21 primitives."""
