"""The table of docs/baselines.md, of a benchmark's folder: one row a baseline, the paper's row in a column of its own.

    python -m benchmarks.baselines table FOLDER

Each cell is successes of units and the exact interval, 95 %; the executor's own row, where the folder has one, is last.
Below stands what was measured with code or tasks of others. No folder has it, and it is not measured anew: `ELSEWHERE`
says by which command of docs/baselines.md it was. None of it is of T1 to T6, which the paper's row beside it is of.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.baselines.methods import BASELINES
from executor.bench.folder import BenchFolder, NotABench
from executor.bench.tables import Cell, main_table
from executor.bench.units import BenchSetting
from executor.campaign.rate import Rate, number
from executor.scenes.generators.families import FAMILIES

OF_THE_PAPER = {"constraint-pose": "M3 GenSim2 (Primitive)", "sampled-grasp": "M4 RoboGen (Primitive)"}


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """Something that was measured outside the benchmark.

    Attributes:
        task: Whose task, and which.
        row: What was measured.
        code: Whose code did it.
        seeds: Of the episodes.
        rate: How often it succeeded, by the criterion of its own.
        source: The command, as docs/baselines.md prints it.
        method: The paper's row of the same system at work; none for all else.
    """

    task: str
    row: str
    code: str
    seeds: str
    rate: Rate
    source: str
    method: str = ""


GENSIM2 = {
    "OpenRefrigeratorDoor": 13,
    "CloseRefrigeratorDoor": 15,
    "OpenBox": 20,
    "OpenDrawer": 17,
    "PushDrawerClose": 20,
    "OpenSafe": 11,
    "RotateMicrowaveDoor": 10,
    "CloseMicrowave": 5,
    "StoreLemonInRefrigerator": 3,
    "PlaceCrackerBoxIntoRefrigerator": 1,
}
"""Task of its own -> successes of 20."""

ELSEWHERE = (
    *(
        Elsewhere(
            *(f"GenSim2's {task}", "GenSim2, its own criteria", "GenSim2's", "0 to 19", Rate(good, 20)),
            *("benchmarks/gensim2_tasks.py GenSim2 --episodes 20", OF_THE_PAPER["constraint-pose"]),
        )
        for task, good in GENSIM2.items()
    ),
    Elsewhere(
        *("opening and shutting 10 of GenSim2's models", "planned flows", "own", "from 69500"),
        Rate(394, 398, clusters=10),
        "python -m benchmarks.gensim2_models GenSim2 --episodes 20 --seed 69500",
    ),
    Elsewhere(
        *("RoboGen's recorded decompositions", "proved as written, of those that can be said", "own"),
        *("-", Rate(11, 20), "python -m benchmarks.robogen_plans RoboGen"),
    ),
    Elsewhere(
        *("RoboGen's recorded decompositions", "proved as its code does them, of those that can be said", "own"),
        *("-", Rate(19, 20), "python -m benchmarks.robogen_plans RoboGen"),
    ),
    Elsewhere(
        *("8 of RoboGen's recorded decompositions", "as written, executed unchecked", "own", "69600 to 69603"),
        *(Rate(12, 32, clusters=8), "python -m benchmarks.robogen_executed RoboGen --episodes 4 --seed 69600"),
    ),
    Elsewhere(
        *("8 of RoboGen's recorded decompositions", "as its code does them, unchecked", "own", "69600 to 69603"),
        *(Rate(25, 32, clusters=8), "python -m benchmarks.robogen_executed RoboGen --episodes 4 --seed 69600"),
    ),
)
HEAD = (
    "family",
    "row",
    "whose code",
    "seeds",
    "success",
    "score",
    "simulated in vain",
    "the paper's own row (success / score)",
)


def rows(cells: list[Cell]) -> Iterator[tuple[str, ...]]:
    """Yield the table's rows, by family."""
    printed = {row.method: row.cells for row in main_table()}
    for family in FAMILIES:
        for cell in sorted((c for c in cells if c.series.family == family), key=_last_is_ours):
            setting = cell.series.setting
            method = OF_THE_PAPER.get(setting.baseline or "", "")
            paper = printed[method].get(family) if method else None
            seeds = [result["seed"] for result in cell.results]
            yield (
                family,
                BASELINES.get(setting.baseline or "", setting.label.removeprefix("here: ")),
                "own",
                f"{min(seeds)} to {max(seeds)}" if seeds else "-",
                str(cell.all),
                "-" if cell.subtask_score is None else number(cell.subtask_score),
                f"{sum(one.get('simulated_s', 0.0) for one in cell.failed):.0f} s",
                "-" if paper is None else f"{method}: {number(paper[0])} / {number(paper[1])}",
            )


def elsewhere() -> Iterator[tuple[str, ...]]:
    """Yield the rows of what was measured outside the benchmark, in the table's columns."""
    printed = {row.method: row.cells for row in main_table()}
    for one in ELSEWHERE:
        cells = ", ".join(number(success) for success, _ in printed.get(one.method, {}).values())
        paper = f"{one.method}, T1 to T6: {cells}" if cells else "-"
        row = f"{one.row}; not measured anew, by `{one.source}`"
        yield one.task, row, one.code, one.seeds, str(one.rate), "-", "-", paper


def details(cells: list[Cell]) -> Iterator[str]:
    """Yield what was grasped by each baseline, and how often it succeeded with each kind of mistake."""
    for name, label in BASELINES.items():
        results = [result for cell in cells if cell.series.setting.baseline == name for result in cell.results]
        if any("grasps_tried" in result for result in results):
            tried, held = (sum(result.get(f"grasps_{word}", 0) for result in results) for word in ("tried", "held"))
            yield f"{label}: {held} of {tried} grasps with both fingers"
        for mistake in sorted({result["mistake"] for result in results if "mistake" in result}):
            ended = [result["ended"] for result in results if result.get("mistake") == mistake]
            yield f"{label}, {mistake}: {ended.count('succeeded')} of {len(ended)}"


def _last_is_ours(cell: Cell) -> tuple[bool, str]:
    setting: BenchSetting = cell.series.setting
    return setting.baseline is None, setting.name


def main(words: Sequence[str]) -> int:
    """Print the table as Markdown."""
    try:
        (folder,) = map(Path, words)
        series = BenchFolder(folder).series()
    except (ValueError, NotABench) as problem:
        print(f"usage: python -m benchmarks.baselines table FOLDER of `scene2demo bench` ({problem})", file=sys.stderr)
        return 2
    cells = [Cell(one, BenchFolder(folder).results(one)) for one in series]
    for row in (HEAD, ("---",) * len(HEAD), *rows(cells), *elsewhere()):
        print(f"| {' | '.join(row)} |")
    for line in details(cells):
        print(line)
    return 0
