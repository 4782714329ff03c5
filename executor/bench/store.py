"""A benchmark's folder: which series were asked for, and one file a unit, each complete or absent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from executor.bench.presence import alone
from executor.bench.units import SCHEMA, Series, Unit
from executor.machine.files import read_json, write_json

INDEX_SCHEMA = "scene2demo-bench/1"
INDEX = "bench.json"
RESULTS = ("summary.json", "report.html")
"""What is written anew into a benchmark's folder each time."""


class NotABench(ValueError):
    """A folder has no benchmark, or not the unit that was asked for."""


@dataclass(frozen=True, slots=True)
class BenchFolder:
    """Where a benchmark keeps what it found.

    `bench.json` lists the series, `units/` has one file a unit, named by the unit and its content id. Several
    processes, on several machines, may write units into one folder at once.
    """

    path: Path

    def series(self) -> tuple[Series, ...]:
        """Returns what was asked for, in the order of the rows.

        Raises:
            NotABench: The folder has no index, or one that cannot be read.
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
        """Adds series to the index and returns all of it; a cell asked for again is replaced, its units stay.

        Raises:
            NotABench: The folder has an index that cannot be read, or results of something else, which are kept.
        """
        if self.path.exists() and not self.path.is_dir():
            raise self._not_one("it is a file")
        there = (self.path / INDEX).exists()
        if found := [name for name in RESULTS if not there and (self.path / name).exists()]:
            raise self._not_one(f"it has {' and '.join(found)} of something else; choose another folder with --out")
        if there:
            self.series()  # Refuses what cannot be read before anything is written.
        with alone(self.path):  # What another run adds meanwhile is not lost.
            known = {(s.setting, s.family): s for s in (self.series() if (self.path / INDEX).exists() else ())}
            known |= {(s.setting, s.family): s for s in asked}
            ordered = tuple(sorted(known.values(), key=lambda s: (s.setting.name, s.family)))
            index = {"schema": INDEX_SCHEMA, "series": [series.to_json() for series in ordered]}
            write_json(self.path / INDEX, index)
        return ordered

    def place(self, unit: Unit, version: str) -> Path:
        """Returns where a unit's result belongs."""
        return self.path / "units" / f"{unit.name}-{unit.id(version)[:8]}.json"

    def read(self, unit: Unit, version: str) -> dict[str, Any] | None:
        """Returns a unit's result, or None when it was not run yet or its file cannot be read."""
        try:
            found: dict[str, Any] = read_json(self.place(unit, version))
        except (OSError, ValueError):
            return None
        return found if is_result(found) and found.get("id") == unit.id(version) else None

    def write(self, unit: Unit, version: str, result: Mapping[str, Any]) -> dict[str, Any]:
        """Writes a unit's result, all of it or nothing, and returns it with what names the unit."""
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
        """Returns the results of a series that are there, in the order of its units."""
        found = (self.read(unit, series.version) for unit in series.units())
        return [result for result in found if result is not None]

    def find(self, name: str) -> dict[str, Any]:
        """Returns the result of the unit whose name, file or beginning of either is given.

        Raises:
            NotABench: No unit, or more than one, is called so, or its file cannot be read.
        """
        stem = Path(name).name.removesuffix(".json")
        files = sorted((self.path / "units").glob("*.json")) if (self.path / "units").is_dir() else []
        fitting = [path for path in files if path.stem.startswith(stem)]
        exact = [path for path in fitting if path.stem[:-9] == stem or path.stem == stem]
        # One name may have results of several versions of the program; the index says which counts.
        counting = {self.place(unit, series.version) for series in self.series() for unit in series.units()}
        chosen = [path for path in exact or fitting if path in counting] or exact or fitting
        if not chosen:
            raise NotABench(f"{self.path} has no unit {name!r}; it has {len(files)}, such as {_names(files)}")
        if len(chosen) > 1:
            raise NotABench(f"{name!r} is the beginning of {len(chosen)} units of {self.path}: {_names(chosen)}")
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


def _names(files: Iterable[Path]) -> str:
    return ", ".join(path.stem for path in list(files)[:3]) or "none"


Amount = Annotated[float, Field(ge=0.0, le=1e12)]
Number = Annotated[float, Field(ge=-1e12, le=1e12)]
Count = Annotated[int, Field(ge=0, le=10**12)]
# What is read together.
_WITH = {
    "rss_mb": {"started_s", "worker", "peak_rss_mb"},
    "started_s": {"elapsed_s"},
    "revisions": {"succeeded_at_once"},
}


class _Form(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Failure(_Form):
    kind: str
    message: str = ""
    measurements: dict[str, Any] = {}
    primitive: None = None


class _StepFailure(_Form):
    kind: str
    message: str
    measurements: dict[str, Any] = {}
    primitive: str
    action: int | dict[str, Number | list[Number] | None]
    subtask: Count
    subtask_name: str
    step: Count
    time_s: Amount


class _Subtask(_Form):
    succeeded: bool


class _Resizing(_Form):
    factors: Annotated[list[Number], Field(min_length=1)]


class _Penetration(_Form):
    p99_m: Number
    deepest_m: Number
    pair: list[str]


class _Result(_Form):
    name: str
    ended: str
    seed: Count
    index: Count | None = None
    query: str = ""
    mistake: str = ""
    grasps_tried: Count = 0
    grasps_held: Count = 0
    failure: _StepFailure | _Failure | None = None
    subtask_names: list[str] = []
    subtasks: list[_Subtask] = []
    scaled: list[_Resizing] = []
    penetration: _Penetration = _Penetration(p99_m=0.0, deepest_m=0.0, pair=[])
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
    """Decides whether a file's content is a unit's result that can be counted."""
    try:
        _Result.model_validate(value)
    except (ValidationError, RecursionError):
        return False
    return isinstance(value, dict) and all(value.keys() >= needed for key, needed in _WITH.items() if key in value)
