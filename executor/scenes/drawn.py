"""Scenes that are drawn from a seed, by their names: the rooms of the households, and the kitchens of long tasks.

kitchen02-b          the second variation of a room, with the usual seed
kitchen02-13000-b    the same with its seed: the name that its records have
t1-12000             the kitchen of a long task that this seed stands for; t1_012000 is what its records say
t1                   where episodes have seeds: of each one the kitchen that its own stands for
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from bddl import near_names
from executor.scenes import household, long_horizon
from executor.scenes.household.arrange import VARIATIONS
from executor.scenes.library import SceneNotFound
from executor.scenes.vary import LARGEST_SEED
from oag import Scene

USUAL_SEED = 13000
"""Seed of a household's room whose name has none."""

USUAL_KITCHENS = range(12000, 12003)
"""Seeds of the kitchens that are listed; any other one draws one too."""

_ROOM = re.compile(r"([a-z]+\d+)(?:-(\d{1,10}))?-([a-c])")
_KITCHEN = re.compile(r"[tT]([1-4])[-_](\d{1,10})")
_KITCHENS = re.compile(r"[tT][1-4]")


@dataclass(frozen=True, slots=True)
class Listed:
    """A drawn scene that is listed: its name, and what is asked in it."""

    name: str
    query: str


def rooms() -> tuple[Listed, ...]:
    """Returns the 102 rooms of the households, variations of a layout together."""
    return tuple(
        Listed(f"{layout.name}-{'abc'[variation]}", layout.wishes[variation].query)
        for layout in household.layouts()
        for variation in range(VARIATIONS)
    )


def kitchens() -> tuple[Listed, ...]:
    """Returns some kitchens of the long tasks, as examples of their names."""
    return tuple(
        Listed(f"{family.lower()}-{seed}", query)
        for family, query in long_horizon.QUERIES.items()
        for seed in USUAL_KITCHENS
    )


def is_of_seeds(name: str) -> bool:
    """Decides whether a name ("t1" to "t4") stands for another kitchen with every seed."""
    return _KITCHENS.fullmatch(name) is not None


def of_seed(name: str, seed: int) -> str:
    """Returns the scene that an episode is in: of "t1" to "t4" the kitchen of its seed, else that of the name."""
    return f"{name}-{seed}" if is_of_seeds(name) else name


def named(name: str) -> Scene | None:
    """Returns the scene that a name of this form stands for, drawn and settled; None for a name of another form.

    Raises:
        SceneNotFound: The households have no such room, or the seed is too large.
        NotDrawn: None of the layouts that the seed stands for holds.
    """
    if (found := _ROOM.fullmatch(name)) is not None:
        layouts = [layout.name for layout in household.layouts()]
        layout, seed, letter = found.groups()
        if layout not in layouts or int(seed or 0) > LARGEST_SEED:
            near = near_names(layout, layouts)
            raise SceneNotFound(name, tuple(f"{other}-{letter}" for other in near or layouts[:3]))
        index = layouts.index(layout) * VARIATIONS + "abc".index(letter)
        return household.pair(int(seed or USUAL_SEED), index).scene
    if (found := _KITCHEN.fullmatch(name)) is not None and int(found[2]) <= LARGEST_SEED:
        return long_horizon.draw(f"T{found[1]}", int(found[2])).scene
    return None
