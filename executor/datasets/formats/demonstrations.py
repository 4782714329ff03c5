"""Stored episodes as the demonstrations that the writer of robomimic's files takes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from executor.datasets.footage import footage_path, pictures
from executor.datasets.formats.fold import FoldedEpisode, Survey, joint_positions, object_poses
from executor.datasets.store import StoredEpisode
from executor.pictures.frames import Frames
from executor.records.rollout import Trajectory
from executor.results.episode import Episode, SubtaskSpan
from executor.results.robomimic import write_robomimic

FILE = "demonstrations.hdf5"


def write_merged_robomimic(episodes: Iterable[FoldedEpisode], found: Survey, folder: Path) -> None:
    """Writes one file with all demonstrations into a folder; masks `train` and `valid` say which is for what.

    Args:
        episodes: In order; one at a time is in memory.
        found: What they have in common.
        folder: It exists.

    Raises:
        VideoFailed: An episode's video cannot be read.
        MissingExtra: h5py is not installed, or PyAV where there are videos.
        OSError: The folder cannot be written.
    """
    train = len(found.train)
    masks = {"train": range(train), "valid": range(train, len(found.names))}
    write_robomimic(folder / FILE, _demonstrations(episodes, found), masks)


def _demonstrations(episodes: Iterable[FoldedEpisode], found: Survey) -> Iterator[Episode]:
    return (_demonstration(episode, tuple(found.views)) for episode in episodes)


def _demonstration(folded: FoldedEpisode, views: tuple[str, ...]) -> Episode:
    """Returns a folded episode as a demonstration in memory, with the pictures of some views.

    Raises:
        NotADataset: Its samples cannot be read.
        VideoFailed: A video cannot be read.
    """
    episode = folded.source
    meta = episode.meta
    frames = None
    if views:
        seen = {view: np.stack(list(pictures(footage_path(episode.path, view)))) for view in views}
        height, width = next(iter(seen.values())).shape[1:3]
        frames = Frames(seen, (width, height))
    return Episode.from_samples(
        task=episode.task,
        scene=episode.scene,
        seed=int(meta["unit"]["seed"]),
        succeeded=episode.succeeded,
        state_hash=str(meta["state_hash"]),
        trajectory=trajectory_of(episode),
        spans=tuple(
            SubtaskSpan(
                name=entry["name"],
                detail=entry["detail"],
                init=entry["init"],
                goal=entry["goal"],
                flow=[step["action"] for step in entry["steps"]],
                first=entry["span"][0],
                end=entry["span"][1],
                succeeded=entry["succeeded"],
            )
            for entry in meta["subtasks"]
            if entry["span"] is not None
        ),
        frames=frames,
        observations={"environment_state": folded.columns["observation.environment_state"]},
        commanded={"actions_hand": folded.columns["action"][:-1]},
    )


def trajectory_of(episode: StoredEpisode) -> Trajectory:
    """Returns the recorded motion of a stored episode.

    Raises:
        NotADataset: Its samples cannot be read.
    """
    arrays = episode.arrays
    same = ("time_s", "robot_qpos", "robot_qvel", "robot_target", "eef_pose", "subtask", "step")
    return Trajectory(
        **{name: arrays[name] for name in same},
        object_poses=object_poses(episode),
        joint_positions=joint_positions(episode),
        packed_states=tuple(state.tobytes() for state in arrays["packed_states"]),
    )
