"""Puts the episodes of several stores into one: folders are copied as they are, requests joined."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from executor.datasets.store import EpisodeStore
from executor.datasets.units import DemoUnit


@dataclass
class Merged:
    """What came of it.

    Attributes:
        copied: How many episodes were added.
        same: How many were there already: units that say the same are the same.
    """

    copied: int = 0
    same: int = 0


def merge(
    stores: Sequence[EpisodeStore], out: Path, counted: Callable[[int, int], None] = lambda done, total: None
) -> Merged:
    """Adds all episodes of some stores to one, which is made when absent; what is there already stays.

    Args:
        stores: Where episodes come from, the first first.
        out: Folder of the store that they go to.
        counted: Told how many of how many stores are done.

    Raises:
        NotADataset: One of them is none, or an episode cannot be read.
        OSError: The folder cannot be written.
    """
    requests = [request for store in stores for request in store.requests()]
    target, done = EpisodeStore(out), Merged()
    target.add_requests(requests)
    for place, store in enumerate(stores):
        counted(place, len(stores))
        for episode in store.episodes():
            unit, version = DemoUnit.from_json(episode.meta["unit"]), str(episode.meta["version"])
            there = target.read(unit, version)
            if there is not None and not (there.broken_off and not episode.broken_off):
                done.same += 1
                continue
            with target.writing(unit, version) as folder:
                shutil.copytree(episode.path, folder, dirs_exist_ok=True)
            done.copied += 1
    return done
