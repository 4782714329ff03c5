"""Folder of a benchmark: an index of the requested series, and one result file per unit, each complete or absent."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bddl.errors import Scene2DemoError
from executor.bench.units import SCHEMA, Series, Unit
from executor.campaign.claims import exclusive_lock
from executor.campaign.engine import result_of
from executor.campaign.planning_model import ANSWERS, EXCHANGES, replay_words, was_made
from executor.system.files import read_json, write_json
from executor.system.workers import WorkerOutcome

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

    def ending(self, unit: Unit, version: str) -> str | None:
        """Return how a unit ended, or None when it was not run yet."""
        done = self.read(unit, version)
        return None if done is None else str(done["ended"])

    def request(self, unit: Unit, version: str) -> dict[str, Any]:
        """Return the request of a unit to its worker process."""
        own = {} if unit.setting.model is None else self._answers_of(unit, version)
        return {**unit.to_json(), "version": version, **own}

    def _answers_of(self, unit: Unit, version: str) -> dict[str, str]:
        """Return where a process keeps what a unit's model answers."""
        return {"folder": str(self.path), "place": self.place(unit, version).stem}

    def answers(self, result: Mapping[str, Any]) -> Path:
        """Return the recording of what a unit's model answered."""
        return self.path / ANSWERS / f"{result['name']}-{result['id'][:8]}" / EXCHANGES

    def keep(self, unit: Unit, version: str, outcome: WorkerOutcome) -> Mapping[str, Any]:
        """Write the outcome of a unit's process, and return the content of its file."""
        result = result_of(outcome)
        if not was_made(result):
            return {**unit.to_json(), **result, "id": unit.id(version), "name": unit.name}
        return self.write(unit, version, result)

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
            raise NotABench(f"{chosen[0]} is not a unit of a benchmark; the same `scene2demo bench` makes it again")
        return found

    def replay(self, name: str) -> Path:
        """Return where `bench replay` puts a unit that was run again, unless it is told otherwise."""
        return self.path / "replays" / Path(name).name

    def commands(self, result: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Yield what can be done with a unit's result -> the command.

        There is nothing for a baseline's, and for a wish whose model's answers no command can name.
        """
        if result["setting"].get("baseline") is not None:
            return
        if result["family"] != "T7":
            again = ["bench", "replay", str(self.path), result["name"]]
            yield "run it again, with video and report", shlex.join(["scene2demo", *again])
            return
        wish = [str(result.get("query", "QUERY")), "--scene", f"t7-{result['seed']}", "--keep-sizes"]
        if (model := result["setting"].get("model")) is not None:
            replayed = replay_words(model, self.answers(result))
            if not replayed:
                return
            wish += replayed
        if result["ended"] == "refused":
            yield "see why the wish is refused", shlex.join(["scene2demo", "plan", *wish])
        else:
            yield "the same wish, with video and report", shlex.join(["scene2demo", "run", *wish, "--out", "FOLDER"])

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
    proved: bool = False
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
