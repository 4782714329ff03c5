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
    driven_first,
    halved,
    inserted,
    last_up_to,
    move,
    open_numbers,
)
from llm.evolution.corrections.joints import joint_stalled
from oag import Action, ActionFlow, Primitive
from oag.model.primitives import ARTICULATIONS

FINE_M = 0.002
"""The smallest offset of an aim that is worth a correction: the gripper has a few millimetres to spare."""

DEEPER_M = 0.015
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
    start = last_up_to(flow, step, Primitive.APPROACH)
    if start is None or all(abs(amount) < FINE_M for amount in by_m.values()):
        return
    totals = dict.fromkeys((LEFT, FORWARD), 0.0) | {axis: a for axis, a in by_m.items() if abs(a) >= FINE_M}
    first = start
    while first > 0 and (slide := _slide_of(flow[first - 1])) is not None:
        totals[slide[0]] += slide[1]
        first -= 1
    slides = tuple(move(axis.base, amount, 3) for axis, amount in totals.items() if abs(amount) >= FINE_M)
    told = " and ".join(map(str, slides)) or "no slide"
    drive = () if any(a.primitive in NAVIGATIONS for a in flow[:first]) else (Action(Primitive.NAVIGATE_TO_TARGET),)
    yield (*flow[:first], *drive, *slides, *flow[start:]), f"do {told} before APPROACH, {why}"


def _slide_of(action: Action) -> tuple[Axis, float] | None:
    for axis in (LEFT, FORWARD):
        if action.primitive in axis.base and isinstance(action.parameter, float | int):
            return axis, action.parameter * axis.sign(action)
    return None


def grasp_missed(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows that aim better, or take hold again."""
    step = cause.step
    yield from aimed(cause.off_the_aim_m, flow, step)
    met = cause.contact
    if flow[step].primitive is Primitive.CONVERGE and met is not None and met.mover == PALM:
        # The thing reaches further into the hand than it was thought to.
        for spare in SPARE_M:
            less = math.ceil(((cause.residual_m or 0.0) + spare) * 1000.0) / 1000.0
            why = f"to reach {less * 1000:.0f} mm less far, since the palm met {met.other}"
            yield from slid(flow, step, {FORWARD: -less}, why)
    drives = [i for i in range(step) if flow[i].primitive is Primitive.NAVIGATE_TO_TARGET]
    if len(drives) == 1 and flow[step].primitive is Primitive.GRASP and cause.fingers_touching == 0:
        # The drive may have moved the target: planned anew, the next one is short.
        back = (Action(Primitive.MOVE_BASE_BACKWARD, AWAY_M), Action(Primitive.NAVIGATE_TO_TARGET))
        words = "go back a little and drive there again, since it is not where the first drive was planned for"
        yield inserted(flow, drives[0] + 1, *back), words
    yield from _held_again(flow, step)
    start = last_up_to(flow, step, Primitive.APPROACH)
    start = step if start is None else start
    yield from driven_first(flow, start, start)


def held_badly(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows that take an item better which was lost when it was carried."""
    yield from aimed(cause.held_off_m, flow, cause.step)
    yield from aimed(cause.off_the_aim_m, flow, cause.step)
    yield from _held_again(flow, cause.step)
    why = f"to reach {DEEPER_M * 1000:.0f} mm further, so that more of the fingers holds it"
    yield from slid(flow, cause.step, {FORWARD: DEEPER_M}, why)
    yield from halved(flow, range(cause.step + 1, len(flow)))
    yield from open_numbers(flow)


def _held_again(flow: ActionFlow, grasp: int) -> Changes:
    start = last_up_to(flow, grasp, Primitive.APPROACH)
    grasps = [action for action in flow if action.primitive is Primitive.GRASP]
    if flow[grasp].primitive is Primitive.GRASP and len(grasps) == 1:
        again = (Action(Primitive.UNGRASP), Action(Primitive.RETREAT), Action(Primitive.NAVIGATE_TO_TARGET))
        taken = flow[grasp if start is None else start : grasp + 1]
        yield inserted(flow, grasp + 1, *again, *taken), "let go, go back, and take hold again"


def grip_lost(cause: RootCause, flow: ActionFlow) -> Changes:
    """Yields flows that ask less of a grip, or take a better one."""
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
