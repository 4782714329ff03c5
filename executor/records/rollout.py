"""What a rollout tells while it runs, and leaves behind: plain data for reports, data sets and a critic."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bddl.visible import counted
from executor.machine.files import plain
from executor.records.commands import DriveCommand
from oag import ActionFlow, Report, Scene, Task
from oag.revision.grounds import GoalReading
from oag.revision.measurements import Measurements, measurements_json

JsonValue = str | int | float | bool | None | list[Any] | dict[str, Any]


class FailureKind(Enum):
    """Why a primitive ended early; every member is decided by a measurement, never guessed."""

    UNREACHABLE = "unreachable"
    NO_PATH = "no-collision-free-path"
    GRASP_MISSED = "grasp-missed"
    TOO_WIDE = "too-wide-for-gripper"
    SLIPPED = "slipped"
    STALLED = "stalled"
    DROPPED = "dropped"
    COLLISION = "unexpected-contact"
    SIDE_EFFECT = "side-effect"
    PRECONDITION = "precondition"
    TIMEOUT = "timeout"
    GOAL_NOT_REACHED = "goal-not-reached"


@dataclass(frozen=True, slots=True)
class Penetration:
    """How deep bodies overlapped over the sampled states of an episode, everything counted that touches anything.

    Attributes:
        p99_m: 99th percentile over the samples of the deepest overlap in each.
        deepest_m: The deepest overlap of all.
        pair: The bodies of the deepest one, as "owner/link".
        samples: How many states were looked at.
    """

    p99_m: float = 0.0
    deepest_m: float = 0.0
    pair: tuple[str, ...] = ()
    samples: int = 0


@dataclass(frozen=True, slots=True)
class Peaks:
    """The most that an episode asked of the robot, at any physics step; `docs/executor.md` has the limits.

    Attributes:
        base_m_s, yaw_rad_s, arm_rad_s: Speeds: of the base over the floor, of its turning, of the fastest arm joint.
        base_m_s2, yaw_rad_s2, arm_rad_s2: Accelerations of these, over 20 ms.
        base_n, yaw_nm: What drives the base and turns it.
        shoulder_nm, wrist_nm: The largest torque of arm joints 1 to 4, and 5 to 7.
        finger_n: What one finger is pressed with.
    """

    base_m_s: float = 0.0
    yaw_rad_s: float = 0.0
    arm_rad_s: float = 0.0
    base_m_s2: float = 0.0
    yaw_rad_s2: float = 0.0
    arm_rad_s2: float = 0.0
    base_n: float = 0.0
    yaw_nm: float = 0.0
    shoulder_nm: float = 0.0
    wrist_nm: float = 0.0
    finger_n: float = 0.0


@dataclass(frozen=True, slots=True)
class Failure:
    """One typed failure with the numbers behind it.

    Attributes:
        kind: The type.
        message: One sentence for a person.
        measurements: The numbers behind it.
    """

    kind: FailureKind
    message: str
    measurements: Measurements = ()

    def to_json(self) -> dict[str, Any]:
        """Returns the failure as plain data."""
        numbers = plain(measurements_json(self.measurements))
        return {"kind": self.kind.value, "message": self.message, "measurements": numbers}


@dataclass(frozen=True, slots=True)
class StepRecord:
    """One primitive of one subtask, as it ran.

    Attributes:
        subtask: Index of the subtask, from 0.
        step: Index in the subtask's flow, from 0.
        primitive: The primitive's name, such as "APPROACH".
        action: The action as JSON, numbers filled in.
        start_s, end_s: Simulated time.
        planning_wall_s: Wall time spent on planning this step.
        measurements: Evidence for the critic: pose reached, residuals, contacts, widths.
        failure: None when the step did what it should.
    """

    subtask: int
    step: int
    primitive: str
    action: JsonValue
    start_s: float
    end_s: float
    planning_wall_s: float
    measurements: Measurements
    failure: Failure | None = None


@dataclass(frozen=True, slots=True)
class SubtaskRecord:
    """One subtask: its flow as filled in, its steps, and how its regressed goal was judged.

    Attributes:
        moved_m: Side effects: how far each item has moved that the subtask has nothing to do with, where it did.
        commands: What the robot was told, from the checkpoint to the end.
    """

    index: int
    name: str
    flow: ActionFlow
    steps: tuple[StepRecord, ...]
    readings: tuple[GoalReading, ...]
    state_hash: str
    checkpoint: bytes
    moved_m: Mapping[str, float] = field(default_factory=dict)
    commands: tuple[DriveCommand, ...] = ()

    @property
    def failure(self) -> Failure | None:
        """The first failed step's failure, or None."""
        return next((step.failure for step in self.steps if step.failure), None)

    @property
    def succeeded(self) -> bool:
        """True when no step failed and every literal of the regressed goal was read as wanted."""
        return self.failure is None and all(reading.satisfied for reading in self.readings)


@dataclass(frozen=True, slots=True)
class Trajectory:
    """The recorded motion, one row a sample (10 Hz unless the rollout was told otherwise).

    Attributes:
        time_s: (N,) simulated time.
        robot_qpos: (N, 12) joint positions; base_x, base_y, base_yaw, seven arm joints, two fingers.
        robot_qvel: (N, 12) joint velocities.
        robot_target: (N, 12) drive targets: the action that was commanded.
        eef_pose: (N, 7) TCP position and quaternion w x y z in the world.
        object_poses: id -> (N, 7) root pose of each dynamic object in the world.
        joint_positions: id -> (N, J) joints of each articulated object.
        subtask, step: (N,) int32 indices of what was running.
        packed_states: N byte strings from the physics engine, for exact deferred rendering.
    """

    time_s: NDArray[np.float64]
    robot_qpos: NDArray[np.float32]
    robot_qvel: NDArray[np.float32]
    robot_target: NDArray[np.float32]
    eef_pose: NDArray[np.float32]
    object_poses: Mapping[str, NDArray[np.float32]]
    joint_positions: Mapping[str, NDArray[np.float32]]
    subtask: NDArray[np.int32]
    step: NDArray[np.int32]
    packed_states: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class Detour:
    """Subtasks that a rollout inserted into its plan, which was then proved again.

    Attributes:
        first: Index, in the plan that ran, of the first inserted subtask.
        count: How many were inserted.
        reason: Why, as a clause.
    """

    first: int
    count: int
    reason: str


@dataclass(frozen=True, slots=True)
class Rollout:
    """One execution of a task in one varied scene.

    Attributes:
        task: The plan that ran: the one asked for, and what was inserted into it; in an evolution, the revised one.
        scene: The concrete scene (after variation by the seed and size adjustment), enough to rebuild the world.
        goal_readings: The task goal G, judged after everything had settled.
        state_hash: SHA-256 over the recorded physical states; equal for equal scene, flow, seed.
        record_hz: Samples a second of simulated time; the hash is over the samples.
        planning_wall_s, simulation_wall_s: Where the wall time went.
        penetration: How deep bodies overlapped while it ran.
        peaks: The most that it asked of the robot.
        detours: What was inserted into the plan that was asked for, in the order of the plan.
    """

    task: Task
    scene: Scene
    seed: int
    record_hz: float
    subtasks: tuple[SubtaskRecord, ...]
    goal_readings: tuple[GoalReading, ...]
    trajectory: Trajectory
    state_hash: str
    simulated_s: float
    planning_wall_s: float
    simulation_wall_s: float
    penetration: Penetration = field(default_factory=Penetration)
    peaks: Peaks = field(default_factory=Peaks)
    detours: tuple[Detour, ...] = ()

    @property
    def inserted(self) -> frozenset[int]:
        """Indices of the subtasks that were inserted into the plan."""
        return frozenset(index for one in self.detours for index in range(one.first, one.first + one.count))

    @property
    def asked_for(self) -> Task:
        """The plan without what was inserted into it."""
        kept = (subtask for index, subtask in enumerate(self.task.subtasks) if index not in self.inserted)
        return replace(self.task, subtasks=tuple(kept))

    @property
    def detour_notes(self) -> tuple[str, ...]:
        """A sentence for each detour: what was inserted where, and why."""
        return tuple(_detour_note(self.task, detour) for detour in self.detours)

    def __repr__(self) -> str:
        ended = "succeeded" if self.succeeded else "failed"
        done = f"{len(self.subtasks)} of {counted(len(self.task.subtasks), 'subtask')}"
        return f"<Rollout {ended} of {self.task.name!r}, seed {self.seed}: {done}, {self.simulated_s:.1f} s>"

    @property
    def failure(self) -> Failure | None:
        """The failure that ended the rollout, or None."""
        return next((subtask.failure for subtask in self.subtasks if subtask.failure), None)

    @property
    def succeeded(self) -> bool:
        """True when all subtasks ran and succeeded and the task goal holds at the end."""
        complete = len(self.subtasks) == len(self.task.subtasks)
        return complete and all(s.succeeded for s in self.subtasks) and all(r.satisfied for r in self.goal_readings)


def _detour_note(task: Task, detour: Detour) -> str:
    end = detour.first + detour.count
    names = " and ".join(subtask.name for subtask in task.subtasks[detour.first : end])
    numbers, were = (
        (f"subtask {end}", "was") if detour.count == 1 else (f"subtasks {detour.first + 1} to {end}", "were")
    )
    return f"{numbers} ({names}) of {len(task.subtasks)} {were} inserted on the way: {detour.reason}"


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened.

    Attributes:
        kind: What began or ended, or that the plan was revised.
        subtask: Index of the subtask, from 0.
        subtask_count: How many subtasks the task has.
        step: Index of the step in its flow, or -1 for subtask events.
        name: Name of the subtask or primitive.
        simulated_s: Simulated time so far; of a revision, the time that the run goes back to.
        message: A short remark, such as a failure's sentence or a revision's reason; empty when all went well.
    """

    kind: Literal["subtask-start", "step-start", "step-end", "subtask-end", "revision"]
    subtask: int
    subtask_count: int
    step: int
    name: str
    simulated_s: float
    message: str = ""


Listener = Callable[[Event], None]


def ignore(event: Event) -> None:
    """Listens to nothing; the default listener."""


class PlanRefused(ValueError):
    """A plan that `verify` does not prove is not executed; `report` says why."""

    def __init__(self, report: Report) -> None:
        super().__init__(f"the plan is not proved, nothing was moved:\n{report}")
        self.report = report


class MissingFlow(ValueError):
    """A subtask without an action flow cannot be executed."""


def require_flows(task: Task) -> None:
    """Returns when every subtask has an action flow.

    Raises:
        MissingFlow: One has none; the message names it.
    """
    missing = [subtask.name for subtask in task.subtasks if subtask.flow is None]
    if missing:
        raise MissingFlow(f"no action flow for {', '.join(missing)}; a flow is a list such as [17, 1, 2, 3]")


class RolloutInterrupted(KeyboardInterrupt):
    """Ctrl-C during a rollout; `partial` is what had been done."""

    def __init__(self, partial: Rollout) -> None:
        super().__init__("the rollout was interrupted")
        self.partial = partial
