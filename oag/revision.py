"""Self-evolution of a subtask: records of attempts and revisions, their history, and the admission of a revised flow.

Records are plain data with a JSON form. The loop writes them; supervisors, reports and training sets read them. Their
fields are what `History.from_json` reads by. A history can only be added to.

A revised flow may run if it is legal, verifies in its task, and does not repeat a failed one. Two flows are the same if
they ask for the same motion once idle and cancelled motions are left out.

Source: the paper's Self-Evolution: critiques m_(tau, j), the revised flow with its explanation r_(tau+1), the history
H_(<tau) = {(flow_i, critiques_i, reason_(i+1))}, its library constraint on revisions, and the history's use, "which
helps the supervisor avoid repeatedly trying previously failed configurations".
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal, NamedTuple, Self

from bddl.terminal import pluralize
from oag.graph import compose
from oag.measurements import MeasuredEvidence, is_whole
from oag.model.actions import Action, ActionFlow, flow_from_json
from oag.model.codec import ReadBy, Record, Source, expected, fields_json, index, load, short_repr, shown
from oag.model.diagnostics import Diagnostic, FlowError, HistoryFull, NoSuchSubtask, RecordError
from oag.model.domain import BUILT_IN, Domain
from oag.model.reading import unreadable_step
from oag.model.scene import Scene
from oag.model.symbols import OPPOSITE, OPPOSITES, ParameterKind, Primitive, parameter_kind
from oag.primitives.table import NAVIGATION
from oag.task_definition import Task, chosen_scene, subtask_place
from oag.verify.verify import Report, Verdict

Outcome = Literal["succeeded", "failed"]
Change = Literal["sequence", "parameters"]
Origin = Literal["measurements", "model", "both"]
BLAMED_LATER = "blamed-later"
"""The failure of an attempt whose subtask was reached, but because of which a later one failed."""


def _flag(value: object) -> bool | None:
    if value is None or isinstance(value, bool):
        return value
    raise ValueError(expected("true, false or null", value))


def _primitive(value: object, domain: Domain) -> Primitive:
    found = None
    if isinstance(value, str) and value.strip():
        found = Primitive.__members__.get(value) or domain.primitive(value)
    if found is None:
        raise ValueError(f"there is no primitive {shown(value)}")
    return found


_Flag = Annotated[bool | None, ReadBy(_flag)]
_Flow = Annotated[ActionFlow, ReadBy(flow_from_json, in_domain=True)]
_Index = Annotated[int, ReadBy(index)]


@short_repr
@dataclass(frozen=True, slots=True)
class Critique(Record):
    """Judgement of an inspector on one executed step.

    Attributes:
        step: Index in the flow, from 0.
        motion_verified: Whether the robot moved as intended; None when not judged.
        state_reached: Whether the intended change occurred; None when not judged.
        state_contrast: What differs between the step's beginning and its end, in words.
        anomaly: What happened that should not have, such as a collision; None when nothing did.
        text: The diagnosis in a sentence or two.
        origin: Whether measurements, a model that looked at frames, or both were asked.

    Source: the paper's three aspects of a critique: motion verification, state contrast, anomaly detection.
    """

    step: _Index
    primitive: Annotated[Primitive, ReadBy(_primitive, in_domain=True)]
    motion_verified: _Flag = None
    state_reached: _Flag = None
    state_contrast: str = ""
    anomaly: str | None = None
    text: str = ""
    evidence: MeasuredEvidence = field(default_factory=MeasuredEvidence)
    origin: Origin = "measurements"

    @property
    def finds_fault(self) -> bool:
        """True when anything about the step was wrong."""
        return self.motion_verified is False or self.state_reached is False or self.anomaly is not None


@short_repr
@dataclass(frozen=True, slots=True)
class Hindsight(Record):
    """Why an attempt that reached its goal counts as failed after all: a later subtask failed because of it.

    Attributes:
        subtask: Index of the later subtask, from 0.
        failure: Kind of its failure, such as "slipped".
        message: That failure in a sentence.
    """

    subtask: _Index
    failure: str
    message: str = ""


@short_repr
@dataclass(frozen=True, slots=True)
class Attempt(Record):
    """One execution of a subtask's flow from its saved initial state.

    Attributes:
        flow: The flow as it was asked for, open numbers left open.
        outcome: Whether the subtask's goal was reached.
        failed_step: Index of the earliest step that failed; None when it succeeded, or when every step ran but the goal
            was not reached.
        failure: Kind of failure, such as "unexpected-contact"; empty on success.
        critiques: One for each step that was judged, in order.
        filled: The flow with the numbers that were run; None when they were all given.
        seed: Seed of the episode; None when it has none.
        state_hash: Hash of the states it went through; empty when there is none.
        start: Hash of the states that led to its initial state; it differs between attempts when an earlier subtask was
            revised between them.
        hindsight: The later failure that it was blamed for; the outcome is then "failed", the failure "blamed-later".
            None when it was not blamed.
    """

    flow: _Flow
    outcome: Outcome
    failed_step: _Index | None = None
    failure: str = ""
    message: str = ""
    critiques: tuple[Critique, ...] = ()
    filled: _Flow | None = None
    seed: _Index | None = None
    state_hash: str = ""
    start: str = ""
    hindsight: Hindsight | None = None

    @property
    def succeeded(self) -> bool:
        """True when the subtask's goal was reached."""
        return self.outcome == "succeeded"


@short_repr
@dataclass(frozen=True, slots=True)
class Revision:
    """A changed flow, and why it was changed.

    Attributes:
        change: "sequence" when primitives were added, taken out or exchanged, "parameters" when only numbers differ.
        explanation: The supervisor's reason, for people and for the next round.
        cause: The root cause in a few words, such as "door in the way".
        cause_step: Index of the step of the old flow that it lies in; None when it lies in none.
        origin: Whether a search over measurements, a model, or both made it.
        subtask: Index of the revised subtask, when the cause lies in an earlier subtask than the one that failed.
            `cause_step` is then a step of that subtask. None: the one that failed.
        refused: Earlier answers that may not run, each in words with the reason; none of them was executed.
        note: Name of the memory note that it was taken from; empty for none.
    """

    flow: _Flow
    change: Change
    explanation: str
    cause: str = ""
    cause_step: _Index | None = None
    origin: Origin = "measurements"
    subtask: _Index | None = None
    refused: tuple[str, ...] = ()
    note: str = ""

    def to_json(self) -> dict[str, object]:
        """Return the revision as JSON values, the note only where there is one."""
        written = fields_json(self)
        return ({"note": self.note} if self.note else {}) | {
            key: value for key, value in written.items() if key != "note"
        }


def change_between(old: ActionFlow, new: ActionFlow) -> Change:
    """Return how one flow became another: "parameters" when the primitives are the same ones, else "sequence"."""
    same = [action.primitive for action in old] == [action.primitive for action in new]
    return "parameters" if same else "sequence"


SCHEMA = "scene2demo-history/2"
# Source: the paper's limit on iterations.
MOST_REVISIONS = 5


@short_repr
class Iteration(NamedTuple):
    """One attempt, and the revision that was made because of it; None after the last.

    A revision whose `subtask` is an earlier one changed that subtask's flow; the next attempt has another start state.
    """

    attempt: Attempt
    revision: Revision | None = None


@short_repr
@dataclass(frozen=True, slots=True)
class History:
    """What was tried for one subtask so far.

    Attributes:
        subtask: Index of the subtask, from 0.
        iterations: In order; only the last may lack a revision.
    """

    subtask: int
    iterations: tuple[Iteration, ...] = ()
    limit: int = MOST_REVISIONS

    @property
    def failures(self) -> tuple[Attempt, ...]:
        """The attempts that failed, in order."""
        return tuple(attempt for attempt, _ in self.iterations if not attempt.succeeded)

    @property
    def revisions(self) -> tuple[Revision, ...]:
        """The revisions of this subtask's own flow, in order."""
        return tuple(r for _, r in self.iterations if r is not None and self._is_own(r))

    @property
    def exhausted(self) -> bool:
        """True when no further revision may be made."""
        return len(self.revisions) >= self.limit

    @property
    def limit_reached(self) -> str:
        """The words for a history that is exhausted."""
        return (
            f"{pluralize(self.limit, 'revision')} {'was' if self.limit == 1 else 'were'} tried, and that is the limit"
        )

    @property
    def solved(self) -> bool:
        """True when the last attempt reached the subtask's goal."""
        return bool(self.iterations) and self.iterations[-1].attempt.succeeded

    def add(self, attempt: Attempt, revision: Revision | None = None) -> Self:
        """Return the history with one more attempt, and the revision made because of it.

        Raises HistoryFull when the evolution has ended already, or the revision would be one too many.
        """
        which = f"subtask {self.subtask + 1}"
        if self.iterations and self.iterations[-1].revision is None:
            ended = f"the evolution of {which} ended with attempt {len(self.iterations)}"
            raise HistoryFull(f"{ended}: nothing was revised after it, so there is nothing more to try")
        if revision is not None and self.exhausted and self._is_own(revision):
            raise HistoryFull(f"{which} was revised {pluralize(self.limit, 'time')}, and that is the limit")
        return replace(self, iterations=(*self.iterations, Iteration(attempt, revision)))

    def reopened(self, hindsight: Hindsight) -> tuple[Attempt, Self]:
        """Return the last, successful attempt as a failed one, and the history before it.

        Adding that attempt again, with its revision, continues the evolution. Raises RecordError when there is no
        success to blame, or the blaming subtask does not come later.
        """
        if not self.solved or hindsight.subtask <= self.subtask:
            problem = f"T{self.subtask + 1} cannot be blamed for a failure of T{hindsight.subtask + 1}"
            raise RecordError(problem, source="(history)", hint="only a subtask that was solved before can be")
        message = f"its goal was reached, but T{hindsight.subtask + 1} failed because of it: {hindsight.message}"
        last = self.iterations[-1].attempt
        failed = replace(last, outcome="failed", failure=BLAMED_LATER, message=message, hindsight=hindsight)
        return failed, replace(self, iterations=self.iterations[:-1])

    def superseded(self, revision: Revision) -> Self:
        """Return the history with its last attempt superseded by the revision of an earlier subtask.

        Raises RecordError when it is no such revision, or the last attempt was revised already.
        """
        if revision.subtask is None or revision.subtask >= self.subtask or not self.iterations:
            problem = "only a change before it supersedes an attempt"
            raise RecordError(problem, source="(history)", hint="see `reopened`")
        last, revised = self.iterations[-1]
        if revised is not None:
            raise RecordError("the last attempt was revised already", source="(history)", hint="add the next attempt")
        return replace(self, iterations=(*self.iterations[:-1], Iteration(last, revision)))

    def _is_own(self, revision: Revision) -> bool:
        return revision.subtask in (None, self.subtask)

    def to_json(self) -> dict[str, object]:
        """Return the mapping that `from_json` reads back into an equal history."""
        return {
            "schema": SCHEMA,
            "subtask": self.subtask,
            "limit": self.limit,
            "iterations": [
                {"attempt": attempt.to_json(), "revision": None if revision is None else revision.to_json()}
                for attempt, revision in self.iterations
            ],
        }

    @classmethod
    def from_json(cls, source: Source, domain: Domain = BUILT_IN) -> Self:
        """Return the history that a JSON file, or a mapping of the same form, describes in a domain.

        Raises RecordError for the one first thing that is malformed, with its place and what was expected.
        """
        document = load(source, RecordError)
        form = document.read(_HistoryForm, domain=domain)
        history = cls(form.subtask, (), form.limit)
        for number, iteration in enumerate(form.iterations):
            try:
                history = history.add(*iteration)
            except HistoryFull as problem:
                raise document.fail(("iterations", number), str(problem)) from problem
        return history


@dataclass(frozen=True, slots=True)
class _HistoryForm:
    # The first version knew no hindsight and no causes in an earlier subtask; what it has is read as it was meant.
    schema: Literal["scene2demo-history/1", "scene2demo-history/2"]
    subtask: Annotated[int, ReadBy(index)]
    limit: Annotated[int, ReadBy(index)]
    iterations: tuple[Iteration, ...]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far two numbers may lie apart and still be the same number to the robot.

    Attributes:
        joint: For joint limits: fractions of the range, or radians or metres of the joint.
    """

    distance_m: float = 0.01
    angle_deg: float = 1.0
    joint: float = 0.01

    def __post_init__(self) -> None:
        for name, value in (("distance_m", self.distance_m), ("angle_deg", self.angle_deg), ("joint", self.joint)):
            if not 0.0 <= value < math.inf:
                raise ValueError(f"Expected a tolerance of 0 or more for {name}, got {value!r}.")

    def of(self, primitive: Primitive) -> float:
        """Return the tolerance for the numbers of a primitive."""
        kinds = {ParameterKind.ANGLE_DEG: self.angle_deg, ParameterKind.JOINT_LIMITS: self.joint}
        return kinds.get(parameter_kind(primitive), self.distance_m)

    def __str__(self) -> str:
        degrees = "degree" if self.angle_deg == 1.0 else "degrees"
        return f"{self.distance_m:g} m, {self.angle_deg:g} {degrees} or {self.joint:g} of a joint's range"


# The axis of each motion, named by what moves along it, and the direction.
_AXES = {primitive: (first, sign) for first, second in OPPOSITES for primitive, sign in ((first, 1.0), (second, -1.0))}


def same_flow(one: ActionFlow, other: ActionFlow, tolerance: Tolerance | None = None) -> bool:
    """Decide whether two flows ask for the same motion, up to a tolerance on their numbers.

    Consecutive motions along one axis count as their signed sum, turns modulo 360 degrees. Motions within the tolerance
    are ignored, and so is a retreat right after a navigation. A step that repeats the one before it is ignored too,
    such as a second navigation to the same place. An open number equals only another open one.

    Example:
        >>> from oag.model.actions import flow_from_json
        >>> one = flow_from_json([18, {"13": 0.3}, 5])
        >>> same_flow(one, flow_from_json([18, 18, {"13": 0.4}, {"14": 0.1}, 5]))
        True
    """
    within = tolerance or Tolerance()
    first, second = net_motion(one, within), net_motion(other, within)
    return len(first) == len(second) and all(_same_action(a, b, within) for a, b in zip(first, second, strict=True))


def net_motion(flow: Iterable[Action], tolerance: Tolerance) -> tuple[Action, ...]:
    """Return the net flow: sums of motions along one axis, without idle and repeated steps."""
    current = tuple(flow)
    while True:
        summed: list[Action] = []
        for action in current:
            _append(summed, action, tolerance)
        # The sum of a row of motions is known only when the row is complete.
        moving = tuple(action for action in summed if not _idle(action, tolerance))
        if len(moving) == len(current):
            return moving
        current = moving


def _append(summed: list[Action], action: Action, tolerance: Tolerance) -> None:
    """Add an action to the net flow, as part of the last action where it continues that."""
    last = summed[-1] if summed else None
    if last is not None and action.primitive in _AXES and last.primitive in _AXES:
        (axis, sign), (same_axis, last_sign) = _AXES[action.primitive], _AXES[last.primitive]
        if axis is same_axis and isinstance(action.parameter, int | float) and isinstance(last.parameter, int | float):
            net = last_sign * last.parameter + sign * action.parameter
            if parameter_kind(axis) is ParameterKind.ANGLE_DEG:
                net = math.remainder(net, 360.0)
            summed[-1] = Action(axis if net >= 0.0 else OPPOSITE[axis], abs(net))
            return
    elif last is not None:
        # A drive leaves the arm at home.
        home_already = action.primitive is Primitive.RETREAT and last.primitive in NAVIGATION
        if home_already or _same_action(last, action, tolerance):
            return
    summed.append(action)


def _idle(action: Action, tolerance: Tolerance) -> bool:
    moved = action.parameter
    return action.primitive in _AXES and isinstance(moved, int | float) and abs(moved) <= tolerance.of(action.primitive)


def _same_action(one: Action, other: Action, tolerance: Tolerance) -> bool:
    if one.primitive is not other.primitive or one.parameter is None or other.parameter is None:
        return one == other
    first, second = (p if isinstance(p, tuple) else (p,) for p in (one.parameter, other.parameter))
    within = tolerance.of(one.primitive)
    return len(first) == len(second) and all(abs(a - b) <= within for a, b in zip(first, second, strict=True))


# Longer than any flow of the paper by far; what is longer is a mistake, and would keep a simulator busy.
MOST_STEPS = 40
_ELSEWHERE = "the plan has this mistake with the flow as it was, too: mend it first, no revision of this subtask can"


@short_repr
@dataclass(frozen=True, slots=True)
class Admission:
    """Decision whether a revised flow may run; true exactly when it may.

    Attributes:
        flow: The flow, None when it could not be read.
        diagnostics: The reasons against it, as errors; empty when it may.
        report: Report of the task with the flow; None when it was not verified.
        repeats: Number of the failed attempt that it repeats, from 1; None when it repeats none.
    """

    flow: ActionFlow | None
    diagnostics: tuple[Diagnostic, ...]
    report: Report | None = None
    repeats: int | None = None

    def __bool__(self) -> bool:
        return not self.diagnostics

    def __str__(self) -> str:
        """Return the reasons as numbered blocks, for a person or for the next round with a model."""
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
    """Decide whether a revised flow of one subtask may run.

    Args:
        subtask_index: Index of the revised subtask, from 0.
        new_flow: Actions, or the paper's JSON form of them as a model wrote it.
        scene: The scene to judge it in; by default the one that the task carries.
        history: What was tried for this subtask before.
        tolerance: What counts as the same number; by default 0.01 m, 1 degree and 0.01 of a joint's range.

    Returns:
        An admission. It is refused when the flow cannot be read, is too long, leaves the plan REFUTED, or repeats a
        failed flow. It is refused too when it needs an unknown fact that the plan did not need before, or when the
        history allows no further revision. A CONDITIONAL plan may stay CONDITIONAL: `admission.report` has the verdict.

    Raises:
        NoSuchSubtask: The task has no subtask of that index.
        RecordError: The history is that of another subtask.
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
        flow = _read(new_flow, chosen.domain)
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
    """Yield the reasons against a revised flow from its verdict, without the history.

    Another subtask's mistake that was there before is marked as such, since no revision of this subtask removes it.
    Needs of the old plan may stay unknown; further unknown needs of the new flow are reasons.
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


def _read(new_flow: object, domain: Domain) -> ActionFlow:
    if isinstance(new_flow, tuple | list) and all(isinstance(action, Action) for action in new_flow):
        return tuple(new_flow)
    return flow_from_json(new_flow, domain)


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
    """Return the number of the failed attempt that a flow repeats, from 1; attempts from another start do not count."""
    start = history.iterations[-1].attempt.start if history.iterations else ""
    for number, (attempt, _) in enumerate(history.iterations, start=1):
        if attempt.start == start and not attempt.succeeded and same_flow(flow, attempt.flow, tolerance):
            return number
    return None
