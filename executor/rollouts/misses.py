"""How far an item is from the place that its goal names, in the robot's own directions.

This is what turns "it fell beside the shelf" into a number that a flow can be corrected by.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from bddl import Atom, format
from executor.assets.model import Region
from executor.geometry import Array, inverse, rotation_z
from executor.world.detectors import box_around
from executor.world.world import World
from oag.revision.grounds import Miss

_KINDS = {"inside": "interior", "ontop": "surface"}
CLEARANCE_M = 0.01
"""How far the item's box should stay away from the sides of its place."""

FREE_FALL_M = 0.04
"""How far above its place an item may be let go."""


def misses(goal: Iterable[Atom], world: World, base_yaw_rad: float) -> tuple[Miss, ...]:
    """Returns how far the items of a goal are from their places, one for each `inside` or `ontop` that has a place.

    Args:
        goal: Atoms that shall be true.
        world: Where things are.
        base_yaw_rad: Where the robot faces, which is "forward".
    """
    return tuple(found for atom in goal for found in _nearest(atom, world, base_yaw_rad))


def _nearest(atom: Atom, world: World, base_yaw_rad: float) -> Iterator[Miss]:
    if atom.predicate not in _KINDS or len(atom.args) != 2:
        return
    item, support = atom.args
    if item not in world.dynamic_ids or support not in world.assets:
        return
    regions = [r for r in world.assets[support].regions if r.kind == _KINDS[atom.predicate]]
    found = [_miss(atom, world, region, base_yaw_rad) for region in regions]
    if found:
        yield min(found, key=lambda miss: miss.distance_m)


def _miss(atom: Atom, world: World, region: Region, base_yaw_rad: float) -> Miss:
    item, support = atom.args
    T_world_link = world.T_world_link(support, region.link)
    centre, half = box_around(world, item, inverse(T_world_link))
    middle, room = np.asarray(region.center_m), np.asarray(region.half_extents_m)
    # Where its centre may be: inside by its own size at the sides; standing, or a little above, in height.
    free = np.maximum(room - half - CLEARANCE_M, 0.0)
    low, high = middle - free, middle + free
    standing = middle[2] - room[2] + half[2]
    low[2], high[2] = standing, standing + FREE_FALL_M
    to_robot = rotation_z(base_yaw_rad).T @ T_world_link[:3, :3]
    offset: Array = to_robot @ (np.clip(centre, low, high) - centre)
    to_middle: Array = to_robot @ (middle - centre)
    numbers = (float(v) for v in np.round([*offset, *to_middle[:2]], 4))
    return Miss(format(atom), *numbers)
