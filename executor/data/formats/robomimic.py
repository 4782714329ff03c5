"""robomimic's HDF5: one file, `data/demo_<i>` a demonstration, read by its `SequenceDataset` without conversion.

Layout, with T transitions:

    data                        attrs: total, env_args (JSON: type, env_kwargs), scene2demo_version, and of a data set
                                scene2demo (JSON: what all demonstrations have in common)
      demo_0                    attrs: num_samples = T, success, seed, state_hash, task, task_detail, scene (JSON),
                                scaled (JSON: objects at another size than they are drawn with), rate_hz,
                                action_names, action_scale, joint_names (JSON: of a row of robot_qpos, of robot_qvel
                                and of actions_absolute), subtasks (JSON); query and paraphrases (JSON), the sentence
                                that was typed and others for it; scene_fixes (JSON), where the scene was changed;
                                cameras (JSON, by view): size, fov_y_rad, intrinsics (3 x 3, pixels), mount (a link of
                                the robot, or null for the world) and T_mount_camera
                                (4 x 4; x ahead, y left, z up)
        actions                 (T, Q + 1) float32 in [-1, 1]; action_names: displacement of the base in its own frame
                                and of the arm's joints, commanded for the interval and divided by action_scale; the
                                gripper's commanded opening, -1 shut and 1 as far as the robot's fingers open
        actions_absolute        (T, J) float32 drive targets in m and rad, joints by the robot's record
        actions_hand            (T, H) float32 in m and rad, in data sets; see `hand_actions` of the robot
        states                  (T, D) float32; attrs columns
        packed_states           (T + 1, L) uint8: exact states of the physics engine, for replay; not in data sets
        about                   (JSON, of a data set) what else there is to say; `docs/datasets.md` documents it
        rewards, dones          (T,): 1 at the last transition of a success, in data sets 1 / number of subtasks where
                                each ends; done at the last transition
        time_s                  (T + 1,) float64
        subtask, step           (T + 1,) int32; step -1 while the world settles between steps
        obs, next_obs           robot_qpos (J), robot_qvel (J), eef_pos (3), eef_quat (4),
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
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bddl.files import atomic_path
from executor.data.episode import CLOUD, ArrayClip, Clip, Episode, camera_column, metadata_line
from executor.data.state_readers import AGENT_MORE
from executor.geometry import transform_from_quaternion
from executor.sim.robot.actions import joint_limits
from executor.system.extras import require
from executor.system.files import plain
from oag import Scene
from oag.model.robots import Robot
from oag.sizes import scaled_objects

FILE = "demonstrations.hdf5"
"""Name of the file of a data set."""

# Fastest motion that an action of 1 stands for: m/s, m/s, rad/s and m/s for the base, rad/s for each arm joint.
_BASE_RATES, _ARM_RATE = (1.0, 1.0, 2.0, 0.3), 3.0


def action_names(robot: Robot) -> tuple[str, ...]:
    """Return the names of the numbers of `actions`."""
    base = ("base_forward", "base_left", "base_turn", "lift")[: len(robot.base_joints)]
    return (*base, *(f"arm_joint{index}" for index, _ in enumerate(robot.arm_joints, start=1)), "gripper")


def action_rates(robot: Robot) -> NDArray[np.float64]:
    """Return (Q,) the fastest motions, which actions of 1 stand for."""
    return np.array([*_BASE_RATES[: len(robot.base_joints)], *[_ARM_RATE] * len(robot.arm_joints)])


# robomimic's trainer reads both of every file, `type` as one of its numbers (2 is a gym-like one). It makes an
# environment only of an `env_name`, to roll its policies out in; there is none to name, so that has to be off.
ENVIRONMENT = {"type": 2, "env_kwargs": {}}
NO_MASKS: Mapping[str, range] = MappingProxyType({})
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
        about: What all of a data set have in common, as JSON; empty where they are none, and say no more of themselves.

    Raises:
        ValueError: When there are no episodes.
        OSError: When the disk is full, or the folder cannot be written.
    """
    with new_hdf5(Path(path)) as file:
        data = file.create_group("data")
        good: list[int] = []
        count = total = 0
        for episode in episodes:
            _write_demo(data.create_group(f"demo_{count}"), episode, with_about=bool(about))
            good += [count] if episode.succeeded else []
            count, total = count + 1, total + episode.length - 1
        if not count:
            raise ValueError("expected at least one episode to write, got none")
        data.attrs["total"] = total
        data.attrs["env_args"] = json.dumps(ENVIRONMENT)
        data.attrs["scene2demo_version"] = _version()
        if about:
            data.attrs["scene2demo"] = about
        for name, numbers in {"all": range(count), "successful": good, **masks}.items():
            file.create_dataset(f"mask/{name}", data=np.array([f"demo_{k}".encode() for k in numbers], dtype="S16"))
    return Path(path)


def _write_demo(demo: Any, episode: Episode, *, with_about: bool) -> None:
    about, columns, recorded = episode.about, episode.columns, episode.recorded
    scene, length = Scene.from_json(about["scene"]), episode.length - 1
    spans = [_span(entry, succeeded=episode.succeeded) for entry in about["subtasks"]]
    rate_hz = 1.0 / float(np.median(np.diff(recorded["time_s"])))
    robot = scene.robot.model
    scale, width = action_rates(robot) / rate_hz, len(robot.joint_names)
    qpos, targets = columns["observation.state"][:, :width], columns["action.joint_target"][:-1]
    actions = normalised_actions(qpos, targets, scale, float(joint_limits(robot)[-1, 1]))
    views = [view for view, kind in episode.clips if not kind]
    demo.attrs.update(
        {
            "num_samples": length,
            "success": episode.succeeded,
            "seed": int(about["unit"]["seed"]),
            "state_hash": str(about["state_hash"]),
            "task": about["task"]["task_activity_name"],
            "task_detail": about["task"]["task_detail_message"],
            "scene": json.dumps(plain(scene.to_json())),
            "scaled": json.dumps([change.to_json() for change in scaled_objects(scene)]),
            "rate_hz": round(rate_hz, 6),
            "action_names": json.dumps(action_names(robot)),
            "action_scale": scale,
            "joint_names": json.dumps(robot.joint_names),
            "subtasks": json.dumps([span for span in spans if span is not None]),
            "query": episode.task,
            "paraphrases": json.dumps(about["paraphrases"] or ()),
            "cameras": json.dumps({view: about["pictures"]["views"][view] for view in views}),
            **({"scene_fixes": json.dumps(about["scene_fixes"])} if "scene_fixes" in about else {}),
        }
    )
    _write_numbers(demo, "actions", actions)
    _write_numbers(demo, "actions_absolute", targets)
    if "action" in columns:
        _write_numbers(demo, "actions_hand", columns["action"][:-1])
    objects, joints = _objects(episode), _joints(episode)
    parts = [qpos, columns["observation.velocity"], *joints.values(), *objects.values()]
    names = [f"robot_qpos:{width}", f"robot_qvel:{width}"]
    names += [f"{name}/{k}:1" for name, positions in joints.items() for k in range(positions.shape[1])]
    names += [f"{name}:7" for name in objects]
    states = np.concatenate(parts, axis=1, dtype=np.float32)[:-1]
    _write_numbers(demo, "states", states).attrs["columns"] = json.dumps(names)
    if "packed_states" in recorded:
        _write_numbers(demo, "packed_states", recorded["packed_states"].view(np.uint8))
    if with_about:
        # No attribute: these end at 64 kB.
        demo.create_dataset("about", data=metadata_line(about))
    dones = np.zeros(length, dtype=np.int64)
    dones[-1] = 1
    rows = {"rewards": columns["next.reward"][1:], "dones": dones}
    rows |= {name: recorded[name] for name in ("time_s", "subtask", "step")}
    rows |= {f"object_poses/{name}": poses for name, poses in objects.items()}
    rows |= {f"joint_positions/{name}": positions for name, positions in joints.items()}
    for name, values in rows.items():
        _write_numbers(demo, name, values)
    _write_observations(demo, episode)
    _write_datagen_info(demo.create_group("datagen_info"), episode, objects, spans, actions)


def normalised_actions(
    qpos: NDArray[np.float32], targets: NDArray[np.float32], scale: NDArray[np.float64], opening_m: float
) -> NDArray[np.float32]:
    """Return (N - 1, Q + 1) the actions of every transition, clipped to [-1, 1].

    Args:
        qpos: (N, J) joint positions.
        targets: (N - 1, J) what was commanded between them.
        scale: (Q,) displacement that an action of 1 stands for.
        opening_m: How far one finger of the robot opens.
    """
    now = qpos[:-1].astype(np.float64)
    movers = len(scale)
    moves = targets[:, :movers].astype(np.float64) - now[:, :movers]
    cosine, sine = np.cos(now[:, 2]), np.sin(now[:, 2])
    forward = cosine * moves[:, 0] + sine * moves[:, 1]
    left = -sine * moves[:, 0] + cosine * moves[:, 1]
    moves[:, 0], moves[:, 1] = forward, left
    gripper = targets[:, movers:].mean(axis=1, keepdims=True) / opening_m * 2.0 - 1.0
    return np.clip(np.concatenate([moves / scale, gripper], axis=1), -1.0, 1.0).astype(np.float32)


def _span(entry: Mapping[str, Any], *, succeeded: bool) -> dict[str, Any] | None:
    """Return where a subtask lies: samples `first` up to, but not including, `end`; None without samples."""
    if entry["span"] is None:
        return None
    first, end = entry["span"]
    return {
        **{name: entry[name] for name in ("name", "detail", "init", "goal")},
        "flow": [step["action"] for step in entry["steps"]],
        "first": first,
        "end": end,
        "succeeded": entry.get("succeeded", succeeded),
    }


def _objects(episode: Episode) -> dict[str, NDArray[np.float32]]:
    """Return id -> (N, 7) pose of each movable object, without the room for more."""
    poses = _wide(episode, "observation.object_poses")
    return {name: poses[:, 7 * k : 7 * k + 7] for k, name in enumerate(episode.about["object_ids"])}


def _joints(episode: Episode) -> dict[str, NDArray[np.float32]]:
    """Return id -> (N, J) joints of each articulated object."""
    found: dict[str, list[int]] = {}
    for number, name in enumerate(episode.about["joint_names"]):
        found.setdefault(name.rpartition("/")[0], []).append(number)
    positions = _wide(episode, "observation.joint_positions")
    return {owner: positions[:, numbers] for owner, numbers in found.items()}


def _wide(episode: Episode, name: str) -> NDArray[np.float32]:
    """Return a column that a set without such things does not have."""
    return episode.columns.get(name, np.zeros((episode.length, 0), np.float32))


def _write_observations(demo: Any, episode: Episode) -> None:
    state = episode.columns["observation.state"]
    joints = state.shape[1] - AGENT_MORE
    columns = {
        "robot_qpos": state[:, :joints],
        "robot_qvel": episode.columns["observation.velocity"],
        "eef_pos": state[:, joints : joints + 3],
        "eef_quat": state[:, joints + 3 : joints + 7],
        "gripper_opening": state[:, joints + 7 :],
        "joints": _wide(episode, "observation.joint_positions"),
        "object": _wide(episode, "observation.object_poses"),
    }
    named = {"environment_state": "observation.environment_state"}
    named |= {f"{view}_camera_pose": camera_column(view) for view, kind in episode.clips if not kind}
    named |= {"point_cloud": CLOUD}
    columns |= {name: episode.columns[column] for name, column in named.items() if column in episode.columns}
    if "primitive_index" in episode.columns:
        columns["primitive"] = episode.columns["primitive_index"][:, None].astype(np.float32)
    for name, values in columns.items():
        if values.ndim > 2:
            _write_pictures(demo, name, values)
        elif values.shape[1]:
            _write_numbers(demo, f"obs/{name}", values[:-1])
            _write_numbers(demo, f"next_obs/{name}", values[1:])
    # Colours come last.
    for (view, kind), clip in sorted(episode.clips.items(), key=lambda one: not one[0][1]):
        pictures = _stacked(clip)
        _write_pictures(demo, f"{view}_{kind or 'image'}", pictures[..., None] if kind else pictures)


def _stacked(clip: Clip) -> NDArray[Any]:
    return clip.array if isinstance(clip, ArrayClip) else np.stack(list(clip.pictures()))


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
    for group, some in (("obs", pictures[:-1]), ("last_obs", pictures[-1:])):
        demo.create_dataset(
            f"{group}/{name}",
            data=some,
            chunks=(1, *pictures.shape[1:]),
            compression="gzip",
            compression_opts=COMPRESSION,
        )


def _write_datagen_info(
    group: Any,
    episode: Episode,
    objects: Mapping[str, NDArray[np.float32]],
    spans: Iterable[Mapping[str, Any] | None],
    actions: NDArray[np.float32],
) -> None:
    rows = np.arange(episode.length - 1)
    columns: dict[str, NDArray[Any]] = {"eef_pose": _matrices(episode.columns["observation.state"][:-1, -8:-1])}
    columns["gripper_action"] = actions[:, -1:]
    for name, poses in objects.items():
        columns[f"object_poses/{name}"] = _matrices(poses[:-1])
    for number, span in enumerate((span for span in spans if span is not None), start=1):
        signal = ((rows >= span["end"] - 1) & span["succeeded"]).astype(np.int64)
        columns[f"subtask_term_signals/{number}_{span['name'].replace('/', '_')}"] = signal
    for name, values in columns.items():
        _write_numbers(group, name, values)


def _matrices(poses: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (T, 4, 4) transforms of (T, 7) poses with quaternions x y z w."""
    made = [transform_from_quaternion(pose[:3], pose[[6, 3, 4, 5]]) for pose in poses.astype(np.float64)]
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
