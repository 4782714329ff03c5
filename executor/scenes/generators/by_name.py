"""Scenes drawn from a seed, by name: the rooms of the households, and the kitchens of the long-horizon tasks.

kitchen02-b          the second variation of a room, with the usual seed
kitchen02-13000-b    the same with its seed: the name in its records
t1-12000             the kitchen of a long-horizon task drawn from this seed; its records have t1_012000
t1                   where episodes have seeds: each episode gets the kitchen of its own seed
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from bddl import near_names
from executor.scenes.generators import household, long_horizon
from executor.scenes.generators.household import VARIATIONS
from executor.scenes.library import SceneNotFound
from executor.scenes.vary import LARGEST_SEED
from oag import Scene

USUAL_SEED = 13000
"""Seed of a household's room whose name has no seed."""

USUAL_KITCHENS = range(12000, 12003)
"""Seeds of the listed kitchens; any other seed draws a kitchen, too."""

_ROOM = re.compile(r"([a-z]+\d+)(?:-(\d{1,10}))?-([a-c])")
_KITCHEN = re.compile(r"[tT]([1-4])[-_](\d{1,10})")
_KITCHENS = re.compile(r"[tT][1-4]")


@dataclass(frozen=True, slots=True)
class NamedScene:
    """A listed drawn scene: its name and its query."""

    name: str
    query: str


def rooms() -> tuple[NamedScene, ...]:
    """Return the 102 rooms of the households, variations of a layout together."""
    return tuple(
        NamedScene(f"{layout.name}-{'abc'[variation]}", layout.wishes[variation].query)
        for layout in household.layouts()
        for variation in range(VARIATIONS)
    )


def kitchens() -> tuple[NamedScene, ...]:
    """Return some kitchens of the long-horizon tasks, as examples of their names."""
    return tuple(
        NamedScene(f"{family.lower()}-{seed}", query)
        for family, query in long_horizon.QUERIES.items()
        for seed in USUAL_KITCHENS
    )


def varies_with_seed(name: str) -> bool:
    """Return whether a name ("t1" to "t4") denotes another kitchen for every seed."""
    return _KITCHENS.fullmatch(name) is not None


def scene_name_for_seed(name: str, seed: int) -> str:
    """Return the scene name of an episode: the kitchen of its seed for "t1" to "t4", else the name itself."""
    return f"{name}-{seed}" if varies_with_seed(name) else name


def draw_named(name: str) -> Scene | None:
    """Draw and settle the scene of a name of this form; return None for a name of another form.

    Raises:
        SceneNotFound: The households have no such room, or the seed is too large.
        NotDrawn: None of the seed's layouts holds.
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
