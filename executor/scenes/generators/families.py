"""Drawn scenes and scene-task pairs: T1 to T6 of the paper by seed and index, rooms and kitchens by name.

T1 to T4 draw one pair per seed. T5 and T6 draw a set of pairs per seed, in which an index selects one.

Names:

kitchen02-b          the second variation of a room, with the usual seed
kitchen02-13000-b    the same with its seed: the name in its records
t1-12000             the kitchen of a long-horizon task drawn from this seed; its records have t1_012000
t7-70000             the home of a wish of T7
t1                   where episodes have seeds: each episode gets the kitchen of its own seed
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import Annotated, Any, Literal

from pydantic import Field, StrictInt

from bddl import near_names
from bddl.errors import Scene2DemoError
from executor.scenes.generators import any_task, household, long_horizon
from executor.scenes.generators.household import VARIATIONS
from executor.scenes.library import SceneNotFound
from executor.scenes.pair import UNCHANGED, LayoutChanges, ScenePair
from executor.scenes.vary import LARGEST_SEED
from oag import Scene, Task
from oag.model.actions import flow_from_json
from oag.model.robots import PAPER_ROBOT

Family = Literal["T1", "T2", "T3", "T4", "T5", "T6"]
Flows = Literal["planned", "paper"]
Seed = Annotated[StrictInt, Field(ge=0, le=LARGEST_SEED)]

LONG_HORIZON: tuple[Family, ...] = ("T1", "T2", "T3", "T4")
HOUSEHOLD: tuple[Family, ...] = ("T5", "T6")
FAMILIES = LONG_HORIZON + HOUSEHOLD


def pair_of(
    family: str,
    seed: int,
    index: int | None,
    *,
    keep_sizes: bool = False,
    robot: str = PAPER_ROBOT.name,
    changes: LayoutChanges = UNCHANGED,
) -> ScenePair:
    """Return a scene-task pair; equal arguments give equal pairs.

    Args:
        family: "T1" to "T6".
        seed: For T1 to T4 the episode's seed; for T5 and T6 that of the set of pairs.
        index: Position in the set; None for T1 to T4.

    Raises:
        NotDrawn: No room could be drawn for this seed.
    """
    if index is None:
        return long_horizon.draw(family, seed, keep_sizes=keep_sizes, robot=robot, changes=changes)
    return household.pair(seed, index, keep_sizes=keep_sizes, robot=robot, changes=changes)


@cache
def indices_of(family: str | None) -> tuple[int, ...] | tuple[None]:
    """Return the indices of a household family's pairs in a set, in order; only None for anything else."""
    if family not in HOUSEHOLD:
        return (None,)
    wishes = [wish for layout in household.layouts() for wish in layout.wishes]
    return tuple(index for index, wish in enumerate(wishes) if wish.family == family)


def pairs_from(family: str | None, seed: int, count: int) -> Iterator[tuple[int, int | None]]:
    """Yield seed and index of consecutive pairs; those of T5 and T6 go through one set of pairs after the other."""
    indices = indices_of(family)
    for number in range(count):
        beyond, place = divmod(number, len(indices))
        yield seed + beyond, indices[place]


def pair_name(seed: int, index: int | None) -> str:
    """Return the part of a unit's name that seed and index give."""
    return f"{seed:06d}" if index is None else f"{seed:06d}-{index:03d}"


class NoPaperFlow(Scene2DemoError, ValueError):
    """The paper prints no flows for this family, or for a decomposition of this length."""


def families_with_flows() -> tuple[str, ...]:
    """Return the families whose initial flows the paper prints."""
    return tuple(sorted(key for key in _paper_flows() if key != "source"))


def with_paper_flows(task: Task, family: str) -> Task:
    """Replace a task's flows by the paper's initial flows, numbers verbatim.

    Raises:
        NoPaperFlow: The paper prints none for the family, or for another number of subtasks.
    """
    flows = _paper_flows()
    if family == "source" or family not in flows:
        raise NoPaperFlow(f"the paper prints no flows for {family}; it does for {', '.join(families_with_flows())}")
    if len(flows[family]) != len(task.subtasks):
        raise NoPaperFlow(
            f"the paper's {family} has {len(flows[family])} subtasks, but {task.name} was decomposed into "
            f"{len(task.subtasks)}"
        )
    subtasks = tuple(
        replace(subtask, flow=flow_from_json(flow)) for subtask, flow in zip(task.subtasks, flows[family], strict=True)
    )
    return replace(task, subtasks=subtasks)


@cache
def _paper_flows() -> dict[str, Any]:
    text = (resources.files(__package__) / "data" / "initial_flows.json").read_text(encoding="utf-8")
    found: dict[str, Any] = json.loads(text)
    return found


USUAL_SEED = 13000
"""Seed of a household's room whose name has no seed."""

USUAL_KITCHENS = range(12000, 12003)
"""Seeds of the listed kitchens; any other seed draws a kitchen, too."""

_ROOM = re.compile(r"([a-z]+\d+)(?:-(\d{1,10}))?-([a-c])")
_KITCHEN = re.compile(r"[tT]([1-4])[-_](\d{1,10})")
_HOME = re.compile(r"[tT]7[-_](\d{1,10})")
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
    if (found := _HOME.fullmatch(name)) is not None and int(found[1]) <= LARGEST_SEED:
        return any_task.draw(int(found[1])).scene
    return None
