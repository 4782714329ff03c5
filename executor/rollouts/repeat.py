"""Does a recorded episode again, command by command: no plan, no sensing, the same states to the last bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from executor.primitives.control import Controller
from executor.primitives.noise import QUIET, CommandNoise
from executor.records.commands import DriveCommand
from executor.records.rollout import SubtaskRecord, Trajectory
from executor.robot.kinematics import Kinematics
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.judge import judge_at_rest
from executor.rollouts.recorder import TrajectoryRecorder
from executor.world.faults import Fault
from executor.world.physics import STANDARD, Physics
from executor.world.world import World
from oag import Scene, Task
from oag.revision.grounds import GoalReading


@dataclass(frozen=True, slots=True)
class Repeated:
    """What comes of the same commands.

    Attributes:
        trajectory: The recorded motion; its steps are not told apart.
        state_hash: Over the recorded states; equal to the first run's where all went as it did then.
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
    noise: CommandNoise = QUIET,
    start: Checkpoint | None = None,
) -> Repeated:
    """Returns what comes of giving a robot commands, open loop.

    Args:
        task: Whose goal is judged at the end.
        scene: The concrete scene.
        commands: What the robot was told, subtask by subtask (`SubtaskRecord.commands`).
        record_hz: Samples a second; the hash is over the samples.
        faults, physics, noise: As in the run that the commands are of.
        start: Where that began; by default where the scene has everything, at rest.
    """
    recorder = _recorder(scene, record_hz)
    checkpoint = start or Checkpoint.at_start(scene, faults, physics)
    readings: tuple[GoalReading, ...] = ()
    for index, given in enumerate(commands):
        world, control = checkpoint.restore(
            scene, recorder.after_step, faults, physics, noise.of_subtask(index, physics.timestep_s)
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
    noise: CommandNoise = QUIET,
) -> Trajectory:
    """Returns the motion of one attempt at a subtask, which an evolution keeps no samples of once it was revised.

    Args:
        scene: The concrete scene.
        record: What the attempt left behind.
        record_hz: Samples a second.
        faults, physics, noise: As in the run that the attempt is of.

    Raises:
        CheckpointError: The record's checkpoint cannot be read.
        RuntimeError: The states are others than those of the attempt.
    """
    start, recorder = Checkpoint.from_bytes(record.checkpoint), _recorder(scene, record_hz)
    recorder.state_hash = start.state_hash
    quiet_or_not = noise.of_subtask(record.index, physics.timestep_s)
    world, control = start.restore(scene, recorder.after_step, faults, physics, quiet_or_not)
    with world:
        _give(record.commands, record.index, recorder, world, control)
    if recorder.state_hash != record.state_hash:
        raise RuntimeError(f"subtask {record.index} went otherwise than its commands say")
    return recorder.trajectory()


def _recorder(scene: Scene, record_hz: float) -> TrajectoryRecorder:
    with World(scene, oracle=True) as model:
        return TrajectoryRecorder(Kinematics(model.robot), record_hz)


def _give(
    commands: Sequence[DriveCommand], index: int, recorder: TrajectoryRecorder, world: World, control: Controller
) -> None:
    recorder.world, recorder.control, recorder.subtask = world, control, index
    for command in commands:
        control.repeat(command)
    recorder.world = None
