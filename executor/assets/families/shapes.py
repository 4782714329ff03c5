"""Shapes, regions and simple assets, built from the lengths that the model families compute."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from executor.assets.model import Asset, Link, Quaternion, Region, Rim, Shape, Vector
from oag import SceneObject

Color = tuple[float, ...]
Profile = Sequence[tuple[float, float]]
GREY = (0.7, 0.7, 0.7)
UP: Vector = (0.0, 0.0, 1.0)
SEGMENTS = 40  # A full turn looks round from arm's length.
ROOM_ABOVE_M = 0.40  # As high as what is put on furniture may be.
_SQUARE_M = 1e-3


def box(
    low: Sequence[float],
    high: Sequence[float],
    color: Color,
    *,
    friction: float = 0.8,
    density_kg_m3: float = 1000.0,
    collides: bool = True,
    visible: bool = True,
) -> Shape:
    """Return an axis-aligned box between two corners of the link frame, in metres."""
    x, y, z = ((a + b) / 2 for a, b in zip(low, high, strict=True))
    return Shape(
        kind="box",
        size_m=tuple((b - a) / 2 for a, b in zip(low, high, strict=True)),
        position_m=(x, y, z),
        color=color,
        friction=friction,
        density_kg_m3=density_kg_m3,
        collides=collides,
        visible=visible,
    )


def cylinder(
    radius_m: float,
    low_m: float,
    high_m: float,
    *,
    color: Color = GREY,
    friction: float = 0.8,
    density_kg_m3: float = 1000.0,
    visible: bool = True,
) -> Shape:
    """Return an upright cylinder about the link's z axis, between two heights."""
    return Shape(
        kind="cylinder",
        size_m=(radius_m, (high_m - low_m) / 2),
        position_m=(0.0, 0.0, (low_m + high_m) / 2),
        color=color,
        friction=friction,
        density_kg_m3=density_kg_m3,
        visible=visible,
    )


def shell(
    *,
    foot_m: float,
    low_m: float,
    thick_m: float,
    pieces: int,
    piece_m: tuple[float, float],
    middle_m: tuple[float, float],
    reach_m: float,
    pitch_rad: float,
    friction: float,
    density_kg_m3: float,
) -> tuple[Shape, ...]:
    """Return the collision shapes of a round hollow object: a disc as its floor, and a ring of flat pieces as its wall.

    Args:
        low_m: Height of the floor's underside.
        pieces: Number of wall pieces; the first one faces +x.
        piece_m: Size of a piece across the ring and upwards, before it leans.
        middle_m: Centre of a piece: its distance from the z axis, and its height.
        reach_m: Radius at which neighbouring pieces meet.
        pitch_rad: Outward lean of the pieces.
        friction, density_kg_m3: Of all shapes.
    """
    floor = Shape(
        kind="cylinder",
        size_m=(foot_m, thick_m / 2),
        position_m=(0.0, 0.0, low_m + thick_m / 2),
        friction=friction,
        density_kg_m3=density_kg_m3,
        visible=False,
    )
    across, upwards = piece_m
    (middle, height), half_width = middle_m, reach_m * math.tan(math.pi / pieces)
    walls = (
        Shape(
            kind="box",
            size_m=(across / 2, half_width, upwards / 2),
            position_m=(middle * math.cos(angle), middle * math.sin(angle), height),
            orientation=yaw_then_pitch(angle, pitch_rad),
            friction=friction,
            density_kg_m3=density_kg_m3,
            visible=False,
        )
        for angle in (2 * math.pi * index / pieces for index in range(pieces))
    )
    return floor, *walls


def yaw_then_pitch(about_z_rad: float, then_about_y_rad: float) -> Quaternion:
    """Return the quaternion w x y z of a turn about z followed by one about the new y."""
    cz, sz = math.cos(about_z_rad / 2), math.sin(about_z_rad / 2)
    if then_about_y_rad == 0.0:
        return (cz, 0.0, 0.0, sz)
    cy, sy = math.cos(then_about_y_rad / 2), math.sin(then_about_y_rad / 2)
    return (cz * cy, -sz * sy, cz * sy, sz * cy)


def edged(*points: tuple[float, float]) -> list[Profile]:
    """Return profiles for `revolved` through points of (radius_m, z_m), with an edge at each of them."""
    return list(pairwise(points))


def revolved(profiles: Sequence[Profile], color: Color, segments: int = SEGMENTS) -> Shape:
    """Return a visual mesh: profiles revolved about the link's z axis.

    Args:
        profiles: Polylines of (radius_m, z_m). Walking along one, the outside of the body lies to the right of the
            direction of travel (up the outer wall, then down the inner one). Shading is smooth along one polyline and
            has an edge between two.
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
                here, neighbor = first + row * segments + step, first + row * segments + (step + 1) % segments
                above, diagonal = here + segments, neighbor + segments
                if profile[row][0] > 0:
                    triangles.append((here, neighbor, diagonal))
                if profile[row + 1][0] > 0:
                    triangles.append((here, diagonal, above))
    return Shape(kind="mesh", color=color, collides=False, vertices_m=tuple(vertices), triangles=tuple(triangles))


def open_top(link: str, half_m: Vector, wall_m: float, board: Callable[..., Shape]) -> tuple[tuple[Shape, ...], Region]:
    """Return the boards of a box without a lid, and its hollow.

    Args:
        half_m: Half of its sides.
        board: Makes a board between two corners.
    """
    (x, y, z), t = half_m, wall_m
    boards = (
        board((-x, -y, -z), (x, y, -z + t)),
        board((-x, -y, -z + t), (-x + t, y, z)),
        board((x - t, -y, -z + t), (x, y, z)),
        board((-x + t, -y, -z + t), (x - t, -y + t, z)),
        board((-x + t, y - t, -z + t), (x - t, y, z)),
    )
    return boards, Region("hollow", "interior", link, (0.0, 0.0, t / 2), (x - t, y - t, z - t / 2), UP)


def surface(
    link: str, half_x_m: float, half_y_m: float, level_m: float, *, x_m: float = 0.0, room_m: float = ROOM_ABOVE_M
) -> Region:
    """Return the region on a flat top, in the link frame.

    Args:
        level_m: Height of the top.
        x_m: Centre of the top along x; along y it is 0.
        room_m: Height of the region above it.
    """
    return Region("top", "surface", link, (x_m, 0.0, level_m + room_m / 2), (half_x_m, half_y_m, room_m / 2), UP)


def fixture(
    obj: SceneObject, link: str, shapes: Sequence[Shape], extent_m: Vector, synset: str, *regions: Region
) -> Asset:
    """Return a static piece of furniture."""
    return Asset(obj.category, "static", (Link(link, tuple(shapes)),), extent_m, regions=regions, synset=synset)


def round_item(
    obj: SceneObject,
    link: str,
    shapes: Sequence[Shape],
    radius_m: float,
    height_m: float,
    synset: str,
    *,
    regions: tuple[Region, ...] = (),
    rim: Rim | None = None,
    closes_around: bool = True,
) -> Asset:
    """Return an item that is round about z.

    Args:
        link: Name of its only link.
    """
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link(link, tuple(shapes)),),
        extent_m=(2 * radius_m, 2 * radius_m, height_m),
        regions=regions,
        symmetric_about_z=True,
        graspable_width_m=2 * radius_m if closes_around else None,
        synset=synset,
        rim=rim,
    )


def box_item(
    obj: SceneObject, link: str, shapes: Sequence[Shape], extent_m: Vector, synset: str, *regions: Region
) -> Asset:
    """Return a box-shaped item: fingers close across its shorter side, or along both sides of a square."""
    x, y, _ = extent_m
    axes: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link(link, tuple(shapes)),),
        extent_m=extent_m,
        regions=regions,
        graspable_width_m=min(x, y),
        synset=synset,
        grasp_axes=axes if abs(x - y) < _SQUARE_M else axes[:1] if x < y else axes[1:],
    )
