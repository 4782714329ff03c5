"""Benchmarks as listings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from executor.bench.folder import BenchFolder
from executor.records import action_text
from executor.reports.html import value_text
from executor.view.records import (
    EpisodeDetail,
    EpisodeRow,
    NothingToView,
    StepView,
    SubtaskView,
    command,
)


@dataclass(frozen=True, slots=True)
class BenchListing:
    """The units of a benchmark."""

    path: Path
    kind: str = "benchmark"
    selection_command: str = ""

    def rows(self) -> tuple[EpisodeRow, ...]:
        """Return a line for each unit that was run."""
        return tuple(_unit_row(result) for result in self._results())

    def _results(self) -> Iterator[dict[str, Any]]:
        folder = BenchFolder(self.path)
        for series in folder.series():
            yield from folder.results(series)

    def detail(self, name: str) -> EpisodeDetail:
        """Return everything about a unit; a benchmark keeps no motion."""
        result = next((one for one in self._results() if one["name"] == name), None)
        if result is None:
            raise NothingToView(f"{self.path} has no unit {name!r}")
        failure = result.get("failure") or {}
        again = command("bench replay", self.path, name, "--out", name)
        return EpisodeDetail(
            _unit_row(result),
            str(failure.get("message") or ""),
            subtasks=[_unit_subtask(part, index, failure) for index, part in enumerate(result.get("subtasks") or ())],
            commands=[("run it again, with video and report", again)],
        )


def _unit_row(result: Mapping[str, Any]) -> EpisodeRow:
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
    )


def _unit_subtask(part: Mapping[str, Any], index: int, failure: Mapping[str, Any]) -> SubtaskView:
    steps = []
    if failure.get("primitive") is not None and failure.get("subtask") == index:
        measured = [(name.replace("_", " "), value_text(one)) for name, one in failure["measurements"].items()]
        text = action_text(failure["primitive"], failure["action"])
        steps = [StepView(text, None, failure["time_s"], (failure["kind"], failure["message"]), measured)]
    return SubtaskView(str(part["name"]).replace("_", " "), "", bool(part["succeeded"]), steps)
