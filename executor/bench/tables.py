"""Results of a benchmark: rates with exact intervals, scores, throughput, text tables, and the HTML report.

The main table has the paper's rows beside those of this program. The report is one HTML file and needs no network.
"""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from statistics import fmean, median
from typing import Any
from urllib.parse import quote

from bddl.terminal import pluralize
from executor.bench.any_task import wish_rows
from executor.bench.folder import BenchFolder
from executor.bench.units import Series
from executor.campaign.planning_model import sum_of, used_text
from executor.campaign.rate import Rate, number
from executor.records import describe_peaks
from executor.reports.episode import measured_facts
from executor.reports.html import render
from executor.reports.page import versions
from executor.scenes.generators.families import FAMILIES
from executor.scenes.generators.household import VARIATIONS
from executor.skills.control import DISPLACED_M, TIPPED_DEG
from executor.system.files import write_json, write_text


@dataclass(frozen=True, slots=True)
class PaperRow:
    """One row of the paper's main table.

    Attributes:
        method: The method.
        cells: Family -> success rate and subtask-level score in percent; families without numbers are absent.
    """

    method: str
    cells: Mapping[str, tuple[float, float]]


def main_table() -> tuple[PaperRow, ...]:
    """Return the rows of the paper's main table that have numbers, as printed; its fifth has "fail" or "success"."""
    text = (resources.files(__package__) / "data" / "main_comparison.json").read_text(encoding="utf-8")
    rows = json.loads(text)["rows"]
    return tuple(
        PaperRow(row["method"], {key: tuple(cell) for key, cell in row.items() if key != "method" and cell})
        for row in rows
    )


Result = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Cell:
    """Results of one family in one setting.

    Attributes:
        series: The request.
        results: The finished units, in order.
    """

    series: Series
    results: Sequence[Result]

    @property
    def all(self) -> Rate:
        """Success rate over all finished units."""
        return _rate(self.results)

    @property
    def failed(self) -> list[Result]:
        """Units that did not succeed."""
        return [result for result in self.results if not _succeeded(result)]

    @property
    def reasons(self) -> dict[str, int]:
        """Kind of failure -> number of units that it ended, the most frequent first."""
        counted = Counter(result["failure"]["kind"] if result.get("failure") else "unknown" for result in self.failed)
        return dict(counted.most_common())

    @property
    def subtasks(self) -> list[Rate]:
        """Success rate of each subtask in order, over the units that reached it."""
        return subtask_rates(self.results)

    @property
    def subtask_score(self) -> float | None:
        """The paper's Subtask-Level Score in percent: the mean over subtasks of their conditional success rate."""
        return subtask_score(self.results)

    @property
    def scales(self) -> tuple[float, float] | None:
        """Minimum and maximum scaling factor of handled things; None before anything was handled."""
        least = [
            min((min(change["factors"]) for change in r["scaled"]), default=1.0) for r in self.results if "scaled" in r
        ]
        return (min(least), max(least)) if least else None

    @property
    def taken_twice(self) -> int:
        """Number of units in which a thing was set down and grasped again, after the rollout replaced a first plan."""
        return sum(bool(result.get("taken_twice")) for result in self.results)

    @property
    def bystanders_moved_m(self) -> float | None:
        """Maximum displacement of things outside the task [m]; None where it was not measured."""
        return max(
            (result["bystanders_moved_m"] for result in self.results if "bystanders_moved_m" in result), default=None
        )

    @property
    def proved(self) -> Rate | None:
        """How many of the plans that a model was asked for are proved; None where the offline planner plans.

        Units that say nothing of a plan do not count: their process died, or nothing was drawn.
        """
        if self.series.setting.model is None:
            return None
        verdicts = [bool(result["proved"]) for result in self.results if "proved" in result]
        return Rate(sum(verdicts), len(verdicts))

    @property
    def model(self) -> dict[str, object] | None:
        """What the model took for the finished units, whenever it was asked; None where none was."""
        return sum_of([result["model"] for result in self.results if "model" in result])

    @property
    def busy_s(self) -> float:
        """Wall time in which at least one unit was running [s]; pauses between runs do not count."""
        return busy_s(self.results)

    @property
    def demos_per_hour(self) -> float | None:
        """Successful episodes an hour of wall time, all processes together."""
        return 3600.0 * self.all.successes / self.busy_s if self.busy_s > 0.0 else None

    def to_json(self) -> dict[str, object]:
        """Return the cell as plain data."""
        return {
            **self.series.to_json(),
            "label": self.series.setting.label,
            "finished": len(self.results),
            "all": self.all.to_json(),
            "subtasks": [rate.to_json() for rate in self.subtasks],
            "subtask_score_percent": self.subtask_score,
            "reasons": self.reasons,
            "scales": self.scales,
            "taken_twice": self.taken_twice,
            "bystanders": {
                "moved_at_most_m": self.bystanders_moved_m,
                "a_failure_from_m": DISPLACED_M,
                "or_tipped_by_deg": TIPPED_DEG,
            },
            "demos_per_hour": self.demos_per_hour,
            "busy_s": self.busy_s,
            "times_s": {part: _spread(values) for part, values in self._times().items()},
            "penetration": self._penetration(),
            "peaks": self._peaks(),
            **self._evolution(),
            **({} if self.proved is None else {"proved": self.proved.to_json(), "model": self.model}),
        }

    def _times(self) -> dict[str, list[float]]:
        parts: dict[str, list[float]] = {"elapsed": [r["elapsed_s"] for r in self.results if "elapsed_s" in r]}
        for result in self.results:
            for part, seconds in result.get("wall_s", {}).items():
                parts.setdefault(part, []).append(seconds)
        parts["simulated"] = [result["simulated_s"] for result in self.results if "simulated_s" in result]
        return parts

    def _penetration(self) -> dict[str, object] | None:
        """Return the penetration of bodies: the largest of the episodes' 99th percentiles, and the deepest of all."""
        recorded = [result["penetration"] for result in self.results if "penetration" in result]
        if not recorded:
            return None
        deepest = max(recorded, key=lambda figures: figures["deepest_m"])
        return {
            "episodes": len(recorded),
            "largest_p99_mm": 1000.0 * max(figures["p99_m"] for figures in recorded),
            "deepest_mm": 1000.0 * deepest["deepest_m"],
            "deepest_pair": deepest["pair"],
        }

    def _peaks(self) -> dict[str, float]:
        """Return the peak loads of the robot over all episodes, by the names of `executor.records.Peaks`."""
        recorded = [result.get("peaks", {}) for result in self.results]
        return {
            name: max(row.get(name, 0.0) for row in recorded)
            for name in sorted({name for row in recorded for name in row})
        }

    def _evolution(self) -> dict[str, object]:
        evolved = [result for result in self.results if "revisions" in result]
        if not evolved:
            return {}
        solved = [result["revisions"] for result in evolved if _succeeded(result)]
        return {
            "at_once": Rate(sum(bool(result["succeeded_at_once"]) for result in evolved), len(evolved)).to_json(),
            "revisions_of_successes_mean": fmean(solved) if solved else None,
        }


def subtask_rates(results: Sequence[Result]) -> list[Rate]:
    """Return the success rate of each subtask over the units that reached it.

    A unit reaches a subtask when all before it succeeded. The first is always reached, also by a unit whose process
    died. Units with fewer subtasks count for those that they have.
    """
    longest = max((len(_names(result)) for result in results), default=0)
    rates = []
    for k in range(longest):
        reached = [r for r in results if len(_names(r)) > k and _done(r) >= k]
        rates.append(Rate(sum(_done(r) > k for r in reached), len(reached)))
    return rates


def subtask_score(results: Sequence[Result]) -> float | None:
    """Return the mean over subtasks of their conditional success rates [%]; one never reached counts 0."""
    rates = subtask_rates(results)
    return fmean(rate.percent or 0.0 for rate in rates) if rates else None


def busy_s(results: Sequence[Result]) -> float:
    """Return the length of the union of the units' time intervals [s]."""
    spans = sorted((r["started_s"], r["started_s"] + r["elapsed_s"]) for r in results if "started_s" in r)
    total, until = 0.0, float("-inf")
    for start, end in spans:
        total += max(0.0, end - max(start, until))
        until = max(until, end)
    return total


def _rate(results: Sequence[Result]) -> Rate:
    """T5 and T6 repeat the same layouts, within a set and from set to set, with other models, sizes and places."""
    rooms = {result["index"] // VARIATIONS for result in results if result.get("index") is not None}
    repeated = 0 < len(rooms) < len(results)
    return Rate(sum(_succeeded(result) for result in results), len(results), len(rooms) if repeated else None)


def _succeeded(result: Result) -> bool:
    return bool(result["ended"] == "succeeded")


def _names(result: Result) -> Sequence[str]:
    """Return the subtasks' names; a unit that failed before its task still has one undone subtask."""
    return result.get("subtask_names") or ["?"]


def _done(result: Result) -> int:
    """Return the number of subtasks that succeeded before the first failure."""
    count = 0
    for subtask in result.get("subtasks", ()):
        if not subtask["succeeded"]:
            break
        count += 1
    return count


def _spread(values: Sequence[float]) -> dict[str, float] | None:
    if not values:
        return None
    return {"mean": fmean(values), "median": median(values), "largest": max(values), "total": sum(values)}


DASH = "-"
SCALE_ROW = "  scale of what is taken"
FOOTNOTE = (
    "Success rate / subtask-level score (mean success of the subtasks) in percent. "
    "The paper's rows are as printed: its simulator, its scenes. "
    "Rows that begin with 'here' were measured by this program; below each is by how much what is taken was scaled, "
    "1 being its own size."
)


def main_rows(cells: Sequence[Cell]) -> Iterator[tuple[str, ...]]:
    """Yield the rows of the main table: method, then one cell a family."""
    for row in main_table():
        yield (
            row.method,
            *(f"{number(row.cells[f][0])} / {number(row.cells[f][1])}" if f in row.cells else DASH for f in FAMILIES),
        )
    for setting in dict.fromkeys(cell.series.setting for cell in cells if cell.series.family in FAMILIES):
        mine = {cell.series.family: cell for cell in cells if cell.series.setting == setting}
        yield setting.label, *(cell_text(mine[family]) if family in mine else DASH for family in FAMILIES)
        yield SCALE_ROW, *(scale_text(mine[family]) if family in mine else DASH for family in FAMILIES)


def cell_text(cell: Cell) -> str:
    """Return a cell as in the paper: success rate and subtask-level score over all finished units."""
    rate, score = cell.all.percent, cell.subtask_score
    return DASH if rate is None or score is None else f"{number(rate)} / {number(score)}"


def scale_text(cell: Cell) -> str:
    """Return the scaling factors of the things that a cell's units handled, to fit the gripper."""
    if cell.scales is None:
        return DASH
    least, greatest = (f"{factor:.2f}".rstrip("0").rstrip(".") for factor in cell.scales)
    return least if least == greatest else f"{least}-{greatest}"


def detail_rows(cell: Cell) -> Iterator[tuple[str, str]]:
    """Yield the details of a cell: names and values, for the terminal and for the report."""
    asked = cell.series.episodes
    if cell.series.family not in FAMILIES:
        yield from wish_rows(cell.results)
        yield from _model_rows(cell)
        yield "seeds", seeds_text(cell)
        return
    yield from _model_rows(cell)
    yield "success, all units", str(cell.all)
    if cell.results:
        yield "subtasks, of those reaching each", ", ".join(f"{r.successes}/{r.trials}" for r in cell.subtasks)
    factors = [min(change["factors"]) for result in cell.results for change in result.get("scaled", ())]
    if factors:
        units = sum(bool(result.get("scaled")) for result in cell.results)
        yield (
            "things scaled to fit the gripper",
            f"in {pluralize(units, 'unit')}, by {min(factors):g} to {max(factors):g}",
        )
    if cell.taken_twice:
        yield "a thing was taken twice", f"in {pluralize(cell.taken_twice, 'unit')}"
    if cell.bystanders_moved_m is not None:
        yield (
            "things beside",
            f"moved by {1000 * cell.bystanders_moved_m:.0f} mm at most; a failure from {1000 * DISPLACED_M:.0f} mm or "
            f"{TIPPED_DEG:.0f} degrees on",
        )
    if cell.reasons:
        yield "reasons of failure", ", ".join(f"{count} {kind}" for kind, count in cell.reasons.items())
    data = cell.to_json()
    at_once, revisions = data.get("at_once"), data.get("revisions_of_successes_mean")
    if isinstance(at_once, dict):
        yield "success without a revision", f"{at_once['successes']} of {at_once['trials']}"
    if isinstance(revisions, float):
        yield "revisions of a success, mean", f"{revisions:.2f}"
    if cell.demos_per_hour is not None:
        yield "successes an hour of wall time", f"{cell.demos_per_hour:.0f}"
    times = data["times_s"]
    if isinstance(times, dict) and times.get("elapsed"):
        elapsed = times["elapsed"]
        yield "wall time of a unit", f"median {elapsed['median']:.1f} s, largest {elapsed['largest']:.1f} s"
        parts = ("scene", "planning", "physics")
        means = [f"{part} {times[part]['mean']:.2f} s" for part in parts if times.get(part)]
        yield "of that, mean", ", ".join(means)
    overlap = data["penetration"]
    if isinstance(overlap, dict):
        between = " and ".join(overlap["deepest_pair"])
        yield (
            "overlap of bodies",
            f"99th percentile of an episode at most {overlap['largest_p99_mm']:.1f} mm, deepest "
            f"{overlap['deepest_mm']:.1f} mm ({between})",
        )
    peaks = data["peaks"]
    if isinstance(peaks, dict) and peaks:
        yield "most asked of the robot", "; ".join(f"{part} {words}" for part, words in describe_peaks(peaks))
    if len(cell.results) < asked:
        yield "not run yet", f"{asked - len(cell.results)} of {asked}"
    yield "seeds", seeds_text(cell)


def _model_rows(cell: Cell) -> Iterator[tuple[str, str]]:
    """Yield what a model's plans came to, and what they took."""
    if cell.proved is not None and cell.series.family in FAMILIES:
        yield "plan proved, of those asked for", str(cell.proved)
    if cell.model is not None:
        yield "the model", used_text(cell.model)


def seeds_text(cell: Cell) -> str:
    """Return the first and last seed of a cell, and the program's version."""
    seeds = [result["seed"] for result in cell.results]
    span = f"{min(seeds)} to {max(seeds)}" if seeds else f"from {cell.series.seed}"
    return f"{span}, program {cell.series.version}"


SUMMARY_SCHEMA = "scene2demo-bench-summary/1"


def write_results(folder: BenchFolder) -> list[Cell]:
    """Write summary and report of everything in a folder, and return its cells."""
    cells = [Cell(series, folder.results(series)) for series in folder.series()]
    write_json(folder.path / "summary.json", bench_json(cells))
    write_text(folder.path / "report.html", bench_page(cells, folder))
    return cells


def bench_json(cells: Sequence[Cell]) -> dict[str, object]:
    """Return the summary as plain data: the table, every cell, and one line a unit."""
    return {
        "schema": SUMMARY_SCHEMA,
        "table": [dict(zip(("method", *FAMILIES), row, strict=True)) for row in main_rows(cells)],
        "cells": [cell.to_json() for cell in cells],
        "failed": [
            {"unit": result["name"], "ended": result["ended"], "failure": result.get("failure")}
            for cell in cells
            for result in cell.failed
        ],
    }


def bench_page(cells: Sequence[Cell], folder: BenchFolder) -> str:
    """Return the whole page as text.

    Args:
        cells: The results.
        folder: The benchmark's folder; what was run again in it is linked and shown.
    """
    return render(
        "bench.html",
        families=FAMILIES,
        rows=list(main_rows(cells)),
        footnote=FOOTNOTE,
        cells=cells,
        number=number,
        detail_rows=detail_rows,
        units=[_shown_unit(folder, result) for cell in cells for result in cell.results],
        view=shlex.join(["scene2demo", "view", str(folder.path)]),
        versions=versions(),
    )


def _shown_unit(folder: BenchFolder, result: Result) -> dict[str, object]:
    """Return what the page shows of a unit: its result, and where its report and video lie, seen from the page."""
    replay = folder.replay(result["name"])
    address = {name: f"replays/{quote(replay.name)}/{name}" for name in ("report.html", "video.mp4")}
    there = {name.partition(".")[0]: address[name] for name in address if (replay / name).is_file()}
    return {
        "result": result,
        "succeeded": _succeeded(result),
        "measured": measured_facts((result.get("failure") or {}).get("measurements", {})),
        "commands": list(folder.commands(result)),
        "report": there.get("report"),
        "video": there.get("video"),
    }
