"""A book that lies flat: covers and spine around the pages."""

from __future__ import annotations

from executor.assets.entry import Entry, Option, Span
from executor.assets.model import Asset, Link
from executor.assets.parameters import require_size
from executor.assets.placing import shorter_sides
from executor.assets.shapes import box
from oag import SceneObject

COLOR = Option("color", ("red", "blue", "green"))
_COLORS = {"red": (0.42, 0.06, 0.06), "blue": (0.07, 0.12, 0.32), "green": (0.06, 0.22, 0.12)}
_PAPER = (0.82, 0.79, 0.70)
_DENSITY_KG_M3 = 400.0
_COVER = 0.10
_SET_BACK = 0.03


def book(obj: SceneObject) -> Asset:
    """Returns a book whose thickness is the object's smallest side; it lies where that is z, and stands otherwise.

    An upright one can be taken between the fingers; a lying one is too wide for them.

    Raises:
        AssetError: When it is too small.
    """
    extent = require_size(obj, (0.008, 0.008, 0.008))
    thin = min(range(3), key=lambda axis: extent[axis])
    spine = 0 if thin != 0 else 1
    half = [value / 2 for value in extent]
    color = _COLORS[COLOR.read(obj)]
    everything = box([-v for v in half], half, color, friction=0.9, density_kg_m3=_DENSITY_KG_M3, visible=False)
    shapes = [everything]
    for sign in (-1.0, 1.0):
        low, high = [-v for v in half], list(half)
        low[thin], high[thin] = sorted((sign * half[thin], sign * half[thin] * (1 - 2 * _COVER)))
        shapes.append(box(low, high, color, collides=False))
    low, high = [v * (2 * _SET_BACK - 1) for v in half], [v * (1 - 2 * _SET_BACK) for v in half]
    low[thin], high[thin] = -half[thin] * (1 - 2 * _COVER), half[thin] * (1 - 2 * _COVER)
    shapes.append(box(low, high, _PAPER, collides=False))
    back_low, back_high = list(low), list(high)
    back_low[spine], back_high[spine] = -half[spine], -half[spine] * (1 - 2 * _SET_BACK)
    for axis in range(3):
        if axis not in (thin, spine):
            back_low[axis], back_high[axis] = -half[axis], half[axis]
    shapes.append(box(back_low, back_high, color, collides=False))
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("book", tuple(shapes)),),
        extent_m=extent,
        graspable_width_m=min(extent[:2]),
        synset="hardback.n.01",
        grasp_axes=shorter_sides(extent),
    )


ENTRIES = (
    Entry(
        "book_upright", "book", "hardback.n.01", book, Span(0.10, 0.13), Span(0.024, 0.042), Span(0.15, 0.19), (COLOR,)
    ),
    Entry(
        "book_lying", "book", "hardback.n.01", book, Span(0.18, 0.24), Span(0.12, 0.16), Span(0.020, 0.045), (COLOR,)
    ),
)
