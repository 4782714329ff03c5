"""How far a shared folder is: what is done, runs, and was lost, at which rate, from the files alone.

Any machine that sees the folder can ask, and no run is disturbed.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from executor.bench import folder as bench_folder
from executor.bench.folder import BenchFolder
from executor.campaign.claims import ClaimedRun, runs_in
from executor.campaign.versions import outcome_version
from executor.data.store import INDEX, EpisodeStore, NotADataset
from executor.data.units import DemoSeries
from executor.system.files import read_json
from executor.view.stores import StoreListing

EVALUATION = "evaluation-units.json"
_LATEST = 200
"""Units by whose times the rate is measured."""
_TRIES = 3


@dataclass(frozen=True, slots=True)
class Asked:
    """One unit that was asked for.

    Attributes:
        id: Its id.
        file: Its folder or file, relative to `units/`.
    """

    id: str
    file: str


@dataclass(frozen=True, slots=True)
class FolderProgress:
    """How far a folder is.

    Attributes:
        kind: "store", "benchmark" or "evaluation".
        asked: Number of units that were asked for.
        endings: Ending -> number of finished units.
        failures: Kind of failure -> number of units.
        runs: Runs that live.
        running: Units that these have claimed and not finished.
        lost: Units whose run ended without finishing or giving them back.
        an_hour: Finished units an hour, by the times of the latest; None before there are two.
    """

    kind: str
    asked: int
    endings: Counter[str]
    failures: Counter[str]
    runs: tuple[ClaimedRun, ...]
    running: int
    lost: int
    an_hour: float | None

    @property
    def done(self) -> int:
        """Number of finished units."""
        return self.endings.total()

    @property
    def left_s(self) -> float | None:
        """Time until all are done at this rate [s]; None where nothing runs or no rate is known."""
        if not self.running or not self.an_hour:
            return None
        return 3600.0 * (self.asked - self.done) / self.an_hour

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "kind": self.kind,
            "asked": self.asked,
            "done": self.done,
            "endings": dict(self.endings.most_common()),
            "failures": dict(self.failures.most_common()),
            "runs": [{"host": run.host, "process": run.process, "units": len(run.units)} for run in self.runs],
            "running": self.running,
            "lost": self.lost,
            "an_hour": self.an_hour,
            "left_s": self.left_s,
        }


def progress_of(path: Path) -> FolderProgress:
    """Return how far the folder of a store, a benchmark or an evaluation is.

    Raises:
        NotADataset, NotABench: It is neither.
    """
    if (path / EVALUATION).exists():
        return _progress(path, "evaluation", list(_asked_of_evaluation(path)), _endings_in_files(path))
    if (path / bench_folder.INDEX).exists() and not (path / INDEX).exists():
        return _progress(path, "benchmark", list(_asked_of_bench(path)), _endings_in_files(path))
    endings = _endings_of_store(path)
    return _progress(path, "store", list(_asked_of_store(path, endings)), endings)


def _progress(path: Path, kind: str, asked: list[Asked], endings: dict[str, tuple[str, str]]) -> FolderProgress:
    asked = list(dict.fromkeys(asked))  # Requests may have units in common.
    done = {unit.id: endings[unit.file] for unit in asked if unit.file in endings}
    left = {unit.id for unit in asked} - set(done)
    runs = runs_in(path)
    living = tuple(run for run in runs if run.lives)
    running = left & {unit for run in living for unit in run.units}
    lost = left & {unit for run in runs for unit in run.units} - running
    failures = Counter(kind for ended, kind in done.values() if ended != "succeeded" and kind)
    files = [unit.file for unit in asked if unit.id in done]
    return FolderProgress(
        kind,
        len(asked),
        Counter(ended for ended, _ in done.values()),
        failures,
        living,
        len(running),
        len(lost),
        _an_hour(path / "units", files, min((run.began_s for run in living), default=0.0)),
    )


def _an_hour(folder: Path, files: list[str], began_s: float) -> float | None:
    """Return how many units were finished an hour, from the latest of them since the present runs began."""
    times = []
    for file in files:
        with suppress(OSError):
            times.append((folder / file).stat().st_mtime)
    latest = sorted(at for at in times if at >= began_s)[-_LATEST:]
    if len(latest) < 2:
        return None
    span_s = (time.time() if began_s else latest[-1]) - latest[0]
    return 3600.0 * (len(latest) - 1) / span_s if span_s > 0.0 else None


def _asked_of_store(path: Path, endings: Mapping[str, tuple[str, str]]) -> Iterator[Asked]:
    version = outcome_version()
    for request in EpisodeStore.open(path).requests():
        try:
            series = DemoSeries.from_json(request)
        except ValueError:
            raise NotADataset(f"{path}: its {INDEX} does not list requests as one does") from None
        units = [Asked(unit_id := unit.id(version), unit.folder_of(unit_id)) for unit in series.units()]
        made = [unit for unit in units if unit.file in endings]
        succeeded = sum(endings[unit.file][0] == "succeeded" for unit in made)
        # With its successes there, a series wants no more units.
        yield from made if series.successes is not None and succeeded >= series.successes else units


def _endings_of_store(path: Path) -> dict[str, tuple[str, str]]:
    for tries in range(_TRIES):
        try:
            return {row.name: (row.ended, row.failure) for row in StoreListing(path).rows()}
        except NotADataset:  # A unit was being replaced.
            if tries == _TRIES - 1:
                raise
    return {}


def _asked_of_evaluation(path: Path) -> Iterator[Asked]:
    """Yield what `executor.learn.evaluation_units` has listed; that module needs the extra `learn`, and this none."""
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        for unit_id, file in read_json(path / EVALUATION)["units"].items():
            yield Asked(str(unit_id), str(file))


def _asked_of_bench(path: Path) -> Iterator[Asked]:
    store = BenchFolder(path)
    for series in store.series():
        for unit in series.units():
            yield Asked(unit.id(series.version), store.place(unit, series.version).name)


def _endings_in_files(path: Path) -> dict[str, tuple[str, str]]:
    found: dict[str, tuple[str, str]] = {}
    with suppress(FileNotFoundError), os.scandir(path / "units") as entries:
        for entry in entries:
            if entry.name.endswith(".json"):
                with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
                    result = read_json(Path(entry.path))
                    found[entry.name] = str(result["ended"]), str((result.get("failure") or {}).get("kind") or "")
    return found
