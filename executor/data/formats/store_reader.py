"""Read a store as episode tables: demonstrations, and failed attempts that were corrected."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bddl.terminal import pluralize
from executor.assets.library import asset_for
from executor.data.card import page
from executor.data.episode import (
    CLOUD,
    CORRECTION,
    DEMONSTRATION,
    FAILURE,
    Clip,
    Episode,
    camera_column,
    derived_columns,
    motion_columns,
)
from executor.data.formats.selection import EVERYTHING, SUCCEEDED, Selection, Traits
from executor.data.formats.table import CHANNELS, CLOUD_SHAPE, DatasetSpec, EpisodeStream, Extra, Repeats
from executor.data.formats.videos import VideoClip
from executor.data.state_readers import ENVIRONMENT, CloudReader, StateReader, named_objects
from executor.data.store import SAMPLES, EpisodeStore, NotADataset, StoredEpisode
from executor.data.units import DemoUnit
from executor.data.views import POSES, footage_path
from executor.geometry import quaternions_last
from executor.sim.engine import TIMESTEP_S
from executor.sim.robot.actions import OPENING, hand_actions
from executor.sim.world import World
from executor.system.files import plain
from oag.model.robots import record_of_robot, robot_of_record

_VALIDATION_OF = 10
"""One in this many episodes is for validation."""

_PARTS = ("train", "valid", "corrections")
_STORE_ONLY = ("samples", "pictures", "steps", "corrected_by")
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
        """Whether it is a revised attempt."""
        return self.file != SAMPLES

    @property
    def footage(self) -> PurePath:
        """Folder of its pictures, relative to the unit's folder."""
        return PurePath(PurePath(self.file).stem) if self.failed else PurePath()


@dataclass(frozen=True, slots=True)
class _MotionInfo:
    """A motion with its metadata from `unit.json` and the head of its file.

    Attributes:
        part: Its split: "train", "valid" or "corrections".
        motion: The motion.
        traits: Its traits for selection.
        objects, joints: Rows for objects, and numbers for joints of articulated objects.
        key: Key of its content: states, sentence and pictures.
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
    ) -> _MotionInfo:
        """Return a motion of a unit, with the description of its pictures."""
        traits = traits_of(episode, drawn, motion.footage)
        shapes = episode.shapes(motion.file)
        return cls(part, motion, traits, shapes["object_poses"][1], shapes["joint_positions"][1], key)


def traits_of(episode: StoredEpisode, drawn: Mapping[str, Any] | None, footage: str | PurePath = "") -> Traits:
    """Return the traits of a motion of a unit for selection.

    Args:
        episode: The unit.
        drawn: Description of the motion's pictures.
        footage: Folder of its pictures, relative to the unit's folder.
    """
    meta, folder = episode.meta, episode.path / footage
    views, channels = {}, {}
    for view, known in ((drawn or {}).get("views") or {}).items():
        if footage_path(folder, view).is_file():
            views[view] = (int(known["size"][0]), int(known["size"][1]))
            channels[view] = [kind for kind in CHANNELS if footage_path(folder, view, kind).is_file()]
    unit = DemoUnit.from_json(meta["unit"])
    return Traits(
        episode=episode.name,
        seed=unit.seed,
        origin=unit.origin.label,
        ended=str(meta["ended"]),
        rate_hz=_rate_hz(float(meta["record_hz"])),
        robot=robot_of_record(meta["robot"]),
        views=views,
        channels=channels,
        audited=episode.audit_word,
    )


def stream_of(store: EpisodeStore, include: Collection[Extra] = (), only: Selection = EVERYTHING) -> EpisodeStream:
    """Return the data set of a store's demonstrations, or of the selected ones.

    Args:
        store: The episodes.
        include: Optional columns and pictures.
        only: Selected motions; without the key `ended`, the successes.

    Raises:
        NothingToExport: There are none, or they do not go together; the message says how to select.
        NotADataset: An episode is unreadable.
    """
    found: list[_MotionInfo] = []
    # The first episode of each motion decides the split of all its duplicates, so that none is in both splits.
    leaders: dict[str, str] = {}
    not_kept = 0
    for episode in store.episodes():
        if not episode.has_samples:
            not_kept += 1
        else:
            leader = leaders.setdefault(episode.motion_key, str(episode.meta["id"]))
            part = "valid" if is_for_validation(leader) else "train"
            key, motion = episode.demonstration_key, _Motion(episode.name)
            found.append(_MotionInfo.of(part, episode, motion, episode.meta.get("pictures"), key))
        for pair in episode.corrections if "corrections" in include else ():
            motion = _Motion(episode.name, pair["samples"])
            key = f"{episode.name} {pair['samples']}"
            found.append(_MotionInfo.of("corrections", episode, motion, pair.get("pictures"), key))
    only.check([one.traits for one in found], store.path)
    # Failed episodes are exported only if `ended` selects them; their corrections always are.
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

    def episodes() -> Iterator[Episode]:
        for motion, index in places.items():
            yield _tabulate(store.episode(motion.unit), motion, index, survey, places)

    chosen_of = f"\nChosen of these: `{only.text}`, {pluralize(len(chosen), 'episode')}.\n" if only.chosen else ""
    return EpisodeStream(survey, episodes, page(store) + chosen_of)


def _without_repeats(chosen: Sequence[_MotionInfo]) -> tuple[list[_MotionInfo], Repeats]:
    """Keep the first motion of each content, and return the names of the others, each with that of its first."""
    firsts: dict[str, _MotionInfo] = {}
    repeats = []
    for one in chosen:
        first = firsts.setdefault(one.key, one)
        if first is not one:
            repeats.append((one.motion.unit, first.motion.unit))
    return list(firsts.values()), tuple(repeats)


def _survey(
    store: EpisodeStore, chosen: Sequence[_MotionInfo], include: Collection[Extra], only: Selection, repeats: Repeats
) -> DatasetSpec:
    """Return the common properties of selected motions.

    Raises:
        NothingToExport: They do not make one data set.
        NotADataset: An episode is unreadable.
    """
    kinds = [kind for kind in CHANNELS if kind in include]
    views = only.common([one.traits for one in chosen], kinds, store.path)
    parts = Counter(one.part for one in chosen)
    robot = store.episode(chosen[-1].motion.unit).meta["robot"]
    drives = zip(robot_of_record(robot).joint_names, robot["drives"], strict=True)
    return DatasetSpec(
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
                **record_of_robot(robot_of_record(robot)),
                "drives": [{"joint": name, **dict(zip(_DRIVE, drive, strict=True))} for name, drive in drives],
            }
        ),
    )


def is_for_validation(episode_id: str) -> bool:
    """Decide an episode's split; it follows from its id, or that of the first episode of its motion."""
    return int(episode_id[:8], 16) % _VALIDATION_OF == 0


def joint_names(episode: StoredEpisode) -> tuple[str, ...]:
    """Return "id/joint" of each number of `joint_positions`, in the recording's order."""
    objects = episode.scene.objects
    return tuple(
        f"{name}/{joint.name}" for name in episode.meta["joint_ids"] for joint in asset_for(objects[name]).joints
    )


def _tabulate(
    episode: StoredEpisode, motion: _Motion, index: int, found: DatasetSpec, places: Mapping[_Motion, int]
) -> Episode:
    """Tabulate a motion.

    Args:
        episode: Its unit.
        motion: Which of the unit's motions.
        index: Its number in the data set.
        found: Common properties of the set.
        places: Number of each motion in the set.

    Raises:
        NotADataset: Its samples are unreadable.
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
    actions = hand_actions(episode.scene.robot.model, targets, after).astype(np.float32)
    # There is no command after the last row, not even by rounding.
    actions[-1, np.arange(actions.shape[1]) != OPENING] = 0.0
    around, rows = _surroundings(episode, arrays["packed_states"], point_cloud=found.point_cloud)
    about = _about(episode, motion, places, validation=index in found.splits["validation"])
    metadata = {
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
        **motion_columns(arrays),
        **around,
        **{camera_column(view): quaternions_last(arrays[f"{POSES}{view}"]) for view in found.views},
        "action": actions,
    }
    for name, width in (("object_poses", 7 * found.objects), ("joint_positions", found.joints)):
        columns[f"observation.{name}"] = _pad_columns(columns[f"observation.{name}"], width)
    columns = {name: columns[name] for name in (*found.vectors, *((CLOUD,) if found.point_cloud else ()))}
    about = plain(metadata)
    folder = episode.path / motion.footage
    clips: dict[tuple[str, str], Clip] = {
        (view, kind): VideoClip(footage_path(folder, view, kind), found.rate_hz, count) for view, kind in found.clips
    }
    return Episode(index, {**columns, **derived_columns(about, count)}, clips, about)


def _pad_columns(rows: NDArray[Any], width: int) -> NDArray[np.float32]:
    """Pad rows with 0 to (N, width)."""
    wide = np.zeros((len(rows), width), np.float32)
    wide[:, : rows.shape[1]] = rows
    return wide


def _rate_hz(asked_hz: float) -> float:
    """Return the actual sample rate: samples are whole physics steps apart."""
    return round(1.0 / (max(round(1.0 / (asked_hz * TIMESTEP_S)), 1) * TIMESTEP_S), 6)


def _surroundings(
    episode: StoredEpisode, states: NDArray[Any], *, point_cloud: bool
) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
    """Return the columns of the robot's surroundings, and the names of their rows."""
    columns = {"observation.environment_state": np.empty((len(states), ENVIRONMENT), np.float32)}
    task = episode.whole_task
    with World(episode.scene) as world:
        reader, cloud = StateReader(world, task), None
        if point_cloud:
            # The environment chooses the same points in an episode of this seed.
            cloud = CloudReader(world, named_objects(task, world.assets), int(episode.meta["unit"]["seed"]))
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
    """Return the metadata of a motion besides its rows."""
    meta = episode.meta
    same = ("name", "id", "unit", "query", "paraphrases", "task", "scene", "certificate", "verdict", "scaled", "drawn")
    metadata = {name: meta.get(name) for name in same} | {"detours": meta.get("detours", [])}
    metadata |= {name: meta[name] for name in ("takeover", "assets", "scene_fixes") if name in meta}
    if not motion.failed and (audited := episode.audited) is not None:
        metadata["audited"] = {name: audited[name] for name in ("verdict", "kinds", "replayed")}
    if not motion.failed:
        failed = meta["ended"] != SUCCEEDED
        return {
            "kind": FAILURE if failed else DEMONSTRATION,
            **({"failure": meta.get("failure")} if failed else {}),
            "validation": validation,
            **metadata,
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
        **metadata,
        "state_hash": pair["reproduce"]["state_hash"],
        "pictures": pair.get("pictures"),
        "subtasks": [_subtask(entry, [0, count], pair["steps"])],
        "correction": {
            **{name: value for name, value in pair.items() if name not in _STORE_ONLY},
            "corrected_by": _corrected_by(episode, pair, places),
        },
    }


def _subtask(entry: Mapping[str, Any], span: object, steps: list[dict[str, Any]]) -> dict[str, Any]:
    step_fields = ("primitive", "text", "action", "span")
    return {
        **{name: entry[name] for name in ("name", "detail", "init", "goal")},
        "span": span,
        "steps": [{name: step[name] for name in step_fields} for step in steps],
    }


def _corrected_by(
    episode: StoredEpisode, failed: Mapping[str, Any], places: Mapping[_Motion, int]
) -> dict[str, Any] | None:
    """Return the episode of the set, and its rows, with the revised flow's motion; None where it is not in the set.

    It is the demonstration if that was the last attempt at the revised subtask, and otherwise another failed attempt.
    """
    file = failed.get("corrected_by") or ""
    place = places.get(_Motion(episode.name, file))
    if place is None:
        return None
    if file == SAMPLES:
        return {"episode_index": place, "span": episode.meta["subtasks"][failed["revision"]["subtask"]]["span"]}
    return {"episode_index": place, "span": [0, episode.shapes(file)["robot_qpos"][0]]}
