"""Free spots in a region where a thing can stand: drawn from the seed within what fits, then a few set ones.

The drawn ones come first, so that demonstrations differ in where things end up. A seed may draw none that the robot
can get to, as behind a post or in the far corner of a table: the set ones, in the middle and near edges, are for that.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from executor.assets.footprint import EDGES, Disc, Footprint, gaps_m
from executor.assets.model import Region
from executor.geometry import Array, heading_of, inverse

DEPTHS_M = (0.16, 0.21, 0.12, 0.27)  # Behind a front, the most comfortable first.
LATERALS_M = (0.0, 0.07, -0.07, 0.13, -0.13, 0.20, -0.20)  # Beside the middle of a compartment, the middle first.
EDGE_INSETS_M = (0.13, 0.20, 0.09)  # From a table's edge: a thing is safe there and in reach.
ALONG_EDGE = (0.5, 0.35, 0.65, 0.2, 0.8)  # Of an edge's length, the middle first.
FLOOR = "floor"
"""What the floor calls its place: it is everywhere, so spots are around the robot and not along its edges."""

FLOOR_RINGS_M = (0.55, 0.75, 1.0)  # Off the base, which is 0.26 m wide, and near enough to need little driving.
FLOOR_SPOTS = 12  # A ring, every 30 degrees.
SMALL_M = 0.12  # A region that is smaller has one side as well as any other: a bowl's inside.
HEADINGS = 12  # Every 30 degrees.
HEADING_OFFSETS_RAD = (0.0, 0.25, -0.25)  # Straight in first.
LATERAL_COST = 0.5  # For each metre beside the middle.
ROOM_M = 0.06
"""Free floor around a thing beyond which more does not help: fingers and palm fit in."""

CROWD_COST = 0.3  # Without any room to the next thing.
APART_M = 0.005  # What things keep from each other.
MOST_SPOTS = 15  # Each has dozens of hand poses.

DRAWS = 12  # So many that one or more is in reach: a table against a wall has one free edge of four.
HOLLOW_DRAWS = 4  # Of a bowl's inside, which has no side that is any better; each is tried from twelve headings.
HOLLOW_SHARE = 0.5  # Of the room off its middle: its floor rises towards the wall, and what lies there lies aslant.
DRAW_COST = 0.02  # For each draw after the first: less than a joint margin that can be told.
SET_COST = 0.25
"""What a set spot costs more than the first drawn one: as much as all draws, so that it is taken where these fail."""

DEEPEST_M, WIDEST_M = 0.27, 0.22
"""How far behind a front, or in from an edge, and how far beside the middle the arm gets to."""

EDGE_M = 0.03
"""What drawn things keep from edges and walls: fingers fit in, and nothing stands half over an edge."""

BEHIND_M = 0.10  # The middle of a thing is so far behind a front: doors shut, and no drawer has it at its lip.
FINGER_M = 0.02  # Of a finger beside what it lowers into a bowl.


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


def drawing(seed: int, item: str, support: str, region: str) -> np.random.Generator:
    """Returns what the spots of a thing in a region are drawn from: the same for whoever asks within an episode."""
    return np.random.default_rng([seed, zlib.crc32(f"{item} {support} {region}".encode())])


def spots(
    region: Region,
    T_world_link: Array,
    footprint_m: float,
    here: Array,
    *,
    height_m: float = 0.0,
    others: Mapping[str, Footprint] = MappingProxyType({}),
    rng: np.random.Generator | None = None,
) -> list[Spot]:
    """Returns free spots in a region, the preferred ones first: drawn ones, then set ones in reach and in the middle.

    Args:
        region: The region, in its link's frame.
        T_world_link: (4, 4) where the link is.
        footprint_m: Width of the thing on the floor.
        here: (3,) where the robot stands: of a table's edges, nearer ones cost less.
        height_m: Height of the thing.
        others: id -> what else stands in the world.
        rng: What spots are drawn from; without it there are the set ones alone.
    """
    floor = _Floor.of(region, T_world_link, footprint_m)

    def free(candidates: Iterable[Spot]) -> list[Spot]:
        found = []
        for spot in candidates:
            x, y, z = spot.point_m.tolist()
            mine = Disc(x, y, footprint_m / 2, z + APART_M, z + max(height_m, APART_M))
            room_m = min((gap_m for _, gap_m in gaps_m(mine, others)), default=np.inf)
            if room_m >= APART_M:
                found.append(replace(spot, cost=spot.cost + CROWD_COST * max(0.0, 1.0 - room_m / ROOM_M)))
        return sorted(found, key=lambda spot: spot.cost)[:MOST_SPOTS]

    if rng is None:
        return free(floor.set_spots(here))
    drawn = free(floor.drawn_spots(here, rng))
    return drawn + [replace(spot, cost=spot.cost + SET_COST) for spot in free(floor.set_spots(here))]


@dataclass(frozen=True, slots=True)
class _Floor:
    """A region's floor in its link's frame.

    Attributes:
        T_world_link: (4, 4) where the link is.
        half: (3,) half extents of the region.
        middle: (3,) middle of the floor.
        opening: (3,) from where things are put in.
        footprint_m: Width of the thing on the floor.
        is_everywhere: Whether it is the room's floor, which has no edge to stand at.
        is_within: Whether walls are around it.
    """

    T_world_link: Array
    half: Array
    middle: Array
    opening: Array
    footprint_m: float
    is_everywhere: bool
    is_within: bool

    @classmethod
    def of(cls, region: Region, T_world_link: Array, footprint_m: float) -> _Floor:
        half, middle, is_within = np.array(region.half_extents_m), np.array(region.floor_m), region.kind == "interior"
        return cls(T_world_link, half, middle, np.array(region.opening), footprint_m, region.name == FLOOR, is_within)

    def set_spots(self, here: Array) -> Iterator[Spot]:
        """Yields a fixed choice of spots, on and about the middle line."""
        if self.is_everywhere:
            turns = itertools.product(enumerate(FLOOR_RINGS_M), range(FLOOR_SPOTS))
            around = (self._on_ring(here, ring_m, k / FLOOR_SPOTS, 0.05 * rank) for (rank, ring_m), k in turns)
            yield from (spot for spot in around if spot is not None)
        elif self._is_behind_a_front:
            depth_room, width_room = self._depth_m, self._beside_m(0.01)
            for (rank, depth), lateral in itertools.product(enumerate(DEPTHS_M), LATERALS_M):
                if depth + self.footprint_m / 2 <= depth_room and abs(lateral) <= width_room:
                    yield self._behind(depth, lateral, 0.03 * rank + LATERAL_COST * abs(lateral))
        elif self._is_small:
            yield self._within((0.0, 0.0), 0.0)
        else:
            for edge in EDGES.values():
                deepest = float(self.half[edge[0]])
                insets = dict.fromkeys(min(i, deepest) for i in EDGE_INSETS_M if i > self.footprint_m / 2)
                for (rank, inset), (turn, along) in itertools.product(enumerate(insets), enumerate(ALONG_EDGE)):
                    spot = self._at_edge(edge, inset, 2 * along - 1)
                    distance = float(np.hypot(*(spot.point_m[:2] - here[:2])))
                    yield replace(spot, cost=0.05 * distance + 0.02 * turn + 0.05 * rank)

    def drawn_spots(self, here: Array, rng: np.random.Generator) -> Iterator[Spot]:
        """Yields spots drawn evenly from where the thing fits and the arm gets to."""
        least = self.footprint_m / 2 + EDGE_M
        for rank, numbers in enumerate(rng.uniform(size=(DRAWS, 3))):
            cost = DRAW_COST * rank
            if self.is_everywhere:
                spot = self._on_ring(here, _between(numbers[0], FLOOR_RINGS_M[0], FLOOR_RINGS_M[-1]), numbers[1], cost)
                if spot is not None:
                    yield spot
            elif self._is_behind_a_front:
                nearest = max(BEHIND_M, least)
                deepest = min(DEEPEST_M, self._depth_m - self.footprint_m / 2 - 0.01)
                beside = min(WIDEST_M, self._beside_m(EDGE_M))
                if deepest >= nearest and beside >= 0.0:
                    depth, lateral = _between(numbers[0], nearest, deepest), _between(numbers[1], -beside, beside)
                    yield self._behind(depth, lateral, cost)
            elif self._is_small:
                if rank >= HOLLOW_DRAWS:
                    break
                radius = min(self.half[:2]) - self.footprint_m / 2 - FINGER_M
                angle = 2 * np.pi * numbers[1]
                off = (HOLLOW_SHARE if self.is_within else 1.0) * max(radius, 0.0) * np.sqrt(numbers[0])
                yield self._within((off * np.cos(angle), off * np.sin(angle)), cost)
            else:
                edge = tuple(EDGES.values())[int(len(EDGES) * numbers[2])]
                deepest, along = min(DEEPEST_M, float(self.half[edge[0]])), float(self.half[1 - edge[0]]) - least
                if deepest >= least and along >= 0.0:
                    share = _between(numbers[1], -along, along) / float(self.half[1 - edge[0]])
                    yield replace(self._at_edge(edge, _between(numbers[0], least, deepest), share), cost=cost)

    def _on_ring(self, here: Array, ring_m: float, turn: float, cost: float) -> Spot | None:
        """Returns the spot so far off the robot in a direction, a share of a full turn; None where the floor ends."""
        heading = 2 * np.pi * float(turn)
        point = np.array([here[0] + ring_m * np.cos(heading), here[1] + ring_m * np.sin(heading), 0.0])
        local = (inverse(self.T_world_link) @ np.array([*point, 1.0]))[:3]
        if (np.abs(local - self.middle)[:2] > self.half[:2] - self.footprint_m / 2).any():
            return None
        point[2] = self._point(self.middle)[2]
        return Spot(point, tuple(heading + offset for offset in HEADING_OFFSETS_RAD), cost)

    @property
    def _is_behind_a_front(self) -> bool:
        return bool(abs(self.opening[2]) < 0.5)

    @property
    def _is_small(self) -> bool:
        return bool(max(self.half[:2]) < SMALL_M)

    @property
    def _depth_m(self) -> float:
        return 2 * float(np.abs(self.half @ np.abs(self.opening)))

    def _beside_m(self, clear_m: float) -> float:
        """How far beside the middle of a compartment the thing may stand."""
        side = np.cross([0.0, 0.0, 1.0], self.opening)
        return float(self.half @ np.abs(side)) - self.footprint_m / 2 - clear_m

    def _behind(self, depth_m: float, lateral_m: float, cost: float) -> Spot:
        side = np.cross([0.0, 0.0, 1.0], self.opening)
        local = self.middle + self.opening * (self._depth_m / 2 - depth_m) + side * lateral_m
        return Spot(self._point(local), self._headings(-self.opening), cost)

    def _within(self, off_m: tuple[float, float], cost: float) -> Spot:
        ring = tuple(2 * np.pi * k / HEADINGS for k in range(HEADINGS))
        return Spot(self._point(self.middle + np.array([*off_m, 0.0])), ring, cost)

    def _at_edge(self, edge: tuple[int, float], inset_m: float, share: float) -> Spot:
        axis, sign = edge
        inward = np.zeros(3)
        inward[axis] = -sign
        local = self.middle - inward * (self.half[axis] - inset_m)
        local = local + share * np.where(np.arange(3) == 1 - axis, self.half, 0.0)
        return Spot(self._point(local), self._headings(inward), 0.0)

    def _headings(self, into: Array) -> tuple[float, ...]:
        heading = heading_of(self.T_world_link[:3, :3] @ into)
        return tuple(heading + offset for offset in HEADING_OFFSETS_RAD)

    def _point(self, local: Array) -> Array:
        return np.asarray((self.T_world_link @ np.array([*local, 1.0]))[:3])


def _between(share: float, low: float, high: float) -> float:
    return low + float(share) * (high - low)
