"""Upright round containers, such as cups and mugs: a floor and a ring of wall pieces, so that they hold things."""

from __future__ import annotations

import math

from executor.assets.model import Region, Rim, Shape
from executor.assets.shapes import revolved

WALL_PIECES = 12
Color = tuple[float, ...]


def vessel_shapes(
    radius_m: float, low_m: float, high_m: float, wall_m: float, density_kg_m3: float, friction: float
) -> list[Shape]:
    """Returns what physics sees of an upright hollow cylinder whose flats touch the given radius."""
    floor = Shape(
        kind="cylinder",
        size_m=(radius_m - wall_m, wall_m / 2),
        position_m=(0.0, 0.0, low_m + wall_m / 2),
        friction=friction,
        density_kg_m3=density_kg_m3,
        visible=False,
    )
    half_width = radius_m * math.tan(math.pi / WALL_PIECES)
    middle = radius_m - wall_m / 2
    walls = [
        Shape(
            kind="box",
            size_m=(wall_m / 2, half_width, (high_m - low_m) / 2),
            position_m=(middle * math.cos(angle), middle * math.sin(angle), (low_m + high_m) / 2),
            orientation=(math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)),
            friction=friction,
            density_kg_m3=density_kg_m3,
            visible=False,
        )
        for angle in (2 * math.pi * index / WALL_PIECES for index in range(WALL_PIECES))
    ]
    return [floor, *walls]


def hollow(link: str, radius_m: float, low_m: float, high_m: float, wall_m: float) -> Region:
    """Returns the largest upright square prism inside the walls."""
    half = (radius_m - wall_m) / math.sqrt(2.0) - 0.001
    floor = low_m + wall_m
    return Region(
        name="hollow",
        kind="interior",
        link=link,
        center_m=(0.0, 0.0, (floor + high_m) / 2),
        half_extents_m=(half, half, (high_m - floor) / 2),
        opening=(0.0, 0.0, 1.0),
    )


def upright_rim(radius_m: float, low_m: float, high_m: float, wall_m: float) -> Rim:
    """Returns the wall of an upright hollow cylinder, as something to hold."""
    return Rim((0.0, 0.0, high_m), radius_m - wall_m / 2, wall_m, 0.0, high_m - low_m, WALL_PIECES)


def vessel_look(
    radius_m: float, low_m: float, high_m: float, wall_m: float, outside: Color, inside: Color
) -> list[Shape]:
    """Returns what cameras see of it: an outer wall with a rim, and the inner wall in a colour of its own."""
    inner, floor, foot = radius_m - wall_m, low_m + wall_m, 0.93 * radius_m
    step = 0.04 * (high_m - low_m)
    outer = [
        [(0.0, low_m), (foot, low_m)],
        [(foot, low_m), (radius_m, low_m + step), (radius_m, high_m)],
        [(radius_m, high_m), (inner, high_m)],
    ]
    lining = [[(inner, high_m), (inner, floor)], [(inner, floor), (0.0, floor)]]
    return [revolved(outer, outside), revolved(lining, inside)]
