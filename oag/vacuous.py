"""Findings about subtasks whose goal held before they began."""

from __future__ import annotations

from collections.abc import Iterator

import bddl
from oag.codes import eai_label
from oag.diagnostic import Diagnostic
from oag.places import subtask_place
from oag.progress import Trace
from oag.task import Task


def vacuous_findings(task: Task, trace: Trace) -> Iterator[Diagnostic]:
    """Yields one warning for each subtask whose goal held already when it started."""
    for index in trace.vacuous:
        yield Diagnostic(
            "task/vacuous",
            "warning",
            f"its goal {bddl.format(task.subtasks[index].goal)} holds already when it starts",
            subtask_place(task, index),
            index,
            hint="drop the subtask, or say what it has to change",
            eai_label=eai_label("task/vacuous"),
        )
