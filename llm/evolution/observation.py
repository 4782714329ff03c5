"""What is handed to an inspector: an attempt at a subtask as it was measured, step by step.

Plain data without any simulator; whoever executes a flow fills it in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from oag import Action, ActionFlow, Attempt, Critique, History, Revision, Scene, Task
from oag.revision.grounds import GoalReading, Miss
from oag.revision.measurements import Measurements


@dataclass(frozen=True, slots=True)
class StepSeen:
    """One executed step.

    Attributes:
        step: Index in the flow, from 0.
        asked: The action as the flow has it.
        done: The action with the number that was run.
        measurements: What the primitive measured.
        failure: Kind of failure, such as "unexpected-contact"; empty when the step did what it should.
        message: The failure in a sentence.
        failure_measurements: The numbers behind the failure.
        before, after: The goal's conditions at the step's beginning and end.
        misses_before, misses_after: Where items are that the goal wants elsewhere, at the beginning and the end.
        frames: View -> encoded pictures, for an inspector that looks at them.
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


@dataclass(frozen=True, slots=True)
class StartSeen:
    """How it was when an attempt began.

    Attributes:
        facts: What was read to be true of `open`, `ontop` and `inside`, as BDDL, the gripper included.
        base: Where the robot's base stood: x and y in metres, yaw in radians.
    """

    facts: tuple[str, ...]
    base: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class AttemptSeen:
    """One attempt at a subtask.

    Attributes:
        task: The task as it was run.
        subtask: Index of the subtask, from 0.
        flow: The flow as it was asked for.
        steps: The steps that ran, in order.
        goal: The regressed goal's conditions after everything had come to rest.
        start: How it was at the beginning; None where that was not read.
    """

    task: Task
    subtask: int
    flow: ActionFlow
    steps: tuple[StepSeen, ...]
    goal: tuple[GoalReading, ...]
    start: StartSeen | None = None

    @property
    def unmet(self) -> tuple[GoalReading, ...]:
        """The conditions of the goal that do not hold at the end."""
        return tuple(condition for condition in self.goal if not condition.satisfied)


@runtime_checkable
class Inspector(Protocol):
    """Judges executed steps one by one.

    Source: the paper's Robotic Safety Inspector, m_(tau, j).
    """

    def inspect(self, seen: AttemptSeen, step: int) -> Critique:
        """Returns the critique of one step that ran.

        Args:
            seen: The whole attempt, so that the steps before can be looked back at.
            step: Index into `seen.steps`.
        """
        ...


@dataclass(frozen=True, slots=True)
class Situation:
    """What a supervisor is told of a failed attempt.

    Attributes:
        task: The task with the flow that failed.
        subtask: Index of the failed subtask, from 0.
        scene: Where it was run.
        attempt: The failed attempt with the critiques of its steps.
        history: What was tried for this subtask before.
        objections: Why the answers given so far to this very question may not run, numbered and readable.
        earlier: Histories of the subtasks before, in order. The last attempt of each is the one that stands; it was
            judged as well, so that what it left behind, such as how an item was taken, can be looked up.
        seen: The failed attempt as it was seen, for one who looks at its pictures; None where there are none.
    """

    task: Task
    subtask: int
    scene: Scene
    attempt: Attempt
    history: History
    objections: tuple[str, ...] = ()
    earlier: tuple[History, ...] = ()
    seen: AttemptSeen | None = None


@dataclass(frozen=True, slots=True)
class GiveUp:
    """No revision.

    Attributes:
        reason: Why, in a sentence or two for a person.
        cause: The root cause in a few words; empty when it was not found.
        needed: What it would take, where it is evident that no flow of the library helps; empty otherwise.
        refused: What was answered before and may not run, with the reason, each in words.
    """

    reason: str
    cause: str = ""
    needed: str = ""
    refused: tuple[str, ...] = ()

    def to_json(self) -> dict[str, object]:
        """Returns the answer as JSON values."""
        return {"reason": self.reason, "cause": self.cause, "needed": self.needed, "refused": list(self.refused)}


@runtime_checkable
class Supervisor(Protocol):
    """Revises flows.

    Source: the paper's Robotic Task Supervisor: root cause at the earliest failed step, revision of the sequence or of
    its parameters, nothing but the library's primitives.
    """

    def revise(self, situation: Situation) -> Revision | GiveUp:
        """Returns the revised flow, or why there is none.

        Where the cause lies in an earlier subtask, the revision is of that one's flow and has its index in `subtask`;
        the loop goes back to that subtask's start, runs the revised flow, and goes forward again. It counts as one of
        that subtask's revisions.
        """
        ...
