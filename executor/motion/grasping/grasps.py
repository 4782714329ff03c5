"""Hand poses that can hold a thing: along a handle's bar, or around an item from several headings."""

from __future__ import annotations

import numpy as np

from executor.assets.model import Asset, Handle
from executor.assets.transforms import bounds
from executor.geometry import Array, hand_rotation, heading_of, transform
from executor.motion.stances.candidates import HandGoal

HANDLE_PITCHES_DEG = (0.0, 20.0, -15.0)
TALL_PITCHES_DEG = (0.0, 15.0, 30.0)
FROM_ABOVE_DEG = (45.0, 60.0, 75.0)
LOW_PITCHES_DEG = (45.0, 60.0, 35.0, 75.0)
FLATTER_DEG, FLATTER_FROM_M = (25.0, 15.0), 0.04
"""On high tops, where steep hands do not reach, things of this height are taken nearly level."""
FLAT_PITCHES_DEG = (82.0, 75.0, 60.0, 45.0)
THIN_PITCHES_DEG = (88.0, 82.0, 75.0)
FLAT_M, THIN_M = 0.030, 0.008
"""What is lower is taken almost straight down; of what is lower still the tips hold only a few millimetres."""

ITEM_HEADINGS = 12
PITCH_COST = 0.02
THIN_PITCH_COST = 0.4
PALM_ROOM_M = 0.024
"""From the middle of the fingertips back to the palm, with two millimetres to spare."""
RAISED = 0.12
FINGERTIPS_M = 0.005
"""How far the hand may stay back and still close around the middle of what it takes."""

GRIP_DEPTH_M = 0.010
FROM_ABOVE_COST = 0.10
PALM_HALF_M = 0.023
FINGERTIP_M, FINGER_HALF_M = 0.007, 0.008
"""How far the fingers go on beyond the middle of their tips, and half their thickness."""

OFF_THE_SUPPORT_M, THIN_OFF_THE_SUPPORT_M = 0.002, 0.0016
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

    They come from all headings, or where the item says what the fingers can close along, from those across it. Steep
    hands take a tall item near its top, because its upper edge would meet the palm further down.

    Args:
        asset: The item; its frame is the centre of its bounding box.
        T_world_object: (4, 4) where it stands.
    """
    pitches_deg = _pitches_deg(asset)
    pitch_cost = THIN_PITCH_COST if asset.extent_m[2] < THIN_M else PITCH_COST
    goals = []
    for yaw in item_headings(asset, T_world_object[:3, :3]):
        for rank, pitch_deg in enumerate(pitches_deg):
            R = hand_rotation(yaw, np.deg2rad(pitch_deg))
            point = _hold_at(asset, T_world_object, R)
            if point is not None:
                cost = pitch_cost * rank + (FROM_ABOVE_COST if pitch_deg in FROM_ABOVE_DEG and is_tall(asset) else 0.0)
                goals.append(HandGoal(transform(R, point), yaw, cost))
    return goals


def _pitches_deg(asset: Asset) -> tuple[float, ...]:
    if is_tall(asset):
        return (*TALL_PITCHES_DEG, *FROM_ABOVE_DEG)
    height_m = asset.extent_m[2]
    if height_m < THIN_M:
        return THIN_PITCHES_DEG
    low_deg = FLAT_PITCHES_DEG if height_m < FLAT_M else LOW_PITCHES_DEG
    return (*low_deg, *FLATTER_DEG) if height_m >= FLATTER_FROM_M else low_deg


def _hold_at(asset: Asset, T_world_object: Array, R_world_hand: Array) -> Array | None:
    """Returns where between the fingertips the hand's middle comes to be, or None where the palm meets the item first.

    A little above the middle of a tall item is best: farther from the support, and the item hangs below the fingers.
    Where its upper edge would meet the palm, the hand takes it higher up; where its near side would, it stays back.
    """
    R = T_world_object[:3, :3]
    point = T_world_object[:3, 3] + R @ np.array(asset.grasp_point_m)
    approach = R_world_hand[:, 2]
    if not is_tall(asset):
        held = point - max(0.0, _depth_m(asset, T_world_object, point, R_world_hand) - PALM_ROOM_M) * approach
        # The tips of a hand that takes something flat stay off what it lies on.
        drop_m = FINGERTIP_M * -float(approach[2]) + FINGER_HALF_M * float(np.hypot(approach[0], approach[1]))
        off_m = THIN_OFF_THE_SUPPORT_M if asset.extent_m[2] < THIN_M else OFF_THE_SUPPORT_M
        lowest_m = T_world_object[2, 3] + bounds(asset, R)[0][2] + off_m + drop_m
        down_m = float(held[2]) - lowest_m
        # What is flat is held as low as that, where the palm stays off it: its side may be round further up.
        if asset.extent_m[2] < FLAT_M and _depth_m(asset, T_world_object, held, R_world_hand) + down_m <= PALM_ROOM_M:
            return np.asarray(held - np.array([0.0, 0.0, down_m]))
        return np.asarray(held - np.array([0.0, 0.0, min(0.0, down_m)]))
    pitch = float(np.arcsin(-approach[2]))
    point = point + np.array([0.0, 0.0, RAISED * asset.extent_m[2]])
    side_m = _depth_m(asset, T_world_object, point, hand_rotation(heading_of(approach), 0.0)) * float(np.cos(pitch))
    edge_m = float(T_world_object[2, 3] + bounds(asset, R)[1][2] - point[2])
    # What is above the palm's upper edge passes over it.
    met_m = min(edge_m, PALM_HALF_M / float(np.cos(pitch)))
    beyond_m = side_m + met_m * float(np.sin(pitch)) - PALM_ROOM_M
    if beyond_m <= FINGERTIPS_M or (not pitch and not asset.symmetric_about_z):
        return np.asarray(point - max(0.0, beyond_m) * approach)
    lower_edge_m = (PALM_ROOM_M + FINGERTIPS_M - side_m) / float(np.sin(pitch)) if pitch else 0.0
    if lower_edge_m < GRIP_DEPTH_M:
        return None
    return np.asarray(point + np.array([0.0, 0.0, edge_m - lower_edge_m]) - FINGERTIPS_M * approach)


def _depth_m(asset: Asset, T_world_object: Array, point: Array, R_world_hand: Array) -> float:
    """Returns how far the item reaches towards the hand from a point, along the hand's approach."""
    nearest, _ = bounds(asset, R_world_hand.T @ T_world_object[:3, :3])
    return float((R_world_hand.T @ (point - T_world_object[:3, 3]))[2] - nearest[2])


def item_headings(asset: Asset, R_world_object: Array) -> list[float]:
    """Headings of the hand; its fingers close across its heading."""
    level = [axis for axis in (R_world_object @ np.array(a) for a in asset.grasp_axes) if abs(axis[2]) < _LEVEL]
    if not level:
        return [2.0 * np.pi * k / ITEM_HEADINGS for k in range(ITEM_HEADINGS)]
    return [heading_of(axis) + side for axis in level for side in (np.pi / 2, -np.pi / 2)]
