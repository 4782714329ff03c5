"""Campaign of a benchmark: claim units with a file lock, run pending ones in processes, keep each result at once.

A run keeps a card in `running/` locked while it lives. The system releases the lock when the process ends, however it
ends. Nothing has to be cleaned up by hand. Where the system or the disk has no such locks, no run is refused. The
folder lists the requested series and has one result file per unit, each complete or absent.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bddl.errors import Scene2DemoError
from bddl.files import open_plain
from executor.bench.units import SCHEMA, Series, Unit
from executor.system.files import read_json, write_json
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


INDEX_SCHEMA = "scene2demo-bench/1"
INDEX = "bench.json"
RESULTS = ("summary.json", "report.html")
"""Files of a benchmark's folder that every run rewrites."""


class NotABench(Scene2DemoError, ValueError):
    """A folder has no benchmark, or not the requested unit."""


@dataclass(frozen=True, slots=True)
class BenchFolder:
    """Folder of a benchmark's results.

    `bench.json` lists the series; `units/` has one file per unit, named by the unit and its content id. Several
    processes, on several machines, may write units into one folder at once.
    """

    path: Path

    def series(self) -> tuple[Series, ...]:
        """Return the requested series, in the order of the rows.

        Raises:
            NotABench: The folder has no readable index.
        """
        try:
            index = read_json(self.path / INDEX)
        except OSError as problem:
            raise self._not_one(f"its {INDEX} cannot be read ({problem.strerror})") from None
        except ValueError as problem:
            raise self._not_one(f"its {INDEX} is not JSON ({problem})") from None
        try:
            return tuple(Series.from_json(entry) for entry in index["series"])
        except (KeyError, TypeError, ValueError, AttributeError):
            raise self._not_one(f"its {INDEX} does not list series as one does") from None

    def add_series(self, asked: Iterable[Series]) -> tuple[Series, ...]:
        """Add series to the index and return all of it; a repeated cell is replaced, its units stay.

        Raises:
            NotABench: The folder has an unreadable index, or other results, which are kept.
        """
        if self.path.exists() and not self.path.is_dir():
            raise self._not_one("it is a file")
        there = (self.path / INDEX).exists()
        if found := [name for name in RESULTS if not there and (self.path / name).exists()]:
            raise self._not_one(f"it has {' and '.join(found)} of something else; choose another folder with --out")
        if there:
            self.series()  # Refuse an unreadable index before anything is written.
        with exclusive_lock(self.path):  # Additions of another run are not lost.
            known = {(s.setting, s.family): s for s in (self.series() if (self.path / INDEX).exists() else ())}
            known |= {(s.setting, s.family): s for s in asked}
            ordered = tuple(sorted(known.values(), key=lambda s: (s.setting.name, s.family)))
            index = {"schema": INDEX_SCHEMA, "series": [series.to_json() for series in ordered]}
            write_json(self.path / INDEX, index)
        return ordered

    def place(self, unit: Unit, version: str) -> Path:
        """Return the path of a unit's result."""
        return self.path / "units" / f"{unit.name}-{unit.id(version)[:8]}.json"

    def read(self, unit: Unit, version: str) -> dict[str, Any] | None:
        """Return a unit's result, or None when it was not run yet or its file is unreadable."""
        try:
            found: dict[str, Any] = read_json(self.place(unit, version))
        except (OSError, ValueError):
            return None
        return found if is_result(found) and found.get("id") == unit.id(version) else None

    def write(self, unit: Unit, version: str, result: Mapping[str, Any]) -> dict[str, Any]:
        """Write a unit's result atomically, and return it with the unit's identity."""
        named = {
            "schema": SCHEMA,
            "id": unit.id(version),
            "name": unit.name,
            "version": version,
            **unit.to_json(),
            **result,
        }
        write_json(self.place(unit, version), named)
        return named

    def results(self, series: Series) -> list[dict[str, Any]]:
        """Return the existing results of a series, in the order of its units."""
        found = (self.read(unit, series.version) for unit in series.units())
        return [result for result in found if result is not None]

    def find(self, name: str) -> dict[str, Any]:
        """Return the result of a unit by its name, its file, or the begin of either.

        Raises:
            NotABench: No unit, or more than one, matches, or its file is unreadable.
        """
        stem = Path(name).name.removesuffix(".json")
        files = sorted((self.path / "units").glob("*.json")) if (self.path / "units").is_dir() else []
        fitting = [path for path in files if path.stem.startswith(stem)]
        exact = [path for path in fitting if path.stem[:-9] == stem or path.stem == stem]
        # One name may have results of several versions of the program; the index decides.
        counting = {self.place(unit, series.version) for series in self.series() for unit in series.units()}
        chosen = [path for path in exact or fitting if path in counting] or exact or fitting
        if not chosen:
            raise NotABench(f"{self.path} has no unit {name!r}; it has {len(files)}, such as {_some_names(files)}")
        if len(chosen) > 1:
            raise NotABench(f"{name!r} is the beginning of {len(chosen)} units of {self.path}: {_some_names(chosen)}")
        try:
            found: dict[str, Any] = read_json(chosen[0])
            whole = found["name"] == Unit.from_json(found).name and bool(found["ended"])
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            whole = False
        if not whole:
            raise NotABench(f"{chosen[0]} is not a unit of a benchmark; the same `scene2demo bench` makes it anew")
        return found

    def _not_one(self, why: str) -> NotABench:
        return NotABench(f"{self.path} is not a benchmark's folder: {why}")


def _some_names(files: Iterable[Path]) -> str:
    return ", ".join(path.stem for path in list(files)[:3]) or "none"


Amount = Annotated[float, Field(ge=0.0, le=1e12)]
Number = Annotated[float, Field(ge=-1e12, le=1e12)]
Count = Annotated[int, Field(ge=0, le=10**12)]
# Keys that are read together.
_READ_TOGETHER = {
    "rss_mb": {"started_s", "worker", "peak_rss_mb"},
    "started_s": {"elapsed_s"},
    "revisions": {"succeeded_at_once"},
}


class _StrictForm(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _FailureForm(_StrictForm):
    kind: str
    message: str = ""
    measurements: dict[str, Any] = {}
    primitive: None = None


class _StepFailureForm(_StrictForm):
    kind: str
    message: str
    measurements: dict[str, Any] = {}
    primitive: str
    action: int | dict[str, Number | list[Number] | None]
    subtask: Count
    subtask_name: str
    step: Count
    time_s: Amount


class _SubtaskForm(_StrictForm):
    succeeded: bool


class _ResizingForm(_StrictForm):
    factors: Annotated[list[Number], Field(min_length=1)]


class _PenetrationForm(_StrictForm):
    p99_m: Number
    deepest_m: Number
    pair: list[str]


class _ResultForm(_StrictForm):
    name: str
    ended: str
    seed: Count
    index: Count | None = None
    query: str = ""
    mistake: str = ""
    grasps_tried: Count = 0
    grasps_held: Count = 0
    failure: _StepFailureForm | _FailureForm | None = None
    subtask_names: list[str] = []
    subtasks: list[_SubtaskForm] = []
    scaled: list[_ResizingForm] = []
    penetration: _PenetrationForm = _PenetrationForm(p99_m=0.0, deepest_m=0.0, pair=[])
    peaks: dict[str, Amount] = {}
    revisions: Count = 0
    succeeded_at_once: bool = False
    started_s: Amount = 0.0
    elapsed_s: Amount = 0.0
    simulated_s: Amount = 0.0
    bystanders_moved_m: Amount = 0.0
    taken_twice: Count = 0
    worker: Count = 0
    wall_s: dict[str, Amount] = {}
    rss_mb: Annotated[float, Field(gt=0.0, le=1e12)] = 1.0
    peak_rss_mb: Amount = 0.0
    traceback: list[str] = []


def is_result(value: object) -> bool:
    """Decide whether a file's content is a valid result of a unit."""
    try:
        _ResultForm.model_validate(value)
    except (ValidationError, RecursionError):
        return False
    return isinstance(value, dict) and all(
        value.keys() >= needed for key, needed in _READ_TOGETHER.items() if key in value
    )


WORKER = "executor.bench.worker"
UNIT_LIMIT_S = 900.0
"""Wall time after which a unit's process of a benchmark counts as hung."""

UnitCallback = Callable[[Unit, Mapping[str, Any]], None]


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
    folder: BenchFolder, series: Sequence[Series], shard: Shard = WHOLE, *, again: bool = False
) -> Iterator[tuple[Unit, str]]:
    """Yield the units that are still to be run, with their versions of the program.

    Args:
        folder: Folder of the results.
        series: The requests.
        shard: Part of the units.
        again: Whether to repeat units whose process crashed or hung.
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
    on_progress: UnitCallback,
    *,
    limit_s: float = UNIT_LIMIT_S,
    worker: str = WORKER,
) -> None:
    """Run units; each result is on disk before the next one is awaited.

    Args:
        folder: Folder of the results.
        units: Units with their versions of the program.
        workers: Number of processes.
        on_progress: Called with every unit and its result.
        limit_s: Maximum wall time of a unit [s].
        worker: Module of the worker process.

    Raises:
        WorkersUnusable: No worker process can be started, or it runs another version of the program.
        KeyboardInterrupt: Ctrl-C; finished units are on disk.
    """
    versions = {unit: version for unit, version in units}
    # Each process's software renderer would use all cores.
    pool = WorkerPool(worker, workers, limit_s=limit_s, environment={"LP_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"})
    # Closed on every exit, such as a full disk, so that no worker process stays behind.
    requests = [{**unit.to_json(), "version": version} for unit, version in versions.items()]
    with closing(pool.run(requests)) as outcomes:
        for outcome in outcomes:
            unit = Unit.from_json(outcome.request)
            on_progress(unit, folder.write(unit, versions[unit], result_of(outcome)))


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
