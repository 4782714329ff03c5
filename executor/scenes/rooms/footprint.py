"""A thing's box seen from above: a rectangle at any angle, and the heights that it takes up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from executor.assets.library import asset_for
from executor.assets.transforms import corners
from executor.geometry import Array, rotation_z
from oag import SceneObject


@dataclass(frozen=True, slots=True)
class Footprint:
    """A rectangle on the floor, extruded between two heights.

    Attributes:
        x_m, y_m: Its middle in the world.
        yaw_rad: Heading of its own x axis.
        half_x_m, half_y_m: Half its sides.
        low_m, high_m: Heights between which the thing is.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    half_x_m: float
    half_y_m: float
    low_m: float = 0.0
    high_m: float = math.inf

    @classmethod
    def of(cls, obj: SceneObject) -> Self:
        """Returns the footprint of an upright object's bounding box."""
        x, y, z = obj.position
        length, width, height = obj.extent_m
        return cls(x, y, yaw_of(obj), length / 2, width / 2, z - height / 2, z + height / 2)

    @property
    def corners_m(self) -> Array:
        """Its corners in the world, (4, 2)."""
        signs = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])
        R = rotation_z(self.yaw_rad)[:2, :2]
        return np.asarray(signs * [self.half_x_m, self.half_y_m] @ R.T + [self.x_m, self.y_m])

    def gap_m(self, other: Footprint) -> float:
        """Returns the gap between two rectangles, negative where they overlap, whatever their heights.

        It is the largest gap along any of their sides' directions: never more than the true distance.
        """
        mine, theirs = self.corners_m, other.corners_m
        gaps = []
        for yaw in (self.yaw_rad, other.yaw_rad):
            for axis in rotation_z(yaw)[:2, :2].T:
                a, b = mine @ axis, theirs @ axis
                gaps.append(max(float(a.min() - b.max()), float(b.min() - a.max())))
        return max(gaps)

    def beside(self, other: Footprint) -> bool:
        """Decides whether there are heights that both take up."""
        return self.low_m < other.high_m - 1e-6 and other.low_m < self.high_m - 1e-6

    def depth_m(self, other: Footprint) -> float:
        """Returns how deep two extruded rectangles overlap, 0 where they do not."""
        height_m = min(self.high_m, other.high_m) - max(self.low_m, other.low_m)
        return max(0.0, min(height_m, -self.gap_m(other)))


def solid_parts(obj: SceneObject) -> list[Footprint]:
    """Returns the box of every part of an upright object that collides, joints shut."""
    asset = asset_for(obj)
    offset_of = {joint.child: np.asarray(joint.position_m) for joint in asset.joints}
    R = rotation_z(yaw_of(obj))
    parts = []
    for link in asset.links:
        for shape in (shape for shape in link.shapes if shape.collides):
            low, high = corners(shape, np.eye(3))
            half_x, half_y, half_z = (float(value) for value in (high - low) / 2)
            centre = offset_of.get(link.name, np.zeros(3)) + np.asarray(shape.position_m) + (low + high) / 2
            x, y, z = (float(value) for value in R @ centre + np.asarray(obj.position))
            parts.append(Footprint(x, y, yaw_of(obj), half_x, half_y, z - half_z, z + half_z))
    return parts


def yaw_of(obj: SceneObject) -> float:
    """Returns the heading in rad of an object's own x axis."""
    w, x, y, z = obj.orientation
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
