"""Record a rollout: sampled trajectory, state hash, peak loads; and replay its commands, open loop.

A replay needs no plan and no sensing, and gives the same states to the last bit.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from executor.geometry import Array, pose_vector
from executor.records import DriveCommand, Peaks, SubtaskRecord, Trajectory
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.goals import judge_at_rest
from executor.sim.detectors import Overlap, deepest_overlap
from executor.sim.engine import STANDARD, Physics
from executor.sim.faults import Fault
from executor.sim.robot.description import drives
from executor.sim.robot.kinematics import Kinematics
from executor.sim.world import World
from executor.skills.control import Controller
from executor.skills.trajectories import NO_NOISE, CommandNoise
from oag import Scene, Task
from oag.measurements import GoalReading

EVERY_STEPS = 5
"""Peaks are looked for every 20 ms. Over that an acceleration is a change of speed: from one step to the next, contacts
make any number of it."""


class PeakWatch:
    """Track peak speeds and loads of one world; they are taken out sample by sample."""

    def __init__(self) -> None:
        self._world: World | None = None
        self._stiffness = self._damping = self._limits = np.zeros(0)
        self._before: Array | None = None
        self._row = np.zeros(11)

    def look(self, world: World, control: Controller) -> None:
        """Update the peaks with the state after a physics step, asked every `EVERY_STEPS`.

        Drive forces follow from the drives' law for that state, within the engine's limits.
        """
        if self._world is not world:
            self._world, self._before = world, None
            self._stiffness, self._damping, _ = np.array(drives(world.model)).T
            self._limits = np.array([joint.force_limit for joint in world.robot.active_joints])
        q, v = np.asarray(world.robot.get_qpos(), float), np.asarray(world.robot.get_qvel(), float)
        off = np.concatenate([control.drive_target, [control.finger_target_m] * 2]) - q
        slower = np.concatenate([control.velocity, [0.0, 0.0]]) - v
        f = np.minimum(np.abs(self._stiffness * off + self._damping * slower), self._limits)
        a = np.zeros(len(q)) if self._before is None else np.abs(v - self._before) / (EVERY_STEPS * world.timestep_s)
        self._before = v
        s = np.abs(v)
        robot = world.model
        arm, wrist, fingers = robot.arm, robot.movers - robot.wrist, robot.fingers
        motion = (np.hypot(s[0], s[1]), s[2], s[arm].max(), np.hypot(a[0], a[1]), a[2], a[arm].max())
        pressed = (np.hypot(f[0], f[1]), f[2], f[arm.start : wrist].max(), f[wrist : arm.stop].max(), f[fingers].max())
        self._row = np.maximum(self._row, (*motion, *pressed))

    def take(self) -> Array:
        """Return (11,) the peaks since the last call, in the order of `Peaks`."""
        row, self._row = self._row, np.zeros(11)
        return row


def summarize_peaks(rows: Sequence[Array]) -> Peaks:
    """Return the peaks of an episode."""
    return Peaks(*(round(float(value), 3) for value in np.max(rows, axis=0))) if rows else Peaks()


class TrajectoryRecorder:
    """Rows of a trajectory, sampled at a fixed rate; every sample is hashed.

    Args:
        kinematics: For the hand's pose.
        rate_hz: Samples a second of simulated time [Hz].
        state_hash: Hash of what was recorded before, when a run is resumed.
    """

    def __init__(self, kinematics: Kinematics, rate_hz: float, state_hash: str = "") -> None:
        self._kinematics = kinematics
        self._rate_hz = rate_hz
        self.state_hash = state_hash
        self.world: World | None = None
        self.control: Controller | None = None
        self.subtask, self.step = 0, -1
        self._rows: list[dict[str, object]] = []
        self._packed: list[bytes] = []
        self.overlaps: list[Overlap] = []
        self.peaks: list[Array] = []
        self._watch = PeakWatch()

    def after_step(self) -> None:
        """Take a sample when one is due; called after every physics step."""
        world = self.world
        if world is None or self.control is None:
            return
        if world.steps % EVERY_STEPS == 0:
            self._watch.look(world, self.control)
        every = max(round(1.0 / (self._rate_hz * world.timestep_s)), 1)
        if world.steps % every:
            return
        self.state_hash = hashlib.sha256(self.state_hash.encode() + world.state_vector().tobytes()).hexdigest()
        qpos = np.asarray(world.robot.get_qpos(), dtype=np.float32)
        fingers = [self.control.finger_target_m] * 2
        self._rows.append(
            {
                "time_s": world.time_s,
                "robot_qpos": qpos,
                "robot_qvel": np.asarray(world.robot.get_qvel(), dtype=np.float32),
                "robot_target": np.concatenate([self.control.target, fingers]).astype(np.float32),
                "eef": self._kinematics.forward(qpos.astype(np.float64)),
                "subtask": self.subtask,
                "step": self.step,
                **{f"object:{i}": world.T_world_link(i) for i in world.dynamic_ids},
                **{
                    f"joints:{i}": [world.joint_position(i, joint.name) for joint in world.assets[i].joints]
                    for i in world.articulated_ids
                },
            }
        )
        self._packed.append(world.pack())
        self.overlaps.append(deepest_overlap(world))
        self.peaks.append(self._watch.take())

    @property
    def samples(self) -> int:
        """How many samples were taken."""
        return len(self._rows)

    def rewind(self, samples: int, state_hash: str) -> None:
        """Drop what was recorded after the first samples, when a run goes back to a checkpoint.

        Args:
            samples: How many to keep.
            state_hash: The checkpoint's hash.
        """
        for rows in self._all():
            del rows[samples:]
        self.state_hash = state_hash

    def recorded(self) -> tuple[str, list[list[Any]]]:
        """Return what was recorded so far, for `restore`."""
        return self.state_hash, [list(rows) for rows in self._all()]

    def restore(self, recorded: tuple[str, list[list[Any]]]) -> None:
        """Replace the recording by an earlier one, and drop all that was recorded since."""
        self.state_hash = recorded[0]
        for rows, kept in zip(self._all(), recorded[1], strict=True):
            rows[:] = kept

    def _all(self) -> tuple[list[Any], ...]:
        return self._rows, self._packed, self.overlaps, self.peaks

    def trajectory(self) -> Trajectory:
        """Return what was recorded so far."""

        def column(name: str, dtype: type) -> np.ndarray:
            return np.array([row[name] for row in self._rows], dtype=dtype)

        def columns(prefix: str, made: Callable[[str], np.ndarray]) -> Mapping[str, np.ndarray]:
            names = [name for name in self._rows[0] if name.startswith(prefix)] if self._rows else []
            return {name.removeprefix(prefix): made(name) for name in names}

        def poses(name: str) -> np.ndarray:
            return pose_vector(column(name, np.float64).reshape(-1, 4, 4)).astype(np.float32)

        return Trajectory(
            time_s=column("time_s", np.float64),
            robot_qpos=column("robot_qpos", np.float32),
            robot_qvel=column("robot_qvel", np.float32),
            robot_target=column("robot_target", np.float32),
            eef_pose=poses("eef"),
            object_poses=columns("object:", poses),
            joint_positions=columns("joints:", lambda name: column(name, np.float32)),
            subtask=column("subtask", np.int32),
            step=column("step", np.int32),
            packed_states=tuple(self._packed),
        )


@dataclass(frozen=True, slots=True)
class Repeated:
    """The outcome of repeated commands.

    Attributes:
        trajectory: The recorded motion; its steps are not distinguished.
        state_hash: Hash of the recorded states; equal to the first run's where nothing differed.
        goal_readings: The task's goal, judged where the commands end.
    """

    trajectory: Trajectory
    state_hash: str
    goal_readings: tuple[GoalReading, ...]


def repeat(
    task: Task,
    scene: Scene,
    commands: Sequence[Sequence[DriveCommand]],
    record_hz: float,
    *,
    faults: tuple[Fault, ...] = (),
    physics: Physics = STANDARD,
    noise: CommandNoise = NO_NOISE,
    start: Checkpoint | None = None,
) -> Repeated:
    """Give a robot recorded commands, open loop, and return the outcome.

    Args:
        task: Its goal is judged at the end.
        commands: Drive commands, subtask by subtask (`SubtaskRecord.commands`).
        record_hz: Samples a second [Hz]; the hash is over the samples.
        faults, physics, noise: As in the recorded run.
        start: Where that run began; by default the scene's initial state, at rest.
    """
    recorder = _recorder(scene, record_hz)
    checkpoint = start or Checkpoint.at_start(scene, faults, physics)
    readings: tuple[GoalReading, ...] = ()
    for index, given in enumerate(commands):
        world, control = checkpoint.restore(
            scene, recorder.after_step, faults, physics, noise.of_subtask(scene.robot.model, index, physics.timestep_s)
        )
        with world:
            _give(given, index, recorder, world, control)
            if index + 1 == len(commands):
                readings = judge_at_rest(task.goal, world)
            checkpoint = Checkpoint.of(world, control)
    return Repeated(recorder.trajectory(), recorder.state_hash, readings)


def repeat_subtask(
    scene: Scene,
    record: SubtaskRecord,
    record_hz: float,
    *,
    faults: tuple[Fault, ...] = (),
    physics: Physics = STANDARD,
    noise: CommandNoise = NO_NOISE,
) -> Trajectory:
    """Return the motion of one attempt at a subtask; an evolution keeps no samples of a revised attempt.

    Args:
        record: The attempt's record.
        faults, physics, noise: As in the recorded run.

    Raises:
        CheckpointError: The record's checkpoint cannot be read.
        RuntimeError: The states differ from those of the attempt.
    """
    start, recorder = Checkpoint.from_bytes(record.checkpoint), _recorder(scene, record_hz)
    recorder.state_hash = start.state_hash
    quiet_or_not = noise.of_subtask(scene.robot.model, record.index, physics.timestep_s)
    world, control = start.restore(scene, recorder.after_step, faults, physics, quiet_or_not)
    with world:
        _give(record.commands, record.index, recorder, world, control)
    if recorder.state_hash != record.state_hash:
        raise RuntimeError(f"subtask {record.index} went otherwise than its commands say")
    return recorder.trajectory()


def _recorder(scene: Scene, record_hz: float) -> TrajectoryRecorder:
    with World(scene, oracle=True) as model:
        return TrajectoryRecorder(Kinematics(model.robot, model.model), record_hz)


def _give(
    commands: Sequence[DriveCommand], index: int, recorder: TrajectoryRecorder, world: World, control: Controller
) -> None:
    recorder.world, recorder.control, recorder.subtask = world, control, index
    for command in commands:
        control.repeat(command)
    recorder.world = None
