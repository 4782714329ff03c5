"""Module 5: the action flow of each simple task.

Source: the paper's Action Flow Planning with the library of 21 primitives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from llm.answers.actions import WireStep
from llm.answers.base import MOST_ACTIONS, MOST_SUBTASKS, Answer, SubtaskAnswer
from llm.answers.describe import primitives_text, subtask_table
from llm.answers.prompting import fenced
from llm.modules.context import Asked, bare_task
from llm.offline.steps import TEMPLATES
from oag import Diagnostic, Scene, SimpleTask
from oag.task.wellformed import check as check_form


class SubtaskFlow(SubtaskAnswer):
    """The flow of one simple task."""

    flow: list[WireStep] = Field(min_length=1, max_length=MOST_ACTIONS)


class Flows(Answer):
    """The flows of all simple tasks, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskFlow] = Field(min_length=1, max_length=MOST_SUBTASKS)

    def added_to(self, subtasks: Sequence[SimpleTask]) -> tuple[SimpleTask, ...]:
        """Returns simple tasks with these flows."""
        return tuple(
            replace(subtask, flow=tuple(step.action() for step in entry.flow))
            for subtask, entry in zip(subtasks, self.sub_tasks, strict=True)
        )


def plan(asked: Asked, subtasks: Sequence[SimpleTask], scales: Mapping[str, float]) -> tuple[SimpleTask, ...]:
    """Returns the simple tasks with their action flows, or raises as `Asked.ask` does.

    Args:
        asked: Who is asked.
        subtasks: The simple tasks with their conditions.
        scales: Factors of the size adjustment.
    """
    templates = (
        f"- {kind}: {', '.join(f'{int(primitive)} {primitive.name}' for primitive in flow)}"
        for kind, flow in TEMPLATES.items()
    )
    places = {
        "subtasks": fenced("subtasks", subtask_table(subtasks)),
        "primitives": primitives_text(),
        "templates": "\n".join(templates),
        "longest": str(MOST_ACTIONS),
    }
    return asked.ask(
        5, Flows, lambda given: _wrong(given, subtasks, scales, asked.scene), places, entries=len(subtasks)
    ).added_to(subtasks)


def _wrong(
    answer: Flows, subtasks: Sequence[SimpleTask], scales: Mapping[str, float], scene: Scene
) -> Iterator[Diagnostic]:
    """Yields parameters out of range and primitives that cannot act on their objects."""
    yield from check_form(replace(bare_task(scene, answer.added_to(subtasks)), scales=dict(scales)), scene)
