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
from functools import cache, cached_property, lru_cache
from importlib import import_module
from importlib.resources import as_file, files
from itertools import product
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import bddl
from oag.model.errors import OagError
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
ANY_WORD = "any"
# The robot's variables as predicates of rows: number of names, fact, and value.
ROBOT_WORDS: Mapping[str, tuple[int, Fact, str]] = {
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


class DomainError(OagError):
    """A domain cannot be used: a name, a row or a kind is not as documented.

    Attributes:
        source: The file's name, or "(mapping)".
        place: Where in it, such as `primitives.PUSH.needs`.
    """

    def __init__(self, problem: str, *, source: str = "(mapping)", place: str = "", hint: str = "") -> None:
        self.source, self.place, self.problem, self.hint = source, place, problem, hint
        where = f"{source}: {place}" if place else source
        super().__init__(f"domain {where}: {problem}" + (f" ({hint})" if hint else ""))


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
    """Return what a primitive needs and writes in a subtask; of writes to one fact the affirmed one counts.

    Where two variables are one object, a fact that is denied and unknown is unknown.
    """
    row, names = own.row, own.names(target, support)
    needs = tuple(
        tuple(_condition(literal, names, row.robot) for literal in _alternatives(formula)) for formula in row.needs
    )
    denied = {_fact(each.atom, names): False for each in row.writes if not each.value}
    writes: dict[Fact, Value] = {**denied, **dict.fromkeys(_fact(atom, names) for atom in row.unknown)}
    for literal in (each for each in row.writes if each.value):
        condition = _condition(literal, names, row.robot)
        writes[condition.fact] = condition.value
        if row.robot and condition.fact[0] in WITH_INVARIANTS[1:] and len(condition.fact) == 3:
            # The converse cannot hold as well.
            relation, thing, place = condition.fact
            writes[relation, place, thing] = False
    return Bound(needs, tuple(writes.items()))


def _alternatives(formula: bddl.Formula) -> tuple[bddl.Literal, ...]:
    parts = formula.parts if isinstance(formula, bddl.Or) else (formula,)
    return tuple(literal for part in parts for literal in bddl.literals(part) or ())


def _fact(atom: bddl.Atom, names: Mapping[str, str]) -> Fact:
    return (atom.predicate, *(ANY if name == ANY_WORD else names.get(name, name) for name in atom.args))


def _condition(literal: bddl.Literal, names: Mapping[str, str], robot: bool) -> Condition:
    fact = _fact(literal.atom, names)
    if robot and fact[0] in ROBOT_WORDS:
        _, variable, value = ROBOT_WORDS[fact[0]]
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
        line = f"<Domain {self.name!r}: {base}{', '.join(self.rows) or 'nothing of its own'}>"
        return line if len(line) <= 200 else f"{line[:196]}...>"

    @classmethod
    def from_toml(cls, path: str | PathLike[str]) -> Self:
        """Return the domain of a TOML file; raises DomainError for anything that is not as documented."""
        import tomllib

        try:
            data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as problem:
            why = problem.strerror if isinstance(problem, OSError) else problem
            raise DomainError(f"cannot be read: {why}", source=str(path)) from problem
        except RecursionError:
            raise DomainError("is nested too deeply", source=str(path)) from None
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
        # It makes rows and errors of this module.
        try:
            return cls(**import_module("oag.model.domain_form").Reading(data, source).parts())
        except RecursionError:
            raise DomainError("is nested too deeply", source=source) from None

    @classmethod
    def appliances(cls) -> Domain:
        """Return the domain of scenes with a button or a knob: the 21 primitives, and one to press and to turn each."""
        return _packaged("appliances")

    @classmethod
    def fallen(cls, *, appliances: bool = False) -> Domain:
        """Return the domain of scenes in which something has fallen over: the 21 primitives, and SET_UPRIGHT.

        Args:
            appliances: Whether the rows for buttons and knobs are in it, too.
        """
        return _packaged("appliances", "fallen") if appliances else _packaged("fallen")

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

    def name_apart_from(self, other: Domain) -> str:
        """Return its name, with the beginning of its digest where another domain has the same name."""
        return self.name if self.name != other.name else f"{self.name} ({self.digest[:8]})"

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
        return dialect(self.name, self.predicates)

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
    def written(self) -> Mapping[str, float]:
        """The predicates that its own primitives write, with the most facts of each that one of them writes."""
        most: dict[str, float] = {}
        for row in self.rows.values():
            counts: dict[str, float] = {}
            for literal in row.writes:
                predicate = literal.atom.predicate
                counts[predicate] = counts.get(predicate, 0) + (math.inf if ANY_WORD in literal.atom.args else 1)
            most = {key: max(most.get(key, 0), counts.get(key, 0)) for key in (*most, *counts)}
        return most

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


def dialect(name: str, predicates: Mapping[str, bddl.PredicateSpec]) -> bddl.Profile:
    """Return the dialect of formulas in some predicates."""
    profile = bddl.PROFILES["scene"]
    return replace(profile, name=f"{profile.name} of the domain {name}", predicates=predicates)


@cache
def _packaged(*names: str) -> Domain:
    """Return what the domains of the package say that have some names."""
    found = []
    for name in names:
        with as_file(files(__package__).joinpath(f"{name}.toml")) as path:
            found.append(Domain.from_toml(path))
    if len(found) == 1:
        return found[0]
    predicates = {key: value for one in found for key, value in one.own_predicates.items()}
    rows = {key: row for one in found for key, row in one.rows.items()}
    return Domain("_and_".join(names), own_predicates=predicates, rows=rows)


BUILT_IN = Domain("household")
"""The domain without anything of its own: the 21 primitives."""
