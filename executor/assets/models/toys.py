"""What lies about in a living room: a book, a die and a teddy bear."""

from __future__ import annotations

from functools import partial

from executor.assets.model import Asset, Link, Shape, Vector
from executor.assets.parameters import Option, require_size
from executor.assets.parts.shapes import Color, box, box_item
from oag import SceneObject

_BOOK_COLORS = {"red": (0.42, 0.06, 0.06), "blue": (0.07, 0.12, 0.32), "green": (0.06, 0.22, 0.12)}
BOOK_COLOR = Option("color", tuple(_BOOK_COLORS))
_PAPER = (0.82, 0.79, 0.70)
# Of the book's sides: how thick a cover is, and how far the pages stand back from its edge.
_COVER, _SET_BACK = 0.10, 0.03


def book(obj: SceneObject) -> Asset:
    """Returns a book whose thickness is the object's smallest side; it lies where that is z, and stands otherwise.

    An upright one can be taken between the fingers; a lying one is too wide for them.
    """
    extent = require_size(obj, (0.008, 0.008, 0.008))
    thin = min(range(3), key=lambda axis: extent[axis])
    spine = 0 if thin != 0 else 1
    half = [value / 2 for value in extent]
    color = _BOOK_COLORS[BOOK_COLOR.read(obj)]
    shapes = [box([-v for v in half], half, color, friction=0.9, density_kg_m3=400.0, visible=False)]
    for sign in (-1.0, 1.0):
        low, high = [-v for v in half], list(half)
        low[thin], high[thin] = sorted((sign * half[thin], sign * half[thin] * (1 - 2 * _COVER)))
        shapes.append(box(low, high, color, collides=False))
    low, high = [v * (2 * _SET_BACK - 1) for v in half], [v * (1 - 2 * _SET_BACK) for v in half]
    low[thin], high[thin] = -half[thin] * (1 - 2 * _COVER), half[thin] * (1 - 2 * _COVER)
    shapes.append(box(low, high, _PAPER, collides=False))
    low[spine], high[spine] = -half[spine], -half[spine] * (1 - 2 * _SET_BACK)
    (along,) = {0, 1, 2} - {thin, spine}
    low[along], high[along] = -half[along], half[along]
    shapes.append(box(low, high, color, collides=False))
    return box_item(obj, "book", shapes, extent, "hardback.n.01")


_IVORY, _DARK = (0.85, 0.83, 0.76), (0.05, 0.05, 0.06)
# Of the body and of the pips.
_DIE_COLORS = {"ivory": (_IVORY, _DARK), "black": (_DARK, _IVORY), "red": ((0.62, 0.06, 0.05), _IVORY)}
DIE_COLOR = Option("color", tuple(_DIE_COLORS))
_SPREAD, _PIP_SIDE = 0.5, 0.09
_PROUD = 0.98
_FIVE = ((0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
# Face (axis, sign) -> pips in the face's two other axes; opposite faces add up to seven.
_FACES: dict[tuple[int, int], tuple[tuple[int, int], ...]] = {
    (2, 1): ((0, 0),),
    (2, -1): (*_FIVE[1:], (1, 0), (-1, 0)),
    (0, 1): ((1, 1), (-1, -1)),
    (0, -1): _FIVE,
    (1, 1): ((0, 0), (1, 1), (-1, -1)),
    (1, -1): _FIVE[1:],
}


def die(obj: SceneObject) -> Asset:
    """Returns a die with sides as long as the object is high."""
    _, _, side = require_size(obj, (0.010, 0.010, 0.010))
    half = side / 2
    body, dots = _DIE_COLORS[DIE_COLOR.read(obj)]
    cube = box((-half,) * 3, (half,) * 3, body, friction=0.9, density_kg_m3=1200.0, visible=False)
    look = box((-_PROUD * half,) * 3, (_PROUD * half,) * 3, body, collides=False)
    pips = (_pip(axis, sign, spot, half, dots) for (axis, sign), spots in _FACES.items() for spot in spots)
    return box_item(obj, "die", (cube, look, *pips), (side, side, side), "die.n.01")


def _pip(axis: int, sign: int, spot: tuple[int, int], half: float, color: Color) -> Shape:
    """A square that stands a hair proud of its face and ends at the object's box."""
    first, second = (other for other in range(3) if other != axis)
    low, high = [0.0] * 3, [0.0] * 3
    low[axis], high[axis] = sorted((sign * 0.9 * half, sign * half))
    for other, place in ((first, spot[0]), (second, spot[1])):
        low[other], high[other] = (half * (_SPREAD * place + side * _PIP_SIDE * 2) for side in (-1, 1))
    return box(low, high, color, collides=False)


_FUR_COLORS = {"brown": (0.30, 0.16, 0.07), "honey": (0.55, 0.34, 0.12), "grey": (0.42, 0.40, 0.38)}
FUR = Option("color", tuple(_FUR_COLORS))
_PAW, _NOSE = (0.66, 0.52, 0.36), (0.03, 0.02, 0.02)
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
_SEAT: tuple[Vector, Vector] = ((-0.180, -0.200, 0.0), (0.160, 0.200, 0.100))
_FRONT, _BACK, _SIDE = -0.330, 0.310, 0.380
# Of a bear: its length and its height in multiples of its width.
BEAR_LENGTH, BEAR_HEIGHT = 0.64 / 0.76, 1 / 0.76


def teddy_bear(obj: SceneObject) -> Asset:
    """Returns a sitting bear made of balls, as high as the object; its other sides follow from that."""
    _, _, height = require_size(obj, (0.03, 0.03, 0.05))
    color = _FUR_COLORS[FUR.read(obj)]
    middle = (_FRONT + _BACK) / 2

    def at(point: Vector) -> Vector:
        return ((point[0] - middle) * height, point[1] * height, (point[2] - 0.5) * height)

    def ball(radius: float, center: Vector, paint: Color, *, collides: bool) -> Shape:
        size, where = (radius * height,), at(center)
        return Shape("sphere", size, where, color=paint, friction=0.9, density_kg_m3=150.0, collides=collides)

    skin = partial(ball, collides=False)
    shapes = [
        box(at(_SEAT[0]), at(_SEAT[1]), color, friction=0.9, density_kg_m3=150.0, visible=False),
        *(ball(radius, center, color, collides=True) for radius, center in _BALLS),
        *(skin(radius, center, _PAW) for radius, center in _PADS),
        *(skin(radius, center, _NOSE) for radius, center in _EYES),
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
