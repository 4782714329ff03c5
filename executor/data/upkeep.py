"""Check a store's episodes against their metadata, and merge stores."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.data import samples
from executor.data.formats.store_reader import joint_names
from executor.data.formats.videos import count_pictures
from executor.data.store import META, SAMPLES, UNITS, EpisodeStore, NotADataset, StoredEpisode
from executor.data.units import DemoUnit, Recording
from executor.data.views import footage_path, kinds
from executor.sim.render.frames import VideoFailed
from executor.system.files import content_key, json_text
from executor.system.progress import OnProgress, ignore_progress
from oag.model.diagnostics import InputError

_PER_SAMPLE = (
    *("packed_states", "time_s", "subtask", "step", "robot_qpos", "robot_qvel", "robot_target", "eef_pose"),
    *("object_poses", "joint_positions"),
)


@dataclass(frozen=True, slots=True)
class StoreFlaw:
    """A flaw of a store.

    Attributes:
        episode: Folder of the unit.
        what: The sentence.
    """

    episode: str
    what: str


def find_flaws(store: EpisodeStore, on_progress: OnProgress = ignore_progress) -> Iterator[StoreFlaw]:
    """Yield the flaws of a store's episodes.

    Args:
        store: The store; its index is read, too.
        on_progress: Called with the numbers of checked and of all episodes.

    Raises:
        NotADataset: The folder is no store.
    """
    store.requests()
    folder = store.path / UNITS
    names = sorted(name for name in os.listdir(folder) if not name.startswith(".")) if folder.is_dir() else []
    known: dict[str, str] = {}
    for place, name in enumerate(names):
        on_progress(place, len(names))
        try:
            episode = store.episode(name)
            yield from (StoreFlaw(name, what) for what in _flaws_of(episode))
            if episode.has_samples and (first := known.setdefault(recorded_key(episode), name)) != name:
                yield StoreFlaw(name, f"it repeats {first}, whose states, actions, sentence and pictures it has")
        except (NotADataset, VideoFailed, InputError) as problem:
            yield StoreFlaw(name, str(problem))
        except (KeyError, TypeError, ValueError, IndexError) as problem:
            yield StoreFlaw(name, f"its {META} does not have what it should: {type(problem).__name__} {problem}")


def recorded_key(episode: StoredEpisode) -> str:
    """Return a key of the recorded content; episodes with equal keys are duplicates."""
    recorded = (part for name in _PER_SAMPLE for part in (name, _bytes_of(episode.arrays[name])))
    return content_key(json_text([episode.meta.get("query"), episode.meta.get("pictures")]), *recorded)


def _bytes_of(rows: NDArray[Any]) -> memoryview | bytes:
    # Views, not copies: recordings may be as large as a file of samples. An empty array has no view.
    return np.ascontiguousarray(rows).data.cast("B") if rows.size else b""


def _flaws_of(episode: StoredEpisode) -> Iterator[str]:
    meta = episode.meta
    unit, version = DemoUnit.from_json(meta["unit"]), str(meta["version"])
    if meta["id"] not in unit.ids(version):
        yield f"its id is {meta['id']}, that of its unit is {unit.id(version)}"
    elif episode.name != unit.folder_of(meta["id"]):
        yield f"its folder should be named {unit.folder_of(meta['id'])}"
    for pair in episode.corrections:
        # Keep one motion at a time in memory.
        counts = {name: len(rows) for name, rows in episode.motion(pair["samples"]).items()}
        if missing := sorted(set(_PER_SAMPLE) - set(counts)):
            yield f"{pair['samples']} lacks {', '.join(missing)}"
        aside = Path(pair["samples"]).stem
        yield from _flaws_of_pictures(episode.path, aside, unit.recording, counts[_PER_SAMPLE[0]])
    if not episode.has_samples:
        if episode.succeeded:
            yield "it succeeded, and its samples are missing"
        return
    arrays, count = episode.arrays, int(meta["samples"])
    if missing := sorted(set(_PER_SAMPLE) - set(arrays)):
        yield f"its samples lack {', '.join(missing)}"
        return
    for name in _PER_SAMPLE:
        if len(arrays[name]) != count:
            yield f"it has {len(arrays[name])} rows of {name}, and says {count} samples"
    joints = len(episode.scene.robot.model.joint_names)
    for name in ("robot_qpos", "robot_qvel", "robot_target"):
        if arrays[name].shape[1:] != (joints,):
            yield f"{name} has {arrays[name].shape[1:]} numbers a row, {joints} belong there"
    if arrays["object_poses"].shape[1:] != (len(meta["object_ids"]), 7):
        yield f"it has poses of {arrays['object_poses'].shape[1]} objects, and names {len(meta['object_ids'])}"
    found = len(joint_names(episode))
    if arrays["joint_positions"].shape[1] != found:
        yield f"it has {arrays['joint_positions'].shape[1]} joints, its scene has {found}"
    for entry in meta["subtasks"]:
        if entry["span"] is not None and not 0 <= entry["span"][0] < entry["span"][1] <= count:
            yield f"{entry['name']} is said to span samples {entry['span']} of {count}"
    try:
        samples.commands(arrays)
    except samples.BadSamples as problem:
        yield f"{SAMPLES}: {problem}"
    if episode.task.name == "":
        yield "its task has no name"
    yield from _flaws_of_pictures(episode.path, "", unit.recording, count)


def _flaws_of_pictures(unit: Path, aside: str, recording: Recording, count: int) -> Iterator[str]:
    """Yield the flaws of the videos of a motion of `count` samples, in a unit's folder or in one of its own."""
    for view in recording.views:
        for kind in kinds(recording):
            video = footage_path(unit / aside, view, kind)
            if not video.is_file():
                yield f"{video.relative_to(unit)} is missing"
            elif (found := count_pictures(video)) != count:
                yield f"{video.relative_to(unit)} has {found} pictures for {count} samples"


@dataclass
class Merged:
    """Result of a merge.

    Attributes:
        copied: Number of added episodes.
        same: Number of episodes that were there already: equal units are the same.
    """

    copied: int = 0
    same: int = 0


def merge(stores: Sequence[EpisodeStore], out: Path, on_progress: OnProgress = ignore_progress) -> Merged:
    """Copy all episodes of some stores into one, which is created when absent; existing episodes stay.

    Folders are copied as they are, and requests are joined.

    Args:
        stores: Sources, in order of priority.
        out: Folder of the destination.
        on_progress: Called with the numbers of finished and of all stores.

    Raises:
        NotADataset: One of them, or an episode, is unreadable.
        OSError: The folder cannot be written.
    """
    requests = [request for store in stores for request in store.requests()]
    target, done = EpisodeStore(out), Merged()
    target.add_requests(requests)
    for place, store in enumerate(stores):
        on_progress(place, len(stores))
        for episode in store.episodes():
            unit, version = DemoUnit.from_json(episode.meta["unit"]), str(episode.meta["version"])
            # An id of an earlier program stays, and so does its folder's name.
            known_as = next((one for one in unit.ids(version) if one == episode.meta["id"]), "")
            there = target.read(unit, version, known_as)
            if there is not None and not (there.broken_off and not episode.broken_off):
                done.same += 1
                continue
            with target.writing(unit, version, known_as) as folder:
                shutil.copytree(episode.path, folder, dirs_exist_ok=True)
            done.copied += 1
    return done
