"""Which changes of a flow a cause calls for, the ones that the measurements point to first.

Every correction says in words what it does; none is checked here: `oag.admissible` decides whether it may run.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from llm.evolution.cause import CauseKind, RootCause
from llm.evolution.corrections.edits import (
    FORWARD,
    LEFT,
    Changes,
    driven_first,
    inserted,
    is_move,
    numbered_moves,
    open_numbers,
    release_after,
    with_parameter,
    without,
)
from llm.evolution.corrections.grips import grasp_missed, grip_lost, held_badly
from llm.evolution.corrections.joints import as_far_as_free, joint_short, joint_stalled, narrower, opened_little
from llm.evolution.corrections.placing import LIFTS_M, blocked, in_the_way, misplaced, nowhere
from oag import Action, ActionFlow, Primitive

_TAKES_HOLD = (Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP)
_CHOOSES_A_STANCE = (Primitive.APPROACH, Primitive.NAVIGATE_TO_SUPPORT)
# What has to come before a step that came out of place.
_NEEDED = {
    Primitive.CONVERGE: _TAKES_HOLD[:1],
    Primitive.GRASP: _TAKES_HOLD[:2],
    Primitive.ARTICULATE_OPEN: _TAKES_HOLD,
    Primitive.ARTICULATE_CLOSE: _TAKES_HOLD,
}
# Moves of the base that make room, the smallest first.
_ROOM_M = (
    (Primitive.MOVE_BASE_BACKWARD, 0.1),
    (Primitive.MOVE_BASE_BACKWARD, 0.3),
    (Primitive.MOVE_BASE_LEFT, 0.2),
    (Primitive.MOVE_BASE_RIGHT, 0.2),
)


def corrections(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields the corrections of a flow for a cause, the most likely one first, the most general one last."""
    yield from (change for change in _BY_KIND[cause.kind](cause, flow) if change[0] != flow)


def _out_of_reach(cause: RootCause, flow: ActionFlow) -> Changes:
    step, residual = cause.step, cause.residual_m
    action = flow[step]
    if is_move(action) and residual is not None and isinstance(action.parameter, float | int):
        kept = float(action.parameter) - math.ceil(residual * 100.0) / 100.0 - 0.01
        shorter = with_parameter(flow, step, kept) if kept >= 0.01 else without(flow, step)
        for axis in (FORWARD, LEFT):
            if action.primitive in axis.hand:
                rest = Action(
                    axis.base[axis.hand.index(action.primitive)], round(float(action.parameter) - max(kept, 0.0), 2)
                )
                yield inserted(shorter, step, rest), f"leave the {residual:.2f} m that the arm is short of to the base"
        yield shorter, f"ask the arm for the {residual:.2f} m less that it is short of"
    else:
        yield from narrower(flow, step)
        for later, number in numbered_moves(flow, range(step, len(flow))):
            for part in (0.75, 0.5):
                words = f"ask {flow[later].primitive.name} for {number * part:.2f} m only"
                yield with_parameter(flow, later, number * part), words
        yield from driven_first(flow, step, step + 1)
    yield from open_numbers(flow)


def _no_way(cause: RootCause, flow: ActionFlow) -> Changes:
    step = cause.step
    if cause.unplanned is not None and cause.unplanned.joint is not None:
        yield from as_far_as_free(flow, step, cause.unplanned.free_to_fraction)
    if flow[step].primitive in _CHOOSES_A_STANCE:
        # A place to stand is chosen for all that follows: where there is none, a number after it may ask for too much.
        yield from open_numbers(flow)
    if flow[step].primitive is Primitive.APPROACH:
        yield from driven_first(flow, step, step + 1)
    # Where one lift did not help, more of the same will not.
    lifted = step > 0 and flow[step - 1].primitive is Primitive.LIFT_EEF_UP
    for lift in () if lifted else LIFTS_M:
        words = f"lift the hand by {lift:.2f} m before it"
        yield inserted(flow, step, Action(Primitive.LIFT_EEF_UP, lift)), words
    for primitive, amount_m in _ROOM_M:
        words = f"make room with {primitive.name} {amount_m:.1f} m before it"
        yield inserted(flow, step, Action(primitive, amount_m)), words
    yield inserted(flow, step, Action(Primitive.RETREAT)), "retreat before it"
    yield from open_numbers(flow)


def _still_touched(cause: RootCause, flow: ActionFlow) -> Changes:
    after = flow[cause.step + 1 :]
    if not any(action.primitive is Primitive.RETREAT for action in after):
        yield inserted(flow, cause.step + 1, Action(Primitive.RETREAT)), "take the hand away from it by RETREAT"
    release = release_after(flow, cause.step)
    if release is not None:
        yield from open_numbers(flow, release)


def _out_of_order(cause: RootCause, flow: ActionFlow) -> Changes:
    step = cause.step
    needed = _NEEDED.get(flow[step].primitive, (Primitive.UNGRASP,))
    yield inserted(flow, step, *map(Action, needed)), f"do {', '.join(p.name for p in needed)} before it"
    yield from open_numbers(flow)


def _too_long(cause: RootCause, flow: ActionFlow) -> Changes:
    yield from narrower(flow, cause.step)
    yield from open_numbers(flow)


_BY_KIND: dict[CauseKind, Callable[[RootCause, ActionFlow], Changes]] = {
    CauseKind.JOINT_SHORT: joint_short,
    CauseKind.JOINT_STALLED: joint_stalled,
    CauseKind.OUT_OF_REACH: _out_of_reach,
    CauseKind.NOWHERE: nowhere,
    CauseKind.BLOCKED: blocked,
    CauseKind.MISPLACED: misplaced,
    CauseKind.STILL_TOUCHED: _still_touched,
    CauseKind.GRASP_MISSED: grasp_missed,
    CauseKind.GRIP_LOST: grip_lost,
    CauseKind.NO_WAY: _no_way,
    CauseKind.DISPLACED: blocked,
    CauseKind.OUT_OF_ORDER: _out_of_order,
    CauseKind.TOO_LONG: _too_long,
    CauseKind.TOO_WIDE: lambda cause, flow: iter(()),
    CauseKind.HELD_BADLY: held_badly,
    CauseKind.OPENED_LITTLE: opened_little,
    CauseKind.IN_THE_WAY: in_the_way,
    CauseKind.UNKNOWN: lambda cause, flow: open_numbers(flow),
}
