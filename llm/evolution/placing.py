"""Corrections of how a held thing gets to its place: by what it missed by, around what is in the way, elsewhere."""

from __future__ import annotations

from dataclasses import replace

from llm.evolution.cause import Cause
from llm.evolution.changes import Changes, open_numbers, release_after
from llm.evolution.edits import (
    FORWARD,
    HAND_REACH_M,
    LEFT,
    NEGLIGIBLE_M,
    UP,
    along,
    carrying,
    inserted,
    is_move,
    shifted,
    with_parameter,
    without,
)
from oag import Action, ActionFlow, Primitive

CLEARANCE_M = 0.05
TOUCHING_M = 0.005
OFF_M = 0.01
"""How far beside its goal a base has to end for a second drive to be worth it."""

SIDE_STEPS_M = (0.1, 0.2, 0.3)
LIFTS_M = (0.05, 0.1)


def misplaced(cause: Cause, flow: ActionFlow) -> Changes:
    """Yields flows that let go elsewhere: by what was missed, or lower."""
    release = release_after(flow, cause.step)
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
    yield from open_numbers(flow, release)


def nowhere(cause: Cause, flow: ActionFlow) -> Changes:
    """Yields flows whose moves lead to a free place: one number open, then by what was missed."""
    release = release_after(flow, cause.step)
    if release is None:
        return
    for step in reversed(carrying(flow, release)):
        if flow[step].parameter is not None:
            words = f"leave the {flow[step].parameter:g} of {flow[step].primitive.name} to the geometric planner"
            yield with_parameter(flow, step, None), words
    # From a nominal place nobody fills open numbers in: those moves go, and what was missed says what comes instead.
    closed = tuple(action for action in flow if not (is_move(action) and action.parameter is None))
    yield from misplaced(replace(cause, step=release - (len(flow) - len(closed))), closed)


def blocked(cause: Cause, flow: ActionFlow) -> Changes:
    """Yields flows that go around what is in the way, or stop before it."""
    step = cause.step
    release = release_after(flow, step)
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
    yield from open_numbers(flow, release if release is not None else len(flow))


def _navigated_again(cause: Cause, flow: ActionFlow) -> Changes:
    """Where the base ended beside its goal, a second, shorter drive ends nearer to it."""
    beside = cause.number("beside_m")
    at = next((i for i in range(cause.step, -1, -1) if flow[i].primitive is Primitive.NAVIGATE_TO_SUPPORT), None)
    if beside is not None and beside >= OFF_M and at is not None:
        again = inserted(flow, at + 1, Action(Primitive.NAVIGATE_TO_SUPPORT))
        yield again, f"drive to the support again, since the base ended {beside:.2f} m beside where it was to be"


def _shift(flow: ActionFlow, release: int, forward_m: float, left_m: float, up_m: float) -> ActionFlow:
    """Returns the flow that lets go somewhere else by a vector; along each axis at most one step is changed."""
    for axis, amount_m in ((LEFT, left_m), (FORWARD, forward_m), (UP, up_m)):
        longer = shifted(flow, release, axis, amount_m)
        release += len(longer) - len(flow)
        flow = longer
    return flow


def _over(flow: ActionFlow, release: int, lift_m: float) -> ActionFlow:
    first = carrying(flow, release).start
    lowered = inserted(flow, release, Action(Primitive.LIFT_EEF_DOWN, lift_m))
    return inserted(lowered, first, Action(Primitive.LIFT_EEF_UP, lift_m))


def _reaching(flow: ActionFlow, step: int, rest_m: float) -> ActionFlow:
    """Returns the flow in which the hand makes up for a way: by its own move's number, or by one more move."""
    rest_m = min(max(rest_m, -HAND_REACH_M), HAND_REACH_M)
    release = release_after(flow, step)
    if release is not None and any(flow[i].primitive in FORWARD.hand for i in carrying(flow, release)):
        return shifted(flow, release, FORWARD, rest_m)
    return flow if abs(rest_m) < NEGLIGIBLE_M else inserted(flow, step, along(FORWARD, rest_m))


def _nearer_and_up(flow: ActionFlow, release: int) -> Changes:
    for lower in (0.03, 0.08):
        words = f"lower by {lower:.2f} m before letting go"
        yield inserted(flow, release, Action(Primitive.LIFT_EEF_DOWN, lower)), words


def _later(flow: ActionFlow, first: int, release: int) -> float:
    """Returns how far forward the moves of some steps bring the hand."""
    signs = {FORWARD.hand[0]: 1.0, FORWARD.hand[1]: -1.0}
    if FORWARD.base is not None:
        signs |= {FORWARD.base[0]: 1.0, FORWARD.base[1]: -1.0}
    numbers = ((signs.get(a.primitive, 0.0), a.parameter) for a in flow[first:release])
    return sum(sign * float(n) for sign, n in numbers if isinstance(n, float | int))


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
