"""Free spots in a region where a thing can stand, and the hand poses that hold it upright over a spot.

Spots are sampled from the seed within what fits; a few fixed ones follow. Sampled ones come first, so that
demonstrations differ in where things end up. A seed may sample none that the robot can get to, as behind a post or in
the far corner of a table. The fixed ones, in the middle and near edges, are for that.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from executor.assets.asset_geometry import rolls_freely
from executor.assets.footprint import EDGES, Disc, Footprint, gaps_m
from executor.assets.model import Asset, Region
from executor.geometry import Array, hand_rotation, heading_of, inverse, rotation_z, transform
from executor.planning.cargo import Carried
from executor.planning.grasps import heading_of_hand, is_held_at_rim
from executor.planning.stances import HandGoal
from executor.sim.detectors import box_around
from executor.sim.world import World
from oag.model.robots import HandShape

DEPTHS_M = (0.16, 0.21, 0.12, 0.27)  # Behind a front, the most comfortable first.
LATERALS_M = (0.0, 0.07, -0.07, 0.13, -0.13, 0.20, -0.20)  # To the side of a compartment's middle, the middle first.
EDGE_INSETS_M = (0.13, 0.20, 0.09)  # From a table's edge: a thing is safe there and in reach.
ALONG_EDGE = (0.5, 0.35, 0.65, 0.2, 0.8)  # Of an edge's length, the middle first.
FLOOR = "floor"
"""Name of the floor's region: it is everywhere, so spots are around the robot and not along its edges."""

FLOOR_RINGS_M = (0.55, 0.75, 1.0)  # Off the base, which is 0.26 m wide, and near enough to need little driving.
FLOOR_SPOTS = 12  # A ring, every 30 degrees.
SMALL_M = 0.12  # A region that is smaller has one side as well as any other: a bowl's inside.
HEADINGS = 12  # Every 30 degrees.
HEADING_OFFSETS_RAD = (0.0, 0.25, -0.25)  # Straight in first.
LATERAL_COST = 0.5  # For each metre off the middle.
ROOM_M = 0.06
"""Free floor around a thing beyond which more does not help: fingers and palm fit in."""

CROWD_COST = 0.3  # Without any room to the next thing.
APART_M = 0.005  # What things keep from each other.
MOST_SPOTS = 15  # Each has dozens of hand poses.

DRAWS = 12  # Samples: so many that one or more is in reach, since a table against a wall has one free edge of four.
HOLLOW_DRAWS = 4  # Of a bowl's inside, which has no side that is any better; each is tried from twelve headings.
HOLLOW_SHARE = 0.5  # Of the room off its middle: its floor rises towards the wall, and what lies there lies aslant.
SHARES_BETWEEN = (0.5, 0.75, 1.0)  # Of the room off its middle, where other things lie in it.
ASIDE_M = (0.005, 0.01, 0.0, 0.015)  # More than half of the distance to what comes later: things slide a little.
NEARER = (0.5, 0.0)  # What stands half on a bowl's wall may fall; nearer to the middle it does not.
NEARER_COST = 0.15  # Farther out there is more room for what comes later.
HEAP_M = 0.08  # What lies in a bowl is at most so high where another thing is let go of above it.
ROOM_COST = 1.0  # Of a place that leaves no room for what comes later: more than all other costs.
SQUARE_M = 1e-4  # By so much the sides of a square region differ at most.
PARALLEL = 1e-6
DRAW_COST = 0.02  # For each sample after the first: less than a noticeable joint margin.
SET_COST = 0.25
"""Extra cost of a fixed spot over the first sampled one: as much as all samples, so it is taken where these fail."""

DEEPEST_M, WIDEST_M = 0.27, 0.22
"""How far behind a front, or in from an edge, and how far to the side of the middle the arm reaches."""

EDGE_M = 0.03
"""Distance of sampled spots from edges and walls: fingers fit in, and nothing stands half over an edge."""

BEHIND_M = 0.10  # The middle of a thing is so far behind a front: doors shut, and no drawer has it at its lip.
FINGER_M = 0.02  # Of a finger next to what it lowers into a bowl.


@dataclass(frozen=True, slots=True)
class PlacementSpot:
    """A point on a region's floor where something can stand.

    Attributes:
        point_m: (3,) in the world.
        headings_rad: Headings from which the hand may come, the preferred one first.
        cost: In rad of joint margin.
    """

    point_m: Array
    headings_rad: tuple[float, ...]
    cost: float


def spot_rng(seed: int, item: str, support: str, region: str) -> np.random.Generator:
    """Return the random generator of a thing's spots in a region: the same throughout an episode."""
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
    to_come_m: float = 0.0,
    heaps: bool = False,
    is_round: bool = False,
) -> list[PlacementSpot]:
    """Return free spots in a region, the preferred ones first: sampled ones, then fixed ones within reach.

    In the middle of a bowl or box a thing takes the room of all others: where more is to come, it goes to a side.

    Args:
        region: The region, in its link's frame.
        T_world_link: (4, 4) where the link is.
        footprint_m: Width of the thing on the floor.
        here: (3,) where the robot stands: of a table's edges, nearer ones cost less.
        height_m: Height of the thing.
        others: id -> what else stands in the world.
        rng: Samples the spots; without it there are the fixed ones alone.
        to_come_m: Width of the widest thing that is put into the region later; 0 where nothing is.
        heaps: Whether spots above what lies in a bowl or box are among them.
        is_round: Whether a small top is round, such as a plate's: its region is the square within.
    """
    floor = _Floor.of(region, T_world_link, footprint_m, is_round=is_round)

    def free(candidates: Iterable[PlacementSpot]) -> list[PlacementSpot]:
        found = []
        for spot in candidates:
            x, y, z = spot.point_m.tolist()
            mine = Disc(x, y, footprint_m / 2, z + APART_M, z + max(height_m, APART_M))
            room_m = min((gap_m for _, gap_m in gaps_m(mine, others)), default=np.inf)
            if room_m >= APART_M:
                found.append(replace(spot, cost=spot.cost + CROWD_COST * max(0.0, 1.0 - room_m / ROOM_M)))
        return sorted(found, key=lambda spot: spot.cost)[:MOST_SPOTS]

    def heaped() -> Iterator[PlacementSpot]:
        """Yield the spots in a bowl or box that are above what lies there, best where the least of it is below."""
        for spot in floor.spots_between():
            x, y, z = spot.point_m.tolist()
            over = Disc(x, y, footprint_m / 2, z, z + HEAP_M)
            below = {name: gap_m for name, gap_m in gaps_m(over, others) if gap_m < APART_M}
            top_m = max((others[name].high_m for name in below), default=np.inf)
            if top_m - z <= HEAP_M:
                cost = spot.cost + CROWD_COST * (APART_M - min(below.values())) / footprint_m
                yield replace(spot, point_m=np.array([x, y, top_m]), cost=cost)

    if rng is None:
        return free(floor.fixed_spots(here))
    aside = free(floor.spots_aside(to_come_m)) if to_come_m else []
    if aside and not heaps:
        return aside
    drawn = aside + free(floor.spots_aside(to_come_m, NEARER)) if aside else free(floor.sample_spots(here, rng))
    found = drawn + _later(free(floor.fixed_spots(here))) or free(floor.spots_between())
    heaps = heaps and not floor.is_disc
    if to_come_m and heaps and not floor.is_small:
        theirs = spots(region, T_world_link, to_come_m, here, height_m=height_m, others=others)
        inward = -T_world_link[:2, :2] @ np.array(region.opening[:2]) if floor.is_behind_a_front else np.zeros(2)
        found = _with_room_first(found, theirs, (footprint_m + to_come_m) / 2 + APART_M, inward)
    return found + _later(free(heaped())) if heaps else found


def _with_room_first(
    found: list[PlacementSpot], theirs: list[PlacementSpot], apart_m: float, inward: Array
) -> list[PlacementSpot]:
    """Return spots, those last that leave none of other spots free.

    Args:
        found: The spots.
        theirs: Free spots of what comes later.
        apart_m: Distance of a spot from one of the others that is left free.
        inward: (2,) from the front of a compartment to its back; 0 where there is no front. What comes first goes to
            the back, so that the hand with the next thing does not have to pass it.
    """
    if not theirs:
        return found
    others_m = np.array([spot.point_m[:2] for spot in theirs])
    costed = list[PlacementSpot]()
    for spot in found:
        off_m = others_m - spot.point_m[:2]
        before = off_m @ inward <= 0.0
        spare_m = float(np.hypot(*off_m.T)[before].max(initial=0.0)) - apart_m
        # Fingers need room between the two, and what is let go of is not where it was meant to the millimetre.
        cost = ROOM_COST if spare_m < 0.0 else CROWD_COST * max(0.0, 1.0 - spare_m / ROOM_M)
        costed.append(replace(spot, cost=spot.cost + cost))
    return sorted(costed, key=lambda spot: spot.cost)


def _later(found: list[PlacementSpot]) -> list[PlacementSpot]:
    return [replace(spot, cost=spot.cost + SET_COST) for spot in found]


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
        is_disc: Whether it is small and round, and `half` its radius.
    """

    T_world_link: Array
    half: Array
    middle: Array
    opening: Array
    footprint_m: float
    is_everywhere: bool
    is_within: bool
    is_disc: bool = False

    @classmethod
    def of(cls, region: Region, T_world_link: Array, footprint_m: float, *, is_round: bool) -> _Floor:
        half, middle, is_within = np.array(region.half_extents_m), np.array(region.floor_m), region.kind == "interior"
        is_disc = is_round and not is_within and bool(max(half[:2]) < SMALL_M)
        if is_disc:
            half[:2] *= np.sqrt(2.0)
        opening, is_everywhere = np.array(region.opening), region.name == FLOOR
        return cls(T_world_link, half, middle, opening, footprint_m, is_everywhere, is_within, is_disc)

    def fixed_spots(self, here: Array) -> Iterator[PlacementSpot]:
        """Yield a fixed choice of spots, on and about the middle line."""
        if self.is_everywhere:
            turns = itertools.product(enumerate(FLOOR_RINGS_M), range(FLOOR_SPOTS))
            around = (self._on_ring(here, ring_m, k / FLOOR_SPOTS, 0.05 * rank) for (rank, ring_m), k in turns)
            yield from (spot for spot in around if spot is not None)
        elif self.is_behind_a_front:
            depth_room, width_room = self._depth_m, self._lateral_room_m(0.01)
            for (rank, depth), lateral in itertools.product(enumerate(DEPTHS_M), LATERALS_M):
                if depth + self.footprint_m / 2 <= depth_room and abs(lateral) <= width_room:
                    yield self._behind(depth, lateral, 0.03 * rank + LATERAL_COST * abs(lateral))
        elif self.is_small:
            yield self._within((0.0, 0.0), 0.0)
        else:
            for edge in EDGES.values():
                deepest = float(self.half[edge[0]])
                insets = dict.fromkeys(min(i, deepest) for i in EDGE_INSETS_M if i > self.footprint_m / 2)
                for (rank, inset), (turn, along) in itertools.product(enumerate(insets), enumerate(ALONG_EDGE)):
                    spot = self._at_edge(edge, inset, 2 * along - 1)
                    distance = float(np.hypot(*(spot.point_m[:2] - here[:2])))
                    yield replace(spot, cost=0.05 * distance + 0.02 * turn + 0.05 * rank)

    def sample_spots(self, here: Array, rng: np.random.Generator) -> Iterator[PlacementSpot]:
        """Yield spots that are sampled evenly from where the thing fits and the arm reaches."""
        least = self.footprint_m / 2 + EDGE_M
        for rank, numbers in enumerate(rng.uniform(size=(DRAWS, 3))):
            cost = DRAW_COST * rank
            if self.is_everywhere:
                spot = self._on_ring(here, _between(numbers[0], FLOOR_RINGS_M[0], FLOOR_RINGS_M[-1]), numbers[1], cost)
                if spot is not None:
                    yield spot
            elif self.is_behind_a_front:
                nearest = max(BEHIND_M, least)
                deepest = min(DEEPEST_M, self._depth_m - self.footprint_m / 2 - 0.01)
                lateral_limit = min(WIDEST_M, self._lateral_room_m(EDGE_M))
                if deepest >= nearest and lateral_limit >= 0.0:
                    depth, lateral = (
                        _between(numbers[0], nearest, deepest),
                        _between(numbers[1], -lateral_limit, lateral_limit),
                    )
                    yield self._behind(depth, lateral, cost)
            elif self.is_small:
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

    def spots_between(self) -> Iterator[PlacementSpot]:
        """Yield spots all over a bowl's or box's inside, for one that has things in it."""
        for share in SHARES_BETWEEN:
            for angle in self._angles:
                yield self._off_middle(share * self._room_m(self.footprint_m, angle), angle, DRAW_COST * share)

    def spots_aside(self, to_come_m: float, nearer: tuple[float, ...] = ()) -> Iterator[PlacementSpot]:
        """Yield spots in a bowl or box beside which a thing of a width [m] has room too, the innermost first.

        Both share the room, since what is near to a bowl's wall lies high. There are none where it has room beside the
        middle, or nowhere.

        Args:
            to_come_m: The width.
            nearer: Shares of the way from where the other has all of its room to where both have as much; the spots are
                there instead.
        """
        apart_m = (self.footprint_m + to_come_m) / 2 + APART_M
        least_m = {angle: apart_m - self._room_m(to_come_m, angle) for angle in self._angles}
        if min(least_m.values(), default=0.0) > 0.0:
            for (rank, more_m), angle in itertools.product(enumerate(ASIDE_M), least_m):
                off_m = max(apart_m / 2, least_m[angle]) + more_m
                if off_m <= self._room_m(self.footprint_m, angle) and not nearer:
                    yield self._off_middle(off_m, angle, DRAW_COST * rank)
            for (rank, share), angle in itertools.product(enumerate(nearer), least_m):
                if 0.0 < least_m[angle] < apart_m / 2:
                    off_m = least_m[angle] + share * (apart_m / 2 - least_m[angle])
                    yield self._off_middle(off_m, angle, NEARER_COST + DRAW_COST * rank)

    @property
    def _angles(self) -> list[float]:
        """Directions from the middle of what is small and has walls: all around, and into the corners of a box."""
        if not (self.is_small and (self.is_within or self.is_disc)):
            return []
        around = [2 * np.pi * turn / HEADINGS for turn in range(HEADINGS)]
        rooms_m = np.maximum(self.half[:2] - self.footprint_m / 2, 0.0)
        if self._is_round or not rooms_m.any():
            return around
        corner = float(np.arctan2(rooms_m[1], rooms_m[0]))
        return [*around, corner, np.pi - corner, np.pi + corner, -corner]

    @property
    def _is_round(self) -> bool:
        """Whether what is small may be round: in a box that is as long as wide corners are left free."""
        return bool(abs(self.half[0] - self.half[1]) < SQUARE_M)

    def _off_middle(self, off_m: float, angle: float, cost: float) -> PlacementSpot:
        return self._within((off_m * float(np.cos(angle)), off_m * float(np.sin(angle))), cost)

    def _room_m(self, width_m: float, angle: float) -> float:
        """Return how far off the middle of what is small, in a direction, a thing of a width may be [m]."""
        x_m, y_m = np.maximum(self.half[:2] - width_m / 2, 0.0).tolist()
        if self._is_round:
            return float(min(x_m, y_m))
        along_m = ((x_m, abs(np.cos(angle))), (y_m, abs(np.sin(angle))))
        return min(room_m / share for room_m, share in along_m if share > PARALLEL)

    def _on_ring(self, here: Array, ring_m: float, turn: float, cost: float) -> PlacementSpot | None:
        """Return the spot at a distance and direction (share of a full turn) from the robot; None beyond the floor's
        end.
        """
        heading = 2 * np.pi * float(turn)
        point = np.array([here[0] + ring_m * np.cos(heading), here[1] + ring_m * np.sin(heading), 0.0])
        local = (inverse(self.T_world_link) @ np.array([*point, 1.0]))[:3]
        if (np.abs(local - self.middle)[:2] > self.half[:2] - self.footprint_m / 2).any():
            return None
        point[2] = self._point(self.middle)[2]
        return PlacementSpot(point, tuple(heading + offset for offset in HEADING_OFFSETS_RAD), cost)

    @property
    def is_behind_a_front(self) -> bool:
        """Whether things are put in from the side."""
        return bool(abs(self.opening[2]) < 0.5)

    @property
    def is_small(self) -> bool:
        """Whether one side is as good as any other: bowls and boxes, in which things are put aside as it is."""
        return self.is_disc or bool(max(self.half[:2]) < SMALL_M)

    @property
    def _depth_m(self) -> float:
        return 2 * float(np.abs(self.half @ np.abs(self.opening)))

    def _lateral_room_m(self, clear_m: float) -> float:
        """Return how far to the side of a compartment's middle the thing may stand [m]."""
        side = np.cross([0.0, 0.0, 1.0], self.opening)
        return float(self.half @ np.abs(side)) - self.footprint_m / 2 - clear_m

    def _behind(self, depth_m: float, lateral_m: float, cost: float) -> PlacementSpot:
        side = np.cross([0.0, 0.0, 1.0], self.opening)
        local = self.middle + self.opening * (self._depth_m / 2 - depth_m) + side * lateral_m
        return PlacementSpot(self._point(local), self._headings(-self.opening), cost)

    def _within(self, off_m: tuple[float, float], cost: float) -> PlacementSpot:
        ring = tuple(2 * np.pi * k / HEADINGS for k in range(HEADINGS))
        return PlacementSpot(self._point(self.middle + np.array([*off_m, 0.0])), ring, cost)

    def _at_edge(self, edge: tuple[int, float], inset_m: float, share: float) -> PlacementSpot:
        axis, sign = edge
        inward = np.zeros(3)
        inward[axis] = -sign
        local = self.middle - inward * (self.half[axis] - inset_m)
        local = local + share * np.where(np.arange(3) == 1 - axis, self.half, 0.0)
        return PlacementSpot(self._point(local), self._headings(inward), 0.0)

    def _headings(self, into: Array) -> tuple[float, ...]:
        heading = heading_of(self.T_world_link[:3, :3] @ into)
        return tuple(heading + offset for offset in HEADING_OFFSETS_RAD)

    def _point(self, local: Array) -> Array:
        return np.asarray((self.T_world_link @ np.array([*local, 1.0]))[:3])


def _between(share: float, low: float, high: float) -> float:
    return low + float(share) * (high - low)


GAPS_M = (0.004, 0.02, 0.04, 0.06)
"""Free fall that is accepted when the gripper opens, the smallest feasible one first."""

UPRIGHT_COSINE, LEANING_COSINE = 0.97, 0.80
"""How upright a thing has to be, and how far one that leans between the fingers may lean at release."""

HOLLOW = "hollow"
"""Name of the inside of bowls."""

FALLING_COSINE, FALLS_COST = 0.5, 0.3
FREE_PITCHES_DEG = (45.0, 60.0, 75.0, 30.0)
GAP_COST = 0.15  # For each higher fall: a plan with good joints may outweigh it.
OVER_RIM_M, MOST_FALL_M = 0.006, 0.095
"""How far above the rim of what is too narrow for the open hand a finger stays, and how far a thing may fall then."""


def release_gaps_m(hand: HandShape, asset: Asset, region: Region) -> tuple[float, ...]:
    """Return the free falls that are accepted in a region, the preferred one first.

    What is narrower than the open hand, such as a mug, has things dropped into it from above its rim too.

    Args:
        hand: Lengths of the hand.
        asset: What is let go of.
        region: Where.
    """
    spread_m = hand.opening_m + 2 * hand.finger_thick_m
    narrow = region.name == HOLLOW and 2 * min(region.half_extents_m[:2]) < spread_m
    over_m = region.height_m + OVER_RIM_M + hand.finger_half_m - asset.extent_m[2] / 2
    return (*GAPS_M, over_m) if narrow and GAPS_M[-1] < over_m <= MOST_FALL_M else GAPS_M


def upright_pitch(carried: Carried, *, flip: bool) -> float:
    """Return the hand's pitch [rad] at which the held thing stands as upright as its tilt between the fingers allows.

    Things turn about the fingers' closing axis when they are grasped, so the pitch of the grasp need not be it.
    """
    x, _, z = carried.T_eef_object[:3, 2]
    return float(np.arctan2(-z, x if flip else -x))


def leaning_rad(asset: Asset, carried: Carried) -> float:
    """Return the tilt [rad] of a held thing to the side between the fingers, which no pitch of the hand corrects."""
    x, _, z = carried.T_eef_object[:3, 2]
    return 0.0 if rolls_freely(asset) or is_held_at_rim(asset, carried) else float(np.arccos(min(np.hypot(x, z), 1.0)))


def rim_placement_goals(asset: Asset, spot: PlacementSpot, gap_m: float, carried: Carried) -> list[HandGoal]:
    """Return hand poses that hold a thing by its wall upright over a spot, its near side towards the hand's heading.

    Args:
        spot: Where it is to be.
        gap_m: How far above its place it is let go.
        carried: How it is held.
    """
    T_object_eef = inverse(carried.T_eef_object)
    middle = np.zeros(3) if asset.rim is None else np.array(asset.rim.center_m)
    inward = heading_of_hand(T_object_eef, middle)
    centre = spot.point_m + np.array([0.0, 0.0, asset.extent_m[2] / 2 + gap_m])
    goals = []
    for turn, yaw in enumerate(spot.headings_rad):
        goals.append(HandGoal(transform(rotation_z(yaw - inward), centre) @ T_object_eef, yaw, spot.cost + 0.01 * turn))
    return goals


def hand_goals(
    asset: Asset, spot: PlacementSpot, gap_m: float, carried: Carried, pitch_rad: float, region: Region
) -> list[HandGoal]:
    """Return hand poses that hold the thing upright over a spot; over a hollow also tilted, since it lies there as it
    falls.

    Args:
        spot: Where it is to be.
        gap_m: How far above its place it is let go.
        carried: How it is held.
        pitch_rad: The hand's present pitch.
        region: The region that the spot is in.
    """
    if is_held_at_rim(asset, carried):
        return rim_placement_goals(asset, spot, gap_m, carried)
    free = rolls_freely(asset)
    x, _, z = carried.T_eef_object[:3, 2]
    # What leans to the side between the fingers cannot be set upright by them; a little is set down all the same.
    upright = max(min(UPRIGHT_COSINE, float(np.hypot(x, z)) - 0.01), LEANING_COSINE)
    low = is_low(asset)
    goals = []
    for turn, yaw in enumerate(spot.headings_rad):
        for flip in (False, True):
            pitches = [pitch_rad] if free else [upright_pitch(carried, flip=flip)]
            if free or (low and region.name == HOLLOW and not carried.cargo):
                pitches += [np.deg2rad(p) for p in FREE_PITCHES_DEG]
            for rank, pitch in enumerate(pitches):
                R = hand_rotation(yaw, pitch, flip=flip)
                cosine = float((R @ carried.T_eef_object[:3, :3])[2, 2])
                falls = low and region.name == HOLLOW and rank > 0
                if not free and cosine < (FALLING_COSINE if falls else upright):
                    continue
                above_m = (max(asset.extent_m) if falls else asset.extent_m[2]) / 2 + gap_m
                centre = spot.point_m + np.array([0.0, 0.0, above_m])
                offset = R @ carried.T_eef_object[:3, 3]
                cost = spot.cost + 0.02 * rank + 0.01 * turn + (FALLS_COST if falls else 0.0)
                goals.append(HandGoal(transform(R, centre - offset), yaw, cost))
    return goals


def is_low(asset: Asset) -> bool:
    """Return whether a thing is lower than it is wide, so that it does not stand on its edge."""
    return asset.extent_m[2] < min(asset.extent_m[:2])


def placement_goals(
    world: World,
    carried: Carried,
    support: str,
    regions: Iterable[Region],
    here: Array,
    pitch_rad: float,
    *,
    seed: int,
    forecast: bool = False,
    slid: Array | None = None,
    to_come_m: float = 0.0,
) -> list[HandGoal]:
    """Return the hand poses that hold a thing over the free spots of a support's regions.

    Args:
        carried: What is held, and how.
        support: Id of what it is put on or in.
        regions: The support's regions in question.
        here: (3,) or longer: where the base stands.
        pitch_rad: The hand's pitch now.
        seed: Of the episode: spots are sampled from it.
        forecast: Whether one fall is enough for each region: the highest into what is open at the top, else the lowest.
        slid: (4, 4) by what the regions will have moved until then, in the world.
        to_come_m: Width of the widest thing that is put there later; 0 where nothing is.
    """
    asset, own = world.assets[carried.object_id], (*carried.ids, support)
    loose = world.assets if support == FLOOR else world.dynamic_ids
    others = {name: Footprint.around(*box_around(world, name)) for name in loose if name not in own}
    found = []
    for region in regions:
        T_link = world.T_world_link(support, region.link)
        width_m, height_m = max(asset.extent_m[:2]), asset.extent_m[2]
        T_link = T_link if slid is None else slid @ T_link
        rng = spot_rng(seed, carried.object_id, support, region.name)
        for spot in spots(
            region,
            T_link,
            width_m,
            here,
            height_m=height_m,
            others=others,
            rng=rng,
            to_come_m=to_come_m,
            heaps=not world.model.keeps_order,
            is_round=not world.model.keeps_order and support in loose and world.assets[support].symmetric_about_z,
        ):
            gaps_m = release_gaps_m(world.model.hand, asset, region)
            if not region.opens_upward and not world.model.keeps_order:
                # From higher up it would be in the board above, wherever the robot stands.
                gaps_m = tuple(gap_m for gap_m in gaps_m if height_m + gap_m <= 2 * region.half_extents_m[2])
            if forecast:
                gaps_m = gaps_m[-1:] if region.opens_upward else gaps_m[:1]
            for rank, gap_m in enumerate(gaps_m):
                goals = hand_goals(asset, spot, gap_m, carried, pitch_rad, region)
                found += [replace(goal, cost=goal.cost + GAP_COST * rank, region=region.name) for goal in goals]
    return found
