"""The paper's initial flows with faults, before and after self-evolution: a resumable run over tasks, faults and seeds.

    python -m benchmarks.evolution --out build/evolution --seeds 16000-16004 [--tasks T1 T3] [--faults none pose]
    python -m benchmarks.evolution --out build/evolution --table

One line of `results.jsonl` is one episode. An episode up to its first revision is what would have happened without
evolution, so that one run gives both columns. Numbers are the paper's as printed; the scene is varied by the seed.
Ctrl-C keeps what is finished, and the next run goes on from there.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from benchmarks.evolution_episode import FAULTS, SCENES, has_episodes
from benchmarks.evolution_table import tables
from executor.system.workers import WorkerPool

WORKER = "benchmarks.evolution_episode"
Request = dict[str, Any]


def requests(chosen: argparse.Namespace, done: Iterable[dict[str, Any]]) -> list[Request]:
    """Return the episodes that are not done yet.

    Args:
        chosen: What the command line asks for.
        done: The results so far.
    """
    known = {(r["task"], r["fault"], r["seed"]) for r in done}
    cells = [(task, kind) for task in chosen.tasks for kind in chosen.faults if has_episodes(task, kind)]
    return [
        {"task": task, "fault": kind, "seed": seed, "limit": chosen.limit}
        for seed in chosen.seeds
        for task, kind in cells
        if (task, kind, seed) not in known
    ]


def read(path: Path) -> list[dict[str, Any]]:
    """Return the episodes that a results file has; a last line that was cut off is left out."""
    if not path.exists():
        return []
    found = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return found


def run(chosen: argparse.Namespace, path: Path) -> int:
    """Run the episodes that a results file lacks, adds each to it as soon as it is finished; returns how many broke.

    An episode whose process ends is told and left out: the next run tries it again.
    """
    broken = 0
    pool = WorkerPool(WORKER, chosen.workers)
    for outcome in pool.run(requests(chosen, read(path))):
        asked, found = outcome.request, outcome.answer
        unit = f"{asked['task']} {asked['fault']} {asked['seed']}"
        if outcome.ending != "finished":
            broken += 1
            print(f"{unit}: {outcome.message}", file=sys.stderr, flush=True)
            continue
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(found, sort_keys=True) + "\n")
        word = "at once" if found["before"] else "evolved" if found["after"] else "failed"
        print(f"{unit}: {word}, {found['revisions']} revisions, {found['wall_s']} s", flush=True)
    return broken


def _seeds(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def main() -> int:
    """Run what is lacking, prints the tables, and returns the exit code: 1 when an episode broke, 2 on Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=_seeds, default=range(0), help="such as 16000-16004")
    parser.add_argument("--tasks", nargs="+", choices=sorted(SCENES), default=sorted(SCENES))
    parser.add_argument("--faults", nargs="+", choices=FAULTS, default=list(FAULTS))
    parser.add_argument("--limit", type=int, default=5, help="revisions of a subtask at most")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--table", action="store_true", help="run nothing")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    path, code = chosen.out / "results.jsonl", 0
    if not chosen.table:
        try:
            code = int(run(chosen, path) > 0)
        except KeyboardInterrupt:
            code = 2
    print("\n".join(tables(read(path))))
    return code


if __name__ == "__main__":
    sys.exit(main())
