"""Whether two flows ask for the same motion: what a flow comes to when its idle and cancelled motions are left out."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from oag.model.actions import Action, ActionFlow
from oag.model.primitives import OPPOSITE, OPPOSITES, ParameterKind, Primitive, parameter_kind
from oag.table.library import NAVIGATION


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far two numbers may lie apart and still be the same number to the robot.

    Attributes:
        distance_m: For distances.
        angle_deg: For turns.
        joint: For joint limits: fractions of the range, or radians or metres of the joint.

    Raises:
        ValueError: A tolerance is negative, or no finite number: no flow would then repeat another one.
    """

    distance_m: float = 0.01
    angle_deg: float = 1.0
    joint: float = 0.01

    def __post_init__(self) -> None:
        for name, value in (("distance_m", self.distance_m), ("angle_deg", self.angle_deg), ("joint", self.joint)):
            if not 0.0 <= value < math.inf:
                raise ValueError(f"Expected a tolerance of 0 or more for {name}, got {value!r}.")

    def of(self, primitive: Primitive) -> float:
        """Returns the tolerance for the numbers of a primitive."""
        kinds = {ParameterKind.ANGLE_DEG: self.angle_deg, ParameterKind.JOINT_LIMITS: self.joint}
        return kinds.get(parameter_kind(primitive), self.distance_m)

    def __str__(self) -> str:
        degrees = "degree" if self.angle_deg == 1.0 else "degrees"
        return f"{self.distance_m:g} m, {self.angle_deg:g} {degrees} or {self.joint:g} of a joint's range"


# The axis of each motion, named by what moves along it, and the direction.
_AXES = {primitive: (first, sign) for first, second in OPPOSITES for primitive, sign in ((first, 1.0), (second, -1.0))}


def same_flow(one: ActionFlow, other: ActionFlow, tolerance: Tolerance | None = None) -> bool:
    """Decides whether two flows ask for the same motion, up to a tolerance on their numbers.

    Motions along one axis in a row count as their sum, forwards and backwards set off against each other, and of turns
    whole ones left out. What the tolerance does not tell from standing still counts as none, as does a retreat right
    after a navigation, and a step that says what the one before it said, such as a second navigation to the same
    place. An open number equals another open one only.

    Example:
        >>> import oag
        >>> one = oag.flow_from_json([18, {"13": 0.3}, 5])
        >>> oag.same_flow(one, oag.flow_from_json([18, 18, {"13": 0.4}, {"14": 0.1}, 5]))
        True
    """
    within = tolerance or Tolerance()
    first, second = net_motion(one, within), net_motion(other, within)
    return len(first) == len(second) and all(_same_action(a, b, within) for a, b in zip(first, second, strict=True))


def net_motion(flow: Iterable[Action], tolerance: Tolerance) -> tuple[Action, ...]:
    """Returns the flow that a flow comes to: sums of motions along one axis, nothing idle, nothing said twice."""
    current = tuple(flow)
    while True:
        summed: list[Action] = []
        for action in current:
            _append(summed, action, tolerance)
        # Only when a row of motions is complete is it known what it comes to.
        moving = tuple(action for action in summed if not _idle(action, tolerance))
        if len(moving) == len(current):
            return moving
        current = moving


def _append(summed: list[Action], action: Action, tolerance: Tolerance) -> None:
    """Adds an action to what was done before it, as part of the last action where it only continues that."""
    last = summed[-1] if summed else None
    if last is not None and action.primitive in _AXES and last.primitive in _AXES:
        (axis, sign), (same_axis, last_sign) = _AXES[action.primitive], _AXES[last.primitive]
        if axis is same_axis and isinstance(action.parameter, int | float) and isinstance(last.parameter, int | float):
            net = last_sign * last.parameter + sign * action.parameter
            if parameter_kind(axis) is ParameterKind.ANGLE_DEG:
                net = math.remainder(net, 360.0)
            summed[-1] = Action(axis if net >= 0.0 else OPPOSITE[axis], abs(net))
            return
    elif last is not None:
        # A drive leaves the arm at home.
        home_already = action.primitive is Primitive.RETREAT and last.primitive in NAVIGATION
        if home_already or _same_action(last, action, tolerance):
            return
    summed.append(action)


def _idle(action: Action, tolerance: Tolerance) -> bool:
    """Decides whether an action moves by no more than what the tolerance takes for nothing."""
    moved = action.parameter
    return action.primitive in _AXES and isinstance(moved, int | float) and abs(moved) <= tolerance.of(action.primitive)


def _same_action(one: Action, other: Action, tolerance: Tolerance) -> bool:
    if one.primitive is not other.primitive or one.parameter is None or other.parameter is None:
        return one == other
    first, second = (p if isinstance(p, tuple) else (p,) for p in (one.parameter, other.parameter))
    within = tolerance.of(one.primitive)
    return len(first) == len(second) and all(abs(a - b) <= within for a, b in zip(first, second, strict=True))
