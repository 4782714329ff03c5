"""Benchmarks as listings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from executor.bench.folder import BenchFolder
from executor.records import action_text, readable
from executor.reports.episode import EpisodeDetail, EpisodeRow, StepView, SubtaskView, measured_facts
from executor.view.records import NothingToView
from executor.view.stores import ROLLOUT, run_detail


@dataclass(frozen=True, slots=True)
class BenchListing:
    """The units of a benchmark."""

    path: Path
    kind: str = "benchmark"
    selection_command: str = ""

    def rows(self) -> tuple[EpisodeRow, ...]:
        """Return a line for each unit that was run."""
        return tuple(self._row(result) for result in self._results())

    def _results(self) -> Iterator[dict[str, Any]]:
        folder = BenchFolder(self.path)
        for series in folder.series():
            yield from folder.results(series)

    def detail(self, name: str) -> EpisodeDetail:
        """Return everything about a unit; its video and curves once `bench replay` has run it again."""
        result = next((one for one in self._results() if one["name"] == name), None)
        if result is None:
            raise NothingToView(f"{self.path} has no unit {name!r}")
        row, folder = self._row(result), BenchFolder(self.path)
        commands = list(folder.commands(result))
        if (folder.replay(name) / ROLLOUT).is_file():
            return replace(run_detail(folder.replay(name), row), commands=commands)
        failure = result.get("failure") or {}
        return EpisodeDetail(
            row,
            str(failure.get("message") or ""),
            subtasks=[_unit_subtask(part, index, failure) for index, part in enumerate(result.get("subtasks") or ())],
            commands=commands,
        )

    def _row(self, result: Mapping[str, Any]) -> EpisodeRow:
        setting, subtasks = result["setting"], result.get("subtasks") or ()
        return EpisodeRow(
            name=result["name"],
            task=str(result.get("query") or result["name"]),
            series=f"{result['family']} {setting['flows']}{' evolving' if setting['evolve'] else ''}",
            seed=result["seed"],
            ended=str(result["ended"]),
            failure=str((result.get("failure") or {}).get("kind") or ""),
            simulated_s=result.get("simulated_s"),
            subtasks=len(subtasks) or None,
            steps=sum(part["steps"] for part in subtasks) or None,
            videos=int((BenchFolder(self.path).replay(result["name"]) / "video.mp4").is_file()),
        )


def _unit_subtask(part: Mapping[str, Any], index: int, failure: Mapping[str, Any]) -> SubtaskView:
    steps = []
    if failure.get("primitive") is not None and failure.get("subtask") == index:
        text = action_text(failure["primitive"], failure["action"])
        what = (failure["kind"], failure["message"])
        measured = measured_facts(failure["measurements"])
        steps = [StepView(text, None, failure["time_s"], what, measured, number=failure["step"] + 1)]
    return SubtaskView(readable(str(part["name"])), "", bool(part["succeeded"]), steps)
