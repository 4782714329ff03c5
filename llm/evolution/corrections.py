"""Which changes of a flow a cause calls for, the ones that the measurements point to first.

Every correction says in words what it does; none is checked here: `oag.admissible` decides whether it may run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from llm.evolution.cause import Cause, CauseKind
from llm.evolution.edits import (
    FORWARD,
    HAND_REACH_M,
    LEFT,
    NAVIGATIONS,
    NEGLIGIBLE_M,
    UP,
    along,
    carrying,
    inserted,
    is_move,
    shifted,
    slide,
    with_parameter,
    without,
)
from llm.evolution.joints import joint_short, joint_stalled, narrower
from llm.evolution.measured import ARTICULATIONS
from oag import Action, ActionFlow, Primitive

CLEARANCE_M = 0.05
TOUCHING_M = 0.005
FINE_M = 0.002
"""The smallest offset of an aim that is worth a correction: the gripper has a few millimetres to spare."""

OFF_M = 0.01
"""How far beside its goal a base has to end for a second drive to be worth it."""

SIDE_STEPS_M = (0.1, 0.2, 0.3)
LIFTS_M = (0.05, 0.1)


@dataclass(frozen=True, slots=True)
class Correction:
    """A changed flow.

    Attributes:
        flow: The flow.
        words: What was changed and by what measurement, as half a sentence that begins with a verb.
    """

    flow: ActionFlow
    words: str


def corrections(cause: Cause, flow: ActionFlow) -> Iterator[Correction]:
    """Yields the corrections of a flow for a cause, the most likely one first, the most general one last."""
    yield from (Correction(changed, words) for changed, words in _BY_KIND[cause.kind](cause, flow) if changed != flow)


Changes = Iterator[tuple[ActionFlow, str]]


def _navigated_again(cause: Cause, flow: ActionFlow) -> Changes:
    """Where the base ended beside its goal, a second, shorter drive ends nearer to it."""
    beside = cause.number("beside_m")
    at = next((i for i in range(cause.step, -1, -1) if flow[i].primitive is Primitive.NAVIGATE_TO_SUPPORT), None)
    if beside is not None and beside >= OFF_M and at is not None:
        again = inserted(flow, at + 1, Action(Primitive.NAVIGATE_TO_SUPPORT))
        yield again, f"drive to the support again, since the base ended {beside:.2f} m beside where it was to be"


def _misplaced(cause: Cause, flow: ActionFlow) -> Changes:
    release = _release(flow, cause.step)
    if release is None:
        return
    yield from _navigated_again(cause, flow)
    miss = max(cause.misses, key=lambda m: m.distance_m, default=None)
    if miss is not None and miss.distance_m > 0.0:
        told = _told(miss.forward_m, miss.left_m, miss.up_m)
        yield _shift(flow, release, miss.forward_m, miss.left_m, miss.up_m), f"let go {told}, which is what was missing"
        centred = (miss.centre_forward_m, miss.centre_left_m, miss.up_m)
        yield _shift(flow, release, *centred), f"let go {_told(*centred)}, in the middle of the place"
    yield from _nearer_and_up(flow, release)
    yield from _open_numbers(flow, release)


def _nowhere(cause: Cause, flow: ActionFlow) -> Changes:
    release = _release(flow, cause.step)
    if release is None:
        return
    for step in reversed(carrying(flow, release)):
        if flow[step].parameter is not None:
            words = f"leave the {flow[step].parameter:g} of {flow[step].primitive.name} to the geometric planner"
            yield with_parameter(flow, step, None), words
    yield from _misplaced(replace(cause, step=release), flow)


def _blocked(cause: Cause, flow: ActionFlow) -> Changes:
    step = cause.step
    release = _release(flow, step)
    mover, other = str(cause.measurements.get("mover", "the robot")), str(cause.measurements.get("other", "something"))
    moved, asked = cause.number("eef_moved_m"), cause.number("asked_m")
    miss = max(cause.misses, key=lambda m: m.distance_m, default=None)
    yield from _navigated_again(cause, flow)
    if release is not None and miss is not None and abs(miss.centre_left_m) > 0.02:
        side = "left" if miss.centre_left_m > 0 else "right"
        words = f"go {abs(miss.centre_left_m):.2f} m to the {side} before it, where the middle of the place is"
        yield shifted(flow, release, LEFT, miss.centre_left_m), words
    if moved is not None and asked is not None and moved < asked and is_move(flow[step]):
        # A hand that meets something on its way down is where it can let go.
        clearance_m = TOUCHING_M if flow[step].primitive in UP.primitives() else CLEARANCE_M
        kept = max(moved - clearance_m, 0.0)
        ahead = moved - kept if flow[step].primitive in FORWARD.primitives() else 0.0
        shorter = with_parameter(flow, step, kept) if kept >= 0.01 else without(flow, step)
        if release is not None and miss is not None:
            # The way that is left is the hand's: what the miss says, less what the flow's later moves bring anyhow.
            rest = miss.forward_m + ahead - _later(flow, step + 1, release)
            at = step + 1 - (len(flow) - len(shorter))
            yield (
                _reaching(shorter, at, rest),
                f"stop {clearance_m:g} m before {other} and reach the rest with the hand",
            )
        yield shorter, f"stop {clearance_m:g} m before {mover} meets {other}"
    if release is not None:
        for lift in LIFTS_M:
            yield _over(flow, release, lift), f"lift by {lift:.2f} m before it and lower after it"
    for side_step in SIDE_STEPS_M:
        for primitive in (Primitive.MOVE_BASE_LEFT, Primitive.MOVE_BASE_RIGHT):
            words = f"step aside with {primitive.name} by {side_step:.1f} m before it"
            yield inserted(flow, step, Action(primitive, side_step)), words
    yield from _open_numbers(flow, release if release is not None else len(flow))


def _out_of_reach(cause: Cause, flow: ActionFlow) -> Changes:
    step, residual = cause.step, cause.number("residual_m")
    action = flow[step]
    if is_move(action) and residual is not None and isinstance(action.parameter, float | int):
        kept = float(action.parameter) - math.ceil(residual * 100.0) / 100.0 - 0.01
        shorter = with_parameter(flow, step, kept) if kept >= 0.01 else without(flow, step)
        axis = next((axis for axis in (FORWARD, LEFT) if action.primitive in axis.hand), None)
        if axis is not None and axis.base is not None:
            base = Action(
                axis.base[axis.hand.index(action.primitive)], round(float(action.parameter) - max(kept, 0.0), 2)
            )
            yield inserted(shorter, step, base), f"leave the {residual:.2f} m that the arm is short of to the base"
        yield shorter, f"ask the arm for the {residual:.2f} m less that it is short of"
    else:
        yield from narrower(flow, step)
        for later in range(step, len(flow)):
            number = flow[later].parameter
            if is_move(flow[later]) and isinstance(number, float | int):
                for part in (0.75, 0.5):
                    words = f"ask {flow[later].primitive.name} for {number * part:.2f} m only"
                    yield with_parameter(flow, later, number * part), words
        if not any(action.primitive in NAVIGATIONS for action in flow[: step + 1]):
            yield inserted(flow, step, Action(Primitive.NAVIGATE_TO_TARGET)), "drive to the target first"
    yield from _open_numbers(flow, len(flow))


def _aimed(cause: Cause, flow: ActionFlow) -> Changes:
    """Slides the base before APPROACH by what the aim was off by; APPROACH keeps that."""
    start = next((i for i in range(cause.step, -1, -1) if flow[i].primitive is Primitive.APPROACH), None)
    if start is None:
        return
    offsets = ((axis, cause.number(f"target_{axis.name}_m") or 0.0) for axis in (LEFT, FORWARD))
    slides = tuple(slide(axis, amount) for axis, amount in offsets if abs(amount) >= FINE_M)
    if slides:
        told = " and ".join(str(move) for move in slides)
        drive = () if any(a.primitive in NAVIGATIONS for a in flow[:start]) else (Action(Primitive.NAVIGATE_TO_TARGET),)
        yield inserted(flow, start, *drive, *slides), f"do {told} before APPROACH, which is what the aim was off by"


def _grasp_missed(cause: Cause, flow: ActionFlow) -> Changes:
    yield from _aimed(cause, flow)
    grasp = cause.step
    start = next((i for i in range(grasp, -1, -1) if flow[i].primitive is Primitive.APPROACH), grasp)
    grasps = [action for action in flow if action.primitive is Primitive.GRASP]
    if flow[grasp].primitive is Primitive.GRASP and len(grasps) == 1:
        again = (Action(Primitive.UNGRASP), Action(Primitive.RETREAT), Action(Primitive.NAVIGATE_TO_TARGET))
        yield inserted(flow, grasp + 1, *again, *flow[start : grasp + 1]), "let go, go back, and take hold again"
    if not any(action.primitive in NAVIGATIONS for action in flow[:start]):
        yield inserted(flow, start, Action(Primitive.NAVIGATE_TO_TARGET)), "drive to the target first"


def _grip_lost(cause: Cause, flow: ActionFlow) -> Changes:
    if flow[cause.step].primitive in ARTICULATIONS:
        yield from joint_stalled(cause, flow)
        return
    yield from _aimed(cause, flow)
    for step in range(cause.step, -1, -1):
        number = flow[step].parameter
        if is_move(flow[step]) and isinstance(number, float | int):
            yield with_parameter(flow, step, number / 2), f"move by half at {flow[step].primitive.name}"
    yield from _open_numbers(flow, len(flow))


def _no_way(cause: Cause, flow: ActionFlow) -> Changes:
    step = cause.step
    for lift in LIFTS_M:
        words = f"lift the hand by {lift:.2f} m before it"
        yield inserted(flow, step, Action(Primitive.LIFT_EEF_UP, lift)), words
    for primitive, amount in (
        (Primitive.MOVE_BASE_BACKWARD, 0.1),
        (Primitive.MOVE_BASE_BACKWARD, 0.3),
        (Primitive.MOVE_BASE_LEFT, 0.2),
        (Primitive.MOVE_BASE_RIGHT, 0.2),
    ):
        yield (
            inserted(flow, step, Action(primitive, amount)),
            f"make room with {primitive.name} {amount:.1f} m before it",
        )
    yield inserted(flow, step, Action(Primitive.RETREAT)), "retreat before it"
    yield from _open_numbers(flow, len(flow))


def _out_of_order(cause: Cause, flow: ActionFlow) -> Changes:
    step = cause.step
    needed = {
        Primitive.CONVERGE: (Primitive.APPROACH,),
        Primitive.GRASP: (Primitive.APPROACH, Primitive.CONVERGE),
        Primitive.ARTICULATE_OPEN: (Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP),
        Primitive.ARTICULATE_CLOSE: (Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP),
    }.get(flow[step].primitive, (Primitive.UNGRASP,))
    actions = tuple(Action(primitive) for primitive in needed)
    yield inserted(flow, step, *actions), f"do {', '.join(p.name for p in needed)} before it"
    yield from _open_numbers(flow, len(flow))


def _beyond_a_flow(cause: Cause, flow: ActionFlow) -> Changes:
    """No flow makes a thing narrower."""
    return iter(())


def _unknown(cause: Cause, flow: ActionFlow) -> Changes:
    yield from _open_numbers(flow, len(flow))


def _shift(flow: ActionFlow, release: int, forward_m: float, left_m: float, up_m: float) -> ActionFlow:
    """Returns the flow that lets go somewhere else by a vector; along each axis at most one step is changed."""
    for axis, amount_m in ((LEFT, left_m), (FORWARD, forward_m), (UP, up_m)):
        longer = shifted(flow, release, axis, amount_m)
        release += len(longer) - len(flow)
        flow = longer
    return flow


def _reaching(flow: ActionFlow, step: int, rest_m: float) -> ActionFlow:
    """Returns the flow in which the hand makes up for a way: by its own move's number, or by one more move."""
    rest_m = min(max(rest_m, -HAND_REACH_M), HAND_REACH_M)
    release = _release(flow, step)
    if release is not None and any(flow[i].primitive in FORWARD.hand for i in carrying(flow, release)):
        return shifted(flow, release, FORWARD, rest_m)
    return flow if abs(rest_m) < NEGLIGIBLE_M else inserted(flow, step, along(FORWARD, rest_m))


def _over(flow: ActionFlow, release: int, lift_m: float) -> ActionFlow:
    first = carrying(flow, release).start
    lowered = inserted(flow, release, Action(Primitive.LIFT_EEF_DOWN, lift_m))
    return inserted(lowered, first, Action(Primitive.LIFT_EEF_UP, lift_m))


def _nearer_and_up(flow: ActionFlow, release: int) -> Changes:
    for lower in (0.03, 0.08):
        words = f"lower by {lower:.2f} m before letting go"
        yield inserted(flow, release, Action(Primitive.LIFT_EEF_DOWN, lower)), words


def _open_numbers(flow: ActionFlow, end: int) -> Changes:
    """The most general correction: the lengths of moves are left to the geometric planner."""
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


def _later(flow: ActionFlow, first: int, release: int) -> float:
    """Returns how far forward the moves of some steps bring the hand."""
    signs = {FORWARD.hand[0]: 1.0, FORWARD.hand[1]: -1.0}
    if FORWARD.base is not None:
        signs |= {FORWARD.base[0]: 1.0, FORWARD.base[1]: -1.0}
    numbers = ((signs.get(a.primitive, 0.0), a.parameter) for a in flow[first:release])
    return sum(sign * float(n) for sign, n in numbers if isinstance(n, float | int))


def _release(flow: ActionFlow, step: int) -> int | None:
    return next((i for i in range(step, len(flow)) if flow[i].primitive is Primitive.UNGRASP), None)


def _told(forward_m: float, left_m: float, up_m: float) -> str:
    parts = [
        f"{abs(amount):.2f} m {there if amount > 0 else back}"
        for amount, there, back in (
            (forward_m, "further forward", "less far forward"),
            (left_m, "to the left", "to the right"),
            (up_m, "higher", "lower"),
        )
        if abs(amount) >= 0.005
    ]
    return " and ".join(parts) or "where it is"


_BY_KIND: dict[CauseKind, Callable[[Cause, ActionFlow], Changes]] = {
    CauseKind.JOINT_SHORT: joint_short,
    CauseKind.JOINT_STALLED: joint_stalled,
    CauseKind.OUT_OF_REACH: _out_of_reach,
    CauseKind.NOWHERE: _nowhere,
    CauseKind.BLOCKED: _blocked,
    CauseKind.MISPLACED: _misplaced,
    CauseKind.GRASP_MISSED: _grasp_missed,
    CauseKind.GRIP_LOST: _grip_lost,
    CauseKind.NO_WAY: _no_way,
    CauseKind.DISPLACED: _blocked,
    CauseKind.OUT_OF_ORDER: _out_of_order,
    CauseKind.TOO_WIDE: _beyond_a_flow,
    CauseKind.UNKNOWN: _unknown,
}
