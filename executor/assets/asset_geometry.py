"""Geometry of an asset: bounding boxes, outlines, link poses, engine frames, and shapes as triangle meshes.

Shifted and scaled copies of an asset are made here, too. Point clouds and ray casting use the meshes of `shape_mesh`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.model import IDENTITY, Asset, Handle, Joint, Quaternion, Region, Rim, Shape, Vector
from executor.geometry import Array, transform, transform_from_quaternion
from executor.system.extras import require
from oag.sizes import LEAST_TOP_M

_Part = TypeVar("_Part", Asset, Shape, Joint, Handle, Region, Rim)
_AROUND = 24  # Points for something round: what they span is narrower by one per cent at the most.


def bounds(asset: Asset, rotation: Array | None = None) -> tuple[Array, Array]:
    """Return the low and high corner (3,) of the bounding box of all colliding shapes, joints shut.

    The box is exact for turned shapes: a lying cylinder is as high as its diameter, and a rolled sphere as high as
    before. Turning the object's bounding box instead would be up to 1.7 times too large.

    Args:
        rotation: (3, 3) orientation of the root frame in the frame of the box's axes; None for the root frame.

    Returns:
        Corners relative to the root frame's origin [m].
    """
    turn = np.eye(3) if rotation is None else rotation
    lows, highs = [], []
    for shape, center in _solids(asset, turn):
        low, high = corners(shape, turn)
        lows.append(center + low)
        highs.append(center + high)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def rolls_freely(asset: Asset) -> bool:
    """Return whether an object has no upright orientation: all its colliding shapes are spheres."""
    return all(shape.kind == "sphere" for link in asset.links for shape in link.shapes if shape.collides)


EQUAL_SIDES = 0.95
"""A box whose shortest side is at least this share of its longest one is a cube: it stands on any of its faces."""


def is_cube(asset: Asset) -> bool:
    """Return whether an object's only colliding shape is a cube."""
    solid = [shape for link in asset.links for shape in link.shapes if shape.collides]
    return len(solid) == 1 and solid[0].kind == "box" and min(solid[0].size_m) >= EQUAL_SIDES * max(solid[0].size_m)


def is_tall(asset: Asset) -> bool:
    """Return whether an item is clearly taller than it is wide: it is grasped from the side."""
    return asset.extent_m[2] > 1.2 * min(asset.extent_m[0], asset.extent_m[1])


def stands_by_nature(asset: Asset) -> bool:
    """Return whether a thing has one way in which it stands: it is round about an axis, tall, or hollow.

    A ball has none, and a die stands on any side.
    """
    is_hollow = any(region.kind == "interior" and region.opens_upward for region in asset.regions)
    return not rolls_freely(asset) and (asset.symmetric_about_z or is_tall(asset) or is_hollow)


LEAST_TOP_SHARE = 0.5
"""Of an item's width: a flat top of at least this share bears things, and a bottle's cap does not."""

_TOP_ROOM_M = 0.40  # As high as what is put on it may be.


def resting_top(asset: Asset) -> Region | None:
    """Return where things rest on an upright item that has no surface of its own; None where nothing does.

    They rest on its rim, as far as that is known, or on the flat top of a cylinder or a box. The region is the square
    within the circle of either.
    """
    if asset.motion != "dynamic" or any(region.kind == "surface" for region in asset.regions):
        return None
    link, square = asset.links[0], math.sqrt(0.5)
    if asset.rim is not None:
        x, y, level = asset.rim.center_m
        half_x = half_y = square * asset.rim.radius_m
    else:
        level = asset.extent_m[2] / 2
        tops = [shape for shape in link.shapes if shape.collides and _is_flat_at(shape, level)]
        if len(tops) != 1:
            return None
        x, y, _ = tops[0].position_m
        is_box, size = tops[0].kind == "box", tops[0].size_m
        if 2 * min(size[:2] if is_box else size[:1]) < max(LEAST_TOP_M, LEAST_TOP_SHARE * min(asset.extent_m[:2])):
            return None
        half_x, half_y = (size[0], size[1]) if is_box else (square * size[0], square * size[0])
    middle = (x, y, level + _TOP_ROOM_M / 2)
    return Region("top", "surface", link.name, middle, (half_x, half_y, _TOP_ROOM_M / 2), (0.0, 0.0, 1.0))


def _is_flat_at(shape: Shape, level_m: float) -> bool:
    """Return whether an upright cylinder or box ends at a height."""
    if shape.kind not in ("box", "cylinder") or shape.orientation != IDENTITY:
        return False
    return math.isclose(shape.position_m[2] + shape.size_m[-1], level_m, abs_tol=1e-4)


def hang_m(ball: Asset, support: Asset) -> float:
    """Return by how much a ball on a support's rim is lower than the rim: the part of it that hangs into the mouth.

    It is 0 for all that is no ball, and for a ball that goes through.
    """
    if support.rim is None or resting_top(support) is None or not rolls_freely(ball):
        return 0.0
    radius_m, mouth_m = ball.extent_m[2] / 2, support.rim.radius_m - support.rim.thickness_m / 2
    return radius_m - math.sqrt(radius_m**2 - mouth_m**2) if mouth_m < radius_m else 0.0


def width_at(asset: Asset, rotation: Array, depth_m: float) -> float:
    """Return the width along y of an asset's colliding shapes in a plane across z, joints shut; 0 beside the asset.

    Args:
        rotation: (3, 3) orientation of the root frame in the frame of y and z.
        depth_m: Height of the plane along z, from the root frame's origin.
    """
    cut: list[Array] = []
    for shape, center in _solids(asset, rotation):
        turn = rotation @ Rotation.from_quat(shape.orientation, scalar_first=True).as_matrix()
        points = center + outline(shape) @ turn.T
        beyond = points[:, 2] > depth_m
        # A plane cuts what is convex where it cuts the lines between its points on the one side and on the other.
        (y0, z0), (y1, z1) = (points[side][:, 1:].T for side in (~beyond, beyond))
        cut.append((y0[:, None] + (y1 - y0[:, None]) * (depth_m - z0[:, None]) / (z1 - z0[:, None])).ravel())
    widths = np.concatenate(cut)
    return float(np.ptp(widths)) if len(widths) else 0.0


def _solids(asset: Asset, turn: Array) -> Iterator[tuple[Shape, Array]]:
    """Yield the colliding shapes with their centres (3,) in a turned frame."""
    offset_of = {joint.child: np.asarray(joint.position_m) for joint in asset.joints}
    for link in asset.links:
        for shape in link.shapes:
            if shape.collides:
                yield shape, turn @ (offset_of.get(link.name, np.zeros(3)) + np.asarray(shape.position_m))


def outline(shape: Shape) -> Array:
    """Return points (N, 3) on a shape, in its own frame, whose hull is the shape or slightly smaller."""
    if shape.kind == "convex":
        return np.asarray(shape.vertices_m)
    if shape.kind == "box":
        return np.array(list(itertools.product(*((-half, half) for half in shape.size_m))))
    around = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    if shape.kind == "sphere":
        down = np.linspace(0.0, np.pi, _AROUND // 2 + 1)
        rings = shape.size_m[0] * np.stack([np.sin(down), np.cos(down)], axis=1)
    else:
        radius, half_length = shape.size_m
        rings = np.array([(radius, -half_length), (radius, half_length)])
    return np.array([(r * np.cos(a), r * np.sin(a), z) for r, z in rings for a in around])


def corners(shape: Shape, turn: Array) -> tuple[Array, Array]:
    """Return the low and high corner (3,) of a turned shape's bounding box, relative to the shape's centre.

    The box is exact for every kind of shape at any orientation.
    """
    axes = turn @ Rotation.from_quat(shape.orientation, scalar_first=True).as_matrix()
    if shape.kind == "convex":
        points = np.asarray(shape.vertices_m) @ axes.T
        return points.min(axis=0), points.max(axis=0)
    if shape.kind == "sphere":
        half = np.full(3, shape.size_m[0])
    elif shape.kind == "box":
        half = np.abs(axes) @ np.asarray(shape.size_m)
    else:
        radius, half_length = shape.size_m
        along = np.abs(axes[:, 2])
        half = half_length * along + radius * np.sqrt(np.maximum(0.0, 1.0 - along**2))
    return -half, half


def box_around_shape(shape: Shape) -> tuple[Array, Array]:
    """Return the box along a shape's own axes: (4, 4) pose of its middle in the link's frame, and (3,) half extents."""
    T = transform_from_quaternion(shape.position_m, shape.orientation)
    if shape.kind == "box":
        return T, np.asarray(shape.size_m, dtype=float)
    if shape.kind == "sphere":
        return T, np.full(3, shape.size_m[0])
    if shape.kind == "cylinder":
        radius, half_length = shape.size_m
        return T, np.array([radius, radius, half_length])
    points = np.asarray(shape.vertices_m, dtype=float)
    low, high = points.min(axis=0), points.max(axis=0)
    T[:3, 3] += T[:3, :3] @ ((low + high) / 2)
    return T, (high - low) / 2


def farthest_points(points: Array, count: int, first: int) -> list[int]:
    """Return indices of points (N, 3), each the farthest from those before it: omitted points lie near kept ones."""
    chosen, gap_m = [first], np.linalg.norm(points - points[first], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(np.argmax(gap_m)))
        gap_m = np.minimum(gap_m, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return chosen


def joint_transform(joint: Joint, position: float) -> Array:
    """Return the (4, 4) pose of a joint's child link in its parent link, at a joint position [rad] or [m]."""
    x, y, z = joint.axis
    if joint.kind == "prismatic":
        return transform(np.eye(3), np.asarray(joint.position_m) + position * np.array([x, y, z]))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation = np.eye(3) + math.sin(position) * cross + (1.0 - math.cos(position)) * (cross @ cross)
    return transform(rotation, joint.position_m)


def quaternion_x_to_axis(axis: Vector) -> Quaternion:
    """Return the quaternion w x y z that turns +x, the engine's axis of joints and cylinders, to a unit vector."""
    x, y, z = axis
    if x < -1 + 1e-9:
        return (0.0, 0.0, 0.0, 1.0)
    if x > 1 - 1e-9:
        return IDENTITY
    quaternion = np.array([1.0 + x, 0.0, -z, y])
    w, i, j, k = quaternion / np.linalg.norm(quaternion)
    return (float(w), float(i), float(j), float(k))


def cylinder_orientation(orientation: Quaternion) -> Quaternion:
    """Convert a cylinder's orientation w x y z (axis z) to the engine's, whose cylinders lie along x."""
    ours, across = (
        Rotation.from_quat(turn, scalar_first=True) for turn in (orientation, quaternion_x_to_axis((0.0, 0.0, 1.0)))
    )
    w, x, y, z = (ours * across).as_quat(scalar_first=True)
    return (float(w), float(x), float(y), float(z))


def shifted(asset: Asset, by_m: Vector) -> Asset:
    """Return the asset shifted in the root frame; its extent stays."""
    root = asset.links[0]

    def moved(position: Vector) -> Vector:
        x, y, z = (value + offset for value, offset in zip(position, by_m, strict=True))
        return (x, y, z)

    body = replace(root, shapes=tuple(replace(shape, position_m=moved(shape.position_m)) for shape in root.shapes))
    return replace(
        asset,
        links=(body, *asset.links[1:]),
        joints=tuple(replace(joint, position_m=moved(joint.position_m)) for joint in asset.joints),
        regions=tuple(
            replace(region, center_m=moved(region.center_m)) if region.link == root.name else region
            for region in asset.regions
        ),
        rim=None if asset.rim is None else replace(asset.rim, center_m=moved(asset.rim.center_m)),
    )


def scaled(asset: Asset, factor: float) -> Asset:
    """Return the asset scaled by a factor; densities and angles stay.

    Mass scales with the cube of the factor, inertia with its fifth power, and a container's volume with its cube.
    Lengths are the fields whose names end in `_m`, and the limits of prismatic joints.
    """

    def longer(value: Any) -> Any:
        return tuple(map(longer, value)) if isinstance(value, tuple) else factor * value

    def grown(part: _Part, **also: Any) -> _Part:
        lengths = {field.name: getattr(part, field.name) for field in fields(part) if field.name.endswith("_m")}
        return replace(part, **{name: longer(value) for name, value in lengths.items() if value is not None}, **also)

    return grown(
        asset,
        links=tuple(replace(link, shapes=tuple(map(grown, link.shapes))) for link in asset.links),
        joints=tuple(
            grown(joint, limits=longer(joint.limits)) if joint.kind == "prismatic" else grown(joint)
            for joint in asset.joints
        ),
        handles=tuple(map(grown, asset.handles)),
        regions=tuple(map(grown, asset.regions)),
        rim=None if asset.rim is None else grown(asset.rim),
    )


_SIDES = 24  # Of a round shape.


def shape_mesh(shape: Shape) -> Any:
    """Return a shape as a `trimesh.Trimesh` in its link's frame."""
    trimesh = require("trimesh", "sim")
    if shape.kind == "box":
        mesh = trimesh.creation.box(2.0 * np.asarray(shape.size_m))
    elif shape.kind == "cylinder":
        mesh = trimesh.creation.cylinder(shape.size_m[0], 2.0 * shape.size_m[1], sections=_SIDES)
    elif shape.kind == "sphere":
        mesh = trimesh.creation.icosphere(2, shape.size_m[0])
    elif shape.kind == "convex":
        mesh = trimesh.convex.convex_hull(np.asarray(shape.vertices_m))
    else:
        mesh = trimesh.Trimesh(shape.vertices_m, shape.triangles, process=False)
    return mesh.apply_transform(transform_from_quaternion(shape.position_m, shape.orientation))
