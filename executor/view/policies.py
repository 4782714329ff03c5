"""Evaluations of policies, and exported LeRobot data sets, as listings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from executor.data.episode import Episode
from executor.data.formats.export import open_set
from executor.data.formats.lerobot import EPISODES, LINES, VIDEO_PATHS, picture_key
from executor.data.formats.table import read_metadata_lines
from executor.data.views import footage_path
from executor.reports.episode import Clip, EpisodeDetail, EpisodeRow, StepView, SubtaskView, measured_facts
from executor.reports.series import motion_plots
from executor.system.extras import require
from executor.system.files import read_json
from executor.view.records import NothingToView
from oag import Scene, Task

EVALUATION = "evaluation.json"


@dataclass(frozen=True, slots=True)
class EvaluationListing:
    """The episodes of policies."""

    path: Path
    kind: str = "evaluation"
    selection_command: str = ""

    def rows(self) -> tuple[EpisodeRow, ...]:
        """Return a line for each episode of each policy."""
        return tuple(row for row, _, _ in self._episodes())

    def detail(self, name: str) -> EpisodeDetail:
        """Return everything about an episode; it has a video where `evaluate --videos` drew one."""
        for row, outcome, clips in self._episodes():
            if row.name == name:
                measured = measured_facts(outcome["measured"])
                measured += [(f"{kind} at", f"{at:.1f} s") for kind, at in outcome["monitors"].items()]
                failure = (row.failure, "") if row.failure else None
                step = StepView("the policy", 0.0, row.simulated_s, failure, measured)
                subtask = SubtaskView(row.task, "", bool(outcome["success_once"]), [step])
                return EpisodeDetail(row, clips=clips, subtasks=[subtask], files=[clip.file for clip in clips])
        raise NothingToView(f"{self.path} has no episode {name!r}")

    def _episodes(self) -> Iterator[tuple[EpisodeRow, Mapping[str, Any], list[Clip]]]:
        results = read_json(self.path / EVALUATION)
        origin = results["kind"]["origin"]
        task = str(origin["query"] or origin["family"])
        for number, (policy, score) in enumerate(results["policies"].items()):
            for outcome in score["episodes"]:
                failure, seed = str(outcome["failure"] or ""), int(outcome["seed"])
                # `evaluate` names the folder of a failure's video so.
                video = footage_path(self.path / f"{number:02d}-{seed:06d}-{failure}", "global")
                clips = [Clip("global", video)] if failure and video.is_file() else []
                row = EpisodeRow(
                    name=f"{number:02d}-{seed:06d}",
                    task=task,
                    series=Path(policy).name or policy,
                    seed=seed,
                    ended="succeeded" if outcome["success_once"] else "failed",
                    failure=failure,
                    simulated_s=outcome["simulated_s"],
                    drawn={key: value for key, value in (outcome.get("drawn") or {}).items() if value is not None},
                    videos=len(clips),
                )
                yield row, outcome, clips


@dataclass(frozen=True, slots=True)
class SetListing:
    """The episodes of a LeRobot data set that was exported of a store."""

    path: Path
    kind: str = "data set"
    selection_command: str = ""

    def rows(self) -> tuple[EpisodeRow, ...]:
        """Return a line for each episode."""
        videos = len(self._views())
        return tuple(_set_row(k, about, videos) for k, about in enumerate(read_metadata_lines(self.path / LINES)))

    def detail(self, name: str) -> EpisodeDetail:
        """Return everything about an episode."""
        number = int(name) if name.isdecimal() else -1
        episodes = open_set(self.path).episodes() if number >= 0 else iter(())
        episode = next(islice(episodes, number, None), None) if number >= 0 else None
        if episode is None:
            raise NothingToView(f"{self.path} has no episode {name!r}")
        about = episode.about
        scene = Scene.from_json(about["scene"])
        task = Task.from_json(about["task"], scene=scene)
        rate_hz = open_set(self.path).found.rate_hz
        plots = motion_plots(_arrays(episode, rate_hz), task, scene, about["object_ids"], about["joint_names"])
        clips = list(self._clips(number))
        subtasks = [_set_subtask(part, rate_hz) for part in about["subtasks"]]
        return EpisodeDetail(
            _set_row(number, about, len(clips)),
            clips=clips,
            subtasks=subtasks,
            plots=plots,
            scene=scene,
            commands=[
                ("in Rerun, where it is installed", f"rerun {self.path}"),
                (
                    "in LeRobot's visualizer",
                    f"lerobot-dataset-viz --repo-id local --root {self.path} --episode-index {number}",
                ),
            ],
        )

    def _views(self) -> tuple[str, ...]:
        features = read_json(self.path / "meta" / "info.json")["features"]
        prefix = picture_key("", "")
        return tuple(key.removeprefix(prefix) for key, one in features.items() if one["dtype"] == "video")

    def _clips(self, number: int) -> Iterator[Clip]:
        info = read_json(self.path / "meta" / "info.json")
        pattern = info["video_path"]
        if pattern is None:
            return
        line: dict[str, Any] = {"episode_index": number, "episode_chunk": number // info.get("chunks_size", 1000)}
        if info["codebase_version"] == "v3.0":
            parquet = require("pyarrow.parquet", "data")
            names = [f"videos/{picture_key(view, '')}/{key}" for view in self._views() for key in _PLACE]
            line = parquet.read_table(self.path / EPISODES, columns=names).slice(number, 1).to_pylist()[0]
        for view in self._views():
            key = picture_key(view, "")
            place = {name: line.get(f"videos/{key}/{name}", 0) for name in _PLACE}
            numbers = {"chunk_index": place["chunk_index"], "file_index": place["file_index"]}
            known = VIDEO_PATHS[info["codebase_version"]]
            file = self.path / known.format(video_key=key, **numbers, **{k: v for k, v in line.items() if "/" not in k})
            if file.is_file():
                yield Clip(view, file, 1.0, float(place["from_timestamp"]))


_PLACE = ("chunk_index", "file_index", "from_timestamp")


def _set_row(number: int, about: Mapping[str, Any], videos: int) -> EpisodeRow:
    return EpisodeRow(
        name=str(number),
        task=str(about["query"]),
        series=str(about["kind"]),
        seed=(about.get("unit") or {}).get("seed"),
        ended="succeeded" if about["kind"] == "demonstration" else "failed",
        simulated_s=about.get("simulated_s"),
        subtasks=len(about["subtasks"]),
        steps=sum(len(part["steps"]) for part in about["subtasks"]),
        videos=videos,
    )


def _set_subtask(part: Mapping[str, Any], rate_hz: float) -> SubtaskView:
    steps = []
    for step in part["steps"]:
        span = step.get("span")
        begin_s, end_s = (None, None) if span is None else (span[0] / rate_hz, span[1] / rate_hz)
        steps.append(StepView(str(step.get("text") or step["action"]), begin_s, end_s))
    return SubtaskView(str(part["name"]).replace("_", " "), str(part["goal"]), bool(part["succeeded"]), steps)


def _arrays(episode: Episode, rate_hz: float) -> dict[str, Any]:
    """Return the columns of a data set under the names of samples."""
    columns = episode.columns
    state, velocity = columns["observation.state"], columns["observation.velocity"]
    objects = len(episode.about["object_ids"])
    poses = np.asarray(columns["observation.object_poses"]).reshape(episode.length, -1, 7)[:, :objects]
    joints = np.asarray(columns["observation.joint_positions"])[:, : len(episode.about["joint_names"])]
    width = velocity.shape[1]
    return {
        "time_s": np.arange(episode.length) / rate_hz,
        "subtask": columns["subtask_index"],
        "robot_qpos": state[:, :width],
        "robot_qvel": velocity,
        "robot_target": columns["action.joint_target"],
        "eef_pose": state[:, width : width + 7],
        "object_poses": poses,
        "joint_positions": joints,
    }
