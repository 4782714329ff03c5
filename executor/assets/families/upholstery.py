"""Upholstered furniture and lamps: armchair, ottoman, double bed, table lamp, floor lamp."""

from __future__ import annotations

import math

from executor.assets.families.controls import CONTROL, SWITCHING, with_control
from executor.assets.families.furniture import bed
from executor.assets.families.shapes import box, cylinder, fixture, round_item, surface
from executor.assets.model import Asset
from executor.assets.parameters import SAME_AS_WIDTH, AssetError, ModelEntry, Range, require_size
from oag import SceneObject
from oag.model.symbols import Kind

_FABRIC, _CUSHION, _FOOT = (0.34, 0.30, 0.26), (0.42, 0.38, 0.33), (0.12, 0.09, 0.07)
_METAL, _SHADE = (0.20, 0.19, 0.18), (0.82, 0.76, 0.62)
_ROOM_M = 0.30
_ARM_M, _BACK_M, _SEAT_M, _ARM_HEIGHT_M = 0.12, 0.16, 0.42, 0.60
_FEET_M, _FOOT_M = 0.06, 0.05
_BASE_M, _STEM_M, _SHADE_SHARE, _BASE_SHARE = 0.02, 0.012, 0.45, 0.6
_LAMP_KG_M3 = 300.0
_BLOCK_M, _SWITCH_M, _ROOM_FOR_SWITCH_M = 0.12, 0.075, 0.04


def armchair(obj: SceneObject) -> Asset:
    """Return an armchair: a seat between two arms, before a back (+x)."""
    x, y, z = (length / 2 for length in require_size(obj, (0.50, 0.50, 0.65)))
    sitting, arm, back, side = -z + _SEAT_M, -z + _ARM_HEIGHT_M, x - _BACK_M, y - _ARM_M
    shapes = (
        box((-x, -y, -z), (x, -side, arm), _FABRIC),
        box((-x, side, -z), (x, y, arm), _FABRIC),
        box((back, -side, -z), (x, side, z), _FABRIC),
        box((-x + 0.02, -side, -z), (back, side, sitting), _CUSHION),
    )
    place = surface("armchair", (back + x) / 2, side, sitting, x_m=(back - x) / 2, room_m=_ROOM_M)
    return fixture(obj, "armchair", shapes, obj.extent_m, "armchair.n.01", place)


def ottoman(obj: SceneObject) -> Asset:
    """Return an ottoman: an upholstered block on four short feet."""
    x, y, z = (length / 2 for length in require_size(obj, (0.25, 0.25, 0.25)))
    feet = [
        box((left, near, -z), (left + _FOOT_M, near + _FOOT_M, -z + _FEET_M), _FOOT)
        for left in (-x, x - _FOOT_M)
        for near in (-y, y - _FOOT_M)
    ]
    block = box((-x, -y, -z + _FEET_M), (x, y, z), _CUSHION)
    return fixture(obj, "ottoman", (*feet, block), obj.extent_m, "ottoman.n.03", surface("ottoman", x, y, z))


def lamp(obj: SceneObject) -> Asset:
    """Return a lamp: a shade on a stem, on a round base. One hand does not close around the shade."""
    length, width, height = require_size(obj, (0.10, 0.10, 0.20))
    radius, z = min(length, width) / 2, height / 2
    if CONTROL.read(obj) != "none":
        return _switched_lamp(obj, radius, z)
    shade = -z + (1.0 - _SHADE_SHARE) * height if obj.kind is Kind.ITEM else z - min(_SHADE_SHARE * height, 0.35)
    shapes = (
        cylinder(_BASE_SHARE * radius, -z, -z + _BASE_M, color=_METAL, density_kg_m3=4 * _LAMP_KG_M3),
        cylinder(_STEM_M, -z + _BASE_M, shade, color=_METAL, density_kg_m3=_LAMP_KG_M3),
        cylinder(radius, shade, z, color=_SHADE, density_kg_m3=_LAMP_KG_M3 / 6),
    )
    if obj.kind is Kind.ITEM:
        return round_item(obj, "lamp", shapes, radius, height, "lamp.n.02", closes_around=False)
    side = radius / math.sqrt(2.0)
    return fixture(obj, "lamp", shapes, (2 * radius, 2 * radius, height), "lamp.n.02", surface("lamp", side, side, z))


def _switched_lamp(obj: SceneObject, radius: float, z: float) -> Asset:
    """Return a lamp with a button or knob at the front of the block that it stands on."""
    if obj.kind is Kind.ITEM:
        raise AssetError(obj, "it has a button or a knob, and would slide away from the hand", 'expected "fixed": true')
    require_size(obj, (0.16, 0.16, 0.28))
    side, shade = radius - _ROOM_FOR_SWITCH_M, -z + max(_BLOCK_M + 0.04, (2.0 - 2.0 * _SHADE_SHARE) * z)
    shapes = (
        box((-side, -side, -z), (side, side, -z + _BLOCK_M), _FOOT),
        cylinder(_STEM_M, -z + _BLOCK_M, shade, color=_METAL),
        cylinder(radius, shade, z, color=_SHADE),
    )
    asset = fixture(obj, "lamp", shapes, (2 * radius, 2 * radius, 2 * z), "lamp.n.02")
    return with_control(obj, asset, (-side, 0.0, -z + _SWITCH_M), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


MODELS = (
    ModelEntry(
        "armchair_upholstered",
        "armchair",
        "armchair.n.01",
        armchair,
        Range(0.65, 0.95),
        Range(0.62, 1.00),
        Range(0.70, 1.05),
    ),
    ModelEntry("ottoman", "ottoman", "ottoman.n.03", ottoman, Range(0.40, 0.90), Range(0.40, 0.75), Range(0.35, 0.50)),
    ModelEntry("bed_double", "bed", "bed.n.01", bed, Range(1.95, 2.15), Range(1.40, 2.00), Range(0.80, 1.20)),
    ModelEntry(
        "lamp_on_stem",
        "lamp",
        "lamp.n.02",
        lamp,
        SAME_AS_WIDTH,
        Range(0.18, 0.30),
        Range(0.35, 0.70),
        SWITCHING,
    ),
)
FAMILIES = {"armchair": armchair, "ottoman": ottoman, "lamp": lamp}
