"""Measure what others do in the executor's place, on the same units, or print the table of a folder.

    python -m benchmarks.baselines NAME T1 T2 --episodes 20 --seed 68000 --out FOLDER
    python -m benchmarks.baselines table FOLDER

The same command goes on where it ended; `scene2demo bench` adds the executor's own row to the same folder.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.baselines import table
from benchmarks.baselines.methods import BASELINES, baseline_version
from benchmarks.baselines.one_demonstration import SOURCE_SEEDS, source_seeds_text
from executor.bench.folder import BenchFolder
from executor.bench.tables import write_results
from executor.bench.units import BenchSetting, Series, Unit
from executor.campaign.engine import Campaign, claimed, pending
from executor.scenes.generators.families import FAMILIES

WORKER = "benchmarks.baselines.worker"


def main(words: Sequence[str]) -> int:
    """Measure or print; return the exit code, 130 after Ctrl-C."""
    if words[:1] == ["table"]:
        return table.main(words[1:])
    parser = argparse.ArgumentParser(prog="python -m benchmarks.baselines", description=__doc__.splitlines()[0])
    parser.add_argument("baseline", choices=BASELINES)
    parser.add_argument("families", nargs="+", choices=FAMILIES)
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--episodes", type=int, default=20, help="units of each family")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first episode or set of pairs")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    given = parser.parse_args(words)
    setting, version = BenchSetting(baseline=given.baseline), baseline_version()
    asked = [Series(family, given.seed, given.episodes, setting, version) for family in given.families]
    units = [unit for series in asked for unit in series.units()]
    if given.baseline == "one-demonstration" and any(unit.seed in SOURCE_SEEDS for unit in units):
        parser.error(f"--seed {given.seed}: the demonstrations are of the seeds {source_seeds_text()}")
    folder = BenchFolder(given.out)
    folder.add_series(asked)
    jobs = list(pending(folder, [(unit, version) for unit in units]))
    try:
        with claimed(folder, jobs):
            Campaign(folder, WORKER, given.workers).run(jobs, show_unit)
    except KeyboardInterrupt:
        return 130
    finally:
        write_results(folder)
    return 0


def show_unit(unit: Unit, result: Mapping[str, Any]) -> None:
    """Print how a unit ended."""
    failure = result.get("failure") or {}
    words = "succeeded" if result["ended"] == "succeeded" else f"{failure.get('kind')}: {failure.get('message')}"
    print(f"  {unit.name:28} {result['elapsed_s']:6.1f} s  {words}", file=sys.stderr)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
