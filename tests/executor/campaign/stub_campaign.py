"""A campaign of units that do nothing: `python stub_campaign.py FOLDER UNITS SECONDS --workers N [--shard i/n]`.

Each unit appends a line to a log of its own, so that units that ran twice are seen. No process is started for one.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from collections.abc import Generator, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from executor.campaign.engine import Campaign, Engine, Shard, claimed, result_of
from executor.system.workers import WorkerOutcome


@dataclass(frozen=True)
class StubUnit:
    """A numbered unit."""

    number: int

    def id(self, version: str) -> str:
        """Return its id."""
        return f"{version}-{self.number:04d}"


@dataclass(frozen=True)
class StubFolder:
    """A file for every finished unit."""

    path: Path

    def ending(self, unit: StubUnit, version: str) -> str | None:
        """Return how a unit ended."""
        return "succeeded" if (self.path / unit.id(version)).exists() else None

    def request(self, unit: StubUnit, version: str) -> dict[str, Any]:
        """Return a unit's request."""
        return {"number": unit.number, "id": unit.id(version), "folder": str(self.path)}

    def keep(self, unit: StubUnit, version: str, outcome: WorkerOutcome) -> Mapping[str, Any]:
        """Write a unit's file, which nobody else has written."""
        with (self.path / unit.id(version)).open("x") as file:
            file.write("done\n")
        return result_of(outcome)


class InPlace:
    """An engine without processes."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def run(self, requests: Iterable[Mapping[str, Any]]) -> Generator[WorkerOutcome, None, None]:
        """Do nothing for a while, request by request."""
        for request in requests:
            time.sleep(self._seconds)
            yield WorkerOutcome(request, "finished", {"ended": "succeeded"}, "", 0.0, self._seconds, os.getpid())


def units(folder: Path, count: int) -> list[tuple[StubUnit, str]]:
    """Return the jobs of a folder."""
    return [(StubUnit(number), "v") for number in range(count)]


def main() -> int:
    """Run what is left of a part."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("units", type=int)
    parser.add_argument("seconds", type=float)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--shard", default="1/1")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    number, of = map(int, options.shard.split("/"))
    store = StubFolder(options.folder)
    engine: Engine = InPlace(options.seconds)
    try:
        with claimed(store, units(options.folder, options.units), Shard(number, of), 20.0) as todo:
            Campaign(store, "", 1, engine=lambda *_: engine).run(todo, lambda unit, result: None)
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
