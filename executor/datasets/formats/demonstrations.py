"""Episodes as the demonstrations of robomimic's file, and back: a demonstration has a transition between two rows."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.datasets.formats.stream import (
    CHANNELS,
    CLOUD,
    DEMONSTRATION,
    FoldedEpisode,
    Survey,
    about_text,
    camera_column,
    told_rows,
)
from executor.datasets.formats.videos import Clip, ReadClip
from executor.machine.extras import require
from executor.machine.files import plain
from executor.pictures.frames import Frames
from executor.records.rollout import Trajectory
from executor.results.episode import Episode, SubtaskSpan
from executor.results.robomimic import ABOUT, LAST, write_robomimic
from oag import Scene, Task

FILE = "demonstrations.hdf5"


def write_demonstrations(episodes: Iterable[FoldedEpisode], found: Survey, folder: Path) -> None:
    """Writes one file with all episodes into a folder; masks `train`, `valid`, `corrections` say which is for what.

    Args:
        episodes: In order; one at a time is in memory.
        found: What they have in common.
        folder: It exists.

    Raises:
        VideoFailed: An episode's video cannot be read.
        MissingExtra: h5py is not installed, or PyAV where there are videos.
        OSError: The folder cannot be written.
    """
    parts = found.splits
    masks = {"train": parts["train"], "valid": parts["validation"]}
    if found.corrections:
        masks["corrections"] = parts["corrections"]
    about = json.dumps(plain(found.to_json()))
    write_robomimic(folder / FILE, (_demonstration(episode, found) for episode in episodes), masks, about)


def read_demonstrations(folder: Path) -> tuple[Survey, Callable[[], Iterator[FoldedEpisode]]]:
    """Returns what a file that this program wrote has in common, and what goes through its episodes.

    Args:
        folder: Where the file is.

    Raises:
        OSError, ValueError, KeyError, TypeError, IndexError: It is none that this program wrote, here or later.
        MissingExtra: h5py is not installed.
    """
    h5py: Any = require("h5py", "data")
    with h5py.File(folder / FILE) as file:
        found = Survey.from_json(json.loads(file["data"].attrs[ABOUT]))
    return found, partial(_episodes, folder / FILE, found)


def _demonstration(episode: FoldedEpisode, found: Survey) -> Episode:
    about, columns = episode.about, episode.columns
    scene = Scene.from_json(about["scene"])
    frames, maps = None, {}
    for view in found.views:
        for kind in found.channels:
            maps[f"{view}_{kind}"] = np.stack(list(episode.clips[view, kind].pictures()))[..., None]
    if found.views:
        seen = {view: np.stack(list(episode.clips[view, ""].pictures())) for view in found.views}
        frames = Frames(seen, next(iter(found.views.values())))
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
        about=about_text(about),
        query=episode.task,
        paraphrases=tuple(about.get("paraphrases") or ()),
        cameras={view: (about["pictures"] or {})["views"][view] for view in found.views},
    )


def _trajectory(episode: FoldedEpisode, found: Survey) -> Trajectory:
    """Returns the motion that an episode's rows are of, without the engine's states."""
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
    """Returns id -> (N, J) joints of each articulated object."""
    found: dict[str, list[int]] = {}
    for number, name in enumerate(names):
        found.setdefault(name.rpartition("/")[0], []).append(number)
    return {owner: columns["observation.joint_positions"][:, numbers] for owner, numbers in found.items()}


def _quaternions_first(poses: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns (N, 7) poses with their quaternions as w x y z, of some with x y z w."""
    return poses[:, [0, 1, 2, 6, 3, 4, 5]]


def _episodes(path: Path, found: Survey) -> Iterator[FoldedEpisode]:
    h5py: Any = require("h5py", "data")
    with h5py.File(path) as file:
        for index in range(found.count):
            yield _episode(file["data"][f"demo_{index}"], index, found)


def _episode(demo: Any, index: int, found: Survey) -> FoldedEpisode:
    about = json.loads(demo["about"].asstr()[()])

    def rows(name: str) -> NDArray[Any]:
        """Return what there is to see before each transition, and after the last one."""
        return np.concatenate([_own(demo, f"obs/{name}")[:], _own(demo, f"{_after(demo, name)}/{name}")[-1:]])

    actions, targets = _own(demo, "actions_hand")[:], _own(demo, "actions_absolute")[:]
    # After the last transition nothing is commanded, and the drives stay where they are.
    still = np.zeros_like(actions[-1:])
    still[:, 6] = actions[-1, 6]
    state = [rows("robot_qpos"), rows("eef_pos"), rows("eef_quat"), rows("gripper_opening")]
    columns = {
        "observation.state": np.concatenate(state, axis=1),
        "observation.velocity": rows("robot_qvel"),
        "observation.environment_state": rows("environment_state"),
        **({"observation.object_poses": rows("object")} if found.objects else {}),
        **({"observation.joint_positions": rows("joints")} if found.joints else {}),
        **{camera_column(view): rows(f"{view}_camera_pose") for view in found.views},
        "action": np.concatenate([actions, still]),
        "action.joint_target": np.concatenate([targets, targets[-1:]]),
        **({CLOUD: rows("point_cloud")} if found.point_cloud else {}),
        **told_rows(about),
    }
    clips: dict[tuple[str, str], Clip] = {
        (view, kind): ReadClip(f"{demo.file.filename}, {name}", partial(_pictures, demo, name))
        for view, kind in found.clips
        for name in (f"{view}_{kind or 'image'}",)
    }
    return FoldedEpisode(index, columns, clips, about)


def _after(demo: Any, name: str) -> str:
    """Return the group of what there was to see after the transitions; files of before had pictures in next_obs too."""
    return LAST if f"{LAST}/{name}" in demo else "next_obs"


def _own(demo: Any, name: str) -> Any:
    """Returns an array whose numbers are in the file itself.

    Raises:
        KeyError: There is none.
        ValueError: They are somewhere else on the disk.
    """
    found = demo[name]
    if found.is_virtual or found.external or found.file.filename != demo.file.filename:
        raise ValueError(f"{demo.name}/{name} is kept in another file")
    return found


def _pictures(demo: Any, name: str) -> Iterator[NDArray[Any]]:
    before, after = _own(demo, f"obs/{name}"), _own(demo, f"{_after(demo, name)}/{name}")
    numbers = name.endswith(tuple(f"_{kind}" for kind in CHANNELS))
    for place in range(len(before) + 1):
        picture = before[place] if place < len(before) else after[-1]
        yield picture[..., 0] if numbers else picture
