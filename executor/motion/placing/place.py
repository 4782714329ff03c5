"""Where in a region a thing can be put, and how it is held over it: free spots, and hand poses that keep it upright."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from executor.assets.model import Asset, Region
from executor.geometry import Array, hand_rotation, heading_of, inverse, rotation_z, transform
from executor.motion.grasping.grasps import heading_of_hand, is_held_at_rim
from executor.motion.planning.candidates import HandGoal
from executor.motion.planning.oracle import Carried
from executor.world.detectors import box_around
from executor.world.world import World

GAPS_M = (0.004, 0.02, 0.04, 0.06)
"""Free fall that is accepted when the gripper opens, the smallest feasible one first."""

UPRIGHT_COSINE, LEANING_COSINE = 0.97, 0.80
"""How upright a thing has to be, and how far one that leans between the fingers may lean when it is let go of."""

HOLLOW = "hollow"
"""What bowls call their inside."""

FALLING_COSINE, FALLS_COST = 0.5, 0.3
FREE_PITCHES_DEG = (45.0, 60.0, 75.0, 30.0)
GAP_COST = 0.15  # For each higher fall: a plan with good joints may outweigh it.
DEPTHS_M = (0.16, 0.21, 0.12, 0.27)  # Behind a front, the most comfortable first.
LATERALS_M = (0.0, 0.07, -0.07, 0.13, -0.13, 0.20, -0.20)  # Beside the middle of a compartment, the middle first.
EDGE_INSETS_M = (0.13, 0.20, 0.09)  # From a table's edge: a thing is safe there and in reach.
ALONG_EDGE = (0.5, 0.35, 0.65, 0.2, 0.8)  # Of an edge's length, the middle first.
SMALL_M = 0.12  # A region that is smaller has one spot, its middle.
FLOOR = "floor"
"""What the floor calls its place: it is everywhere, so spots are around the robot and not along its edges."""

FLOOR_RINGS_M = (0.55, 0.75, 1.0)  # Off the base, which is 0.26 m wide, and near enough to need little driving.
FLOOR_SPOTS = 12  # A ring, every 30 degrees.
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
    if region.name == FLOOR:
        return _around_the_robot(T_world_link, half, floor, footprint_m, here)
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


def _around_the_robot(T_world_link: Array, half: Array, floor: Array, footprint_m: float, here: Array) -> list[Spot]:
    """Spots on rings around where the robot stands, as far as the floor goes, the hand coming from there."""
    found = []
    for (rank, ring_m), k in itertools.product(enumerate(FLOOR_RINGS_M), range(FLOOR_SPOTS)):
        heading = 2 * np.pi * k / FLOOR_SPOTS
        point = np.array([here[0] + ring_m * np.cos(heading), here[1] + ring_m * np.sin(heading), 0.0])
        local = (inverse(T_world_link) @ np.array([*point, 1.0]))[:3]
        if (np.abs(local - floor)[:2] <= half[:2] - footprint_m / 2).all():
            point[2] = _point(T_world_link, floor)[2]
            headings = tuple(heading + offset for offset in HEADING_OFFSETS_RAD)
            found.append(Spot(point, headings, 0.05 * rank))
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


def rolls_freely(asset: Asset) -> bool:
    """Decides whether a thing has no upright: all that collides is a sphere."""
    return all(shape.kind == "sphere" for link in asset.links for shape in link.shapes if shape.collides)


def upright_pitch(carried: Carried, *, flip: bool) -> float:
    """Returns the hand's pitch in rad at which what it holds stands as upright as its tilt between the fingers lets it.

    Things turn about the fingers' closing axis when they are taken hold of, so the pitch of the grasp need not be it.
    """
    x, _, z = carried.T_eef_object[:3, 2]
    return float(np.arctan2(-z, x if flip else -x))


def leaning_rad(asset: Asset, carried: Carried) -> float:
    """Returns how far a held thing leans to the side between the fingers, which no tilt of the hand sets upright."""
    x, _, z = carried.T_eef_object[:3, 2]
    return 0.0 if rolls_freely(asset) or is_held_at_rim(asset, carried) else float(np.arccos(min(np.hypot(x, z), 1.0)))


def rim_put_goals(asset: Asset, spot: Spot, gap_m: float, carried: Carried) -> list[HandGoal]:
    """Returns hand poses that hold a thing by its wall upright over a spot, its near side towards where they come from.

    Args:
        asset: The thing.
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
    asset: Asset, spot: Spot, gap_m: float, carried: Carried, pitch_rad: float, region: Region
) -> list[HandGoal]:
    """Returns hand poses that hold the thing upright over a spot; leaning too over a hollow, where it lies as it falls.

    Args:
        asset: The thing.
        spot: Where it is to be.
        gap_m: How far above its place it is let go.
        carried: How it is held.
        pitch_rad: The hand's present pitch.
        region: The region that the spot is in.
    """
    if is_held_at_rim(asset, carried):
        return rim_put_goals(asset, spot, gap_m, carried)
    free = rolls_freely(asset)
    x, _, z = carried.T_eef_object[:3, 2]
    # What leans to the side between the fingers cannot be set upright by them; a little is set down all the same.
    upright = max(min(UPRIGHT_COSINE, float(np.hypot(x, z)) - 0.01), LEANING_COSINE)
    low = is_low(asset)
    goals = []
    for turn, yaw in enumerate(spot.headings_rad):
        for flip in (False, True):
            pitches = [pitch_rad] if free else [upright_pitch(carried, flip=flip)]
            if free or (low and region.name == HOLLOW):
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
    """Decides whether a thing is lower than it is wide, so that it does not stand on its edge."""
    return asset.extent_m[2] < min(asset.extent_m[:2])


def hands_over(
    world: World,
    carried: Carried,
    support: str,
    regions: Iterable[Region],
    here: Array,
    pitch_rad: float,
    *,
    gaps_m: Callable[[Region], tuple[float, ...]] = lambda _: GAPS_M,
    slid: Array | None = None,
) -> list[HandGoal]:
    """Returns the hand poses that hold a thing over the free spots of a support's regions.

    Args:
        world: Where things are.
        carried: What is held, and how.
        support: Id of what it is put on or in.
        regions: The support's regions in question.
        here: (3,) or longer: where the base stands.
        pitch_rad: The hand's pitch now.
        gaps_m: How far above its place the thing may be let go, for a region.
        slid: (4, 4) by what the regions will have moved until then, in the world.
    """
    asset, own = world.assets[carried.object_id], (carried.object_id, support)
    obstacles = [Obstacle(*box_around(world, other)) for other in world.dynamic_ids if other not in own]
    if support == FLOOR:
        obstacles = [Obstacle(*box_around(world, other)) for other in world.assets if other not in own]
    found = []
    for region in regions:
        T_link = world.T_world_link(support, region.link)
        width_m, height_m = max(asset.extent_m[:2]), asset.extent_m[2]
        T_link = T_link if slid is None else slid @ T_link
        for spot in spots(region, T_link, width_m, here, height_m=height_m, obstacles=obstacles):
            for rank, gap_m in enumerate(gaps_m(region)):
                goals = hand_goals(asset, spot, gap_m, carried, pitch_rad, region)
                found += [replace(goal, cost=goal.cost + GAP_COST * rank, region=region.name) for goal in goals]
    return found
