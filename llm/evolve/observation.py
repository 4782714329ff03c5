"""Observations of an attempt, protocols of its judges, and its description for prompts: texts and pictures.

An observation is plain data without any simulator; the executor of a flow fills it in, step by step.

Source of the selection of pictures: the paper's X_(k,j), per view the frames of the actions max(j - p_1, 1) to
j, at most six an action.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

from llm.client.transport import Image, Part
from llm.structured.prompting import subtask_table
from oag import Action, Scene, Task
from oag.measurements import GoalReading, MeasuredEvidence, Measurements, Miss
from oag.model.actions import ActionFlow, flow_to_json
from oag.revision import Attempt, Critique, History, Revision


@dataclass(frozen=True, slots=True)
class StepObservation:
    """One executed step.

    Attributes:
        step: Index in the flow, from 0.
        asked: The action as the flow has it.
        done: The action with the executed number.
        measurements: Measurements of the primitive.
        failure: Kind of failure, such as "unexpected-contact"; empty after success.
        message: The failure in a sentence.
        failure_measurements: The numbers behind the failure.
        before, after: The goal's conditions at the step's beginning and end.
        misses_before, misses_after: Distances of misplaced items from their goals, at the beginning and the end.
        frames: View -> encoded pictures, for an inspector that uses them.
        moments_s: Time of each picture since the step began [s]; empty where it is unknown.
    """

    step: int
    asked: Action
    done: Action
    measurements: Measurements = ()
    failure: str = ""
    message: str = ""
    failure_measurements: Measurements = ()
    before: tuple[GoalReading, ...] = ()
    after: tuple[GoalReading, ...] = ()
    misses_before: tuple[Miss, ...] = ()
    misses_after: tuple[Miss, ...] = ()
    frames: Mapping[str, tuple[bytes, ...]] = field(default_factory=dict)
    moments_s: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class StartObservation:
    """State at the beginning of an attempt.

    Attributes:
        facts: True facts of `open`, `ontop` and `inside`, as BDDL, the gripper included.
        base: Pose of the robot's base: x [m], y [m], yaw [rad].
    """

    facts: tuple[str, ...]
    base: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class AttemptObservation:
    """One attempt at a subtask.

    Attributes:
        task: The task as it was run.
        subtask: Index of the subtask, from 0.
        flow: The requested flow.
        steps: The executed steps, in order.
        goal: The regressed goal's conditions after everything had come to rest.
        start: State at the beginning; None if it was not read.
    """

    task: Task
    subtask: int
    flow: ActionFlow
    steps: tuple[StepObservation, ...]
    goal: tuple[GoalReading, ...]
    start: StartObservation | None = None

    @property
    def unmet(self) -> tuple[GoalReading, ...]:
        """The goal's conditions that do not hold at the end."""
        return tuple(condition for condition in self.goal if not condition.satisfied)


@runtime_checkable
class Inspector(Protocol):
    """Judges executed steps one by one.

    Source: the paper's Robotic Safety Inspector, m_(tau, j).
    """

    def inspect(self, attempt: AttemptObservation, step: int) -> Critique:
        """Return the critique of one executed step."""
        ...


@dataclass(frozen=True, slots=True)
class Situation:
    """Input of a supervisor about a failed attempt.

    Attributes:
        task: The task with the failed flow.
        subtask: Index of the failed subtask, from 0.
        scene: The scene of the run.
        attempt: The failed attempt with the critiques of its steps.
        history: Earlier attempts at this subtask.
        objections: Why earlier answers to this question may not run, numbered and readable.
        earlier: Histories of the subtasks before, in order. The last attempt of each is the one that stands. It was
            judged as well, so that its effects, such as how an item was grasped, can be looked up.
        observation: The observed attempt with its pictures; None if there are none.
    """

    task: Task
    subtask: int
    scene: Scene
    attempt: Attempt
    history: History
    objections: tuple[str, ...] = ()
    earlier: tuple[History, ...] = ()
    observation: AttemptObservation | None = None


@dataclass(frozen=True, slots=True)
class GiveUp:
    """No revision.

    Attributes:
        reason: Explanation for people, in a sentence or two.
        cause: The root cause in a few words; empty if it was not found.
        needed: What would be needed, if evidently no flow of the library helps; empty otherwise.
        refused: Earlier answers that may not run, each with the reason.
    """

    reason: str
    cause: str = ""
    needed: str = ""
    refused: tuple[str, ...] = ()

    def to_json(self) -> dict[str, object]:
        """Return the answer as JSON values."""
        return {"reason": self.reason, "cause": self.cause, "needed": self.needed, "refused": list(self.refused)}


@runtime_checkable
class Supervisor(Protocol):
    """Revises flows.

    Source: the paper's Robotic Task Supervisor: root cause at the earliest failed step, revision of the sequence or of
    its parameters, nothing but the library's primitives.
    """

    def revise(self, situation: Situation) -> Revision | GiveUp:
        """Return the revised flow, or why there is none.

        If the cause is in an earlier subtask, the revision is of that one's flow and has its index in `subtask`. The
        loop returns to that subtask's start, runs the revised flow, and goes forward again. It counts as one of that
        subtask's revisions.
        """
        ...


_JPEG = b"\xff\xd8\xff"


@dataclass(frozen=True, slots=True)
class Picture:
    """One picture of a step, taken `moment_s` after its beginning [s]; None where that is unknown."""

    step: int
    primitive: str
    view: str
    image: Image
    moment_s: float | None = None

    @property
    def caption(self) -> str:
        """The step, the view and the moment, in a line."""
        moment = "" if self.moment_s is None else f", {self.moment_s:.1f} s after the step began"
        return f"step {self.step + 1} {self.primitive}, {self.view} view{moment}"


def window(step: int, look_back: int) -> range:
    """Return the steps used to judge one: itself, and up to `look_back` steps before it."""
    return range(max(step - look_back, 0), step + 1)


def select_pictures(
    attempt: AttemptObservation, steps: Iterable[int], views: Sequence[str], most: int
) -> tuple[Picture, ...]:
    """Return the pictures of some steps, in order, view by view; evenly thinned out if there are too many.

    Each step and view keeps the same number, as far as it has them, its last one first.
    """
    sequences = [
        [
            Picture(
                step,
                attempt.steps[step].asked.primitive.name,
                view,
                Image(data, "image/jpeg" if data.startswith(_JPEG) else "image/png"),
                moment_s,
            )
            for data, moment_s in _timed_frames(attempt.steps[step], view)
        ]
        for step in steps
        for view in views
    ]
    longest = max(map(len, sequences), default=0)
    for length in range(longest, 0, -1):
        kept = [picture for sequence in sequences for picture in _thinned(sequence, length)]
        if len(kept) <= most:
            return tuple(kept)
    # There is no room for one of each sequence.
    return tuple(_thinned([sequence[-1] for sequence in sequences if sequence], most))


def _timed_frames(step: StepObservation, view: str) -> Iterator[tuple[bytes, float | None]]:
    frames = step.frames.get(view, ())
    return zip(frames, step.moments_s or (None,) * len(frames), strict=True)


def _thinned(sequence: Sequence[Picture], count: int) -> Iterator[Picture]:
    """Yield at most `count` pictures of a sequence, evenly spread; the last one is always among them."""
    if len(sequence) <= count:
        yield from sequence
    elif count == 1:
        yield sequence[-1]
    else:
        yield from (sequence[round(k * (len(sequence) - 1) / (count - 1))] for k in range(count))


def captioned(pictures: Sequence[Picture]) -> tuple[Part, ...]:
    """Return the pictures of a question, each after its caption."""
    return tuple(part for picture in pictures for part in (picture.caption, picture.image))


def picture_text(pictures: Sequence[Picture]) -> str:
    """Return the sentence about the pictures of a question, or that there are none."""
    if not pictures:
        return "There are no pictures."
    head = f"The pictures come with this message ({len(pictures)}), step by step and view by view"
    return f"{head}; a caption stands before each. Those of one view run from the step's beginning to its end."


LONGEST_LINE = 600
_LONGEST_NUMBERS = 1_500
# Offset below which an object counts as being at its place.
_THERE_M = 1e-3
_MEASURED = ("measurements", "failure", "failure_measurements", "unmet", "misses")
_WORDS = {True: "yes", False: "no", None: "not judged"}


def one_line(text: str, longest: int = LONGEST_LINE) -> str:
    """Return a text on one line, truncated if it is long, without control characters."""
    plain = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())
    return plain if len(plain) <= longest else f"{plain[: longest - 3]}..."


def task_text(task: Task) -> str:
    """Return a task's goal and its simple tasks."""
    return f"goal of the whole task: {one_line(str(task.goal), 2_000)}\n{subtask_table(task.subtasks)}"


def subtask_text(attempt: AttemptObservation) -> str:
    """Return the attempted simple task."""
    return subtask_table(attempt.task.subtasks[attempt.subtask : attempt.subtask + 1]).partition(" | ")[2]


def start_text(start: StartObservation) -> str:
    """Return the state at the beginning of an attempt: the robot's pose and the facts."""
    x_m, y_m, yaw_rad = start.base
    lines = [f"robot at ({x_m:.2f}, {y_m:.2f}), heading {math.remainder(yaw_rad, math.tau):.2f} rad"]
    lines.append(f"facts: {' '.join(start.facts) or 'none'}")
    lines.append("of open, ontop and inside everything true is listed; what is not listed is false")
    return "\n".join(lines)


def flow_text(flow: ActionFlow) -> str:
    """Return a flow in the form that models write, and a line for each step."""
    return "\n".join((json.dumps(flow_to_json(flow)), *(_step_line(step, action) for step, action in enumerate(flow))))


def steps_text(steps: Sequence[StepObservation], shown: range, *, numbers_run: bool) -> str:
    """Return some of the executed steps, a line each."""
    return "\n".join(_step_line(step, steps[step].done if numbers_run else steps[step].asked) for step in shown)


def _step_line(step: int, action: Action) -> str:
    left_open = " (its number was left to the planner)" if action.unfilled else ""
    return f"step {step + 1}: {int(action.primitive)} {action}{left_open}"


def critique_text(critique: Critique) -> str:
    """Return the critique of a step on one line."""
    parts = [
        f"step {critique.step + 1} {critique.primitive.name}",
        f"motion as meant: {_WORDS[critique.motion_verified]}",
        f"state reached: {_WORDS[critique.state_reached]}",
    ]
    if critique.anomaly is not None:
        parts.append(f"anomaly: {one_line(critique.anomaly)}")
    if critique.state_contrast:
        parts.append(f"contrast: {one_line(critique.state_contrast)}")
    return " | ".join((*parts, one_line(critique.text)))


def numbers_text(evidence: MeasuredEvidence) -> str:
    """Return the measurements as one line of JSON, truncated if it is long; empty for none.

    Pictures and earlier texts are omitted, and so are misses of objects that are at their place.
    """
    offsets = ((miss, (miss.forward_m, miss.left_m, miss.up_m)) for miss in evidence.misses)
    missed = tuple(miss for miss, offset in offsets if any(abs(part_m) >= _THERE_M for part_m in offset))
    kept = {
        key: value for key, value in replace(evidence, misses=missed).to_json().items() if key in _MEASURED and value
    }
    if not kept:
        return ""
    rounded = json.loads(json.dumps(kept, default=str), parse_float=lambda number: float(f"{float(number):.4g}"))
    return one_line(json.dumps(rounded), _LONGEST_NUMBERS)


def history_text(history: History, *, show_failures: bool) -> str:
    """Return the earlier attempts: each flow, its failure, and the reason of the following revision."""
    lines = []
    for number, (attempt, revision) in enumerate(history.iterations, start=1):
        lines.append(f"attempt {number}: {json.dumps(flow_to_json(attempt.flow))}")
        lines.append(f"  it failed: {_failure(attempt, show_failures)}")
        if revision is not None:
            lines.append(f"  so it was revised: {one_line(revision.explanation)}")
    return "\n".join(lines) or "nothing: this was the first attempt"


def _failure(attempt: Attempt, measured: bool) -> str:
    if measured:
        where = "" if attempt.failed_step is None else f"at step {attempt.failed_step + 1}, "
        return f"{where}{one_line(attempt.message or attempt.failure)}"
    faults = [critique for critique in attempt.critiques if critique.finds_fault]
    faults_text = (f"step {fault.step + 1} {fault.primitive.name}: {one_line(fault.text, 240)}" for fault in faults[:3])
    return "; ".join(faults_text) or "the goal was not reached, and no step was found at fault"
