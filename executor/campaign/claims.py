"""Claims of units by running processes, on one machine or several that share a folder.

A run keeps a card in `running/` locked while it lives. The system releases the lock when the process ends, however it
ends. Nothing has to be cleaned up by hand. Where the system or the disk has no such locks, no run is refused.
"""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from bddl.errors import Scene2DemoError
from bddl.files import open_plain

try:
    import fcntl
except ImportError:  # Windows has none.
    fcntl = None  # type: ignore[assignment]

RUNNING = "running"
LOCK = ".lock"
_LOOKS_EVERY_S = 2.0


class BenchBusy(Scene2DemoError):
    """Another run works on some of the same units."""


@dataclass(frozen=True, slots=True)
class ClaimedRun:
    """A run that has claimed units, and may have ended since.

    Attributes:
        host, process: Where it runs.
        units: Ids of its units.
        began_s: When it claimed them, in seconds since 1970.
        lives: Whether it still runs.
    """

    host: str
    process: int
    units: frozenset[str]
    began_s: float
    lives: bool


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
def claim_units(folder: Path, units: Iterable[str], wait_s: float = 0.0) -> Iterator[None]:
    """Claim units in a folder for as long as the block lasts.

    Args:
        folder: Folder of the benchmark or store.
        units: Ids of the units.
        wait_s: How long to wait for a living run that works on some of them [s].

    Raises:
        BenchBusy: A living run works on some of them; the message names it.
        OSError: The folder cannot be written.
    """
    wanted, until = set(units), time.monotonic() + wait_s
    while True:
        try:
            path, card = _claim(folder, wanted)
            break
        except BenchBusy:
            if time.monotonic() >= until:
                raise
        time.sleep(_LOOKS_EVERY_S)
    try:
        yield
    finally:
        with exclusive_lock(folder):
            path.unlink(missing_ok=True)
            card.close()
            if not any(path.parent.iterdir()):
                path.parent.rmdir()


def _claim(folder: Path, wanted: set[str]) -> tuple[Path, IO[str]]:
    """Write and lock this process's card, unless a living run has some of the units."""
    process, host, place = os.getpid(), socket.gethostname(), folder / RUNNING
    with exclusive_lock(folder):
        place.mkdir(exist_ok=True)
        for other in _live_runs(place, wanted):
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
    return path, card


def runs_in(folder: Path) -> tuple[ClaimedRun, ...]:
    """Return the runs that have claimed units of a folder: those that live, and those that ended without a word.

    Where the folder cannot be written, or has no locks, all count as living.
    """
    found = []
    try:
        with exclusive_lock(folder):  # Nobody takes this look for a living run.
            for path in sorted((folder / RUNNING).glob("*.json")):
                with suppress(OSError, ValueError, KeyError, TypeError), _open_card(path, 0) as card:
                    found.append(_run_of(path, card, lives=not _try_lock(card)))
    except OSError:
        for path in sorted((folder / RUNNING).glob("*.json")):
            with suppress(OSError, ValueError, KeyError, TypeError), path.open(encoding="utf-8") as card:
                found.append(_run_of(path, card, lives=True))
    return tuple(found)


def _run_of(path: Path, card: IO[str], *, lives: bool) -> ClaimedRun:
    kept = json.load(card)
    return ClaimedRun(str(kept["host"]), int(kept["process"]), frozenset(kept["units"]), path.stat().st_mtime, lives)


def _live_runs(place: Path, wanted: set[str]) -> Iterator[Mapping[str, Any]]:
    """Yield the cards of other living runs; cards of ended ones are deleted, unless all their units are of others."""
    for path in sorted(place.glob("*.json")):
        with _open_card(path, 0) as card:
            if not _try_lock(card):
                yield json.load(card)
            elif not _is_of_others(card, wanted):
                path.unlink(missing_ok=True)


def _is_of_others(card: IO[str], wanted: set[str]) -> bool:
    """Decide whether an ended run had none of some units, so that `status` still tells what it lost."""
    try:
        return wanted.isdisjoint(json.load(card)["units"])
    except (ValueError, KeyError, TypeError):
        return False


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
