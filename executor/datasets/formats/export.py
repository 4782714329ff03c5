"""Folds a store into a data set: the same bytes from the same episodes, whoever made them, and in whatever order."""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Literal

from executor.datasets.formats.demonstrations import write_merged_robomimic
from executor.datasets.formats.fold import FoldedEpisode, Survey, folded, survey
from executor.datasets.formats.lerobot import write_lerobot
from executor.datasets.formats.zarr_v2 import write_zarr
from executor.datasets.store import EpisodeStore
from executor.datasets.upkeep.card import CARD, card
from executor.machine.files import write_text

Format = Literal["lerobot", "lerobot-v2.1", "robomimic", "zarr"]
FORMATS: tuple[Format, ...] = ("lerobot", "lerobot-v2.1", "robomimic", "zarr")

Counted = Callable[[int, int], None]


class ExportExists(FileExistsError):
    """The folder that a data set is to be written to has something in it."""

    def __init__(self, folder: Path) -> None:
        super().__init__(f"{folder} is there already; choose another folder with --out, or replace it with --force")


def export(
    store: EpisodeStore,
    kind: Format,
    out: Path,
    *,
    replace: bool = False,
    counted: Counted = lambda done, total: None,
) -> Survey:
    """Writes a data set of a store's demonstrations, complete or not at all, and returns what it has.

    Args:
        store: The episodes.
        kind: The format.
        out: Its folder, which is made.
        replace: Whether what is there already goes.
        counted: Told how many of how many episodes are written.

    Raises:
        ExportExists: Something is there.
        NothingToExport: The store has no demonstrations that make one data set.
        NotADataset: An episode cannot be read.
        VideoFailed: A video of one cannot be read.
        MissingExtra: A library that the format needs is not installed.
        OSError: The folder cannot be written.
    """
    if not replace and out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise ExportExists(out)
    found = survey(store)
    aside = out.with_name(f".{out.name}.{secrets.token_hex(4)}.part")
    made, spool = aside / "set", aside / "spool"
    made.mkdir(parents=True)
    spool.mkdir()
    try:
        episodes = _told(folded(store, found), len(found.names), counted)
        if kind == "robomimic":
            write_merged_robomimic(episodes, found, made)
        elif kind == "zarr":
            write_zarr(episodes, found, made)
        else:
            write_lerobot(episodes, found, made, spool, "v3.0" if kind == "lerobot" else "v2.1")
        write_text(made / CARD, card(store, kind))
        if out.is_dir() and not out.is_symlink():
            shutil.rmtree(out)
        elif replace:
            out.unlink(missing_ok=True)
        made.rename(out)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return found


def _told(episodes: Iterable[FoldedEpisode], total: int, counted: Counted) -> Iterator[FoldedEpisode]:
    for episode in episodes:
        counted(episode.index, total)
        yield episode
