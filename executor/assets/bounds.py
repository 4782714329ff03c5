"""The box around an asset's collision shapes, exact for every kind of shape at any orientation."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.model import Asset, Shape
from executor.geometry import Array


def bounds(asset: Asset, rotation: Array | None = None) -> tuple[Array, Array]:
    """Returns the low and high corner (3,) of the box around everything that collides, joints shut.

    A cylinder that lies on its side is as high as its diameter, and a sphere that rolled as high as before:
    turning the object's bounding box instead would be up to 1.7 times too large.

    Args:
        asset: The geometry.
        rotation: (3, 3) orientation of the root frame in the frame whose axes the box shall have; none for
            the root's.

    Returns:
        Corners relative to the root frame's origin, in metres.
    """
    turn = np.eye(3) if rotation is None else rotation
    offset_of = {joint.child: np.asarray(joint.position_m) for joint in asset.joints}
    lows, highs = [], []
    for link in asset.links:
        for shape in link.shapes:
            if shape.collides:
                center = turn @ (offset_of.get(link.name, np.zeros(3)) + np.asarray(shape.position_m))
                low, high = corners(shape, turn)
                lows.append(center + low)
                highs.append(center + high)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def corners(shape: Shape, turn: Array) -> tuple[Array, Array]:
    """Returns the low and high corner (3,) of the box around one turned shape, relative to the shape's centre."""
    axes = turn @ Rotation.from_quat(shape.orientation, scalar_first=True).as_matrix()
    if shape.kind == "convex":
        points = np.asarray(shape.vertices_m) @ axes.T
        return points.min(axis=0), points.max(axis=0)
    half = _half_extents(shape, axes)
    return -half, half


def _half_extents(shape: Shape, axes: Array) -> Array:
    """Half extents (3,) along the outer axes of a box, cylinder or sphere whose own axes are the columns."""
    if shape.kind == "sphere":
        return np.full(3, shape.size_m[0])
    if shape.kind == "box":
        return np.abs(axes) @ np.asarray(shape.size_m)
    radius, half_length = shape.size_m
    along = np.abs(axes[:, 2])
    return half_length * along + radius * np.sqrt(np.maximum(0.0, 1.0 - along**2))
