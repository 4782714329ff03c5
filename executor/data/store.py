"""Store of episodes: one folder per finished unit, complete or absent.

    DIR/dataset.json              the requests, in order
    DIR/units/NAME-ID/unit.json   unit, outcome, texts, spans and numbers (`docs/datasets.md`)
                     samples.xz   arrays (`executor.data.samples`); absent where no motion was kept
                     audit.json   verdict of `dataset audit`, where one was asked for
                     <view>.mp4 and further requested pictures (`executor.data.views`)

A unit's folder is written under a temporary name and renamed. Several processes, on several machines, may write into
one store at once. Exports go through the episodes in the order of folder names. Who made them, and when, has no effect.
"""

from __future__ import annotations

import hashlib
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
from typing import Any, BinaryIO

from numpy.typing import NDArray

from bddl.errors import Scene2DemoError
from bddl.files import open_input
from executor.campaign.claims import exclusive_lock
from executor.campaign.engine import UNFINISHED, result_of
from executor.data import samples
from executor.data.units import SCHEMA, DemoUnit
from executor.rollouts.checkpoint import Checkpoint
from executor.system.files import content_key, json_text, plain, read_json, write_json, write_text
from executor.system.workers import WorkerOutcome
from oag import Scene, Task

INDEX_SCHEMA = "scene2demo-dataset/1"
INDEX, UNITS, META, SAMPLES, AUDIT = "dataset.json", "units", "unit.json", "samples.xz", "audit.json"
NOT_AUDITED = "no"

_ASIDE = ".part-"
_TOKEN_BYTES = 4
_BEGIN_BYTES = 1 << 16  # Begin of a file of samples: the maximum size of its header.


class NotADataset(Scene2DemoError, ValueError):
    """A folder is no store of episodes, or an episode in it is unreadable."""


@dataclass(frozen=True)
class StoredEpisode:
    """One finished unit.

    Attributes:
        path: Its folder.
        meta: Content of its `unit.json`.
    """

    path: Path
    meta: Mapping[str, Any]

    @property
    def name(self) -> str:
        """Name of its folder."""
        return self.path.name

    @property
    def succeeded(self) -> bool:
        """Whether the task's goal was reached."""
        return bool(self.meta["ended"] == "succeeded")

    @property
    def broken_off(self) -> bool:
        """Whether its process crashed or hung, so that its outcome is unknown, or a file of it was cut off since."""
        return self.meta["ended"] in UNFINISHED or self.cut_off

    @cached_property
    def cut_off(self) -> bool:
        """Whether a file of samples ends early, as after a copy that was interrupted."""
        return not all(map(samples.is_whole, self.path.glob(f"*{Path(SAMPLES).suffix}")))

    @property
    def has_samples(self) -> bool:
        """Whether its motion was kept."""
        return (self.path / SAMPLES).exists()

    @cached_property
    def arrays(self) -> dict[str, NDArray]:
        """Its arrays by name, as `executor.data.samples.columns` documents them.

        Raises:
            NotADataset: The file is missing, or no file of samples.
        """
        return self.motion(SAMPLES)

    def motion(self, file: str) -> dict[str, NDArray]:
        """Return the arrays of one of its files of samples: its own, or that of a revised attempt.

        Raises:
            NotADataset: The file is missing, or no file of samples.
        """
        with self._opened(file) as stream:
            return samples.unpacked(stream)

    def shapes(self, file: str) -> dict[str, tuple[int, ...]]:
        """Return the shapes of the arrays of a file of samples, reading only its begin.

        Raises:
            NotADataset: The file is missing, or no file of samples.
        """
        with self._opened(file) as stream:
            return samples.shapes(stream.read(_BEGIN_BYTES))

    @contextmanager
    def _opened(self, file: str) -> Iterator[BinaryIO]:
        if Path(file).name != file or file == "..":
            raise NotADataset(f"{self.path / META} names {file!r}, which is no file of its folder")
        try:
            with open_input(self.path / file) as stream:
                yield stream
        except OSError as problem:
            raise NotADataset(f"{self.path / file} cannot be read: {problem.strerror}") from None
        except samples.BadSamples as problem:
            raise NotADataset(f"{self.path / file}: {problem}") from None

    @property
    def motion_key(self) -> str:
        """Key of the recorded states, whatever the request."""
        return content_key(str(self.meta["state_hash"]), json_text(float(self.meta["record_hz"])))

    @property
    def demonstration_key(self) -> str:
        """Key of states, sentence and pictures; episodes with equal keys are duplicates."""
        return content_key(self.motion_key, json_text([self.meta.get("query"), self.meta.get("pictures")]))

    @property
    def corrections(self) -> tuple[Mapping[str, Any], ...]:
        """Failed and revised attempts, as `executor.data.work` writes them."""
        return tuple(self.meta.get("corrections") or ())

    @property
    def content_hash(self) -> str:
        """SHA-256 of its `unit.json` and samples."""
        digest = hashlib.sha256()
        for name in (META, SAMPLES):
            with suppress(FileNotFoundError):
                digest.update(hashlib.sha256((self.path / name).read_bytes()).digest())
        return digest.hexdigest()

    @property
    def audited(self) -> Mapping[str, Any] | None:
        """Verdict of its audit (`executor.audit`); None without one, or where its files have changed since."""
        try:
            found = read_json(self.path / AUDIT)
        except (OSError, ValueError):
            return None
        return found if isinstance(found, dict) and found.get("content") == self.content_hash else None

    @property
    def audit_word(self) -> str:
        """Its verdict in a word: sound, flawed or undecided; "no" without an audit."""
        return str((self.audited or {}).get("verdict", NOT_AUDITED))

    @cached_property
    def scene(self) -> Scene:
        """The concrete scene."""
        return Scene.from_json(self.meta["scene"])

    @cached_property
    def task(self) -> Task:
        """Executed task, with filled numbers."""
        return Task.from_json(self.meta["task"], scene=self.scene)

    @cached_property
    def start(self) -> Checkpoint | None:
        """Start of the episode; None for the scene's own start.

        Raises:
            CheckpointError: The recorded start is no checkpoint.
        """
        return start_of(self.meta.get("takeover"))

    @cached_property
    def whole_task(self) -> Task:
        """Task from the scene's start; after a takeover the planner did only a part of it."""
        takeover = self.meta.get("takeover")
        return self.task if takeover is None else Task.from_json(takeover["task"], scene=self.scene)


def start_of(takeover: Mapping[str, Any] | None) -> Checkpoint | None:
    """Return the start of an episode from its `takeover` record; None without one.

    Raises:
        CheckpointError: It has no such start.
    """
    return None if takeover is None else Checkpoint.from_bytes(json.dumps(takeover["start"]).encode())


@dataclass(frozen=True)
class EpisodeStore:
    """Folder of episodes."""

    path: Path

    @classmethod
    def open(cls, path: Path) -> EpisodeStore:
        """Open an existing store.

        Raises:
            NotADataset: There is none.
        """
        store = cls(path)
        store.requests()
        return store

    def requests(self) -> tuple[Mapping[str, Any], ...]:
        """Return the requests, in order.

        Raises:
            NotADataset: The folder has no readable index.
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
        """Add requests, once each; the store is created when absent.

        Raises:
            NotADataset: The folder has something else.
            OSError: The folder cannot be written.
        """
        if self.path.exists() and not self.path.is_dir():
            raise self._not_one("it is a file")
        there = (self.path / INDEX).exists()
        if not there and self.path.exists() and any(self.path.iterdir()):
            raise self._not_one("it has files of something else; choose another folder with --out")
        if there:
            self.requests()
        with exclusive_lock(self.path):
            known = list(self.requests()) if (self.path / INDEX).exists() else []
            for request in map(plain, asked):  # As read from JSON: tuples become lists.
                known += [] if request in known else [request]
            write_json(self.path / INDEX, {"schema": INDEX_SCHEMA, "requests": known})

    def place(self, unit: DemoUnit, version: str) -> Path:
        """Return the path of a unit's episode."""
        return self.path / UNITS / unit.folder(version)

    def read(self, unit: DemoUnit, version: str, stored_id: str = "") -> StoredEpisode | None:
        """Return a unit's episode, under any id of an equal outcome, or None when it is not made yet.

        Args:
            unit: The unit.
            version: Hash of the program.
            stored_id: An id that an earlier program gave it; where outcomes differ since, only that episode counts.
        """
        equal = tuple(unit.equal_ids(version))
        for unit_id in equal if stored_id in ("", *equal) else (stored_id,):
            try:
                found = self.episode(unit.folder_of(unit_id))
            except NotADataset:
                continue
            if found.meta.get("id") == unit_id:
                return found
        return None

    @contextmanager
    def writing(self, unit: DemoUnit, version: str, stored_id: str = "") -> Iterator[Path]:
        """Give a new folder, which becomes the unit's when the block ends without an exception.

        Keep a result that another process finished first; replace only "unfinished" markers.

        Args:
            unit: The unit.
            version: Hash of the program.
            stored_id: The id that its episode has, where an earlier program gave it another one.

        Raises:
            OSError: The folder cannot be written.
        """
        place = self.path / UNITS / unit.folder_of(stored_id or unit.id(version))
        aside, before = self._aside(place.name), self._aside(place.name)
        aside.mkdir(parents=True)
        try:
            yield aside
            there = self.read(unit, version, stored_id)
            if there is None or there.broken_off:
                unfinished = place if there is None else there.path
                with suppress(FileNotFoundError):
                    unfinished.rename(before)  # Atomic: the unit is complete or absent at every moment.
                try:
                    aside.rename(place)
                except OSError:
                    there = self.read(unit, version, stored_id)
                    if there is None or there.broken_off:
                        raise
        finally:
            for path in (aside, before):
                shutil.rmtree(path, ignore_errors=True)

    def _aside(self, folder: str) -> Path:
        return self.path / UNITS / f"{_ASIDE}{folder}-{secrets.token_hex(_TOKEN_BYTES)}"

    def write(self, unit: DemoUnit, version: str, meta: Mapping[str, Any], aside: Path) -> None:
        """Write a unit and its outcome into its new folder."""
        named = {"schema": SCHEMA, "id": unit.id(version), "name": unit.name, "version": version}
        text = json.dumps(plain({**named, "unit": unit.to_json(), **meta}), allow_nan=False)
        write_text(aside / META, text + "\n")

    def ending(self, unit: DemoUnit, version: str) -> str | None:
        """Return how a unit ended, or None when it is not made yet, or has to be made again since it was cut off."""
        done = self.read(unit, version)
        return None if done is None or done.cut_off else str(done.meta["ended"])

    def request(self, unit: DemoUnit, version: str) -> dict[str, Any]:
        """Return the request of a unit to its worker process."""
        return {"unit": unit.to_json(), "store": str(self.path), "version": version}

    def keep(self, unit: DemoUnit, version: str, outcome: WorkerOutcome) -> Mapping[str, Any]:
        """Return the outcome of a unit's process; for one that died or hung, write a folder with that ending."""
        if outcome.ending == "finished":
            return {**outcome.answer, "elapsed_s": outcome.wall_s}
        # The processor time is lost with the process.
        result = {**result_of(outcome), "wall_s": outcome.wall_s}
        self.tidy({unit.folder(version)})  # The process has ended.
        with self.writing(unit, version) as folder:
            self.write(unit, version, result, folder)
        failure = {name: result["failure"][name] for name in ("kind", "message")}
        return {"ended": result["ended"], **failure, "elapsed_s": outcome.wall_s}

    def tidy(self, mine: Container[str], older_than_s: float = math.inf) -> None:
        """Remove partial results of killed processes.

        A process that still lives then writes to nothing: its folder is renamed in one step.

        Args:
            mine: Unit folders claimed by this process; their partial results are deleted.
            older_than_s: Maximum age [s] of a living process's folder; older ones are deleted, whoever owns them.
        """
        for path in self.path.glob(f"{UNITS}/{_ASIDE}*"):
            unit_folder = path.name.removeprefix(_ASIDE)[: -1 - 2 * _TOKEN_BYTES]
            with suppress(OSError):  # Another process tidies, too.
                if unit_folder in mine or time.time() - path.stat().st_mtime >= older_than_s:
                    shutil.rmtree(path.rename(self._aside("gone")), ignore_errors=True)

    def episodes(self) -> Iterator[StoredEpisode]:
        """Yield all finished units in the order of folder names.

        Raises:
            NotADataset: One of them is unreadable.
        """
        folder = self.path / UNITS
        for name in sorted(os.listdir(folder)) if folder.is_dir() else ():
            if not name.startswith("."):
                yield self.episode(name)

    def demonstrations(self) -> Iterator[StoredEpisode]:
        """Yield the successes with motion, in order."""
        return (episode for episode in self.episodes() if episode.succeeded and episode.has_samples)

    def episode(self, name: str) -> StoredEpisode:
        """Return a finished unit by its folder's name.

        Raises:
            NotADataset: It is missing or unreadable.
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
