"""Episode tables as demonstrations of one robomimic file, and back: a transition lies between two rows."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.data.episode import Episode, SubtaskSpan
from executor.data.formats.table import (
    CLOUD,
    CLOUD_SHAPE,
    DEMONSTRATION,
    DatasetSpec,
    EpisodeTable,
    camera_column,
    derived_columns,
    metadata_line,
)
from executor.data.formats.videos import Clip, ReadClip
from executor.data.robomimic import ABOUT, LAST, write_robomimic
from executor.data.state_readers import ENVIRONMENT
from executor.records import Trajectory
from executor.sim.render.frames import Frames
from executor.sim.robot.actions import HAND_NUMBERS, TARGETS
from executor.system.extras import require
from executor.system.files import plain
from oag import Scene, Task

FILE = "demonstrations.hdf5"
_COMMANDED = {"actions_hand": HAND_NUMBERS, "actions_absolute": TARGETS}
_STATE = {"robot_qpos": TARGETS, "eef_pos": 3, "eef_quat": 4, "gripper_opening": 1}
_SHUFFLE, _DEFLATE = 2, 1  # As HDF5 numbers its filters.
_FILTERS = ((), (_DEFLATE,), (_SHUFFLE, _DEFLATE))
_MOST_CHUNK_BYTES = 4_000_000  # A picture of the largest size takes 3 MB.
_ITEM_BYTES = 8


def write_demonstrations(episodes: Iterable[EpisodeTable], found: DatasetSpec, folder: Path) -> None:
    """Write one file with all episodes into a folder, with the masks `train`, `valid` and `corrections`.

    Args:
        episodes: The episodes, in order; one at a time is in memory.
        found: Their common properties.
        folder: An existing folder.

    Raises:
        VideoFailed: An episode's video is unreadable.
        MissingExtra: h5py is not installed, or PyAV where there are videos.
        OSError: The folder cannot be written.
    """
    parts = found.splits
    masks = {"train": parts["train"], "valid": parts["validation"]}
    if found.corrections:
        masks["corrections"] = parts["corrections"]
    about = json.dumps(plain(found.to_json()))
    write_robomimic(folder / FILE, (_demonstration(episode, found) for episode in episodes), masks, about)


def read_demonstrations(folder: Path) -> tuple[DatasetSpec, Callable[[], Iterator[EpisodeTable]]]:
    """Read a file of this program: its common properties, and an iteration over its episodes.

    Args:
        folder: Folder of the file.

    Raises:
        OSError, ValueError, KeyError, TypeError, IndexError: It was not written by this program; raised here or during
            the iteration.
        MissingExtra: h5py is not installed.
    """
    h5py: Any = require("h5py", "data")
    with h5py.File(folder / FILE) as file:
        found = DatasetSpec.from_json(json.loads(file["data"].attrs[ABOUT]))
    return found, partial(_episodes, folder / FILE, found)


def _demonstration(episode: EpisodeTable, found: DatasetSpec) -> Episode:
    about, columns = episode.about, episode.columns
    scene = Scene.from_json(about["scene"])
    frames, maps = None, {}
    for view in found.views:
        for kind in found.channels:
            maps[f"{view}_{kind}"] = np.stack(list(episode.clips[view, kind].pictures()))[..., None]
    if found.views:
        pictures = {view: np.stack(list(episode.clips[view, ""].pictures())) for view in found.views}
        frames = Frames(pictures, next(iter(found.views.values())))
    named = {"object": "observation.object_poses", "joints": "observation.joint_positions"}
    named |= {"environment_state": "observation.environment_state"}
    named |= {f"{view}_camera_pose": camera_column(view) for view in found.views}
    named |= {"point_cloud": CLOUD} if found.point_cloud else {}
    return Episode.from_samples(
        task=Task.from_json(about["task"], scene=scene),
        scene=scene,
        seed=int(about["unit"]["seed"]),
        succeeded=about["kind"] == DEMONSTRATION,
        state_hash=str(about["state_hash"]),
        trajectory=_trajectory(episode, found),
        spans=tuple(
            SubtaskSpan(
                name=entry["name"],
                detail=entry["detail"],
                init=entry["init"],
                goal=entry["goal"],
                flow=[step["action"] for step in entry["steps"]],
                first=entry["span"][0],
                end=entry["span"][1],
                succeeded=about["kind"] == DEMONSTRATION,
            )
            for entry in about["subtasks"]
            if entry["span"] is not None
        ),
        frames=frames,
        observations={
            **{name: columns[column] for name, column in named.items() if column in columns},
            "primitive": columns["primitive_index"][:, None].astype(np.float32),
            **maps,
        },
        commanded={"actions_hand": columns["action"][:-1]},
        rewards=columns["next.reward"][1:],
        about=metadata_line(about),
        query=episode.task,
        paraphrases=tuple(about.get("paraphrases") or ()),
        cameras={view: (about["pictures"] or {})["views"][view] for view in found.views},
    )


def _trajectory(episode: EpisodeTable, found: DatasetSpec) -> Trajectory:
    """Return the motion of an episode's rows, without the engine's states."""
    about, columns, count = episode.about, episode.columns, episode.length
    state, targets = columns["observation.state"], columns["action.joint_target"]
    first = np.asarray(about["first_target"], np.float32)[None]
    poses = columns.get("observation.object_poses", np.zeros((count, 0), np.float32))
    steps = np.full(count, -1, np.int32)
    for entry in about["subtasks"]:
        for number, step in enumerate(entry["steps"]):
            if step["span"] is not None:
                steps[slice(*step["span"])] = number
    return Trajectory(
        time_s=about["starts_s"] + np.arange(count) / found.rate_hz,
        robot_qpos=state[:, :12],
        robot_qvel=columns["observation.velocity"],
        robot_target=np.concatenate([first, targets[:-1]]),
        eef_pose=_quaternions_first(state[:, 12:19]),
        object_poses={
            name: _quaternions_first(poses[:, 7 * k : 7 * k + 7]) for k, name in enumerate(about["object_ids"])
        },
        joint_positions=_joints(about["joint_names"], columns),
        subtask=columns["subtask_index"].astype(np.int32),
        step=steps,
        packed_states=(),
    )


def _joints(names: list[str], columns: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[np.float32]]:
    """Return id -> (N, J) joints of each articulated object."""
    found: dict[str, list[int]] = {}
    for number, name in enumerate(names):
        found.setdefault(name.rpartition("/")[0], []).append(number)
    return {owner: columns["observation.joint_positions"][:, numbers] for owner, numbers in found.items()}


def _quaternions_first(poses: NDArray[np.float32]) -> NDArray[np.float32]:
    """Reorder (N, 7) poses from quaternions x y z w to w x y z."""
    return poses[:, [0, 1, 2, 6, 3, 4, 5]]


def _episodes(path: Path, found: DatasetSpec) -> Iterator[EpisodeTable]:
    h5py: Any = require("h5py", "data")
    with h5py.File(path) as file:
        for index in range(found.count):
            yield _episode(file["data"][f"demo_{index}"], index, found)


def _episode(demo: Any, index: int, found: DatasetSpec) -> EpisodeTable:
    about = json.loads(demo["about"].asstr()[()])
    count = found.check_length(len(demo["actions_hand"]) + 1)

    def rows(name: str, *sides: int) -> NDArray[Any]:
        """Return the observations before each transition, and after the last one."""
        before, after = _Numbers(demo, f"obs/{name}", sides), _Numbers(demo, f"{_after(demo, name)}/{name}", sides)
        return np.concatenate([before.rows(0, count - 1), after.rows(len(after) - 1, len(after))])

    actions, targets = (_Numbers(demo, name, (n,)).rows(0, count - 1) for name, n in _COMMANDED.items())
    # After the last transition there is no command, and the drives hold.
    still = np.zeros_like(actions[-1:])
    still[:, 6] = actions[-1, 6]
    state = [rows(name, sides) for name, sides in _STATE.items()]
    columns = {
        "observation.state": np.concatenate(state, axis=1),
        "observation.velocity": rows("robot_qvel", TARGETS),
        "observation.environment_state": rows("environment_state", ENVIRONMENT),
        **({"observation.object_poses": rows("object", 7 * found.objects)} if found.objects else {}),
        **({"observation.joint_positions": rows("joints", found.joints)} if found.joints else {}),
        **{camera_column(view): rows(f"{view}_camera_pose", 7) for view in found.views},
        "action": np.concatenate([actions, still]),
        "action.joint_target": np.concatenate([targets, targets[-1:]]),
        **({CLOUD: rows("point_cloud", *CLOUD_SHAPE)} if found.point_cloud else {}),
        **derived_columns(about, count),
    }
    clips: dict[tuple[str, str], Clip] = {}
    for view, kind in found.clips:
        name, sides = f"{view}_{kind or 'image'}", (*found.views[view][::-1], 1 if kind else 3)
        pictures = partial(_pictures, demo, name, sides, count)
        clips[view, kind] = ReadClip(f"{demo.file.filename}, {name}", pictures)
    return EpisodeTable(index, columns, clips, about)


def _after(demo: Any, name: str) -> str:
    """Return the group of the observation after the last transition; older files had pictures in next_obs, too."""
    return LAST if f"{LAST}/{name}" in demo else "next_obs"


def _pictures(demo: Any, name: str, sides: tuple[int, ...], count: int) -> Iterator[NDArray[Any]]:
    before, after = _Numbers(demo, f"obs/{name}", sides), _Numbers(demo, f"{_after(demo, name)}/{name}", sides)
    for place in range(count):
        picture = before.rows(place, place + 1)[0] if place + 1 < count else after.rows(len(after) - 1, len(after))[0]
        yield picture[..., 0] if sides[-1] == 1 else picture


class _Numbers:
    """Array of a demonstration; no more is decompressed than its shape states.

    Args:
        demo: Its group.
        name: Its name there.
        sides: Required shape of a row.

    Raises:
        KeyError: There is none.
        ValueError: Its data is in another file, of another shape, or compressed differently.
    """

    def __init__(self, demo: Any, name: str, sides: tuple[int, ...]) -> None:
        self._data, self._name = demo[name], f"{demo.name}/{name}"
        if self._data.is_virtual or self._data.external or self._data.file.filename != demo.file.filename:
            raise ValueError(f"{self._name} is kept in another file")
        if (
            self._data.shape[1:] != sides
            or self._data.dtype.kind not in "fiu"
            or self._data.dtype.itemsize > _ITEM_BYTES
        ):
            raise ValueError(
                f"{self._name} has the shape {self._data.shape} of {self._data.dtype}: expected rows of {sides}"
            )
        properties = self._data.id.get_create_plist()
        self._filters = tuple(properties.get_filter(k)[0] for k in range(properties.get_nfilters()))
        self._chunk_bytes = math.prod(self._data.chunks or ()) * self._data.dtype.itemsize
        whole = self._data.chunks is None or self._data.chunks[1:] == sides
        if self._filters not in _FILTERS or not whole or self._chunk_bytes > _MOST_CHUNK_BYTES:
            raise ValueError(f"{self._name} is not packed as this program does it")

    def __len__(self) -> int:
        return len(self._data)

    def rows(self, first: int, end: int) -> NDArray[Any]:
        """Return the rows from `first` up to, but not including, `end`.

        Raises:
            ValueError: There are fewer, or a chunk is corrupt.
        """
        if not 0 <= first <= end <= len(self._data):
            raise ValueError(f"{self._name} has {len(self._data)} rows, and not {first} to {end}")
        if self._data.chunks is None:
            return np.asarray(self._data[first:end])
        each = self._data.chunks[0]
        found = np.empty((end - first, *self._data.shape[1:]), self._data.dtype)
        for start in range(first - first % each, end, each):
            begin, until = max(start, first), min(start + each, end)
            found[begin - first : until - first] = self._chunk(start)[begin - start : until - start]
        return found

    def _chunk(self, start: int) -> NDArray[Any]:
        """Return the rows of the chunk that begins at a row. HDF5's own filter would decompress without a limit."""
        where = (start, *(0 for _ in self._data.shape[1:]))
        if self._data.id.get_chunk_info_by_coord(where).size > 2 * _MOST_CHUNK_BYTES:
            raise ValueError(f"a chunk of {self._name} is too large")
        left_out, content = self._data.id.read_direct_chunk(where)
        for place, kind in reversed(list(enumerate(self._filters))):
            if left_out >> place & 1:
                continue
            if kind == _DEFLATE:
                try:
                    content = zlib.decompressobj().decompress(content, self._chunk_bytes + 1)
                except zlib.error as problem:
                    raise ValueError(f"a chunk of {self._name} is torn: {problem}") from None
            elif len(content) == self._chunk_bytes:
                content = np.frombuffer(content, np.uint8).reshape(self._data.dtype.itemsize, -1).T.tobytes()
        if len(content) != self._chunk_bytes:
            raise ValueError(f"a chunk of {self._name} is torn")
        return np.frombuffer(content, self._data.dtype).reshape(self._data.chunks)
