"""What is handed to an inspector: an attempt at a subtask as it was measured, step by step.

Plain data without any simulator; whoever executes a flow fills it in.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from oag import Action, ActionFlow, Task
from oag.revision.grounds import Miss, Reading
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
    before: tuple[Reading, ...] = ()
    after: tuple[Reading, ...] = ()
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
    goal: tuple[Reading, ...]
    start: StartSeen | None = None

    @property
    def unmet(self) -> tuple[Reading, ...]:
        """The conditions of the goal that do not hold at the end."""
        return tuple(condition for condition in self.goal if not condition.satisfied)
