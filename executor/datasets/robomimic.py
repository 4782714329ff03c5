"""robomimic's HDF5: one file, `data/demo_<i>` a demonstration, read by its `SequenceDataset` without conversion.

Layout, with T transitions:

    data                        attrs: total, env_args (JSON: env_name, type, env_kwargs), scene2demo_version
      demo_0                    attrs: num_samples = T, success, seed, state_hash, task, task_detail, scene (JSON),
                                rate_hz, action_names, action_scale, subtasks (JSON)
        actions                 (T, 11) float32 in [-1, 1]; see `executor.episode.Episode.actions`
        actions_absolute        (T, 12) float32 drive targets in m and rad
        states                  (T, D) float32; attrs columns
        packed_states           (T + 1, L) uint8: exact states of the physics engine, for replay
        rewards, dones          (T,): 1 at the last transition of a success; done at the last transition
        time_s                  (T + 1,) float64
        subtask, step           (T + 1,) int32; step -1 while the world settles between steps
        obs, next_obs           robot_qpos (12), robot_qvel (12), eef_pos (3), eef_quat (4, w x y z),
                                gripper_opening (1), joints (J), object (7 K), and where rendered
                                <view>_image (H, W, 3) uint8
        object_poses/<id>       (T + 1, 7) position and quaternion w x y z
        joint_positions/<id>    (T + 1, J)
        datagen_info            eef_pose (T, 4, 4), gripper_action (T, 1), object_poses/<id> (T, 4, 4),
                                subtask_term_signals/<subtask> (T,): 1 from the end of the subtask on
    mask/all, mask/successful   names of demonstrations

Source: the layout that robomimic 0.3 and 0.5 read, and MimicGen's `datagen_info`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.datasets.hdf5_file import new_hdf5
from executor.episode import ACTION_NAMES, Episode
from executor.extras import require
from executor.files import plain
from executor.geometry import transform_from_quaternion

ENVIRONMENT_TYPE = 2  # robomimic's number for a gym-like environment.


def write_robomimic(path: Path | str, episodes: Sequence[Episode]) -> Path:
    """Writes demonstrations as one HDF5 file and returns its path; the file appears only when it is complete.

    Args:
        path: The file.
        episodes: At least one, in the order of their numbers.

    Raises:
        ValueError: When there are no episodes.
        OSError: When the disk is full, or the folder cannot be written.
    """
    if not episodes:
        raise ValueError("expected at least one episode to write, got none")
    with new_hdf5(Path(path)) as file:
        data = file.create_group("data")
        data.attrs["total"] = sum(episode.length for episode in episodes)
        data.attrs["env_args"] = json.dumps(_environment(episodes[0]))
        data.attrs["scene2demo_version"] = _version()
        for index, episode in enumerate(episodes):
            _write_demo(data.create_group(f"demo_{index}"), episode)
        names = [f"demo_{index}".encode() for index in range(len(episodes))]
        good = [name for name, episode in zip(names, episodes, strict=True) if episode.rollout.succeeded]
        file.create_dataset("mask/all", data=np.array(names, dtype="S"))
        file.create_dataset("mask/successful", data=np.array(good, dtype="S16"))
    return Path(path)


def _write_demo(demo: Any, episode: Episode) -> None:
    rollout, length = episode.rollout, episode.length
    trajectory = rollout.trajectory
    demo.attrs.update(
        {
            "num_samples": length,
            "success": rollout.succeeded,
            "seed": rollout.seed,
            "state_hash": rollout.state_hash,
            "task": rollout.task.name,
            "task_detail": rollout.task.detail,
            "scene": json.dumps(plain(rollout.scene.to_json())),
            "rate_hz": episode.rate_hz,
            "action_names": json.dumps(ACTION_NAMES),
            "action_scale": episode.action_scale,
            "subtasks": json.dumps([plain(asdict(span)) for span in episode.spans]),
        }
    )
    rewards = np.zeros(length, dtype=np.float32)
    rewards[-1] = float(rollout.succeeded)
    dones = np.zeros(length, dtype=np.int64)
    dones[-1] = 1
    packed = np.frombuffer(b"".join(trajectory.packed_states), np.uint8).reshape(length + 1, -1)
    demo.create_dataset("actions", data=episode.actions)
    demo.create_dataset("actions_absolute", data=episode.actions_absolute)
    demo.create_dataset("states", data=episode.states[:-1]).attrs["columns"] = json.dumps(episode.state_names)
    demo.create_dataset("packed_states", data=packed, compression="gzip", compression_opts=1)
    demo.create_dataset("rewards", data=rewards)
    demo.create_dataset("dones", data=dones)
    demo.create_dataset("time_s", data=trajectory.time_s)
    demo.create_dataset("subtask", data=trajectory.subtask)
    demo.create_dataset("step", data=trajectory.step)
    _write_observations(demo, episode)
    for name, poses in trajectory.object_poses.items():
        demo.create_dataset(f"object_poses/{name}", data=poses)
    for name, positions in trajectory.joint_positions.items():
        demo.create_dataset(f"joint_positions/{name}", data=positions)
    _write_datagen_info(demo.create_group("datagen_info"), episode)


def _write_observations(demo: Any, episode: Episode) -> None:
    h5py: Any = require("h5py", "data")

    trajectory, length = episode.rollout.trajectory, episode.length
    columns = {
        "robot_qpos": trajectory.robot_qpos,
        "robot_qvel": trajectory.robot_qvel,
        "eef_pos": trajectory.eef_pose[:, :3],
        "eef_quat": trajectory.eef_pose[:, 3:],
        "gripper_opening": trajectory.robot_qpos[:, 10:12].sum(axis=1, keepdims=True),
        "joints": episode.joint_positions,
        "object": episode.object_poses,
    }
    for name, values in columns.items():
        if values.shape[1]:
            demo.create_dataset(f"obs/{name}", data=values[:-1])
            demo.create_dataset(f"next_obs/{name}", data=values[1:])
    for view, pictures in episode.images.items():
        # Every picture is stored once; obs and next_obs are windows on it, one sample apart.
        stored = demo.create_dataset(
            f"images/{view}",
            data=pictures,
            chunks=(1, *pictures.shape[1:]),
            compression="gzip",
            compression_opts=1,
            shuffle=False,
        )
        for group, first in (("obs", 0), ("next_obs", 1)):
            layout = h5py.VirtualLayout((length, *pictures.shape[1:]), dtype=np.uint8)
            source = h5py.VirtualSource(".", stored.name, shape=stored.shape, dtype=np.uint8)
            layout[:] = source[first : first + length]
            demo.create_virtual_dataset(f"{group}/{view}_image", layout)


def _write_datagen_info(group: Any, episode: Episode) -> None:
    trajectory, length = episode.rollout.trajectory, episode.length
    group.create_dataset("eef_pose", data=_matrices(trajectory.eef_pose[:-1]))
    group.create_dataset("gripper_action", data=episode.actions[:, -1:])
    for name, poses in trajectory.object_poses.items():
        group.create_dataset(f"object_poses/{name}", data=_matrices(poses[:-1]))
    rows = np.arange(length)
    for number, span in enumerate(episode.spans, start=1):
        signal = ((rows >= span.end - 1) & span.succeeded).astype(np.int64)
        group.create_dataset(f"subtask_term_signals/{number}_{span.name.replace('/', '_')}", data=signal)


def _matrices(poses: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (T, 4, 4) transforms of (T, 7) poses."""
    made = [transform_from_quaternion(pose[:3], pose[3:]) for pose in poses.astype(np.float64)]
    return np.array(made, dtype=np.float32).reshape(len(poses), 4, 4)


def _environment(episode: Episode) -> dict[str, Any]:
    """Returns robomimic's `env_args`; its documentation says env_type, its code reads `type`."""
    arguments = {
        "scene": episode.rollout.scene.name,
        "task": episode.rollout.task.name,
        "control_freq": episode.rate_hz,
        "cameras": sorted(episode.images),
    }
    return {"env_name": "Scene2Demo-v0", "type": ENVIRONMENT_TYPE, "env_kwargs": arguments}


def _version() -> str:
    try:
        return metadata.version("scene2demo")
    except metadata.PackageNotFoundError:
        return "unknown"
