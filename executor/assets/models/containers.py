"""What food and drink come in: bottles, a can, a closed carton, and an open box that holds things."""

from __future__ import annotations

from functools import partial

from executor.assets.model import Asset, Region
from executor.assets.parameters import Option, Quantity, require_size
from executor.assets.parts.shapes import UP, box, box_item, cylinder, edged, revolved, round_item
from oag import SceneObject

NECK = Quantity("neck_ratio", 0.40, 0.34, 0.50)
SHOULDER = Quantity("shoulder_ratio", 0.62, 0.55, 0.70)
_GREEN, _CAP, _LABEL = (0.06, 0.26, 0.13), (0.75, 0.72, 0.20), (0.82, 0.80, 0.72)
_AMBER, _WHITE = (0.62, 0.26, 0.03), (0.86, 0.86, 0.85)


def bottle(obj: SceneObject) -> Asset:
    """Returns a drink bottle: a body, a shoulder and a capped neck; its diameter is the smaller horizontal extent."""
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
    """Returns a medicine bottle: a wide cap over an amber body with a label."""
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
        revolved(cap, _WHITE),
        revolved(band, _LABEL),
    )
    return round_item(obj, "bottle", shapes, radius, height, "pill_bottle.n.01")


_CAN_COLORS = {"red": (0.60, 0.05, 0.05), "blue": (0.05, 0.15, 0.50), "green": (0.10, 0.35, 0.12)}
CAN_COLOR = Option("color", tuple(_CAN_COLORS))
_METAL = (0.62, 0.63, 0.65)


def can(obj: SceneObject) -> Asset:
    """Returns a full can, drawn with its tapered ends; its diameter is the smaller horizontal extent."""
    length, width, height = require_size(obj, (0.03, 0.03, 0.04))
    radius, half, rim = min(length, width) / 2, height / 2, 0.05 * height
    solid = cylinder(radius, -half, half, color=_METAL, friction=0.9, density_kg_m3=900.0, visible=False)
    lid = half - 0.02 * height
    below = edged((0.0, -half), (0.88 * radius, -half), (radius, -half + rim))
    above = edged((radius, half - rim), (0.90 * radius, half), (0.85 * radius, lid), (0.0, lid))
    label = revolved(edged((radius, -half + rim), (radius, half - rim)), _CAN_COLORS[CAN_COLOR.read(obj)])
    return round_item(obj, "can", (solid, label, revolved([*below, *above], _METAL)), radius, height, "can.n.01")


_BOX_COLORS = {"cardboard": (0.52, 0.36, 0.20), "blue": (0.12, 0.24, 0.45), "yellow": (0.72, 0.55, 0.10)}
BOX_COLOR = Option("color", tuple(_BOX_COLORS))
BOX_WALL = Quantity("wall_m", 0.005, 0.004, 0.008)
_TAPE = (0.68, 0.60, 0.46)
_TAPE_M = 0.0004


def carton(obj: SceneObject) -> Asset:
    """Returns a closed carton as large as the object."""
    extent = require_size(obj, (0.01, 0.01, 0.01))
    x, y, z = (value / 2 for value in extent)
    color = _BOX_COLORS[BOX_COLOR.read(obj)]
    whole = box((-x, -y, -z), (x, y, z), color, friction=0.8, density_kg_m3=350.0, visible=False)
    look = box((-x, -y, -z), (x, y, z - _TAPE_M), color, collides=False)
    tape = box((-0.999 * x, -0.12 * y, z - 2 * _TAPE_M), (0.999 * x, 0.12 * y, z), _TAPE, collides=False)
    return box_item(obj, "box", (whole, look, tape), extent, "box.n.01")


def open_box(obj: SceneObject) -> Asset:
    """Returns a box without a lid."""
    extent = require_size(obj, (0.03, 0.03, 0.02))
    x, y, z = (value / 2 for value in extent)
    t = BOX_WALL.read(obj)
    board = partial(box, color=_BOX_COLORS[BOX_COLOR.read(obj)], friction=0.8, density_kg_m3=700.0)
    shapes = (
        board((-x, -y, -z), (x, y, -z + t)),
        board((-x, -y, -z + t), (-x + t, y, z)),
        board((x - t, -y, -z + t), (x, y, z)),
        board((-x + t, -y, -z + t), (x - t, -y + t, z)),
        board((-x + t, y - t, -z + t), (x - t, y, z)),
    )
    hollow = Region("hollow", "interior", "box", (0.0, 0.0, t / 2), (x - t, y - t, z - t / 2), UP)
    return box_item(obj, "box", shapes, extent, "box.n.01", hollow)
