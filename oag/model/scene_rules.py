"""Rules of scene files beyond types: ids, facts, closed predicates, and the limits of sizes."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable
from functools import partial

import bddl
from oag.model.codec import did_you_mean, expected, shown
from oag.model.diagnostics import SceneError

FLOOR = "floor"
"""Id and category of the floor, where a scene lists it."""

# Names that facts may use in addition to the scene's objects.
_OWN_NAMES = ("gripper", "robot", "ground", FLOOR)
# Names that formulas can have: no blank, no parenthesis, no `*`, which stands for any object.
_OBJECT_ID = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
# Limits: a building fits in, and the arithmetic of poses loses no digits.
LARGEST_M = 1000.0
SMALLEST_M = 1e-4
LARGEST_TURN_RAD = 1000.0
LARGEST_TURN_DEG = 36_000.0
# The paper's robot has 0.7 of a Panda's full size.
PAPER_SCALE, FULL_SCALE = 0.7, 1.0
# Factors of sizes.
SCALES = (1e-6, 1e6)
# Rooms and substances are named, not listed: arguments that stand for them are free.
FREE_PARAMETERS = frozenset({"room", "substance"})
# Ids and categories appear in every message, and ids name files.
LONGEST_NAME = 200


def triple(values: Iterable[float]) -> tuple[float, float, float]:
    """Return three numbers as a tuple of three."""
    x, y, z = values
    return (x, y, z)


def id_problem(key: str, category: object) -> str:
    """Return why an object cannot have an id: no formula can name it, or it is reserved; empty if it can.

    Args:
        key: The id.
        category: The object's category; the floor may be listed.
    """
    if key in _OWN_NAMES and not key == category == FLOOR:
        own = f"{', '.join(_OWN_NAMES[:-1])} and {_OWN_NAMES[-1]}"
        return f"the id {key!r} is reserved: {own} are in every scene; name the object otherwise"
    if not _OBJECT_ID.fullmatch(key) or len(key) > LONGEST_NAME:
        return (
            f"the id {shown(key)} cannot be used; expected letters a to z, digits, '_', '.' and '-', "
            f"{LONGEST_NAME} at most, not starting with '.' or '-', such as glass_0"
        )
    return ""


def about_z(turn_rad: float) -> tuple[float, float, float, float]:
    """Return the quaternion w x y z of a turn about the vertical."""
    return (math.cos(turn_rad / 2), 0.0, 0.0, math.sin(turn_rad / 2)) if turn_rad else (1.0, 0.0, 0.0, 0.0)


def read_closed(given: object, source: str) -> frozenset[str]:
    """Return the predicates that a scene declares to know completely.

    Raises:
        SceneError: It is no list of predicates.
    """
    names = _listed(given, "closed", source)
    for index, name in enumerate(names):
        if not isinstance(name, str) or name not in bddl.PREDICATES:
            reason = f"unknown predicate {name!r}" if isinstance(name, str) else expected("a string", name)
            hint = did_you_mean(name, bddl.PREDICATES) if isinstance(name, str) else ""
            raise SceneError(reason, source=source, place=f"closed[{index}]", hint=hint)
    return frozenset(map(str, names))


def read_facts(given: object, objects: Iterable[str], source: str) -> tuple[bddl.Formula, ...]:
    """Return the literals that hold at the start; each must be ground, of this scene, and not contradicted.

    Args:
        given: A list of formulas or their texts.
        objects: The scene's ids.
        source: Where they are from, for messages.

    Raises:
        SceneError: One of them is not.
    """
    known = (*objects, *_OWN_NAMES)
    values: dict[bddl.Atom, bool] = {}
    facts = []
    for index, text in enumerate(_listed(given, "facts", source)):
        refused = partial(SceneError, source=source, place=f"facts[{index}]")
        if isinstance(text, bddl.Formula):
            formula = text
        elif isinstance(text, str):
            try:
                formula = bddl.parse_formula(text)
            except bddl.BDDLError as problem:
                raise refused(problem.first_messages) from problem
        else:
            raise refused(expected("a string", text))
        literals = bddl.literals(formula)
        if literals is None:
            raise refused("a fact must be a literal, such as (ontop glass_0 table_0) or (not (open fridge_0))")
        for literal in literals:
            reason, hint = _unfit_fact(literal.atom, known)
            if not reason and values.setdefault(literal.atom, literal.value) is not literal.value:
                reason = f"contradicts an earlier fact about {bddl.format(literal.atom)}"
            if reason:
                raise refused(reason, hint=hint)
        facts.append(formula)
    return tuple(facts)


def _listed(given: object, place: str, source: str) -> Collection[object]:
    if not isinstance(given, list | tuple | set | frozenset):
        raise SceneError(expected("a list", given), source=source, place=place)
    return given


def _unfit_fact(atom: bddl.Atom, known: tuple[str, ...]) -> tuple[str, str]:
    """Return the problem of a fact and a hint: an unknown predicate or object, or a wrong arity."""
    spec = bddl.PREDICATES.get(atom.predicate)
    if spec is None:
        return f"unknown predicate {atom.predicate!r}", did_you_mean(atom.predicate, bddl.PREDICATES)
    if len(atom.args) != spec.arity:
        return f"{atom.predicate} takes {spec.arity} arguments, got {len(atom.args)}", ""
    for name, parameter in zip(atom.args, spec.parameters, strict=True):
        if parameter not in FREE_PARAMETERS and name not in known:
            return f"unknown object {name!r}", did_you_mean(name, known)
    return "", ""
