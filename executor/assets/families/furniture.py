"""Furniture: cabinets, a nightstand, a wardrobe, desks, tables, shelves, beds, sofas, chairs, walls and the floor.

Cupboards are layouts of doors and drawers. One cabinet, which the published scenes use as a counter, has fronts that do
not open. Every builder raises AssetError where a size or a parameter does not fit.
"""

from __future__ import annotations

from dataclasses import replace

from executor.assets.asset_geometry import shifted
from executor.assets.families.casework import (
    NO_GRIP,
    Case,
    Column,
    Compartment,
    Grip,
    assemble,
    hinge_of,
    legs,
    plinth,
    slab,
    top_of,
)
from executor.assets.families.shapes import box, cylinder, fixture, surface
from executor.assets.model import Asset, Shape
from executor.assets.parameters import ChoiceParameter, NumericParameter, number, require_size
from oag import SceneObject

# Base cabinets.
SHELVES = NumericParameter("shelves", 1, 0, 2, whole=True)
DRAWERS = NumericParameter("drawers", 3, 2, 4, whole=True)
_BASE_OVERHANG_M = 0.030


def cabinet_one_door(obj: SceneObject) -> Asset:
    """Return a base cabinet with one door."""
    return _base_cabinet(obj, Column((Compartment("door", hinge_of(obj), shelves=SHELVES.count(obj)),)))


def cabinet_two_doors(obj: SceneObject) -> Asset:
    """Return a base cabinet with a pair of doors, hinged at the outer sides, and a partition between them."""
    count = SHELVES.count(obj)
    left, right = Compartment("left_door", "left", shelves=count), Compartment("right_door", "right", shelves=count)
    return _base_cabinet(obj, Column((left,)), Column((right,)))


def cabinet_drawers(obj: SceneObject) -> Asset:
    """Return a base cabinet full of drawers, numbered from the top."""
    count = DRAWERS.count(obj)
    rows = tuple(Compartment(f"drawer_{count - index}", "drawer", 1.3 if index == 0 else 1.0) for index in range(count))
    return _base_cabinet(obj, Column(rows))


def cabinet_drawers_doors(obj: SceneObject) -> Asset:
    """Return a base cabinet with a drawer above each of two doors."""
    count = SHELVES.count(obj)
    left = Column((Compartment("left_door", "left", 0.75, count), Compartment("left_drawer", "drawer", 0.25)))
    right = Column((Compartment("right_door", "right", 0.75, count), Compartment("right_drawer", "drawer", 0.25)))
    return _base_cabinet(obj, left, right)


def _base_cabinet(obj: SceneObject, *columns: Column) -> Asset:
    extent = require_size(obj, (0.40, 0.32 * len(columns), 0.50))
    case = Case(extent, columns, Grip.of(obj), base_m=0.09, top_m=0.035)
    extra, top = [plinth(case), slab(case, _BASE_OVERHANG_M)], top_of(case, _BASE_OVERHANG_M)
    return assemble(case, obj.category, "cabinet.n.01", extra=extra, surfaces=[top])


_PAINTED_FRONT, _SEAM_M, _PANEL_M = (0.50, 0.56, 0.54), 0.006, 0.012


def cabinet(obj: SceneObject) -> Asset:
    """Return a base cabinet under a countertop whose doors, below the overhang, do not move."""
    extent = require_size(obj, (0.25, 0.25, 0.30))
    x, y, z = (length / 2 for length in extent)
    under, plinth_z = z - 0.035, -z + 0.080
    front, side = -x + _BASE_OVERHANG_M, y - 0.005
    shapes = [
        box((-x, -y, under), (x, y, z), (0.72, 0.70, 0.66)),
        box((front, -side, plinth_z), (x - 0.005, side, under), (0.60, 0.63, 0.60)),
        box((front + 0.050, -y + 0.015, -z), (x - 0.015, y - 0.015, plinth_z), (0.08, 0.08, 0.08)),
        *_painted_doors(front, side, plinth_z, under),
    ]
    return fixture(obj, "cabinet", shapes, extent, "cabinet.n.01", surface("cabinet", x, y, z))


def _painted_doors(front: float, half_width: float, low: float, high: float) -> list[Shape]:
    """Door panels with a bar on each; they stay under the overhang, so that only cameras need them."""
    count = max(1, round(2 * half_width / 0.45))
    pitch = 2 * half_width / count
    shapes = []
    for index in range(count):
        left = -half_width + index * pitch
        y0, y1 = left + _SEAM_M / 2, left + pitch - _SEAM_M / 2
        panel = (front - _PANEL_M, y0, low + _SEAM_M), (front, y1, high - _SEAM_M)
        shapes.append(box(*panel, _PAINTED_FRONT, collides=False))
        grip_y = y1 - 0.035 if index % 2 == 0 else y0 + 0.035
        grip = (front - _PANEL_M - 0.012, grip_y - 0.005, high - 0.19), (front - _PANEL_M, grip_y + 0.005, high - 0.05)
        shapes.append(box(*grip, (0.20, 0.20, 0.21), collides=False))
    return shapes


# The bedroom's.
BELOW = ChoiceParameter("below", ("niche", "drawer"))
WARDROBE_SHELVES = NumericParameter("shelves", 2, 1, 3, whole=True)
_OAK, _OAK_FRONT, _OAK_TOP = (0.47, 0.31, 0.17), (0.55, 0.38, 0.22), (0.40, 0.25, 0.13)
_WARDROBE, _WARDROBE_FRONT = (0.66, 0.61, 0.53), (0.76, 0.72, 0.65)
_BEDSIDE_OVERHANG_M = 0.015


def nightstand(obj: SceneObject) -> Asset:
    """Return a nightstand: a drawer over a niche or over a second drawer."""
    extent = require_size(obj, (0.32, 0.32, 0.42))
    below = Compartment("niche", "open", 1.0) if BELOW.read(obj) == "niche" else Compartment("drawer_2", "drawer", 1.0)
    column = Column((below, Compartment("drawer", "drawer", 0.8)))
    case = Case(extent, (column,), Grip.of(obj), base_m=0.12, top_m=0.025, body=_OAK, front=_OAK_FRONT)
    extra = [*legs(case, _OAK_TOP), slab(case, _BEDSIDE_OVERHANG_M, _OAK_TOP)]
    return assemble(case, obj.category, "stand.n.04", extra=extra, surfaces=[top_of(case, _BEDSIDE_OVERHANG_M)])


def wardrobe(obj: SceneObject) -> Asset:
    """Return a wardrobe: two doors, hinged at the outer sides, a partition between them, shelves on the right."""
    extent = require_size(obj, (0.45, 0.70, 1.20))
    left, right = (
        Compartment("left_door", "left", shelves=1),
        Compartment("right_door", "right", shelves=WARDROBE_SHELVES.count(obj)),
    )
    columns = (Column((left,)), Column((right,)))
    case = Case(extent, columns, Grip.of(obj), base_m=0.07, body=_WARDROBE, front=_WARDROBE_FRONT, inner=_OAK)
    return assemble(case, obj.category, "wardrobe.n.01", extra=[plinth(case)])


# The desk.
SIDE = ChoiceParameter("drawer_side", ("right", "left"))
DESK_DRAWERS = NumericParameter("drawers", 3, 2, 3, whole=True)
PEDESTAL_WIDTH = NumericParameter("pedestal_width_m", 0.40, 0.36, 0.44)
_WALNUT, _WALNUT_FRONT, _WALNUT_TOP = (0.30, 0.18, 0.10), (0.36, 0.23, 0.13), (0.44, 0.28, 0.16)
_DESK_OVERHANG_M, _PANEL_END_M = 0.020, 0.030


def desk_with_drawers(obj: SceneObject) -> Asset:
    """Return a desk: a top over a column of drawers on one side and a panel on the other, with legroom in between."""
    length, width, height = require_size(obj, (0.45, 0.80, 0.60))
    count, pedestal = DESK_DRAWERS.count(obj), PEDESTAL_WIDTH.read(obj)
    side = 1.0 if SIDE.read(obj) == "left" else -1.0
    column = Column(tuple(Compartment(f"drawer_{count - index}", "drawer") for index in range(count)))
    grip, extent = Grip.of(obj), (length, width, height)
    whole = Case(extent, (column,), grip, base_m=0.06, top_m=0.030, body=_WALNUT, front=_WALNUT_FRONT)
    narrow = replace(whole, extent_m=(length, pedestal, height))
    asset = assemble(narrow, obj.category, "desk.n.01", extra=[plinth(narrow)])
    asset = shifted(asset, (0.0, side * (width - pedestal) / 2, 0.0))
    (x0, x1), high, y = whole.x, whole.z[1], width / 2
    low_y, high_y = sorted((-side * y, -side * (y - _PANEL_END_M)))
    panel = box((x0, low_y, -height / 2), (x1, high_y, high), _WALNUT)
    body = replace(asset.links[0], shapes=(*asset.links[0].shapes, slab(whole, _DESK_OVERHANG_M, _WALNUT_TOP), panel))
    regions = (*asset.regions, top_of(whole, _DESK_OVERHANG_M))
    return replace(asset, links=(body, *asset.links[1:]), extent_m=extent, regions=regions)


BOARDS = NumericParameter("boards", 2, 1, 4, whole=True)
TOP_THICKNESS = NumericParameter("top_thickness_m", 0.030, 0.020, 0.045)
_PINE, _WHITE, _GREY = (0.62, 0.45, 0.27), (0.78, 0.77, 0.74), (0.55, 0.56, 0.56)
_WOOD, _DARK_WOOD = (0.48, 0.29, 0.15), (0.33, 0.19, 0.09)
_LEG_M, _INSET_M = 0.045, 0.010
_BELOW_GROUND_M = 0.08  # Farther than the engine reports contacts from.


def table(obj: SceneObject) -> Asset:
    """Return a table: one top on four legs; `top_thickness_m` may be more than the library draws."""
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
    """Return a round table on one leg; its place is the square inside the round top."""
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
    """Return a counter: a solid body under a stone top, without anything that opens."""
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
    """Return an open bookcase; things stand on its boards, and on its top."""
    extent = require_size(obj, (0.22, 0.40, 0.50))
    column = Column((Compartment("board", "open", shelves=BOARDS.count(obj)),))
    case = Case(extent, (column,), NO_GRIP, base_m=0.05, body=_PINE, inner=_PINE, niche="surface")
    return assemble(case, obj.category, "shelf.n.01", extra=[plinth(case)], surfaces=[top_of(case)])


_HEADBOARD_M, _ARM_M, _BACK_M, _POST_M = 0.05, 0.14, 0.16, 0.04
_LYING_ROOM_M = 0.30
_FRAME, _LINEN, _BLANKET, _PILLOW = (0.36, 0.22, 0.12), (0.80, 0.79, 0.76), (0.35, 0.42, 0.50), (0.86, 0.85, 0.82)
_FABRIC, _CUSHION, _CHAIR = (0.40, 0.43, 0.46), (0.47, 0.50, 0.53), (0.50, 0.33, 0.18)


def bed(obj: SceneObject) -> Asset:
    """Return a bed: its headboard at the back (+x), a mattress with a blanket and a pillow."""
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
    """Return a sofa: a seat between two arms, before a back."""
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
    """Return a chair: a seat on four legs, a back at +x."""
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
    """Return a piece of a room's wall, an obstacle for the robot; its inner side faces -x."""
    extent = require_size(obj, (0.02, 0.20, 0.20))
    x, y, z = (length / 2 for length in extent)
    plaster = box((-x, -y, -z), (x, y, z), (0.72, 0.70, 0.66))
    skirting = box((-x - 0.006, -y, -z), (-x, y, -z + 0.07), (0.50, 0.48, 0.45), collides=False)
    return fixture(obj, "wall", (plaster, skirting), extent, "wall.n.01")


def floor(obj: SceneObject) -> Asset:
    """Return the floor: a region on the ground, which every world has; its own body lies below, out of contact."""
    x, y, z = (length / 2 for length in require_size(obj, (0.20, 0.20, 0.12)))
    below = box((-x, -y, -z), (x, y, z - _BELOW_GROUND_M), _GREY)
    return fixture(obj, "floor", (below,), obj.extent_m, "floor.n.01", replace(surface("floor", x, y, z), name="floor"))
