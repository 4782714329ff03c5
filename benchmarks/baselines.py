"""The table of docs/baselines.md, of a benchmark's folder: one row a baseline, the paper's row in a column of its own.

    python -m benchmarks.baselines FOLDER

Each cell is successes of units and the exact interval, 95 %; the executor's own row, where the folder has one, is last.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from executor.bench.paper import main_table
from executor.bench.store import BenchFolder, NotABench
from executor.bench.summary import Cell
from executor.bench.table import number, rate_text
from executor.bench.units import FAMILIES, BenchSetting

OF_THE_PAPER = {"constraint-pose": "M3 GenSim2 (Primitive)", "sampled-grasp": "M4 RoboGen (Primitive)"}
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
    """Yields the table's rows, by family."""
    printed = {row.method: row.cells for row in main_table()}
    for family in FAMILIES:
        for cell in sorted((c for c in cells if c.series.family == family), key=_last_is_ours):
            setting = cell.series.setting
            method = OF_THE_PAPER.get(setting.baseline or "", "")
            paper = printed[method].get(family) if method else None
            seeds = [result["seed"] for result in cell.results]
            yield (
                family,
                setting.label.removeprefix("here: "),
                "own",
                f"{min(seeds)} to {max(seeds)}" if seeds else "-",
                rate_text(cell.all),
                "-" if cell.subtask_score is None else number(cell.subtask_score),
                f"{cell.simulated_in_vain_s:.0f} s",
                "-" if paper is None else f"{method}: {number(paper[0])} / {number(paper[1])}",
            )


def _last_is_ours(cell: Cell) -> tuple[bool, str]:
    setting: BenchSetting = cell.series.setting
    return setting.baseline is None, setting.name


def main(words: list[str]) -> int:
    """Prints the table as Markdown."""
    try:
        (folder,) = map(Path, words)
        series = BenchFolder(folder).series()
    except (ValueError, NotABench) as problem:
        print(f"usage: python -m benchmarks.baselines FOLDER of `scene2demo bench` ({problem})", file=sys.stderr)
        return 2
    cells = [Cell(one, BenchFolder(folder).results(one)) for one in series]
    for row in (HEAD, ("---",) * len(HEAD), *rows(cells)):
        print(f"| {' | '.join(row)} |")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
