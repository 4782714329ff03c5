"""Makes the units of a data set that are not there yet, in worker processes, and counts what comes of them."""

from __future__ import annotations

import shutil
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

from executor.bench.run import result_of
from executor.datasets.store import EpisodeStore
from executor.datasets.units import DemoUnit
from executor.machine.workers.pool import WorkerOutcome, WorkerPool

WORKER = "executor.datasets.worker"
UNIT_LIMIT_S = 900.0
"""Wall time after which a unit's process is taken for hung."""
_ROOM_LEFT_BYTES = 200_000_000  # A disk that is nearly full makes everything else on it fail too.


@dataclass(frozen=True, slots=True)
class Limits:
    """When to stop before all is made; what is in flight then is lost.

    Attributes:
        wall_s: Wall time of this run; None for no end.
        store_bytes: What the run may add to the disk; None for no end.
    """

    wall_s: float | None = None
    store_bytes: int | None = None


@dataclass
class Tally:
    """What came of the units so far.

    Attributes:
        endings: How many succeeded, failed, crashed...
        kinds: Failures by kind.
        added_bytes, cpu_s: Of this run's units; what they cost.
        began: When the run began, by `time.perf_counter`.
        stopped_by: What part of the limits ended the run; empty when none did.
    """

    endings: Counter[str] = field(default_factory=Counter)
    kinds: Counter[str] = field(default_factory=Counter)
    made: int = 0
    kept: int = 0
    added_bytes: int = 0
    cpu_s: float = 0.0
    began: float = field(default_factory=time.perf_counter)
    stopped_by: str = ""

    def count(self, result: Mapping[str, Any]) -> None:
        """Counts a unit that was made just now."""
        self.note(result["ended"], result.get("kind"))
        self.made += 1
        self.kept += result["ended"] == "succeeded"
        self.added_bytes += result.get("bytes", 0)
        self.cpu_s += result.get("cpu_s", 0.0)

    def note(self, ended: str, kind: str | None) -> None:
        """Counts a unit, whoever made it."""
        self.endings[ended] += 1
        if ended != "succeeded" and kind:
            self.kinds[kind] += 1

    @property
    def kept_an_hour(self) -> float:
        """Successes an hour of wall time, of this run."""
        return 3600.0 * self.kept / max(time.perf_counter() - self.began, 1e-9)


Told = Callable[[DemoUnit, Mapping[str, Any]], None]


def generate(
    store: EpisodeStore,
    units: Sequence[DemoUnit],
    version: str,
    workers: int,
    told: Told,
    *,
    tally: Tally,
    limits: Limits = Limits(),
    limit_s: float = UNIT_LIMIT_S,
    worker: str = WORKER,
    more: Callable[[DemoUnit], Mapping[str, Any]] = lambda unit: {},
) -> None:
    """Makes units; each is in the store, whole, before it is told of.

    Args:
        store: Where episodes are kept.
        units: What is still to be made, in the order in which to begin; no other run is at work on them (`at_work`).
        version: Hash of the program.
        workers: How many processes.
        told: Called with every unit and how it ended.
        tally: Counts them.
        limits: When to stop early.
        limit_s: Wall time that a unit may take.
        worker: The module that makes a unit.
        more: What else the worker is told of a unit.

    Raises:
        WorkersUnusable: No worker process can be started, or it runs another version of the program.
        OSError: The disk is full; what had been finished is kept.
        KeyboardInterrupt: Ctrl-C; what had been finished is kept.
    """
    # A software renderer would take all cores for each process.
    pool = WorkerPool(worker, workers, limit_s=limit_s, environment={"LP_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"})
    # No other run is at work on these units, or it would have been refused; of others' only age tells.
    store.tidy({unit.folder(version) for unit in units}, 2.0 * limit_s)
    shared = {"store": str(store.path), "version": version}
    asked = [{"unit": unit.to_json(), **shared, **more(unit)} for unit in units]
    with closing(pool.run(asked)) as outcomes:
        for outcome in outcomes:
            unit = DemoUnit.from_json(outcome.request["unit"])
            result = _settled(store, unit, version, outcome)
            tally.count(result)
            told(unit, {**result, "elapsed_s": outcome.wall_s})
            tally.stopped_by = _exhausted(store, tally, limits) if tally.made < len(units) else ""
            if tally.stopped_by:
                return


def _settled(store: EpisodeStore, unit: DemoUnit, version: str, outcome: WorkerOutcome) -> Mapping[str, Any]:
    """Returns how a unit ended; of one whose process died or hung, the store gets a folder that says so."""
    if outcome.ending == "finished":
        return outcome.answer
    # The time of the processor went with the process.
    result = {**result_of(outcome), "wall_s": outcome.wall_s}
    store.tidy({unit.folder(version)})  # The process is gone.
    with store.writing(unit, version) as folder:
        store.write(unit, version, result, folder)
    return {"ended": result["ended"], "kind": result["failure"]["kind"], "message": result["failure"]["message"]}


def _exhausted(store: EpisodeStore, tally: Tally, limits: Limits) -> str:
    if limits.wall_s is not None and time.perf_counter() - tally.began >= limits.wall_s:
        return "time"
    if limits.store_bytes is not None and tally.added_bytes >= limits.store_bytes:
        return "disk budget"
    if shutil.disk_usage(store.path).free < _ROOM_LEFT_BYTES:
        return "room on the disk"
    return ""
