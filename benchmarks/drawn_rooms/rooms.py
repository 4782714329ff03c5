"""Rooms that are drawn from a seed: households and kitchens, each with a query."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from executor.scenes.generators import household
from executor.scenes.generators.families import LONG_HORIZON, pair_of
from executor.scenes.pair import ScenePair

HOUSEHOLD = "household"
_STREAM = 180  # Keeps these draws apart from those of the rooms.


@dataclass(frozen=True)
class DrawnRoom:
    """One pair of a scene and a query; equal ones are equal pairs.

    Attributes:
        family: "T1" to "T4", or "household" for T5 and T6.
        seed: Of the pair.
        index: Of household pairs, which of the seed's.
    """

    family: str
    seed: int
    index: int | None

    @property
    def name(self) -> str:
        """Fit for files."""
        return f"{self.family}-{self.seed}" + ("" if self.index is None else f"-{self.index:03d}")

    @property
    def entropy(self) -> tuple[int, int]:
        """Seeds of noise and detector errors."""
        kitchen = household.COUNT + (LONG_HORIZON.index(self.family) if self.family in LONG_HORIZON else 0)
        return self.seed, kitchen if self.index is None else self.index

    @property
    def camera_seed(self) -> int:
        """Seed of the camera's place."""
        return self.seed + (self.index or 0)

    def pair(self) -> ScenePair:
        """Return the scene and the query.

        Raises:
            NotDrawn: No room could be made of this seed.
        """
        return pair_of(self.family, self.seed, self.index)


def households(seed: int, count: int) -> list[DrawnRoom]:
    """Return so many household pairs: the first of a fixed shuffle of a seed's, then of the next seed's."""
    found = []
    for number in range(count):
        beyond, place = divmod(number, household.COUNT)
        order = np.random.default_rng([seed + beyond, _STREAM]).permutation(household.COUNT)
        found.append(DrawnRoom(HOUSEHOLD, seed + beyond, int(order[place])))
    return found


def kitchens(seed: int, count: int) -> list[DrawnRoom]:
    """Return so many kitchens, by turns of T1 to T4, each of a seed of its own."""
    return [DrawnRoom(LONG_HORIZON[number % len(LONG_HORIZON)], seed + number, None) for number in range(count)]


def drawn(seed: int, rooms: int, of_kitchens: int) -> list[DrawnRoom]:
    """Return household pairs and kitchens alternately, so that a part of a measurement has some of both."""
    both = itertools.zip_longest(households(seed, rooms), kitchens(seed, of_kitchens))
    return [room for turn in both for room in turn if room is not None]
