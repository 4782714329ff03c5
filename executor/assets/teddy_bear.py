"""A sitting teddy bear made of balls."""

from __future__ import annotations

from executor.assets.entry import Entry, Option, Span
from executor.assets.model import Asset, Link, Shape, Vector
from executor.assets.parameters import require_size
from executor.assets.shapes import box
from oag import SceneObject

FUR = Option("color", ("brown", "honey", "grey"))
_COLORS = {"brown": (0.30, 0.16, 0.07), "honey": (0.55, 0.34, 0.12), "grey": (0.42, 0.40, 0.38)}
_PAW, _DARK = (0.66, 0.52, 0.36), (0.03, 0.02, 0.02)
_DENSITY_KG_M3 = 150.0
_FRICTION = 0.9
# Radius and centre of every ball for a bear one metre high that sits on z = 0 and faces -x.
_BALLS: tuple[tuple[float, Vector], ...] = (
    (0.260, (0.050, 0.0, 0.280)),
    (0.225, (0.000, 0.0, 0.690)),
    (0.085, (0.020, 0.175, 0.915)),
    (0.085, (0.020, -0.175, 0.915)),
    (0.110, (-0.040, 0.270, 0.420)),
    (0.110, (-0.040, -0.270, 0.420)),
    (0.130, (-0.200, 0.190, 0.130)),
    (0.130, (-0.200, -0.190, 0.130)),
)
_PADS: tuple[tuple[float, Vector], ...] = (
    (0.100, (-0.160, 0.0, 0.640)),
    (0.068, (-0.262, 0.190, 0.130)),
    (0.068, (-0.262, -0.190, 0.130)),
)
_EYES: tuple[tuple[float, Vector], ...] = (
    (0.028, (-0.190, 0.080, 0.745)),
    (0.028, (-0.190, -0.080, 0.745)),
    (0.030, (-0.245, 0.0, 0.665)),
)
_FRONT, _BACK, _SIDE = -0.330, 0.310, 0.380
_SEAT: tuple[Vector, Vector] = ((-0.180, -0.200, 0.0), (0.160, 0.200, 0.100))


def teddy_bear(obj: SceneObject) -> Asset:
    """Returns a bear as high as the object; its other sides follow from that.

    Raises:
        AssetError: When it is too small.
    """
    _, _, height = require_size(obj, (0.03, 0.03, 0.05))
    color = _COLORS[FUR.read(obj)]
    middle = (_FRONT + _BACK) / 2

    def at(point: Vector) -> Vector:
        return ((point[0] - middle) * height, point[1] * height, (point[2] - 0.5) * height)

    def ball(radius: float, center: Vector, paint: tuple[float, ...], *, collides: bool) -> Shape:
        return Shape(
            kind="sphere",
            size_m=(radius * height,),
            position_m=at(center),
            color=paint,
            friction=_FRICTION,
            density_kg_m3=_DENSITY_KG_M3,
            collides=collides,
        )

    seat = box(at(_SEAT[0]), at(_SEAT[1]), color, friction=_FRICTION, density_kg_m3=_DENSITY_KG_M3, visible=False)
    shapes = [
        seat,
        *(ball(radius, center, color, collides=True) for radius, center in _BALLS),
        *(ball(radius, center, _PAW, collides=False) for radius, center in _PADS),
        *(ball(radius, center, _DARK, collides=False) for radius, center in _EYES),
    ]
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("bear", tuple(shapes)),),
        extent_m=((_BACK - _FRONT) * height, 2 * _SIDE * height, height),
        graspable_width_m=2 * _BALLS[1][0] * height,
        synset="teddy.n.01",
        grasp_axes=((0.0, 1.0, 0.0),),
    )


_LENGTH, _WIDTH = 0.64, 0.76
ENTRIES = (
    Entry(
        "teddy_bear",
        "teddy_bear",
        "teddy.n.01",
        teddy_bear,
        Span(_LENGTH / _WIDTH, _LENGTH / _WIDTH, of_width=True),
        Span(0.090, 0.150),
        Span(1 / _WIDTH, 1 / _WIDTH, of_width=True),
        (FUR,),
    ),
)
