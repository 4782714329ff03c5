"""Write a stream of episodes as a data set in some format, and open a store or a LeRobot data set as a stream.

Equal episodes give equal bytes, whoever made them and in whatever order.
"""

from __future__ import annotations

import json
import secrets
import shutil
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from bddl.errors import Scene2DemoError
from executor.data.card import CARD, card
from executor.data.episode import Episode, step_numbers
from executor.data.formats import robomimic
from executor.data.formats.lerobot import ABOUT, read_lerobot, write_lerobot
from executor.data.formats.selection import EVERYTHING, Selection
from executor.data.formats.statistics import ColumnSpool, subsample_rows
from executor.data.formats.store_reader import stream_of
from executor.data.formats.table import DatasetSpec, EpisodeStream, Extra
from executor.data.formats.zarr_v2 import write_zarr
from executor.data.store import INDEX, EpisodeStore, NotADataset
from executor.sim.render.frames import VideoFailed
from executor.system.files import plain, write_json, write_text
from executor.system.progress import OnProgress, ignore_progress

Format = Literal["lerobot", "lerobot-v2.1", "robomimic", "zarr"]
FORMATS: tuple[Format, ...] = get_args(Format)
STATISTICS = "statistics.json"
"""Statistics of the columns, for formats that have no place for them."""

_UNREADABLE = (
    *(OSError, ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError),
    *(RuntimeError, OverflowError, MemoryError),  # Further exceptions of the reader of parquet.
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
    overwrite: bool = False,
    on_progress: OnProgress = ignore_progress,
) -> DatasetSpec:
    """Write a data set, complete or not at all, and return its common properties.

    Args:
        stream: The episodes.
        kind: The format.
        out: Its folder, which is created.
        overwrite: Whether an existing folder is replaced.
        on_progress: Called with the numbers of written and of all episodes.

    Raises:
        ExportExists: The folder has something.
        NotADataset: An episode is unreadable.
        VideoFailed: A video of one is unreadable.
        MissingExtra: A library that the format needs is not installed.
        OSError: The folder cannot be written.
    """
    if not overwrite and out.exists() and not (out.is_dir() and not any(out.iterdir())):
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
            episodes = _with_spool(episodes, numbers)
            if kind == "zarr":
                write_zarr(episodes, found, made)
            else:
                _write_robomimic(episodes, found, made)
            write_json(made / STATISTICS, numbers.statistics())
        write_text(made / CARD, card(stream.page, kind))
        if out.is_dir() and not out.is_symlink():
            shutil.rmtree(out)
        elif overwrite:
            out.unlink(missing_ok=True)
        made.rename(out)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return found


def _write_robomimic(episodes: Iterator[Episode], found: DatasetSpec, folder: Path) -> None:
    """Write one file with all episodes, with the masks `train`, `valid` and `corrections`."""
    parts = found.splits
    masks = {"train": parts["train"], "valid": parts["validation"]}
    if found.corrections:
        masks["corrections"] = parts["corrections"]
    recorded = (replace(episode, recorded=_recorded(episode, found.rate_hz)) for episode in episodes)
    robomimic.write_robomimic(folder / robomimic.FILE, recorded, masks, json.dumps(plain(found.to_json())))


def _recorded(episode: Episode, rate_hz: float) -> dict[str, NDArray[Any]]:
    return {
        "time_s": episode.about["starts_s"] + np.arange(episode.length) / rate_hz,
        "subtask": episode.columns["subtask_index"].astype(np.int32),
        "step": step_numbers(episode.about["subtasks"], episode.length),
    }


def open_set(path: Path, include: Collection[Extra] = (), only: Selection = EVERYTHING) -> EpisodeStream:
    """Open a store, or a LeRobot data set that was exported of one.

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
    if not (path / ABOUT).is_file():
        raise NotADataset(
            f"{path} is no store of episodes, nor a LeRobot data set that was exported of one: it has neither {INDEX} "
            f"nor {ABOUT}"
        )
    try:
        found, episodes = read_lerobot(path)
    except _UNREADABLE as problem:
        raise _broken(path, problem) from None
    return EpisodeStream(found, partial(_read, path, episodes))


def _read(path: Path, episodes: Callable[[], Iterator[Episode]]) -> Iterator[Episode]:
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
    return NotADataset(f"{path} cannot be read as what was exported: {words}; export it again, or copy all of it")


def _with_progress(episodes: Iterator[Episode], total: int, on_progress: OnProgress) -> Iterator[Episode]:
    for episode in episodes:
        on_progress(episode.index, total)
        yield episode


def _with_spool(episodes: Iterator[Episode], spool: ColumnSpool) -> Iterator[Episode]:
    for episode in episodes:
        for name, rows in episode.columns.items():
            spool.add(name, subsample_rows(rows))
        yield episode
