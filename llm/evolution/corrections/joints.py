"""Corrections of the joint limits of ARTICULATE_OPEN and ARTICULATE_CLOSE."""

from __future__ import annotations

import math

from llm.evolution.cause import RootCause
from llm.evolution.corrections.edits import Changes, inserted, with_parameter
from oag import Action, ActionFlow, Primitive
from oag.model.primitives import ARTICULATIONS

OPEN_ENOUGH = (0.3, 0.5, 0.7, 0.85)
"""Fractions of a joint's range that an opening is raised to, the smallest change first."""

_LET_GO = (Primitive.UNGRASP, Primitive.RETREAT, Primitive.NAVIGATE_TO_TARGET)
HOLD_AGAIN = tuple(map(Action, (*_LET_GO, Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP)))
"""Lets go of a handle and takes hold of it again."""

_BEFORE = 0.03  # Of a joint's range, so much before it meets something.
_OPENED = "leave the joint limits to the geometric planner"


def joint_short(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows whose joint limits reach the goal; what was left open says how far to go."""
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


def opened_little(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows that open further a door that kept the robot out later."""
    step, reached = cause.step, 0.0 if cause.joint is None else cause.joint.fraction_reached
    for fraction in reversed(OPEN_ENOUGH):
        if fraction > reached + 0.05:
            words = f"open to {fraction:g} of the range instead of the {reached:.2f} it came to"
            yield with_parameter(flow, step, (0.0, fraction)), words
    yield with_parameter(flow, step, None), _OPENED


def joint_stalled(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows for a joint that did not follow: less far where something stands, else another grip on the way."""
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


def _less_far(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows that open a door to where it came; a little less, since it or the robot met something there."""
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
    """Yields flows that open the next joint to before what is in its way, where that is known, else less far."""
    later = next((later for later in range(step, len(flow)) if flow[later].primitive in ARTICULATIONS), None)
    if later is not None and free_to is not None and flow[later].primitive is Primitive.ARTICULATE_OPEN:
        before = math.floor(100.0 * free_to) / 100.0 - _BEFORE
        if before > 0.0:
            yield with_parameter(flow, later, (0.0, before)), f"open to {before:.2f}: it is free to {free_to:.2f}"
    yield from narrower(flow, step)


def narrower(flow: ActionFlow, step: int) -> Changes:
    """Yields flows that open the next joint less far."""
    for later in range(step, len(flow)):
        limits = flow[later].parameter
        if flow[later].primitive is Primitive.ARTICULATE_OPEN and isinstance(limits, tuple):
            for fraction in reversed(OPEN_ENOUGH):
                if fraction < limits[1] - 0.05:
                    yield with_parameter(flow, later, (limits[0], fraction)), f"open to {fraction:g} of the range only"
        if flow[later].primitive in ARTICULATIONS and isinstance(limits, tuple):
            yield with_parameter(flow, later, None), _OPENED
            return
