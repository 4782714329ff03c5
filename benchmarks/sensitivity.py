"""Success over what the physics is set to: friction, resistance of joints, damping, mass, force limits, time step.

python -m benchmarks.sensitivity --out DIR                         every cell, about two minutes each; resumes
python -m benchmarks.sensitivity --out DIR --factors joint_friction base_force
python -m benchmarks.sensitivity --out DIR --table                 what is there, as a table

One setting at a time is changed, by `executor.sim.engine.Physics`; scenes, plans and motion stay as they are. Every
cell runs the same episodes, four of each long task and of each of the household's two (24), so that its rows compare.
The usual settings come first, then the hardest value of each factor, then the others: a run cut short says most.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import Any

from bddl.files import write_atomically
from benchmarks.audit import units
from executor.bench.units import Unit
from executor.bench.work import prepare
from executor.campaign.versions import outcome_version
from executor.rollouts.rollout import RunConditions, failure_of, rollout
from executor.scenes.generators.families import FAMILIES
from executor.sim.engine import STANDARD, TIMESTEP_S, Physics
from oag.measurements import clopper_pearson

USUAL = "usual"
SEED = 62400

# From far below what a real thing has to far above it, the hardest first; the fingers' 0.6 is rubber on lacquer, 0.3
# nearly nothing.
VALUES: Mapping[str, tuple[float, ...]] = {
    "finger_friction": (0.3, 0.6, 1.0, 3.0),
    "joint_friction": (3.0, 2.0, 1.5, 0.33),
    "damping": (0.01, 0.33, 3.0),
    "item_mass": (6.0, 3.0, 0.33),
    "item_friction": (0.33, 0.5, 2.0),
    "base_force": (0.5, 0.7, 2.0),
    "arm_force": (0.5, 0.7, 2.0),
    "grip_force": (0.33, 0.5, 2.0),
    "timestep_s": (TIMESTEP_S * 2, TIMESTEP_S / 2),
}
Cell = tuple[str, float]


def cells(factors: list[str]) -> Iterator[Cell]:
    """Yield the settings to try: the usual ones, then the first value of each factor, then the second, and so on."""
    yield USUAL, 1.0
    for values in zip_longest(*(VALUES[factor] for factor in factors)):
        yield from ((factor, value) for factor, value in zip(factors, values, strict=True) if value is not None)


def physics_of(cell: Cell) -> Physics:
    """Return the settings of a cell."""
    factor, value = cell
    return STANDARD if factor == USUAL else Physics(**{factor: value})


def path_of(folder: Path, cell: Cell, unit: Unit) -> Path:
    """Return the file of an episode in a cell."""
    factor, value = cell
    return folder / f"{factor}-{value:.6g}" / f"{unit.name}.json"


def run(folder: Path, factors: list[str], per_family: int, seed: int) -> None:
    """Run the episodes that are not there yet in this version of the program."""
    version, prepared = outcome_version(), cache(prepare)
    for cell in cells(factors):
        for unit in units(per_family, seed):
            if _kept(path_of(folder, cell, unit)).get("version") == version:
                continue
            pair, graph = prepared(unit)
            began = time.perf_counter()
            done = rollout(graph, pair.scene, unit.seed, vary=False, conditions=RunConditions(physics=physics_of(cell)))
            failure = None if done.succeeded else failure_of(done)
            kept = {
                "version": version,
                "unit": unit.to_json(),
                "factor": cell[0],
                "value": cell[1],
                "succeeded": done.succeeded,
                "failure": None if failure is None else failure.to_json(),
                "state_hash": done.state_hash,
                "wall_s": round(time.perf_counter() - began, 2),
            }
            path = path_of(folder, cell, unit)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, (json.dumps(kept, indent=1) + "\n").encode())
            words = "succeeded" if failure is None else f"{failure.kind.value}: {failure.message}"
            print(f"{cell[0]:16} {cell[1]:<8.4g} {unit.name:28} {words}", flush=True)


def _kept(path: Path) -> dict[str, Any]:
    kept: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    return kept


def table(folder: Path) -> str:
    """Return a row for each cell: how many episodes, how many succeeded, the exact interval, and what failed."""
    found: dict[Cell, list[dict[str, Any]]] = {}
    for path in sorted(folder.glob("*/*.json")):
        kept = _kept(path)
        found.setdefault((kept["factor"], kept["value"]), []).append(kept)
    order = [USUAL, *VALUES]
    lines = [
        "| setting | value | n | succeeded | 95 % | " + " | ".join(FAMILIES) + " | failures |",
        "| --- " * (6 + len(FAMILIES)) + "|",
    ]
    for factor, value in sorted(found, key=lambda cell: (order.index(cell[0]), cell[1])):
        episodes = found[factor, value]
        good = sum(kept["succeeded"] for kept in episodes)
        low, high = clopper_pearson(good, len(episodes))
        by_family = []
        for family in FAMILIES:
            of = [kept for kept in episodes if kept["unit"]["family"] == family]
            by_family.append(f"{sum(kept['succeeded'] for kept in of)}/{len(of)}")
        kinds = Counter(kept["failure"]["kind"] for kept in episodes if kept["failure"]).most_common()
        lines.append(
            f"| {factor} | {value:.4g} | {len(episodes)} | {good} | {100 * low:.0f} to {100 * high:.0f} % | "
            f"{' | '.join(by_family)} | {', '.join(f'{count} {kind}' for kind, count in kinds) or '-'} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Run what is missing and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the episodes' files")
    parser.add_argument("--factors", nargs="*", choices=list(VALUES), default=list(VALUES))
    parser.add_argument("--per-family", type=int, default=4)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--table", action="store_true", help="print what is there and run nothing")
    options = parser.parse_args()
    if not options.table:
        run(options.out, options.factors, options.per_family, options.seed)
    print(table(options.out))


if __name__ == "__main__":
    main()
