"""A store's episodes as the rows that every format is made of: demonstrations, and what failed and was put right."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.assets.library import asset_for
from executor.datasets.footage import POSES, footage_path
from executor.datasets.formats.clouds import CloudReader
from executor.datasets.formats.observations import ENVIRONMENT, StateReader, named
from executor.datasets.formats.stream import (
    CHANNELS,
    CLOUD,
    CLOUD_SHAPE,
    CORRECTION,
    DEMONSTRATION,
    EpisodeStream,
    Extra,
    FoldedEpisode,
    Survey,
    camera_column,
    told_rows,
)
from executor.datasets.formats.videos import Clip, VideoClip
from executor.datasets.store import SAMPLES, EpisodeStore, StoredEpisode
from executor.datasets.upkeep.card import page
from executor.geometry import quaternions_last
from executor.machine.files import plain
from executor.robot.actions import hand_actions
from executor.robot.description import JOINT_NAMES
from executor.world.engine import TIMESTEP_S
from executor.world.world import World

_VALIDATION_OF = 10
"""One episode in so many is for validation."""

_OF_THE_STORE = ("samples", "pictures", "steps", "corrected_by")
_DRIVE = ("stiffness", "damping", "force_limit")


class NothingToExport(ValueError):
    """A store has no demonstrations that make one data set."""


@dataclass(frozen=True, slots=True)
class _Motion:
    """One recorded motion of a unit.

    Attributes:
        unit: Name of the unit's folder.
        file: Its file of samples: the unit's own, or an attempt's.
    """

    unit: str
    file: str = SAMPLES

    @property
    def failed(self) -> bool:
        """Whether it is an attempt that was revised."""
        return self.file != SAMPLES

    @property
    def footage(self) -> PurePath:
        """Where its pictures lie, seen from the unit's folder."""
        return PurePath(PurePath(self.file).stem) if self.failed else PurePath()


@dataclass
class _Seen:
    """What has been found of a store's motions so far, from their `unit.json` and headers alone."""

    parts: dict[str, list[_Motion]] = field(default_factory=lambda: {"train": [], "valid": [], "corrections": []})
    rates: set[float] = field(default_factory=set)
    scales: set[float] = field(default_factory=set)
    sizes: Counter[tuple[str, int, int]] = field(default_factory=Counter)
    kinds: Counter[tuple[str, str]] = field(default_factory=Counter)
    robot: Mapping[str, Any] = field(default_factory=dict)
    objects: int = 0
    joints: int = 0
    repeats: list[tuple[str, str]] = field(default_factory=list)

    def add(self, part: str, episode: StoredEpisode, motion: _Motion, drawn: Mapping[str, Any] | None) -> None:
        """Counts a motion, with what is said of its pictures."""
        self.parts[part].append(motion)
        self.rates.add(_rate_hz(float(episode.meta["record_hz"])))
        self.scales.add(float(episode.meta["robot"]["scale"]))
        for view, told in ((drawn or {}).get("views") or {}).items():
            folder = episode.path / motion.footage
            there = [kind for kind in ("", *CHANNELS) if footage_path(folder, view, kind).is_file()]
            self.kinds.update((view, kind) for kind in there)
            if "" in there:
                self.sizes[view, int(told["size"][0]), int(told["size"][1])] += 1
        shapes = episode.shapes(motion.file)
        self.objects = max(self.objects, shapes["object_poses"][1])
        self.joints = max(self.joints, shapes["joint_positions"][1])
        self.robot = episode.meta["robot"]

    @property
    def motions(self) -> tuple[_Motion, ...]:
        """All of them in the order of the data set."""
        return tuple(motion for motions in self.parts.values() for motion in motions)

    def survey(self, include: Collection[Extra]) -> Survey:
        """Returns what the motions have in common, which are of one rate."""
        count = len(self.motions)
        views = {view: (width, height) for (view, width, height), seen in sorted(self.sizes.items()) if seen == count}
        joints = zip(JOINT_NAMES, self.robot["drives"], strict=True)
        return Survey(
            train=len(self.parts["train"]),
            validation=len(self.parts["valid"]),
            corrections=len(self.parts["corrections"]),
            rate_hz=next(iter(self.rates)),
            views=views,
            channels=tuple(
                kind
                for kind in CHANNELS
                if kind in include and views and all(self.kinds[view, kind] == count for view in views)
            ),
            objects=self.objects,
            joints=self.joints,
            point_cloud="point_cloud" in include,
            repeats=tuple(self.repeats),
            robot=plain(
                {
                    "scale": self.robot["scale"],
                    "drives": [{"joint": name, **dict(zip(_DRIVE, drive, strict=True))} for name, drive in joints],
                }
            ),
        )


def stream_of(store: EpisodeStore, include: Collection[Extra] = ()) -> EpisodeStream:
    """Returns the data set that a store's demonstrations make.

    Args:
        store: The episodes.
        include: What it is to have beside what it always has; pictures only where all episodes have them.

    Raises:
        NothingToExport: There are no demonstrations, or they are of different rates or of robots of both sizes.
        NotADataset: An episode cannot be read.
    """
    seen = _Seen()
    # The first episode of each motion says which part all of that motion are in: equal ones are never in both.
    firsts: dict[str, str] = {}
    known: dict[str, str] = {}
    for episode in store.episodes():
        if episode.succeeded and episode.has_samples:
            first = known.setdefault(episode.demonstration_key, episode.name)
            if first != episode.name:
                seen.repeats.append((episode.name, first))
                continue
            leader = firsts.setdefault(episode.motion_key, str(episode.meta["id"]))
            part = "valid" if is_for_validation(leader) else "train"
            seen.add(part, episode, _Motion(episode.name), episode.meta.get("pictures"))
        for pair in episode.corrections if "corrections" in include else ():
            seen.add("corrections", episode, _Motion(episode.name, pair["samples"]), pair.get("pictures"))
    if not seen.motions:
        raise NothingToExport(f"{store.path} has no success with samples, and only these are exported")
    if len(seen.rates) > 1:
        found = ", ".join(f"{rate:g}" for rate in sorted(seen.rates))
        raise NothingToExport(
            f"{store.path} has episodes of {found} samples a second, and a data set has one rate; generate them into a "
            "store each"
        )
    if len(seen.scales) > 1:
        raise NothingToExport(
            f"{store.path} has demonstrations of robots of both sizes, and a data set has one; generate them into a "
            "store each"
        )
    survey, motions = seen.survey(include), seen.motions
    places = {motion: index for index, motion in enumerate(motions)}

    def episodes() -> Iterator[FoldedEpisode]:
        for motion, index in places.items():
            yield _fold(store.episode(motion.unit), motion, index, survey, places)

    return EpisodeStream(survey, episodes, page(store))


def is_for_validation(episode_id: str) -> bool:
    """Decides which part of a data set an episode is in: it follows from its id, or that of the first of its motion."""
    return int(episode_id[:8], 16) % _VALIDATION_OF == 0


def joint_names(episode: StoredEpisode) -> tuple[str, ...]:
    """Returns "id/joint" of each number of `joint_positions`, in the recording's order."""
    objects = episode.scene.objects
    return tuple(
        f"{name}/{joint.name}" for name in episode.meta["joint_ids"] for joint in asset_for(objects[name]).joints
    )


def _fold(
    episode: StoredEpisode, motion: _Motion, index: int, found: Survey, places: Mapping[_Motion, int]
) -> FoldedEpisode:
    """Returns a motion as rows.

    Args:
        episode: The unit that it is of.
        motion: Which of the unit's.
        index: Its place in the data set.
        found: What all episodes of the set have in common.
        places: Where in the set each motion is.

    Raises:
        NotADataset: Its samples cannot be read.
    """
    arrays = episode.motion(motion.file)
    qpos, targets = arrays["robot_qpos"], arrays["robot_target"]
    count = len(qpos)
    after = np.concatenate([targets[1:], targets[-1:]])
    actions = hand_actions(float(episode.meta["robot"]["scale"]), targets, after).astype(np.float32)
    # Nothing is commanded after the last row: no rounding shall say otherwise.
    actions[-1, [0, 1, 2, 3, 4, 5, 7, 8, 9]] = 0.0
    around, rows = _surroundings(episode, arrays["packed_states"], point_cloud=found.point_cloud)
    poses = quaternions_last(arrays["object_poses"]).reshape(count, -1)
    opening = qpos[:, 10:12].sum(axis=1, keepdims=True)
    about = _about(episode, motion, places, validation=index in found.splits["validation"])
    told = {
        "episode_index": index,
        "length": count,
        **about,
        "starts_s": float(arrays["time_s"][0]),
        "first_target": targets[0],
        "object_ids": episode.meta["object_ids"],
        "joint_names": joint_names(episode),
        **rows,
    }
    columns = {
        "observation.state": np.concatenate(
            [qpos, quaternions_last(arrays["eef_pose"]), opening], axis=1, dtype=np.float32
        ),
        "observation.velocity": arrays["robot_qvel"].astype(np.float32),
        "observation.object_poses": _widened(poses, 7 * found.objects),
        "observation.joint_positions": _widened(arrays["joint_positions"], found.joints),
        **around,
        **{camera_column(view): quaternions_last(arrays[f"{POSES}{view}"]) for view in found.views},
        "action": actions,
        "action.joint_target": after.astype(np.float32),
    }
    columns = {name: columns[name] for name in (*found.vectors, *((CLOUD,) if found.point_cloud else ()))}
    about = plain(told)
    folder = episode.path / motion.footage
    clips: dict[tuple[str, str], Clip] = {
        (view, kind): VideoClip(footage_path(folder, view, kind), found.rate_hz, 0, count) for view, kind in found.clips
    }
    return FoldedEpisode(index, {**columns, **told_rows(about)}, clips, about)


def _widened(rows: NDArray[Any], width: int) -> NDArray[np.float32]:
    """Returns (N, width) rows, what is missing filled up with 0."""
    wide = np.zeros((len(rows), width), np.float32)
    wide[:, : rows.shape[1]] = rows
    return wide


def _rate_hz(asked_hz: float) -> float:
    """Returns the rate of samples: they are whole physics steps apart, which is not always what was asked for."""
    return round(1.0 / (max(round(1.0 / (asked_hz * TIMESTEP_S)), 1) * TIMESTEP_S), 6)


def _surroundings(
    episode: StoredEpisode, states: NDArray[Any], *, point_cloud: bool
) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
    """Returns the columns of what is around the robot, and what the rows of these are of."""
    columns = {"observation.environment_state": np.empty((len(states), ENVIRONMENT), np.float32)}
    task = episode.whole_task
    with World(episode.scene) as world:
        reader, cloud = StateReader(world, task), None
        if point_cloud:
            # The environment chooses the same points, in an episode of this seed.
            cloud = CloudReader(world, named(task, world.assets), int(episode.meta["unit"]["seed"]))
            columns[CLOUD] = np.empty((len(states), *CLOUD_SHAPE), np.float32)
        for row, state in enumerate(states):
            world.unpack(state.tobytes())
            columns["observation.environment_state"][row] = reader.environment()
            if cloud is not None:
                columns[CLOUD][row] = cloud.read()
    return columns, {"things": reader.things, "handles": reader.handles}


def _about(
    episode: StoredEpisode, motion: _Motion, places: Mapping[_Motion, int], *, validation: bool
) -> dict[str, Any]:
    """Returns what is said of a motion beside its rows."""
    meta = episode.meta
    same = ("name", "id", "unit", "query", "paraphrases", "task", "scene", "certificate", "verdict", "scaled", "drawn")
    told = {name: meta.get(name) for name in same}
    if "takeover" in meta:
        told["takeover"] = meta["takeover"]
    if not motion.failed:
        return {
            "kind": DEMONSTRATION,
            "validation": validation,
            **told,
            "state_hash": meta["state_hash"],
            "pictures": meta.get("pictures"),
            "subtasks": [_subtask(entry, entry["span"], entry["steps"]) for entry in meta["subtasks"]],
        }
    pair = next(pair for pair in episode.corrections if pair["samples"] == motion.file)
    number = pair["context"]["subtask"]
    planned = meta["task"]["sub_tasks"][number]
    entry = {
        "name": planned["task_activity_name"],
        "detail": planned["task_detail_message"],
        "init": pair["context"]["roles"]["init"],
        "goal": pair["context"]["roles"]["goal"],
    }
    count = episode.shapes(motion.file)["robot_qpos"][0]
    return {
        "kind": CORRECTION,
        "validation": False,
        **told,
        "state_hash": pair["reproduce"]["state_hash"],
        "pictures": pair.get("pictures"),
        "subtasks": [_subtask(entry, [0, count], pair["steps"])],
        "correction": {
            **{name: value for name, value in pair.items() if name not in _OF_THE_STORE},
            "corrected_by": _corrected_by(episode, pair, places),
        },
    }


def _subtask(entry: Mapping[str, Any], span: object, steps: list[dict[str, Any]]) -> dict[str, Any]:
    told = ("primitive", "text", "action", "span")
    return {
        **{name: entry[name] for name in ("name", "detail", "init", "goal")},
        "span": span,
        "steps": [{name: step[name] for name in told} for step in steps],
    }


def _corrected_by(
    episode: StoredEpisode, failed: Mapping[str, Any], places: Mapping[_Motion, int]
) -> dict[str, Any] | None:
    """Returns which episode of the set, and which of its rows, the revised flow moved; None where it is not in the set.

    It is the demonstration where that was the last attempt at the revised subtask, and else one that failed too.
    """
    file = failed.get("corrected_by") or ""
    place = places.get(_Motion(episode.name, file))
    if place is None:
        return None
    if file == SAMPLES:
        return {"episode_index": place, "span": episode.meta["subtasks"][failed["revision"]["subtask"]]["span"]}
    return {"episode_index": place, "span": [0, episode.shapes(file)["robot_qpos"][0]]}
