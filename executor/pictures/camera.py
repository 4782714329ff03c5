"""One pinhole camera, and a pose that looks at something.

Pure geometry, no simulator. A camera's frame is SAPIEN's: x looks forward, y to the left, z up.
"""

from __future__ import annotations

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
