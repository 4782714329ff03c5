"""robomimic's HDF5: one file, `data/demo_<i>` a demonstration, read by its `SequenceDataset` without conversion.

Layout, with T transitions:

    data                        attrs: total, env_args (JSON: type, env_kwargs), scene2demo_version, and of a data set
                                scene2demo (JSON: what all demonstrations have in common)
      demo_0                    attrs: num_samples = T, success, seed, state_hash, task, task_detail, scene (JSON),
                                scaled (JSON: objects at another size than they are drawn with), rate_hz,
                                action_names, action_scale, subtasks (JSON); query and paraphrases (JSON), the sentence
                                that was typed and others for it; cameras (JSON, by view): size, fov_y_rad, intrinsics
                                (3 x 3, pixels), mount (a link of the robot, or null for the world) and T_mount_camera
                                (4 x 4; x ahead, y left, z up)
        actions                 (T, 11) float32 in [-1, 1]; see `executor.data.episode.Episode.actions`
        actions_absolute        (T, 12) float32 drive targets in m and rad
        actions_hand            (T, 10) float32 in m and rad, in data sets; see `hand_actions` of the robot
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
                                room for the most that one has
        obs, last_obs           point_cloud (1024, 4) float32; where rendered <view>_image (H, W, 3) uint8,
                                <view>_depth, <view>_segmentation (H, W, 1) uint16; T in obs, and in last_obs the one
                                after the last transition
        object_poses/<id>       (T + 1, 7) position and quaternion
        joint_positions/<id>    (T + 1, J)
        datagen_info            eef_pose (T, 4, 4), gripper_action (T, 1), object_poses/<id> (T, 4, 4),
                                subtask_term_signals/<subtask> (T,): 1 from the end of the subtask on
    mask/all, mask/successful   names of demonstrations; of a data set also mask/train, valid, corrections

Quaternions are x y z w, as robosuite and robomimic have them. All arrays are plain data sets, so that a demonstration
that is copied into another file is whole; numbers and pictures are compressed (gzip).

Pictures and clouds are in obs alone: next_obs would have nearly all of them a second time. robomimic reads next_obs
only where `train.hdf5_load_next_obs` is true, which it is for no algorithm of behaviour cloning. Where offline
reinforcement learning is to have pictures, what follows obs[i] is obs[i + 1], and last_obs at the end.

Source: the layout that robomimic 0.3 and 0.5 read, and MimicGen's `datagen_info`.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bddl.files import atomic_path
from executor.data.episode import ACTION_NAMES, Episode
from executor.geometry import quaternions_last, transform_from_quaternion
from executor.system.extras import require
from executor.system.files import plain
from oag.sizes import scaled_objects

# robomimic's trainer reads both of every file, `type` as one of its numbers (2 is a gym-like one). It makes an
# environment only of an `env_name`, to roll its policies out in; there is none to name, so that has to be off.
ENVIRONMENT = {"type": 2, "env_kwargs": {}}
NO_MASKS: Mapping[str, range] = MappingProxyType({})
ABOUT = "scene2demo"
"""Attribute of the group of demonstrations: what all of a data set have in common."""

LAST = "last_obs"
"""Group of the observations after the last transition that next_obs does not have."""

COMPRESSION = 4
"""Of pictures: 15 % smaller than the fastest level for half as much time again; more takes twice the time for 8 %."""

CHUNK_BYTES = 1 << 20
"""Of numbers that are compressed together, at the most."""

_NOT_WORTH_IT_BYTES = 4096  # Overhead of a compressed array.


def write_robomimic(
    path: Path | str, episodes: Iterable[Episode], masks: Mapping[str, range] = NO_MASKS, about: str = ""
) -> Path:
    """Write demonstrations as one HDF5 file atomically, and return its path.

    Args:
        path: The file.
        episodes: At least one, in the order of their numbers; a generator keeps one at a time in memory.
        masks: Name -> which demonstrations it has, in addition to `all` and `successful`.
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
            "scaled": json.dumps([change.to_json() for change in scaled_objects(episode.scene)]),
            "rate_hz": episode.rate_hz,
            "action_names": json.dumps(ACTION_NAMES),
            "action_scale": episode.action_scale,
            "subtasks": json.dumps([plain(asdict(span)) for span in episode.spans]),
            "query": episode.query,
            "paraphrases": json.dumps(episode.paraphrases),
            "cameras": json.dumps(plain(episode.cameras)),
        }
    )
    rewards = episode.rewards
    if rewards is None:
        rewards = np.zeros(length, dtype=np.float32)
        rewards[-1] = float(episode.succeeded)
    dones = np.zeros(length, dtype=np.int64)
    dones[-1] = 1
    columns: dict[str, NDArray[Any]] = {
        "actions": episode.actions,
        "actions_absolute": episode.actions_absolute,
        **episode.commanded,
    }
    for name, values in columns.items():
        _write_numbers(demo, name, values)
    _write_numbers(demo, "states", _states(episode)).attrs["columns"] = json.dumps(episode.state_names)
    if trajectory.packed_states:
        packed = np.frombuffer(b"".join(trajectory.packed_states), np.uint8).reshape(length + 1, -1)
        _write_numbers(demo, "packed_states", packed)
    if episode.about:
        # No attribute: these end at 64 kB.
        demo.create_dataset("about", data=episode.about)
    columns = {"rewards": rewards, "dones": dones, "time_s": trajectory.time_s}
    columns |= {"subtask": trajectory.subtask, "step": trajectory.step}
    columns |= {f"object_poses/{name}": quaternions_last(poses) for name, poses in trajectory.object_poses.items()}
    columns |= {f"joint_positions/{name}": positions for name, positions in trajectory.joint_positions.items()}
    for name, values in columns.items():
        _write_numbers(demo, name, values)
    _write_observations(demo, episode)
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
            _write_numbers(demo, f"obs/{name}", values[:-1])
            _write_numbers(demo, f"next_obs/{name}", values[1:])
    for view, pictures in episode.images.items():
        _write_pictures(demo, f"{view}_image", pictures)


def _write_numbers(group: Any, name: str, values: NDArray[Any]) -> Any:
    """Write (N, ...) numbers, compressed where that is worth it, and return the data set."""
    if values.nbytes <= _NOT_WORTH_IT_BYTES:
        return group.create_dataset(name, data=values)
    rows = min(len(values), max(CHUNK_BYTES * len(values) // values.nbytes, 1))
    return group.create_dataset(
        name,
        data=values,
        chunks=(rows, *values.shape[1:]),
        compression="gzip",
        compression_opts=COMPRESSION,
        shuffle=values.itemsize > 1,
    )


def _write_pictures(demo: Any, name: str, pictures: NDArray[Any]) -> None:
    """Write pictures, or clouds, each compressed by itself: those of the transitions, and the one after the last."""
    for group, some in (("obs", pictures[:-1]), (LAST, pictures[-1:])):
        demo.create_dataset(
            f"{group}/{name}",
            data=some,
            chunks=(1, *pictures.shape[1:]),
            compression="gzip",
            compression_opts=COMPRESSION,
        )


def _write_datagen_info(group: Any, episode: Episode) -> None:
    trajectory, rows = episode.trajectory, np.arange(episode.length)
    columns: dict[str, NDArray[Any]] = {"eef_pose": _matrices(trajectory.eef_pose[:-1])}
    columns["gripper_action"] = episode.actions[:, -1:]
    for name, poses in trajectory.object_poses.items():
        columns[f"object_poses/{name}"] = _matrices(poses[:-1])
    for number, span in enumerate(episode.spans, start=1):
        signal = ((rows >= span.end - 1) & span.succeeded).astype(np.int64)
        columns[f"subtask_term_signals/{number}_{span.name.replace('/', '_')}"] = signal
    for name, values in columns.items():
        _write_numbers(group, name, values)


def _objects(episode: Episode) -> NDArray[np.float32]:
    """Return (N, 7 K) poses of the objects with quaternions x y z w."""
    count = len(episode.object_poses)
    return quaternions_last(episode.object_poses.reshape(count, -1, 7)).reshape(count, -1)


def _states(episode: Episode) -> NDArray[np.float32]:
    """Return (T, D) the episode's states with quaternions x y z w."""
    objects = _objects(episode)[:-1]
    return np.concatenate([episode.states[:-1, : episode.states.shape[1] - objects.shape[1]], objects], axis=1)


def _matrices(poses: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (T, 4, 4) transforms of (T, 7) poses."""
    made = [transform_from_quaternion(pose[:3], pose[3:]) for pose in poses.astype(np.float64)]
    return np.array(made, dtype=np.float32).reshape(len(poses), 4, 4)


def _version() -> str:
    try:
        return metadata.version("scene2demo")
    except metadata.PackageNotFoundError:
        return "unknown"


@contextmanager
def new_hdf5(path: Path) -> Iterator[Any]:
    """Provide a new `h5py.File`; it becomes the file at `path` when the block ends without an exception.

    Args:
        path: The file; its folder is made when absent.

    Raises:
        OSError: The disk is full, or the folder cannot be written.
        MissingExtra: h5py is not installed.
    """
    h5py: Any = require("h5py", "data")
    with atomic_path(path) as temporary, _Patient(temporary) as stream:
        try:
            with h5py.File(stream, "w") as file:
                yield file
        finally:
            if stream.problem is not None:
                raise stream.problem


class _Patient(io.FileIO):
    """A file that accepts all writes, and keeps the first error of writing.

    Attributes:
        problem: The system's error; from then on nothing is written.
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
