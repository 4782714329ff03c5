"""Free places: what things take up of a floor, how far others are from that, and the floors that things have.

Whoever looks for a place asks `gaps_m` what is in the way there: scenes as they are laid out, for boxes with a heading
(`Footprint`), and the planner of motions, for things of which the heading is still open (`Disc`).
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

from executor.assets.library import asset_for
from executor.assets.model import Region, Shape
from executor.assets.transforms import corners, joint_transform, outline
from executor.geometry import Array, rotation_z, transform, transform_from_quaternion
from oag import SceneObject

EDGES: Mapping[str, tuple[int, float]] = MappingProxyType(
    {"+x": (0, 1.0), "-x": (0, -1.0), "+y": (1, 1.0), "-y": (1, -1.0)}
)
"""Axis and sign of the edges of a top, in the frame of what has it; -x is the front."""

_UPRIGHT = 0.9  # Of a hinge's axis.
_LEVEL_M = 0.01  # A top is level within this; meshes are not quite.
_TOUCH_M = 1e-6  # Rounding: one thing may stand on another.


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

    @classmethod
    def around(cls, centre_m: Array, half_m: Array) -> Self:
        """Returns the footprint of a box along the world's axes: its centre and half extents (3,)."""
        (x, y, z), (half_x, half_y, half_z) = centre_m.tolist(), half_m.tolist()
        return cls(x, y, 0.0, half_x, half_y, z - half_z, z + half_z)

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

    def depth_m(self, other: Footprint) -> float:
        """Returns how deep two extruded rectangles overlap, 0 where they do not."""
        height_m = min(self.high_m, other.high_m) - max(self.low_m, other.low_m)
        reach_m = math.hypot(self.half_x_m, self.half_y_m) + math.hypot(other.half_x_m, other.half_y_m)
        if height_m <= 0.0 or math.hypot(self.x_m - other.x_m, self.y_m - other.y_m) > reach_m:
            return 0.0
        return max(0.0, min(height_m, -self.gap_m(other)))


@dataclass(frozen=True, slots=True)
class Disc:
    """What a thing may take up, whichever way it is turned.

    Attributes:
        x_m, y_m: Its middle in the world.
        radius_m: Of the disc.
        low_m, high_m: Heights between which the thing is.
    """

    x_m: float
    y_m: float
    radius_m: float
    low_m: float
    high_m: float

    def gap_m(self, other: Footprint) -> float:
        """Returns the distance to a rectangle, negative where they overlap, whatever their heights."""
        c, s = math.cos(other.yaw_rad), math.sin(other.yaw_rad)
        x, y = self.x_m - other.x_m, self.y_m - other.y_m
        beyond = abs(c * x + s * y) - other.half_x_m, abs(c * y - s * x) - other.half_y_m
        return float(np.hypot(*np.maximum(beyond, 0.0))) - self.radius_m


def gaps_m(mine: Footprint | Disc, others: Mapping[str, Footprint]) -> Iterator[tuple[str, float]]:
    """Yields which others share heights with a thing, each with its gap to it, negative where they overlap.

    Args:
        mine: What the thing takes up, or would take up.
        others: id -> what others take up.
    """
    for name, other in others.items():
        if mine.low_m < other.high_m - _TOUCH_M and other.low_m < mine.high_m - _TOUCH_M:
            yield name, mine.gap_m(other)


def solid_parts(obj: SceneObject) -> list[Footprint]:
    """Returns the box of every part of an upright object that collides, joints shut."""
    asset = asset_for(obj)
    offset_of = {joint.child: np.asarray(joint.position_m) for joint in asset.joints}
    R = rotation_z(yaw_of(obj))
    frames = {
        link.name: transform(R, R @ offset_of.get(link.name, np.zeros(3)) + np.asarray(obj.position))
        for link in asset.links
    }
    return [_part(shape, frames[link.name]) for link in asset.links for shape in link.shapes if shape.collides]


def top_outlines(obj: SceneObject) -> list[tuple[float, Array]]:
    """Returns for every part of an object that collides the height of its top and the outline (N, 2) of that.

    What tapers to a line or a point, such as a ball, has no top.
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
    """Returns how far within the edges of what it stands on a thing's middle is, negative beyond them.

    Between two tops that both carry it the thing stands, too.

    Args:
        body: The thing.
        tops: Outlines (N, 2) of the tops under it, as of `top_outlines`.
        middle_m: (2,) the middle of its weight in the plan.

    Returns:
        The distance; minus infinity where it touches none of the tops.
    """
    touched = [shared for top in tops if len(shared := _shared(body.corners_m[::-1], top))]
    if not touched or (ring := _ring(np.concatenate(touched))) is None:
        return -math.inf
    along = np.roll(ring, -1, axis=0) - ring
    inwards = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    within = np.einsum("ij,ij->i", np.asarray(middle_m) - ring, inwards)
    return float(within.min())


def _shared(first: Array, second: Array) -> Array:
    """Returns the corners (N, 2) of what two convex outlines (N, 2), counter-clockwise, have in common."""
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
    """Returns the corners of the hull of points (N, 2), counter-clockwise; None where it has no area."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return None


def swept_parts(obj: SceneObject, most_rad: float, steps: int) -> list[Footprint]:
    """Returns boxes of the parts of an upright object's doors as they swing on upright hinges.

    Args:
        obj: The object.
        most_rad: How far each door is opened, unless it ends before.
        steps: In how many steps.
    """
    asset = asset_for(obj)
    links = {link.name: link for link in asset.links}
    parts = []
    for joint in asset.joints:
        if joint.kind == "revolute" and abs(joint.axis[2]) > _UPRIGHT:
            low, high = joint.limits
            for position in np.linspace(low, min(high, low + most_rad), steps):
                T = link_frame(obj, joint.child, joint.fraction(float(position)))
                parts += [_part(shape, T) for shape in links[joint.child].shapes if shape.collides]
    return parts


def _part(shape: Shape, T: Array) -> Footprint:
    """Returns the box of a shape of a link whose pose (4, 4) in the world is upright."""
    low, high = corners(shape, np.eye(3))
    half_x, half_y, half_z = (float(value) for value in (high - low) / 2)
    x, y, z = (float(value) for value in T[:3, :3] @ (np.asarray(shape.position_m) + (low + high) / 2) + T[:3, 3])
    return Footprint(x, y, math.atan2(T[1, 0], T[0, 0]), half_x, half_y, z - half_z, z + half_z)


def deepest_m(first: Iterable[Footprint], second: Iterable[Footprint]) -> float:
    """Returns how deep two things overlap, given the boxes of their parts; 0 where they do not."""
    return max((a.depth_m(b) for a, b in itertools.product(first, second)), default=0.0)


def open_fraction(obj: SceneObject) -> float:
    """Returns how far an object's doors or drawers stand open at the start, 0 to 1 of their range."""
    value = obj.parameters.get("open_fraction", 0.0)
    return float(value) if isinstance(value, int | float) else 0.0


def link_frame(obj: SceneObject, link: str, fraction: float | None = None) -> Array:
    """Returns the (4, 4) pose of an object's link in the world.

    Args:
        obj: The object.
        link: Name of the link.
        fraction: How far the joint that moves it stands open, 0 to 1 of its range; by default as at the start.
    """
    T = transform_from_quaternion(obj.position, obj.orientation)
    joint = next((joint for joint in asset_for(obj).joints if joint.child == link), None)
    if joint is None:
        return T
    return T @ joint_transform(joint, joint.position(open_fraction(obj) if fraction is None else fraction))


def region_frame(obj: SceneObject, region: Region) -> tuple[Array, Array]:
    """Returns the (4, 4) pose of the middle of a region's floor in the world, and the half sides (2,) of that floor."""
    floor = transform(np.eye(3), region.floor_m)
    return link_frame(obj, region.link) @ floor, np.asarray(region.half_extents_m[:2])


def yaw_of(obj: SceneObject) -> float:
    """Returns the heading in rad of an object's own x axis."""
    w, x, y, z = obj.orientation
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
