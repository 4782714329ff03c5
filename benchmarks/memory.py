"""Whether a process that runs many episodes keeps its size: its memory after each unit of a benchmark.

    scene2demo bench T3 --episodes 500 --workers 1 --seed 0 --out FOLDER
    python -m benchmarks.memory FOLDER

Prints the memory of the process that ran the most units after its 1st, 10th, 20th, 50th, ... unit, and by how much it
grew after its warm-up. The exit code is 1 when that is more than 10 %.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from executor.bench.folder import BenchFolder
from executor.bench.tables import Result

MOST_PERCENT = 10.0
SHOWN = (1, 10, 20, 50, 100, 200, 500, 1000)


def memory_growth(results: Sequence[Result]) -> dict[str, object] | None:
    """Return the memory growth of the process with the most units after its warm-up, or None.

    The first ten units, or a tenth where there are fewer than a hundred, warm up caches of libraries.
    """
    longest = of_one_process(results)
    if not longest:
        return None
    warm = longest[min(10, len(longest) // 10) :]
    first, last = warm[0]["rss_mb"], warm[-1]["rss_mb"]
    return {
        "units_in_one_process": len(longest),
        "after_warm_up_mb": first,
        "at_the_end_mb": last,
        "growth_percent": 100.0 * (last / first - 1.0),
        "peak_mb": max(result["peak_rss_mb"] for result in longest),
    }


def of_one_process(results: Sequence[Result]) -> list[Result]:
    """Return the results of the process with the most units, in their order."""
    by_worker: dict[int, list[Result]] = {}
    for result in sorted((r for r in results if "rss_mb" in r), key=lambda r: r["started_s"]):
        by_worker.setdefault(result["worker"], []).append(result)
    return max(by_worker.values(), key=len, default=[])


def main(folder: str) -> int:
    """Print the figures of a benchmark's folder and returns the exit code."""
    bench = BenchFolder(Path(folder))
    results = [result for series in bench.series() for result in bench.results(series)]
    growth, mine = memory_growth(results), of_one_process(results)
    if growth is None:
        print(f"{folder} has no finished units")
        return 2
    for count in (*(number for number in SHOWN if number < len(mine)), len(mine)):
        print(f"after {count:4} units {mine[count - 1]['rss_mb']:7.1f} MB")
    percent = growth["growth_percent"]
    print(f"growth after the warm-up {percent:+.1f} %, peak {growth['peak_mb']:.1f} MB")
    return int(not isinstance(percent, float) or percent > MOST_PERCENT)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", help="the benchmark's folder")
    sys.exit(main(parser.parse_args().folder))
