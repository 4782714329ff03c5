"""All that is to be said of a plan that was followed, in the order in which reports list it."""

from __future__ import annotations

from collections.abc import Iterator

import bddl
from oag.explain.explain import Explainer
from oag.explain.locality import locality_findings
from oag.flows.noflow import NoFlow, no_flow_finding, searched_notes
from oag.model.diagnostic import Diagnostic, eai_label
from oag.model.scene import Scene
from oag.progression.progress import Trace
from oag.task.sizes import resizings
from oag.task.task import Task, label, subtask_place


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


def all_findings(
    task: Task, scene: Scene, trace: Trace, proof: NoFlow | None, searched: tuple[int, ...]
) -> tuple[Diagnostic, ...]:
    """Returns the diagnostics of a well-formed plan: errors first, then warnings, then notes.

    Args:
        task: The plan.
        scene: Its scene.
        trace: The plan as it was followed.
        proof: What shows that a subtask has no flow, if something does.
        searched: Indices of the subtasks whose flow was searched.
    """
    explainer = Explainer(task, scene, trace)
    found = [*explainer.failures(), *explainer.assumptions(), *no_flow_finding(task, trace, proof)]
    if trace.unsettled is not None:
        found.append(_unsettled(trace.unsettled))
    if not task.subtasks:
        found.append(_empty())
    runs = not trace.failures and proof is None
    if runs:
        found.extend(vacuous_findings(task, trace))
    found.extend(locality_findings(task, scene, trace, runs=runs))
    if runs:
        found.extend(explainer.goal_gaps())
    found.extend(searched_notes(task, searched))
    found.extend(_unfilled(task))
    found.extend(_resized(task, scene))
    return tuple(found)


def _empty() -> Diagnostic:
    return Diagnostic(
        "task/empty",
        "warning",
        "there are no subtasks: the verdict is about doing nothing",
        "task",
        hint='list the subtasks under "sub_tasks"',
        eai_label=eai_label("task/empty"),
    )


def _unsettled(reason: str) -> Diagnostic:
    return Diagnostic(
        "context/undecided",
        "warning",
        f"this was not decided exactly ({reason}), so the plan may be better or worse than is said here",
        "task",
        hint="state more of the scene's facts, or say the conditions in fewer alternatives",
        eai_label=eai_label("context/undecided"),
    )


def _resized(task: Task, scene: Scene) -> Iterator[Diagnostic]:
    """Yields a note for each object that is run at another size than it has in the scene."""
    for change in resizings(task.scales, scene):
        yield Diagnostic("task/scaled", "note", str(change), "scales")


def _unfilled(task: Task) -> Iterator[Diagnostic]:
    steps = [
        f"{label(index, position)} {action.primitive.name}"
        for index, subtask in enumerate(task.subtasks)
        for position, action in enumerate(subtask.flow or ())
        if action.unfilled
    ]
    if steps:
        yield Diagnostic(
            "flow/unfilled",
            "note",
            f"the executor's geometric planner fills in the numbers of {', '.join(steps)}",
            "task",
        )
