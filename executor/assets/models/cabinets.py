"""Cupboards that are layouts of doors and drawers: base cabinets, a nightstand, a wardrobe, a desk with drawers.

One cabinet, which the published scenes use as a counter, has fronts that do not open.
"""

from __future__ import annotations

from dataclasses import replace

from executor.assets.model import Asset, Shape
from executor.assets.parameters import Option, Quantity, require_size
from executor.assets.parts.casework import assemble, legs, plinth, slab, top_of
from executor.assets.parts.layout import Case, Column, Compartment, Grip, hinge_of
from executor.assets.parts.shapes import box, fixture, surface
from executor.assets.transforms import shifted
from oag import SceneObject

# Base cabinets.
SHELVES = Quantity("shelves", 1, 0, 2, whole=True)
DRAWERS = Quantity("drawers", 3, 2, 4, whole=True)
_BASE_OVERHANG_M = 0.030


def cabinet_one_door(obj: SceneObject) -> Asset:
    """Returns a base cabinet with one door."""
    return _base_cabinet(obj, Column((Compartment("door", hinge_of(obj), shelves=SHELVES.count(obj)),)))


def cabinet_two_doors(obj: SceneObject) -> Asset:
    """Returns a base cabinet with a pair of doors, hinged at the outer sides, and a partition between them."""
    count = SHELVES.count(obj)
    left, right = Compartment("left_door", "left", shelves=count), Compartment("right_door", "right", shelves=count)
    return _base_cabinet(obj, Column((left,)), Column((right,)))


def cabinet_drawers(obj: SceneObject) -> Asset:
    """Returns a base cabinet full of drawers, numbered from the top."""
    count = DRAWERS.count(obj)
    rows = tuple(Compartment(f"drawer_{count - index}", "drawer", 1.3 if index == 0 else 1.0) for index in range(count))
    return _base_cabinet(obj, Column(rows))


def cabinet_drawers_doors(obj: SceneObject) -> Asset:
    """Returns a base cabinet with a drawer above each of two doors."""
    count = SHELVES.count(obj)
    left = Column((Compartment("left_door", "left", 0.75, count), Compartment("left_drawer", "drawer", 0.25)))
    right = Column((Compartment("right_door", "right", 0.75, count), Compartment("right_drawer", "drawer", 0.25)))
    return _base_cabinet(obj, left, right)


def _base_cabinet(obj: SceneObject, *columns: Column) -> Asset:
    extent = require_size(obj, (0.40, 0.32 * len(columns), 0.50))
    case = Case(extent, columns, Grip.of(obj), base_m=0.09, top_m=0.035)
    extra, top = [plinth(case), slab(case, _BASE_OVERHANG_M)], top_of(case, _BASE_OVERHANG_M)
    return assemble(case, obj.category, "cabinet.n.01", extra=extra, surfaces=[top])


_FRONT, _SEAM_M, _PANEL_M = (0.50, 0.56, 0.54), 0.006, 0.012


def cabinet(obj: SceneObject) -> Asset:
    """Returns a base cabinet under a countertop whose doors, below the overhang, do not move."""
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
    """Door panels with a bar on each; they stay under the overhang, so that only cameras need to see them."""
    count = max(1, round(2 * half_width / 0.45))
    pitch = 2 * half_width / count
    shapes = []
    for index in range(count):
        left = -half_width + index * pitch
        y0, y1 = left + _SEAM_M / 2, left + pitch - _SEAM_M / 2
        panel = (front - _PANEL_M, y0, low + _SEAM_M), (front, y1, high - _SEAM_M)
        shapes.append(box(*panel, _FRONT, collides=False))
        grip_y = y1 - 0.035 if index % 2 == 0 else y0 + 0.035
        grip = (front - _PANEL_M - 0.012, grip_y - 0.005, high - 0.19), (front - _PANEL_M, grip_y + 0.005, high - 0.05)
        shapes.append(box(*grip, (0.20, 0.20, 0.21), collides=False))
    return shapes


# The bedroom's.
BELOW = Option("below", ("niche", "drawer"))
WARDROBE_SHELVES = Quantity("shelves", 2, 1, 3, whole=True)
_OAK, _OAK_FRONT, _OAK_TOP = (0.47, 0.31, 0.17), (0.55, 0.38, 0.22), (0.40, 0.25, 0.13)
_LINEN, _LINEN_FRONT = (0.66, 0.61, 0.53), (0.76, 0.72, 0.65)
_BEDSIDE_OVERHANG_M = 0.015


def nightstand(obj: SceneObject) -> Asset:
    """Returns a nightstand: a drawer over a niche or over a second drawer."""
    extent = require_size(obj, (0.32, 0.32, 0.42))
    below = Compartment("niche", "open", 1.0) if BELOW.read(obj) == "niche" else Compartment("drawer_2", "drawer", 1.0)
    column = Column((below, Compartment("drawer", "drawer", 0.8)))
    case = Case(extent, (column,), Grip.of(obj), base_m=0.12, top_m=0.025, body=_OAK, front=_OAK_FRONT)
    extra = [*legs(case, _OAK_TOP), slab(case, _BEDSIDE_OVERHANG_M, _OAK_TOP)]
    return assemble(case, obj.category, "stand.n.04", extra=extra, surfaces=[top_of(case, _BEDSIDE_OVERHANG_M)])


def wardrobe(obj: SceneObject) -> Asset:
    """Returns a wardrobe: two doors, hinged at the outer sides, a partition between them, shelves on the right."""
    extent = require_size(obj, (0.45, 0.70, 1.20))
    left, right = (
        Compartment("left_door", "left", shelves=1),
        Compartment("right_door", "right", shelves=WARDROBE_SHELVES.count(obj)),
    )
    columns = (Column((left,)), Column((right,)))
    case = Case(extent, columns, Grip.of(obj), base_m=0.07, body=_LINEN, front=_LINEN_FRONT, inner=_OAK)
    return assemble(case, obj.category, "wardrobe.n.01", extra=[plinth(case)])


# The desk.
SIDE = Option("drawer_side", ("right", "left"))
DESK_DRAWERS = Quantity("drawers", 3, 2, 3, whole=True)
PEDESTAL_WIDTH = Quantity("pedestal_width_m", 0.40, 0.36, 0.44)
_WALNUT, _WALNUT_FRONT, _WALNUT_TOP = (0.30, 0.18, 0.10), (0.36, 0.23, 0.13), (0.44, 0.28, 0.16)
_DESK_OVERHANG_M, _PANEL_END_M = 0.020, 0.030


def desk_with_drawers(obj: SceneObject) -> Asset:
    """Returns a desk: a top over a column of drawers on one side and a panel on the other; one sits in between."""
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
