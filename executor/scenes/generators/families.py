"""Task families T1 to T6 of the paper: their scene-task pairs by seed and index, and the paper's initial flows.

T1 to T4 draw one pair per seed. T5 and T6 draw a set of pairs per seed, in which an index selects one.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from importlib import resources
from typing import Annotated, Any, Literal

from pydantic import Field, StrictInt

from bddl.errors import Scene2DemoError
from executor.scenes.generators import household, long_horizon
from executor.scenes.pair import UNCHANGED, LayoutChanges, ScenePair
from executor.scenes.vary import LARGEST_SEED
from oag import Task, flow_from_json

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
    full_size: bool = False,
    changes: LayoutChanges = UNCHANGED,
) -> ScenePair:
    """Return a scene-task pair; equal arguments give equal pairs.

    Args:
        family: "T1" to "T6".
        seed: For T1 to T4 the episode's seed; for T5 and T6 that of the set of pairs.
        index: Position in the set; None for T1 to T4.
        keep_sizes: Whether nothing is scaled to the gripper.
        full_size: Whether the robot is of full size.
        changes: Deviations from what the seed alone gives.

    Raises:
        NotDrawn: No room could be drawn for this seed.
    """
    if index is None:
        return long_horizon.draw(family, seed, keep_sizes=keep_sizes, full_size=full_size, changes=changes)
    return household.pair(seed, index, keep_sizes=keep_sizes, full_size=full_size, changes=changes)


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
