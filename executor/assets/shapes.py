"""Small helpers that the families share: boxes, surfaces of revolution, and the frame of a joint axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.assets.model import IDENTITY, Quaternion, Shape, Vector

SEGMENTS = 40
Profile = Sequence[tuple[float, float]]


def box(
    low: Sequence[float],
    high: Sequence[float],
    color: tuple[float, ...],
    *,
    friction: float = 0.8,
    density_kg_m3: float = 1000.0,
    collides: bool = True,
    visible: bool = True,
) -> Shape:
    """Returns an axis-aligned box between two corners of the link frame, in metres."""
    center = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
    half = tuple((b - a) / 2 for a, b in zip(low, high, strict=True))
    return Shape(
        kind="box",
        size_m=half,
        position_m=(center[0], center[1], center[2]),
        color=color,
        friction=friction,
        density_kg_m3=density_kg_m3,
        collides=collides,
        visible=visible,
    )


def revolved(profiles: Sequence[Profile], color: tuple[float, ...], segments: int = SEGMENTS) -> Shape:
    """Returns a visual mesh: profiles turned about the link's z axis.

    Args:
        profiles: Polylines of (radius_m, z_m). Walking along one, the outside of the body lies to the right
            of the direction of travel (up the outer wall, then down the inner one). Shading is smooth along
            one polyline and has an edge between two.
        color: Linear RGB or RGBA.
        segments: How many steps the full turn has.
    """
    vertices: list[Vector] = []
    triangles: list[tuple[int, int, int]] = []
    angles = np.linspace(0.0, 2 * np.pi, segments, endpoint=False)
    for profile in profiles:
        first = len(vertices)
        for radius, height in profile:
            ring = radius * np.cos(angles), radius * np.sin(angles)
            vertices.extend((float(x), float(y), float(height)) for x, y in zip(*ring, strict=True))
        for row in range(len(profile) - 1):
            for step in range(segments):
                here, beside = first + row * segments + step, first + row * segments + (step + 1) % segments
                above, diagonal = here + segments, beside + segments
                if profile[row][0] > 0:
                    triangles.append((here, beside, diagonal))
                if profile[row + 1][0] > 0:
                    triangles.append((here, diagonal, above))
    return Shape(kind="mesh", color=color, collides=False, vertices_m=tuple(vertices), triangles=tuple(triangles))


def vertex_normals(vertices_m: Sequence[Vector], triangles: Sequence[tuple[int, int, int]]) -> NDArray[np.float64]:
    """Returns (N, 3) unit normals, averaged over each vertex's triangles by area."""
    points, faces = np.asarray(vertices_m, float), np.asarray(triangles, int)
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    weighted = np.cross(b - a, c - a)
    normals = np.zeros_like(points)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], weighted)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0, normals / np.maximum(length, 1e-30), [0.0, 0.0, 1.0])


def x_axis_onto(axis: Vector) -> Quaternion:
    """Returns the quaternion w x y z that turns +x, the engine's joint and cylinder axis, onto a unit vector."""
    x, y, z = axis
    if x < -1 + 1e-9:
        return (0.0, 0.0, 0.0, 1.0)
    if x > 1 - 1e-9:
        return IDENTITY
    quaternion = np.array([1.0 + x, 0.0, -z, y])
    w, i, j, k = quaternion / np.linalg.norm(quaternion)
    return (float(w), float(i), float(j), float(k))


def engine_orientation(shape: Shape) -> Quaternion:
    """Returns a shape's orientation w x y z for the engine, whose cylinders lie along x where ours stand along z."""
    if shape.kind != "cylinder":
        return shape.orientation
    ours = Rotation.from_quat(shape.orientation, scalar_first=True)
    w, x, y, z = (ours * Rotation.from_quat(_X_ONTO_Z, scalar_first=True)).as_quat(scalar_first=True)
    return (float(w), float(x), float(y), float(z))


_X_ONTO_Z = x_axis_onto((0.0, 0.0, 1.0))
