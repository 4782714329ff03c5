"""Listings of episodes: what a path holds, and what can be done with it."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from bddl.errors import Scene2DemoError
from executor.reports.episode import EpisodeDetail, EpisodeRow


class NothingToView(Scene2DemoError, ValueError):
    """A path holds nothing that the viewer reads, or an episode is not there."""


class Listing(Protocol):
    """What a path holds: its episodes, and the details of each."""

    @property
    def path(self) -> Path:
        """The path."""
        ...

    @property
    def kind(self) -> str:
        """What it is: "run", "store", "benchmark", "evaluation" or "data set"."""
        ...

    @property
    def selection_command(self) -> str:
        """A command for selected episodes, with `{names}` for their names; empty where there is none."""
        ...

    def rows(self) -> Sequence[EpisodeRow]:
        """Return the table, in order."""
        ...

    def detail(self, name: str) -> EpisodeDetail:
        """Return everything about an episode.

        Raises:
            NothingToView: There is no such episode, or it is unreadable.
        """
        ...


def command(name: str, *words: object) -> str:
    """Return a command line of this program, quoted for a shell."""
    return shlex.join(["scene2demo", *name.split(), *map(str, words)])
