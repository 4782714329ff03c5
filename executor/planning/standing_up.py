"""Grasp poses at a thing that lies and is to be stood up: around it from above, the fingers across its axis.

The hand keeps hold of it until it stands, so a grasp has to suit both: a hand that comes straight down onto a lying
thing is level once the thing is upright, and one that leans towards its foot comes as much from above then. What only
its wall can be held at is not stood up: through its mouth no hand gets that close above what it lies on.
"""

from __future__ import annotations

import itertools

import numpy as np

from executor.assets.asset_geometry import bounds, stands_by_nature, width_at
from executor.assets.model import Asset
from executor.geometry import Array, hand_rotation, heading_of, transform
from executor.planning.grasps import (
    FINGERTIPS_M,
    GRIP_DEPTH_M,
    OFF_THE_SUPPORT_M,
    PITCH_COST,
)
from executor.planning.stances import HandGoal
from oag.model.robots import HandShape

LYING_COSINE = 0.5  # Of a thing's axis with the vertical: it lies within 30 degrees.
LEANS_DEG = (15.0, 30.0, 0.0, 45.0)
"""How far the hand leans towards the foot, the preferred one first: once the thing stands, it comes so from above."""

HELD_SHARES = (0.0, 0.12, 0.25)
"""Of its height, towards its top from its middle: where the thing is held."""

OFF_MIDDLE_COST = 5.0
"""For each metre: what is held off its middle hangs, and turns between the fingers as it is lifted. A full bottle that
was held 28 mm off it did so by 40 degrees."""

ANY_SIDE_DEG = 35.0  # A hand that leans less than this may have the arm on any side.
FLAT_SHARE = 0.95
"""What is as wide, by this share, where the hand holds it as at its middle has flat sides, and holds higher up too."""


def standing_up_goals(hand: HandShape, asset: Asset, T_world_object: Array) -> list[HandGoal]:
    """Return hand poses from above around a thing that lies, its axis across the fingers; none for what does not lie.

    Args:
        hand: Lengths of the hand.
        asset: The thing; its frame is the centre of its bounding box.
        T_world_object: (4, 4) where it lies.
    """
    if abs(T_world_object[2, 2]) > LYING_COSINE or not stands_by_nature(asset):
        return []
    R, height_m = T_world_object[:3, :3], asset.extent_m[2]
    middle = T_world_object[:3, 3] + R @ np.array(asset.grasp_point_m)
    ahead = heading_of(-R[:, 2])
    level = hand_rotation(ahead, np.pi / 2)
    (_, low_y, _), (_, high_y, _) = bounds(asset, level.T @ R)
    if high_y - low_y > hand.opening_m:
        return []
    low_m, high_m = (float(T_world_object[2, 3] + bound[2]) for bound in bounds(asset, R))
    goals = []
    for (rank, lean_deg), share in itertools.product(enumerate(LEANS_DEG), HELD_SHARES):
        lean = float(np.deg2rad(lean_deg))
        approach = hand_rotation(ahead, np.pi / 2 - lean)[:, 2]
        at = middle + share * height_m * R[:, 2]
        # The palm meets the side of the thing with its edge that is towards the thing's top, or the end of the top.
        side_m = high_m - float(at[2])
        met_m = min((0.5 - share) * height_m, (hand.palm_half_m + side_m * np.sin(lean)) / np.cos(lean))
        beyond_m = side_m * np.cos(lean) + met_m * np.sin(lean) - hand.palm_room_m
        point = at - max(0.0, beyond_m) * approach
        drop_m = hand.fingertip_m * float(np.cos(lean)) + hand.finger_half_m * float(np.sin(lean))
        point[2] = max(float(point[2]), low_m + OFF_THE_SUPPORT_M + drop_m)
        higher_m = float(point[2] - at[2])
        if higher_m > FINGERTIPS_M and not _is_flat(
            asset, level.T @ R, float(middle[2] - T_world_object[2, 3]), higher_m
        ):
            continue
        if high_m - (float(point[2]) - drop_m) < GRIP_DEPTH_M:
            continue
        cost = PITCH_COST * rank + OFF_MIDDLE_COST * share * height_m
        sides = (0.0, 0.5, -0.5, 1.0) if lean_deg < ANY_SIDE_DEG else (0.0,)
        T = transform(hand_rotation(ahead, np.pi / 2 - lean), point)
        goals += [HandGoal(T, ahead + side * np.pi, cost) for side in sides]
    return goals


def is_rolled_over(T_world_eef: Array, T_world_object: Array) -> bool:
    """Return whether a hand around a thing that lies is half a turn from how hands go about, once the thing stands.

    Few postures of an arm hold it so, and few ways lead into and out of them.
    """
    return bool(T_world_eef[:3, 0] @ T_world_object[:3, 2] > 0.0)


def _is_flat(asset: Asset, R_down_object: Array, middle_m: float, higher_m: float) -> bool:
    """Return whether a lying thing is as wide some way above its middle as there.

    Args:
        asset: The thing.
        R_down_object: (3, 3) its orientation in a frame whose y is across and whose z points down.
        middle_m: Height of what is held above the thing's frame.
        higher_m: How much higher.
    """
    above_m, there_m = (width_at(asset, R_down_object, -(middle_m + over_m)) for over_m in (higher_m, 0.0))
    return above_m >= FLAT_SHARE * there_m
