"""Furniture without doors: tables, a counter, shelves, beds, sofas, chairs; the walls and the floor around it."""

from __future__ import annotations

from dataclasses import replace

from executor.assets.model import Asset
from executor.assets.parameters import Quantity, number, require_size
from executor.assets.parts.casework import assemble, plinth, slab, top_of
from executor.assets.parts.layout import NO_GRIP, Case, Column, Compartment
from executor.assets.parts.shapes import box, cylinder, fixture, surface
from oag import SceneObject

BOARDS = Quantity("boards", 2, 1, 4, whole=True)
TOP_THICKNESS = Quantity("top_thickness_m", 0.030, 0.020, 0.045)
_PINE, _WHITE, _GREY = (0.62, 0.45, 0.27), (0.78, 0.77, 0.74), (0.55, 0.56, 0.56)
_WOOD, _DARK_WOOD = (0.48, 0.29, 0.15), (0.33, 0.19, 0.09)
_LEG_M, _INSET_M = 0.045, 0.010
_BELOW_GROUND_M = 0.08  # Farther than the engine reports contacts from.


def table(obj: SceneObject) -> Asset:
    """Returns a table: one top on four legs; `top_thickness_m` may be more than the library draws."""
    extent = require_size(obj, (0.20, 0.20, 0.15))
    x, y, z = (length / 2 for length in extent)
    under = z - number(obj, "top_thickness_m", 0.030, 0.010, 0.10)
    shapes = [box((-x, -y, under), (x, y, z), _WOOD)]
    for side_x in (-1.0, 1.0):
        for side_y in (-1.0, 1.0):
            corner_x, corner_y = side_x * (x - _INSET_M), side_y * (y - _INSET_M)
            inner_x, inner_y = corner_x - side_x * _LEG_M, corner_y - side_y * _LEG_M
            low = (min(corner_x, inner_x), min(corner_y, inner_y), -z)
            shapes.append(box(low, (low[0] + _LEG_M, low[1] + _LEG_M, under), _DARK_WOOD))
    return fixture(obj, "table", shapes, extent, "table.n.02", surface("table", x, y, z))


def round_table(obj: SceneObject) -> Asset:
    """Returns a round table on one leg; its place is the square inside the round top."""
    length, width, height = require_size(obj, (0.40, 0.40, 0.30))
    radius, half, top = min(length, width) / 2, height / 2, TOP_THICKNESS.read(obj)
    foot, inner = -half + 0.025, 0.70 * radius
    shapes = (
        cylinder(radius, half - top, half, color=_PINE),
        cylinder(0.045, foot, half - top, color=_GREY),
        cylinder(0.55 * radius, -half, foot, color=_GREY),
    )
    extent = (2 * radius, 2 * radius, height)
    place = surface("table", inner, inner, half)
    return replace(fixture(obj, "table", shapes, extent, "pedestal_table.n.01", place), symmetric_about_z=True)


def counter(obj: SceneObject) -> Asset:
    """Returns a counter: a solid body under a stone top, without anything that opens."""
    extent = require_size(obj, (0.35, 0.35, 0.50))
    case = Case(extent, (), NO_GRIP, base_m=0.09, top_m=TOP_THICKNESS.read(obj))
    (x0, x1), (z0, z1), y = case.x, case.z, extent[1] / 2
    shapes = (
        box((x0 + 0.03, -y + 0.004, z0), (x1 - 0.004, y - 0.004, z1), _WHITE),
        box((x0 + 0.08, -y + 0.014, -extent[2] / 2), (x1 - 0.014, y - 0.014, z0), _GREY),
        slab(case, 0.0),
    )
    return fixture(obj, "body", shapes, extent, "countertop.n.01", top_of(case))


def shelf(obj: SceneObject) -> Asset:
    """Returns an open bookcase; things stand on its boards, and on its top."""
    extent = require_size(obj, (0.22, 0.40, 0.50))
    column = Column((Compartment("board", "open", shelves=BOARDS.count(obj)),))
    case = Case(extent, (column,), NO_GRIP, base_m=0.05, body=_PINE, inner=_PINE, niche="surface")
    return assemble(case, obj.category, "shelf.n.01", extra=[plinth(case)], surfaces=[top_of(case)])


_HEADBOARD_M, _ARM_M, _BACK_M, _POST_M = 0.05, 0.14, 0.16, 0.04
_LYING_ROOM_M = 0.30
_FRAME, _LINEN, _BLANKET, _PILLOW = (0.36, 0.22, 0.12), (0.80, 0.79, 0.76), (0.35, 0.42, 0.50), (0.86, 0.85, 0.82)
_FABRIC, _CUSHION, _CHAIR = (0.40, 0.43, 0.46), (0.47, 0.50, 0.53), (0.50, 0.33, 0.18)


def bed(obj: SceneObject) -> Asset:
    """Returns a bed: its headboard at the back (+x), a mattress with a blanket and a pillow."""
    x, y, z = (length / 2 for length in require_size(obj, (1.20, 0.60, 0.60)))
    frame, lying, head = -z + 0.26, -z + 0.44, x - _HEADBOARD_M
    shapes = (
        box((head, -y, -z), (x, y, z), _FRAME),
        box((-x, -y, -z + 0.08), (head, y, frame), _FRAME),
        box((-x + 0.06, -y + 0.06, -z), (head, y - 0.06, -z + 0.08), _FRAME),
        box((-x + 0.02, -y + 0.02, frame), (head, y - 0.02, lying), _LINEN),
        box((-x + 0.01, -y + 0.01, frame + 0.02), (head - 0.62, y - 0.01, lying + 0.004), _BLANKET, collides=False),
        box((head - 0.42, -0.32, lying), (head - 0.04, 0.32, lying + 0.08), _PILLOW),
    )
    low, high = -x + 0.02, head - 0.44
    place = surface("bed", (high - low) / 2, y - 0.02, lying, x_m=(low + high) / 2, room_m=_LYING_ROOM_M)
    return fixture(obj, "bed", shapes, obj.extent_m, "bed.n.01", place)


def sofa(obj: SceneObject) -> Asset:
    """Returns a sofa: a seat between two arms, before a back."""
    x, y, z = (length / 2 for length in require_size(obj, (0.60, 0.90, 0.60)))
    sitting, arm, back = -z + 0.42, -z + 0.58, x - _BACK_M
    low, side = -x + 0.02, y - _ARM_M
    shapes = (
        box((-x, -y, -z), (x, -y + _ARM_M, arm), _FABRIC),
        box((-x, side, -z), (x, y, arm), _FABRIC),
        box((back, -y + _ARM_M, -z), (x, side, z), _FABRIC),
        box((low, -y + _ARM_M, -z), (back, side, sitting), _CUSHION),
    )
    place = surface("sofa", (back - low) / 2, side, sitting, x_m=(low + back) / 2, room_m=_LYING_ROOM_M)
    return fixture(obj, "sofa", shapes, obj.extent_m, "sofa.n.01", place)


def chair(obj: SceneObject) -> Asset:
    """Returns a chair: a seat on four legs, a back at +x."""
    x, y, z = (length / 2 for length in require_size(obj, (0.30, 0.30, 0.60)))
    sitting, back = -z + 0.45, x - _POST_M
    posts = [
        box((low, side, -z), (low + _POST_M, side + _POST_M, sitting - 0.03), _CHAIR)
        for low in (-x, back)
        for side in (-y, y - _POST_M)
    ]
    seat = box((-x, -y, sitting - 0.03), (x, y, sitting), _CHAIR)
    rest = box((back, -y, sitting), (x, y, z), _CHAIR)
    place = surface("chair", (back - -x) / 2, y, sitting, x_m=(-x + back) / 2, room_m=_LYING_ROOM_M)
    return fixture(obj, "chair", (*posts, seat, rest), obj.extent_m, "chair.n.01", place)


def wall(obj: SceneObject) -> Asset:
    """Returns a piece of a room's wall, which the robot keeps off; its inner side faces -x."""
    extent = require_size(obj, (0.02, 0.20, 0.20))
    x, y, z = (length / 2 for length in extent)
    plaster = box((-x, -y, -z), (x, y, z), (0.72, 0.70, 0.66))
    skirting = box((-x - 0.006, -y, -z), (-x, y, -z + 0.07), (0.50, 0.48, 0.45), collides=False)
    return fixture(obj, "wall", (plaster, skirting), extent, "wall.n.01")


def floor(obj: SceneObject) -> Asset:
    """Returns the floor: a place on the ground, which is in every world; its own body is out of all touch below it."""
    x, y, z = (length / 2 for length in require_size(obj, (0.20, 0.20, 0.12)))
    below = box((-x, -y, -z), (x, y, z - _BELOW_GROUND_M), _GREY)
    return fixture(obj, "floor", (below,), obj.extent_m, "floor.n.01", replace(surface("floor", x, y, z), name="floor"))
