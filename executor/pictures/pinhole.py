"""A pinhole camera: where it is mounted, how it is aimed, and how points project into its picture.

Pure geometry, no simulator. A camera's frame is SAPIEN's: x looks forward, y to the left, z up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from executor.geometry import Array, transform


@dataclass(frozen=True, slots=True)
class Camera:
    """One pinhole camera.

    Attributes:
        name: "global", "head" or "wrist".
        mount: Robot link that carries it, or None for a camera that stands still in the world.
        T_mount_camera: (4, 4) pose in the mount's frame (in the world where there is no mount).
        fov_y_rad: Vertical opening angle.
        near_m, far_m: Clipping distances.
    """

    name: str
    mount: str | None
    T_mount_camera: Array
    fov_y_rad: float
    near_m: float = 0.02
    far_m: float = 25.0


def look_at(position_m: ArrayLike, target_m: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
    """Returns the (4, 4) pose of a camera at a position (3,) that looks at a target (3,)."""
    position = np.asarray(position_m, dtype=float)
    forward = np.asarray(target_m, dtype=float) - position
    forward /= np.linalg.norm(forward)
    left = np.cross(np.asarray(up, dtype=float), forward)
    left /= np.linalg.norm(left)
    return transform(np.stack([forward, left, np.cross(forward, left)], axis=1), position)


def project(camera: Camera, T_world_mount: Array, points_m: ArrayLike, size: tuple[int, int]) -> Array:
    """Returns (N, 3): column and row in pixels, and the distance along the viewing axis in metres.

    Args:
        camera: The camera.
        T_world_mount: (4, 4) pose of its mount; the identity for one without a mount.
        points_m: (N, 3) world points.
        size: Width and height of the picture.
    """
    width, height = size
    T = T_world_mount @ camera.T_mount_camera
    local = (np.asarray(points_m, dtype=float) - T[:3, 3]) @ T[:3, :3]
    focal = height / 2 / math.tan(camera.fov_y_rad / 2)
    depth = local[:, 0]
    safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
    return np.stack([width / 2 - focal * local[:, 1] / safe, height / 2 - focal * local[:, 2] / safe, depth], axis=1)
