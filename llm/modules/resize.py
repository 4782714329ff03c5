"""Module 4: the factors by which targets are scaled so that the gripper can take them.

Source: the paper's Object Size Adjustment: aim about 0.05 m, type A always 1.0; the limit is the gripper's, and so are
the widths that are taken. Of several factors for one object the first one counts. Where sizes are kept nobody is asked.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

from pydantic import Field

from llm.answers.base import MOST_SUBTASKS, Answer, ObjectId, SubtaskAnswer
from llm.answers.conversation import finding
from llm.answers.describe import subtask_table
from llm.answers.prompting import fenced
from llm.modules.context import Asked
from oag import Diagnostic, Scene, SceneObject, SimpleTask
from oag.task.sizes import LEAST_SCALE, Gripper, scale_factor, too_small

_ROUNDING_M = 0.0005  # Half a hundredth of the factor, of the widest thing that is scaled.


class SubtaskSize(SubtaskAnswer):
    """The factor of one simple task's target."""

    target: ObjectId = Field(description="id of its target")
    scale: float = Field(gt=0.0, le=100.0, description="factor; 1.0 leaves the object as it is")


class Sizes(Answer):
    """The factors of all simple tasks' targets, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskSize] = Field(min_length=1, max_length=MOST_SUBTASKS)


def resize(asked: Asked, subtasks: Sequence[SimpleTask]) -> dict[str, float]:
    """Returns the factor of each target of the simple tasks, or raises as `Asked.ask` does."""
    if asked.sizing.keep:
        return {subtask.target: 1.0 for subtask in subtasks}
    gripper = Gripper.of(asked.scene.robot)
    places = {
        "subtasks": fenced("subtasks", subtask_table(subtasks, conditions=False)),
        "limit": f"{gripper.widest_m:g}",
        "aim": f"{gripper.aim_m:.2f}",
        "narrow": f"{gripper.least_m:g}",
        "wide": f"{gripper.most_m:g}",
        "least": f"{LEAST_SCALE:g}",
    }
    answer = asked.ask(4, Sizes, lambda given: _wrong(given, subtasks, asked.scene), places, entries=len(subtasks))
    factors: dict[str, float] = {}
    for entry in answer.sub_tasks:
        factors.setdefault(entry.target, entry.scale)
    return factors


def _wrong(answer: Sizes, subtasks: Sequence[SimpleTask], scene: Scene) -> Iterator[Diagnostic]:
    """Yields objects that are not the subtask's target, and factors that break the rule."""
    gripper = Gripper.of(scene.robot)
    for index, (entry, subtask) in enumerate(zip(answer.sub_tasks, subtasks, strict=True)):
        place = f"T{index + 1} {subtask.name}, scale"
        if entry.target != subtask.target:
            message = f"its target is {subtask.target}, not {entry.target[:80]}"
            yield finding("answer/target", message, place, subtask=index)
            continue
        problem = _problem(entry.scale, scene[subtask.target], gripper)
        if problem is not None:
            hint = f"write {scale_factor(scene[subtask.target], gripper)}"
            yield finding("answer/scale", problem, place, subtask=index, hint=hint)


def _problem(factor: float, thing: SceneObject, gripper: Gripper) -> str | None:
    d_min_m = min(thing.extent_m[:2])
    if scale_factor(thing, gripper) == 1.0:
        if factor == 1.0:
            return None
        why = "it is of type A" if thing.role == "A" else f"it is {d_min_m:.3f} m wide and is taken as it is"
        return f"{thing.id} is scaled by {factor:g}, and it is not to be scaled: {why}"
    unfit = too_small(factor)
    if unfit is not None:
        return f"{thing.id} {unfit}"
    low, high = gripper.least_m, gripper.most_m
    if low - _ROUNDING_M <= factor * d_min_m <= high + _ROUNDING_M:
        return None
    scaled = f"scaled by {factor:g} it is {factor * d_min_m:.3f} m"
    return f"{thing.id} is {d_min_m:.3f} m wide; {scaled}, not from {low:g} to {high:g} m"
