"""A die with its pips."""

from __future__ import annotations

from executor.assets.entry import SAME_AS_WIDTH, Entry, Option, Span
from executor.assets.fronts import Color
from executor.assets.model import Asset, Link, Shape
from executor.assets.parameters import require_size
from executor.assets.placing import shorter_sides
from executor.assets.shapes import box
from oag import SceneObject

COLOR = Option("color", ("ivory", "black", "red"))
_IVORY, _DARK = (0.85, 0.83, 0.76), (0.05, 0.05, 0.06)
# Of the body and of the pips.
_COLORS = {"ivory": (_IVORY, _DARK), "black": (_DARK, _IVORY), "red": ((0.62, 0.06, 0.05), _IVORY)}
_DENSITY_KG_M3 = 1200.0
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
    """Returns a die with sides as long as the object is high.

    Raises:
        AssetError: When it is too small, or of a colour that there is not.
    """
    _, _, side = require_size(obj, (0.010, 0.010, 0.010))
    half = side / 2
    body, dots = _COLORS[COLOR.read(obj)]
    cube = box((-half,) * 3, (half,) * 3, body, friction=0.9, density_kg_m3=_DENSITY_KG_M3, visible=False)
    look = box((-_PROUD * half,) * 3, (_PROUD * half,) * 3, body, collides=False)
    pips = tuple(_pip(axis, sign, spot, half, dots) for (axis, sign), spots in _FACES.items() for spot in spots)
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("die", (cube, look, *pips)),),
        extent_m=(side, side, side),
        graspable_width_m=side,
        synset="die.n.01",
        grasp_axes=shorter_sides((side, side, side)),
    )


def _pip(axis: int, sign: int, spot: tuple[int, int], half: float, color: Color) -> Shape:
    """A square that stands a hair proud of its face and ends at the object's box."""
    first, second = (other for other in range(3) if other != axis)
    low, high = [0.0] * 3, [0.0] * 3
    low[axis], high[axis] = sorted((sign * 0.9 * half, sign * half))
    for other, place in ((first, spot[0]), (second, spot[1])):
        low[other], high[other] = (half * (_SPREAD * place + side * _PIP_SIDE * 2) for side in (-1, 1))
    return box(low, high, color, collides=False)


ENTRIES = (Entry("die", "die", "die.n.01", die, SAME_AS_WIDTH, Span(0.030, 0.055), SAME_AS_WIDTH, (COLOR,)),)
