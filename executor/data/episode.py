"""One motion as rows: what a rollout becomes, a store gives, every format is written from, and policies learn from.

Row i has the observation at sample i, and the command from there until sample i + 1. At the last sample the last
command stays. Columns, all at the rate of the recording:

    observation.state              (J + 8) joints of the robot's record, 12 of the paper's: base x, y (m), yaw (rad),
                                   a lift (m), the arm (rad), two fingers (m); the point between the fingertips in the
                                   world: x y z (m), quaternion x y z w; gripper opening (m)
    observation.velocity           (J) of the joints, m/s and rad/s
    observation.environment_state  (216) things and handles, see `executor.data.state_readers`
    observation.object_poses       (7 M) movable objects, in the order of the episode's `object_ids`: x y z (m) in the
                                   world, quaternion x y z w; M is the maximum over the set, unused numbers are 0
    observation.joint_positions    (J) joints of the articulated objects (rad or m), in the order of `joint_names`
    observation.camera_pose_VIEW   (7) the camera in the world, where there are pictures: x y z (m), quaternion x y z w;
                                   x right, y down, z ahead
    observation.point_cloud        (1024, 4) on request: x y z in the robot's base (m), 1 on the hand;
                                   `executor.data.state_readers`
    action                         (H) `executor.sim.robot.actions.hand_actions`
    action.joint_target            (J) joint targets for the next sample, m and rad
    subtask_index, primitive_index running subtask and primitive; a primitive's number in flows, 0 between primitives
    next.reward                    1 / number of subtasks in the last row of each; of a demonstration they add up to 1
    next.done                      true in the last row

Quaternions are x y z w, as in robosuite, robomimic and LeRobot; inside this program they are w x y z.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import bddl
from bddl.terminal import pluralize
from executor.data import samples
from executor.geometry import Array, quaternions_last
from executor.records import Rollout
from executor.sim.render.cameras import camera_json
from executor.sim.render.frames import Frames, cameras_of
from executor.system.files import plain
from llm.offline.reader import paraphrases
from oag.model.actions import flow_to_json

DEMONSTRATION, CORRECTION, FAILURE = "demonstration", "correction", "failure"
"""Kinds of episodes: successes, failed and corrected attempts, and final failures."""

CLOUD = "observation.point_cloud"
SCALARS = {"subtask_index": "int64", "primitive_index": "int64", "next.reward": "float32", "next.done": "bool"}
"""Scalar columns -> dtype."""


class EpisodeTooShort(ValueError):
    """A recording with fewer than two samples has no transition to learn from."""

    def __init__(self, count: int) -> None:
        super().__init__(f"an episode needs at least 2 recorded samples, this recording has {count}")


class Clip(Protocol):
    """Pictures of an episode of one view and kind."""

    def pictures(self) -> Iterator[NDArray[Any]]:
        """Yield (H, W, 3) uint8 RGB, or (H, W) uint16."""
        ...


@dataclass(frozen=True, slots=True)
class ArrayClip:
    """Pictures in memory."""

    array: NDArray[Any]

    def pictures(self) -> Iterator[NDArray[Any]]:
        """Yield them."""
        return iter(self.array)


@dataclass(frozen=True, slots=True, repr=False)
class Episode:
    """One recorded motion as rows.

    Attributes:
        index: Its number in the data set.
        columns: Name -> one row per sample; the module's docstring documents each. Those that are not known are left
            out: a rollout's own episode has neither hand actions nor what is read from a world.
        clips: View and kind ("" for colours) -> its pictures, one per row. Those of a file are readable until the next
            episode is requested.
        about: Its further metadata, as plain data; `docs/datasets.md` documents it.
        recorded: `time_s`, `subtask`, `step` and `packed_states` as recorded; empty where it follows from `about`.
    """

    index: int
    columns: Mapping[str, NDArray[Any]]
    clips: Mapping[tuple[str, str], Clip]
    about: Mapping[str, Any]
    recorded: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    @classmethod
    def from_rollout(cls, rollout: Rollout, frames: Frames | None = None, query: str = "") -> Episode:
        """Return the episode of a rollout, with pictures when there are any.

        Args:
            rollout: The rollout.
            frames: Its rendered pictures.
            query: The sentence that was typed, where one was.

        Raises:
            EpisodeTooShort: Fewer than two samples were recorded.
            ValueError: Pictures and samples differ in number.
        """
        motion = rollout.trajectory
        count = len(motion.time_s)
        if count < 2:
            raise EpisodeTooShort(count)
        if frames is not None and frames.count != count:
            raise ValueError(f"expected {count} pictures of each view, got {frames.count}")
        arrays = samples.motion_columns(motion, ())
        reward = np.zeros(count, np.float32)
        reward[-1] = rollout.succeeded
        joints = {name: positions.shape[1] for name, positions in motion.joint_positions.items()}
        about = {
            "kind": DEMONSTRATION if rollout.succeeded else FAILURE,
            "unit": {"seed": rollout.seed},
            "query": query,
            "paraphrases": paraphrases(query) if query else (),
            "task": rollout.task.to_json(),
            **rollout.scene_fixes_json,
            "scene": rollout.scene.to_json(),
            "state_hash": rollout.state_hash,
            "object_ids": list(motion.object_poses),
            "joint_names": [f"{name}/{k}" for name, width in joints.items() for k in range(width)],
            "pictures": None if frames is None else {"views": _cameras(rollout, frames)},
            "subtasks": list(_subtasks(rollout)),
        }
        followed = (
            {} if frames is None or frames.overview is None else {camera_column("global"): _poses(frames.overview)}
        )
        return cls(
            0,
            {**motion_columns(arrays), **followed, "next.reward": reward},
            {} if frames is None else {(view, ""): ArrayClip(frames.at_size(view)) for view in frames.views},
            plain(about),
            {name: arrays[name] for name in ("time_s", "subtask", "step", "packed_states")},
        )

    @property
    def length(self) -> int:
        """Number of rows."""
        return len(self.columns["observation.state"])

    @property
    def succeeded(self) -> bool:
        """Whether the task's goal was reached."""
        return bool(self.about["kind"] == DEMONSTRATION)

    @property
    def task(self) -> str:
        """The sentence."""
        return str(self.about["query"])

    @property
    def subtasks(self) -> tuple[str, ...]:
        """A short sentence per subtask; `subtask_index` is its index."""
        return tuple(entry["name"].replace("_", " ") for entry in self.about["subtasks"])

    def __repr__(self) -> str:
        ended = "succeeded" if self.succeeded else "failed"
        name, seed = self.about["task"]["task_activity_name"], self.about["unit"]["seed"]
        return f"<Episode {ended} of {name!r}, seed {seed}: {pluralize(self.length, 'sample')}>"


def motion_columns(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[np.float32]]:
    """Return the columns that follow from a motion's arrays (`executor.data.samples`) alone."""
    qpos, targets = arrays["robot_qpos"], arrays["robot_target"]
    opening_m = qpos[:, -2:].sum(axis=1, keepdims=True)
    state = np.concatenate([qpos, quaternions_last(arrays["eef_pose"]), opening_m], axis=1, dtype=np.float32)
    return {
        "observation.state": state,
        "observation.velocity": arrays["robot_qvel"].astype(np.float32),
        "observation.object_poses": quaternions_last(arrays["object_poses"]).reshape(len(qpos), -1),
        "observation.joint_positions": arrays["joint_positions"],
        "action.joint_target": np.concatenate([targets[1:], targets[-1:]]).astype(np.float32),
    }


def _poses(mounts: Array) -> NDArray[np.float32]:
    """Return (N, 7) positions and quaternions x y z w of cameras (x right, y down, z ahead) at mounts (N, 4, 4)."""
    turned = mounts[:, :3, :3] @ np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    return np.concatenate([mounts[:, :3, 3], Rotation.from_matrix(turned).as_quat()], axis=1, dtype=np.float32)


def _cameras(rollout: Rollout, frames: Frames) -> dict[str, dict[str, Any]]:
    """Return the cameras of a rollout's pictures, at the common size."""
    cameras = cameras_of(rollout.scene, rollout.task, tuple(frames.views), frames.size)
    return {camera.name: camera_json(camera, frames.size) for camera in cameras}


def _subtasks(rollout: Rollout) -> Iterator[dict[str, Any]]:
    """Yield the subtasks that have samples, with their flows as executed; of the last one the flow may not be done."""
    finished = {record.index: record for record in rollout.subtasks}
    for index, subtask in enumerate(rollout.task.subtasks):
        rows = np.flatnonzero(rollout.trajectory.subtask == index)
        if not len(rows):
            continue
        record = finished.get(index)
        flow = record.flow if record is not None else subtask.flow or ()
        yield {
            "name": subtask.name,
            "detail": subtask.detail,
            "init": bddl.format(subtask.init),
            "goal": bddl.format(subtask.goal),
            "span": [int(rows[0]), int(rows[-1]) + 1],
            "steps": [{"action": action} for action in flow_to_json(flow)],
            "succeeded": record is not None and record.succeeded,
        }


def camera_column(view: str) -> str:
    """Return the name of the column of a camera's poses."""
    return f"observation.camera_pose_{view}"


def derived_columns(about: Mapping[str, Any], count: int) -> dict[str, NDArray[Any]]:
    """Return the columns that follow from an episode's metadata: running steps, reward, and the end.

    Args:
        about: Its `length`, `kind` and `subtasks` with their spans.
        count: Number of rows.

    Raises:
        ValueError: The metadata states another length.
    """
    if about["length"] != count:
        raise ValueError(f"an episode is said to have {about['length']} rows, and has {count}")
    subtasks = about["subtasks"]
    found = {name: np.zeros(count, dtype) for name, dtype in SCALARS.items()}
    for number, entry in enumerate(subtasks):
        if entry["span"] is None:
            continue
        first, end = entry["span"]
        found["subtask_index"][first:end] = number
        if about["kind"] == DEMONSTRATION:
            found["next.reward"][end - 1] = 1.0 / len(subtasks)
        for step in entry["steps"]:
            if step["span"] is not None:
                action = step["action"]
                running = int(next(iter(action)) if isinstance(action, dict) else action)
                found["primitive_index"][slice(*step["span"])] = running
    found["next.done"][-1] = True
    return found


def step_numbers(subtasks: Sequence[Mapping[str, Any]], count: int) -> NDArray[np.int32]:
    """Return (N,) the running step's index in its flow, -1 between steps."""
    found = np.full(count, -1, np.int32)
    for entry in subtasks:
        for number, step in enumerate(entry["steps"]):
            if step["span"] is not None:
                found[slice(*step["span"])] = number
    return found


def metadata_line(about: Mapping[str, Any]) -> str:
    """Return an episode's metadata as a line of JSON, without the line end."""
    return json.dumps(about, ensure_ascii=False, allow_nan=False)
