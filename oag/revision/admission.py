"""Whether a revised flow may be run: it must be legal, verify in its task, and not be one that failed already.

Source: the paper's library constraint on revisions, and its history, "which helps the supervisor avoid repeatedly
trying previously failed configurations".
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from oag.graph import compose
from oag.model.actions import Action, ActionFlow, flow_from_json
from oag.model.diagnostic import Diagnostic
from oag.model.errors import FlowError, NoSuchSubtask, RecordError
from oag.model.jsonfile import shown
from oag.model.scene import Scene
from oag.report import Report, Verdict
from oag.revision.evidence import is_whole
from oag.revision.history import History
from oag.revision.motion import Tolerance, same_flow
from oag.task.reading import unreadable_step
from oag.task.task import Task, chosen_scene, subtask_place

# Longer than any flow of the paper by far; what is longer is a mistake, and would keep a simulator busy.
MOST_STEPS = 40
_ELSEWHERE = "the plan has this mistake with the flow as it was, too: mend it first, no revision of this subtask can"


@dataclass(frozen=True, slots=True)
class Admission:
    """Whether a revised flow may be run; true exactly when it may.

    Attributes:
        flow: The flow, None when it could not be read.
        diagnostics: Why not, as errors; empty when it may.
        report: What `verify` says of the task with the flow in it; None when it did not come to that.
        repeats: Number of the failed attempt that it repeats, from 1; None when it repeats none.
    """

    flow: ActionFlow | None
    diagnostics: tuple[Diagnostic, ...]
    report: Report | None = None
    repeats: int | None = None

    def __bool__(self) -> bool:
        return not self.diagnostics

    def __str__(self) -> str:
        """Returns the reasons as numbered blocks, for a person or for the next round with a model."""
        if self:
            return "admissible"
        return "\n\n".join(f"{number}. {finding}" for number, finding in enumerate(self.diagnostics, start=1))


def admissible(
    task: Task,
    subtask_index: int,
    new_flow: Sequence[Action] | object,
    *,
    scene: Scene | None = None,
    history: History | None = None,
    tolerance: Tolerance | None = None,
) -> Admission:
    """Decides whether a revised flow of one subtask may be run.

    Args:
        task: The task as it is.
        subtask_index: Index of the revised subtask, from 0.
        new_flow: Actions, or the paper's JSON form of them as a model wrote it.
        scene: The scene to judge it in; by default the one that the task carries.
        history: What was tried for this subtask before.
        tolerance: What counts as the same number; by default 0.01 m, 1 degree and 0.01 of a joint's range.

    Returns:
        An admission. It is refused when the flow cannot be read, is too long, leaves the plan REFUTED, makes it rest on
        something unknown on which it did not rest before, repeats a flow that failed, or when the history allows no
        further revision. A plan that was CONDITIONAL may stay so: `admission.report` says whether it is PROVED.

    Raises:
        NoSuchSubtask: The task has no subtask of that index.
        RecordError: The history is that of another subtask.
        MissingScene: There is no scene, neither here nor with the task.
        TaskError, SceneError: An argument is no `Task`, or no `Scene`.
    """
    chosen = chosen_scene(task, scene)
    count = len(task.subtasks)
    if not is_whole(subtask_index) or not 0 <= subtask_index < count:
        expected = f"expected the index of one of its {count} subtasks, from 0, got {shown(subtask_index)}"
        raise NoSuchSubtask(f"task {task.name!r}: {expected}")
    if history is not None and history.subtask != subtask_index:
        problem = f"it is the history of T{history.subtask + 1}, and the revised flow is for T{subtask_index + 1}"
        hint = "hand over the history of the subtask that is revised"
        raise RecordError(problem, source="(history)", hint=hint)
    place = subtask_place(task, subtask_index)
    try:
        flow = _read(new_flow)
    except FlowError as problem:
        where = place if problem.index is None else f"{place}, step {problem.index + 1}"
        return Admission(None, (unreadable_step(problem, where, subtask_index, problem.index),))
    if len(flow) > MOST_STEPS:
        message = f"it has {len(flow)} steps, more than the {MOST_STEPS} that a revision may have"
        return Admission(flow, (_finding("revision/too-long", message, place, subtask_index),))
    revised = replace(task.subtasks[subtask_index], flow=flow, issues=())
    subtasks = (*task.subtasks[:subtask_index], revised, *task.subtasks[subtask_index + 1 :])
    report = compose(replace(task, subtasks=subtasks), scene=chosen).verify()
    found = [] if report else list(_verdict_findings(task, chosen, subtask_index, report))
    if history is None:
        return Admission(flow, tuple(found), report)
    within = tolerance or Tolerance()
    repeats = _repeated(flow, history, within)
    found.extend(_history_findings(history, repeats, within, place))
    return Admission(flow, tuple(found), report, repeats)


def _verdict_findings(task: Task, scene: Scene, subtask: int, report: Report) -> Iterator[Diagnostic]:
    """Yields what keeps a plan from being run with a revised flow, other than what was tried before.

    A mistake of another subtask that was there before is said to be one, since no revision of this subtask mends it.
    What the plan already rested on may stay unknown; that the new flow needs more of the unknown is a reason.
    """
    before = compose(task, scene=scene).verify()
    if report.verdict is Verdict.REFUTED:
        known = {(error.code, error.place, error.literal) for error in before.errors}
        for error in report.errors:
            elsewhere = error.subtask != subtask and (error.code, error.place, error.literal) in known
            yield replace(error, hint=_ELSEWHERE) if elsewhere else error
        return
    rested = {finding.literal for finding in before.diagnostics if finding.code == "context/open"}
    place = subtask_place(task, subtask)
    for finding in report.diagnostics:
        if finding.code == "context/open" and finding.literal not in rested:
            message = f"it rests on {finding.literal} at {finding.place}, which is unknown; the flow before did not"
            yield _finding("revision/assumes", message, place, subtask, hint=finding.hint)


def _read(new_flow: object) -> ActionFlow:
    if isinstance(new_flow, tuple | list) and all(isinstance(action, Action) for action in new_flow):
        return tuple(new_flow)
    return flow_from_json(new_flow)


def _history_findings(history: History, repeats: int | None, tolerance: Tolerance, place: str) -> Iterator[Diagnostic]:
    if history.exhausted:
        hint = "report the failure with its history; another decomposition may do"
        yield _finding("revision/exhausted", history.limit_reached, place, history.subtask, hint=hint)
    if repeats is not None:
        attempt = history.iterations[repeats - 1].attempt
        where = "" if attempt.failed_step is None else f" at step {attempt.failed_step + 1}"
        why = f": {attempt.message or attempt.failure}" if attempt.message or attempt.failure else ""
        message = f"attempt {repeats} ran the same flow and failed{where}{why}"
        hint = f"change the sequence, or a number by more than {tolerance}"
        yield _finding("revision/repeated", message, place, history.subtask, hint=hint)


def _finding(code: str, message: str, place: str, subtask: int, hint: str | None = None) -> Diagnostic:
    return Diagnostic(code, "error", message, place, subtask, hint=hint)


def _repeated(flow: ActionFlow, history: History, tolerance: Tolerance) -> int | None:
    """Returns the number of the failed attempt that a flow repeats, from 1; from another start none is repeated."""
    start = history.iterations[-1].attempt.start if history.iterations else ""
    for number, (attempt, _) in enumerate(history.iterations, start=1):
        if attempt.start == start and not attempt.succeeded and same_flow(flow, attempt.flow, tolerance):
            return number
    return None
