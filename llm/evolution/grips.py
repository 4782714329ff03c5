"""Corrections of how a thing is taken hold of: the aim, another grip, half the way."""

from __future__ import annotations

from dataclasses import replace

from llm.evolution.cause import Cause
from llm.evolution.changes import Changes, open_numbers
from llm.evolution.edits import FORWARD, LEFT, NAVIGATIONS, inserted, is_move, slide, with_parameter
from llm.evolution.joints import joint_stalled
from oag import Action, ActionFlow, Primitive
from oag.primitives import ARTICULATIONS

FINE_M = 0.002
"""The smallest offset of an aim that is worth a correction: the gripper has a few millimetres to spare."""

DEEPER_M = (0.015,)


def aimed(cause: Cause, flow: ActionFlow, measured: str = "target") -> Changes:
    """Slides the base before APPROACH by what the aim was off by; APPROACH keeps that.

    Args:
        cause: What was measured.
        flow: The flow to correct.
        measured: "target" for how far the target was from the aim, "held" for how far from its place in the hand.
    """
    start = next((i for i in range(cause.step, -1, -1) if flow[i].primitive is Primitive.APPROACH), None)
    if start is None:
        return
    offsets = ((axis, cause.number(f"{measured}_{axis.name}_m") or 0.0) for axis in (LEFT, FORWARD))
    slides = tuple(slide(axis, amount) for axis, amount in offsets if abs(amount) >= FINE_M)
    if slides:
        told = " and ".join(str(move) for move in slides)
        drive = () if any(a.primitive in NAVIGATIONS for a in flow[:start]) else (Action(Primitive.NAVIGATE_TO_TARGET),)
        yield inserted(flow, start, *drive, *slides), f"do {told} before APPROACH, which is what the aim was off by"


def grasp_missed(cause: Cause, flow: ActionFlow) -> Changes:
    """Yields flows that aim better, or take hold again."""
    yield from aimed(cause, flow)
    yield from _held_again(flow, cause.step)
    start = next((i for i in range(cause.step, -1, -1) if flow[i].primitive is Primitive.APPROACH), cause.step)
    if not any(action.primitive in NAVIGATIONS for action in flow[:start]):
        yield inserted(flow, start, Action(Primitive.NAVIGATE_TO_TARGET)), "drive to the target first"


def held_badly(cause: Cause, flow: ActionFlow) -> Changes:
    """Yields flows that take an item better which was lost when it was carried."""
    yield from aimed(cause, flow, "held")
    yield from aimed(cause, flow)
    yield from _held_again(flow, cause.step)
    start = next((i for i in range(cause.step, -1, -1) if flow[i].primitive is Primitive.APPROACH), None)
    if start is not None:
        drive = () if any(a.primitive in NAVIGATIONS for a in flow[:start]) else (Action(Primitive.NAVIGATE_TO_TARGET),)
        for deeper in DEEPER_M:
            words = f"reach {deeper * 1000:.0f} mm further before closing, so that more of the fingers holds it"
            yield inserted(flow, start, *drive, slide(FORWARD, deeper)), words
    for step in range(cause.step + 1, len(flow)):
        number = flow[step].parameter
        if is_move(flow[step]) and isinstance(number, float | int):
            yield with_parameter(flow, step, number / 2), f"move by half at {flow[step].primitive.name}"
    yield from open_numbers(flow, len(flow))


def _held_again(flow: ActionFlow, grasp: int) -> Changes:
    start = next((i for i in range(grasp, -1, -1) if flow[i].primitive is Primitive.APPROACH), grasp)
    grasps = [action for action in flow if action.primitive is Primitive.GRASP]
    if flow[grasp].primitive is Primitive.GRASP and len(grasps) == 1:
        again = (Action(Primitive.UNGRASP), Action(Primitive.RETREAT), Action(Primitive.NAVIGATE_TO_TARGET))
        yield inserted(flow, grasp + 1, *again, *flow[start : grasp + 1]), "let go, go back, and take hold again"


def grip_lost(cause: Cause, flow: ActionFlow) -> Changes:
    """Yields flows that ask less of a grip, or take a better one."""
    if flow[cause.step].primitive in ARTICULATIONS:
        yield from joint_stalled(cause, flow)
        return
    yield from aimed(cause, flow)
    grasp = next((i for i in range(cause.step, -1, -1) if flow[i].primitive is Primitive.GRASP), None)
    if grasp is not None:
        yield from aimed(replace(cause, step=grasp), flow, "held")
        yield from _held_again(flow, grasp)
    for step in range(cause.step, -1, -1):
        number = flow[step].parameter
        if is_move(flow[step]) and isinstance(number, float | int):
            yield with_parameter(flow, step, number / 2), f"move by half at {flow[step].primitive.name}"
    yield from open_numbers(flow, len(flow))
