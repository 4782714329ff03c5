"""Write a stream of episodes as a data set in some format, and open one again as a stream.

Equal episodes give equal bytes, whoever made them and in whatever order. A format that is read back is a stream again.
A conversion is therefore a reader into a writer, and gives what the store would have given.
"""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Literal, get_args

from bddl.errors import Scene2DemoError
from bddl.files import read_bounded_text
from executor.data.card import CARD, card, page_in
from executor.data.formats.lerobot import ABOUT, read_lerobot, write_lerobot
from executor.data.formats.robomimic_set import FILE, read_demonstrations, write_demonstrations
from executor.data.formats.selection import EVERYTHING, Selection
from executor.data.formats.statistics import ColumnSpool, subsample_rows
from executor.data.formats.store_reader import stream_of
from executor.data.formats.table import DatasetSpec, EpisodeStream, EpisodeTable, Extra
from executor.data.formats.zarr_v2 import read_zarr, write_zarr
from executor.data.store import INDEX, EpisodeStore, NotADataset
from executor.sim.render.frames import VideoFailed
from executor.system.files import write_json, write_text
from executor.system.progress import OnProgress, ignore_progress

Format = Literal["lerobot", "lerobot-v2.1", "robomimic", "zarr"]
FORMATS: tuple[Format, ...] = get_args(Format)
STATISTICS = "statistics.json"
"""Statistics of the columns, for formats that have no place for them."""

# Marker file of an export of this program -> its reader.
_READERS = {ABOUT: read_lerobot, FILE: read_demonstrations, ".zattrs": read_zarr}
_UNREADABLE = (
    *(OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError),
    *(RuntimeError, OverflowError, MemoryError),  # Further exceptions of the readers of HDF5 and parquet.
)


class ExportExists(Scene2DemoError, FileExistsError):
    """The folder of a new data set is not empty."""

    def __init__(self, folder: Path) -> None:
        super().__init__(f"{folder} is there already; choose another folder with --out, or replace it with --force")


def write_set(
    stream: EpisodeStream,
    kind: Format,
    out: Path,
    *,
    replace: bool = False,
    on_progress: OnProgress = ignore_progress,
) -> DatasetSpec:
    """Write a data set, complete or not at all, and return its common properties.

    Args:
        stream: The episodes.
        kind: The format.
        out: Its folder, which is created.
        replace: Whether an existing folder is replaced.
        on_progress: Called with the numbers of written and of all episodes.

    Raises:
        ExportExists: The folder has something.
        NotADataset: An episode is unreadable.
        VideoFailed: A video of one is unreadable.
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
        episodes = _with_progress(stream.episodes(), found.count, on_progress)
        if kind in ("lerobot", "lerobot-v2.1"):
            write_lerobot(episodes, found, made, spool, "v3.0" if kind == "lerobot" else "v2.1")
        else:
            numbers = ColumnSpool(spool)
            (write_zarr if kind == "zarr" else write_demonstrations)(_with_spool(episodes, numbers), found, made)
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
    """Open a data set of any kind: a store, or an export of one.

    Args:
        path: Its folder.
        include: Optional columns and pictures of a store; an export has what it has.
        only: Selected motions of a store.

    Raises:
        NotADataset: It was not made by this program.
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


def _read(path: Path, episodes: Callable[[], Iterator[EpisodeTable]]) -> Iterator[EpisodeTable]:
    """Yield episodes of a folder; all errors of reading become NotADataset."""
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


def _with_progress(episodes: Iterator[EpisodeTable], total: int, on_progress: OnProgress) -> Iterator[EpisodeTable]:
    for episode in episodes:
        on_progress(episode.index, total)
        yield episode


def _with_spool(episodes: Iterator[EpisodeTable], spool: ColumnSpool) -> Iterator[EpisodeTable]:
    for episode in episodes:
        for name, rows in episode.columns.items():
            spool.add(name, subsample_rows(rows))
        yield episode
