"""What corrections are made of, and the most general one of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from llm.evolution.edits import carrying, is_move
from oag import Action, ActionFlow, Primitive

Changes = Iterator[tuple[ActionFlow, str]]
"""Changed flows, each with what was done in words that begin with a verb."""


def release_after(flow: ActionFlow, step: int) -> int | None:
    """Returns the index of the first release from a step on, or None."""
    return next((i for i in range(step, len(flow)) if flow[i].primitive is Primitive.UNGRASP), None)


def open_numbers(flow: ActionFlow, end: int) -> Changes:
    """Yields the most general correction: the lengths of moves before a step are left to the geometric planner."""
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
