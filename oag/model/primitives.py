"""The 21 primitives: their IDs, and what number each one takes."""

from __future__ import annotations

import math
from enum import Enum, IntEnum

from oag.model.categories import Kind

MAX_DISTANCE_M = 3.0
MAX_ANGLE_DEG = 180.0
# Joint limits are normalised (0 to 1) or physical (radians or metres); a full turn bounds both.
MAX_JOINT_LIMIT = 2.0 * math.pi


class Primitive(IntEnum):
    """An atomic action of the robot; the value is the ID that flows use in JSON.

    Source: the paper's raw outputs fix 1, 2, 3, 5, 8, 9, 13, 15, 17, 18 and 19; the others follow the order in
    which its library lists them.
    """

    APPROACH = 1
    CONVERGE = 2
    GRASP = 3
    ARTICULATE_OPEN = 4
    UNGRASP = 5
    RETREAT = 6
    LIFT_EEF_UP = 7
    LIFT_EEF_DOWN = 8
    MOVE_EEF_FORWARD = 9
    MOVE_EEF_BACKWARD = 10
    MOVE_EEF_LEFT = 11
    MOVE_EEF_RIGHT = 12
    MOVE_BASE_FORWARD = 13
    MOVE_BASE_BACKWARD = 14
    MOVE_BASE_LEFT = 15
    MOVE_BASE_RIGHT = 16
    NAVIGATE_TO_TARGET = 17
    NAVIGATE_TO_SUPPORT = 18
    ARTICULATE_CLOSE = 19
    TURN_BASE_LEFT = 20
    TURN_BASE_RIGHT = 21


class ParameterKind(Enum):
    """What a primitive's parameter means; the value describes it for a person."""

    NONE = "no parameter"
    DISTANCE_M = f"one distance from 0 to {MAX_DISTANCE_M:g} m"
    ANGLE_DEG = f"one angle from 0 to {MAX_ANGLE_DEG:g} degrees"
    JOINT_LIMITS = "joint limits [min, max] with min <= max"


Parameter = float | tuple[float, float] | None


# The largest magnitude that a kind of parameter may have, and its unit for messages.
_RANGES = {ParameterKind.DISTANCE_M: (MAX_DISTANCE_M, "m"), ParameterKind.ANGLE_DEG: (MAX_ANGLE_DEG, "degrees")}


# What moves a fixture's joint.
ARTICULATIONS = (Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)
# The first of each pair moves along an axis, the second against it.
OPPOSITES = (
    (Primitive.LIFT_EEF_UP, Primitive.LIFT_EEF_DOWN),
    (Primitive.MOVE_EEF_FORWARD, Primitive.MOVE_EEF_BACKWARD),
    (Primitive.MOVE_EEF_LEFT, Primitive.MOVE_EEF_RIGHT),
    (Primitive.MOVE_BASE_FORWARD, Primitive.MOVE_BASE_BACKWARD),
    (Primitive.MOVE_BASE_LEFT, Primitive.MOVE_BASE_RIGHT),
    (Primitive.TURN_BASE_LEFT, Primitive.TURN_BASE_RIGHT),
)
OPPOSITE = {one: other for pair in OPPOSITES for one, other in (pair, pair[::-1])}
_TURNS = (Primitive.TURN_BASE_LEFT, Primitive.TURN_BASE_RIGHT)
_KINDS = {
    **dict.fromkeys(Primitive, ParameterKind.NONE),
    **dict.fromkeys(ARTICULATIONS, ParameterKind.JOINT_LIMITS),
    **dict.fromkeys(_TURNS, ParameterKind.ANGLE_DEG),
    **{p: ParameterKind.DISTANCE_M for p in Primitive if Primitive.LIFT_EEF_UP <= p <= Primitive.MOVE_BASE_RIGHT},
}


def applicable(primitive: Primitive, kind: Kind) -> bool:
    """Decides whether a primitive can act on an object of a kind at all: joints to articulate, something to grasp."""
    if primitive in ARTICULATIONS:
        return kind is Kind.ARTICULATED
    return primitive is not Primitive.GRASP or kind is not Kind.SUPPORT


def parameter_kind(primitive: Primitive) -> ParameterKind:
    """Returns which kind of parameter a primitive takes."""
    return _KINDS[primitive]


def parameter_problem(primitive: Primitive, parameter: Parameter) -> str | None:
    """Decides whether a parameter fits its primitive: None when it does, else what is wrong.

    A parameter of None always fits: the primitive takes none, or the executor fills it in.
    """
    if parameter is None:
        return None
    kind = parameter_kind(primitive)
    if kind is ParameterKind.NONE:
        return f"takes no parameter, got {parameter!r}"
    if kind is ParameterKind.JOINT_LIMITS:
        return _limits_problem(parameter)
    if isinstance(parameter, tuple):
        return f"takes {kind.value}, got {list(parameter)!r}"
    if not math.isfinite(parameter):
        return f"takes {kind.value}, got {parameter!r}"
    largest, unit = _RANGES[kind]
    if 0.0 <= parameter <= largest:
        return None
    other_way = "; the opposite primitive moves the other way" if parameter < 0.0 else ""
    return f"takes {kind.value}, got {parameter:g} {unit}{other_way}"


def _limits_problem(parameter: float | tuple[float, float]) -> str | None:
    wanted = ParameterKind.JOINT_LIMITS.value
    if not isinstance(parameter, tuple):
        return f"takes {wanted}, got the single number {parameter:g}"
    low, high = parameter
    if not (math.isfinite(low) and math.isfinite(high)):
        return f"takes {wanted}, got {list(parameter)!r}"
    if low > high:
        return f"takes {wanted}, got [{low:g}, {high:g}]"
    if max(abs(low), abs(high)) > MAX_JOINT_LIMIT:
        return f"takes {wanted} within a full turn ({MAX_JOINT_LIMIT:.2f}), got [{low:g}, {high:g}]"
    return None
