"""Which places of a support a subtask is about."""

from __future__ import annotations

from bddl import atoms
from executor.assets.model import Region
from executor.world.world import World
from oag import SimpleTask


def support_of(subtask: SimpleTask) -> str:
    """Returns the id of what a subtask's target is put on or in; its own where the subtask names none."""
    return subtask.support_goal or subtask.support_init or subtask.target


def regions_for(world: World, subtask: SimpleTask) -> list[Region]:
    """Returns the support's regions that the goal is about: interiors for `inside`, else surfaces."""
    support = support_of(subtask)
    inside = any(a.predicate == "inside" and support in a.args[1:] for a in atoms(subtask.goal))
    kind = "interior" if inside else "surface"
    return [region for region in world.assets[support].regions if region.kind == kind]
