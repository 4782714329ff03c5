"""Footprints on the floor, gaps between them, and the floors of regions.

Every search for a free place asks `gaps_m` for obstacles. Scene layout asks with boxes of a known heading
(`Footprint`), the motion planner with objects whose heading is still open (`Disc`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from executor.assets.asset_geometry import corners, joint_transform, outline
from executor.assets.library import asset_for
from executor.assets.model import Region, Shape
from executor.geometry import Array, rotation_z, transform, transform_from_quaternion
from oag import SceneObject

EDGES: Mapping[str, tuple[int, float]] = MappingProxyType(
    {"+x": (0, 1.0), "-x": (0, -1.0), "+y": (1, 1.0), "-y": (1, -1.0)}
)
"""Axis and sign of the edges of a top, in the frame of what has it; -x is the front."""

_UPRIGHT = 0.9  # Of a hinge's axis.
_LEVEL_M = 0.01  # Tolerance of a level top; meshes are not exactly level.
_TOUCH_M = 1e-6  # Rounding tolerance: one object may stand on another.


@dataclass(frozen=True, slots=True)
class Footprint:
    """A rectangle on the floor, extruded between two heights.

    Attributes:
        x_m, y_m: Its centre in the world.
        yaw_rad: Heading of its own x axis.
        half_x_m, half_y_m: Half of its sides.
        low_m, high_m: Bottom and top of the object.
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
        """Return the footprint of an upright object's bounding box."""
        x, y, z = obj.position
        length, width, height = obj.extent_m
        return cls(x, y, yaw_of(obj), length / 2, width / 2, z - height / 2, z + height / 2)

    @classmethod
    def around(cls, centre_m: Array, half_m: Array) -> Self:
        """Return the footprint of a box along the world's axes: its centre and half extents (3,)."""
        (x, y, z), (half_x, half_y, half_z) = centre_m.tolist(), half_m.tolist()
        return cls(x, y, 0.0, half_x, half_y, z - half_z, z + half_z)

    @property
    def corners_m(self) -> Array:
        """Its corners in the world, (4, 2)."""
        signs = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])
        R = rotation_z(self.yaw_rad)[:2, :2]
        return np.asarray(signs * [self.half_x_m, self.half_y_m] @ R.T + [self.x_m, self.y_m])

    def gap_m(self, other: Footprint) -> float:
        """Return the gap between two rectangles, negative where they overlap, at any heights.

        It is the largest gap along any direction of their sides: never more than the true distance.
        """
        mine, theirs = self.corners_m, other.corners_m
        gaps = []
        for yaw in (self.yaw_rad, other.yaw_rad):
            for axis in rotation_z(yaw)[:2, :2].T:
                a, b = mine @ axis, theirs @ axis
                gaps.append(max(float(a.min() - b.max()), float(b.min() - a.max())))
        return max(gaps)

    def depth_m(self, other: Footprint) -> float:
        """Return the overlap depth of two extruded rectangles, 0 without overlap."""
        height_m = min(self.high_m, other.high_m) - max(self.low_m, other.low_m)
        reach_m = math.hypot(self.half_x_m, self.half_y_m) + math.hypot(other.half_x_m, other.half_y_m)
        if height_m <= 0.0 or math.hypot(self.x_m - other.x_m, self.y_m - other.y_m) > reach_m:
            return 0.0
        return max(0.0, min(height_m, -self.gap_m(other)))


@dataclass(frozen=True, slots=True)
class Disc:
    """The space of an object at any heading.

    Attributes:
        x_m, y_m: Its centre in the world.
    """

    x_m: float
    y_m: float
    radius_m: float
    low_m: float
    high_m: float

    def gap_m(self, other: Footprint) -> float:
        """Return the distance to a rectangle, negative where they overlap, at any heights."""
        c, s = math.cos(other.yaw_rad), math.sin(other.yaw_rad)
        x, y = self.x_m - other.x_m, self.y_m - other.y_m
        beyond = abs(c * x + s * y) - other.half_x_m, abs(c * y - s * x) - other.half_y_m
        return float(np.hypot(*np.maximum(beyond, 0.0))) - self.radius_m


def gaps_m(mine: Footprint | Disc, others: Mapping[str, Footprint]) -> Iterator[tuple[str, float]]:
    """Yield the objects that share heights with a given one, each with its gap to it, negative where they overlap.

    Args:
        mine: The footprint of the given object, actual or intended.
        others: id -> footprint.
    """
    for name, other in others.items():
        if mine.low_m < other.high_m - _TOUCH_M and other.low_m < mine.high_m - _TOUCH_M:
            yield name, mine.gap_m(other)


def solid_parts(obj: SceneObject) -> list[Footprint]:
    """Return the box of every colliding part of an upright object, joints shut."""
    asset = asset_for(obj)
    offset_of = {joint.child: np.asarray(joint.position_m) for joint in asset.joints}
    R = rotation_z(yaw_of(obj))
    frames = {
        link.name: transform(R, R @ offset_of.get(link.name, np.zeros(3)) + np.asarray(obj.position))
        for link in asset.links
    }
    return [_part(shape, frames[link.name]) for link in asset.links for shape in link.shapes if shape.collides]


def top_outlines(obj: SceneObject) -> list[tuple[float, Array]]:
    """Return the top's height and outline (N, 2) of every colliding part of an object.

    A part that tapers to a line or a point, such as a ball, has no top.
    """
    found = []
    for link in asset_for(obj).links:
        T_link = link_frame(obj, link.name)
        for shape in link.shapes:
            if shape.collides:
                T = T_link @ transform_from_quaternion(shape.position_m, shape.orientation)
                points = outline(shape) @ T[:3, :3].T + T[:3, 3]
                height_m = float(points[:, 2].max())
                ring = _ring(points[points[:, 2] > height_m - _LEVEL_M, :2])
                if ring is not None:
                    found.append((height_m, ring))
    return found


def edge_margin_m(body: Footprint, tops: Iterable[Array], middle_m: Array) -> float:
    """Return the distance of an object's centre from the edges of its supports, negative beyond the edges.

    An object between two supports that both touch it counts as supported.

    Args:
        tops: Outlines (N, 2) of the tops under it, as of `top_outlines`.
        middle_m: (2,) its centre of mass in the plan.

    Returns:
        The distance [m]; minus infinity where it touches none of the tops.
    """
    touched = [shared for top in tops if len(shared := _shared(body.corners_m[::-1], top))]
    if not touched or (ring := _ring(np.concatenate(touched))) is None:
        return -math.inf
    along = np.roll(ring, -1, axis=0) - ring
    inwards = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    within = np.einsum("ij,ij->i", np.asarray(middle_m) - ring, inwards)
    return float(within.min())


def _shared(first: Array, second: Array) -> Array:
    """Return the corners (N, 2) of the intersection of two convex outlines (N, 2), counter-clockwise."""
    points = first
    for start, end in zip(second, np.roll(second, -1, axis=0), strict=True):
        if not len(points):
            break
        dx, dy = end - start
        side = dx * (points[:, 1] - start[1]) - dy * (points[:, 0] - start[0])
        kept = []
        for here, there, mine, theirs in zip(points, np.roll(points, -1, axis=0), side, np.roll(side, -1), strict=True):
            if mine >= 0.0:
                kept.append(here)
            if (mine < 0.0) is not (theirs < 0.0):
                kept.append(here + (there - here) * mine / (mine - theirs))
        points = np.array(kept).reshape(-1, 2)
    return points


def _ring(points: Array) -> Array | None:
    """Return the hull's corners of points (N, 2), counter-clockwise; None for a hull without area."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return None


def swept_parts(obj: SceneObject, most_rad: float, steps: int) -> list[Footprint]:
    """Return boxes of an upright object's doors as they swing on vertical hinges.

    Args:
        most_rad: Largest opening angle of each door, within its limits.
    """
    asset = asset_for(obj)
    links = {link.name: link for link in asset.links}
    parts = []
    for joint in asset.doors:
        if joint.kind == "revolute" and abs(joint.axis[2]) > _UPRIGHT:
            low, high = joint.limits
            for position in np.linspace(low, min(high, low + most_rad), steps):
                T = link_frame(obj, joint.child, joint.fraction(float(position)))
                parts += [_part(shape, T) for shape in links[joint.child].shapes if shape.collides]
    return parts


def _part(shape: Shape, T: Array) -> Footprint:
    low, high = corners(shape, np.eye(3))
    half_x, half_y, half_z = (float(value) for value in (high - low) / 2)
    x, y, z = (float(value) for value in T[:3, :3] @ (np.asarray(shape.position_m) + (low + high) / 2) + T[:3, 3])
    return Footprint(x, y, math.atan2(T[1, 0], T[0, 0]), half_x, half_y, z - half_z, z + half_z)


def overlap_depth_m(first: Iterable[Footprint], second: Iterable[Footprint]) -> float:
    """Return the overlap depth of two objects from the boxes of their parts; 0 without overlap."""
    return max((a.depth_m(b) for a, b in itertools.product(first, second)), default=0.0)


def parts_gap_m(first: Iterable[Footprint], second: Iterable[Footprint]) -> float:
    """Return the least gap between the boxes of two objects' parts, along the axis that separates each pair the most.

    It is never more than the true distance, and negative where they overlap; infinite without parts.
    """
    pairs = itertools.product(first, second)
    return min((max(a.gap_m(b), a.low_m - b.high_m, b.low_m - a.high_m) for a, b in pairs), default=math.inf)


def open_fraction(obj: SceneObject) -> float:
    """Return the open fraction of an object's doors or drawers at the start, 0 to 1 of their range."""
    value = obj.parameters.get("open_fraction", 0.0)
    return float(value) if isinstance(value, int | float) else 0.0


def link_frame(obj: SceneObject, link: str, fraction: float | None = None) -> Array:
    """Return the (4, 4) pose of an object's link in the world.

    Args:
        fraction: Open fraction of its joint, 0 to 1 of the range; by default that at the start.
    """
    T = transform_from_quaternion(obj.position, obj.orientation)
    joint = next((joint for joint in asset_for(obj).joints if joint.child == link), None)
    if joint is None:
        return T
    return T @ joint_transform(joint, joint.start(open_fraction(obj)) if fraction is None else joint.position(fraction))


def region_frame(obj: SceneObject, region: Region) -> tuple[Array, Array]:
    """Return the (4, 4) world pose of the centre of a region's floor, and the floor's half sides (2,)."""
    floor = transform(np.eye(3), region.floor_m)
    return link_frame(obj, region.link) @ floor, np.asarray(region.half_extents_m[:2])


def yaw_of(obj: SceneObject) -> float:
    """Return the heading [rad] of an object's own x axis."""
    w, x, y, z = obj.orientation
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
