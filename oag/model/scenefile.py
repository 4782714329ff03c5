"""The parts of a scene file that need more than a type check: ids, places, quaternions, facts, closed predicates."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping

import bddl
from bddl.syntax.tree import NAME_RULE, is_name
from oag.model.jsonfile import JsonNode, shown

FLOOR = "floor"
"""Id and category of the floor, where a scene lists it."""

# Names that facts may use beside the scene's objects.
_OWN_NAMES = ("gripper", "robot", "ground", FLOOR)
# What every formula can name: no blank, no parenthesis, no `*`, which stands for any object.
_OBJECT_ID = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
# A building fits in, and no number is lost in the arithmetic of poses.
LARGEST_M = 1000.0
SMALLEST_M = 1e-4
LARGEST_TURN_RAD = 1000.0
LARGEST_TURN_DEG = 36_000.0
# Factors of sizes.
SCALES = (1e-6, 1e6)
# As far as rounding lets the norm of a normalised quaternion be from 1.
_UNIT = 1e-15
# Rooms and substances are named, not listed: arguments that stand for them are free.
FREE_PARAMETERS = frozenset({"room", "substance"})
# Ids and categories are said in every message, and ids name files.
LONGEST_NAME = 200


def triple(values: Iterable[float]) -> tuple[float, float, float]:
    """Returns three numbers as a tuple of three."""
    x, y, z = values
    return (x, y, z)


def check_id(key: str, node: JsonNode) -> None:
    """Refuses an object's id that no formula can name, or that is in every scene; the floor may be listed.

    Args:
        key: The id.
        node: The object's entry.
    """
    listed = isinstance(node.value, Mapping) and key == node.value.get("category") == FLOOR
    if key in _OWN_NAMES and not listed:
        own = f"{', '.join(_OWN_NAMES[:-1])} and {_OWN_NAMES[-1]}"
        raise node.fail(f"the id {key!r} is reserved: {own} are in every scene; name the object otherwise")
    if not _OBJECT_ID.fullmatch(key) or len(key) > LONGEST_NAME:
        raise node.fail(
            f"the id {shown(key)} cannot be used; expected letters a to z, digits, '_', '.' and '-', "
            f"{LONGEST_NAME} at most, not starting with '.' or '-', such as glass_0"
        )


def about_z(turn_rad: float) -> tuple[float, float, float, float]:
    """Returns the quaternion w x y z of a turn about the vertical."""
    return (math.cos(turn_rad / 2), 0.0, 0.0, math.sin(turn_rad / 2)) if turn_rad else (1.0, 0.0, 0.0, 0.0)


def read_quaternion(node: JsonNode) -> tuple[float, float, float, float]:
    """Returns a unit quaternion w x y z, normalised."""
    # Squares of larger numbers lose what they stand for; a unit quaternion has none above 1.
    w, x, y, z = node.numbers(4, "quaternion w x y z", -1e6, 1e6)
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if norm < 1e-6:
        raise node.fail("expected a quaternion w x y z that is not zero")
    if abs(norm - 1.0) < _UNIT:
        # What was normalised once comes back from a file as it was.
        return (w, x, y, z)
    return (w / norm, x / norm, y / norm, z / norm)


def read_place(node: JsonNode) -> tuple[float, ...]:
    """Returns where something is in the world [m]: three numbers, or two for what stands there."""
    if isinstance(node.value, list | tuple) and len(node.value) == 2:
        return node.numbers(2, "x y in metres", -LARGEST_M, LARGEST_M)
    return node.numbers(3, "x y z in metres", -LARGEST_M, LARGEST_M)


def read_point(node: JsonNode) -> tuple[float, ...]:
    """Returns a point of a top [m]."""
    return node.numbers(2, "x y in metres", -LARGEST_M, LARGEST_M)


def read_extent(node: JsonNode) -> tuple[float, float, float]:
    """Returns the sides of a bounding box [m]."""
    return triple(node.numbers(3, "x y z in metres, all > 0", SMALLEST_M, LARGEST_M))


def read_factors(node: JsonNode) -> tuple[float, float, float]:
    """Returns the factors along the axes of a box."""
    return triple(node.numbers(3, "x y z, all > 0", *SCALES))


def check_sides(node: JsonNode, extent: tuple[float, float, float], scale: tuple[float, float, float]) -> None:
    """Refuses factors that make sides of a box that no scene has."""
    for side, factor in zip(extent, scale, strict=True):
        if not SMALLEST_M <= side * factor <= LARGEST_M:
            raise node.fail(f"makes a side of {side * factor:g} m; expected {SMALLEST_M:g} to {LARGEST_M:g} m")


def read_category(node: JsonNode) -> str:
    """Returns what something is; a quantifier has to be able to say it."""
    category = node.string()
    if not is_name(category) or len(category) > LONGEST_NAME:
        raise node.fail(
            f"the category {shown(category)} cannot be used: {NAME_RULE}; {LONGEST_NAME} characters at most",
            "such as water_glass",
        )
    return category


def read_closed(root: JsonNode) -> frozenset[str]:
    """Returns the predicates that the scene declares to know completely."""
    node = root.get("closed")
    if node is None:
        return frozenset()
    for element in node.elements():
        name = element.string()
        if name not in bddl.PREDICATES:
            raise element.fail(f"unknown predicate {name!r}", _did_you_mean(name, bddl.PREDICATES))
    return frozenset(element.string() for element in node.elements())


def read_facts(root: JsonNode, objects: Iterable[str]) -> tuple[bddl.Formula, ...]:
    """Returns the literals that hold at the start; each must be ground, of this scene, and not contradicted.

    Where a scene is built in memory a fact may also be a formula.
    """
    node = root.get("facts")
    if node is None:
        return ()
    known = (*objects, *_OWN_NAMES)
    values: dict[bddl.Atom, bool] = {}
    facts = []
    for element in node.elements():
        formula = _parse(element)
        literals = bddl.literals(formula)
        if literals is None:
            raise element.fail("a fact must be a literal, such as (ontop glass_0 table_0) or (not (open fridge_0))")
        for literal in literals:
            _check_fact(element, literal.atom, known)
            if values.setdefault(literal.atom, literal.value) is not literal.value:
                raise element.fail(f"contradicts an earlier fact about {bddl.format(literal.atom)}")
        facts.append(formula)
    return tuple(facts)


def _parse(element: JsonNode) -> bddl.Formula:
    """Returns a fact's formula; its syntax errors become the scene's error."""
    if isinstance(element.value, bddl.Formula):
        return element.value
    try:
        return bddl.parse_formula(element.string())
    except bddl.BDDLError as problem:
        raise element.fail(problem.first_messages) from problem


def _check_fact(element: JsonNode, atom: bddl.Atom, known: tuple[str, ...]) -> None:
    """Raises the scene's error for an unknown predicate, a wrong arity or an unknown object in a fact."""
    spec = bddl.PREDICATES.get(atom.predicate)
    if spec is None:
        raise element.fail(f"unknown predicate {atom.predicate!r}", _did_you_mean(atom.predicate, bddl.PREDICATES))
    if len(atom.args) != spec.arity:
        raise element.fail(f"{atom.predicate} takes {spec.arity} arguments, got {len(atom.args)}")
    for name, parameter in zip(atom.args, spec.parameters, strict=True):
        if parameter not in FREE_PARAMETERS and name not in known:
            raise element.fail(f"unknown object {name!r}", _did_you_mean(name, known))


def _did_you_mean(name: str, legal: Iterable[str]) -> str:
    near = bddl.near_names(name, tuple(legal))
    return f"did you mean {' or '.join(near)}?" if near else ""
