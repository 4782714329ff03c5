"""A drink bottle and a medicine bottle: a body, a shoulder and a capped neck."""

from __future__ import annotations

from executor.assets.entry import SAME_AS_WIDTH, Entry, Quantity, Span
from executor.assets.model import Asset, Link, Shape
from executor.assets.parameters import require_size
from executor.assets.shapes import revolved
from oag import SceneObject

NECK = Quantity("neck_ratio", 0.40, 0.34, 0.50)
SHOULDER = Quantity("shoulder_ratio", 0.62, 0.55, 0.70)
_FRICTION = 0.9
_PLASTIC_KG_M3, _PILLS_KG_M3 = 700.0, 600.0
_GREEN, _CAP, _LABEL = (0.06, 0.26, 0.13), (0.75, 0.72, 0.20), (0.82, 0.80, 0.72)
# The glass lies a little under its label, so that they are not drawn in one surface.
_UNDER = 0.985
_AMBER, _WHITE = (0.62, 0.26, 0.03), (0.86, 0.86, 0.85)


def bottle(obj: SceneObject) -> Asset:
    """Returns a bottle; its diameter is the smaller horizontal extent.

    Raises:
        AssetError: When it is too small, or a parameter does not make one.
    """
    length, width, height = require_size(obj, (0.03, 0.03, 0.08))
    radius, half = min(length, width) / 2, height / 2
    neck, shoulder = NECK.read(obj) * radius, -half + SHOULDER.read(obj) * height
    throat = shoulder + 0.42 * (half - shoulder)
    parts = [
        _round(radius, -half, shoulder, _PLASTIC_KG_M3),
        _round((radius + neck) / 2, shoulder, throat, _PLASTIC_KG_M3),
        _round(neck, throat, half, _PLASTIC_KG_M3),
    ]
    cap = half - 0.07 * height
    glass = [
        [(0.0, -half), (0.94 * radius, -half)],
        [(0.94 * radius, -half), (_UNDER * radius, -half + 0.02 * height), (_UNDER * radius, shoulder)],
        [
            (_UNDER * radius, shoulder),
            (0.86 * radius, shoulder + 0.4 * (throat - shoulder)),
            (0.85 * neck, throat),
            (0.85 * neck, cap),
        ],
    ]
    top = [[(neck, cap), (neck, half)], [(neck, half), (0.0, half)], [(0.0, cap), (neck, cap)]]
    band = [[(radius, -half + 0.18 * height), (radius, shoulder - 0.12 * height)]]
    look = [revolved(glass, _GREEN), revolved(top, _CAP), revolved(band, _LABEL)]
    return _bottle(obj, radius, height, (*parts, *look), "bottle.n.01")


def medicine_bottle(obj: SceneObject) -> Asset:
    """Returns a medicine bottle: a wide cap over an amber body with a label.

    Raises:
        AssetError: When it is too small.
    """
    length, width, height = require_size(obj, (0.02, 0.02, 0.03))
    radius, half = min(length, width) / 2, height / 2
    seam = half - 0.24 * height
    parts = [_round(0.94 * radius, -half, seam, _PILLS_KG_M3), _round(radius, seam, half, _PILLS_KG_M3)]
    body = [
        [(0.0, -half), (0.88 * radius, -half)],
        [(0.88 * radius, -half), (0.92 * radius, -half + 0.03 * height), (0.92 * radius, seam)],
    ]
    cap = [[(0.0, seam), (radius, seam)], [(radius, seam), (radius, half)], [(radius, half), (0.0, half)]]
    band = [[(0.94 * radius, -half + 0.15 * height), (0.94 * radius, seam - 0.15 * height)]]
    look = [revolved(body, _AMBER), revolved(cap, _WHITE), revolved(band, _LABEL)]
    return _bottle(obj, radius, height, (*parts, *look), "pill_bottle.n.01")


def _bottle(obj: SceneObject, radius: float, height: float, shapes: tuple[Shape, ...], synset: str) -> Asset:
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("bottle", shapes),),
        extent_m=(2 * radius, 2 * radius, height),
        symmetric_about_z=True,
        graspable_width_m=2 * radius,
        synset=synset,
    )


def _round(radius: float, low: float, high: float, density: float) -> Shape:
    return Shape(
        kind="cylinder",
        size_m=(radius, (high - low) / 2),
        position_m=(0.0, 0.0, (low + high) / 2),
        friction=_FRICTION,
        density_kg_m3=density,
        visible=False,
    )


ENTRIES = (
    Entry(
        "bottle", "bottle", "bottle.n.01", bottle, SAME_AS_WIDTH, Span(0.055, 0.075), Span(0.18, 0.26), (NECK, SHOULDER)
    ),
    Entry(
        "medicine_bottle",
        "medicine_bottle",
        "pill_bottle.n.01",
        medicine_bottle,
        SAME_AS_WIDTH,
        Span(0.034, 0.055),
        Span(0.06, 0.10),
    ),
)
