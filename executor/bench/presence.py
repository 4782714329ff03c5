"""Who is at work in a benchmark's folder, so that two runs do not do the same units twice.

A run keeps a card in `running/` locked while it lives. The system lets go of the lock when the process ends, however it
ends, so nothing has to be cleaned up by hand. Where the system or the disk has no such locks, nobody is refused.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from bddl.files import open_plain

try:
    import fcntl
except ImportError:  # Windows has none.
    fcntl = None  # type: ignore[assignment]

RUNNING = "running"
LOCK = ".lock"


class BenchBusy(RuntimeError):
    """Another run is at work on some of the same units."""


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Waits until no other process is in a block of this kind for the same folder, and keeps them out.

    Raises:
        OSError: The folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with _open(folder / LOCK, os.O_CREAT) as lock:
        if fcntl is not None:
            with suppress(OSError):  # A disk without locks.
                fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@contextmanager
def at_work(folder: Path, units: Iterable[str]) -> Iterator[None]:
    """Says in a benchmark's folder which units this process does, for as long as the block lasts.

    Args:
        folder: The benchmark's folder.
        units: Ids of the units.

    Raises:
        BenchBusy: A living run does some of them; the message names it.
        OSError: The folder cannot be written.
    """
    process, host, wanted = os.getpid(), socket.gethostname(), set(units)
    place = folder / RUNNING
    with alone(folder):
        place.mkdir(exist_ok=True)
        for other in _living(place):
            if both := wanted & set(other["units"]):
                raise BenchBusy(
                    f"process {other['process']} on {other['host']} works on {len(both)} of these units in {folder} "
                    "already; wait for it, or share the units between runs with --shard"
                )
        path = place / f"{host}-{process}.json"
        path.unlink(missing_ok=True)  # Of a process that had the same number once, or a link that somebody put there.
        card = _open(path, os.O_CREAT | os.O_EXCL)
        _take(card)
        json.dump({"process": process, "host": host, "units": sorted(wanted)}, card)
        card.flush()
    try:
        yield
    finally:
        with alone(folder):
            path.unlink(missing_ok=True)
            card.close()
            if not any(place.iterdir()):
                place.rmdir()


def _living(place: Path) -> Iterator[Mapping[str, Any]]:
    """What the other runs do; the cards of those that are gone are thrown away."""
    for path in sorted(place.glob("*.json")):
        with _open(path, 0) as card:
            if _take(card):
                path.unlink(missing_ok=True)
            else:
                yield json.load(card)


def _open(path: Path, flags: int) -> IO[str]:
    return os.fdopen(open_plain(path, os.O_RDWR | flags), "r+", encoding="utf-8")


def _take(file: IO[str]) -> bool:
    """Locks a file, and decides whether nobody else has."""
    if fcntl is not None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:  # A disk without locks.
            return True
    return True
