"""Runs the units of a benchmark that are not done yet, in worker processes, and keeps each result at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

from executor.bench.store import BenchFolder
from executor.bench.units import Series, Unit
from executor.machine.workers.pool import WorkerOutcome, WorkerPool

WORKER = "executor.bench.worker"
UNIT_LIMIT_S = 900.0
"""Wall time after which a unit's process is taken for hung."""

Told = Callable[[Unit, Mapping[str, Any]], None]


@dataclass(frozen=True, slots=True)
class Shard:
    """One of several equal parts of a benchmark, such as a task of a Slurm array.

    Attributes:
        number: Which part, from 1.
        of: How many parts.
    """

    number: int = 1
    of: int = 1

    def has(self, place: int) -> bool:
        """Whether the unit at a place belongs to it."""
        return place % self.of == self.number - 1


WHOLE = Shard()


def pending(
    folder: BenchFolder, series: Sequence[Series], shard: Shard = WHOLE, *, again: bool = False
) -> Iterator[tuple[Unit, str]]:
    """Yields the units that are still to be run, with the version that they are run under.

    Args:
        folder: Where results are kept.
        series: What was asked for.
        shard: Which part of it.
        again: Whether units whose process crashed or hung are run once more.
    """
    units = ((unit, s.version) for s in series for unit in s.units())
    for place, (unit, version) in enumerate(units):
        if not shard.has(place):
            continue
        done = folder.read(unit, version)
        if done is None or (again and done["ended"] in ("crashed", "timed-out", "error")):
            yield unit, version


def run_units(
    folder: BenchFolder,
    units: Sequence[tuple[Unit, str]],
    workers: int,
    told: Told,
    *,
    limit_s: float = UNIT_LIMIT_S,
    worker: str = WORKER,
) -> None:
    """Runs units; each result is on disk before the next one is waited for.

    Args:
        folder: Where results are kept.
        units: Units with the versions that they are run under.
        workers: How many processes.
        told: Called with every unit and its result.
        limit_s: Wall time that a unit may take.
        worker: The module that runs a unit.

    Raises:
        WorkersUnusable: No worker process can be started, or it runs another version of the program.
        KeyboardInterrupt: Ctrl-C; what had been finished is on disk.
    """
    versions = {unit: version for unit, version in units}
    # A software renderer would take all cores for each process.
    pool = WorkerPool(worker, workers, limit_s=limit_s, environment={"LP_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"})
    # Closed on every way out, such as a full disk, so that no process goes on working for nobody.
    requests = [{**unit.to_json(), "version": version} for unit, version in versions.items()]
    with closing(pool.run(requests)) as outcomes:
        for outcome in outcomes:
            unit = Unit.from_json(outcome.request)
            told(unit, folder.write(unit, versions[unit], result_of(outcome)))


def result_of(outcome: WorkerOutcome) -> dict[str, Any]:
    """Returns what a unit's file has to say; a process that died or hung makes it a failure with that reason."""
    wall = {"started_s": outcome.started_s, "elapsed_s": outcome.wall_s, "worker": outcome.worker}
    if outcome.ending == "finished":
        return {**outcome.answer, **wall}
    failure = {"kind": outcome.ending, "message": outcome.message, "measurements": {}}
    if outcome.ending == "error":
        failure = {"kind": outcome.answer["kind"], "message": outcome.answer["error"], "measurements": {}}
        return {"ended": "error", "failure": failure, "traceback": outcome.answer["traceback"], **wall}
    return {"ended": outcome.ending, "failure": failure, **wall}
