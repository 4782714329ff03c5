"""A store's episodes as the rows that every format is made of: demonstrations, and what failed and was put right."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bddl.visible import counted
from executor.assets.library import asset_for
from executor.datasets.footage import POSES, footage_path
from executor.datasets.formats.clouds import CloudReader
from executor.datasets.formats.observations import ENVIRONMENT, StateReader, named
from executor.datasets.formats.selection import EVERYTHING, SUCCEEDED, Selection, Traits
from executor.datasets.formats.stream import (
    CHANNELS,
    CLOUD,
    CLOUD_SHAPE,
    CORRECTION,
    DEMONSTRATION,
    FAILURE,
    EpisodeStream,
    Extra,
    FoldedEpisode,
    Repeats,
    Survey,
    camera_column,
    told_rows,
)
from executor.datasets.formats.videos import Clip, VideoClip
from executor.datasets.store import SAMPLES, EpisodeStore, NotADataset, StoredEpisode
from executor.datasets.units import DemoUnit
from executor.datasets.upkeep.card import page
from executor.geometry import quaternions_last
from executor.machine.files import plain
from executor.robot.actions import hand_actions
from executor.robot.description import JOINT_NAMES
from executor.world.engine import TIMESTEP_S
from executor.world.world import World

_VALIDATION_OF = 10
"""One episode in so many is for validation."""

_PARTS = ("train", "valid", "corrections")
_OF_THE_STORE = ("samples", "pictures", "steps", "corrected_by")
_DRIVE = ("stiffness", "damping", "force_limit")


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


@dataclass(frozen=True, slots=True)
class _Found:
    """A motion, as its `unit.json` and the head of its file have it.

    Attributes:
        part: What it would be for: "train", "valid" or "corrections".
        motion: Which one it is.
        traits: What it can be chosen by.
        objects, joints: Rows for objects, and numbers for joints of articulated objects.
        key: Equal for motions of one content: states, sentence and pictures.
    """

    part: str
    motion: _Motion
    traits: Traits
    objects: int
    joints: int
    key: str

    @classmethod
    def of(
        cls, part: str, episode: StoredEpisode, motion: _Motion, drawn: Mapping[str, Any] | None, key: str
    ) -> _Found:
        """Return a motion of a unit, with what is said of its pictures."""
        meta, folder = episode.meta, episode.path / motion.footage
        views, channels = {}, {}
        for view, known in ((drawn or {}).get("views") or {}).items():
            if footage_path(folder, view).is_file():
                views[view] = (int(known["size"][0]), int(known["size"][1]))
                channels[view] = [kind for kind in CHANNELS if footage_path(folder, view, kind).is_file()]
        traits = Traits(
            origin=DemoUnit.from_json(meta["unit"]).origin.label,
            ended=str(meta["ended"]),
            rate_hz=_rate_hz(float(meta["record_hz"])),
            scale=float(meta["robot"]["scale"]),
            views=views,
            channels=channels,
        )
        shapes = episode.shapes(motion.file)
        return cls(part, motion, traits, shapes["object_poses"][1], shapes["joint_positions"][1], key)


def stream_of(store: EpisodeStore, include: Collection[Extra] = (), only: Selection = EVERYTHING) -> EpisodeStream:
    """Return the data set that a store's demonstrations make, or those of them that are chosen.

    Args:
        store: The episodes.
        include: What it is to have beside what it always has.
        only: Which motions of the store; without a word of `ended`, the successes.

    Raises:
        NothingToExport: There are none, or they do not go together: it says how to choose.
        NotADataset: An episode cannot be read.
    """
    found: list[_Found] = []
    # The first episode of each motion says which part all of that motion are in: equal ones are never in both.
    leaders: dict[str, str] = {}
    not_kept = 0
    for episode in store.episodes():
        if not episode.has_samples:
            not_kept += 1
        else:
            leader = leaders.setdefault(episode.motion_key, str(episode.meta["id"]))
            part = "valid" if is_for_validation(leader) else "train"
            key, motion = episode.demonstration_key, _Motion(episode.name)
            found.append(_Found.of(part, episode, motion, episode.meta.get("pictures"), key))
        for pair in episode.corrections if "corrections" in include else ():
            motion = _Motion(episode.name, pair["samples"])
            key = f"{episode.name} {pair['samples']}"
            found.append(_Found.of("corrections", episode, motion, pair.get("pictures"), key))
    only.check([one.traits for one in found], store.path)
    # Episodes that failed are exported only where `ended` says so; corrections of these are there all the same.
    chosen = [
        one
        for one in sorted(found, key=lambda one: _PARTS.index(one.part))
        if only.takes(one.traits)
        and (one.traits.ended == SUCCEEDED or one.part == "corrections" or "ended" in only.chosen)
    ]
    chosen, repeats = _without_repeats(chosen)
    if not chosen:
        raise only.nothing([one.traits for one in found], not_kept, store.path)
    survey = _survey(store, chosen, include, only, repeats)
    places = {one.motion: index for index, one in enumerate(chosen)}

    def episodes() -> Iterator[FoldedEpisode]:
        for motion, index in places.items():
            yield _fold(store.episode(motion.unit), motion, index, survey, places)

    chosen_of = f"\nChosen of these: `{only.text}`, {counted(len(chosen), 'episode')}.\n" if only.chosen else ""
    return EpisodeStream(survey, episodes, page(store) + chosen_of)


def _without_repeats(chosen: Sequence[_Found]) -> tuple[list[_Found], Repeats]:
    """Return the first of those that have one content, and the names of the others, each with that of its first."""
    firsts: dict[str, _Found] = {}
    repeats = []
    for one in chosen:
        first = firsts.setdefault(one.key, one)
        if first is not one:
            repeats.append((one.motion.unit, first.motion.unit))
    return list(firsts.values()), tuple(repeats)


def _survey(
    store: EpisodeStore, chosen: Sequence[_Found], include: Collection[Extra], only: Selection, repeats: Repeats
) -> Survey:
    """Return what chosen motions have in common.

    Raises:
        NothingToExport: They do not make one data set.
        NotADataset: An episode cannot be read.
    """
    kinds = [kind for kind in CHANNELS if kind in include]
    views = only.common([one.traits for one in chosen], kinds, store.path)
    parts = Counter(one.part for one in chosen)
    robot = store.episode(chosen[-1].motion.unit).meta["robot"]
    drives = zip(JOINT_NAMES, robot["drives"], strict=True)
    return Survey(
        train=parts["train"],
        validation=parts["valid"],
        corrections=parts["corrections"],
        rate_hz=chosen[0].traits.rate_hz,
        views=views,
        channels=tuple(kinds),
        objects=max(one.objects for one in chosen),
        joints=max(one.joints for one in chosen),
        point_cloud="point_cloud" in include,
        repeats=repeats,
        robot=plain(
            {
                "scale": robot["scale"],
                "drives": [{"joint": name, **dict(zip(_DRIVE, drive, strict=True))} for name, drive in drives],
            }
        ),
    )


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
    if not motion.failed and len(qpos) != episode.meta["samples"]:
        problem = f"has {len(qpos)} samples, and unit.json says {episode.meta['samples']}; it is of another unit"
        raise NotADataset(f"{episode.path / motion.file} {problem}")
    try:
        count = found.check_length(len(qpos))
    except ValueError as problem:
        raise NotADataset(f"{episode.path / motion.file}: {problem}; generate it with fewer samples a second") from None
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
    return FoldedEpisode(index, {**columns, **told_rows(about, count)}, clips, about)


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
    told = {name: meta.get(name) for name in same} | {"detours": meta.get("detours", [])}
    if "takeover" in meta:
        told["takeover"] = meta["takeover"]
    if not motion.failed:
        failed = meta["ended"] != SUCCEEDED
        return {
            "kind": FAILURE if failed else DEMONSTRATION,
            **({"failure": meta.get("failure")} if failed else {}),
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
