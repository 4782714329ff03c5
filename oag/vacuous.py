"""Findings about subtasks as a whole: one without a flow, and one whose goal held before it began."""

from __future__ import annotations

from collections.abc import Iterator

import bddl
from oag.codes import eai_label
from oag.diagnostic import Diagnostic
from oag.places import subtask_place
from oag.progress import Trace
from oag.task import Task


def no_flow_finding(task: Task, trace: Trace) -> Iterator[Diagnostic]:
    """Yields one warning when progression stopped at a subtask without a flow."""
    index = trace.undecided_from
    if index is None:
        return
    left = len(task.subtasks) - index - 1
    after = f", nor of the {left} after it" if left else ""
    yield Diagnostic(
        "flow/no-flow",
        "warning",
        f"it has no action flow, so neither its goal{after} nor the task goal is decided",
        subtask_place(task, index),
        index,
        hint="give it a flow, such as [17, 1, 2, 3]",
        eai_label=eai_label("flow/no-flow"),
    )


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
