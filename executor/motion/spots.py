"""Where in a region a thing can be put, and from which side the hand comes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from executor.assets.model import Region
from executor.geometry import Array, heading_of

DEPTHS_M = (0.16, 0.21, 0.12)
LATERALS_M = (0.0, 0.07, -0.07, 0.13, -0.13)
EDGE_INSET_M = 0.13
ALONG_EDGE = (0.5, 0.3, 0.7)
SMALL_M = 0.12
HEADINGS = 12
HEADING_OFFSETS_RAD = (0.0, 0.25, -0.25)
LATERAL_COST = 0.5


@dataclass(frozen=True, slots=True)
class Spot:
    """A point on a region's floor where something can stand.

    Attributes:
        point_m: (3,) in the world.
        headings_rad: Headings from which the hand may come, the preferred one first.
        cost: In rad of joint margin.
    """

    point_m: Array
    headings_rad: tuple[float, ...]
    cost: float


def spots(region: Region, T_world_link: Array, footprint_m: float, here: Array) -> list[Spot]:
    """Returns spots in a region, the preferred ones first.

    Args:
        region: The region, in its link's frame.
        T_world_link: (4, 4) where the link is.
        footprint_m: Width of the thing on the floor.
        here: (3,) where the robot stands: of a table's edges, nearer ones cost less.
    """
    R = T_world_link[:3, :3]
    half = np.array(region.half_extents_m)
    floor = np.array(region.center_m) - [0.0, 0.0, half[2]]
    opening = np.array(region.opening)

    if abs(opening[2]) < 0.5:
        heading = heading_of(-(R @ opening))
        side = np.cross([0.0, 0.0, 1.0], opening)
        depth_room = 2 * float(np.abs(half @ np.abs(opening)))
        width_room = float(half @ np.abs(side)) - footprint_m / 2 - 0.01
        found = []
        for rank, depth in enumerate(DEPTHS_M):
            if depth + footprint_m / 2 > depth_room:
                continue
            for lateral in LATERALS_M:
                if abs(lateral) <= width_room:
                    local = floor + opening * (depth_room / 2 - depth) + side * lateral
                    headings = tuple(heading + offset for offset in HEADING_OFFSETS_RAD)
                    found.append(Spot(_point(T_world_link, local), headings, 0.03 * rank + LATERAL_COST * abs(lateral)))
        return sorted(found, key=lambda s: s.cost)
    if max(half[:2]) < SMALL_M:
        ring = tuple(2 * np.pi * k / HEADINGS for k in range(HEADINGS))
        return [Spot(_point(T_world_link, floor), ring, 0.0)]
    return _along_edges(T_world_link, half, floor, here)


def _point(T_world_link: Array, local: Array) -> Array:
    return np.asarray((T_world_link @ np.array([*local, 1.0]))[:3])


def _along_edges(T_world_link: Array, half: Array, floor: Array, here: Array) -> list[Spot]:
    found = []
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
        inward = np.zeros(3)
        inward[axis] = -sign
        inset = min(EDGE_INSET_M, float(half[axis]))
        for rank, along in enumerate(ALONG_EDGE):
            local = floor - inward * (half[axis] - inset)
            local = local + (2 * along - 1) * np.where(np.arange(3) == 1 - axis, half, 0.0)
            point = _point(T_world_link, local)
            distance = float(np.hypot(*(point[:2] - here[:2])))
            heading = heading_of(T_world_link[:3, :3] @ inward)
            headings = tuple(heading + offset for offset in HEADING_OFFSETS_RAD)
            found.append(Spot(point, headings, 0.05 * distance + 0.02 * rank))
    return sorted(found, key=lambda s: s.cost)
