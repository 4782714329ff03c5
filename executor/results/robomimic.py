"""robomimic's HDF5: one file, `data/demo_<i>` a demonstration, read by its `SequenceDataset` without conversion.

Layout, with T transitions:

    data                        attrs: total, env_args (JSON: type, env_kwargs), scene2demo_version, and of a data set
                                scene2demo (JSON: what all demonstrations have in common)
      demo_0                    attrs: num_samples = T, success, seed, state_hash, task, task_detail, scene (JSON),
                                scaled (JSON: objects at another size than they are drawn with), rate_hz,
                                action_names, action_scale, subtasks (JSON)
        actions                 (T, 11) float32 in [-1, 1]; see `executor.results.episode.Episode.actions`
        actions_absolute        (T, 12) float32 drive targets in m and rad
        actions_hand            (T, 10) float32 in m and rad, in data sets; see `executor.robot.actions.hand_actions`
        states                  (T, D) float32; attrs columns
        packed_states           (T + 1, L) uint8: exact states of the physics engine, for replay; not in data sets
        about                   (JSON, of a data set) what else there is to say; `docs/datasets.md` documents it
        rewards, dones          (T,): 1 at the last transition of a success, in data sets 1 / number of subtasks where
                                each ends; done at the last transition
        time_s                  (T + 1,) float64
        subtask, step           (T + 1,) int32; step -1 while the world settles between steps
        obs, next_obs           robot_qpos (12), robot_qvel (12), eef_pos (3), eef_quat (4),
                                gripper_opening (1), joints (J), object (7 K), in data sets
                                environment_state, primitive (1), <view>_camera_pose (7), `object` and `joints` with
                                room for the most that one has, point_cloud (1024, 4) float32; where rendered
                                <view>_image (H, W, 3) uint8, <view>_depth, <view>_segmentation (H, W, 1) uint16
                                (all plain data sets: a demonstration that is copied into another file is whole)
        object_poses/<id>       (T + 1, 7) position and quaternion
        joint_positions/<id>    (T + 1, J)
        datagen_info            eef_pose (T, 4, 4), gripper_action (T, 1), object_poses/<id> (T, 4, 4),
                                subtask_term_signals/<subtask> (T,): 1 from the end of the subtask on
    mask/all, mask/successful   names of demonstrations; of a data set also mask/train, valid, corrections

Quaternions are x y z w, as robosuite and robomimic have them.

Source: the layout that robomimic 0.3 and 0.5 read, and MimicGen's `datagen_info`.
"""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bddl.files import temporary_beside
from executor.geometry import quaternions_last, transform_from_quaternion
from executor.machine.extras import require
from executor.machine.files import plain
from executor.results.episode import ACTION_NAMES, Episode
from oag.task.sizes import resized

# robomimic's trainer reads both of every file, `type` as one of its numbers (2 is a gym-like one). It makes an
# environment only of an `env_name`, to roll its policies out in; there is none to name, so that has to be off.
ENVIRONMENT = {"type": 2, "env_kwargs": {}}
NO_MASKS: Mapping[str, range] = MappingProxyType({})
ABOUT = "scene2demo"
"""Attribute of the group of demonstrations: what all of a data set have in common."""

COMPRESSION = 4
"""Of pictures: 15 % smaller than the fastest level for half as much time again; more takes twice the time for 8 %."""


def write_robomimic(
    path: Path | str, episodes: Iterable[Episode], masks: Mapping[str, range] = NO_MASKS, about: str = ""
) -> Path:
    """Writes demonstrations as one HDF5 file and returns its path; the file appears only when it is complete.

    Args:
        path: The file.
        episodes: At least one, in the order of their numbers; one at a time is in memory where they are made so.
        masks: Name -> which demonstrations it has, beside `all` and `successful`.
        about: What all of a data set have in common, as JSON; empty where they are none.

    Raises:
        ValueError: When there are no episodes.
        OSError: When the disk is full, or the folder cannot be written.
    """
    with new_hdf5(Path(path)) as file:
        data = file.create_group("data")
        good: list[int] = []
        count = total = 0
        for episode in episodes:
            _write_demo(data.create_group(f"demo_{count}"), episode)
            good += [count] if episode.succeeded else []
            count, total = count + 1, total + episode.length
        if not count:
            raise ValueError("expected at least one episode to write, got none")
        data.attrs["total"] = total
        data.attrs["env_args"] = json.dumps(ENVIRONMENT)
        data.attrs["scene2demo_version"] = _version()
        if about:
            data.attrs[ABOUT] = about
        for name, numbers in {"all": range(count), "successful": good, **masks}.items():
            file.create_dataset(f"mask/{name}", data=np.array([f"demo_{k}".encode() for k in numbers], dtype="S16"))
    return Path(path)


def _write_demo(demo: Any, episode: Episode) -> None:
    length, trajectory = episode.length, episode.trajectory
    demo.attrs.update(
        {
            "num_samples": length,
            "success": episode.succeeded,
            "seed": episode.seed,
            "state_hash": episode.state_hash,
            "task": episode.task.name,
            "task_detail": episode.task.detail,
            "scene": json.dumps(plain(episode.scene.to_json())),
            "scaled": json.dumps([change.to_json() for change in resized(episode.scene)]),
            "rate_hz": episode.rate_hz,
            "action_names": json.dumps(ACTION_NAMES),
            "action_scale": episode.action_scale,
            "subtasks": json.dumps([plain(asdict(span)) for span in episode.spans]),
        }
    )
    rewards = episode.rewards
    if rewards is None:
        rewards = np.zeros(length, dtype=np.float32)
        rewards[-1] = float(episode.succeeded)
    dones = np.zeros(length, dtype=np.int64)
    dones[-1] = 1
    demo.create_dataset("actions", data=episode.actions)
    demo.create_dataset("actions_absolute", data=episode.actions_absolute)
    for name, values in episode.commanded.items():
        demo.create_dataset(name, data=values)
    demo.create_dataset("states", data=_states(episode)).attrs["columns"] = json.dumps(episode.state_names)
    if trajectory.packed_states:
        packed = np.frombuffer(b"".join(trajectory.packed_states), np.uint8).reshape(length + 1, -1)
        demo.create_dataset("packed_states", data=packed, compression="gzip", compression_opts=1)
    if episode.about:
        # No attribute: these end at 64 kB.
        demo.create_dataset("about", data=episode.about)
    demo.create_dataset("rewards", data=rewards)
    demo.create_dataset("dones", data=dones)
    demo.create_dataset("time_s", data=trajectory.time_s)
    demo.create_dataset("subtask", data=trajectory.subtask)
    demo.create_dataset("step", data=trajectory.step)
    _write_observations(demo, episode)
    for name, poses in trajectory.object_poses.items():
        demo.create_dataset(f"object_poses/{name}", data=quaternions_last(poses))
    for name, positions in trajectory.joint_positions.items():
        demo.create_dataset(f"joint_positions/{name}", data=positions)
    _write_datagen_info(demo.create_group("datagen_info"), episode)


def _write_observations(demo: Any, episode: Episode) -> None:
    trajectory = episode.trajectory
    columns = {
        "robot_qpos": trajectory.robot_qpos,
        "robot_qvel": trajectory.robot_qvel,
        "eef_pos": trajectory.eef_pose[:, :3],
        "eef_quat": quaternions_last(trajectory.eef_pose)[:, 3:],
        "gripper_opening": trajectory.robot_qpos[:, 10:12].sum(axis=1, keepdims=True),
        "joints": episode.joint_positions,
        "object": _objects(episode),
        **episode.observations,
    }
    for name, values in columns.items():
        if values.ndim > 2:
            _write_pictures(demo, name, values)
        elif values.shape[1]:
            demo.create_dataset(f"obs/{name}", data=values[:-1])
            demo.create_dataset(f"next_obs/{name}", data=values[1:])
    for view, pictures in episode.images.items():
        _write_pictures(demo, f"{view}_image", pictures)


def _write_pictures(demo: Any, name: str, pictures: NDArray[Any]) -> None:
    """Writes pictures, or clouds, into obs and next_obs, one sample apart.

    Both are plain data sets, so that a demonstration that is copied into another file takes its pictures along. Each
    picture is compressed once for the two of them.
    """
    length, origin = len(pictures) - 1, (0,) * (pictures.ndim - 1)
    now, after = (
        demo.create_dataset(
            f"{group}/{name}",
            shape=(length, *pictures.shape[1:]),
            dtype=pictures.dtype,
            chunks=(1, *pictures.shape[1:]),
            compression="gzip",
            compression_opts=COMPRESSION,
        )
        for group in ("obs", "next_obs")
    )
    for index, picture in enumerate(pictures):
        packed = zlib.compress(picture.tobytes(), COMPRESSION)
        if index < length:
            now.id.write_direct_chunk((index, *origin), packed)
        if index > 0:
            after.id.write_direct_chunk((index - 1, *origin), packed)


def _write_datagen_info(group: Any, episode: Episode) -> None:
    trajectory, length = episode.trajectory, episode.length
    group.create_dataset("eef_pose", data=_matrices(trajectory.eef_pose[:-1]))
    group.create_dataset("gripper_action", data=episode.actions[:, -1:])
    for name, poses in trajectory.object_poses.items():
        group.create_dataset(f"object_poses/{name}", data=_matrices(poses[:-1]))
    rows = np.arange(length)
    for number, span in enumerate(episode.spans, start=1):
        signal = ((rows >= span.end - 1) & span.succeeded).astype(np.int64)
        group.create_dataset(f"subtask_term_signals/{number}_{span.name.replace('/', '_')}", data=signal)


def _objects(episode: Episode) -> NDArray[np.float32]:
    """Returns (N, 7 K) poses of the objects with quaternions x y z w."""
    count = len(episode.object_poses)
    return quaternions_last(episode.object_poses.reshape(count, -1, 7)).reshape(count, -1)


def _states(episode: Episode) -> NDArray[np.float32]:
    """Returns (T, D) the episode's states with quaternions x y z w."""
    objects = _objects(episode)[:-1]
    return np.concatenate([episode.states[:-1, : episode.states.shape[1] - objects.shape[1]], objects], axis=1)


def _matrices(poses: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (T, 4, 4) transforms of (T, 7) poses."""
    made = [transform_from_quaternion(pose[:3], pose[3:]) for pose in poses.astype(np.float64)]
    return np.array(made, dtype=np.float32).reshape(len(poses), 4, 4)


def _version() -> str:
    try:
        return metadata.version("scene2demo")
    except metadata.PackageNotFoundError:
        return "unknown"


@contextmanager
def new_hdf5(path: Path) -> Iterator[Any]:
    """Gives a new `h5py.File`, which is the wanted file when the block ends without an exception.

    Args:
        path: Where the file belongs; its folder is made when absent.

    Raises:
        OSError: The disk is full, or the folder cannot be written.
        MissingExtra: h5py is not installed.
    """
    h5py: Any = require("h5py", "data")
    with temporary_beside(path) as temporary, _Patient(temporary) as stream:
        try:
            with h5py.File(stream, "w") as file:
                yield file
        finally:
            if stream.problem is not None:
                raise stream.problem


class _Patient(io.FileIO):
    """A file that takes everything, and keeps the first problem of writing it.

    Attributes:
        problem: What the system said; from then on nothing is written.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "r+")
        self.problem: OSError | None = None

    def write(self, data: Any) -> int:
        size = memoryview(data).nbytes
        done = 0
        while done < size and self.problem is None:
            try:
                done += super().write(memoryview(data).cast("B")[done:]) or 0
            except OSError as problem:
                self.problem = problem
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as problem:
            self.problem = self.problem or problem
            return self.tell() if size is None else size
