"""Tableware: a drinking glass, a cup, a mug, a bowl and a plate; all but the glass are hollow for physics."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

from executor.assets.model import Asset, Region, Rim, Shape
from executor.assets.parameters import AssetError, Option, require_size
from executor.assets.parts.shapes import UP, Color, cylinder, edged, revolved, round_item, shell, surface
from executor.assets.transforms import shifted
from oag import SceneObject


def water_glass(obj: SceneObject) -> Asset:
    """Returns a drinking glass: physics sees a cylinder, cameras a hollow glass that widens towards the rim."""
    length, width, height = require_size(obj, (0.02, 0.02, 0.03))
    rim, half = min(length, width) / 2, height / 2
    clear = (0.30, 0.62, 0.88, 0.60)
    solid = cylinder(rim, -half, half, color=clear, friction=0.9, density_kg_m3=600.0, visible=False)
    foot, wall, floor = 0.82 * rim, max(0.0012, 0.06 * rim), -half + 0.09 * half
    profiles = [
        [(0.0, -half), (foot * 0.98, -half)],
        [(foot * 0.98, -half), (foot, -half + 0.02 * half), (rim, half)],
        *edged((rim, half), (rim - wall, half), (foot - wall, floor), (0.0, floor)),
    ]
    return round_item(obj, "glass", (solid, revolved(profiles, clear)), rim, height, "water_glass.n.02")


# Cups and mugs.
_CUP_COLORS = {
    "white": (0.84, 0.83, 0.79),
    "blue": (0.10, 0.22, 0.45),
    "green": (0.16, 0.36, 0.22),
    "red": (0.52, 0.08, 0.07),
}
CUP_COLOR = Option("color", tuple(_CUP_COLORS))
_CUP_WALL_M, _CUP_PIECES, _CUP_FRICTION, _CUP_KG_M3 = 0.0035, 12, 0.9, 2000.0
_EAR_PIECES, _EAR_M = 5, 0.009


def cup(obj: SceneObject) -> Asset:
    """Returns a cup; its diameter is the smaller horizontal extent."""
    length, width, height = require_size(obj, (0.03, 0.03, 0.03))
    return _cup(obj, min(length, width) / 2, height, "cup", "cup.n.01", _CUP_COLORS[CUP_COLOR.read(obj)])


def mug(obj: SceneObject) -> Asset:
    """Returns a mug; its width (y) is the body's diameter, and the ear fills the rest of its length towards +x."""
    length, width, height = require_size(obj, (0.03, 0.03, 0.04))
    reach = length - width
    if reach < 1.5 * _EAR_M:
        least = width + 1.5 * _EAR_M
        raise AssetError(obj, f"its x extent is {length:.3f} m", f"the mug's ear needs at least {least:.3f} m")
    color = _CUP_COLORS[CUP_COLOR.read(obj)]
    body = _cup(obj, width / 2, height, "mug", "mug.n.04", color)
    link = replace(body.links[0], shapes=(*body.links[0].shapes, *_ear(width / 2, reach, height, color)))
    # The ear belongs to the mug's box, whose middle is therefore beside the axis of the body.
    return replace(
        shifted(replace(body, links=(link,)), (-reach / 2, 0.0, 0.0)),
        extent_m=(length, width, height),
        symmetric_about_z=False,
        grasp_axes=((0.0, 1.0, 0.0),),
        grasp_point_m=(-reach / 2, 0.0, 0.0),
    )


def _cup(obj: SceneObject, radius: float, height: float, name: str, synset: str, color: Color) -> Asset:
    low, high, wall = -height / 2, height / 2, _CUP_WALL_M
    inner, floor, foot, step = radius - wall, low + wall, 0.93 * radius, 0.04 * (high - low)
    solid = shell(
        foot_m=inner,
        low_m=low,
        thick_m=wall,
        pieces=_CUP_PIECES,
        piece_m=(wall, high - low),
        middle_m=(radius - wall / 2, (low + high) / 2),
        reach_m=radius,
        pitch_rad=0.0,
        friction=_CUP_FRICTION,
        density_kg_m3=_CUP_KG_M3,
    )
    outer = [
        [(0.0, low), (foot, low)],
        [(foot, low), (radius, low + step), (radius, high)],
        [(radius, high), (inner, high)],
    ]
    lining = edged((inner, high), (inner, floor), (0.0, floor))
    look = (revolved(outer, color), revolved(lining, (0.88, 0.87, 0.84)))
    # The largest upright square prism inside the walls.
    side = inner / math.sqrt(2.0) - 0.001
    middle, half = (0.0, 0.0, (floor + high) / 2), (side, side, (high - floor) / 2)
    hollow = Region("hollow", "interior", name, middle, half, UP)
    rim = Rim((0.0, 0.0, high), radius - wall / 2, wall, 0.0, high - low, _CUP_PIECES)
    return round_item(obj, name, (*solid, *look), radius, height, synset, regions=(hollow,), rim=rim)


def _ear(radius: float, reach: float, height: float, color: Color) -> list[Shape]:
    """Pieces along half an ellipse whose ends are at the wall at +x; the outermost one touches the object's box."""
    half, thick = 0.30 * height, _EAR_M / 2
    angles = [math.pi * (index / _EAR_PIECES - 0.5) for index in range(_EAR_PIECES + 1)]
    widest = max(math.cos(angle) for angle in angles)
    outline = [(radius + (reach - thick) * math.cos(angle) / widest, half * math.sin(angle)) for angle in angles]
    pieces = []
    for (xa, za), (xb, zb) in pairwise(outline):
        turn = math.atan2(xb - xa, zb - za)
        pieces.append(
            Shape(
                kind="box",
                size_m=(thick, thick, math.hypot(xb - xa, zb - za) / 2 + thick / 3),
                position_m=((xa + xb) / 2, 0.0, (za + zb) / 2),
                orientation=(math.cos(turn / 2), 0.0, math.sin(turn / 2), 0.0),
                color=color,
                friction=_CUP_FRICTION,
                density_kg_m3=_CUP_KG_M3,
            )
        )
    return pieces


# Bowls and plates.
_PIECES = 16
_THICK_M = 0.004
_FRICTION = 0.8
_LYING_ROOM_M = 0.10


def bowl(obj: SceneObject) -> Asset:
    """Returns an open bowl of tilted wall pieces; its diameter is the smaller horizontal extent."""
    length, width, height = require_size(obj, (0.06, 0.06, 0.025))
    rim, low = min(length, width) / 2, -height / 2
    tilt = math.atan2(rim - 0.54 * rim, height)
    # Wall pieces end inside the bowl's height and rim although they are tilted and have a thickness.
    slant = (height - _THICK_M * math.sin(tilt)) / math.cos(tilt)
    middle = rim - _THICK_M / 2 * math.cos(tilt) - slant / 2 * math.sin(tilt)
    foot = middle - slant / 2 * math.sin(tilt)
    solid = shell(
        foot_m=foot,
        low_m=low,
        thick_m=_THICK_M,
        pieces=_PIECES,
        piece_m=(_THICK_M, slant),
        middle_m=(middle, 0.0),
        reach_m=rim,
        pitch_rad=tilt,
        friction=_FRICTION,
        density_kg_m3=1500.0,
    )
    inner, floor = foot + (rim - foot) / 2 - _THICK_M, low + _THICK_M
    center, half = (0.0, 0.0, (floor + height / 2) / 2), (inner, inner, (height / 2 - floor) / 2)
    hollow = Region("hollow", "interior", "bowl", center, half, UP)
    top = (0.0, 0.0, slant / 2 * math.cos(tilt))
    edge = Rim(top, middle + slant / 2 * math.sin(tilt), _THICK_M, tilt, slant, _PIECES)
    shapes = (*solid, *_bowl_look(foot, rim, height))
    return round_item(obj, "bowl", shapes, rim, height, "bowl.n.01", regions=(hollow,), rim=edge, closes_around=False)


def _bowl_look(foot: float, rim: float, height: float) -> list[Shape]:
    """A rounded wall between foot and rim: porcelain outside, glazed inside."""
    low, high = -height / 2, height / 2
    steps = [index / 12 for index in range(13)]

    def wall(inset: float, bottom: float) -> list[tuple[float, float]]:
        # A quarter of an ellipse bulges outwards; a third of it keeps the wall near the physical one.
        return [
            (
                foot + (rim - foot) * (0.65 * t + 0.35 * math.sin(t * math.pi / 2)) - inset,
                bottom + (high - bottom) * (0.65 * t + 0.35 * (1 - math.cos(t * math.pi / 2))),
            )
            for t in steps
        ]

    outer, inner = wall(0.0, low), wall(_THICK_M, low + _THICK_M)
    outside = [[(0.0, low), outer[0]], outer, [outer[-1], (rim - _THICK_M, high)]]
    inside = [inner[::-1], [inner[0], (0.0, low + _THICK_M)]]
    return [revolved(outside, (0.86, 0.85, 0.80)), revolved(inside, (0.20, 0.36, 0.50))]


def plate(obj: SceneObject) -> Asset:
    """Returns a dinner plate with a raised rim; its diameter is the smaller horizontal extent. Things lie *on* it."""
    length, width, height = require_size(obj, (0.08, 0.08, 0.010))
    rim, low, high = min(length, width) / 2, -height / 2, height / 2
    foot, floor = 0.66 * rim, low + _THICK_M
    pitch = math.atan2(height - _THICK_M, rim - foot)
    slant = (rim - foot - _THICK_M * math.sin(pitch)) / math.cos(pitch)
    middle = rim - (slant * math.cos(pitch) + _THICK_M * math.sin(pitch)) / 2
    top = high - (slant * math.sin(pitch) + _THICK_M * math.cos(pitch)) / 2
    solid = shell(
        foot_m=foot,
        low_m=low,
        thick_m=_THICK_M,
        pieces=_PIECES,
        piece_m=(slant, _THICK_M),
        middle_m=(middle, top),
        reach_m=rim,
        pitch_rad=-pitch,
        friction=_FRICTION,
        density_kg_m3=2000.0,
    )
    outside = edged((0.0, low), (foot, low), (rim, high), (rim - 0.002, high), (foot - 0.004, floor))
    centre = edged((foot - 0.004, floor), (0.0, floor))
    look = (revolved(outside, (0.86, 0.85, 0.81)), revolved(centre, (0.80, 0.80, 0.78)))
    # Things lie in the square within the foot.
    side = foot / math.sqrt(2.0)
    place = surface("plate", side, side, floor, room_m=_LYING_ROOM_M)
    edge_m = (0.0, 0.0, top + slant / 2 * math.sin(pitch))
    edge = Rim(edge_m, middle + slant / 2 * math.cos(pitch), _THICK_M, math.pi / 2 - pitch, slant, _PIECES)
    return round_item(
        obj, "plate", (*solid, *look), rim, height, "plate.n.04", regions=(place,), rim=edge, closes_around=False
    )
