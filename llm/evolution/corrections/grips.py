"""Corrections of how a thing is taken hold of: the aim, another grip, half the way."""

from __future__ import annotations

import math
from collections.abc import Mapping

from llm.evolution.cause import RootCause
from llm.evolution.corrections.edits import (
    AWAY_M,
    FORWARD,
    LEFT,
    NAVIGATIONS,
    Axis,
    Changes,
    inserted,
    is_move,
    open_numbers,
    slide,
    with_parameter,
)
from llm.evolution.corrections.joints import in_steps, joint_stalled
from oag import Action, ActionFlow, Primitive
from oag.model.primitives import ARTICULATIONS

FINE_M = 0.002
"""The smallest offset of an aim that is worth a correction: the gripper has a few millimetres to spare."""

DEEPER_M = (0.015,)
"""How much further a hand reaches that lost an item, so that more of the fingers holds it."""

PALM = "panda_hand"
SPARE_M = (0.006, 0.012)
"""How much less far a hand reaches than where its palm met something, besides the way that was left."""


def aimed(off_m: tuple[float, float], flow: ActionFlow, step: int) -> Changes:
    """Slides the base before APPROACH by what the aim was off by; APPROACH keeps that.

    Args:
        off_m: How far the target was from the aim, or from its place in the hand: forward and to the left.
        flow: The flow to correct.
        step: A step at or after the APPROACH.
    """
    forward_m, left_m = off_m
    yield from slid(flow, step, {LEFT: left_m, FORWARD: forward_m}, "which is what the aim was off by")


def slid(flow: ActionFlow, step: int, by_m: Mapping[Axis, float], why: str) -> Changes:
    """Slides the base before the APPROACH that a step follows; a slide that is there already becomes longer or shorter.

    Args:
        flow: The flow to correct.
        step: A step at or after the APPROACH.
        by_m: How far along which axis.
        why: The reason, as half a sentence.
    """
    start = next((i for i in range(step, -1, -1) if flow[i].primitive is Primitive.APPROACH), None)
    if start is None or all(abs(amount) < FINE_M for amount in by_m.values()):
        return
    first = start
    while first > 0 and _slide_of(flow[first - 1]) is not None:
        first -= 1
    totals = dict.fromkeys((LEFT, FORWARD), 0.0) | {axis: a for axis, a in by_m.items() if abs(a) >= FINE_M}
    for action in flow[first:start]:
        axis, amount = _slide_of(action) or (FORWARD, 0.0)
        totals[axis] += amount
    slides = tuple(slide(axis, amount) for axis, amount in totals.items() if abs(amount) >= FINE_M)
    told = " and ".join(str(move) for move in slides) or "no slide"
    drive = () if any(a.primitive in NAVIGATIONS for a in flow[:first]) else (Action(Primitive.NAVIGATE_TO_TARGET),)
    yield (*flow[:first], *drive, *slides, *flow[start:]), f"do {told} before APPROACH, {why}"


def _slide_of(action: Action) -> tuple[Axis, float] | None:
    for axis in (LEFT, FORWARD):
        if axis.base is not None and action.primitive in axis.base and isinstance(action.parameter, float | int):
            return axis, float(action.parameter) * (1.0 if action.primitive is axis.base[0] else -1.0)
    return None


def grasp_missed(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows that aim better, or take hold again."""
    yield from aimed(cause.off_the_aim_m, flow, cause.step)
    yield from _less_deep(cause, flow)
    yield from _driven_again(cause, flow)
    yield from _held_again(flow, cause.step)
    start = next((i for i in range(cause.step, -1, -1) if flow[i].primitive is Primitive.APPROACH), cause.step)
    if not any(action.primitive in NAVIGATIONS for action in flow[:start]):
        yield inserted(flow, start, Action(Primitive.NAVIGATE_TO_TARGET)), "drive to the target first"


def held_badly(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows that take an item better which was lost when it was carried."""
    yield from aimed(cause.held_off_m, flow, cause.step)
    yield from aimed(cause.off_the_aim_m, flow, cause.step)
    yield from _held_again(flow, cause.step)
    for deeper in DEEPER_M:
        why = f"to reach {deeper * 1000:.0f} mm further, so that more of the fingers holds it"
        yield from slid(flow, cause.step, {FORWARD: deeper}, why)
    for step in range(cause.step + 1, len(flow)):
        number = flow[step].parameter
        if is_move(flow[step]) and isinstance(number, float | int):
            yield with_parameter(flow, step, number / 2), f"move by half at {flow[step].primitive.name}"
    yield from open_numbers(flow, len(flow))


def _less_deep(cause: RootCause, flow: ActionFlow) -> Changes:
    """Keeps the palm off a thing that reaches further into the hand than it was thought to."""
    met = cause.contact
    if flow[cause.step].primitive is not Primitive.CONVERGE or met is None or met.mover != PALM:
        return
    for spare in SPARE_M:
        less = math.ceil(((cause.residual_m or 0.0) + spare) * 1000.0) / 1000.0
        why = f"to reach {less * 1000:.0f} mm less far, since the palm met {met.other}"
        yield from slid(flow, cause.step, {FORWARD: -less}, why)


def _driven_again(cause: RootCause, flow: ActionFlow) -> Changes:
    """Where nothing is between the fingers, a drive may have moved the target: planned anew, the next one is short."""
    drives = [i for i in range(cause.step) if flow[i].primitive is Primitive.NAVIGATE_TO_TARGET]
    if len(drives) == 1 and flow[cause.step].primitive is Primitive.GRASP and cause.fingers_touching == 0:
        back = (Action(Primitive.MOVE_BASE_BACKWARD, AWAY_M), Action(Primitive.NAVIGATE_TO_TARGET))
        words = "go back a little and drive there again, since it is not where the first drive was planned for"
        yield inserted(flow, drives[0] + 1, *back), words


def _held_again(flow: ActionFlow, grasp: int) -> Changes:
    start = next((i for i in range(grasp, -1, -1) if flow[i].primitive is Primitive.APPROACH), grasp)
    grasps = [action for action in flow if action.primitive is Primitive.GRASP]
    if flow[grasp].primitive is Primitive.GRASP and len(grasps) == 1:
        again = (Action(Primitive.UNGRASP), Action(Primitive.RETREAT), Action(Primitive.NAVIGATE_TO_TARGET))
        yield inserted(flow, grasp + 1, *again, *flow[start : grasp + 1]), "let go, go back, and take hold again"


def grip_lost(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows that ask less of a grip, or take a better one."""
    if flow[cause.step].primitive in ARTICULATIONS:
        yield from in_steps(cause, flow)
        yield from joint_stalled(cause, flow)
        return
    yield from aimed(cause.off_the_aim_m, flow, cause.step)
    grasp = next((i for i in range(cause.step, -1, -1) if flow[i].primitive is Primitive.GRASP), None)
    if grasp is not None:
        yield from aimed(cause.held_off_m, flow, grasp)
        yield from _held_again(flow, grasp)
    for step in range(cause.step, -1, -1):
        number = flow[step].parameter
        if is_move(flow[step]) and isinstance(number, float | int):
            yield with_parameter(flow, step, number / 2), f"move by half at {flow[step].primitive.name}"
    yield from open_numbers(flow, len(flow))
