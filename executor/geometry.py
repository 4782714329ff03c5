"""Rigid transforms as 4x4 arrays, hand orientations, and poses as position plus quaternion w x y z."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def transform(rotation: ArrayLike, position_m: ArrayLike) -> Array:
    """Return the (4, 4) transform with a (3, 3) rotation and a (3,) position."""
    T = np.eye(4)
    T[:3, :3] = rotation
    T[:3, 3] = position_m
    return T


def transform_from_quaternion(position_m: ArrayLike, quaternion_wxyz: ArrayLike) -> Array:
    """Return the (4, 4) transform of a position and a quaternion w x y z."""
    return transform(Rotation.from_quat(np.asarray(quaternion_wxyz), scalar_first=True).as_matrix(), position_m)


def quaternion_wxyz(T: Array) -> Array:
    """Return the (..., 4) unit quaternions w x y z of the rotations of (..., 4, 4) transforms."""
    return np.asarray(Rotation.from_matrix(T[..., :3, :3]).as_quat(scalar_first=True))


def pose_vector(T: Array) -> Array:
    """Return (..., 7): position and quaternion w x y z of (..., 4, 4) transforms, of many faster than one by one."""
    return np.concatenate([T[..., :3, 3], quaternion_wxyz(T)], axis=-1)


def quaternions_last(poses: NDArray) -> NDArray:
    """Return poses (..., 7) of position and quaternion w x y z with their quaternions as x y z w.

    Of the two equal quaternions the one with w >= 0 is chosen.
    """
    turns = np.where(poses[..., 3:4] < 0.0, -poses[..., 3:], poses[..., 3:])
    return np.concatenate([poses[..., :3], turns[..., 1:], turns[..., :1]], axis=-1)


def inverse(T: Array) -> Array:
    """Return the inverse of a rigid (4, 4) transform."""
    return transform(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])


def rotation_z(angle_rad: float) -> Array:
    """Return the (3, 3) rotation about the world's vertical."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def wrap_angle(angle_rad: float) -> float:
    """Return the angle [rad] in (-pi, pi]."""
    return float(-((-angle_rad + np.pi) % (2 * np.pi) - np.pi))


def nearest_turn(angle_rad: float, reference_rad: float) -> float:
    """Return the angle, shifted by whole turns, that lies nearest to the reference."""
    return reference_rad + wrap_angle(angle_rad - reference_rad)


def hand_rotation(yaw_rad: float, pitch_rad: float, *, flip: bool = False, upright: bool = False) -> Array:
    """Return the (3, 3) hand orientation that approaches along a heading, tilted down by a pitch.

    Args:
        yaw_rad: Heading of the approach direction in the world.
        pitch_rad: Downward tilt; 0 approaches horizontally, pi/2 straight down.
        flip: Turns the hand by half a turn about its approach axis (the same grasp with fingers exchanged).
        upright: Closes the fingers vertically (for horizontal bars) instead of horizontally.
    """
    return rotation_z(yaw_rad) @ _tilted(float(pitch_rad), flip, upright)


# A search asks for thousands of headings and a few tilts; a cross product of two vectors costs 60 microseconds.
@lru_cache(maxsize=256)
def _tilted(pitch_rad: float, flip: bool, upright: bool) -> Array:
    approach = np.array([np.cos(pitch_rad), 0.0, -np.sin(pitch_rad)])
    closing = np.array([0.0, 1.0, 0.0])
    if upright:
        closing = np.cross(approach, closing)
    if flip:
        closing = -closing
    return np.stack([np.cross(closing, approach), closing, approach], axis=1)


def pitch_of(T_world_eef: Array) -> float:
    """Return the downward tilt [rad] of a hand pose's approach axis."""
    return float(np.arcsin(np.clip(-T_world_eef[2, 2], -1.0, 1.0)))


def heading_of(direction: ArrayLike) -> float:
    """Return the yaw [rad] of a direction's horizontal part."""
    d = np.asarray(direction, dtype=float)
    return float(np.arctan2(d[1], d[0]))


def interpolate_poses(T_start: Array, T_end: Array, step_m: float = 0.01, step_rad: float = 0.05) -> list[Array]:
    """Return poses along the straight line and shortest rotation; the end is included, the start is not."""
    offset = T_end[:3, 3] - T_start[:3, 3]
    turn = Rotation.from_matrix(T_end[:3, :3] @ T_start[:3, :3].T).as_rotvec()
    count = max(int(np.ceil(max(np.linalg.norm(offset) / step_m, np.linalg.norm(turn) / step_rad))), 1)
    fractions = np.arange(1, count + 1) / count
    rotations = Rotation.from_rotvec(np.outer(fractions, turn)).as_matrix() @ T_start[:3, :3]
    return [transform(R, T_start[:3, 3] + f * offset) for f, R in zip(fractions, rotations, strict=True)]
