"""Elementary edits of a flow: another number, an additional step, a shifted place of release."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from oag import Action, Primitive
from oag.model.actions import ActionFlow
from oag.model.symbols import ParameterKind, parameter_kind

NAVIGATIONS = (Primitive.NAVIGATE_TO_TARGET, Primitive.NAVIGATE_TO_SUPPORT)
NEGLIGIBLE_M = 0.005
"""Shorter moves are omitted: numbers in flows are rounded to a centimetre."""

HAND_REACH_M = 0.15
"""Longest distance assigned to the hand; longer ones are the base's."""

AWAY_M = 0.1
"""Distance that the base backs up before it drives to the same place again."""

Changes = Iterator[tuple[ActionFlow, str]]
"""Changed flows, each with a description that begins with a verb."""


@dataclass(frozen=True, slots=True)
class Axis:
    """A direction and its primitives: of hand and base, forth and back; the base may have none."""

    hand: tuple[Primitive, ...]
    base: tuple[Primitive, ...] = ()

    def sign(self, action: Action) -> int:
        """Return 1 for a move along the axis, -1 for one back, 0 for any other action."""
        pairs = (pair for pair in (self.hand, self.base) if action.primitive in pair)
        return next((1 if action.primitive is pair[0] else -1 for pair in pairs), 0)


FORWARD = Axis(
    (Primitive.MOVE_EEF_FORWARD, Primitive.MOVE_EEF_BACKWARD),
    (Primitive.MOVE_BASE_FORWARD, Primitive.MOVE_BASE_BACKWARD),
)
LEFT = Axis((Primitive.MOVE_EEF_LEFT, Primitive.MOVE_EEF_RIGHT), (Primitive.MOVE_BASE_LEFT, Primitive.MOVE_BASE_RIGHT))
UP = Axis((Primitive.LIFT_EEF_UP, Primitive.LIFT_EEF_DOWN))


def is_move(action: Action) -> bool:
    """Decide whether an action is a straight motion or a turn, with a number of metres or degrees."""
    return parameter_kind(action.primitive) in (ParameterKind.DISTANCE_M, ParameterKind.ANGLE_DEG)


def numbered_moves(flow: ActionFlow, steps: Iterable[int]) -> list[tuple[int, float]]:
    """Return those of some steps that are moves with a given number, and the number."""
    numbers = ((step, flow[step].parameter) for step in steps if is_move(flow[step]))
    return [(step, number) for step, number in numbers if isinstance(number, float | int)]


def last_up_to(flow: ActionFlow, step: int, primitive: Primitive) -> int | None:
    """Return the index of the last step of a primitive among those up to a step, or None."""
    return next((i for i in range(step, -1, -1) if flow[i].primitive is primitive), None)


def release_after(flow: ActionFlow, step: int) -> int | None:
    """Return the index of the first release from a step on, or None."""
    return next((i for i in range(step, len(flow)) if flow[i].primitive is Primitive.UNGRASP), None)


def with_parameter(flow: ActionFlow, step: int, parameter: float | tuple[float, float] | None) -> ActionFlow:
    """Return the flow with another number at a step, rounded to a centimetre or a hundredth of the range."""
    if isinstance(parameter, float | int):
        parameter = round(float(parameter), 2)
    elif parameter is not None:
        parameter = (round(parameter[0], 2), round(parameter[1], 2))
    return (*flow[:step], replace(flow[step], parameter=parameter), *flow[step + 1 :])


def inserted(flow: ActionFlow, step: int, *actions: Action) -> ActionFlow:
    """Return the flow with actions before a step."""
    return (*flow[:step], *actions, *flow[step:])


def without(flow: ActionFlow, step: int) -> ActionFlow:
    """Return the flow without a step."""
    return (*flow[:step], *flow[step + 1 :])


def move(pair: tuple[Primitive, ...], amount_m: float, digits: int = 2) -> Action:
    """Return the move by a signed distance; the pair has one primitive for each direction."""
    return Action(pair[0] if amount_m > 0 else pair[1], round(abs(amount_m), digits))


def along(axis: Axis, amount_m: float) -> Action:
    """Return the move by a signed distance: of the hand if it is short, else of the base."""
    return move(axis.hand if not axis.base or abs(amount_m) <= HAND_REACH_M else axis.base, amount_m)


def carrying(flow: ActionFlow, release: int) -> range:
    """Return the steps of the moves between the last navigation or grasp before a release, and the release."""
    first = release
    while first > 0 and is_move(flow[first - 1]):
        first -= 1
    return range(first, release)


def shifted(flow: ActionFlow, release: int, axis: Axis, amount_m: float) -> ActionFlow:
    """Return the flow with its release shifted along an axis: a changed number if there is one, else a new step.

    Of several numbers the hand's last one is changed, for a longer distance the base's. A new move sideways or up is
    inserted before going in, one further in or down at the end. A negative amount goes back.
    """
    if abs(amount_m) < NEGLIGIBLE_M:
        return flow
    moves = carrying(flow, release)
    numbered = [(step, number) for step, number in numbered_moves(flow, moves) if axis.sign(flow[step])]
    if numbered:
        wanted = axis.hand if abs(amount_m) <= HAND_REACH_M else axis.base
        step, number = ([entry for entry in numbered if flow[entry[0]].primitive in wanted] or numbered)[-1]
        new_m = axis.sign(flow[step]) * number + amount_m
        pair = axis.hand if flow[step].primitive in axis.hand else axis.base
        changed = () if abs(new_m) < NEGLIGIBLE_M else (move(pair, new_m),)
        return (*flow[:step], *changed, *flow[step + 1 :])
    where = release
    if axis is LEFT or (axis is UP and amount_m > 0):
        where = moves.start
    elif axis is FORWARD:
        where = next((step for step in moves if flow[step].primitive is Primitive.LIFT_EEF_DOWN), release)
    return inserted(flow, where, along(axis, amount_m))


def open_numbers(flow: ActionFlow, end: int | None = None) -> Changes:
    """Yield the most general correction: the geometric planner chooses the lengths of moves before a step."""
    end = len(flow) if end is None else end
    changed = tuple(
        replace(action, parameter=None) if is_move(action) and step < end else action
        for step, action in enumerate(flow)
    )
    yield changed, "leave the lengths of its moves to the geometric planner"
    release = last_up_to(flow, len(flow) - 1, Primitive.UNGRASP)
    steps = range(0) if release is None or release > end else carrying(changed, release)
    for shape in ((Primitive.LIFT_EEF_DOWN,), (Primitive.MOVE_BASE_FORWARD, Primitive.LIFT_EEF_DOWN)) if steps else ():
        simple = (*changed[: steps.start], *map(Action, shape), *changed[steps.stop :])
        yield simple, f"come from above with {' and '.join(p.name for p in shape)}, lengths left to the planner"


def halved(flow: ActionFlow, steps: Iterable[int]) -> Changes:
    """Yield the flow with one of its moves halved, step by step."""
    for step, number in numbered_moves(flow, steps):
        yield with_parameter(flow, step, number / 2), f"move by half at {flow[step].primitive.name}"


def driven_first(flow: ActionFlow, step: int, before: int) -> Changes:
    """Yield the flow with a drive to the target at a step, if there is none among the first ones."""
    if not any(action.primitive in NAVIGATIONS for action in flow[:before]):
        yield inserted(flow, step, Action(Primitive.NAVIGATE_TO_TARGET)), "drive to the target first"
