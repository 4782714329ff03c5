"""Holding hollow things by their wall, one finger inside and one outside: what is too wide to be closed around."""

from __future__ import annotations

import itertools

import numpy as np

from executor.assets.model import Asset, Rim
from executor.geometry import Array, heading_of, inverse, rotation_z, transform
from executor.motion.grasping.grasps import FINGERTIP_M
from executor.motion.planning.oracle import Carried
from executor.motion.stances.candidates import HandGoal
from executor.motion.stances.spots import Spot
from executor.robot.description import GRIPPER_OPENING_M

GRIP_DEPTHS_M, DEPTH_COST = (0.016, 0.010), 0.1
"""From the wall's upper edge down along it to between the fingertips: the deeper, the less a heavy thing turns."""

LEANS_RAD, LEAN_COST = (0.0, 0.6, -0.6), 0.1
"""How far the hand leans over along the rim: where straight down is out of reach."""

LEVEL_SHARE = 0.3
FINGER_THICK_M = 0.012
UPRIGHT_COSINE = 0.95
AT_WALL_M = 0.006
"""How near to the wall's middle the fingertips' middle is when they hold it."""

ACROSS_COSINE = 0.8
"""And how squarely they close on it; what is held around all of it is closed on along it there."""


def rim_goals(asset: Asset, T_world_object: Array) -> list[HandGoal]:
    """Returns hand poses that close on each flat piece of an upright thing's wall, coming down along it from outside.

    Args:
        asset: The thing; without a rim there are none.
        T_world_object: (4, 4) where it stands; there are none where it lies.
    """
    if asset.rim is None or T_world_object[2, 2] < UPRIGHT_COSINE:
        return []
    goals = []
    middle = (T_world_object @ np.array([*asset.rim.center_m, 1.0]))[:3]
    sides, depths = range(asset.rim.sides), enumerate(GRIP_DEPTHS_M)
    for side, (rank, depth_m), lean in itertools.product(sides, depths, LEANS_RAD):
        T = T_world_object @ _hand_at(asset.rim, 2.0 * np.pi * side / asset.rim.sides, depth_m, lean)
        cost = DEPTH_COST * rank + (LEAN_COST if lean else 0.0)
        goals.append(HandGoal(T, _heading(T, middle), cost))
    return goals


def is_held_at_rim(asset: Asset, carried: Carried) -> bool:
    """Decides whether a held thing has its wall between the fingers; else they are around all of it."""
    if asset.rim is None:
        return False
    rim, T_object_eef = asset.rim, inverse(carried.T_eef_object)
    hand, closing = T_object_eef[:3, 3] - np.array(rim.center_m), T_object_eef[:3, 1]
    outward = np.array([*hand[:2], 0.0]) / max(float(np.hypot(*hand[:2])), 1e-9)
    cosine, sine = float(np.cos(rim.slope_rad)), float(np.sin(rim.slope_rad))
    across = cosine * outward - np.array([0.0, 0.0, sine])
    beyond_m = float(across @ (hand - rim.radius_m * outward))
    return abs(beyond_m) < AT_WALL_M and abs(float(across @ closing)) > ACROSS_COSINE


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
    inward = _heading(T_object_eef, middle)
    centre = spot.point_m + np.array([0.0, 0.0, asset.extent_m[2] / 2 + gap_m])
    goals = []
    for turn, yaw in enumerate(spot.headings_rad):
        goals.append(HandGoal(transform(rotation_z(yaw - inward), centre) @ T_object_eef, yaw, spot.cost + 0.01 * turn))
    return goals


def room_below_m(asset: Asset) -> tuple[float, float]:
    """Returns how high the held piece of a wall is above what the thing stands on, and how high it would have to be.

    The outer finger of the open hand is as far below it as the wall leans over that finger.

    Raises:
        ValueError: The thing has no rim.
    """
    if asset.rim is None:
        raise ValueError(f"a {asset.category} has no rim")
    slope = asset.rim.slope_rad
    held_m = asset.rim.center_m[2] - GRIP_DEPTHS_M[-1] * np.cos(slope) + asset.extent_m[2] / 2
    outwards_m = GRIPPER_OPENING_M / 2 + FINGER_THICK_M
    return float(held_m), float(outwards_m * np.sin(slope) + FINGERTIP_M * np.cos(slope))


def _hand_at(rim: Rim, angle_rad: float, depth_m: float, lean_rad: float) -> Array:
    """Returns the (4, 4) hand pose in the thing's frame on the wall's piece that faces an angle."""
    outward = np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    cosine, sine = np.cos(rim.slope_rad), np.sin(rim.slope_rad)
    down_along, closing = -(cosine * up + sine * outward), cosine * outward - sine * up
    point = np.array(rim.center_m) + rim.radius_m * outward + depth_m * down_along
    approach = np.cos(lean_rad) * down_along + np.sin(lean_rad) * np.cross(closing, down_along)
    return transform(np.stack([np.cross(closing, approach), closing, approach], axis=1), point)


def _heading(T_eef: Array, middle_m: Array) -> float:
    """Returns from where a hand comes: along its approach, or where it comes straight down, towards the middle."""
    approach = T_eef[:3, 2]
    return heading_of(approach if np.hypot(*approach[:2]) > LEVEL_SHARE else middle_m - T_eef[:3, 3])
