"""The paper's three cameras: one above the room, one on the robot's head, one on its wrist.

Pure geometry, no simulator. A camera's frame is SAPIEN's: x looks forward, y to the left, z up. The camera above the
room stands near, with all that matters in its picture, and as little as can be hidden.

Source: the paper's appendix on the three camera views. Its global camera copies a photograph's pose; a scene that comes
without a photograph gets one that is computed here from the scene's bounding boxes.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from executor.assets.library import asset_for
from executor.geometry import Array, transform, transform_from_quaternion
from oag import Scene, SceneObject, Task
from oag.model.categories import Kind
from oag.model.scenefile import FLOOR

VIEWS = ("global", "head", "wrist")
HEAD_HEIGHT_M = 1.4
WALL = "wall"
"""Category of what need not be seen itself, and hides what is behind it."""

_UNSEEN = (WALL, FLOOR)

_FOV_RAD = math.radians(40.0)
_ELEVATION_DEG = (34.0, 42.0)
_AZIMUTHS = 24  # 15 degrees apart.
_MARGIN = 0.94  # Of the half picture: the rest is free.
_WORKING_ROOM_M = 0.75  # In front of doors and drawers.
_STANDING_ROOM_M = 0.6  # Beside an item.
_ARM_ROOM_M = 0.35  # Over an item.
_ROBOT_HEIGHT_M = 1.0
_ROBOT_RADIUS_M = 0.25

# What a direction is worth, beside 1 for a thing that is seen whole, and 3 for an item: the robot seen whole, its way
# seen from the side, and every metre nearer. Chosen by eye over a dozen rooms.
_ROBOT_WEIGHT = 3.0
_ASIDE_WEIGHT = 2.0
_FAR_WEIGHT_PER_M = 0.6


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
    """Returns the camera above the mobile base, which looks forward and down over the arm's workspace."""
    pose = look_at([-0.42, 0.10, HEAD_HEIGHT_M], [0.50, 0.0, 0.55])
    return Camera("head", "base_body", pose, fov_y_rad=math.radians(68.0))


def wrist_camera() -> Camera:
    """Returns the camera on the hand, which looks along the approach axis between the fingers."""
    pose = look_at([0.075, 0.0, 0.012], [0.0, 0.0, 0.15], up=[1.0, 0.0, 0.0])
    return Camera("wrist", "panda_hand", pose, fov_y_rad=math.radians(72.0), near_m=0.01)


def global_camera(scene: Scene, aspect: float = 1.0, task: Task | None = None) -> Camera:
    """Returns a still camera that sees what matters, the robot, and the room in front of doors and drawers.

    It stands above one of the sides, at the direction from which the fewest of the things that matter hide behind
    other things and doors show their fronts. What matters is every object, or those that a task is about: in a large
    home the rest would make them small. A plan without subtasks is about all of it.
    """
    about = None if task is None or not task.subtasks else _objects_of(task)
    points = interest_points(scene, about)
    # What is to be seen comes first, then what may hide it.
    objects = sorted(scene.objects.items(), key=lambda item: not _matters(item[0], item[1], about))
    things = [thing for name, thing in objects if _matters(name, thing, about)]
    boxes = [_box(thing) for _, thing in objects]
    best: tuple[float, Camera] | None = None
    for elevation in _ELEVATION_DEG:
        for k in range(_AZIMUTHS):
            azimuth = 2 * math.pi * (k + 0.5) / _AZIMUTHS
            camera = _framed(points, azimuth, math.radians(elevation), aspect)
            eye = camera.T_mount_camera[:3, 3]
            score = _score(scene, things, eye, boxes) + (0.0 if about is None else _from_aside(scene, things, eye))
            if best is None or score > best[0] + 1e-9:
                best = (score, camera)
    if best is None:
        raise ValueError("no direction to look from was tried")
    return best[1]


def interest_points(scene: Scene, about: Collection[str] | None = None) -> Array:
    """Returns (N, 3) world points that an overview must show: box corners, robot, room in front of fixtures.

    Args:
        scene: The scene.
        about: The objects that matter, with room for the robot beside items; by default all, without that.
    """
    parts = [_robot_corners(scene)]
    for name, thing in scene.objects.items():
        if not _matters(name, thing, about):
            continue
        T_world_box, half = _box(thing)
        parts.append(_corners(T_world_box, half))
        if thing.kind is Kind.ARTICULATED:
            room = np.array([-half[0] - _WORKING_ROOM_M, 0.0, -half[2]])
            parts.append((T_world_box[:3, :3] @ room + T_world_box[:3, 3])[None])
        elif about is not None and thing.kind is Kind.ITEM:
            # The robot stands on some side of it, and reaches over it.
            for height_m in (0.0, T_world_box[2, 3] + _ARM_ROOM_M):
                beside = _corners(T_world_box, half + [_STANDING_ROOM_M, _STANDING_ROOM_M, 0.0])
                beside[:, 2] = height_m
                parts.append(beside)
    return np.concatenate(parts)


def _robot_corners(scene: Scene) -> Array:
    """Returns the (8, 3) corners of a box around the robot where it begins."""
    offsets = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (0.0, 1.0)]
    robot = np.asarray(scene.robot.position, dtype=float)
    corners: Array = robot + np.array(offsets) * [_ROBOT_RADIUS_M, _ROBOT_RADIUS_M, _ROBOT_HEIGHT_M]
    return corners


def _objects_of(task: Task) -> frozenset[str]:
    """Returns the objects that a task's simple tasks are about."""
    roles = ((part.target, part.support_init, part.support_goal) for part in task.subtasks)
    return frozenset(name for names in roles for name in names if name is not None)


def _matters(name: str, thing: SceneObject, about: Collection[str] | None) -> bool:
    return thing.category not in _UNSEEN and (about is None or name in about)


def _framed(points: Array, azimuth_rad: float, elevation_rad: float, aspect: float) -> Camera:
    """Returns the nearest camera on a viewing direction that has all points in its picture, centred."""
    outward = np.array(
        [
            math.cos(azimuth_rad) * math.cos(elevation_rad),
            math.sin(azimuth_rad) * math.cos(elevation_rad),
            math.sin(elevation_rad),
        ]
    )
    R = look_at(outward, np.zeros(3))[:3, :3]
    along = points @ R
    slope_z = math.tan(_FOV_RAD / 2) * _MARGIN
    bounds = []
    for axis, slope in ((1, slope_z * aspect), (2, slope_z)):
        # A point is in the picture when |side - side_0| <= slope * (ahead - ahead_0), for both signs.
        low = float(np.max(along[:, axis] - slope * along[:, 0]))
        high = float(np.min(along[:, axis] + slope * along[:, 0]))
        bounds.append(((low + high) / 2, (high - low) / (2 * slope)))
    ahead = min(limit for _, limit in bounds)
    position = R @ np.array([ahead, bounds[0][0], bounds[1][0]])
    return Camera("global", None, transform(R, position), _FOV_RAD, near_m=0.05)


def _score(scene: Scene, things: list[SceneObject], eye: Array, boxes: list[tuple[Array, Array]]) -> float:
    """Returns how much of what matters a camera position sees; larger is better.

    Args:
        scene: The scene.
        things: What shall be seen.
        eye: (3,) the position.
        boxes: The boxes of `things`, then those of what may hide them.
    """
    score = 0.0
    for index, thing in enumerate(things):
        T, half = boxes[index]
        targets = _corners(T, half * 0.8)
        others = [box for k, box in enumerate(boxes) if k != index]
        seen = float(np.mean([not any(_blocks(eye, p, box) for box in others) for p in targets]))
        weight = 3.0 if thing.role == "B" else 1.0
        score += weight * seen
        if thing.kind is Kind.ARTICULATED:
            to_eye = eye - T[:3, 3]
            front = float(-T[:2, 0] @ to_eye[:2] / np.linalg.norm(to_eye[:2]))
            # Half from the side is best: straight from the front, the open door and the robot hide what is behind them.
            score += 2.0 - 3.0 * abs(front - 0.72) + _inside_view(thing, T, to_eye)
    shown = float(np.mean([not any(_blocks(eye, p, box) for box in boxes) for p in _robot_corners(scene)]))
    return score + _ROBOT_WEIGHT * shown


def _from_aside(scene: Scene, things: list[SceneObject], eye: Array) -> float:
    """Returns how near a camera position is, and how far to the side of the robot's way to what the task is about.

    Where doors and drawers are part of it, these alone say from which side to look.
    """
    robot = np.asarray(scene.robot.position, dtype=float)[:2]
    middle = np.mean([np.asarray(thing.position, dtype=float)[:2] for thing in things], axis=0)
    way, look = middle - robot, (middle + robot) / 2 - eye[:2]
    norm = float(np.linalg.norm(way) * np.linalg.norm(look))
    aside = abs(float(way[0] * look[1] - way[1] * look[0])) / max(norm, 1e-9)
    if any(thing.kind is Kind.ARTICULATED for thing in things):
        aside = 0.0
    return _ASIDE_WEIGHT * aside - _FAR_WEIGHT_PER_M * math.dist(eye, [*((middle + robot) / 2), 0.0])


def _inside_view(thing: SceneObject, T_world_box: Array, to_eye: Array) -> float:
    """Returns how far a direction lies on the handle's side, from where an opened door does not hide the inside."""
    asset = asset_for(thing)
    joints = {joint.name: joint for joint in asset.joints}
    total = 0.0
    for handle in asset.handles:
        if joints[handle.joint].kind == "revolute":
            sideways = T_world_box[:2, :2] @ np.array([0.0, handle.position_m[1]])
            norm = float(np.linalg.norm(sideways) * np.linalg.norm(to_eye[:2]))
            total += float(sideways @ to_eye[:2]) / max(norm, 1e-9)
    return total


def _blocks(eye: Array, point: Array, box: tuple[Array, Array]) -> bool:
    """Decides whether the segment from eye to point runs through a box."""
    T, half = box
    start = T[:3, :3].T @ (eye - T[:3, 3])
    ray = T[:3, :3].T @ (point - T[:3, 3]) - start
    ray = np.where(np.abs(ray) < 1e-12, 1e-12, ray)
    first, second = (-half - start) / ray, (half - start) / ray
    enter = float(np.minimum(first, second).max())
    leave = float(np.maximum(first, second).min())
    return enter < leave and leave > 0.0 and enter < 0.999


def _box(thing: SceneObject) -> tuple[Array, Array]:
    """Returns an object's bounding box: (4, 4) pose of its centre and (3,) half extents."""
    return transform_from_quaternion(thing.position, thing.orientation), np.asarray(thing.extent_m) / 2


def _corners(T_world_box: Array, half: Array) -> Array:
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return signs * half @ T_world_box[:3, :3].T + T_world_box[:3, 3]
