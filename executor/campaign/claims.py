"""Claim units of a folder with a file lock while a run is alive.

A run keeps a card in `running/` locked while it lives. The system releases the lock when the process ends, however it
ends. Nothing has to be cleaned up by hand. Where the system or the disk has no such locks, no run is refused.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
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
