"""Locality: steps that change objects which their subtask does not speak of, and cargo that moves along.

Source: docs/codes.md, Locality; the paper asks a subtask to preserve the irrelevant parts of the scene.
"""

from __future__ import annotations

from collections.abc import Iterator

from oag.codes import eai_label
from oag.diagnostic import Diagnostic
from oag.facts import fact_text, held_by
from oag.places import step_place
from oag.primitives import Primitive
from oag.progress import Trace
from oag.task import Task

_UNGRASP = Primitive.UNGRASP


def locality_findings(task: Task, trace: Trace) -> Iterator[Diagnostic]:
    """Yields a warning for what is let go outside its subtask's scope, and a note for cargo that is grasped along."""
    for step in trace.steps:
        if step.primitive is not _UNGRASP:
            continue
        subtask, held = task.subtasks[step.subtask], held_by(step.hand)
        if held not in (None, subtask.target):
            yield Diagnostic(
                "locality/outside-scope",
                "warning",
                f"lets go of {held}, while the subtask is about {subtask.target}",
                step_place(task, step.subtask, step.position),
                step.subtask,
                step.position,
                eai_label=eai_label("locality/outside-scope"),
            )
    for note in trace.cargo:
        step = trace.steps[note.step]
        carried = ", ".join(fact_text(fact, True) for fact in note.facts)
        yield Diagnostic(
            "locality/cargo",
            "note",
            f"what is on or in {task.subtasks[step.subtask].target} moves along: {carried}",
            step_place(task, step.subtask, step.position),
            step.subtask,
            step.position,
        )
