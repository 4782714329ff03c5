"""Small changes of a flow: another number, a step more, the place of release shifted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from oag import Action, ActionFlow, ParameterKind, Primitive, parameter_kind

NAVIGATIONS = (Primitive.NAVIGATE_TO_TARGET, Primitive.NAVIGATE_TO_SUPPORT)
NEGLIGIBLE_M = 0.005
"""Shorter moves are left out: numbers in flows are rounded to a centimetre."""

HAND_REACH_M = 0.15
"""What the hand is asked to make up for at most; longer ways are the base's."""

AWAY_M = 0.1
"""How far a base goes back before it drives to the same place again."""


@dataclass(frozen=True, slots=True)
class Axis:
    """A direction of the robot and the primitives along it: hand and base, there and back (None: the base has none)."""

    name: str
    hand: tuple[Primitive, Primitive]
    base: tuple[Primitive, Primitive] | None

    def primitives(self) -> tuple[Primitive, ...]:
        """Returns all primitives along it."""
        return (*self.hand, *(self.base or ()))


FORWARD = Axis(
    "forward",
    (Primitive.MOVE_EEF_FORWARD, Primitive.MOVE_EEF_BACKWARD),
    (Primitive.MOVE_BASE_FORWARD, Primitive.MOVE_BASE_BACKWARD),
)
LEFT = Axis(
    "left", (Primitive.MOVE_EEF_LEFT, Primitive.MOVE_EEF_RIGHT), (Primitive.MOVE_BASE_LEFT, Primitive.MOVE_BASE_RIGHT)
)
UP = Axis("up", (Primitive.LIFT_EEF_UP, Primitive.LIFT_EEF_DOWN), None)


def is_move(action: Action) -> bool:
    """Decides whether an action is a straight motion or a turn, with a number of metres or degrees."""
    return parameter_kind(action.primitive) in (ParameterKind.DISTANCE_M, ParameterKind.ANGLE_DEG)


def with_parameter(flow: ActionFlow, step: int, parameter: float | tuple[float, float] | None) -> ActionFlow:
    """Returns the flow with another number at a step, rounded to a centimetre or a hundredth of the range."""
    if isinstance(parameter, float | int):
        parameter = round(float(parameter), 2)
    elif parameter is not None:
        parameter = (round(parameter[0], 2), round(parameter[1], 2))
    return (*flow[:step], replace(flow[step], parameter=parameter), *flow[step + 1 :])


def inserted(flow: ActionFlow, step: int, *actions: Action) -> ActionFlow:
    """Returns the flow with actions before a step."""
    return (*flow[:step], *actions, *flow[step:])


def without(flow: ActionFlow, step: int) -> ActionFlow:
    """Returns the flow without a step."""
    return (*flow[:step], *flow[step + 1 :])


def along(axis: Axis, amount_m: float) -> Action:
    """Returns the move by a signed distance: the hand's when it is short, else the base's."""
    pair = axis.hand if axis.base is None or abs(amount_m) <= HAND_REACH_M else axis.base
    return Action(pair[0] if amount_m > 0 else pair[1], round(abs(amount_m), 2))


def slide(axis: Axis, amount_m: float) -> Action:
    """Returns the base's move by a signed distance, to the millimetre.

    Raises:
        ValueError: The base does not move along the axis.
    """
    if axis.base is None:
        raise ValueError(f"the base does not move {axis.name}")
    return Action(axis.base[0] if amount_m > 0 else axis.base[1], round(abs(amount_m), 3))


def carrying(flow: ActionFlow, release: int) -> range:
    """Returns the steps of the moves between the last navigation or grasp before a release, and the release."""
    first = release
    while first > 0 and is_move(flow[first - 1]):
        first -= 1
    return range(first, release)


def shifted(flow: ActionFlow, release: int, axis: Axis, amount_m: float) -> ActionFlow:
    """Returns the flow that lets go further along an axis: a number changed where there is one, else one step more.

    Args:
        flow: A flow with a release.
        release: Index of the UNGRASP.
        axis: The direction.
        amount_m: How far; negative goes back.
    """
    if abs(amount_m) < NEGLIGIBLE_M:
        return flow
    steps = [step for step in carrying(flow, release) if flow[step].primitive in axis.primitives()]
    numbered = [step for step in steps if isinstance(flow[step].parameter, float | int)]
    if numbered:
        step = _best(flow, numbered, axis, amount_m)
        number = flow[step].parameter
        there = flow[step].primitive in (axis.hand[0], *(axis.base or ())[:1])
        new = (float(number) if isinstance(number, float | int) else 0.0) + (amount_m if there else -amount_m)
        if abs(new) < NEGLIGIBLE_M:
            return without(flow, step)
        if new > 0:
            return with_parameter(flow, step, new)
        opposite = _opposite(flow[step].primitive, axis)
        return (*flow[:step], Action(opposite, round(-new, 2)), *flow[step + 1 :])
    return inserted(flow, _where(flow, release, axis, amount_m), along(axis, amount_m))


def _best(flow: ActionFlow, steps: list[int], axis: Axis, amount_m: float) -> int:
    """Returns which of several moves along an axis is to be changed: the hand's last, for a longer way the base's."""
    hands = [step for step in steps if flow[step].primitive in axis.hand]
    bases = [step for step in steps if step not in hands]
    preferred = hands if abs(amount_m) <= HAND_REACH_M else bases
    return (preferred or steps)[-1]


def _opposite(primitive: Primitive, axis: Axis) -> Primitive:
    pair = axis.hand if primitive in axis.hand else axis.base or axis.hand
    return pair[1] if primitive is pair[0] else pair[0]


def _where(flow: ActionFlow, release: int, axis: Axis, amount_m: float) -> int:
    """Returns before which step a new move belongs: aside and up before going in, further in and down at the end."""
    moves = carrying(flow, release)
    if axis is LEFT or (axis is UP and amount_m > 0):
        return moves.start
    if axis is FORWARD:
        return next((step for step in moves if flow[step].primitive is Primitive.LIFT_EEF_DOWN), release)
    return release


Changes = Iterator[tuple[ActionFlow, str]]
"""Changed flows, each with what was done in words that begin with a verb."""


def release_after(flow: ActionFlow, step: int) -> int | None:
    """Returns the index of the first release from a step on, or None."""
    return next((i for i in range(step, len(flow)) if flow[i].primitive is Primitive.UNGRASP), None)


def open_numbers(flow: ActionFlow, end: int) -> Changes:
    """Yields the most general correction: the lengths of moves before a step are left to the geometric planner."""
    changed = tuple(
        replace(action, parameter=None) if is_move(action) and step < end else action
        for step, action in enumerate(flow)
    )
    yield changed, "leave the lengths of its moves to the geometric planner"
    release = next((i for i in range(len(flow) - 1, -1, -1) if flow[i].primitive is Primitive.UNGRASP), None)
    if release is None or release > end:
        return
    steps = carrying(changed, release)
    if not steps:
        return
    for shape in ((Primitive.LIFT_EEF_DOWN,), (Primitive.MOVE_BASE_FORWARD, Primitive.LIFT_EEF_DOWN)):
        simple = (*changed[: steps.start], *(Action(primitive) for primitive in shape), *changed[release:])
        yield simple, f"come from above with {' and '.join(p.name for p in shape)}, lengths left to the planner"
