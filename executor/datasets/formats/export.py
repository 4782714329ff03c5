"""Data sets in formats: written from a stream of episodes, and read back as one.

A store folded gives the same bytes from the same episodes, whoever made them, and in whatever order. A format that is
read back is such a stream again, so that a conversion is a reader into a writer, and gives what the store would have.
"""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Literal, get_args

from bddl.files import read_bounded_text
from executor.datasets.formats.demonstrations import FILE, read_demonstrations, write_demonstrations
from executor.datasets.formats.fold import stream_of
from executor.datasets.formats.lerobot import write_lerobot
from executor.datasets.formats.lerobot_features import ABOUT
from executor.datasets.formats.lerobot_reading import read_lerobot
from executor.datasets.formats.selection import EVERYTHING, Selection
from executor.datasets.formats.statistics import Spool, thinned
from executor.datasets.formats.stream import EpisodeStream, Extra, FoldedEpisode, Survey
from executor.datasets.formats.zarr_v2 import read_zarr, write_zarr
from executor.datasets.store import INDEX, EpisodeStore, NotADataset
from executor.datasets.upkeep.card import CARD, card, page_in
from executor.machine.files import write_json, write_text
from executor.pictures.video import VideoFailed

Format = Literal["lerobot", "lerobot-v2.1", "robomimic", "zarr"]
FORMATS: tuple[Format, ...] = get_args(Format)
STATISTICS = "statistics.json"
"""Of the columns of a data set whose format has no place for them."""

Counted = Callable[[int, int], None]
# What says that a folder has a data set of ours -> what reads it.
_READERS = {ABOUT: read_lerobot, FILE: read_demonstrations, ".zattrs": read_zarr}
_UNREADABLE = (
    *(OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError),
    *(RuntimeError, OverflowError, MemoryError),  # What readers of HDF5 and parquet raise beside these.
)


class ExportExists(FileExistsError):
    """The folder that a data set is to be written to has something in it."""

    def __init__(self, folder: Path) -> None:
        super().__init__(f"{folder} is there already; choose another folder with --out, or replace it with --force")


def write_set(
    stream: EpisodeStream,
    kind: Format,
    out: Path,
    *,
    replace: bool = False,
    counted: Counted = lambda done, total: None,
) -> Survey:
    """Writes a data set, complete or not at all, and returns what its episodes have in common.

    Args:
        stream: The episodes.
        kind: The format.
        out: Its folder, which is made.
        replace: Whether what is there already goes.
        counted: Told how many of how many episodes are written.

    Raises:
        ExportExists: Something is there.
        NotADataset: An episode cannot be read.
        VideoFailed: A video of one cannot be read.
        MissingExtra: A library that the format needs is not installed.
        OSError: The folder cannot be written.
    """
    if not replace and out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise ExportExists(out)
    found = stream.found
    aside = out.with_name(f".{out.name}.{secrets.token_hex(4)}.part")
    made, spool = aside / "set", aside / "spool"
    made.mkdir(parents=True)
    spool.mkdir()
    try:
        episodes = _told(stream.episodes(), found.count, counted)
        if kind in ("lerobot", "lerobot-v2.1"):
            write_lerobot(episodes, found, made, spool, "v3.0" if kind == "lerobot" else "v2.1")
        else:
            numbers = Spool(spool)
            (write_zarr if kind == "zarr" else write_demonstrations)(_spooled(episodes, numbers), found, made)
            write_json(made / STATISTICS, numbers.statistics())
        write_text(made / CARD, card(stream.page, kind))
        if out.is_dir() and not out.is_symlink():
            shutil.rmtree(out)
        elif replace:
            out.unlink(missing_ok=True)
        made.rename(out)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return found


def open_set(path: Path, include: Collection[Extra] = (), only: Selection = EVERYTHING) -> EpisodeStream:
    """Returns a data set, whatever it is kept in: a store, or a format that was written of one.

    Args:
        path: Its folder.
        include: Of a store, what the data set is to have beside what it always has; a format has what it has.
        only: Of a store, which of its motions.

    Raises:
        NotADataset: It is none that this program made.
        NothingToExport: It is a store without demonstrations that make one data set.
        MissingExtra: A library that the format needs is not installed.
    """
    if (path / INDEX).exists():
        return stream_of(EpisodeStore.open(path), include, only)
    read = next((reader for name, reader in _READERS.items() if (path / name).is_file()), None)
    if read is None:
        names = ", ".join((INDEX, *_READERS))
        raise NotADataset(f"{path} is no store of episodes, nor exported of one: it has none of {names}")
    try:
        found, episodes = read(path)
        page = page_in(read_bounded_text(path / CARD)) if (path / CARD).is_file() else ""
    except _UNREADABLE as problem:
        raise _broken(path, problem) from None
    return EpisodeStream(found, partial(_read, path, episodes), page)


def _read(path: Path, episodes: Callable[[], Iterator[FoldedEpisode]]) -> Iterator[FoldedEpisode]:
    """Yields episodes that are read of a folder; what cannot be read of it is one kind of problem."""
    stream = episodes()
    while True:
        try:
            episode = next(stream, None)
        except VideoFailed:
            raise
        except _UNREADABLE as problem:
            raise _broken(path, problem) from None
        if episode is None:
            return
        yield episode


def _broken(path: Path, problem: Exception) -> NotADataset:
    words = str(problem)
    if isinstance(problem, OSError) and problem.filename:
        words = f"{problem.filename}: {problem.strerror}"
    elif isinstance(problem, KeyError):
        words = f"it lacks {problem}"
    return NotADataset(f"{path} cannot be read as what was exported: {words}; export it anew, or copy all of it")


def _told(episodes: Iterator[FoldedEpisode], total: int, counted: Counted) -> Iterator[FoldedEpisode]:
    for episode in episodes:
        counted(episode.index, total)
        yield episode


def _spooled(episodes: Iterator[FoldedEpisode], spool: Spool) -> Iterator[FoldedEpisode]:
    for episode in episodes:
        for name, rows in episode.columns.items():
            spool.add(name, thinned(rows))
        yield episode
