"""Run units of work in processes, resumable: pending units of a shard, each result stored before the next is awaited.

    store = BenchFolder(path)  # or EpisodeStore(path)
    with claimed(store, jobs, shard) as left:
        Campaign(store, "executor.bench.worker", workers=2).run(left, on_progress)

A benchmark and a data set differ in what a unit is and how its result is stored, and in nothing else here. Requests are
run by an engine: the pool of this machine, or `executor.campaign.ray_engine`. Parts of a Slurm array are shards.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from executor.campaign.claims import claim_units
from executor.system.workers import WorkerOutcome, WorkerPool

THREADS = {"LP_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""Variables of worker processes: each one's software renderer would use all cores."""

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


def is_done(store: ResultStore[AnyUnit], jobs: Iterable[Job[AnyUnit]], shard: Shard) -> bool:
    """Decide whether a part did its work: it has no units, or one of them came to an end, whichever it was."""
    own = [store.ending(*job) for place, job in enumerate(jobs) if shard.has(place)]
    return not own or any(ending is not None and ending not in UNFINISHED for ending in own)


@contextmanager
def claimed(
    store: ResultStore[AnyUnit],
    jobs: Iterable[Job[AnyUnit]],
    shard: Shard = WHOLE,
    wait_s: float = 0.0,
    *,
    again: bool = False,
) -> Iterator[list[Job[AnyUnit]]]:
    """Claim the units that are still to be run for as long as the block lasts, and provide them.

    Another run may finish some of them until the claim succeeds; these are left out.

    Args:
        store, jobs, shard, again: As for `pending`.
        wait_s: How long to wait for another run of the same units [s].

    Raises:
        BenchBusy, OSError: As for `claim_units`.
    """
    wanted = list(pending(store, jobs, shard, again=again))
    with claim_units(store.path, [unit.id(version) for unit, version in wanted], wait_s):
        yield list(pending(store, wanted, again=again))


class Engine(Protocol):
    """What runs requests in processes, on this machine or on others: requests in, outcomes out."""

    def run(self, requests: Iterable[Mapping[str, Any]]) -> Generator[WorkerOutcome, None, None]:
        """Yield the outcome of each request, in the order in which they end; closed early, all processes end.

        A request is taken when it can start. A process that dies, or a machine that is lost, costs no other request.

        Raises:
            WorkersUnusable: No process can be started, or each is of another version of the program.
            OSError: A disk is full.
        """


EngineMaker = Callable[[str, int, float], Engine]
"""Takes the worker's module, the number of processes a machine, and the limit of a unit [s]."""


def local_pool(worker: str, workers: int, limit_s: float) -> Engine:
    """Return the engine of this machine: a pool of processes."""
    return WorkerPool(worker, workers, limit_s=limit_s, environment=THREADS)


@dataclass(frozen=True)
class Campaign(Generic[AnyUnit]):
    """Worker processes that run units of a store.

    Attributes:
        store: Where results are kept.
        worker: Module of the worker process.
        workers: Number of processes, on each machine.
        limit_s: Maximum wall time of a unit [s].
        more: Gives further fields of the request of a unit for a version.
        engine: Makes what runs the requests.
    """

    store: ResultStore[AnyUnit]
    worker: str
    workers: int
    limit_s: float = UNIT_LIMIT_S
    more: Callable[[AnyUnit, str], Mapping[str, Any]] = lambda unit, version: {}
    engine: EngineMaker = local_pool

    def run(
        self,
        jobs: Iterable[Job[AnyUnit]],
        on_progress: Callable[[AnyUnit, Mapping[str, Any]], None],
        stop: Callable[[], bool] = lambda: False,
        wanted: Callable[[AnyUnit], bool] = lambda unit: True,
    ) -> None:
        """Run units; each result is on disk before the next one is awaited.

        Args:
            jobs: Units in their order of start; no other run works on them (`claimed`).
            on_progress: Called with every unit and its result.
            stop: Asked after every unit; units in flight are lost when it agrees.
            wanted: Asked before a unit starts; units that are wanted no more are left out.

        Raises:
            WorkersUnusable: No worker process can be started, or it runs another version of the program.
            OSError: The disk is full; finished units are kept.
            KeyboardInterrupt: Ctrl-C; finished units are kept.
        """
        job_of: dict[int, tuple[Mapping[str, Any], Job[AnyUnit]]] = {}

        def requests() -> Iterator[Mapping[str, Any]]:
            for job in jobs:
                if wanted(job[0]):
                    request = {**self.store.request(*job), **self.more(*job)}
                    job_of[id(request)] = request, job  # Kept, so that no other request has its number.
                    yield request

        engine = self.engine(self.worker, self.workers, self.limit_s)
        # Closed on every exit, such as a full disk, so that no worker process stays behind.
        with closing(engine.run(requests())) as outcomes:
            for outcome in outcomes:
                _, (unit, version) = job_of.pop(id(outcome.request))
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
