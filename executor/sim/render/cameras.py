"""Cameras: the two that the robot carries, on its mast and wrist, and the overview camera that is placed for a scene.

A camera's frame is SAPIEN's: x looks forward, y to the left, z up. Nothing here needs the simulator.

The overview stands near, with all targets in its picture and little of them hidden. Targets are the objects, foremost
the items, also past a robot that takes them; the insides of what is opened, with its doors open and a robot before it;
and the robot. Directions all around are tried. From each the camera is as near as the picture allows, never in a wall
or a piece of furniture. Rays to the targets measure the visible share past everything solid.

Source: the paper's appendix on its three camera views. Its global camera copies a photograph's pose; a scene that comes
without a photograph gets one that is computed here.

Every collision shape counts as one oriented box: itself where it is a box, the box around it where it is not. So
"inside" errs on the safe side, and furniture, which is made of boxes, is exact: with its doors where they stand.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter1d

from executor.assets.asset_geometry import box_around_shape, joint_transform
from executor.assets.library import asset_for
from executor.assets.model import Asset
from executor.assets.parameters import number
from executor.geometry import Array, transform, transform_from_quaternion
from executor.sim.robot.description import MAST_LINK, camera_mount_m
from oag import Scene, SceneObject, Task
from oag.model.robots import Robot
from oag.model.scene import FLOOR
from oag.model.symbols import Kind

_NOTHING: Mapping[str, ArrayLike] = {}


@dataclass(frozen=True, slots=True)
class Solids:
    """Boxes, N of them.

    Attributes:
        owners: (N,) the object that each belongs to.
        axes: (N, 3, 3) orientations in the world, one axis a column.
        middles: (N, 3) in metres.
        halves: (N, 3) half extents in metres.
    """

    owners: NDArray[np.str_]
    axes: Array
    middles: Array
    halves: Array

    @classmethod
    def of(cls, scene: Scene, joints: Mapping[str, ArrayLike] = _NOTHING) -> Solids:
        """Return the solid parts of a scene.

        Args:
            joints: Id of an articulated object -> its joints [rad] or [m], in the asset's order; by default those of
                the scene.
        """
        owners: list[str] = []
        boxes: list[tuple[Array, Array]] = []
        for name, thing in scene.objects.items():
            asset = asset_for(thing)
            T_world_root = transform_from_quaternion(thing.position, thing.orientation)
            frames = link_frames(asset, joints[name] if name in joints else joints_at_start(thing))
            for link in asset.links:
                for shape in link.shapes:
                    if shape.collides:
                        T_shape_box, half = box_around_shape(shape)
                        boxes.append((T_world_root @ frames[link.name] @ T_shape_box, half))
                        owners.append(name)
        poses_of = np.array([T for T, _ in boxes]).reshape(-1, 4, 4)
        halves = np.array([half for _, half in boxes]).reshape(-1, 3)
        return cls(np.array(owners, dtype=np.str_), poses_of[:, :3, :3], poses_of[:, :3, 3], halves)

    def without(self, owners: Collection[str]) -> Solids:
        """Return the solids without those of some objects."""
        keep = ~np.isin(self.owners, list(owners))
        return Solids(self.owners[keep], self.axes[keep], self.middles[keep], self.halves[keep])

    def with_box(self, owner: str, T_world_box: Array, half: ArrayLike) -> Solids:
        """Return the solids with one more box."""
        return Solids(
            np.append(self.owners, owner),
            np.concatenate([self.axes, T_world_box[None, :3, :3]]),
            np.concatenate([self.middles, T_world_box[None, :3, 3]]),
            np.concatenate([self.halves, np.asarray(half, dtype=float)[None]]),
        )

    def gap_m(self, point_m: ArrayLike) -> float:
        """Return how far a point (3,) is from the nearest solid or the floor; negative inside one."""
        point = np.asarray(point_m, dtype=float)
        beyond = np.abs(np.einsum("nji,nj->ni", self.axes, point - self.middles)) - self.halves
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        inside = np.minimum(beyond.max(axis=1, initial=-np.inf), 0.0)
        return float(min((outside + inside).min(initial=np.inf), point[2]))

    def hidden(self, eye_m: ArrayLike, points_m: ArrayLike) -> NDArray[np.bool_]:
        """Return (P,) whether something solid is between an eye (3,) and each of some points (P, 3)."""
        eye, points = np.asarray(eye_m, dtype=float), np.atleast_2d(np.asarray(points_m, dtype=float))
        start = np.einsum("nji,nj->ni", self.axes, eye - self.middles)[:, None]
        ray = np.einsum("nji,pj->npi", self.axes, points - eye)
        ray = np.where(np.abs(ray) < 1e-12, 1e-12, ray)
        half = self.halves[:, None]
        first, second = (-half - start) / ray, (half - start) / ray
        enter = np.minimum(first, second).max(axis=2)
        leave = np.maximum(first, second).min(axis=2)
        # What a ray only reaches at its end is what is looked at.
        return np.asarray(((enter < leave) & (leave > 0.0) & (enter < 0.999)).any(axis=0))


def joints_at_start(thing: SceneObject, asset: Asset | None = None) -> list[float]:
    """Return the joints of an object when its scene is built, [rad] or [m], in the asset's order.

    Args:
        asset: Its asset, where it is built already.
    """
    fraction = number(thing, "open_fraction", 0.0, 0.0, 1.0)
    return [joint.start(fraction) for joint in (asset or asset_for(thing)).joints]


def link_frames(asset: Asset, joints: ArrayLike | Sequence[float]) -> dict[str, Array]:
    """Return link name -> (4, 4) pose in the root's frame, its joints somewhere (rad or m, in the asset's order)."""
    positions = np.asarray(joints, dtype=float)
    moved = {j.child: joint_transform(j, float(p)) for j, p in zip(asset.joints, positions, strict=True)}
    return {link.name: moved.get(link.name, np.eye(4)) for link in asset.links}


VIEWS = ("global", "head", "wrist")


@dataclass(frozen=True, slots=True)
class Camera:
    """One pinhole camera.

    Attributes:
        name: "global", "head" or "wrist".
        mount: Robot link that carries it, or None for a camera that stands still in the world.
        T_mount_camera: (4, 4) pose in the mount's frame (in the world where there is no mount).
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


def camera_json(camera: Camera, size: tuple[int, int], intrinsics: Array | None = None) -> dict[str, Any]:
    """Return the record of a camera in data sets, for pictures of a width and height.

    Args:
        intrinsics: (3, 3) matrix [pixels] that the renderer drew with; by default that of `intrinsic_matrix`.
    """
    return {
        "size": list(size),
        "fov_y_rad": camera.fov_y_rad,
        "intrinsics": intrinsic_matrix(camera, size) if intrinsics is None else intrinsics,
        "mount": camera.mount,
        "T_mount_camera": camera.T_mount_camera,
        "near_m": camera.near_m,
        "far_m": camera.far_m,
    }


def look_at(position_m: ArrayLike, target_m: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Array:
    """Return the (4, 4) pose of a camera at a position (3,) that looks at a target (3,)."""
    position = np.asarray(position_m, dtype=float)
    forward = np.asarray(target_m, dtype=float) - position
    forward /= np.linalg.norm(forward)
    left = np.cross(np.asarray(up, dtype=float), forward)
    left /= np.linalg.norm(left)
    return transform(np.stack([forward, left, np.cross(forward, left)], axis=1), position)


def head_camera(robot: Robot) -> Camera:
    """Return the camera on the robot's mast, which looks forward and down past the arm at the arm's workspace."""
    pose = look_at(camera_mount_m(robot), [0.55, -0.04 * robot.mast_side, 0.62])
    return Camera("head", MAST_LINK, pose, fov_y_rad=math.radians(68.0))


def wrist_camera(robot: Robot) -> Camera:
    """Return the camera on the hand, which looks along the approach axis between the fingers.

    It has no body. It sits 23 mm to the side of the hand and as far back, where the hand and what it holds keep things
    away.
    """
    pose = look_at([0.045, 0.0, 0.0], [0.015, 0.0, 0.15], up=[1.0, 0.0, 0.0])
    return Camera("wrist", robot.hand_link, pose, fov_y_rad=math.radians(72.0), near_m=0.01)


WALL = "wall"
"""Category of occluders that need not be visible themselves."""

_NOT_SHOWN = (WALL, FLOOR)

TARGET_PX = 40
"""Least number of pixels of the first target in an overview's picture."""

LENS_GAP_M = 0.15
"""No lens is nearer to anything solid: at 5 cm, where its picture begins, one piece would fill it."""

_FOV_RAD = math.radians(40.0)
_ELEVATION_DEG = (26.0, 34.0, 42.0, 54.0)
_AZIMUTHS = 24  # 15 degrees apart.
_MARGIN = 0.94  # Of the half picture: the rest is free.
_WORKING_ROOM_M = 0.75  # In front of doors and drawers.
_STANDING_ROOM_M = 0.6  # Beside an item.
_ARM_ROOM_M = 0.35  # Over an item.
_ROBOT_HEIGHT_M = 1.0  # The mast above that need not be visible.
_ROBOT_RADIUS_M = 0.25
_AT_WORK_M = 0.60  # How far before a front the middle of the robot's base is while it reaches in.
_AT_WORK_HALF_M = (0.16, 0.16, 0.42)  # Base and folded arm; what is above them is thin.
_BAR_M = 0.04  # From the middle of a handle's bar this far out nothing of it is left.
_OPENED = 0.8  # Of their range; doors are seldom opened wider.

_FILLED = 0.45  # Of a box's outline that is sure to be the thing's own: balls and bottles have less than boxes.
_FOLLOW_S = 1.2  # Over which a following camera smooths its way.

# Weights of the visible share of each target, and of a metre's distance. Chosen by eye over forty episodes.
_ITEM_WEIGHT = 4.0
_INSIDE_WEIGHT = 5.0
_FRONT_WEIGHT = 1.5
_THING_WEIGHT = 1.0
_ROBOT_WEIGHT = 2.0
_ASIDE_WEIGHT = 2.0
_FAR_WEIGHT_PER_M = 0.6


@dataclass(frozen=True, slots=True)
class _ViewTarget:
    """Target points (P, 3) of the overview, the solids that may hide them, and the weight of seeing all of them."""

    points: Array
    solids: Solids
    weight: float


def cameras_for(
    scene: Scene,
    views: Iterable[str] = VIEWS,
    aspect: float = 1.0,
    *,
    task: Task | None = None,
    height_px: int | None = None,
) -> tuple[Camera, ...]:
    """Return the cameras of a scene, in the order of `views`.

    Args:
        scene: The concrete scene; the global camera is placed for it.
        views: Names out of `VIEWS`.
        aspect: Width of the pictures over their height.
        task: What the global camera is to show; by default the whole scene.
        height_px: As for `global_camera`.

    Raises:
        ValueError: When a view is not one of `VIEWS`.
    """
    makers = {
        "global": lambda: global_camera(scene, aspect, task, height_px),
        "head": lambda: head_camera(scene.robot.model),
        "wrist": lambda: wrist_camera(scene.robot.model),
    }
    views = tuple(views)
    for view in views:
        if view not in makers:
            raise ValueError(f"there is no view {view!r}; the views are {', '.join(VIEWS)}")
    return tuple(makers[view]() for view in views)


def global_camera(scene: Scene, aspect: float = 1.0, task: Task | None = None, height_px: int | None = None) -> Camera:
    """Return a still camera that sees the objects that matter, the robot, and into what has doors and drawers.

    The objects that matter are all of them, or those of a task: in a large home the rest would make them small. A plan
    without subtasks is about all of them.

    Args:
        scene: The concrete scene.
        aspect: Width of the pictures over their height.
        task: What it is to show; by default the whole scene.
        height_px: Height of its pictures. The camera then comes as near to the first target as `TARGET_PX` needs, even
            where others leave the picture.
    """
    about = None if task is None or not task.subtasks else _objects_of(task)
    points = interest_points(scene, about)
    targets = list(_view_targets(scene, task if about is not None else None))
    solids = (Solids.of(scene), Solids.of(scene, _all_open(scene)))

    first = None if task is None or about is None or height_px is None else scene.objects.get(task.subtasks[0].target)
    others = None if first is None else solids[0].without([first.id])

    def large_share(eye: Array) -> float:
        """How large the first target is in the picture, at most 1: as large as needed."""
        if first is None or others is None or height_px is None:
            return 1.0
        T, half = _box(first)
        visible = float(np.mean(~others.hidden(eye, _corners(T, half * 0.8))))
        return min(visible * (_large_from_m(first, eye, height_px) / math.dist(eye, T[:3, 3])) ** 2, 1.0)

    def worth(camera: Camera) -> tuple[bool, float, float]:
        eye = camera.T_mount_camera[:3, 3]
        clear = all(each.gap_m(eye) >= LENS_GAP_M for each in solids)
        score = sum(s.weight * float(np.mean(~s.solids.hidden(eye, s.points))) for s in targets)
        score += 0.0 if about is None else _side_view_score(scene, about, eye)
        return clear, round(large_share(eye), 1), round(score, 9)

    def nearer(camera: Camera) -> Camera:
        if first is None or height_px is None:
            return camera
        eye, target = camera.T_mount_camera[:3, 3], np.asarray(first.position)
        share = 0.98 * _large_from_m(first, eye, height_px) / math.dist(eye, target)
        if share >= 1.0:
            return camera
        # Along the ray the target keeps its place in the picture; nearer by, it comes to the middle.
        ahead = camera.T_mount_camera[:3, 0]
        centre = eye + ahead * float((target - eye) @ ahead)
        eye = target + share * (eye - target)
        return replace(camera, T_mount_camera=look_at(eye, target + share**2 * (centre - target)))

    azimuths = [2 * math.pi * (k + 0.5) / _AZIMUTHS for k in range(_AZIMUTHS)]
    directions = ((azimuth, math.radians(elevation)) for elevation in _ELEVATION_DEG for azimuth in azimuths)
    return max((nearer(_framing_camera(points, *direction, aspect)) for direction in directions), key=worth)


def _large_from_m(thing: SceneObject, eye: Array, height_px: int) -> float:
    """Return how far away a thing still has enough pixels in a picture from the overview's direction."""
    T, half = _box(thing)
    way = np.asarray(eye) - T[:3, 3]
    facing = np.abs(T[:3, :3].T @ (way / np.linalg.norm(way)))
    area = 4.0 * float(facing @ [half[1] * half[2], half[0] * half[2], half[0] * half[1]])
    focal_px = height_px / 2.0 / math.tan(_FOV_RAD / 2)
    return focal_px * math.sqrt(_FILLED * area / TARGET_PX)


def following(
    camera: Camera, points: NDArray[np.floating[Any]], solids: Solids, aspect: float, rate_hz: float
) -> Array:
    """Return (N, 4, 4) poses of an overview camera that follows the task without turning.

    Args:
        camera: The still camera, from whose side it looks.
        points: (N, P, 3) what each picture has to show.
        solids: What it keeps clear of; where it cannot, it stays nearer to the still camera.
        aspect: Width of the pictures over their height.
        rate_hz: Pictures per second of simulated time.
    """
    T = camera.T_mount_camera
    eyes = np.array([_framing_eye(T[:3, :3], around, aspect) for around in points])
    eyes = gaussian_filter1d(eyes, _FOLLOW_S * rate_hz, axis=0, mode="nearest")
    shares = (1.0, 0.75, 0.5, 0.25)
    paths = (T[:3, 3] + share * (eyes - T[:3, 3]) for share in shares)
    free = (path for path in paths if all(solids.gap_m(eye) >= LENS_GAP_M for eye in path[:: round(rate_hz)]))
    poses = np.tile(T, (len(points), 1, 1))
    poses[:, :3, 3] = next(free, poses[:, :3, 3])
    return poses


def is_lens_clear(scene: Scene, eye: Array) -> bool:
    """Return whether a lens at a place (3,) keeps clear of everything solid, doors shut and doors open."""
    return all(each.gap_m(eye) >= LENS_GAP_M for each in (Solids.of(scene), Solids.of(scene, _all_open(scene))))


def interest_points(scene: Scene, about: Collection[str] | None = None) -> Array:
    """Return (N, 3) world points that an overview must show: box corners, robot, room in front of fixtures.

    Args:
        about: The objects that matter, with room for the robot around items; by default all, without that.
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
                parts.append(_handle_stand_points(thing))
        elif about is not None and thing.kind is Kind.ITEM:
            # The robot stands on some side of it, and reaches over it.
            for height_m in (0.0, T_world_box[2, 3] + _ARM_ROOM_M):
                standing_room = _corners(T_world_box, half + [_STANDING_ROOM_M, _STANDING_ROOM_M, 0.0])
                standing_room[:, 2] = height_m
                parts.append(standing_room)
    return np.concatenate(parts)


def _handle_stand_points(thing: SceneObject) -> Array:
    """Return (P, 3) points around a robot that holds a handle, its door or drawer open."""
    asset = asset_for(thing)
    T_world_root, _ = _box(thing)
    frames = link_frames(asset, [joint.start(_OPENED) for joint in asset.joints])
    parts = [np.empty((0, 3))]
    for handle in asset.handles:
        T_world_link = T_world_root @ frames[handle.link]
        before = np.add(handle.position_m, np.multiply(_AT_WORK_M + _ROBOT_RADIUS_M, handle.outward))
        foot = (T_world_link[:3, :3] @ before + T_world_link[:3, 3]) * [1.0, 1.0, 0.0]
        parts.append(foot + [[0.0, 0.0, 0.0], [0.0, 0.0, _ROBOT_HEIGHT_M]])
    return np.concatenate(parts)


def inside_points(scene: Scene, object_id: str, joint: str, position: float) -> Array:
    """Return (P, 3) world points spread over the room behind a door or drawer; none where it encloses nothing.

    Args:
        object_id: What has the joint.
        position: Position of the joint, [rad] or [m]; what slides with it moves, too.
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


def _view_targets(scene: Scene, task: Task | None) -> Iterator[_ViewTarget]:
    about = None if task is None else _objects_of(task)
    opened = None if task is None else {part.target for part in task.subtasks}
    closed = Solids.of(scene)
    yield _ViewTarget(_robot_corners(scene), closed, _ROBOT_WEIGHT)
    for name, thing in scene.objects.items():
        if not _matters(name, thing, about):
            continue
        T, half = _box(thing)
        points, others = _corners(T, half * 0.8), closed.without([name])
        if thing.role != "B":
            yield _ViewTarget(points, others, _THING_WEIGHT)
        else:
            yield _ViewTarget(points, others, _ITEM_WEIGHT / 2)
            taking = transform(np.eye(3), _picking_position(scene, task, name))
            yield _ViewTarget(points, others.with_box("robot", taking, _AT_WORK_HALF_M), _ITEM_WEIGHT / 2)
        if thing.kind is Kind.ARTICULATED and (opened is None or name in opened):
            yield from _openings(scene, name, closed)


def _picking_position(scene: Scene, task: Task | None, item: str) -> Array:
    """Return (3,) about where the robot's middle is while it takes an item: at its support's front, or on its way."""
    thing = scene.objects[item]
    below = [part.support_init for part in (() if task is None else task.subtasks) if part.target == item]
    support = scene.objects.get(below[0] or "") if below else None
    if support is not None and support.kind is Kind.ARTICULATED:
        away = -_box(support)[0][:2, 0]
    else:
        away = np.subtract(scene.robot.position, thing.position)[:2]
    stand = np.asarray(thing.position)[:2] + _AT_WORK_M * away / max(float(np.linalg.norm(away)), 1e-9)
    return np.array([*stand, _AT_WORK_HALF_M[2]])


def _openings(scene: Scene, name: str, closed: Solids) -> Iterator[_ViewTarget]:
    """Yield the handles of an articulated object, and its insides behind open doors and a robot at work."""
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
        yield _ViewTarget(np.array(handles), closed, _FRONT_WEIGHT)
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
        yield _ViewTarget(points, opened, _INSIDE_WEIGHT / len(insides))


def _all_open(scene: Scene) -> dict[str, list[float]]:
    return {
        name: [joint.start(1.0) for joint in asset_for(thing).joints]
        for name, thing in scene.objects.items()
        if thing.kind is Kind.ARTICULATED
    }


def _robot_corners(scene: Scene) -> Array:
    """Return the (8, 3) corners of a box around the robot where it begins."""
    offsets = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (0.0, 1.0)]
    robot = np.asarray(scene.robot.position, dtype=float)
    corners: Array = robot + np.array(offsets) * [_ROBOT_RADIUS_M, _ROBOT_RADIUS_M, _ROBOT_HEIGHT_M]
    return corners


def _objects_of(task: Task) -> frozenset[str]:
    roles = ((part.target, part.support_init, part.support_goal) for part in task.subtasks)
    return frozenset(name for names in roles for name in names if name is not None)


def _matters(name: str, thing: SceneObject, about: Collection[str] | None) -> bool:
    return thing.category not in _NOT_SHOWN and (about is None or name in about)


def _framing_camera(points: Array, azimuth_rad: float, elevation_rad: float, aspect: float) -> Camera:
    """Return the nearest camera on a viewing direction that has all points in its picture, centred."""
    outward = np.array(
        [
            math.cos(azimuth_rad) * math.cos(elevation_rad),
            math.sin(azimuth_rad) * math.cos(elevation_rad),
            math.sin(elevation_rad),
        ]
    )
    R = look_at(outward, np.zeros(3))[:3, :3]
    return Camera("global", None, transform(R, _framing_eye(R, points, aspect)), _FOV_RAD, near_m=0.05)


def _framing_eye(R: Array, points: Array, aspect: float) -> Array:
    """Return (3,) the nearest place from which a camera of an orientation has all points in its picture, centred."""
    along = points @ R
    slope_z = math.tan(_FOV_RAD / 2) * _MARGIN
    bounds = []
    for axis, slope in ((1, slope_z * aspect), (2, slope_z)):
        # A point is in the picture when |side - side_0| <= slope * (ahead - ahead_0), for both signs.
        low = float(np.max(along[:, axis] - slope * along[:, 0]))
        high = float(np.min(along[:, axis] + slope * along[:, 0]))
        bounds.append(((low + high) / 2, (high - low) / (2 * slope)))
    ahead = min(limit for _, limit in bounds)
    return np.asarray(R @ np.array([ahead, bounds[0][0], bounds[1][0]]))


def _side_view_score(scene: Scene, about: Collection[str], eye: Array) -> float:
    """Return a score of a camera position: near, and to the side of the robot's path to the task's objects.

    Where doors and drawers are part of the task, these alone decide the side.
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
    return transform_from_quaternion(thing.position, thing.orientation), np.asarray(thing.extent_m) / 2


def _corners(T_world_box: Array, half: Array) -> Array:
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return signs * half @ T_world_box[:3, :3].T + T_world_box[:3, 3]
