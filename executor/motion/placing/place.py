"""How a thing is held over the spot where it is put: hand poses that keep it upright."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from executor.assets.footprint import Footprint
from executor.assets.model import Asset, Region
from executor.assets.transforms import rolls_freely
from executor.geometry import Array, hand_rotation, inverse, rotation_z, transform
from executor.motion.grasping.grasps import heading_of_hand, is_held_at_rim
from executor.motion.placing.spots import FLOOR, Spot, drawing, spots
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
    seed: int,
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
        seed: Of the episode: spots are drawn from it.
        gaps_m: How far above its place the thing may be let go, for a region.
        slid: (4, 4) by what the regions will have moved until then, in the world.
    """
    asset, own = world.assets[carried.object_id], (carried.object_id, support)
    loose = world.assets if support == FLOOR else world.dynamic_ids
    others = {name: Footprint.around(*box_around(world, name)) for name in loose if name not in own}
    found = []
    for region in regions:
        T_link = world.T_world_link(support, region.link)
        width_m, height_m = max(asset.extent_m[:2]), asset.extent_m[2]
        T_link = T_link if slid is None else slid @ T_link
        rng = drawing(seed, carried.object_id, support, region.name)
        for spot in spots(region, T_link, width_m, here, height_m=height_m, others=others, rng=rng):
            for rank, gap_m in enumerate(gaps_m(region)):
                goals = hand_goals(asset, spot, gap_m, carried, pitch_rad, region)
                found += [replace(goal, cost=goal.cost + GAP_COST * rank, region=region.name) for goal in goals]
    return found
