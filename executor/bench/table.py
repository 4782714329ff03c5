"""The paper's main table with our rows beside its rows, and what stands behind them, as text tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bddl.visible import counted
from executor.bench.paper import main_table
from executor.bench.summary import Cell, Rate
from executor.bench.units import FAMILIES
from executor.primitives.monitors import DISPLACED_M, TIPPED_DEG
from executor.records.captions import peaks_words

DASH = "-"
SCALE_ROW = "  scale of what is taken"
FOOTNOTE = (
    "SR / Subtask-Level Score in percent. The paper's rows are as printed: its simulator, its scenes. "
    "Rows that begin with 'here' were measured by this program; below each is by how much what is taken was scaled, "
    "1 being its own size."
)


def main_rows(cells: Sequence[Cell]) -> Iterator[tuple[str, ...]]:
    """Yields the rows of the main table: method, then one cell a family."""
    for row in main_table():
        yield (
            row.method,
            *(f"{number(row.cells[f][0])} / {number(row.cells[f][1])}" if f in row.cells else DASH for f in FAMILIES),
        )
    for setting in dict.fromkeys(cell.series.setting for cell in cells):
        mine = {cell.series.family: cell for cell in cells if cell.series.setting == setting}
        yield setting.label, *(cell_text(mine[family]) if family in mine else DASH for family in FAMILIES)
        yield SCALE_ROW, *(scale_text(mine[family]) if family in mine else DASH for family in FAMILIES)


def cell_text(cell: Cell) -> str:
    """Returns a cell as the paper prints it: success rate and subtask-level score over all units that are done."""
    rate, score = cell.all.percent, cell.subtask_score
    return DASH if rate is None or score is None else f"{number(rate)} / {number(score)}"


def scale_text(cell: Cell) -> str:
    """Returns by what factors the things were scaled that a cell's units took, to fit the gripper."""
    if cell.scales is None:
        return DASH
    least, greatest = (f"{factor:.2f}".rstrip("0").rstrip(".") for factor in cell.scales)
    return least if least == greatest else f"{least}-{greatest}"


def number(percent: float) -> str:
    """Returns a percentage with one decimal, or none where it is whole, as the paper prints them."""
    return f"{percent:.1f}".removesuffix(".0")


def rate_text(rate: Rate) -> str:
    """Returns a rate with its counts and its exact interval."""
    interval = rate.interval_percent
    if rate.percent is None or interval is None:
        return "no trials"
    of = "" if rate.clusters is None else f", by {rate.clusters} layouts"
    return f"{rate.successes} of {rate.trials}, {number(rate.percent)} % ({interval[0]:.1f} to {interval[1]:.1f}{of})"


def detail_rows(cell: Cell) -> Iterator[tuple[str, str]]:
    """Yields what stands behind a cell: names and values, for the terminal and for the report."""
    asked, baseline = cell.series.episodes, cell.series.setting.baseline
    yield "success, all units", rate_text(cell.all)
    if cell.results:
        yield "subtasks, of those reaching each", ", ".join(f"{r.successes}/{r.trials}" for r in cell.subtasks)
    if baseline is not None:
        simulated_s = sum(result.get("simulated_s", 0.0) for result in cell.results)
        tried, held = (sum(result.get(f"grasps_{word}", 0) for result in cell.results) for word in ("tried", "held"))
        yield "grasps with both fingers", f"{held} of {tried}"
        yield "simulated in vain", f"{cell.simulated_in_vain_s:.0f} of {simulated_s:.0f} s"
    for mistake, rate in cell.by_mistake.items():
        yield f"success with {mistake}", f"{rate.successes} of {rate.trials}"
    factors = [min(change["factors"]) for result in cell.results for change in result.get("scaled", ())]
    if factors:
        units = sum(bool(result.get("scaled")) for result in cell.results)
        yield (
            "things scaled to fit the gripper",
            f"in {counted(units, 'unit')}, by {min(factors):g} to {max(factors):g}",
        )
    if cell.taken_twice:
        yield "a thing was taken twice", f"in {counted(cell.taken_twice, 'unit')}"
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
        parts = ("scene", "planning", "physics", "pictures")
        means = [f"{part} {times[part]['mean']:.2f} s" for part in parts if times.get(part)]
        yield "of that, mean", ", ".join(means)
    growth = data["memory"]
    if isinstance(growth, dict):
        yield (
            "memory of a process",
            f"{growth['at_the_end_mb']:.0f} MB after {growth['units_in_one_process']} units, "
            f"{growth['growth_percent']:+.1f} % since its warm-up, peak {growth['peak_mb']:.0f} MB",
        )
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
        yield "most asked of the robot", "; ".join(f"{part} {words}" for part, words in peaks_words(peaks))
    if len(cell.results) < asked:
        yield "not run yet", f"{asked - len(cell.results)} of {asked}"
    yield "seeds", seeds_text(cell)


def seeds_text(cell: Cell) -> str:
    """Returns the first and last seed of a cell, and the program's version."""
    seeds = [result["seed"] for result in cell.results]
    span = f"{min(seeds)} to {max(seeds)}" if seeds else f"from {cell.series.seed}"
    return f"{span}, program {cell.series.version}"
