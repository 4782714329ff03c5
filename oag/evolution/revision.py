"""Whether a revised flow may be run: it must be legal, verify in its task, and not be one that failed already.

Source: the paper's library constraint on revisions, and its history, "which helps the supervisor avoid repeatedly
trying previously failed configurations".
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from oag.actions import Action, ActionFlow, flow_from_json
from oag.codes import eai_label
from oag.diagnostic import Diagnostic
from oag.errors import FlowError, NoSuchSubtask
from oag.evolution.history import History
from oag.graph import compose
from oag.places import subtask_place
from oag.primitives import Parameter, ParameterKind, Primitive, parameter_kind
from oag.report import Report, Verdict
from oag.scene import Scene
from oag.task import Task

# Longer than any flow of the paper by far; what is longer is a mistake, and would keep a simulator busy.
MOST_STEPS = 40


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far two numbers may lie apart and still be the same number to the robot.

    Attributes:
        distance_m: For distances.
        angle_deg: For turns.
        joint: For joint limits: fractions of the range, or radians or metres of the joint.
    """

    distance_m: float = 0.01
    angle_deg: float = 1.0
    joint: float = 0.01

    def of(self, primitive: Primitive) -> float:
        """Returns the tolerance for the numbers of a primitive."""
        kinds = {ParameterKind.ANGLE_DEG: self.angle_deg, ParameterKind.JOINT_LIMITS: self.joint}
        return kinds.get(parameter_kind(primitive), self.distance_m)

    def __str__(self) -> str:
        degrees = "degree" if self.angle_deg == 1.0 else "degrees"
        return f"{self.distance_m:g} m, {self.angle_deg:g} {degrees} or {self.joint:g} of a joint's range"


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
        An admission. It is refused when the flow cannot be read, is too long, makes the plan REFUTED, repeats a flow
        that failed, or when the history allows no further revision.

    Raises:
        NoSuchSubtask: The task has no subtask of that index.
        MissingScene: There is no scene, neither here nor with the task.
    """
    if not 0 <= subtask_index < len(task.subtasks):
        raise NoSuchSubtask(f"task {task.name!r} has no subtask {subtask_index}; it has {len(task.subtasks)}")
    place = subtask_place(task, subtask_index)
    flow, problem = _read(new_flow, subtask_index, place)
    if flow is None or problem is not None:
        return Admission(None, () if problem is None else (problem,))
    if len(flow) > MOST_STEPS:
        message = f"it has {len(flow)} steps, more than the {MOST_STEPS} that a revision may have"
        return Admission(flow, (_finding("revision/too-long", message, place, subtask_index),))
    revised = replace(task.subtasks[subtask_index], flow=flow, issues=())
    subtasks = (*task.subtasks[:subtask_index], revised, *task.subtasks[subtask_index + 1 :])
    report = compose(replace(task, subtasks=subtasks), scene=scene).verify()
    found = list(report.errors) if report.verdict is Verdict.REFUTED else []
    repeats = None
    if history is not None:
        repeats = _repeated(flow, history, tolerance or Tolerance())
        found.extend(_history_findings(history, repeats, tolerance or Tolerance(), place, subtask_index))
    return Admission(flow, tuple(found), report, repeats)


def same_flow(one: ActionFlow, other: ActionFlow, tolerance: Tolerance | None = None) -> bool:
    """Decides whether two flows ask for the same motion, up to a tolerance on their numbers.

    Several distances or turns of one primitive in a row count as their sum. An open number equals an open one only.
    """
    within = tolerance or Tolerance()
    first, second = _summed(one), _summed(other)
    if [action.primitive for action in first] != [action.primitive for action in second]:
        return False
    return all(
        _same_number(a.parameter, b.parameter, within.of(a.primitive)) for a, b in zip(first, second, strict=True)
    )


def _read(new_flow: object, subtask: int, place: str) -> tuple[ActionFlow | None, Diagnostic | None]:
    """Returns the flow, or what is wrong with its form."""
    if isinstance(new_flow, tuple | list) and all(isinstance(action, Action) for action in new_flow):
        return tuple(new_flow), None
    try:
        return flow_from_json(new_flow), None
    except FlowError as problem:
        return None, Diagnostic(
            problem.code,
            "error",
            problem.problem,
            place if problem.index is None else f"{place}, step {problem.index + 1}",
            subtask,
            problem.index,
            hint=f"did you mean {' or '.join(problem.near)}?" if problem.near else None,
            eai_label=eai_label(problem.code),
        )


def _history_findings(
    history: History, repeats: int | None, tolerance: Tolerance, place: str, subtask: int
) -> Iterator[Diagnostic]:
    if history.exhausted:
        message = f"{history.limit} revisions were tried, and that is the limit"
        hint = "report the failure with its history; another decomposition may do"
        yield _finding("revision/exhausted", message, place, subtask, hint=hint)
    if repeats is not None:
        attempt = history.iterations[repeats - 1].attempt
        where = "" if attempt.failed_step is None else f" at step {attempt.failed_step + 1}"
        why = f": {attempt.message or attempt.failure}" if attempt.message or attempt.failure else ""
        yield _finding(
            "revision/repeated",
            f"attempt {repeats} ran the same flow and failed{where}{why}",
            place,
            subtask,
            hint=f"change the sequence, or a number by more than {tolerance}",
        )


def _finding(code: str, message: str, place: str, subtask: int, hint: str | None = None) -> Diagnostic:
    return Diagnostic(code, "error", message, place, subtask, hint=hint, eai_label=eai_label(code))


def _repeated(flow: ActionFlow, history: History, tolerance: Tolerance) -> int | None:
    """Returns the number of the failed attempt that a flow repeats, from 1."""
    for number, (attempt, _) in enumerate(history.iterations, start=1):
        if not attempt.succeeded and same_flow(flow, attempt.flow, tolerance):
            return number
    return None


def _summed(flow: ActionFlow) -> list[Action]:
    """Returns a flow in which motions of one primitive that follow each other are one."""
    summed: list[Action] = []
    for primitive, group in groupby(flow, key=lambda action: action.primitive):
        actions = list(group)
        numbers = [action.parameter for action in actions if isinstance(action.parameter, int | float)]
        if parameter_kind(primitive) is ParameterKind.JOINT_LIMITS or len(numbers) < len(actions):
            summed.extend(actions)
        else:
            summed.append(Action(primitive, sum(numbers)))
    return summed


def _same_number(one: Parameter, other: Parameter, tolerance: float) -> bool:
    if isinstance(one, tuple) and isinstance(other, tuple):
        return all(abs(a - b) <= tolerance for a, b in zip(one, other, strict=True))
    if isinstance(one, int | float) and isinstance(other, int | float):
        return abs(one - other) <= tolerance
    return one is None and other is None
