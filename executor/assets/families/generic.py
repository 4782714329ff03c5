"""Generic shapes for things that the library has no model of: a box and a cylinder, both also open at the top, a
slab on legs, a slab with a slab that stands up from its back, as an open laptop, a panel on a stand, and an open shelf.

Each takes any size. A thing so keeps its own category, which decides whether it is an item or furniture; fingers close
around the item if it is narrow enough, and things stand on its top or in its hollow.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType

from executor.assets.families.items import straight_cup
from executor.assets.families.shapes import Color, box, box_item, cylinder, fixture, open_top, round_item, surface
from executor.assets.model import Asset, Region, Shape, Vector
from executor.assets.parameters import SAME_AS_WIDTH, ChoiceParameter, ModelEntry, NumericParameter, Range, require_size
from oag import SceneObject
from oag.model.symbols import Kind

THING = "thing"
"""Category of what has no name."""

WITH_BACK, SHELF, PANEL = "generic_slab_with_back", "generic_shelf", "generic_panel_on_stand"

_COLORS: Mapping[str, Color] = {
    "grey": (0.30, 0.30, 0.30),
    "white": (0.80, 0.80, 0.78),
    "black": (0.03, 0.03, 0.03),
    "brown": (0.25, 0.13, 0.06),
    "red": (0.45, 0.05, 0.05),
    "yellow": (0.70, 0.50, 0.08),
    "green": (0.07, 0.30, 0.10),
    "blue": (0.06, 0.14, 0.40),
    "beige": (0.62, 0.48, 0.30),
    "orange": (0.75, 0.25, 0.03),
    "purple": (0.20, 0.07, 0.30),
    "pink": (0.75, 0.30, 0.42),
}
COLOR = ChoiceParameter("color", tuple(_COLORS))
LEAN = NumericParameter("lean", 0.2, 0.0, 0.5)
BOARDS = tuple(NumericParameter(f"board_{number}_share", 0.0, 0.0, 1.0) for number in range(6))
"""Of a shelf: the height of each board in it, in shares of its own; 0 for none."""

_SYNSET, _LINK = "object.n.01", "body"
_LEAST_OPEN_M: Vector = (0.012, 0.012, 0.01)  # Of what has walls around a hollow.
_LEAST_M: Vector = (0.002, 0.002, 0.002)
_FRICTION, _ITEM_KG_M3 = 0.8, 400.0
_WALL_SHARE, _WALL_M = 0.08, (0.001, 0.015)  # Of the shortest side; limits of an open box's wall.
_TOP_SHARE, _TOP_M = 0.12, 0.04  # Of a slab's height; its largest thickness.
_PANEL_SHARE, _CLEAR_SHARE, _FOOT_SHARE, _NECK_SHARE, _FOOT_M = 0.3, 0.25, 0.4, 0.12, 0.015
"""Of a panel on a stand: its thickness and the clearance below it, in shares of length and height; half sides of its
foot and its neck, in shares of half the width; the thickest foot."""

_LEG_SHARE, _LEG_M = 0.15, 0.05  # Of the shorter side; the widest leg.
_BOARD_SHARE, _BOARD_M = 0.04, 0.02  # Thickness of a shelf's boards, in shares of its shortest side; at most.
_SLAB_SHARE, _SLAB_M, _BACK_KG_M3 = 0.1, 0.018, 100.0  # Of length or height; thickness and density as of laptops.


def solid_box(obj: SceneObject) -> Asset:
    """Return a solid box that fills the object's extent."""
    x, y, z = _halves(obj)
    return _made(obj, [_board(obj)((-x, -y, -z), (x, y, z))], surface(_LINK, x, y, z))


def solid_cylinder(obj: SceneObject) -> Asset:
    """Return an upright cylinder; its diameter is the smaller horizontal extent."""
    x, y, z = _halves(obj)
    radius = min(x, y)
    shape = cylinder(radius, -z, z, color=_COLORS[COLOR.read(obj)], friction=_FRICTION, density_kg_m3=_ITEM_KG_M3)
    side = radius / math.sqrt(2.0)
    top = surface(_LINK, side, side, z)
    if obj.kind is Kind.ITEM:
        return round_item(obj, _LINK, [shape], radius, 2 * z, _SYNSET, regions=(top,))
    return fixture(obj, _LINK, [shape], (2 * radius, 2 * radius, 2 * z), _SYNSET, top)


def open_box(obj: SceneObject) -> Asset:
    """Return a box without a lid."""
    x, y, z = _halves(obj)
    t = min(max(2 * _WALL_SHARE * min(x, y, z), _WALL_M[0]), _WALL_M[1], min(x, y, z) / 2)
    return _made(obj, *open_top(_LINK, (x, y, z), t, _board(obj)))


def open_cylinder(obj: SceneObject) -> Asset:
    """Return an upright cylinder without a lid; its diameter is the smaller horizontal extent."""
    x, y, z = (side / 2 for side in require_size(obj, _LEAST_OPEN_M))
    made = straight_cup(obj, min(x, y), 2 * z, _LINK, _SYNSET, _COLORS[COLOR.read(obj)])
    return (
        made
        if obj.kind is Kind.ITEM
        else fixture(obj, _LINK, made.links[0].shapes, made.extent_m, _SYNSET, *made.regions)
    )


def slab_on_legs(obj: SceneObject) -> Asset:
    """Return a slab with a leg below each of its corners."""
    x, y, z = _halves(obj)
    thick = min(2 * _TOP_SHARE * z, _TOP_M)
    leg = min(2 * _LEG_SHARE * min(x, y), _LEG_M)
    board = _board(obj)
    shapes = [board((-x, -y, z - thick), (x, y, z))]
    for left, near in itertools.product((-x, x - leg), (-y, y - leg)):
        shapes.append(board((left, near, -z), (left + leg, near + leg, z - thick)))
    return _made(obj, shapes, surface(_LINK, x, y, z))


def slab_with_back(obj: SceneObject) -> Asset:
    """Return a slab that lies, and one that stands up at its back (+x), and leans back by a share of its length.

    Things stand on the one that lies. The other one is the lighter one: it leans over nothing.
    """
    x, y, z = _halves(obj)
    thick = min(2 * _SLAB_SHARE * min(x, z), _SLAB_M)
    back = x - 2 * x * LEAN.read(obj)
    corners = [(at, side, level) for at, level in ((back, -z), (x, z)) for side in (-y, y)]
    upright = Shape(
        "convex",
        color=_COLORS[COLOR.read(obj)],
        friction=_FRICTION,
        density_kg_m3=_BACK_KG_M3,
        vertices_m=tuple((at - off, side, level) for at, side, level in corners for off in (0.0, thick)),
    )
    front = (back - thick + x) / 2
    top = surface(_LINK, front, y, thick - z, x_m=front - x)
    return _made(obj, [_board(obj)((-x, -y, -z), (back, y, thick - z)), upright], top)


def panel_on_stand(obj: SceneObject) -> Asset:
    """Return an upright panel on a neck and a foot: below it other things are seen, as below a monitor."""
    x, y, z = _halves(obj)
    thick, foot_m = 2 * _PANEL_SHARE * x, min(_FOOT_M, 0.2 * z)
    under = -z + 2 * _CLEAR_SHARE * z
    board, wide, neck = _board(obj), _FOOT_SHARE * y, _NECK_SHARE * y
    shapes = [
        board((-thick / 2, -y, under), (thick / 2, y, z)),
        board((-thick / 2, -neck, -z + foot_m), (thick / 2, neck, under)),
        board((-x, -wide, -z), (x, wide, -z + foot_m)),
    ]
    return _made(obj, shapes, surface(_LINK, thick / 2, y, z))


def open_shelf(obj: SceneObject) -> Asset:
    """Return a shelf that is open at its front (-x), with boards where they are measured: things stand on all of them.

    The lowest board is its bottom, the highest its top.
    """
    x, y, z = _halves(obj)
    t = min(2 * _BOARD_SHARE * min(x, y, z), _BOARD_M)
    board, levels = _board(obj), [t - z]
    for share in sorted(one.read(obj) for one in BOARDS):
        level = 2 * z * share - z
        if levels[-1] + t < level < z - t:
            levels.append(level)
    shapes = [
        board((x - t, -y, -z), (x, y, z)),
        board((-x, -y, -z), (x - t, t - y, z)),
        board((-x, y - t, -z), (x - t, y, z)),
        *(board((-x, t - y, level - t), (x - t, y - t, level)) for level in (*levels, z)),
    ]
    regions = [surface(_LINK, x, y, z)]
    for number, (level, ceiling) in enumerate(itertools.pairwise((*levels, z))):
        middle, half = (level + ceiling - t) / 2, (ceiling - t - level) / 2
        regions.append(
            Region(
                f"board_{number}", "surface", _LINK, (-t / 2, 0.0, middle), (x - t / 2, y - t, half), (-1.0, 0.0, 0.0)
            )
        )
    return _made(obj, shapes, *regions)


def _halves(obj: SceneObject) -> Vector:
    x, y, z = require_size(obj, _LEAST_M)
    return x / 2, y / 2, z / 2


def _board(obj: SceneObject) -> partial[Shape]:
    return partial(box, color=_COLORS[COLOR.read(obj)], friction=_FRICTION, density_kg_m3=_ITEM_KG_M3)


def _made(obj: SceneObject, shapes: Sequence[Shape], *regions: Region) -> Asset:
    """Return an item, or furniture, by the object's kind."""
    x, y, z = _halves(obj)
    extent_m = 2 * x, 2 * y, 2 * z
    make = box_item if obj.kind is Kind.ITEM else fixture
    return make(obj, _LINK, shapes, extent_m, _SYNSET, *regions)


_SIDE, _HEIGHT, _LONG = Range(0.01, 3.0), Range(0.01, 2.5), Range(0.06, 1.0)
GENERIC: Mapping[str, ModelEntry] = MappingProxyType(
    {
        entry.model: entry
        for entry in (
            ModelEntry("generic_box", THING, _SYNSET, solid_box, _SIDE, _SIDE, _HEIGHT, (COLOR,)),
            ModelEntry("generic_cylinder", THING, _SYNSET, solid_cylinder, SAME_AS_WIDTH, _SIDE, _HEIGHT, (COLOR,)),
            ModelEntry("generic_open_box", THING, _SYNSET, open_box, _SIDE, _SIDE, _HEIGHT, (COLOR,)),
            ModelEntry("generic_open_cylinder", THING, _SYNSET, open_cylinder, SAME_AS_WIDTH, _SIDE, _HEIGHT, (COLOR,)),
            ModelEntry("generic_slab_on_legs", THING, _SYNSET, slab_on_legs, _SIDE, _SIDE, _HEIGHT, (COLOR,)),
            ModelEntry(WITH_BACK, THING, _SYNSET, slab_with_back, _LONG, _LONG, _LONG, (COLOR, LEAN)),
            ModelEntry(PANEL, THING, _SYNSET, panel_on_stand, _SIDE, _SIDE, _HEIGHT, (COLOR,)),
            ModelEntry(SHELF, THING, _SYNSET, open_shelf, _SIDE, _SIDE, _HEIGHT, (COLOR, *BOARDS)),
        )
    }
)
"""The generic shapes by the names of their models. They are no part of the library that scenes are drawn from."""
