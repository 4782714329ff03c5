"""Records of a rollout: drive commands, steps, subtasks, failures, events; and how they read in words.

A motion is kept as the path that it was timed along, not as its thousands of drive targets. Timing is a function of the
path, so a demonstration of a minute takes a few kilobytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import Enum
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bddl.errors import Scene2DemoError
from bddl.terminal import pluralize
from executor.geometry import Array
from executor.system.files import plain
from oag import Report, Scene, Task
from oag.measurements import GoalReading, Measurements, measurements_json
from oag.model.actions import ActionFlow
from oag.model.codec import as_number


@dataclass(frozen=True, slots=True)
class DriveCommand:
    """One command to the drives, and for how many physics steps it held.

    Attributes:
        path: (N, Q) base and arm waypoints of a motion, timed at `speed`; one row is a pose to hold, at rest.
        finger_m: Target of each finger, from the middle [m].
        speed: Fraction of the speed limits along the path.
        followed: Physics steps for which the timed path was followed; not all of it where something ended the motion.
        stopped: Whether the robot then slowed down on the spot, rather than hold the end of the path.
        held: Physics steps for which it held still afterwards.
    """

    path: Array
    finger_m: float
    speed: float = 1.0
    followed: int = 0
    stopped: bool = False
    held: int = 0


JsonValue = str | int | float | bool | None | list[Any] | dict[str, Any]


class FailureKind(Enum):
    """Why a primitive ended early; every member is decided by a measurement, never guessed."""

    UNREACHABLE = "unreachable"
    NO_PATH = "no-collision-free-path"
    GRASP_MISSED = "grasp-missed"
    TOO_WIDE = "too-wide-for-gripper"
    NO_PART = "no-such-part"
    SLIPPED = "slipped"
    STALLED = "stalled"
    DROPPED = "dropped"
    COLLISION = "unexpected-contact"
    SIDE_EFFECT = "side-effect"
    PRECONDITION = "precondition"
    TIMEOUT = "timeout"
    NO_ANSWER = "no-answer-in-time"
    GOAL_NOT_REACHED = "goal-not-reached"


@dataclass(frozen=True, slots=True)
class Penetration:
    """Overlap of bodies over the sampled states of an episode; every contact counts.

    Attributes:
        p99_m: 99th percentile over the samples of the deepest overlap in each.
        deepest_m: The deepest overlap of all.
        pair: The bodies of the deepest one, as "owner/link".
        samples: How many states were measured.
    """

    p99_m: float = 0.0
    deepest_m: float = 0.0
    pair: tuple[str, ...] = ()
    samples: int = 0


@dataclass(frozen=True, slots=True)
class Peaks:
    """Peak speeds and loads of the robot in an episode, every 20 ms; `docs/executor.md` has the limits.

    Attributes:
        base_m_s, yaw_rad_s, arm_rad_s: Speeds: of the base over the floor, of its turning, of the fastest arm joint.
        base_m_s2, yaw_rad_s2, arm_rad_s2: Accelerations of these, over 20 ms.
        base_n, yaw_nm: Force [N] that drives the base, and torque [N m] that turns it.
        shoulder_nm, wrist_nm: The largest torque of arm joints 1 to 4, and 5 to 7.
        finger_n: Force of one finger [N].
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
        """Return the failure as plain data."""
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
    """One subtask: its flow as filled in, its steps, and the readings of its regressed goal.

    Attributes:
        moved_m: Side effects: how far [m] each uninvolved item has moved, where it did.
        commands: All drive commands, from the checkpoint to the end.
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
    """The recorded motion, one row a sample (10 Hz by default).

    Attributes:
        time_s: (N,) simulated time.
        robot_qpos: (N, J) joint positions, in the order of the robot's `joint_names`.
        robot_qvel: (N, J) joint velocities.
        robot_target: (N, J) drive targets: the action that was commanded.
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
    """A repair of a plan, which was then proved again.

    Attributes:
        first: Index, in the plan that ran, of the first inserted subtask, or of the first that is done otherwise.
        count: How many were inserted; 0 where subtasks are done in another order or another way.
        reason: Why, as a clause.
    """

    first: int
    count: int
    reason: str


@dataclass(frozen=True, slots=True)
class SceneFix:
    """A change of a scene without which the wish could not be proved, or not be done.

    Attributes:
        kind: "place" where a thing stands elsewhere, "door" where one is opened or shut, "removed".
        objects: Ids of what is changed, what it carries included.
        change: What is changed, as a sentence's clause.
        reason: Code or kind of the refusal, verdict or failure that it mends.
    """

    kind: Literal["place", "door", "removed"]
    objects: tuple[str, ...]
    change: str
    reason: str

    def __str__(self) -> str:
        return f"the scene was changed: {self.change} (for: {self.reason})"


@dataclass(frozen=True, slots=True)
class Rollout:
    """One execution of a task in one varied scene.

    Attributes:
        task: The plan that ran: the requested one with insertions; in an evolution, the revised one.
        scene: The concrete scene (after variation by the seed and size adjustment), enough to rebuild the world.
        goal_readings: The task goal G, judged after everything had settled.
        state_hash: SHA-256 over the recorded physical states; equal for equal scene, flow, seed.
        record_hz: Samples a second of simulated time; the hash is over the samples.
        planning_wall_s, simulation_wall_s: Wall time [s] by activity.
        penetration: Overlap of bodies during the rollout.
        peaks: Peak speeds and loads of the robot.
        detours: Insertions into the requested plan, in the plan's order.
        scene_fixes: Changes of the scene that were asked for, so that the wish can be done.
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
    scene_fixes: tuple[SceneFix, ...] = ()

    @property
    def scene_fixes_json(self) -> dict[str, Any]:
        """Changes of the scene as a field of records; nothing where there are none."""
        return {"scene_fixes": [plain(asdict(fix)) for fix in self.scene_fixes]} if self.scene_fixes else {}

    @property
    def inserted(self) -> frozenset[int]:
        """Indices of the subtasks that were inserted into the plan."""
        return frozenset(index for one in self.detours for index in range(one.first, one.first + one.count))

    @property
    def asked_for(self) -> Task:
        """The requested plan, without insertions."""
        kept = (subtask for index, subtask in enumerate(self.task.subtasks) if index not in self.inserted)
        return replace(self.task, subtasks=tuple(kept))

    @property
    def detour_notes(self) -> tuple[str, ...]:
        """One sentence a detour: what was inserted, where, and why."""
        return tuple(_detour_note(self.task, detour) for detour in self.detours)

    def __repr__(self) -> str:
        ended = "succeeded" if self.succeeded else "failed"
        done = f"{len(self.subtasks)} of {pluralize(len(self.task.subtasks), 'subtask')}"
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
    if not detour.count:
        return f"from subtask {detour.first + 1} on the plan was changed: {detour.reason}"
    names = " and ".join(subtask.name for subtask in task.subtasks[detour.first : end])
    numbers, were = (
        (f"subtask {end}", "was") if detour.count == 1 else (f"subtasks {detour.first + 1} to {end}", "were")
    )
    return f"{numbers} ({names}) of {len(task.subtasks)} {were} inserted on the way: {detour.reason}"


@dataclass(frozen=True, slots=True)
class Event:
    """One event of a rollout.

    Attributes:
        kind: What began or ended, or that the plan was revised.
        subtask: Index of the subtask, from 0.
        subtask_count: How many subtasks the task has.
        step: Index of the step in its flow, or -1 for subtask events.
        name: Name of the subtask or primitive.
        simulated_s: Simulated time so far; of a revision, the time that the run goes back to.
        message: A failure's message or a revision's reason; empty on success.
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
    """Ignore an event; the default listener."""


class PlanRefused(Scene2DemoError, ValueError):
    """A plan that `verify` does not prove is not executed; `report` says why."""

    exit_code = 1

    def __init__(self, report: Report) -> None:
        super().__init__(f"the plan is not proved, nothing was moved:\n{report}")
        self.report = report


class MissingFlow(Scene2DemoError, ValueError):
    """A subtask without an action flow cannot be executed."""


def require_flows(task: Task) -> None:
    """Check that every subtask has an action flow; raises MissingFlow, which names those without."""
    missing = [subtask.name for subtask in task.subtasks if subtask.flow is None]
    if missing:
        raise MissingFlow(f"no action flow for {', '.join(missing)}; a flow is a list such as [17, 1, 2, 3]")


class RolloutInterrupted(KeyboardInterrupt):
    """Ctrl-C during a rollout; `partial` is what had been done."""

    def __init__(self, partial: Rollout) -> None:
        super().__init__("the rollout was interrupted")
        self.partial = partial


@dataclass(frozen=True, slots=True)
class Caption:
    """A picture's caption of two lines, and the progress of the rollout.

    Attributes:
        title: The subtask, with its number.
        detail: The step, with its number, or the settling between steps.
        time_s: Simulated time.
        progress: From 0 to 1.
    """

    title: str
    detail: str
    time_s: float
    progress: float


def captions_of(rollout: Rollout) -> tuple[Caption, ...]:
    """Return one caption for each recorded sample."""
    trajectory = rollout.trajectory
    steps = {(s.subtask, s.step): s for subtask in rollout.subtasks for s in subtask.steps}
    total = len(rollout.task.subtasks)
    count = len(trajectory.time_s)
    made = []
    for index in range(count):
        subtask, number = int(trajectory.subtask[index]), int(trajectory.step[index])
        planned = rollout.task.subtasks[subtask]
        step = steps.get((subtask, number))
        length = len(planned.flow or ())
        if step is not None:
            detail = f"step {number + 1} of {length}: {action_text(step.primitive, step.action)}"
        else:
            detail = "settling" if number < 0 else f"step {number + 1} of {length}"
        title = f"{subtask + 1}/{total}  {readable(planned.name)}"
        made.append(Caption(title, detail, float(trajectory.time_s[index]), (index + 1) / count))
    return tuple(made)


def action_text(primitive: str, action: object) -> str:
    """Return an action in words, such as `ARTICULATE_OPEN 0.85`."""
    if not isinstance(action, dict):
        return primitive
    values = [value for value in action.values() if value is not None]
    numbers = [part for value in values for part in (value if isinstance(value, list | tuple) else [value])]
    return " ".join([primitive, *(number_text(number) for number in numbers)])


def number_text(value: object) -> str:
    """Return a number with at most four significant digits, anything else as text.

    Below a millionth counts as zero: no measured length or angle is finer.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    number = as_number(value) or 0.0
    return "0" if abs(number) < 1e-6 else f"{number:.4g}"


def readable(name: str) -> str:
    """Return an activity's name for people: `open_refrigerator` becomes `open refrigerator`."""
    return name.replace("_", " ")


def describe_peaks(peaks: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    """Yield each part of the robot with its peak loads and speeds.

    Args:
        peaks: The fields of `Peaks` by name.
    """
    for part, name, force in (("base", "base_m_s", "base_n"), ("base's turning", "yaw_rad_s", "yaw_nm")):
        unit, speed = ("N", "m/s") if part == "base" else ("N m", "rad/s")
        yield part, f"{peaks[force]:.0f} {unit}, {peaks[name]:.2f} {speed}, {peaks[f'{name}2']:.1f} {speed}2"
    torques = f"{peaks['shoulder_nm']:.1f} and {peaks['wrist_nm']:.1f} N m"
    yield "arm", f"{torques}, {peaks['arm_rad_s']:.1f} rad/s, {peaks['arm_rad_s2']:.1f} rad/s2"
    yield "fingers", f"{peaks['finger_n']:.0f} N"
