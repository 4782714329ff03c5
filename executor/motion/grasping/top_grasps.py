"""Hand poses near the top of tall things that are not round, such as a mug whose ear points at the hand.

The box around such a thing reaches farther towards the hand than its upper part does. A hand that stays as far back as
the box asks for holds nothing, though the palm would pass above the ear; whether it does, the collision oracle knows.
"""

from __future__ import annotations

import itertools

import numpy as np

from executor.assets.model import Asset
from executor.geometry import Array, hand_rotation, transform
from executor.motion.grasping.grasps import (
    FROM_ABOVE_COST,
    FROM_ABOVE_DEG,
    GRIP_DEPTH_M,
    PITCH_COST,
    TALL_PITCHES_DEG,
    is_tall,
    item_headings,
)
from executor.motion.stances.candidates import HandGoal

PITCHES_DEG = (*TALL_PITCHES_DEG[1:], *FROM_ABOVE_DEG)
BELOW_TOP_M = (0.022, 0.016, GRIP_DEPTH_M)
"""How far below the top the fingers' middle is, the deepest hold first."""

BACK_M = (0.0, 0.005)
"""How far the hand stays back from the thing's middle."""

SHALLOW_COST = 0.03


def top_goals(asset: Asset, T_world_object: Array) -> list[HandGoal]:
    """Returns hand poses that close around the upper part of an item, whose palm may or may not have room.

    Args:
        asset: The item; its frame is the centre of its bounding box.
        T_world_object: (4, 4) where it stands.

    Returns:
        None at all for what is low, round, or does not stand upright: `item_goals` has all that it can be held at.
    """
    R = T_world_object[:3, :3]
    if asset.symmetric_about_z or not is_tall(asset) or R[2, 2] < np.cos(np.deg2rad(5.0)):
        return []
    top_m = T_world_object[2, 3] + asset.extent_m[2] / 2
    point = T_world_object[:3, 3] + R @ np.array(asset.grasp_point_m)
    goals = []
    ways = itertools.product(enumerate(PITCHES_DEG), enumerate(BELOW_TOP_M), BACK_M)
    for yaw, ((rank, pitch_deg), (shallow, below_m), back_m) in itertools.product(item_headings(asset, R), ways):
        hand = hand_rotation(yaw, np.deg2rad(pitch_deg))
        at = np.array([point[0], point[1], top_m - below_m]) - back_m * hand[:, 2]
        cost = PITCH_COST * rank + SHALLOW_COST * shallow + (FROM_ABOVE_COST if pitch_deg in FROM_ABOVE_DEG else 0.0)
        goals.append(HandGoal(transform(hand, at), yaw, cost))
    return goals
