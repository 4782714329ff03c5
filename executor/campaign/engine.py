"""Run units of work in processes, resumable: pending units of a shard, each result stored before the next is awaited.

    store = BenchFolder(path)  # or EpisodeStore(path)
    jobs = list(pending(store, jobs, shard))
    with claimed(store, jobs):
        Campaign(store, "executor.bench.worker", workers=2).run(jobs, on_progress)

A benchmark and a data set differ in what a unit is and how its result is stored, and in nothing else here.

A run keeps a card in `running/` locked while it lives. The system releases the lock when the process ends, however it
ends. Nothing has to be cleaned up by hand. Where the system or the disk has no such locks, no run is refused.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Generic, Protocol, TypeVar

from bddl.errors import Scene2DemoError
from bddl.files import open_plain
from executor.system.workers import WorkerOutcome, WorkerPool

try:
    import fcntl
except ImportError:  # Windows has none.
    fcntl = None  # type: ignore[assignment]

RUNNING = "running"
LOCK = ".lock"


class BenchBusy(Scene2DemoError):
    """Another run works on some of the same units."""


@contextmanager
def exclusive_lock(folder: Path) -> Iterator[None]:
    """Hold a folder's exclusive lock; wait until other processes release it.

    Raises:
        OSError: The folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with _open_card(folder / LOCK, os.O_CREAT) as lock:
        if fcntl is not None:
            with suppress(OSError):  # A disk without locks.
                fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@contextmanager
def claim_units(folder: Path, units: Iterable[str]) -> Iterator[None]:
    """Claim units in a folder for as long as the block lasts.

    Args:
        folder: Folder of the benchmark or store.
        units: Ids of the units.

    Raises:
        BenchBusy: A living run works on some of them; the message names it.
        OSError: The folder cannot be written.
    """
    process, host, wanted = os.getpid(), socket.gethostname(), set(units)
    place = folder / RUNNING
    with exclusive_lock(folder):
        place.mkdir(exist_ok=True)
        for other in _live_runs(place):
            if both := wanted & set(other["units"]):
                raise BenchBusy(
                    f"process {other['process']} on {other['host']} works on {len(both)} of these units in {folder} "
                    "already; wait for it, or share the units between runs with --shard"
                )
        path = place / f"{host}-{process}.json"
        path.unlink(missing_ok=True)  # Left by an earlier process of the same number, or a planted link.
        card = _open_card(path, os.O_CREAT | os.O_EXCL)
        _try_lock(card)
        json.dump({"process": process, "host": host, "units": sorted(wanted)}, card)
        card.flush()
    try:
        yield
    finally:
        with exclusive_lock(folder):
            path.unlink(missing_ok=True)
            card.close()
            if not any(place.iterdir()):
                place.rmdir()


def _live_runs(place: Path) -> Iterator[Mapping[str, Any]]:
    """Yield the cards of other living runs; cards of ended ones are deleted."""
    for path in sorted(place.glob("*.json")):
        with _open_card(path, 0) as card:
            if _try_lock(card):
                path.unlink(missing_ok=True)
            else:
                yield json.load(card)


def _open_card(path: Path, flags: int) -> IO[str]:
    return os.fdopen(open_plain(path, os.O_RDWR | flags), "r+", encoding="utf-8")


def _try_lock(file: IO[str]) -> bool:
    """Try to lock a file; return whether no other process has it."""
    if fcntl is not None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # A disk without locks.
            return True
    return True


UNIT_LIMIT_S = 900.0
"""Wall time after which a unit's process counts as hung."""

UNFINISHED = ("crashed", "timed-out", "error")
"""Endings of units whose outcome is unknown, because their process crashed, hung or raised."""


class CampaignUnit(Protocol):
    """One piece of work, described by all inputs of its outcome."""

    def id(self, version: str) -> str:
        """Return a key that changes whenever the outcome may."""


AnyUnit = TypeVar("AnyUnit", bound=CampaignUnit)
StoredUnit = TypeVar("StoredUnit", bound=CampaignUnit, contravariant=True)
Job = tuple[AnyUnit, str]
"""A unit, and the version of the program that its result is for."""


class ResultStore(Protocol[StoredUnit]):
    """Folder with one result per unit, each complete or absent."""

    @property
    def path(self) -> Path:
        """The folder."""

    def ending(self, unit: StoredUnit, version: str) -> str | None:
        """Return how a unit ended, or None when it was not run yet."""

    def request(self, unit: StoredUnit, version: str) -> dict[str, Any]:
        """Return the request of a unit to its worker process."""

    def keep(self, unit: StoredUnit, version: str, outcome: WorkerOutcome) -> Mapping[str, Any]:
        """Store the outcome of a unit's process unless the process did, and return what progress is shown of."""


@dataclass(frozen=True, slots=True)
class Shard:
    """One of several equal parts of a campaign, such as a task of a Slurm array.

    Attributes:
        number: Number of the part, from 1.
        of: Number of parts.
    """

    number: int = 1
    of: int = 1

    def has(self, place: int) -> bool:
        """Decide whether the unit at an index belongs to it."""
        return place % self.of == self.number - 1


WHOLE = Shard()


def pending(
    store: ResultStore[AnyUnit], jobs: Iterable[Job[AnyUnit]], shard: Shard = WHOLE, *, again: bool = False
) -> Iterator[Job[AnyUnit]]:
    """Yield the units that are still to be run.

    Args:
        store: Where results are kept.
        jobs: The requested units.
        shard: Part of the units.
        again: Whether to repeat units whose process crashed or hung.
    """
    for place, (unit, version) in enumerate(jobs):
        if shard.has(place):
            ending = store.ending(unit, version)
            if ending is None or (again and ending in UNFINISHED):
                yield unit, version


def claimed(store: ResultStore[AnyUnit], jobs: Iterable[Job[AnyUnit]]) -> AbstractContextManager[None]:
    """Claim units in their store for as long as the block lasts.

    Raises:
        BenchBusy, OSError: As for `claim_units`.
    """
    return claim_units(store.path, [unit.id(version) for unit, version in jobs])


@dataclass(frozen=True)
class Campaign(Generic[AnyUnit]):
    """Worker processes that run units of a store.

    Attributes:
        store: Where results are kept.
        worker: Module of the worker process.
        workers: Number of processes.
        limit_s: Maximum wall time of a unit [s].
        more: Gives further fields of the request of a unit for a version.
    """

    store: ResultStore[AnyUnit]
    worker: str
    workers: int
    limit_s: float = UNIT_LIMIT_S
    more: Callable[[AnyUnit, str], Mapping[str, Any]] = lambda unit, version: {}

    def run(
        self,
        jobs: Sequence[Job[AnyUnit]],
        on_progress: Callable[[AnyUnit, Mapping[str, Any]], None],
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Run units; each result is on disk before the next one is awaited.

        Args:
            jobs: Units in their order of start; no other run works on them (`claimed`).
            on_progress: Called with every unit and its result.
            stop: Asked after every unit; units in flight are lost when it agrees.

        Raises:
            WorkersUnusable: No worker process can be started, or it runs another version of the program.
            OSError: The disk is full; finished units are kept.
            KeyboardInterrupt: Ctrl-C; finished units are kept.
        """
        # Each process's software renderer would use all cores.
        threads = {"LP_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        pool = WorkerPool(self.worker, self.workers, limit_s=self.limit_s, environment=threads)
        requests = [{**self.store.request(*job), **self.more(*job)} for job in jobs]
        job_of = {id(request): job for request, job in zip(requests, jobs, strict=True)}
        # Closed on every exit, such as a full disk, so that no worker process stays behind.
        with closing(pool.run(requests)) as outcomes:
            for outcome in outcomes:
                unit, version = job_of[id(outcome.request)]
                on_progress(unit, self.store.keep(unit, version, outcome))
                if stop():
                    return


def result_of(outcome: WorkerOutcome) -> dict[str, Any]:
    """Return the content of a unit's file; a process that died or hung is a failure of that kind."""
    wall = {"started_s": outcome.started_s, "elapsed_s": outcome.wall_s, "worker": outcome.worker}
    if outcome.ending == "finished":
        return {**outcome.answer, **wall}
    failure = {"kind": outcome.ending, "message": outcome.message, "measurements": {}}
    if outcome.ending == "error":
        failure = {"kind": outcome.answer["kind"], "message": outcome.answer["error"], "measurements": {}}
        return {"ended": "error", "failure": failure, "traceback": outcome.answer["traceback"], **wall}
    return {"ended": outcome.ending, "failure": failure, **wall}
