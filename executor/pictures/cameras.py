"""The paper's three cameras: one above the room, one on the robot's mast, one on its wrist.

Pure geometry, no simulator.

Source: the paper's appendix on the three camera views.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from executor.pictures.camera import Camera, look_at
from executor.pictures.overview import global_camera
from executor.robot.description import CAMERA_MOUNT_M, MAST_LINK
from oag import Scene, Task

VIEWS = ("global", "head", "wrist")


def cameras_for(
    scene: Scene, views: Iterable[str] = VIEWS, aspect: float = 1.0, *, task: Task | None = None
) -> tuple[Camera, ...]:
    """Returns the cameras of a scene, in the order of `views`.

    Args:
        scene: The concrete scene; the global camera is placed for it.
        views: Names out of `VIEWS`.
        aspect: Width of the pictures over their height.
        task: What the global camera is to show; by default the whole scene.

    Raises:
        ValueError: When a view is not one of `VIEWS`.
    """
    makers = {"global": lambda: global_camera(scene, aspect, task), "head": head_camera, "wrist": wrist_camera}
    views = tuple(views)
    for view in views:
        if view not in makers:
            raise ValueError(f"there is no view {view!r}; the views are {', '.join(VIEWS)}")
    return tuple(makers[view]() for view in views)


def head_camera() -> Camera:
    """Returns the camera on the robot's mast, which looks forward and down past the arm at the arm's workspace."""
    pose = look_at(CAMERA_MOUNT_M, [0.55, -0.04, 0.62])
    return Camera("head", MAST_LINK, pose, fov_y_rad=math.radians(68.0))


def wrist_camera() -> Camera:
    """Returns the camera on the hand, which looks along the approach axis between the fingers."""
    pose = look_at([0.075, 0.0, 0.012], [0.0, 0.0, 0.15], up=[1.0, 0.0, 0.0])
    return Camera("wrist", "panda_hand", pose, fov_y_rad=math.radians(72.0), near_m=0.01)
