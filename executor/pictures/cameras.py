"""What a camera is, and the two that the robot carries: one on its mast, one on its wrist.

Pure geometry, no simulator. A camera's frame is SAPIEN's: x looks forward, y to the left, z up.

Source: the paper's appendix on its three camera views; the third is `executor.pictures.overview`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from executor.geometry import Array, transform
from executor.robot.description import CAMERA_MOUNT_M, MAST_LINK

VIEWS = ("global", "head", "wrist")


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


def intrinsic_matrix(camera: Camera, size: tuple[int, int]) -> Array:
    """Return a camera's (3, 3) matrix [pixels] in pictures of a width and height; the middle is half of these."""
    width, height = size
    focal = height / 2.0 / math.tan(camera.fov_y_rad / 2.0)
    return np.array([[focal, 0.0, width / 2.0], [0.0, focal, height / 2.0], [0.0, 0.0, 1.0]])


def camera_json(camera: Camera, size: tuple[int, int]) -> dict[str, Any]:
    """Return what data sets say of a camera, for pictures of a width and height."""
    return {
        "size": list(size),
        "fov_y_rad": camera.fov_y_rad,
        "intrinsics": intrinsic_matrix(camera, size),
        "mount": camera.mount,
        "T_mount_camera": camera.T_mount_camera,
        "near_m": camera.near_m,
        "far_m": camera.far_m,
    }


def look_at(position_m: ArrayLike, target_m: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
    """Returns the (4, 4) pose of a camera at a position (3,) that looks at a target (3,)."""
    position = np.asarray(position_m, dtype=float)
    forward = np.asarray(target_m, dtype=float) - position
    forward /= np.linalg.norm(forward)
    left = np.cross(np.asarray(up, dtype=float), forward)
    left /= np.linalg.norm(left)
    return transform(np.stack([forward, left, np.cross(forward, left)], axis=1), position)


def head_camera() -> Camera:
    """Returns the camera on the robot's mast, which looks forward and down past the arm at the arm's workspace."""
    pose = look_at(CAMERA_MOUNT_M, [0.55, -0.04, 0.62])
    return Camera("head", MAST_LINK, pose, fov_y_rad=math.radians(68.0))


def wrist_camera() -> Camera:
    """Returns the camera on the hand, which looks along the approach axis between the fingers.

    It has no body. It sits 23 mm beside the hand and as far back, where the hand and what it holds keep things away.
    """
    pose = look_at([0.045, 0.0, 0.0], [0.015, 0.0, 0.15], up=[1.0, 0.0, 0.0])
    return Camera("wrist", "panda_hand", pose, fov_y_rad=math.radians(72.0), near_m=0.01)
