"""Where episodes are kept: one folder a finished unit, complete or absent, and nothing else that counts.

    DIR/dataset.json              what was asked for, request by request
    DIR/units/NAME-ID/unit.json   what the unit was, how it ended, its texts, spans and numbers (`docs/datasets.md`)
                     samples.xz   its arrays (`executor.datasets.samples`); absent where nothing was to be kept
                     <view>.mp4 and the other pictures that were asked for (`executor.datasets.footage`)

A unit's folder is written aside and renamed. Several processes, on several machines, may write into one store at once.
What is made of a store goes through the episodes in the order of their folders' names, so that it does not matter who
made them, and when.
"""

from __future__ import annotations

import json
import math
import os
import secrets
import shutil
import time
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from bddl.files import opened
from executor.bench.presence import alone
from executor.bench.run import WHOLE, Shard
from executor.datasets import samples
from executor.datasets.units import SCHEMA, DemoSeries, DemoUnit
from executor.machine.files import content_key, json_text, plain, read_json, write_json, write_text
from executor.rollouts.checkpoint import Checkpoint
from oag import Scene, Task

INDEX_SCHEMA = "scene2demo-dataset/1"
INDEX, UNITS, META, SAMPLES = "dataset.json", "units", "unit.json", "samples.xz"
_BROKEN_OFF = ("crashed", "timed-out", "error")

_ASIDE = ".part-"
_TOKEN_BYTES = 4
_BEGIN_BYTES = 1 << 16  # Of a file of samples: as much as its header can take.


class NotADataset(ValueError):
    """A folder is no store of episodes, or an episode in it cannot be read."""


@dataclass(frozen=True)
class StoredEpisode:
    """One finished unit.

    Attributes:
        path: Its folder.
        meta: What its `unit.json` says.
    """

    path: Path
    meta: Mapping[str, Any]

    @property
    def name(self) -> str:
        """The name of its folder."""
        return self.path.name

    @property
    def succeeded(self) -> bool:
        """Whether the task's goal was reached."""
        return bool(self.meta["ended"] == "succeeded")

    @property
    def broken_off(self) -> bool:
        """Whether its process crashed or hung, so that nothing is known of how it would have ended."""
        return self.meta["ended"] in _BROKEN_OFF

    @property
    def has_samples(self) -> bool:
        """Whether its motion was kept."""
        return (self.path / SAMPLES).exists()

    @cached_property
    def arrays(self) -> dict[str, NDArray]:
        """Its arrays by name, as `executor.datasets.samples.columns` documents them.

        Raises:
            NotADataset: The file is missing, or no file of samples.
        """
        return self.motion(SAMPLES)

    def motion(self, file: str) -> dict[str, NDArray]:
        """Returns the arrays of one of its files of samples: its own, or that of an attempt that was revised.

        Raises:
            NotADataset: The file is missing, or no file of samples.
        """
        try:
            with opened(self._own(file)) as stream:
                return samples.unpacked(stream)
        except OSError as problem:
            raise NotADataset(f"{self.path / file} cannot be read: {problem.strerror}") from None
        except samples.BadSamples as problem:
            raise NotADataset(f"{self.path / file}: {problem}") from None

    def shapes(self, file: str) -> dict[str, tuple[int, ...]]:
        """Returns the shapes of the arrays of a file of samples, of which it reads no more than it has to.

        Raises:
            NotADataset: The file is missing, or no file of samples.
        """
        try:
            with opened(self._own(file)) as stream:
                return samples.shapes(stream.read(_BEGIN_BYTES))
        except OSError as problem:
            raise NotADataset(f"{self.path / file} cannot be read: {problem.strerror}") from None
        except samples.BadSamples as problem:
            raise NotADataset(f"{self.path / file}: {problem}") from None

    def _own(self, file: str) -> Path:
        if Path(file).name != file or file == "..":
            raise NotADataset(f"{self.path / META} names {file!r}, which is no file of its folder")
        return self.path / file

    @property
    def motion_key(self) -> str:
        """What is equal where two episodes have the same recorded states, whatever they were asked for as."""
        return content_key(str(self.meta["state_hash"]), json_text(float(self.meta["record_hz"])))

    @property
    def demonstration_key(self) -> str:
        """What is equal where two episodes have the same sentence and pictures too, so that one says it all."""
        return content_key(self.motion_key, json_text([self.meta.get("query"), self.meta.get("pictures")]))

    @property
    def corrections(self) -> tuple[Mapping[str, Any], ...]:
        """What failed in it and was revised, as `executor.datasets.corrections` keeps it."""
        return tuple(self.meta.get("corrections") or ())

    @cached_property
    def scene(self) -> Scene:
        """The concrete scene."""
        return Scene.from_json(self.meta["scene"])

    @cached_property
    def task(self) -> Task:
        """The task as it was run, numbers filled in."""
        return Task.from_json(self.meta["task"], scene=self.scene)

    @cached_property
    def start(self) -> Checkpoint | None:
        """Where it begins; None for the scene's own start.

        Raises:
            CheckpointError: What is said of it is no checkpoint.
        """
        return start_of(self.meta.get("takeover"))

    @cached_property
    def whole_task(self) -> Task:
        """The task from the scene's start on, where the planner went on with a part of it; else the task."""
        takeover = self.meta.get("takeover")
        return self.task if takeover is None else Task.from_json(takeover["task"], scene=self.scene)


def start_of(takeover: Mapping[str, Any] | None) -> Checkpoint | None:
    """Returns where an episode begins, by what is said of the one who acted before the planner; None for nobody.

    Raises:
        CheckpointError: It says no such place.
    """
    return None if takeover is None else Checkpoint.from_bytes(json.dumps(takeover["start"]).encode())


@dataclass(frozen=True)
class EpisodeStore:
    """A folder of episodes."""

    path: Path

    @classmethod
    def open(cls, path: Path) -> EpisodeStore:
        """Returns a store that is there.

        Raises:
            NotADataset: There is none.
        """
        store = cls(path)
        store.requests()
        return store

    def requests(self) -> tuple[Mapping[str, Any], ...]:
        """Returns what was asked for, in order.

        Raises:
            NotADataset: The folder has no index, or one that cannot be read.
        """
        try:
            index = read_json(self.path / INDEX)
            if index["schema"] != INDEX_SCHEMA:
                raise self._not_one(f"its {INDEX} is of {index['schema']!r}, this program reads {INDEX_SCHEMA!r}")
            return tuple(dict(request) for request in index["requests"])
        except OSError as problem:
            raise self._not_one(f"its {INDEX} cannot be read ({problem.strerror})") from None
        except (ValueError, KeyError, TypeError) as problem:
            if isinstance(problem, NotADataset):
                raise
            raise self._not_one(f"its {INDEX} does not list requests as one does") from None

    def add_requests(self, asked: Iterable[Mapping[str, Any]]) -> None:
        """Adds to what was asked for, once each; the store is made when absent.

        Raises:
            NotADataset: Something else is there.
            OSError: The folder cannot be written.
        """
        if self.path.exists() and not self.path.is_dir():
            raise self._not_one("it is a file")
        there = (self.path / INDEX).exists()
        if not there and self.path.exists() and any(self.path.iterdir()):
            raise self._not_one("it has files of something else; choose another folder with --out")
        if there:
            self.requests()
        with alone(self.path):
            known = list(self.requests()) if (self.path / INDEX).exists() else []
            for request in map(plain, asked):  # As it will be read: tuples are lists.
                known += [] if request in known else [request]
            write_json(self.path / INDEX, {"schema": INDEX_SCHEMA, "requests": known})

    def place(self, unit: DemoUnit, version: str) -> Path:
        """Returns where a unit's episode belongs."""
        return self.path / UNITS / unit.folder(version)

    def read(self, unit: DemoUnit, version: str) -> StoredEpisode | None:
        """Returns a unit's episode, under whatever program's id of it, or None when it was not made yet."""
        for unit_id in unit.ids(version):
            try:
                found = self.episode(unit.folder_of(unit_id))
            except NotADataset:
                continue
            if found.meta.get("id") == unit_id:
                return found
        return None

    @contextmanager
    def writing(self, unit: DemoUnit, version: str) -> Iterator[Path]:
        """Gives a new folder, which becomes the unit's when the block ends without an exception.

        What another process has meanwhile made of the same unit is kept, since it is the same; only what says no more
        than that its process did not finish it gives way.

        Raises:
            OSError: The folder cannot be written.
        """
        place = self.place(unit, version)
        aside, before = self._aside(place.name), self._aside(place.name)
        aside.mkdir(parents=True)
        try:
            yield aside
            there = self.read(unit, version)
            if there is None or there.broken_off:
                unfinished = place if there is None else there.path
                with suppress(FileNotFoundError):
                    unfinished.rename(before)  # At one go: at every moment the unit is whole, or not there.
                try:
                    aside.rename(place)
                except OSError:
                    if not self._has_result(unit, version):
                        raise
        finally:
            for path in (aside, before):
                shutil.rmtree(path, ignore_errors=True)

    def _aside(self, folder: str) -> Path:
        return self.path / UNITS / f"{_ASIDE}{folder}-{secrets.token_hex(_TOKEN_BYTES)}"

    def _has_result(self, unit: DemoUnit, version: str) -> bool:
        found = self.read(unit, version)
        return found is not None and not found.broken_off

    def write(self, unit: DemoUnit, version: str, meta: Mapping[str, Any], aside: Path) -> None:
        """Writes what a unit was and how it ended into its new folder."""
        named = {"schema": SCHEMA, "id": unit.id(version), "name": unit.name, "version": version}
        text = json.dumps(plain({**named, "unit": unit.to_json(), **meta}), allow_nan=False)
        write_text(aside / META, text + "\n")

    def tidy(self, mine: Container[str], older_than_s: float = math.inf) -> None:
        """Removes what processes that were killed had begun.

        A process that lives after all writes to nothing: the folder is gone at one go.

        Args:
            mine: Names of the folders of units that nobody else is at work on: what was begun of these goes.
            older_than_s: Age that no living process's folder reaches, so that what is older goes, whosever it was.
        """
        for path in self.path.glob(f"{UNITS}/{_ASIDE}*"):
            unit_folder = path.name.removeprefix(_ASIDE)[: -1 - 2 * _TOKEN_BYTES]
            with suppress(OSError):  # Somebody else is tidying too.
                if unit_folder in mine or time.time() - path.stat().st_mtime >= older_than_s:
                    shutil.rmtree(path.rename(self._aside("gone")), ignore_errors=True)

    def episodes(self) -> Iterator[StoredEpisode]:
        """Yields all finished units in the order of their folders' names.

        Raises:
            NotADataset: One of them cannot be read.
        """
        folder = self.path / UNITS
        for name in sorted(os.listdir(folder)) if folder.is_dir() else ():
            if not name.startswith("."):
                yield self.episode(name)

    def demonstrations(self) -> Iterator[StoredEpisode]:
        """Yields the successes whose motion was kept, in order."""
        return (episode for episode in self.episodes() if episode.succeeded and episode.has_samples)

    def episode(self, name: str) -> StoredEpisode:
        """Returns a finished unit by its folder's name.

        Raises:
            NotADataset: It is not there, or cannot be read.
        """
        path = self.path / UNITS / name
        try:
            meta = read_json(path / META)
            if meta["schema"] != SCHEMA:
                raise NotADataset(f"{path / META} is of {meta['schema']!r}, this program reads {SCHEMA!r}")
            DemoUnit.from_json(meta["unit"])
        except OSError as problem:
            raise NotADataset(f"{path / META} cannot be read: {problem.strerror}") from None
        except (ValueError, KeyError, TypeError) as problem:
            if isinstance(problem, NotADataset):
                raise
            raise NotADataset(f"{path / META} does not say what a unit was") from None
        return StoredEpisode(path, meta)

    def _not_one(self, why: str) -> NotADataset:
        return NotADataset(f"{self.path} is not a store of episodes: {why}")


def pending(
    store: EpisodeStore, series: Iterable[DemoSeries], version: str, shard: Shard = WHOLE, *, again: bool = False
) -> Iterator[DemoUnit]:
    """Yields the units that are still to be made.

    Args:
        store: Where episodes are kept.
        series: What was asked for.
        version: Hash of the program.
        shard: Which part of them.
        again: Whether units whose process crashed or hung are made once more.
    """
    for place, unit in enumerate(unit for one in series for unit in one.units()):
        if not shard.has(place):
            continue
        done = store.read(unit, version)
        if done is None or (again and done.broken_off):
            yield unit
