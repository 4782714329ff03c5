"""Sizes: what of a plan cannot be done, whatever the stances, since a thing is too large for the hand or for its place.

This is asked first, since it needs no search. It is strict only where sizes alone decide: a thing that could go in
turned or laid down counts as one that fits, and the search for a place decides.
"""

from __future__ import annotations

import math
from collections import Counter

from bddl import atoms
from bddl.terminal import pluralize
from executor.assets.asset_geometry import rolls_freely
from executor.assets.model import Asset, Region
from executor.planning.whereabouts import handles_of, parts_named, regions_of
from executor.records import Failure, FailureKind
from executor.rollouts.goals import LEANS_DEG, STANDS_DEG
from executor.sim.world import World
from executor.skills.navigate import misfit
from oag import Primitive, SimpleTask, Task
from oag.measurements import Unplanned
from oag.model.where import Where
from oag.sizes import Gripper

STANDING = 0.9  # Of an axis: what stands is carried standing.


def first_misfit(task: Task, world: World) -> tuple[int, int, Failure] | None:
    """Return the first subtask, with its step, of which sizes alone say that it cannot be done; None where none is.

    Args:
        task: The plan, with flows.
        world: The things at the start.
    """
    gripper = Gripper.of(world.scene.robot)
    for index, subtask in enumerate(task.subtasks):
        if (failure := no_part(world, subtask)) is not None:
            return index, 0, failure
        if world.assets[subtask.target].motion != "dynamic":
            continue
        primitives = [action.primitive for action in subtask.flow or ()]
        takes = Primitive.GRASP in primitives
        failure = misfit(subtask.target, world.assets[subtask.target], gripper) if takes else None
        if failure is not None:
            return index, primitives.index(Primitive.GRASP), failure
        if Primitive.UNGRASP in primitives and (failure := no_room(world, subtask)) is not None:
            return index, primitives.index(Primitive.UNGRASP), failure
    return None


def no_part(world: World, subtask: SimpleTask) -> Failure | None:
    """Return a failure where a thing does not have the part that a subtask names, else None."""
    where, thing = subtask.where, subtask.support_goal or subtask.target
    if where is None or not where.part:
        return None
    asset = world.assets[thing]
    if subtask.support_goal is None:
        found = bool(handles_of(world, thing, where))
    else:
        found = bool(regions_of(world, thing, asset.regions, where))
    if found:
        return None
    if len(several := parts_named(asset, where)) > 1:
        message = f"{where} fits several parts of {thing}: {', '.join(several)}; expected a word that fits one of them"
        return Failure(FailureKind.NO_PART, message, (Unplanned(target=subtask.target, support=thing),))
    message = f"{thing} has no {where}: it has {_parts(asset, where)}"
    return Failure(FailureKind.NO_PART, message, (Unplanned(target=subtask.target, support=thing),))


def _parts(asset: Asset, where: Where) -> str:
    if where.part == "shelf":
        boards = sum(not region.opens_upward for region in asset.regions)
        return f"{boards or 'no'} {'shelf' if boards == 1 else 'shelves'}"
    kinds = {"revolute": "door", "prismatic": "drawer"}
    counts = Counter(kinds[joint.kind] for joint in asset.joints if joint.opens)
    return " and ".join(pluralize(count, part) for part, count in counts.items()) or "neither doors nor drawers"


def no_room(world: World, subtask: SimpleTask) -> Failure | None:
    """Return a failure where what a subtask puts inside something is too large for each of its interiors, else None."""
    item, support = subtask.target, subtask.support_goal
    inside = any(atom.predicate == "inside" and atom.args == (item, support) for atom in atoms(subtask.goal))
    if support is None or not inside:
        return None
    interiors = [region for region in world.assets[support].regions if region.kind == "interior"]
    fitting = [region for region in interiors if _may_fit(world, item, support, region)]
    if not interiors or any(_may_end_inside(world, item, support, region) for region in fitting):
        return None
    if fitting:
        deepest_m = max(2 * region.half_extents_m[2] for region in fitting)
        message = (
            f"{item} stands out of {support}: its middle stays {1000 * _least_middle_m(world, item, support):.0f} mm "
            f"above the bottom, and {support} is {1000 * deepest_m:.0f} mm deep inside"
        )
        return Failure(FailureKind.NO_PATH, message, (Unplanned(target=item, support=support),))
    size = " x ".join(f"{1000 * extent:.0f}" for extent in world.assets[item].extent_m)
    largest = max(interiors, key=lambda region: math.prod(region.half_extents_m))
    room = " x ".join(f"{2000 * half:.0f}" for half in largest.half_extents_m)
    message = f"{item} is too large for {support}: {size} mm, and the largest room in it is {room} mm"
    return Failure(FailureKind.NO_PATH, message, (Unplanned(target=item, support=support),))


def _may_end_inside(world: World, item: str, support: str, region: Region) -> bool:
    """Return whether a thing stands between the walls of what is open at the top, or its middle gets below the rim.

    What rolls, or lies already, ends as it falls; all else has to stand as upright as a goal asks of it.
    """
    asset = world.assets[item]
    stands = abs(world.T_world_link(item)[2, 2]) >= STANDING and not rolls_freely(asset)
    return (
        not stands
        or not region.opens_upward
        or (_least_middle_m(world, item, support) <= 2 * region.half_extents_m[2])
        # What stands between the walls is in, however far it stands out.
        or all(extent / 2 <= half for extent, half in zip(asset.extent_m[:2], region.half_extents_m[:2], strict=True))
    )


def _least_middle_m(world: World, item: str, support: str) -> float:
    """Return the least height [m] of a standing thing's middle above the floor, leaning as far as a goal allows."""
    x, y, z = world.assets[item].extent_m
    most_rad = math.radians(LEANS_DEG if support in world.dynamic_ids else STANDS_DEG)
    return min(z, z * math.cos(most_rad) + min(x, y) * math.sin(most_rad)) / 2


def _may_fit(world: World, item: str, support: str, region: Region) -> bool:
    x, y, z = world.assets[item].extent_m
    room_x, room_y, room_z = (2 * half for half in region.half_extents_m)
    if region.opens_upward:
        # From above it may come in any way up, and stand out of it.
        least, middle, _ = sorted((x, y, z))
        rim = world.assets[support].rim
        if rim is not None:
            return middle <= 2 * rim.radius_m - rim.thickness_m
        return least <= min(room_x, room_y) and middle <= max(room_x, room_y)
    if abs(world.T_world_link(item)[2, 2]) < STANDING:
        return min(x, y, z) <= room_z
    return z <= room_z and min(x, y) <= min(room_x, room_y) and max(x, y) <= math.hypot(room_x, room_y)
