"""Furniture that only carries things: shelves, a plain counter, round and rectangular tables."""

from __future__ import annotations

from executor.assets.casework import Case, Column, Row, assemble
from executor.assets.entry import SAME_AS_WIDTH, Entry, Quantity, Span
from executor.assets.handles import Grip
from executor.assets.model import Asset, Link, Shape
from executor.assets.parameters import require_size
from executor.assets.plinth import plinth, slab, top_of
from executor.assets.shapes import box
from executor.assets.table import table, top_surface
from oag import SceneObject

BOARDS = Quantity("boards", 2, 1, 4, whole=True)
TOP_THICKNESS = Quantity("top_thickness_m", 0.030, 0.020, 0.045)
_PINE, _WHITE, _GREY = (0.62, 0.45, 0.27), (0.78, 0.77, 0.74), (0.55, 0.56, 0.56)
_NO_HANDLE = Grip("bar", 0.0, 0.0, 0.0)


def shelf(obj: SceneObject) -> Asset:
    """Returns an open bookcase; things stand on its boards, and on its top.

    Raises:
        AssetError: When its size or a parameter does not make one; so do the others of this file.
    """
    extent = require_size(obj, (0.22, 0.40, 0.50))
    row = Row("board", "open", shelves=BOARDS.count(obj))
    case = Case(
        extent_m=extent,
        columns=(Column((row,)),),
        grip=_NO_HANDLE,
        base_m=0.05,
        body=_PINE,
        inner=_PINE,
        niche="surface",
    )
    return assemble(case, obj.category, "shelf.n.01", extra=[plinth(case)], surfaces=[top_of(case)])


def counter(obj: SceneObject) -> Asset:
    """Returns a counter: a solid body under a stone top, without anything that opens."""
    extent = require_size(obj, (0.35, 0.35, 0.50))
    overhang = 0.03
    case = Case(extent_m=extent, columns=(), grip=_NO_HANDLE, base_m=0.09, top_m=TOP_THICKNESS.read(obj))
    (x0, x1), (z0, z1), y = case.x, case.z, extent[1] / 2
    body = box((x0 + overhang, -y + 0.004, z0), (x1 - 0.004, y - 0.004, z1), _WHITE)
    base = box((x0 + 0.08, -y + 0.014, -extent[2] / 2), (x1 - 0.014, y - 0.014, z0), _GREY)
    shapes = (body, base, *slab(case, 0.0))
    return Asset(
        obj.category, "static", (Link("body", shapes),), extent, regions=(top_of(case),), synset="countertop.n.01"
    )


def round_table(obj: SceneObject) -> Asset:
    """Returns a round table on one leg; its place is the square inside the round top."""
    length, width, height = require_size(obj, (0.40, 0.40, 0.30))
    radius, half, top = min(length, width) / 2, height / 2, TOP_THICKNESS.read(obj)
    foot = 0.025
    shapes = (
        _disc(radius, half - top, half, _PINE),
        _disc(0.045, -half + foot, half - top, _GREY),
        _disc(0.55 * radius, -half, -half + foot, _GREY),
    )
    inner = 0.70 * radius
    place = top_surface("table", inner, inner, half)
    return Asset(
        obj.category,
        "static",
        (Link("table", shapes),),
        (2 * radius, 2 * radius, height),
        regions=(place,),
        symmetric_about_z=True,
        synset="pedestal_table.n.01",
    )


def _disc(radius: float, low: float, high: float, color: tuple[float, ...]) -> Shape:
    return Shape(
        kind="cylinder", size_m=(radius, (high - low) / 2), position_m=(0.0, 0.0, (low + high) / 2), color=color
    )


ENTRIES = (
    Entry(
        "table_four_legs",
        "table",
        "table.n.02",
        table,
        Span(0.60, 1.20),
        Span(0.50, 0.80),
        Span(0.55, 0.75),
        (TOP_THICKNESS,),
    ),
    Entry(
        "coffee_table",
        "coffee_table",
        "coffee_table.n.01",
        table,
        Span(0.60, 1.00),
        Span(0.45, 0.60),
        Span(0.38, 0.48),
        (TOP_THICKNESS,),
    ),
    Entry(
        "desk_four_legs",
        "desk",
        "desk.n.01",
        table,
        Span(1.00, 1.40),
        Span(0.55, 0.70),
        Span(0.68, 0.76),
        (TOP_THICKNESS,),
    ),
    Entry(
        "table_round",
        "table",
        "pedestal_table.n.01",
        round_table,
        SAME_AS_WIDTH,
        Span(0.60, 0.90),
        Span(0.55, 0.75),
        (TOP_THICKNESS,),
    ),
    Entry(
        "counter_plain",
        "countertop",
        "countertop.n.01",
        counter,
        Span(0.55, 0.65),
        Span(0.60, 1.40),
        Span(0.70, 0.90),
        (TOP_THICKNESS,),
    ),
    Entry("shelf_open", "shelf", "shelf.n.01", shelf, Span(0.26, 0.36), Span(0.60, 1.00), Span(0.80, 1.60), (BOARDS,)),
)
