"""Where the camera above the room stands: near, with all that matters in its picture, and little of it hidden.

What matters are the objects, the items before all, also past a robot that takes them; the insides of what is opened,
with its doors open and a robot before it; and the robot. Directions all around are tried. From each the camera is
as near as the picture allows, never in a wall or a piece of furniture, and rays to what matters say how much of it is
seen past everything solid.

Source: the paper's global camera copies a photograph's pose; a scene that comes without a photograph gets one that is
computed here.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from executor.assets.library import asset_for
from executor.geometry import Array, transform, transform_from_quaternion
from executor.pictures.cameras import VIEWS, Camera, head_camera, look_at, wrist_camera
from executor.pictures.solids import Solids, joints_at_start, link_frames
from oag import Scene, SceneObject, Task
from oag.model.categories import Kind
from oag.model.scenefile import FLOOR

WALL = "wall"
"""Category of what need not be seen itself, and hides what is behind it."""

_UNSEEN = (WALL, FLOOR)

LENS_GAP_M = 0.15
"""No lens is nearer to anything solid: at 5 cm, where its picture begins, one piece would fill it."""

_FOV_RAD = math.radians(40.0)
_ELEVATION_DEG = (26.0, 34.0, 42.0, 54.0)
_AZIMUTHS = 24  # 15 degrees apart.
_MARGIN = 0.94  # Of the half picture: the rest is free.
_WORKING_ROOM_M = 0.75  # In front of doors and drawers.
_STANDING_ROOM_M = 0.6  # Beside an item.
_ARM_ROOM_M = 0.35  # Over an item.
_ROBOT_HEIGHT_M = 1.0  # The mast above that need not be seen.
_ROBOT_RADIUS_M = 0.25
_AT_WORK_M = 0.60  # How far before a front the middle of the robot's base is while it reaches in.
_AT_WORK_HALF_M = (0.16, 0.16, 0.42)  # Base and folded arm; what is above them is thin.
_BAR_M = 0.04  # From the middle of a handle's bar this far out nothing of it is left.
_OPENED = 0.8  # Of their range; doors are seldom opened wider.

# What is worth seeing, in shares of it that are seen; and every metre nearer. Chosen by eye over forty episodes.
_ITEM_WEIGHT = 4.0
_INSIDE_WEIGHT = 5.0
_FRONT_WEIGHT = 1.5
_THING_WEIGHT = 1.0
_ROBOT_WEIGHT = 2.0
_ASIDE_WEIGHT = 2.0
_FAR_WEIGHT_PER_M = 0.6


@dataclass(frozen=True, slots=True)
class _Sight:
    """Points (P, 3) that shall be seen, what may hide them, and what seeing all of them is worth."""

    points: Array
    solids: Solids
    weight: float


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


def global_camera(scene: Scene, aspect: float = 1.0, task: Task | None = None) -> Camera:
    """Returns a still camera that sees what matters, the robot, and into what has doors and drawers.

    What matters is every object, or those that a task is about: in a large home the rest would make them small. A plan
    without subtasks is about all of it.

    Args:
        scene: The concrete scene.
        aspect: Width of the pictures over their height.
        task: What it is to show.
    """
    about = None if task is None or not task.subtasks else _objects_of(task)
    points = interest_points(scene, about)
    sights = list(_sights(scene, task if about is not None else None))
    solids = (Solids.of(scene), Solids.of(scene, _all_open(scene)))
    best: tuple[tuple[bool, float], Camera] | None = None
    for elevation in _ELEVATION_DEG:
        for k in range(_AZIMUTHS):
            azimuth = 2 * math.pi * (k + 0.5) / _AZIMUTHS
            camera = _framed(points, azimuth, math.radians(elevation), aspect)
            eye = camera.T_mount_camera[:3, 3]
            clear = all(each.gap_m(eye) >= LENS_GAP_M for each in solids)
            score = sum(s.weight * float(np.mean(~s.solids.hidden(eye, s.points))) for s in sights)
            score += 0.0 if about is None else _from_aside(scene, about, eye)
            worth = (clear, round(score, 9))
            if best is None or worth > best[0]:
                best = (worth, camera)
    if best is None:
        raise ValueError("no direction to look from was tried")
    return best[1]


def stands_free(scene: Scene, eye: Array) -> bool:
    """Returns whether a lens at a place (3,) keeps clear of everything solid, doors shut and doors open."""
    return all(each.gap_m(eye) >= LENS_GAP_M for each in (Solids.of(scene), Solids.of(scene, _all_open(scene))))


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
            if about is not None:
                parts.append(_beside_handles(thing))
        elif about is not None and thing.kind is Kind.ITEM:
            # The robot stands on some side of it, and reaches over it.
            for height_m in (0.0, T_world_box[2, 3] + _ARM_ROOM_M):
                beside = _corners(T_world_box, half + [_STANDING_ROOM_M, _STANDING_ROOM_M, 0.0])
                beside[:, 2] = height_m
                parts.append(beside)
    return np.concatenate(parts)


def _beside_handles(thing: SceneObject) -> Array:
    """Returns (P, 3) points around a robot that holds a handle, its door or drawer open."""
    asset = asset_for(thing)
    T_world_root, _ = _box(thing)
    frames = link_frames(asset, [joint.position(_OPENED) for joint in asset.joints])
    parts = [np.empty((0, 3))]
    for handle in asset.handles:
        T_world_link = T_world_root @ frames[handle.link]
        before = np.add(handle.position_m, np.multiply(_AT_WORK_M + _ROBOT_RADIUS_M, handle.outward))
        foot = (T_world_link[:3, :3] @ before + T_world_link[:3, 3]) * [1.0, 1.0, 0.0]
        parts.append(foot + [[0.0, 0.0, 0.0], [0.0, 0.0, _ROBOT_HEIGHT_M]])
    return np.concatenate(parts)


def inside_points(scene: Scene, object_id: str, joint: str, position: float) -> Array:
    """Returns (P, 3) world points in what a door or drawer shuts, spread over its room; none where it shuts nothing.

    Args:
        scene: The concrete scene.
        object_id: What has the joint.
        joint: The joint.
        position: Where it stands (rad or m); what slides with it does.
    """
    thing = scene.objects[object_id]
    asset = asset_for(thing)
    frames = link_frames(asset, [position if each.name == joint else 0.0 for each in asset.joints])
    T_world_root, _ = _box(thing)
    signs = np.array([(x, y, z) for x in (-0.6, 0.0, 0.6) for y in (-0.6, 0.0, 0.6) for z in (-0.7, 0.0)])
    parts = [np.empty((0, 3))]
    for region in asset.regions:
        if region.kind == "interior" and region.joint == joint:
            T = T_world_root @ frames[region.link]
            points = np.asarray(region.center_m) + signs * np.asarray(region.half_extents_m)
            parts.append(points @ T[:3, :3].T + T[:3, 3])
    return np.concatenate(parts)


def _sights(scene: Scene, task: Task | None) -> Iterator[_Sight]:
    """Yields what shall be seen of a scene."""
    about = None if task is None else _objects_of(task)
    opened = None if task is None else {part.target for part in task.subtasks}
    closed = Solids.of(scene)
    yield _Sight(_robot_corners(scene), closed, _ROBOT_WEIGHT)
    for name, thing in scene.objects.items():
        if not _matters(name, thing, about):
            continue
        T, half = _box(thing)
        points, others = _corners(T, half * 0.8), closed.without([name])
        if thing.role != "B":
            yield _Sight(points, others, _THING_WEIGHT)
        else:
            yield _Sight(points, others, _ITEM_WEIGHT / 2)
            taking = transform(np.eye(3), _taken_from(scene, task, name))
            yield _Sight(points, others.with_box("robot", taking, _AT_WORK_HALF_M), _ITEM_WEIGHT / 2)
        if thing.kind is Kind.ARTICULATED and (opened is None or name in opened):
            yield from _openings(scene, name, closed)


def _taken_from(scene: Scene, task: Task | None, item: str) -> Array:
    """Returns (3,) about where the middle of a robot is that takes an item: at its support's front, or on its way."""
    thing = scene.objects[item]
    below = [part.support_init for part in (() if task is None else task.subtasks) if part.target == item]
    support = scene.objects.get(below[0] or "") if below else None
    if support is not None and support.kind is Kind.ARTICULATED:
        away = -_box(support)[0][:2, 0]
    else:
        away = np.subtract(scene.robot.position, thing.position)[:2]
    stand = np.asarray(thing.position)[:2] + _AT_WORK_M * away / max(float(np.linalg.norm(away)), 1e-9)
    return np.array([*stand, _AT_WORK_HALF_M[2]])


def _openings(scene: Scene, name: str, closed: Solids) -> Iterator[_Sight]:
    """Yields the handles of an articulated object, and its insides behind doors that stand open and a robot at work."""
    thing = scene.objects[name]
    asset = asset_for(thing)
    T_world_root, half = _box(thing)
    frames = link_frames(asset, joints_at_start(thing))
    handles = []
    for handle in asset.handles:
        T_world_link = T_world_root @ frames[handle.link]
        before = np.add(handle.position_m, np.multiply(_BAR_M, handle.outward))
        handles.append(T_world_link[:3, :3] @ before + T_world_link[:3, 3])
    if handles:
        yield _Sight(np.array(handles), closed, _FRONT_WEIGHT)
    insides = []
    for index, joint in enumerate(asset.joints):
        positions = joints_at_start(thing)
        positions[index] = joint.position(max(_OPENED, joint.fraction(positions[index])))
        points = inside_points(scene, name, joint.name, positions[index])
        if len(points):
            across = float(((points - T_world_root[:3, 3]) @ T_world_root[:3, 1]).mean())
            stand = T_world_root[:3, :3] @ [-half[0] - _AT_WORK_M, across, 0.0] + T_world_root[:3, 3]
            T_world_robot = transform(T_world_root[:3, :3], [stand[0], stand[1], _AT_WORK_HALF_M[2]])
            opened = Solids.of(scene, {name: positions}).with_box("robot", T_world_robot, _AT_WORK_HALF_M)
            insides.append((points, opened))
    for points, opened in insides:
        yield _Sight(points, opened, _INSIDE_WEIGHT / len(insides))


def _all_open(scene: Scene) -> dict[str, list[float]]:
    return {
        name: [joint.position(1.0) for joint in asset_for(thing).joints]
        for name, thing in scene.objects.items()
        if thing.kind is Kind.ARTICULATED
    }


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


def _from_aside(scene: Scene, about: Collection[str], eye: Array) -> float:
    """Returns how near a camera position is, and how far to the side of the robot's way to what the task is about.

    Where doors and drawers are part of it, these alone say from which side to look.
    """
    things = [thing for name, thing in scene.objects.items() if _matters(name, thing, about)]
    robot = np.asarray(scene.robot.position, dtype=float)[:2]
    middle = np.mean([np.asarray(thing.position, dtype=float)[:2] for thing in things], axis=0)
    way, look = middle - robot, (middle + robot) / 2 - eye[:2]
    norm = float(np.linalg.norm(way) * np.linalg.norm(look))
    aside = abs(float(way[0] * look[1] - way[1] * look[0])) / max(norm, 1e-9)
    if any(thing.kind is Kind.ARTICULATED for thing in things):
        aside = 0.0
    return _ASIDE_WEIGHT * aside - _FAR_WEIGHT_PER_M * math.dist(eye, [*((middle + robot) / 2), 0.0])


def _box(thing: SceneObject) -> tuple[Array, Array]:
    """Returns an object's bounding box: (4, 4) pose of its centre and (3,) half extents."""
    return transform_from_quaternion(thing.position, thing.orientation), np.asarray(thing.extent_m) / 2


def _corners(T_world_box: Array, half: Array) -> Array:
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return signs * half @ T_world_box[:3, :3].T + T_world_box[:3, 3]
