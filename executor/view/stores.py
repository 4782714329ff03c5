"""Stores of episodes and run folders as listings; a store's table comes from a written index.

The index is `view.jsonl` in the store, a line a unit. A unit's folder is written once and renamed into place, so that a
line counts as long as the folder has the same time. 10,000 units are read from it in less than a second.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from bddl.files import open_input
from executor.data.formats.store_reader import joint_names
from executor.data.store import META, UNITS, EpisodeStore, NotADataset, StoredEpisode
from executor.data.units import DemoUnit
from executor.data.views import footage_path
from executor.reports.episode import Clip, EpisodeDetail, EpisodeRow, reading_views, subtask_views
from executor.reports.series import MotionPlots, motion_plots, recorded_plots
from executor.sim.render.frames import SPEED
from executor.system.extras import require
from executor.system.files import read_json, write_text
from executor.view.records import NothingToView, command
from oag import Scene, Task, compose

INDEX = "view.jsonl"
ROLLOUT = "rollout.json"


@dataclass(frozen=True, slots=True)
class StoreListing:
    """The episodes of a store."""

    path: Path
    kind: str = "store"

    @property
    def selection_command(self) -> str:
        """The command that exports selected episodes."""
        return command("dataset export", self.path, "--only", "episode={names}", "--out", "FOLDER")

    def rows(self) -> tuple[EpisodeRow, ...]:
        """Return the table in the order of folder names; read what changed since the index was written.

        Raises:
            NotADataset: It is no store, or a unit is unreadable.
        """
        store = EpisodeStore.open(self.path)
        known = _indexed(self.path / INDEX)
        lines = {}
        for entry in _unit_folders(self.path / UNITS):
            modified_ns = entry.stat().st_mtime_ns
            line = known.get(entry.name)
            if line is None or line.modified_ns != modified_ns:
                line = _IndexLine(modified_ns, row_of(store.episode(entry.name)))
            lines[entry.name] = line
        if lines != known:
            with suppress(OSError):  # A store that can only be read is shown all the same.
                write_text(self.path / INDEX, "".join(json.dumps(asdict(line)) + "\n" for line in lines.values()))
        return tuple(line.row for line in lines.values())

    def detail(self, name: str) -> EpisodeDetail:
        """Return everything about an episode."""
        try:
            episode = EpisodeStore(self.path).episode(_plain_name(name))
        except NotADataset as problem:
            raise NothingToView(str(problem)) from None
        row, meta, folder = row_of(episode), episode.meta, episode.path
        if "task" not in meta:
            return EpisodeDetail(row, str((meta.get("failure") or {}).get("message", "")), files=[folder / META])
        scene, task = episode.scene, episode.task
        plots = None
        if episode.has_samples:
            robot = meta["robot"]["drives"]
            plots = motion_plots(episode.arrays, task, scene, meta["object_ids"], joint_names(episode), robot)
        clips = [Clip(file.stem, file) for file in sorted(folder.glob("*.mp4"))]
        report = compose(task, scene=scene).verify()
        again = command("replay", self.path, "--only", f"episode={name}")
        return EpisodeDetail(
            row,
            str((meta.get("failure") or {}).get("message") or ""),
            report.verdict.value.lower(),
            clips,
            subtask_views(report, meta["subtasks"], inserted_by(meta)),
            plots=plots,
            files=sorted(path for path in folder.iterdir() if path.is_file()),
            commands=[("the same motion again", again)] if episode.succeeded and episode.has_samples else [],
            scene=scene,
        )


def _unit_folders(folder: Path) -> list[os.DirEntry[str]]:
    """Return the units of a store in order; their times come with the folder's listing."""
    with suppress(FileNotFoundError), os.scandir(folder) as entries:
        return sorted((entry for entry in entries if not entry.name.startswith(".")), key=lambda entry: entry.name)
    return []


def row_of(episode: StoredEpisode) -> EpisodeRow:
    """Return the line of a stored episode."""
    meta, unit = episode.meta, DemoUnit.from_json(episode.meta["unit"])
    subtasks = meta.get("subtasks") or ()
    files = [entry.stat() for entry in os.scandir(episode.path) if entry.is_file()]
    views = (meta.get("pictures") or {}).get("views") or {}
    return EpisodeRow(
        name=episode.name,
        task=str(meta.get("query") or unit.origin.label),
        series=unit.origin.label,
        seed=unit.seed,
        ended=str(meta["ended"]),
        failure=str((meta.get("failure") or {}).get("kind") or ""),
        simulated_s=meta.get("simulated_s"),
        subtasks=len(subtasks) if subtasks else None,
        steps=sum(len(one["steps"]) for one in subtasks) if subtasks else None,
        drawn=dict(_drawn(meta.get("drawn") or {})),
        videos=sum(footage_path(episode.path, view).is_file() for view in views),
        bytes=sum(stat.st_size for stat in files),
        audited=str((episode.audited or {}).get("verdict", "")),
    )


def _drawn(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, float | str]]:
    """Yield drawn values as flat names with a number or a word each."""
    for name, value in values.items():
        label = f"{before} {name}".strip()
        if isinstance(value, Mapping):
            yield from _drawn(value, label)
        elif isinstance(value, bool | str):
            yield label, str(value)
        elif isinstance(value, int | float):
            yield label, round(float(value), 4)


@dataclass(frozen=True, slots=True)
class _IndexLine:
    modified_ns: int
    row: EpisodeRow


_LINE = TypeAdapter(_IndexLine)


def _indexed(path: Path) -> dict[str, _IndexLine]:
    """Return the lines of an index by episode; none where it is missing or of another form."""
    try:
        with open_input(path) as stream:
            lines = [_LINE.validate_json(raw) for raw in stream]
    except (OSError, ValidationError):
        return {}
    return {line.row.name: line for line in lines}


@dataclass(frozen=True, slots=True)
class RunListing:
    """A run's folder, or a folder with one a seed, as `rollout` and `evolve` write them."""

    path: Path
    kind: str = "run"
    selection_command: str = ""

    def rows(self) -> tuple[EpisodeRow, ...]:
        """Return a line for each run."""
        return tuple(self._row(folder) for folder in self._folders())

    def _folders(self) -> list[Path]:
        return sorted(file.parent for file in (*self.path.glob(ROLLOUT), *self.path.glob(f"seed_*/{ROLLOUT}")))

    def _row(self, folder: Path) -> EpisodeRow:
        name = folder.name if folder != self.path else self.path.absolute().name
        try:
            return self._row_of(name, folder, read_json(folder / ROLLOUT))
        except (OSError, ValueError, KeyError, TypeError) as problem:
            # One damaged run hides no other.
            return EpisodeRow(name, "", "", None, "unreadable", failure=str(problem))

    def _row_of(self, name: str, folder: Path, rollout: Mapping[str, Any]) -> EpisodeRow:
        failure, subtasks = rollout["failure"] or {}, rollout["subtasks"]
        return EpisodeRow(
            name=name,
            task=_query(folder) or str(rollout["task"]).replace("_", " "),
            series="",
            seed=rollout["seed"],
            ended="succeeded" if rollout["succeeded"] else "failed",
            failure=str(failure.get("kind", "")),
            simulated_s=rollout["simulated_s"],
            subtasks=len(subtasks),
            steps=sum(len(one["steps"]) for one in subtasks),
            videos=int((folder / "video.mp4").is_file()),
            bytes=sum(file.stat().st_size for file in folder.iterdir() if file.is_file()),
        )

    def detail(self, name: str) -> EpisodeDetail:
        """Return everything about a run."""
        for folder in self._folders():
            row = self._row(folder)
            if row.name == name:
                return run_detail(folder, row)
        raise NothingToView(f"{self.path} has no run {name!r}")


def run_detail(folder: Path, row: EpisodeRow) -> EpisodeDetail:
    """Return everything about the run in a folder, under a row of its listing."""
    rollout = read_json(folder / ROLLOUT)
    scene = Scene.from_json(rollout["scene"])
    task = Task.from_json(read_json(folder / "task.json"), scene=scene)
    video = folder / "video.mp4"
    report = compose(task, scene=scene).verify()
    return EpisodeDetail(
        row,
        str((rollout["failure"] or {}).get("message") or ""),
        report.verdict.value.lower(),
        [Clip("overview, head and wrist cameras", video, SPEED)] if video.is_file() else [],
        subtask_views(report, rollout["subtasks"], inserted_by(rollout)),
        tuple(reading_views(rollout["goal_readings"])),
        _recorded_plots(folder / "episode.hdf5", task, scene),
        sorted(path for path in folder.iterdir() if path.is_file()),
        [("check the proof", command("recheck", folder / "certificate.json", "--task", folder / "task.json"))],
        scene,
    )


def inserted_by(record: Mapping[str, Any]) -> set[int]:
    """Return the indices of the subtasks that a rollout inserted into its plan."""
    spans = ((int(one["first"]), int(one["count"])) for one in record.get("detours") or ())
    return {index for first, count in spans for index in range(first, first + count)}


def _recorded_plots(path: Path, task: Task, scene: Scene) -> MotionPlots | None:
    """Return the curves of a demonstration's file (`executor.data.formats.robomimic`); None without one."""
    if not path.is_file():
        return None
    with require("h5py", "data").File(path) as file:
        demo = file["data/demo_0"]
        count = len(demo["actions_absolute"])
        columns = {
            "time_s": demo["time_s"][:count],
            "subtask": demo["subtask"][:count],
            "robot_qpos": demo["obs/robot_qpos"][:],
            "robot_qvel": demo["obs/robot_qvel"][:],
            "robot_target": demo["actions_absolute"][:],
            "eef_pose": demo["obs/eef_pos"][:],
        }
        poses, joints = dict(demo.get("object_poses", {})), dict(demo.get("joint_positions", {}))
        return recorded_plots(
            columns,
            {name: pose[:count] for name, pose in poses.items()},
            {name: one[:count] for name, one in joints.items()},
            task,
            scene,
        )


def _query(folder: Path) -> str:
    with suppress(OSError, ValueError):
        return str(read_json(folder / "proposal.json").get("query") or "")
    return ""


def _plain_name(name: str) -> str:
    """Refuse a name that leads out of its folder."""
    if Path(name).name != name or name in ("", "..", "."):
        raise NothingToView(f"{name!r} is no name of an episode")
    return name
