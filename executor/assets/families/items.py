"""Items to carry: tableware, bottles, a can, boxes, fruit, books, a die and a teddy bear.

All tableware but the glass is hollow for physics. Every builder raises AssetError where a size or a parameter does not
fit.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from executor.assets.asset_geometry import shifted
from executor.assets.families.shapes import (
    UP,
    Color,
    box,
    box_item,
    cylinder,
    edged,
    open_top,
    revolved,
    round_item,
    shell,
    surface,
)
from executor.assets.model import Asset, Link, Region, Rim, Shape, Vector
from executor.assets.parameters import AssetError, ChoiceParameter, NumericParameter, require_size
from oag import SceneObject


def water_glass(obj: SceneObject) -> Asset:
    """Return a drinking glass: physics sees a cylinder, cameras a hollow glass that widens towards the rim."""
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
CUP_COLOR = ChoiceParameter("color", tuple(_CUP_COLORS))
_CUP_WALL_M, _CUP_PIECES, _CUP_FRICTION, _CUP_KG_M3 = 0.0035, 12, 0.9, 2000.0
_EAR_PIECES, _EAR_M = 5, 0.009


def cup(obj: SceneObject) -> Asset:
    """Return a cup; its diameter is the smaller horizontal extent."""
    length, width, height = require_size(obj, (0.03, 0.03, 0.03))
    return straight_cup(obj, min(length, width) / 2, height, "cup", "cup.n.01", _CUP_COLORS[CUP_COLOR.read(obj)])


def mug(obj: SceneObject) -> Asset:
    """Return a mug; its width (y) is the body's diameter, and the ear fills the rest of its length towards +x."""
    length, width, height = require_size(obj, (0.03, 0.03, 0.04))
    reach = length - width
    if reach < 1.5 * _EAR_M:
        least = width + 1.5 * _EAR_M
        raise AssetError(obj, f"its x extent is {length:.3f} m", f"the mug's ear needs at least {least:.3f} m")
    color = _CUP_COLORS[CUP_COLOR.read(obj)]
    body = straight_cup(obj, width / 2, height, "mug", "mug.n.04", color)
    link = replace(body.links[0], shapes=(*body.links[0].shapes, *_ear(width / 2, reach, height, color)))
    # The ear belongs to the mug's box, whose middle is therefore beside the axis of the body.
    return replace(
        shifted(replace(body, links=(link,)), (-reach / 2, 0.0, 0.0)),
        extent_m=(length, width, height),
        symmetric_about_z=False,
        grasp_axes=((0.0, 1.0, 0.0),),
        grasp_point_m=(-reach / 2, 0.0, 0.0),
    )


def straight_cup(obj: SceneObject, radius: float, height: float, name: str, synset: str, color: Color) -> Asset:
    """Return a round vessel with an upright wall, which fingers can take at its rim."""
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
_BOWL_PIECES = 16
_BOWL_THICK_M = 0.004
_BOWL_FRICTION = 0.8
_LYING_ROOM_M = 0.10


def bowl(obj: SceneObject) -> Asset:
    """Return an open bowl of tilted wall pieces; its diameter is the smaller horizontal extent."""
    length, width, height = require_size(obj, (0.06, 0.06, 0.025))
    rim, low = min(length, width) / 2, -height / 2
    tilt = math.atan2(rim - 0.54 * rim, height)
    # Wall pieces end inside the bowl's height and rim although they are tilted and have a thickness.
    slant = (height - _BOWL_THICK_M * math.sin(tilt)) / math.cos(tilt)
    middle = rim - _BOWL_THICK_M / 2 * math.cos(tilt) - slant / 2 * math.sin(tilt)
    foot = middle - slant / 2 * math.sin(tilt)
    solid = shell(
        foot_m=foot,
        low_m=low,
        thick_m=_BOWL_THICK_M,
        pieces=_BOWL_PIECES,
        piece_m=(_BOWL_THICK_M, slant),
        middle_m=(middle, 0.0),
        reach_m=rim,
        pitch_rad=tilt,
        friction=_BOWL_FRICTION,
        density_kg_m3=1500.0,
    )
    inner, floor = foot + (rim - foot) / 2 - _BOWL_THICK_M, low + _BOWL_THICK_M
    center, half = (0.0, 0.0, (floor + height / 2) / 2), (inner, inner, (height / 2 - floor) / 2)
    hollow = Region("hollow", "interior", "bowl", center, half, UP)
    top = (0.0, 0.0, slant / 2 * math.cos(tilt))
    edge = Rim(top, middle + slant / 2 * math.sin(tilt), _BOWL_THICK_M, tilt, slant, _BOWL_PIECES)
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

    outer, inner = wall(0.0, low), wall(_BOWL_THICK_M, low + _BOWL_THICK_M)
    outside = [[(0.0, low), outer[0]], outer, [outer[-1], (rim - _BOWL_THICK_M, high)]]
    inside = [inner[::-1], [inner[0], (0.0, low + _BOWL_THICK_M)]]
    return [revolved(outside, (0.86, 0.85, 0.80)), revolved(inside, (0.20, 0.36, 0.50))]


def plate(obj: SceneObject) -> Asset:
    """Return a dinner plate with a raised rim; its diameter is the smaller horizontal extent. Things lie *on* it."""
    length, width, height = require_size(obj, (0.08, 0.08, 0.010))
    rim, low, high = min(length, width) / 2, -height / 2, height / 2
    foot, floor = 0.66 * rim, low + _BOWL_THICK_M
    pitch = math.atan2(height - _BOWL_THICK_M, rim - foot)
    slant = (rim - foot - _BOWL_THICK_M * math.sin(pitch)) / math.cos(pitch)
    middle = rim - (slant * math.cos(pitch) + _BOWL_THICK_M * math.sin(pitch)) / 2
    top = high - (slant * math.sin(pitch) + _BOWL_THICK_M * math.cos(pitch)) / 2
    solid = shell(
        foot_m=foot,
        low_m=low,
        thick_m=_BOWL_THICK_M,
        pieces=_BOWL_PIECES,
        piece_m=(slant, _BOWL_THICK_M),
        middle_m=(middle, top),
        reach_m=rim,
        pitch_rad=-pitch,
        friction=_BOWL_FRICTION,
        density_kg_m3=2000.0,
    )
    outside = edged((0.0, low), (foot, low), (rim, high), (rim - 0.002, high), (foot - 0.004, floor))
    centre = edged((foot - 0.004, floor), (0.0, floor))
    look = (revolved(outside, (0.86, 0.85, 0.81)), revolved(centre, (0.80, 0.80, 0.78)))
    # Things lie in the square within the foot.
    side = foot / math.sqrt(2.0)
    place = surface("plate", side, side, floor, room_m=_LYING_ROOM_M)
    edge_m = (0.0, 0.0, top + slant / 2 * math.sin(pitch))
    edge = Rim(edge_m, middle + slant / 2 * math.cos(pitch), _BOWL_THICK_M, math.pi / 2 - pitch, slant, _BOWL_PIECES)
    return round_item(
        obj, "plate", (*solid, *look), rim, height, "plate.n.04", regions=(place,), rim=edge, closes_around=False
    )


NECK = NumericParameter("neck_ratio", 0.40, 0.34, 0.50)
SHOULDER = NumericParameter("shoulder_ratio", 0.62, 0.55, 0.70)
_GREEN, _CAP, _LABEL = (0.06, 0.26, 0.13), (0.75, 0.72, 0.20), (0.82, 0.80, 0.72)
_AMBER, _CAP_WHITE = (0.62, 0.26, 0.03), (0.86, 0.86, 0.85)


def bottle(obj: SceneObject) -> Asset:
    """Return a drink bottle: a body, a shoulder and a capped neck; its diameter is the smaller horizontal extent."""
    length, width, height = require_size(obj, (0.03, 0.03, 0.08))
    radius, half = min(length, width) / 2, height / 2
    neck, shoulder = NECK.read(obj) * radius, -half + SHOULDER.read(obj) * height
    throat, cap = shoulder + 0.42 * (half - shoulder), half - 0.07 * height
    solid = partial(cylinder, friction=0.9, density_kg_m3=700.0, visible=False)
    parts = [
        solid(radius, -half, shoulder),
        solid((radius + neck) / 2, shoulder, throat),
        solid(neck, throat, half),
    ]
    # The glass lies a little under its label, so that they are not drawn in one surface.
    under = 0.985 * radius
    glass = [
        [(0.0, -half), (0.94 * radius, -half)],
        [(0.94 * radius, -half), (under, -half + 0.02 * height), (under, shoulder)],
        [
            (under, shoulder),
            (0.86 * radius, shoulder + 0.4 * (throat - shoulder)),
            (0.85 * neck, throat),
            (0.85 * neck, cap),
        ],
    ]
    top = [*edged((neck, cap), (neck, half), (0.0, half)), *edged((0.0, cap), (neck, cap))]
    band = edged((radius, -half + 0.18 * height), (radius, shoulder - 0.12 * height))
    look = (revolved(glass, _GREEN), revolved(top, _CAP), revolved(band, _LABEL))
    return round_item(obj, "bottle", (*parts, *look), radius, height, "bottle.n.01")


def medicine_bottle(obj: SceneObject) -> Asset:
    """Return a medicine bottle: a wide cap over an amber body with a label."""
    length, width, height = require_size(obj, (0.02, 0.02, 0.03))
    radius, half = min(length, width) / 2, height / 2
    seam = half - 0.24 * height
    solid = partial(cylinder, friction=0.9, density_kg_m3=600.0, visible=False)
    body = [
        [(0.0, -half), (0.88 * radius, -half)],
        [(0.88 * radius, -half), (0.92 * radius, -half + 0.03 * height), (0.92 * radius, seam)],
    ]
    cap = edged((0.0, seam), (radius, seam), (radius, half), (0.0, half))
    band = edged((0.94 * radius, -half + 0.15 * height), (0.94 * radius, seam - 0.15 * height))
    shapes = (
        solid(0.94 * radius, -half, seam),
        solid(radius, seam, half),
        revolved(body, _AMBER),
        revolved(cap, _CAP_WHITE),
        revolved(band, _LABEL),
    )
    return round_item(obj, "bottle", shapes, radius, height, "pill_bottle.n.01")


_CAN_COLORS = {"red": (0.60, 0.05, 0.05), "blue": (0.05, 0.15, 0.50), "green": (0.10, 0.35, 0.12)}
CAN_COLOR = ChoiceParameter("color", tuple(_CAN_COLORS))
_CAN_METAL = (0.62, 0.63, 0.65)


def can(obj: SceneObject) -> Asset:
    """Return a full can, drawn with its tapered ends; its diameter is the smaller horizontal extent."""
    length, width, height = require_size(obj, (0.03, 0.03, 0.04))
    radius, half, rim = min(length, width) / 2, height / 2, 0.05 * height
    solid = cylinder(radius, -half, half, color=_CAN_METAL, friction=0.9, density_kg_m3=900.0, visible=False)
    lid = half - 0.02 * height
    below = edged((0.0, -half), (0.88 * radius, -half), (radius, -half + rim))
    above = edged((radius, half - rim), (0.90 * radius, half), (0.85 * radius, lid), (0.0, lid))
    label = revolved(edged((radius, -half + rim), (radius, half - rim)), _CAN_COLORS[CAN_COLOR.read(obj)])
    return round_item(obj, "can", (solid, label, revolved([*below, *above], _CAN_METAL)), radius, height, "can.n.01")


_BOX_COLORS = {"cardboard": (0.52, 0.36, 0.20), "blue": (0.12, 0.24, 0.45), "yellow": (0.72, 0.55, 0.10)}
BOX_COLOR = ChoiceParameter("color", tuple(_BOX_COLORS))
BOX_WALL = NumericParameter("wall_m", 0.005, 0.004, 0.008)
_TAPE = (0.68, 0.60, 0.46)
_TAPE_M = 0.0004


def carton(obj: SceneObject) -> Asset:
    """Return a closed carton as large as the object; things can stand on it."""
    extent = require_size(obj, (0.01, 0.01, 0.01))
    x, y, z = (value / 2 for value in extent)
    color = _BOX_COLORS[BOX_COLOR.read(obj)]
    whole = box((-x, -y, -z), (x, y, z), color, friction=0.8, density_kg_m3=350.0, visible=False)
    look = box((-x, -y, -z), (x, y, z - _TAPE_M), color, collides=False)
    tape = box((-0.999 * x, -0.12 * y, z - 2 * _TAPE_M), (0.999 * x, 0.12 * y, z), _TAPE, collides=False)
    return box_item(obj, "box", (whole, look, tape), extent, "box.n.01", surface("box", x, y, z))


def open_box(obj: SceneObject) -> Asset:
    """Return a box without a lid."""
    extent = x, y, z = require_size(obj, (0.03, 0.03, 0.02))
    board = partial(box, color=_BOX_COLORS[BOX_COLOR.read(obj)], friction=0.8, density_kg_m3=700.0)
    shapes, hollow = open_top("box", (x / 2, y / 2, z / 2), BOX_WALL.read(obj), board)
    return box_item(obj, "box", shapes, extent, "box.n.01", hollow)


_RED, _STEM, _FLESH = (0.62, 0.045, 0.035), (0.16, 0.09, 0.03), (0.85, 0.78, 0.55)
_ORANGE, _NAVEL = (0.80, 0.30, 0.02), (0.20, 0.26, 0.05)
_FRUIT_FRICTION = 0.9
_HALF_APPLE_SLICES = 5
_HALF_APPLE_LOWEST_SHARE = 0.65
_HALF_APPLE_EXPONENT = 3.5
"""Exponent of half an apple's profile: 2 would be a dome like half a ball's; apples are fuller."""


def apple(obj: SceneObject) -> Asset:
    """Return an apple: for physics a sphere as high as the object; cameras see dimples and a stem."""
    _, _, height = require_size(obj, (0.02, 0.02, 0.02))
    radius, polar = height / 2, np.linspace(-np.pi / 2, np.pi / 2, 25)
    # Pressed in at both poles, narrower below, with a stem that ends under the sphere's top.
    dimple = 0.22 * np.exp(-(((np.pi / 2 - polar) / 0.42) ** 2))
    dimple += 0.06 * np.exp(-(((np.pi / 2 + polar) / 0.5) ** 2))
    across = radius * np.cos(polar) * (1 - 0.07 * (1 - np.sin(polar)) / 2)
    heights = radius * (np.sin(polar) - np.where(polar > 0, dimple, -dimple))
    body = [(float(max(r, 0.0)), float(z)) for r, z in zip(across, heights, strict=True)]
    body[0], body[-1] = (0.0, body[0][1]), (0.0, body[-1][1])
    thick, low, high = 0.05 * radius, body[-1][1] - 0.05 * radius, 0.98 * radius
    stem = edged((thick, low), (0.8 * thick, high), (0.0, high))
    look = (revolved([body], _RED), revolved(stem, _STEM, segments=10))
    return round_item(obj, "apple", (_ball(radius, _RED, 800.0), *look), radius, height, "apple.n.01")


def orange(obj: SceneObject) -> Asset:
    """Return an orange: a sphere as high as the object."""
    _, _, height = require_size(obj, (0.02, 0.02, 0.02))
    radius, polar = height / 2, np.linspace(-np.pi / 2, np.pi / 2, 25)
    dent = 1.0 - 0.05 * np.exp(-(((np.pi / 2 - polar) / 0.3) ** 2))
    outline = [(float(r), float(z)) for r, z in zip(radius * np.cos(polar), radius * dent * np.sin(polar), strict=True)]
    outline[0], outline[-1] = (0.0, outline[0][1]), (0.0, outline[-1][1])
    top = outline[-1][1]
    higher = top + 0.03 * radius
    navel = edged((0.07 * radius, top - 0.02 * radius), (0.05 * radius, higher), (0.0, higher))
    look = (revolved([outline], _ORANGE), revolved(navel, _NAVEL, segments=10))
    return round_item(obj, "orange", (_ball(radius, _ORANGE, 850.0), *look), radius, height, "orange.n.01")


def _ball(radius: float, color: Color, density: float) -> Shape:
    return Shape("sphere", (radius,), color=color, friction=_FRUIT_FRICTION, density_kg_m3=density, visible=False)


def half_apple(obj: SceneObject) -> Asset:
    """Return half an apple, cut face down: physics sees a stack of discs that fills it."""
    length, width, height = require_size(obj, (0.03, 0.03, 0.012))
    radius = min(length, width) / 2
    discs = []
    for low, high in itertools.pairwise([0.0, *np.linspace(_HALF_APPLE_LOWEST_SHARE, 1.0, _HALF_APPLE_SLICES)]):
        # A disc is as wide as the apple at the disc's middle; the lowest one is as wide as the cut, and so high that
        # the middle of tilted fingers gets hold of its side: with their tips alone they slip over its edge.
        level = 0.0 if low == 0.0 else (low + high) / 2
        discs.append(
            Shape(
                kind="cylinder",
                size_m=(radius * _fullness(level), (high - low) / 2 * height),
                position_m=(0.0, 0.0, ((low + high) / 2 - 0.5) * height),
                friction=_FRUIT_FRICTION,
                density_kg_m3=850.0,
                visible=False,
            )
        )
    angles = np.linspace(0.0, np.pi / 2, 13)
    dome = [(float(radius * _fullness(np.sin(a))), float(-height / 2 + height * np.sin(a))) for a in angles]
    dome[-1] = (0.0, dome[-1][1])
    cut = edged((0.0, -height / 2), (radius, -height / 2))
    shapes = (*discs, revolved([dome], _RED), revolved(cut, _FLESH))
    return round_item(obj, "apple", shapes, radius, height, "half__apple.n.01")


def _fullness(level: float) -> float:
    """Radius of half an apple at a fraction of its height, as a fraction of that of its cut."""
    return float(max(1.0 - level**_HALF_APPLE_EXPONENT, 0.0) ** (1.0 / _HALF_APPLE_EXPONENT))


_BOOK_COLORS = {"red": (0.42, 0.06, 0.06), "blue": (0.07, 0.12, 0.32), "green": (0.06, 0.22, 0.12)}
BOOK_COLOR = ChoiceParameter("color", tuple(_BOOK_COLORS))
_PAPER = (0.82, 0.79, 0.70)
# Of the book's sides: how thick a cover is, and how far the pages stand back from its edge.
_BOOK_COVER, _BOOK_SET_BACK = 0.10, 0.03


def book(obj: SceneObject) -> Asset:
    """Return a book whose thickness is the object's smallest side; it lies if that is z, and stands otherwise.

    An upright one fits between the fingers; a lying one is too wide for them, and things can stand on it.
    """
    extent = require_size(obj, (0.008, 0.008, 0.008))
    thin = min(range(3), key=lambda axis: extent[axis])
    spine = 0 if thin != 0 else 1
    half = [value / 2 for value in extent]
    color = _BOOK_COLORS[BOOK_COLOR.read(obj)]
    shapes = [box([-v for v in half], half, color, friction=0.9, density_kg_m3=400.0, visible=False)]
    for sign in (-1.0, 1.0):
        low, high = [-v for v in half], list(half)
        low[thin], high[thin] = sorted((sign * half[thin], sign * half[thin] * (1 - 2 * _BOOK_COVER)))
        shapes.append(box(low, high, color, collides=False))
    low, high = [v * (2 * _BOOK_SET_BACK - 1) for v in half], [v * (1 - 2 * _BOOK_SET_BACK) for v in half]
    low[thin], high[thin] = -half[thin] * (1 - 2 * _BOOK_COVER), half[thin] * (1 - 2 * _BOOK_COVER)
    shapes.append(box(low, high, _PAPER, collides=False))
    low[spine], high[spine] = -half[spine], -half[spine] * (1 - 2 * _BOOK_SET_BACK)
    (along,) = {0, 1, 2} - {thin, spine}
    low[along], high[along] = -half[along], half[along]
    shapes.append(box(low, high, color, collides=False))
    tops = (surface("book", *half),) if thin == 2 else ()
    return box_item(obj, "book", shapes, extent, "hardback.n.01", *tops)


_IVORY, _DARK = (0.85, 0.83, 0.76), (0.05, 0.05, 0.06)
# Of the body and of the pips.
_DIE_COLORS = {"ivory": (_IVORY, _DARK), "black": (_DARK, _IVORY), "red": ((0.62, 0.06, 0.05), _IVORY)}
DIE_COLOR = ChoiceParameter("color", tuple(_DIE_COLORS))
_PIP_SPREAD, _PIP_SIDE = 0.5, 0.09
_DIE_BODY_SHARE = 0.98
_DIE_FIVE = ((0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
# Face (axis, sign) -> pips in the face's two other axes; opposite faces add up to seven.
_DIE_FACES: dict[tuple[int, int], tuple[tuple[int, int], ...]] = {
    (2, 1): ((0, 0),),
    (2, -1): (*_DIE_FIVE[1:], (1, 0), (-1, 0)),
    (0, 1): ((1, 1), (-1, -1)),
    (0, -1): _DIE_FIVE,
    (1, 1): ((0, 0), (1, 1), (-1, -1)),
    (1, -1): _DIE_FIVE[1:],
}


def die(obj: SceneObject) -> Asset:
    """Return a die with sides as long as the object is high."""
    _, _, side = require_size(obj, (0.010, 0.010, 0.010))
    half = side / 2
    body, dots = _DIE_COLORS[DIE_COLOR.read(obj)]
    cube = box((-half,) * 3, (half,) * 3, body, friction=0.9, density_kg_m3=1200.0, visible=False)
    look = box((-_DIE_BODY_SHARE * half,) * 3, (_DIE_BODY_SHARE * half,) * 3, body, collides=False)
    pips = (_pip(axis, sign, spot, half, dots) for (axis, sign), spots in _DIE_FACES.items() for spot in spots)
    return box_item(obj, "die", (cube, look, *pips), (side, side, side), "die.n.01")


def _pip(axis: int, sign: int, spot: tuple[int, int], half: float, color: Color) -> Shape:
    """Return a square raised slightly above its face, which ends at the object's box."""
    first, second = (other for other in range(3) if other != axis)
    low, high = [0.0] * 3, [0.0] * 3
    low[axis], high[axis] = sorted((sign * 0.9 * half, sign * half))
    for other, place in ((first, spot[0]), (second, spot[1])):
        low[other], high[other] = (half * (_PIP_SPREAD * place + side * _PIP_SIDE * 2) for side in (-1, 1))
    return box(low, high, color, collides=False)


_FUR_COLORS = {"brown": (0.30, 0.16, 0.07), "honey": (0.55, 0.34, 0.12), "grey": (0.42, 0.40, 0.38)}
FUR = ChoiceParameter("color", tuple(_FUR_COLORS))
_PAW, _NOSE = (0.66, 0.52, 0.36), (0.03, 0.02, 0.02)
# Radius and centre of every ball for a bear one metre high that sits on z = 0 and faces -x.
_BEAR_BALLS: tuple[tuple[float, Vector], ...] = (
    (0.260, (0.050, 0.0, 0.280)),
    (0.225, (0.000, 0.0, 0.690)),
    (0.085, (0.020, 0.175, 0.915)),
    (0.085, (0.020, -0.175, 0.915)),
    (0.110, (-0.040, 0.270, 0.420)),
    (0.110, (-0.040, -0.270, 0.420)),
    (0.130, (-0.200, 0.190, 0.130)),
    (0.130, (-0.200, -0.190, 0.130)),
)
_BEAR_PADS: tuple[tuple[float, Vector], ...] = (
    (0.100, (-0.160, 0.0, 0.640)),
    (0.068, (-0.262, 0.190, 0.130)),
    (0.068, (-0.262, -0.190, 0.130)),
)
_BEAR_EYES: tuple[tuple[float, Vector], ...] = (
    (0.028, (-0.190, 0.080, 0.745)),
    (0.028, (-0.190, -0.080, 0.745)),
    (0.030, (-0.245, 0.0, 0.665)),
)
_BEAR_SEAT: tuple[Vector, Vector] = ((-0.180, -0.200, 0.0), (0.160, 0.200, 0.100))
_BEAR_FRONT, _BEAR_BACK, _BEAR_SIDE = -0.330, 0.310, 0.380
# Of a bear: its length and its height in multiples of its width.
BEAR_LENGTH, BEAR_HEIGHT = 0.64 / 0.76, 1 / 0.76


def teddy_bear(obj: SceneObject) -> Asset:
    """Return a sitting bear made of balls, as high as the object; its other sides follow from the height."""
    _, _, height = require_size(obj, (0.03, 0.03, 0.05))
    color = _FUR_COLORS[FUR.read(obj)]
    middle = (_BEAR_FRONT + _BEAR_BACK) / 2

    def at(point: Vector) -> Vector:
        return ((point[0] - middle) * height, point[1] * height, (point[2] - 0.5) * height)

    def ball(radius: float, center: Vector, paint: Color, *, collides: bool) -> Shape:
        size, where = (radius * height,), at(center)
        return Shape("sphere", size, where, color=paint, friction=0.9, density_kg_m3=150.0, collides=collides)

    skin = partial(ball, collides=False)
    shapes = [
        box(at(_BEAR_SEAT[0]), at(_BEAR_SEAT[1]), color, friction=0.9, density_kg_m3=150.0, visible=False),
        *(ball(radius, center, color, collides=True) for radius, center in _BEAR_BALLS),
        *(skin(radius, center, _PAW) for radius, center in _BEAR_PADS),
        *(skin(radius, center, _NOSE) for radius, center in _BEAR_EYES),
    ]
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("bear", tuple(shapes)),),
        extent_m=((_BEAR_BACK - _BEAR_FRONT) * height, 2 * _BEAR_SIDE * height, height),
        graspable_width_m=2 * _BEAR_BALLS[1][0] * height,
        synset="teddy.n.01",
        grasp_axes=((0.0, 1.0, 0.0),),
    )
