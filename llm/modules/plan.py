"""Module 5: the action flow of each simple task.

Source: the paper's Action Flow Planning with the library of 21 primitives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from llm.answers.base import MOST_ACTIONS
from llm.answers.flows import Flows
from llm.describe import primitives_text, subtask_table
from llm.flows import TEMPLATES
from llm.modules.context import Context, bare_task, numbering
from llm.prompting import fenced
from oag import Diagnostic, Scene, SimpleTask
from oag.task.wellformed import check as check_form


def plan(context: Context, subtasks: Sequence[SimpleTask], scales: Mapping[str, float]) -> tuple[SimpleTask, ...]:
    """Returns the simple tasks with their action flows.

    Args:
        context: Who is asked.
        subtasks: The simple tasks with their conditions.
        scales: Factors of the size adjustment.

    Raises:
        AnswersRefused: No answer held.
        ModelError: There is no reply.
    """
    places = {
        "subtasks": fenced("subtasks", subtask_table(subtasks)),
        "primitives": primitives_text(),
        "templates": _templates(),
        "longest": str(MOST_ACTIONS),
    }
    answer = context.ask(5, Flows, lambda given: tuple(_wrong(given, subtasks, scales, context.scene)), places)
    return _with_flows(answer, subtasks)


def _templates() -> str:
    """Returns the flows that simple tasks usually have."""
    return "\n".join(
        f"- {kind}: {' '.join(f'{int(primitive)} {primitive.name},' for primitive in flow).rstrip(',')}"
        for kind, flow in TEMPLATES.items()
    )


def _with_flows(answer: Flows, subtasks: Sequence[SimpleTask]) -> tuple[SimpleTask, ...]:
    return tuple(
        replace(subtask, flow=tuple(step.action() for step in entry.flow))
        for subtask, entry in zip(subtasks, answer.sub_tasks, strict=True)
    )


def _wrong(
    answer: Flows, subtasks: Sequence[SimpleTask], scales: Mapping[str, float], scene: Scene
) -> Iterator[Diagnostic]:
    """Yields wrong numbers, then parameters out of range and primitives that cannot act on their objects."""
    misnumbered = numbering(answer.sub_tasks, len(subtasks))
    yield from misnumbered
    if misnumbered:
        return
    task = replace(bare_task(scene, _with_flows(answer, subtasks)), scales=dict(scales))
    yield from check_form(task, scene)
