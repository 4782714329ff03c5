"""Corrections of how a held thing gets to its place: by what it missed by, around what is in the way, elsewhere."""

from __future__ import annotations

from dataclasses import replace

from llm.evolution.cause import RootCause
from llm.evolution.corrections.edits import (
    AWAY_M,
    FORWARD,
    HAND_REACH_M,
    LEFT,
    NAVIGATIONS,
    NEGLIGIBLE_M,
    UP,
    Changes,
    along,
    carrying,
    inserted,
    is_move,
    last_up_to,
    move,
    numbered_moves,
    open_numbers,
    release_after,
    shifted,
    with_parameter,
    without,
)
from llm.evolution.corrections.joints import joint_stalled
from oag import Action, ActionFlow, Primitive
from oag.model.primitives import ARTICULATIONS

CLEARANCE_M = 0.05
"""What stays between a mover and what it met."""

TOUCHING_M = 0.005
"""The same on the way down, where what is met is mostly the place itself."""

OFF_M = 0.01
"""How far beside its goal a base has to end for a second drive to be worth it."""

_BASE_LINKS = "base_"
_ROBOT_LINKS = ("panda_", _BASE_LINKS)
FINE_M = 0.003
"""The smallest move over a place that is worth a step."""

OVER_M = 0.08
"""From how high over its place a thing is lowered after it was moved aside: over the rim of a bowl."""

FIRST_M = 0.01
"""The shortest first one of two lowerings."""

# Tried in this order: the smallest step aside first, and the widest way around.
SIDE_STEPS_M = (0.1, 0.2, 0.3)
DETOURS_M = (0.5, 0.25)
LIFTS_M = (0.05, 0.1)
"""Over a sill or a rim, the lower one first."""


def misplaced(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows that let go elsewhere: by what was missed, or lower."""
    release = release_after(flow, cause.step)
    if release is None:
        return
    yield from _navigated_again(cause, flow)
    miss = max(cause.misses, key=lambda m: m.distance_m, default=None)
    if miss is not None and miss.distance_m > 0.0:
        if cause.was_planned:
            for forward_m, left_m in ((miss.centre_forward_m, miss.centre_left_m), (miss.forward_m, miss.left_m)):
                words = f"let go {_told(forward_m, left_m, 0.0)}, moved there over the place, which is what was missing"
                yield _corrected(flow, release, forward_m, left_m), words
        told = _told(miss.forward_m, miss.left_m, miss.up_m)
        yield _shift(flow, release, miss.forward_m, miss.left_m, miss.up_m), f"let go {told}, which is what was missing"
        centred = (miss.centre_forward_m, miss.centre_left_m, miss.up_m)
        yield _shift(flow, release, *centred), f"let go {_told(*centred)}, in the middle of the place"
    for lower in (0.03, 0.08):
        words = f"lower by {lower:.2f} m before letting go"
        yield inserted(flow, release, Action(Primitive.LIFT_EEF_DOWN, lower)), words
    yield from open_numbers(flow, release)


def nowhere(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows whose moves lead to a free place: one number open, then by what was missed."""
    release = release_after(flow, cause.step)
    if release is None:
        return
    for step in reversed(carrying(flow, release)):
        if flow[step].parameter is not None:
            words = f"leave the {flow[step].parameter:g} of {flow[step].primitive.name} to the geometric planner"
            opened = with_parameter(flow, step, None)
            # Where the base ended beside its goal, too, the opened flow would only meet with that next.
            yield from ((again, f"{words}, and {other}") for again, other in _navigated_again(cause, opened))
            yield opened, words
    # From a nominal place nobody fills open numbers in: those moves go, and what was missed says what comes instead.
    closed = tuple(action for action in flow if not (is_move(action) and action.parameter is None))
    yield from misplaced(replace(cause, step=release - (len(flow) - len(closed))), closed)


def blocked(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows that go around what is in the way, or stop before it."""
    step = cause.step
    if flow[step].primitive in ARTICULATIONS:
        yield from joint_stalled(cause, flow)
        return
    release = release_after(flow, step)
    met = cause.contact
    if flow[step].primitive in NAVIGATIONS and met is not None and met.mover.startswith(_BASE_LINKS):
        yield from _driven_elsewhere(met.other, flow, step, release)
        return
    mover, other = ("the robot", "something") if met is None else (met.mover, met.other)
    moved, asked = (None, None) if cause.move is None else (cause.move.eef_moved_m, cause.move.asked_m)
    miss = max(cause.misses, key=lambda m: m.distance_m, default=None)
    yield from _navigated_again(cause, flow)
    over: list[tuple[ActionFlow, str]] = []
    if release is not None:
        for lift_m in LIFTS_M:
            lowered = inserted(flow, release, Action(Primitive.LIFT_EEF_DOWN, lift_m))
            lifted = inserted(lowered, carrying(flow, release).start, Action(Primitive.LIFT_EEF_UP, lift_m))
            over.append((lifted, f"lift by {lift_m:.2f} m before it and lower after it"))
    # What is held ran into its own place on the way in: it hangs lower than it was thought to.
    held = met is not None and not met.mover.startswith(_ROBOT_LINKS) and met.other_link != "door"
    if held and FORWARD.sign(flow[step]):
        yield from over
    lowering = flow[step].primitive is Primitive.LIFT_EEF_DOWN
    if lowering and release is not None and miss is not None and cause.was_planned:
        words = (
            f"move {_told(miss.centre_forward_m, miss.centre_left_m, 0.0)} over the place before lowering all the way"
        )
        yield _corrected(flow, release, miss.centre_forward_m, miss.centre_left_m), words
    if release is not None and miss is not None and abs(miss.centre_left_m) > 0.02 and not cause.was_planned:
        side = "left" if miss.centre_left_m > 0 else "right"
        words = f"go {abs(miss.centre_left_m):.2f} m to the {side} before it, where the middle of the place is"
        yield shifted(flow, release, LEFT, miss.centre_left_m), words
    if moved is not None and asked is not None and moved < asked and is_move(flow[step]):
        # A hand that meets something on its way down is where it can let go.
        clearance_m = TOUCHING_M if UP.sign(flow[step]) else CLEARANCE_M
        kept = max(moved - clearance_m, 0.0)
        ahead = moved - kept if FORWARD.sign(flow[step]) else 0.0
        shorter = with_parameter(flow, step, kept) if kept >= 0.01 else without(flow, step)
        if release is not None and miss is not None:
            # The way that is left is the hand's: what the miss says, less what the flow's later moves bring anyhow.
            later = numbered_moves(flow, range(step + 1, release))
            rest = miss.forward_m + ahead - sum(FORWARD.sign(flow[i]) * number for i, number in later)
            at = step + 1 - (len(flow) - len(shorter))
            yield (
                _reaching(shorter, at, rest),
                f"stop {clearance_m:g} m before {other} and reach the rest with the hand",
            )
        yield shorter, f"stop {clearance_m:g} m before {mover} meets {other}"
    yield from over
    for side_step in SIDE_STEPS_M:
        for primitive in (Primitive.MOVE_BASE_LEFT, Primitive.MOVE_BASE_RIGHT):
            words = f"step aside with {primitive.name} by {side_step:.1f} m before it"
            yield inserted(flow, step, Action(primitive, side_step)), words
    yield from open_numbers(flow, release)


def _driven_elsewhere(other: str, flow: ActionFlow, step: int, release: int | None) -> Changes:
    """What the base met on its way is no matter of the hand: the base ends elsewhere, or sets out from elsewhere."""
    sides = (Primitive.MOVE_BASE_LEFT, Primitive.MOVE_BASE_RIGHT)
    ways = [(away, primitive) for away in DETOURS_M for primitive in sides]
    for number, (away, primitive) in enumerate((*ways, (AWAY_M, Primitive.MOVE_BASE_BACKWARD))):
        if number == len(sides):
            yield from open_numbers(flow, release)
        words = f"set out from {away:g} m along {primitive.name}, by another way around {other}"
        yield inserted(flow, step, Action(primitive, away)), words


def in_the_way(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows that leave an item further in, which kept a door from closing."""
    release = release_after(flow, cause.step)
    if release is None:
        return
    for further in (0.04, 0.08):
        yield shifted(flow, release, FORWARD, further), f"let go {further:.2f} m further in, out of the door's way"
    yield from open_numbers(flow, release)


def _navigated_again(cause: RootCause, flow: ActionFlow) -> Changes:
    """Where the base ended beside its goal, a second, shorter drive ends nearer to it."""
    beside = cause.beside_m
    at = last_up_to(flow, cause.step, Primitive.NAVIGATE_TO_SUPPORT)
    if beside is not None and beside >= OFF_M and at is not None:
        back = (Action(Primitive.MOVE_BASE_BACKWARD, AWAY_M), Action(Primitive.NAVIGATE_TO_SUPPORT))
        words = f"go back a little and drive there again, since the base ended {beside:.2f} m beside where it was to be"
        yield inserted(flow, at + 1, *back), words


def _corrected(flow: ActionFlow, release: int, forward_m: float, left_m: float) -> ActionFlow:
    """Returns the flow that moves the thing aside over its place, between two lowerings: planning leaves that out."""
    ways = ((FORWARD, forward_m), (LEFT, left_m))
    moves = tuple(move(axis.hand, amount_m, 3) for axis, amount_m in ways if abs(amount_m) >= FINE_M)
    if not moves:
        return flow
    steps = [s for s in carrying(flow, release) if flow[s].primitive is Primitive.LIFT_EEF_DOWN]
    if len(steps) > 1:
        return inserted(flow, steps[-1], *moves)
    number = flow[steps[0]].parameter if steps else None
    whole = float(number) if isinstance(number, int | float) else 0.0
    first = max(round(whole - OVER_M, 3), FIRST_M)
    down = (Action(Primitive.LIFT_EEF_DOWN, first), *moves, Action(Primitive.LIFT_EEF_DOWN, OVER_M))
    at = steps[0] if steps else release
    return (*flow[:at], *down, *flow[at + 1 if steps else at :])


def _shift(flow: ActionFlow, release: int, forward_m: float, left_m: float, up_m: float) -> ActionFlow:
    for axis, amount_m in ((LEFT, left_m), (FORWARD, forward_m), (UP, up_m)):
        longer = shifted(flow, release, axis, amount_m)
        release += len(longer) - len(flow)
        flow = longer
    return flow


def _reaching(flow: ActionFlow, step: int, rest_m: float) -> ActionFlow:
    """Returns the flow in which the hand makes up for a way: by its own move's number, or by one more move."""
    rest_m = min(max(rest_m, -HAND_REACH_M), HAND_REACH_M)
    release = release_after(flow, step)
    if release is not None and any(flow[i].primitive in FORWARD.hand for i in carrying(flow, release)):
        return shifted(flow, release, FORWARD, rest_m)
    return flow if abs(rest_m) < NEGLIGIBLE_M else inserted(flow, step, along(FORWARD, rest_m))


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
