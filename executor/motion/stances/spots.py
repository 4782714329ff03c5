"""Where in a region a thing can be put, and from which side the hand comes."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from executor.assets.model import Region
from executor.geometry import Array, heading_of

DEPTHS_M = (0.16, 0.21, 0.12, 0.27)  # Behind a front, the most comfortable first.
LATERALS_M = (0.0, 0.07, -0.07, 0.13, -0.13, 0.20, -0.20)  # Beside the middle of a compartment, the middle first.
EDGE_INSETS_M = (0.13, 0.20, 0.09)  # From a table's edge: a thing is safe there and in reach.
ALONG_EDGE = (0.5, 0.35, 0.65, 0.2, 0.8)  # Of an edge's length, the middle first.
SMALL_M = 0.12  # A region that is smaller has one spot, its middle.
HEADINGS = 12  # Every 30 degrees.
HEADING_OFFSETS_RAD = (0.0, 0.25, -0.25)  # Straight in first.
LATERAL_COST = 0.5  # For each metre beside the middle.
ROOM_M = 0.06
"""Free floor around a thing beyond which more does not help: fingers and palm fit in."""

CROWD_COST = 0.3  # Without any room to the next thing.
APART_M = 0.005  # What things keep from each other.
MOST_SPOTS = 15  # Each has dozens of hand poses.


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


@dataclass(frozen=True, slots=True)
class Obstacle:
    """The box around an item that stands somewhere, along the world's axes: centre and half extents (3,)."""

    centre_m: Array
    half_m: Array


def spots(
    region: Region,
    T_world_link: Array,
    footprint_m: float,
    here: Array,
    *,
    height_m: float = 0.0,
    obstacles: Iterable[Obstacle] = (),
) -> list[Spot]:
    """Returns free spots in a region, the preferred ones first: within reach, in the middle, away from other things.

    Args:
        region: The region, in its link's frame.
        T_world_link: (4, 4) where the link is.
        footprint_m: Width of the thing on the floor.
        here: (3,) where the robot stands: of a table's edges, nearer ones cost less.
        height_m: Height of the thing.
        obstacles: Other items.
    """
    free = []
    others = list(obstacles)
    for spot in _candidates(region, T_world_link, footprint_m, here):
        room_m = min((_gap_m(spot.point_m, height_m, other) for other in others), default=np.inf) - footprint_m / 2
        if room_m >= APART_M:
            free.append(replace(spot, cost=spot.cost + CROWD_COST * max(0.0, 1.0 - room_m / ROOM_M)))
    return sorted(free, key=lambda spot: spot.cost)[:MOST_SPOTS]


def _gap_m(point_m: Array, height_m: float, other: Obstacle) -> float:
    """How far an item is from a point on the floor; infinite where it stands above or below what would stand there."""
    low, high = other.centre_m[2] - other.half_m[2], other.centre_m[2] + other.half_m[2]
    if high <= point_m[2] + APART_M or low >= point_m[2] + max(height_m, APART_M):
        return float(np.inf)
    beyond = np.abs(point_m - other.centre_m)[:2] - other.half_m[:2]
    return float(np.hypot(*np.maximum(beyond, 0.0)))


def _candidates(region: Region, T_world_link: Array, footprint_m: float, here: Array) -> list[Spot]:
    half = np.array(region.half_extents_m)
    floor = np.array(region.center_m) - [0.0, 0.0, half[2]]
    opening = np.array(region.opening)
    if abs(opening[2]) < 0.5:
        return _behind_an_opening(T_world_link, half, floor, opening, footprint_m)
    if max(half[:2]) < SMALL_M:
        ring = tuple(2 * np.pi * k / HEADINGS for k in range(HEADINGS))
        return [Spot(_point(T_world_link, floor), ring, 0.0)]
    return _along_edges(T_world_link, half, floor, footprint_m, here)


def _point(T_world_link: Array, local: Array) -> Array:
    return np.asarray((T_world_link @ np.array([*local, 1.0]))[:3])


def _behind_an_opening(
    T_world_link: Array, half: Array, floor: Array, opening: Array, footprint_m: float
) -> list[Spot]:
    heading = heading_of(-(T_world_link[:3, :3] @ opening))
    headings = tuple(heading + offset for offset in HEADING_OFFSETS_RAD)
    side = np.cross([0.0, 0.0, 1.0], opening)
    depth_room = 2 * float(np.abs(half @ np.abs(opening)))
    width_room = float(half @ np.abs(side)) - footprint_m / 2 - 0.01
    found = []
    for (rank, depth), lateral in itertools.product(enumerate(DEPTHS_M), LATERALS_M):
        if depth + footprint_m / 2 <= depth_room and abs(lateral) <= width_room:
            local = floor + opening * (depth_room / 2 - depth) + side * lateral
            found.append(Spot(_point(T_world_link, local), headings, 0.03 * rank + LATERAL_COST * abs(lateral)))
    return found


def _along_edges(T_world_link: Array, half: Array, floor: Array, footprint_m: float, here: Array) -> list[Spot]:
    found = []
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
        inward = np.zeros(3)
        inward[axis] = -sign
        heading = heading_of(T_world_link[:3, :3] @ inward)
        headings = tuple(heading + offset for offset in HEADING_OFFSETS_RAD)
        insets = dict.fromkeys(min(inset, float(half[axis])) for inset in EDGE_INSETS_M if inset > footprint_m / 2)
        for (depth_rank, inset), (rank, along) in itertools.product(enumerate(insets), enumerate(ALONG_EDGE)):
            local = floor - inward * (half[axis] - inset)
            local = local + (2 * along - 1) * np.where(np.arange(3) == 1 - axis, half, 0.0)
            point = _point(T_world_link, local)
            distance = float(np.hypot(*(point[:2] - here[:2])))
            found.append(Spot(point, headings, 0.05 * distance + 0.02 * rank + 0.05 * depth_rank))
    return found
