"""Hand poses that can hold a thing: along a handle's bar, or around an item from several headings."""

from __future__ import annotations

import numpy as np

from executor.assets.bounds import bounds
from executor.assets.model import Asset, Handle
from executor.geometry import Array, hand_rotation, heading_of, transform
from executor.motion.candidates import HandGoal

HANDLE_PITCHES_DEG = (0.0, 20.0, -15.0)
TALL_PITCHES_DEG = (0.0, 15.0, 30.0)
LOW_PITCHES_DEG = (45.0, 60.0, 35.0, 75.0)
ITEM_HEADINGS = 12
PITCH_COST = 0.02
PALM_ROOM_M = 0.025
"""From the middle of the fingertips back to the palm, with a millimetre to spare."""
_LEVEL = 0.3


def handle_goals(handle: Handle, T_world_link: Array) -> list[HandGoal]:
    """Returns hand poses that close on a handle's bar at several heights and tilts.

    Args:
        handle: The bar, in its link's frame.
        T_world_link: (4, 4) where the link is now.
    """
    centre = (T_world_link @ np.array([*handle.position_m, 1.0]))[:3]
    axis = T_world_link[:3, :3] @ np.array(handle.axis)
    yaw = heading_of(-(T_world_link[:3, :3] @ np.array(handle.outward)))
    upright = abs(axis[2]) < 0.5
    room = max(handle.length_m / 2 - 0.05, 0.0)
    goals = []
    for along_m in (0.0, min(0.06, room), -min(0.06, room)):
        for rank, pitch_deg in enumerate(HANDLE_PITCHES_DEG):
            R = hand_rotation(yaw, np.deg2rad(pitch_deg), upright=upright)
            cost = PITCH_COST * rank + 0.1 * abs(along_m)
            goals.append(HandGoal(transform(R, centre + along_m * axis), yaw, cost))
    return goals


def is_tall(asset: Asset) -> bool:
    """Decides whether an item is grasped from the side: it is clearly taller than it is wide."""
    return asset.extent_m[2] > 1.2 * min(asset.extent_m[0], asset.extent_m[1])


def item_goals(asset: Asset, T_world_object: Array) -> list[HandGoal]:
    """Returns hand poses around an item: level ones for tall items, steep ones for low items.

    They come from all headings, or where the item says what the fingers can close along, from those across it.

    Args:
        asset: The item; its frame is the centre of its bounding box.
        T_world_object: (4, 4) where it stands.
    """
    centre = T_world_object[:3, 3] + T_world_object[:3, :3] @ np.array(asset.grasp_point_m)
    tall = is_tall(asset)
    # A little above the middle: farther from the support, and the item hangs below the fingers.
    point = centre + np.array([0.0, 0.0, 0.12 * asset.extent_m[2] if tall else 0.0])
    goals = []
    for yaw in _item_headings(asset, T_world_object[:3, :3]):
        for rank, pitch_deg in enumerate(TALL_PITCHES_DEG if tall else LOW_PITCHES_DEG):
            R = hand_rotation(yaw, np.deg2rad(pitch_deg))
            goals.append(
                HandGoal(transform(R, point - _back_off_m(asset, T_world_object, R) * R[:, 2]), yaw, PITCH_COST * rank)
            )
    return goals


def _back_off_m(asset: Asset, T_world_object: Array, R_world_hand: Array) -> float:
    """How far the hand stays back so that the near side of a deep item does not meet the palm."""
    if asset.symmetric_about_z and is_tall(asset):
        return 0.0
    R_hand_object = R_world_hand.T @ T_world_object[:3, :3]
    nearest, _ = bounds(asset, R_hand_object)
    depth_m = float((R_hand_object @ np.array(asset.grasp_point_m) - nearest)[2])
    return max(0.0, depth_m - PALM_ROOM_M)


def _item_headings(asset: Asset, R_world_object: Array) -> list[float]:
    """Headings of the hand; its fingers close across its heading."""
    level = [axis for axis in (R_world_object @ np.array(a) for a in asset.grasp_axes) if abs(axis[2]) < _LEVEL]
    if not level:
        return [2.0 * np.pi * k / ITEM_HEADINGS for k in range(ITEM_HEADINGS)]
    return [heading_of(axis) + side for axis in level for side in (np.pi / 2, -np.pi / 2)]
