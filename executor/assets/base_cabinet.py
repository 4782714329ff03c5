"""Kitchen base cabinets that open, under a countertop: doors, drawers, or a drawer above a door."""

from __future__ import annotations

from executor.assets.casework import Case, Column, Row, assemble
from executor.assets.entry import Entry, Option, Quantity, Span
from executor.assets.fronts import Closing
from executor.assets.handles import HANDLE_PARAMETERS, Grip
from executor.assets.model import Asset
from executor.assets.parameters import require_size
from executor.assets.plinth import plinth, slab, top_of
from oag import SceneObject

HINGE = Option("hinge", ("left", "right"))
SHELVES = Quantity("shelves", 1, 0, 2, whole=True)
DRAWERS = Quantity("drawers", 3, 2, 4, whole=True)
_LENGTH, _NARROW, _WIDE, _HEIGHT = Span(0.56, 0.66), Span(0.42, 0.60), Span(0.80, 1.10), Span(0.72, 0.90)
_OVERHANG_M = 0.030


def one_door(obj: SceneObject) -> Asset:
    """Returns a cabinet with one door.

    Raises:
        AssetError: When its size or a parameter does not make one; so do the others of this file.
    """
    closing: Closing = "left" if HINGE.read(obj) == "left" else "right"
    return _cabinet(obj, (Column((Row("door", closing, shelves=SHELVES.count(obj)),)),))


def two_doors(obj: SceneObject) -> Asset:
    """Returns a cabinet with a pair of doors, hinged at the outer sides, and a partition between them."""
    count = SHELVES.count(obj)
    left, right = Row("left_door", "left", shelves=count), Row("right_door", "right", shelves=count)
    return _cabinet(obj, (Column((left,)), Column((right,))))


def drawers(obj: SceneObject) -> Asset:
    """Returns a cabinet full of drawers, numbered from the top."""
    count = DRAWERS.count(obj)
    rows = tuple(Row(f"drawer_{count - index}", "drawer", 1.3 if index == 0 else 1.0) for index in range(count))
    return _cabinet(obj, (Column(rows),))


def drawer_over_door(obj: SceneObject) -> Asset:
    """Returns a cabinet with a drawer above each of two doors."""
    columns = tuple(
        Column((Row(f"{side}_door", side, 0.75, SHELVES.count(obj)), Row(f"{side}_drawer", "drawer", 0.25)))
        for side in ("left", "right")
    )
    return _cabinet(obj, columns)


def _cabinet(obj: SceneObject, columns: tuple[Column, ...]) -> Asset:
    extent = require_size(obj, (0.40, 0.32 * len(columns), 0.50))
    case = Case(
        extent_m=extent,
        columns=columns,
        grip=Grip.of(obj),
        base_m=0.09,
        top_m=0.035,
    )
    extra = [plinth(case), *slab(case, _OVERHANG_M)]
    return assemble(case, obj.category, "cabinet.n.01", extra=extra, surfaces=[top_of(case, _OVERHANG_M)])


ENTRIES = tuple(
    Entry(model, category, "cabinet.n.01", build, _LENGTH, width, _HEIGHT, (*parameters, *HANDLE_PARAMETERS))
    for model, category, build, width, parameters in (
        ("cabinet_one_door", "bottom_cabinet", one_door, _NARROW, (HINGE, SHELVES)),
        ("cabinet_two_doors", "bottom_cabinet", two_doors, _WIDE, (SHELVES,)),
        ("cabinet_drawers", "bottom_cabinet", drawers, _NARROW, (DRAWERS,)),
        ("cabinet_drawers_doors", "bottom_cabinet", drawer_over_door, _WIDE, (SHELVES,)),
    )
)
