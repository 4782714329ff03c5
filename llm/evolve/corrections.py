"""Corrections of a flow for each measured cause: joint limits, grasps, placements; the likeliest come first.

Every correction states in words what it does. None is checked here: `admissible` decides whether it may run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from llm.evolve.diagnosis import CauseKind, FailureCause
from llm.evolve.flow_edits import (
    AWAY_M,
    FORWARD,
    HAND_REACH_M,
    LEFT,
    NAVIGATIONS,
    NEGLIGIBLE_M,
    UP,
    Axis,
    Changes,
    along,
    carrying,
    driven_first,
    halved,
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
from oag import Action, Primitive
from oag.measurements import Miss
from oag.model.actions import ActionFlow
from oag.model.robots import ROBOTS
from oag.model.symbols import ARTICULATIONS

OPEN_ENOUGH = (0.3, 0.5, 0.7, 0.85)
"""Opening fractions of a joint's range to try, the smallest change first."""

_LET_GO = (Primitive.UNGRASP, Primitive.RETREAT, Primitive.NAVIGATE_TO_TARGET)
HOLD_AGAIN = tuple(map(Action, (*_LET_GO, Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP)))
"""Lets go of a handle and takes hold of it again."""

_BEFORE = 0.03  # Margin before an obstacle, as a fraction of the joint's range.
_OPENED = "leave the joint limits to the geometric planner"


def joint_short(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield flows whose joint limits reach the goal; the remaining opening gives the amount."""
    step = cause.step
    limits, left = flow[step].parameter, None if cause.joint is None else cause.joint.fraction_reached
    if isinstance(limits, tuple) and left is not None:
        low, high = limits
        if flow[step].primitive is Primitive.ARTICULATE_CLOSE:
            raised = min(high + math.ceil(left * 100.0) / 100.0, 1.0)
            words = f"raise the upper limit from {high:g} to {raised:g}: {left:.2f} of the range was left open"
            yield with_parameter(flow, step, (0.0, raised)), words
        else:
            for fraction in OPEN_ENOUGH:
                if fraction > max(left, high):
                    words = f"open to {fraction:g} of the range instead of {high:g}"
                    yield with_parameter(flow, step, (low, fraction)), words
    yield with_parameter(flow, step, None), _OPENED


def opened_little(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield flows that open a door further which kept the robot out later."""
    step, reached = cause.step, 0.0 if cause.joint is None else cause.joint.fraction_reached
    for fraction in reversed(OPEN_ENOUGH):
        if fraction > reached + 0.05:
            words = f"open to {fraction:g} of the range instead of the {reached:.2f} it came to"
            yield with_parameter(flow, step, (0.0, fraction)), words
    yield with_parameter(flow, step, None), _OPENED


def joint_stalled(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield flows for a stalled joint: smaller opening before an obstacle, else a new grasp on the way."""
    joint = cause.joint
    met = cause.contact is not None or cause.stopped or (joint is not None and joint.fraction_reached >= 0.5)
    if met:
        yield from _less_far(cause, flow)
    step = cause.step
    opening = flow[step].primitive is Primitive.ARTICULATE_OPEN
    if joint is not None:
        half = (joint.fraction_before + joint.fraction_asked) / 2
        first = (0.0, half) if opening else (0.0, joint.fraction_before - half)
        second = with_parameter(flow, step, None)[step]
        twice = inserted(with_parameter(flow, step, first), step + 1, *HOLD_AGAIN, second)
        yield twice, f"let go at {half:.2f} of the range, take hold of the handle again, and go on"
    if not met:
        yield from _less_far(cause, flow)
    yield from narrower(flow, step)
    yield with_parameter(flow, step, None), _OPENED


def _less_far(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield flows that open a door to where it came, or a little less, since it or the robot met something there."""
    if flow[cause.step].primitive is not Primitive.ARTICULATE_OPEN or cause.joint is None:
        return
    reached = cause.joint.fraction_reached
    if cause.stopped:
        words = f"open to {reached:.2f}, where it ends whatever is asked"
        yield with_parameter(flow, cause.step, (0.0, reached)), words
    elif reached > 0.1:
        for less in (0.04, 0.12):
            words = f"open to {reached - less:.2f}, since it came to {reached:.2f}"
            yield with_parameter(flow, cause.step, (0.0, reached - less)), words


def as_far_as_free(flow: ActionFlow, step: int, free_to: float | None) -> Changes:
    """Yield flows that open the next joint to just before a known obstacle, else less far."""
    later = next((later for later in range(step, len(flow)) if flow[later].primitive in ARTICULATIONS), None)
    if later is not None and free_to is not None and flow[later].primitive is Primitive.ARTICULATE_OPEN:
        before = math.floor(100.0 * free_to) / 100.0 - _BEFORE
        if before > 0.0:
            yield with_parameter(flow, later, (0.0, before)), f"open to {before:.2f}: it is free to {free_to:.2f}"
    yield from narrower(flow, step)


def narrower(flow: ActionFlow, step: int) -> Changes:
    """Yield flows that open the next joint less far."""
    for later in range(step, len(flow)):
        limits = flow[later].parameter
        if flow[later].primitive is Primitive.ARTICULATE_OPEN and isinstance(limits, tuple):
            for fraction in reversed(OPEN_ENOUGH):
                if fraction < limits[1] - 0.05:
                    yield with_parameter(flow, later, (limits[0], fraction)), f"open to {fraction:g} of the range only"
        if flow[later].primitive in ARTICULATIONS and isinstance(limits, tuple):
            yield with_parameter(flow, later, None), _OPENED
            return


SMALLEST_SLIDE_M = 0.002
"""Smallest error of an aim that is worth a correction: the gripper has a few millimetres to spare."""

DEEPER_M = 0.015
"""Additional reach of a hand that lost an item, so that more of the fingers holds it."""

PALMS = frozenset(robot.hand_link for robot in ROBOTS.values())
SPARE_M = (0.006, 0.012)
"""Reductions of reach after a contact of the palm, in addition to the remaining distance."""


def aimed(off_m: tuple[float, float], flow: ActionFlow, step: int) -> Changes:
    """Slide the base before APPROACH by the error of the aim; APPROACH keeps the offset.

    Args:
        off_m: Offset of the target from the aim, or from its place in the hand: forward and left [m].
        flow: The flow to correct.
        step: A step at or after the APPROACH.
    """
    forward_m, left_m = off_m
    yield from slide_base(flow, step, {LEFT: left_m, FORWARD: forward_m}, "which is what the aim was off by")


def slide_base(flow: ActionFlow, step: int, by_m: Mapping[Axis, float], why: str) -> Changes:
    """Slide the base before the APPROACH of a step; an existing slide becomes longer or shorter."""
    start = last_up_to(flow, step, Primitive.APPROACH)
    if start is None or all(abs(amount) < SMALLEST_SLIDE_M for amount in by_m.values()):
        return
    totals = dict.fromkeys((LEFT, FORWARD), 0.0) | {axis: a for axis, a in by_m.items() if abs(a) >= SMALLEST_SLIDE_M}
    first = start
    while first > 0 and (slide := _slide_of(flow[first - 1])) is not None:
        totals[slide[0]] += slide[1]
        first -= 1
    slides = tuple(move(axis.base, amount, 3) for axis, amount in totals.items() if abs(amount) >= SMALLEST_SLIDE_M)
    slides_text = " and ".join(map(str, slides)) or "no slide"
    drive = () if any(a.primitive in NAVIGATIONS for a in flow[:first]) else (Action(Primitive.NAVIGATE_TO_TARGET),)
    yield (*flow[:first], *drive, *slides, *flow[start:]), f"do {slides_text} before APPROACH, {why}"


def _slide_of(action: Action) -> tuple[Axis, float] | None:
    for axis in (LEFT, FORWARD):
        if action.primitive in axis.base and isinstance(action.parameter, float | int):
            return axis, action.parameter * axis.sign(action)
    return None


def grasp_missed(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield flows with a better aim or a repeated grasp."""
    step = cause.step
    yield from aimed(cause.off_the_aim_m, flow, step)
    met = cause.contact
    if flow[step].primitive is Primitive.CONVERGE and met is not None and met.mover in PALMS:
        # The object reaches further into the hand than assumed.
        for spare in SPARE_M:
            less = math.ceil(((cause.residual_m or 0.0) + spare) * 1000.0) / 1000.0
            why = f"to reach {less * 1000:.0f} mm less far, since the palm met {met.other}"
            yield from slide_base(flow, step, {FORWARD: -less}, why)
    drives = [i for i in range(step) if flow[i].primitive is Primitive.NAVIGATE_TO_TARGET]
    if len(drives) == 1 and flow[step].primitive is Primitive.GRASP and cause.fingers_touching == 0:
        # The drive may have moved the target; after replanning, the next drive is short.
        back = (Action(Primitive.MOVE_BASE_BACKWARD, AWAY_M), Action(Primitive.NAVIGATE_TO_TARGET))
        words = "go back a little and drive there again, since it is not where the first drive was planned for"
        yield inserted(flow, drives[0] + 1, *back), words
    yield from _held_again(flow, step)
    start = last_up_to(flow, step, Primitive.APPROACH)
    start = step if start is None else start
    yield from driven_first(flow, start, start)


def held_badly(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield flows with a better grasp of an item that was lost while it was carried."""
    yield from aimed(cause.held_off_m, flow, cause.step)
    yield from aimed(cause.off_the_aim_m, flow, cause.step)
    yield from _held_again(flow, cause.step)
    why = f"to reach {DEEPER_M * 1000:.0f} mm further, so that more of the fingers holds it"
    yield from slide_base(flow, cause.step, {FORWARD: DEEPER_M}, why)
    yield from halved(flow, range(cause.step + 1, len(flow)))
    yield from open_numbers(flow)


def _held_again(flow: ActionFlow, grasp: int) -> Changes:
    start = last_up_to(flow, grasp, Primitive.APPROACH)
    grasps = [action for action in flow if action.primitive is Primitive.GRASP]
    if flow[grasp].primitive is Primitive.GRASP and len(grasps) == 1:
        again = (Action(Primitive.UNGRASP), Action(Primitive.RETREAT), Action(Primitive.NAVIGATE_TO_TARGET))
        taken = flow[grasp if start is None else start : grasp + 1]
        yield inserted(flow, grasp + 1, *again, *taken), "let go, go back, and take hold again"


def grip_lost(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield flows that demand less of a grip, or grasp better."""
    if flow[cause.step].primitive in ARTICULATIONS:
        yield from joint_stalled(cause, flow)
        return
    yield from aimed(cause.off_the_aim_m, flow, cause.step)
    grasp = last_up_to(flow, cause.step, Primitive.GRASP)
    if grasp is not None:
        yield from aimed(cause.held_off_m, flow, grasp)
        yield from _held_again(flow, grasp)
    yield from halved(flow, range(cause.step, -1, -1))
    yield from open_numbers(flow)


CLEARANCE_M = 0.05
"""Distance kept between a moving body and its obstacle."""

TOUCHING_M = 0.005
"""The same for lowering, where the obstacle is mostly the place itself."""

OFF_M = 0.01
"""Error of the base from which a second drive is worthwhile."""

_BASE_LINKS = ("base_", "lift_")
_ROBOT_LINKS = (*_BASE_LINKS, *(link for robot in ROBOTS.values() for link in robot.arm_links + robot.gripper_links))
SMALLEST_SHIFT_M = 0.003
"""Smallest move over a place that is worth a step."""

OVER_M = 0.08
"""Height over its place from which an object is lowered after a sideways move: over the rim of a bowl."""

FIRST_M = 0.01
"""Shortest first one of two lowerings."""

# In the order of trying: the smallest sidestep first, the widest detour first.
SIDE_STEPS_M = (0.1, 0.2, 0.3)
DETOURS_M = (0.5, 0.25)
LIFTS_M = (0.05, 0.1)
"""Over a sill or a rim, the lower one first."""


def misplaced(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield flows with another place of release: shifted by the miss, or lower."""
    release = release_after(flow, cause.step)
    if release is None:
        return
    yield from _navigated_again(cause, flow)
    miss = max(cause.misses, key=lambda m: m.distance_m, default=None)
    if miss is not None and miss.distance_m > 0.0:
        if cause.was_planned:
            for forward_m, left_m in ((miss.centre_forward_m, miss.centre_left_m), (miss.forward_m, miss.left_m)):
                words = f"let go {_text(forward_m, left_m, 0.0)}, moved there over the place, which is what was missing"
                yield _corrected(flow, release, forward_m, left_m), words
        offset = _text(miss.forward_m, miss.left_m, miss.up_m)
        yield (
            _shift(flow, release, miss.forward_m, miss.left_m, miss.up_m),
            f"let go {offset}, which is what was missing",
        )
        centred = (miss.centre_forward_m, miss.centre_left_m, miss.up_m)
        yield _shift(flow, release, *centred), f"let go {_text(*centred)}, in the middle of the place"
    for lower in (0.03, 0.08):
        words = f"lower by {lower:.2f} m before letting go"
        yield inserted(flow, release, Action(Primitive.LIFT_EEF_DOWN, lower)), words
    yield from open_numbers(flow, release)


def nowhere(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield flows whose moves lead to a free place: one number open, then shifted by the miss."""
    release = release_after(flow, cause.step)
    if release is None:
        return
    for step in reversed(carrying(flow, release)):
        if flow[step].parameter is not None:
            words = f"leave the {flow[step].parameter:g} of {flow[step].primitive.name} to the geometric planner"
            opened = with_parameter(flow, step, None)
            # If the base missed its goal as well, the opened flow would fail by that next.
            yield from ((again, f"{words}, and {other}") for again, other in _navigated_again(cause, opened))
            yield opened, words
    # From a nominal place open numbers are not filled in: these moves are removed, and the miss replaces them.
    closed = tuple(action for action in flow if not (is_move(action) and action.parameter is None))
    yield from misplaced(replace(cause, step=release - (len(flow) - len(closed))), closed)


def blocked(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield flows that go around an obstacle, or stop before it."""
    step = cause.step
    if flow[step].primitive in ARTICULATIONS:
        yield from joint_stalled(cause, flow)
        return
    release = release_after(flow, step)
    met = cause.contact
    if flow[step].primitive in NAVIGATIONS and met is not None and met.mover.startswith(_BASE_LINKS):
        yield from _driven_elsewhere(met.other, flow, step, release)
        return
    miss = max(cause.misses, key=lambda m: m.distance_m, default=None)
    yield from _navigated_again(cause, flow)
    over: list[tuple[ActionFlow, str]] = []
    if release is not None:
        for lift_m in LIFTS_M:
            lowered = inserted(flow, release, Action(Primitive.LIFT_EEF_DOWN, lift_m))
            lifted = inserted(lowered, carrying(flow, release).start, Action(Primitive.LIFT_EEF_UP, lift_m))
            over.append((lifted, f"lift by {lift_m:.2f} m before it and lower after it"))
    # The held object collided with its own place on the way in: it hangs lower than assumed.
    held = met is not None and not met.mover.startswith(_ROBOT_LINKS) and met.other_link != "door"
    if held and FORWARD.sign(flow[step]):
        yield from over
    lowering = flow[step].primitive is Primitive.LIFT_EEF_DOWN
    if lowering and release is not None and miss is not None and cause.was_planned:
        words = (
            f"move {_text(miss.centre_forward_m, miss.centre_left_m, 0.0)} over the place before lowering all the way"
        )
        yield _corrected(flow, release, miss.centre_forward_m, miss.centre_left_m), words
    if release is not None and miss is not None and abs(miss.centre_left_m) > 0.02 and not cause.was_planned:
        side = "left" if miss.centre_left_m > 0 else "right"
        words = f"go {abs(miss.centre_left_m):.2f} m to the {side} before it, where the middle of the place is"
        yield shifted(flow, release, LEFT, miss.centre_left_m), words
    yield from _stopped_before(cause, flow, release, miss)
    yield from over
    for side_step in SIDE_STEPS_M:
        for primitive in (Primitive.MOVE_BASE_LEFT, Primitive.MOVE_BASE_RIGHT):
            words = f"step aside with {primitive.name} by {side_step:.1f} m before it"
            yield inserted(flow, step, Action(primitive, side_step)), words
    yield from open_numbers(flow, release)


def _stopped_before(cause: FailureCause, flow: ActionFlow, release: int | None, miss: Miss | None) -> Changes:
    """Yield flows whose move ends before the obstacle; the hand may cover the rest."""
    step, met = cause.step, cause.contact
    mover, other = ("the robot", "something") if met is None else (met.mover, met.other)
    moved, asked = (None, None) if cause.move is None else (cause.move.eef_moved_m, cause.move.asked_m)
    if moved is None or asked is None or moved >= asked or not is_move(flow[step]):
        return
    # A hand that meets an obstacle while lowering is where it can release.
    clearance_m = TOUCHING_M if UP.sign(flow[step]) else CLEARANCE_M
    kept = max(moved - clearance_m, 0.0)
    ahead = moved - kept if FORWARD.sign(flow[step]) else 0.0
    shorter = with_parameter(flow, step, kept) if kept >= 0.01 else without(flow, step)
    if release is not None and miss is not None:
        # The hand covers the remaining distance: the miss less the flow's later moves.
        later = numbered_moves(flow, range(step + 1, release))
        rest = miss.forward_m + ahead - sum(FORWARD.sign(flow[i]) * number for i, number in later)
        at = step + 1 - (len(flow) - len(shorter))
        yield _reaching(shorter, at, rest), f"stop {clearance_m:g} m before {other} and reach the rest with the hand"
    yield shorter, f"stop {clearance_m:g} m before {mover} meets {other}"


def _driven_elsewhere(other: str, flow: ActionFlow, step: int, release: int | None) -> Changes:
    """Yield flows with another end or start of a drive: an obstacle of the base does not concern the hand."""
    sides = (Primitive.MOVE_BASE_LEFT, Primitive.MOVE_BASE_RIGHT)
    detours = [(away, primitive) for away in DETOURS_M for primitive in sides]
    for number, (away, primitive) in enumerate((*detours, (AWAY_M, Primitive.MOVE_BASE_BACKWARD))):
        if number == len(sides):
            yield from open_numbers(flow, release)
        words = f"set out from {away:g} m along {primitive.name}, by another way around {other}"
        yield inserted(flow, step, Action(primitive, away)), words


def in_the_way(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield flows that place an item further in which kept a door from closing."""
    release = release_after(flow, cause.step)
    if release is None:
        return
    for further in (0.04, 0.08):
        yield shifted(flow, release, FORWARD, further), f"let go {further:.2f} m further in, out of the door's way"
    yield from open_numbers(flow, release)


def _navigated_again(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield a flow with a second, shorter drive, which ends nearer to the goal than the first one did."""
    error_m = cause.base_error_m
    at = last_up_to(flow, cause.step, Primitive.NAVIGATE_TO_SUPPORT)
    if error_m is not None and error_m >= OFF_M and at is not None:
        back = (Action(Primitive.MOVE_BASE_BACKWARD, AWAY_M), Action(Primitive.NAVIGATE_TO_SUPPORT))
        words = (
            f"go back a little and drive there again, since the base ended {error_m:.2f} m beside where it was to be"
        )
        yield inserted(flow, at + 1, *back), words


def _corrected(flow: ActionFlow, release: int, forward_m: float, left_m: float) -> ActionFlow:
    """Return the flow with moves sideways over the place, between two lowerings: planning omits them."""
    offsets = ((FORWARD, forward_m), (LEFT, left_m))
    moves = tuple(move(axis.hand, amount_m, 3) for axis, amount_m in offsets if abs(amount_m) >= SMALLEST_SHIFT_M)
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
    """Return the flow in which the hand covers a distance: by its own move's number, or by one more move."""
    rest_m = min(max(rest_m, -HAND_REACH_M), HAND_REACH_M)
    release = release_after(flow, step)
    if release is not None and any(flow[i].primitive in FORWARD.hand for i in carrying(flow, release)):
        return shifted(flow, release, FORWARD, rest_m)
    return flow if abs(rest_m) < NEGLIGIBLE_M else inserted(flow, step, along(FORWARD, rest_m))


def _text(forward_m: float, left_m: float, up_m: float) -> str:
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


_TAKES_HOLD = (Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP)
_CHOOSES_A_STANCE = (Primitive.APPROACH, Primitive.NAVIGATE_TO_SUPPORT)
# Primitives required before a step that is out of order.
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


def corrections(cause: FailureCause, flow: ActionFlow) -> Changes:
    """Yield the corrections of a flow for a cause, the most likely one first, the most general one last."""
    yield from (change for change in _BY_KIND[cause.kind](cause, flow) if change[0] != flow)


def _out_of_reach(cause: FailureCause, flow: ActionFlow) -> Changes:
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


def _no_way(cause: FailureCause, flow: ActionFlow) -> Changes:
    step = cause.step
    if cause.unplanned is not None and cause.unplanned.joint is not None:
        yield from as_far_as_free(flow, step, cause.unplanned.free_to_fraction)
    if flow[step].primitive in _CHOOSES_A_STANCE:
        # A stance is chosen for all later moves: if there is none, a later number may demand too much.
        yield from open_numbers(flow)
    if flow[step].primitive is Primitive.APPROACH:
        yield from driven_first(flow, step, step + 1)
    # If one lift did not help, a second one will not.
    lifted = step > 0 and flow[step - 1].primitive is Primitive.LIFT_EEF_UP
    for lift in () if lifted else LIFTS_M:
        words = f"lift the hand by {lift:.2f} m before it"
        yield inserted(flow, step, Action(Primitive.LIFT_EEF_UP, lift)), words
    for primitive, amount_m in _ROOM_M:
        words = f"make room with {primitive.name} {amount_m:.1f} m before it"
        yield inserted(flow, step, Action(primitive, amount_m)), words
    yield inserted(flow, step, Action(Primitive.RETREAT)), "retreat before it"
    yield from open_numbers(flow)


def _still_touched(cause: FailureCause, flow: ActionFlow) -> Changes:
    after = flow[cause.step + 1 :]
    if not any(action.primitive is Primitive.RETREAT for action in after):
        yield inserted(flow, cause.step + 1, Action(Primitive.RETREAT)), "take the hand away from it by RETREAT"
    release = release_after(flow, cause.step)
    if release is not None:
        yield from open_numbers(flow, release)


def _out_of_order(cause: FailureCause, flow: ActionFlow) -> Changes:
    step = cause.step
    needed = _NEEDED.get(flow[step].primitive, (Primitive.UNGRASP,))
    yield inserted(flow, step, *map(Action, needed)), f"do {', '.join(p.name for p in needed)} before it"
    yield from open_numbers(flow)


def _too_long(cause: FailureCause, flow: ActionFlow) -> Changes:
    yield from narrower(flow, cause.step)
    yield from open_numbers(flow)


_BY_KIND: dict[CauseKind, Callable[[FailureCause, ActionFlow], Changes]] = {
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
