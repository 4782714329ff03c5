"""Curves of a recorded motion over time: arm, gripper, base, doors, and the distances of hand and target from goals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array, transform_from_quaternion
from executor.sim.robot.description import drives
from oag import Scene, SceneObject, Task

MOST_POINTS = 400
"""Points of a curve; a screen shows no more."""
_DECIMALS = 4
_MOVED = 1e-3  # A joint that moves less, in rad or m, is not drawn.


@dataclass(frozen=True, slots=True)
class Plot:
    """Curves that share one axis.

    Attributes:
        name, unit: Title of the axis.
        lines: Curve -> its values at the times of the motion; None where there is none.
    """

    name: str
    unit: str
    lines: Mapping[str, Sequence[float | None]]


@dataclass(frozen=True, slots=True)
class MotionPlots:
    """All curves of a motion.

    Attributes:
        time_s: Times of their points.
        plots: The curves.
        base_m: Position x, y of the base at these times.
    """

    time_s: Sequence[float | None]
    plots: Sequence[Plot]
    base_m: Sequence[tuple[float, float]]

    def to_json(self) -> dict[str, Any]:
        """Return them as plain data."""
        return asdict(self)


def motion_plots(
    arrays: Mapping[str, NDArray[Any]],
    task: Task,
    scene: Scene,
    object_ids: Sequence[str],
    joint_names: Sequence[str],
    gains: Sequence[Sequence[float]] = (),
) -> MotionPlots:
    """Return the curves of a motion.

    Args:
        arrays: Its samples, as `executor.data.samples.columns` names them.
        task, scene: What was executed, and where.
        object_ids: Movable objects, in the order of `object_poses`.
        joint_names: Joints of the articulated objects, in the order of `joint_positions`.
        gains: Stiffness, damping and largest force of each joint of the robot; without them no force is drawn.
    """
    count = len(arrays["time_s"])
    rows = np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).round().astype(int)) if count else np.arange(0)
    return MotionPlots(
        _numbers(arrays["time_s"][rows]),
        tuple(_plots({name: arrays[name][rows] for name in _USED}, task, scene, object_ids, joint_names, gains)),
        [(float(x), float(y)) for x, y in arrays["robot_qpos"][rows, :2].round(_DECIMALS)],
    )


MOTION_COLUMNS = ("time_s", "robot_qpos", "robot_qvel", "robot_target", "eef_pose", "subtask")
"""Arrays of a motion that curves are drawn of, beside those of things."""
_USED = (*MOTION_COLUMNS[1:], "object_poses", "joint_positions")


def recorded_plots(
    columns: Mapping[str, NDArray[Any]],
    poses: Mapping[str, NDArray[Any]],
    joints: Mapping[str, NDArray[Any]],
    task: Task,
    scene: Scene,
) -> MotionPlots:
    """Return the curves of a motion whose things have an array each.

    Args:
        columns: `MOTION_COLUMNS`, with N samples each.
        poses: Movable object -> (N, 7) poses.
        joints: Articulated object -> (N, J) joints.
        task, scene: What was executed, and where.
    """
    count = len(columns["time_s"])
    things = np.stack(list(poses.values()), axis=1) if poses else np.zeros((count, 0, 7))
    hinges = np.concatenate(list(joints.values()), axis=1) if joints else np.zeros((count, 0))
    names = [
        name if one.shape[1] == 1 else f"{name} {k + 1}" for name, one in joints.items() for k in range(one.shape[1])
    ]
    arrays = {**columns, "object_poses": things, "joint_positions": hinges}
    return motion_plots(arrays, task, scene, list(poses), names, drives(scene.robot.model))


def _plots(
    samples: Mapping[str, NDArray[Any]],
    task: Task,
    scene: Scene,
    object_ids: Sequence[str],
    joint_names: Sequence[str],
    gains: Sequence[Sequence[float]],
) -> Iterator[Plot]:
    qpos, joints, robot = samples["robot_qpos"], samples["joint_positions"], scene.robot.model
    yield Plot("distance", "m", _distances(samples, task, scene, object_ids))
    fingers = qpos[:, robot.fingers]
    yield Plot("gripper opening", "mm", {"opening": _numbers(1000.0 * fingers.sum(axis=1))})
    if gains:
        stiffness, damping, most = np.asarray(gains, float)[robot.fingers].T
        error_m, speed_m_s = (
            samples["robot_target"][:, robot.fingers] - fingers,
            samples["robot_qvel"][:, robot.fingers],
        )
        # A drive pushes a finger until what it touches pushes back as much.
        force = np.clip(stiffness * error_m - damping * speed_m_s, -most, most)
        yield Plot("force of the finger drives", "N", _lines(("left", "right"), force))
    if moved := [k for k in range(joints.shape[1]) if np.ptp(joints[:, k]) > _MOVED]:
        yield Plot("doors and drawers", "rad or m", _lines([joint_names[k] for k in moved], joints[:, moved]))
    yield Plot("arm", "rad", _lines([f"joint {k + 1}" for k in range(len(robot.arm_joints))], qpos[:, robot.arm]))
    yield Plot("base", "m, rad", _lines(("x", "y", "yaw", "lift")[robot.base], qpos[:, robot.base]))


def _distances(
    samples: Mapping[str, NDArray[Any]], task: Task, scene: Scene, object_ids: Sequence[str]
) -> dict[str, list[float | None]]:
    """Return how far the hand is from the running subtask's target, and the target from where it is to go."""
    poses = samples["object_poses"].reshape(len(samples["subtask"]), -1, 7)
    hand: list[float | None] = []
    goal: list[float | None] = []
    for row, running in enumerate(samples["subtask"]):
        subtask = task.subtasks[min(int(running), len(task.subtasks) - 1)]
        moves = subtask.target in object_ids
        at = poses[row, object_ids.index(subtask.target), :3] if moves else np.asarray(scene[subtask.target].position)
        hand.append(_number(np.linalg.norm(samples["eef_pose"][row, :3] - at)))
        support = scene.objects.get(subtask.support_goal or "")
        goal.append(None if support is None else _number(_outside_m(support, at)))
    lines = {"hand to target": hand, "target to its goal": goal}
    return {name: line for name, line in lines.items() if any(value is not None for value in line)}


def _outside_m(thing: SceneObject, point: Array) -> float:
    """Return the distance [m] of a point from an object's bounding box; 0 within."""
    turn = transform_from_quaternion(thing.position, thing.orientation)[:3, :3]
    local = turn.T @ (point - np.asarray(thing.position))
    return float(np.linalg.norm(np.maximum(np.abs(local) - np.asarray(thing.extent_m) / 2.0, 0.0)))


def _lines(names: Sequence[str], values: NDArray[Any]) -> dict[str, list[float | None]]:
    return {name: _numbers(values[:, k]) for k, name in enumerate(names)}


def _numbers(values: NDArray[Any]) -> list[float | None]:
    return [_number(value) for value in values]


def _number(value: Any) -> float:
    return round(float(value), _DECIMALS)
