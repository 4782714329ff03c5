"""A desk: a top over a column of drawers on one side and a panel on the other."""

from __future__ import annotations

from dataclasses import replace

from executor.assets.casework import Case, Column, Row, assemble
from executor.assets.entry import Entry, Option, Quantity, Span
from executor.assets.handles import HANDLE_PARAMETERS, Grip
from executor.assets.model import Asset, Shape
from executor.assets.parameters import require_size
from executor.assets.placing import shifted
from executor.assets.plinth import plinth, slab, top_of
from executor.assets.shapes import box
from oag import SceneObject

SIDE = Option("drawer_side", ("right", "left"))
DRAWERS = Quantity("drawers", 3, 2, 3, whole=True)
PEDESTAL_WIDTH = Quantity("pedestal_width_m", 0.40, 0.36, 0.44)
_OVERHANG_M = 0.020
_TOP_M = 0.030
_PANEL_M = 0.030
_WALNUT, _WALNUT_FRONT, _TOP = (0.30, 0.18, 0.10), (0.36, 0.23, 0.13), (0.44, 0.28, 0.16)


def desk_with_drawers(obj: SceneObject) -> Asset:
    """Returns a desk; somebody sits at its front, beside the drawers.

    Raises:
        AssetError: When its size or a parameter does not make one.
    """
    length, width, height = require_size(obj, (0.45, 0.80, 0.60))
    count, pedestal = DRAWERS.count(obj), PEDESTAL_WIDTH.read(obj)
    side = 1.0 if SIDE.read(obj) == "left" else -1.0
    rows = tuple(Row(f"drawer_{count - index}", "drawer") for index in range(count))
    whole = Case(
        extent_m=(length, width, height),
        columns=(Column(rows),),
        grip=Grip.of(obj),
        base_m=0.06,
        top_m=_TOP_M,
        body=_WALNUT,
        front=_WALNUT_FRONT,
    )
    box_of_drawers = replace(whole, extent_m=(length, pedestal, height))
    drawers = assemble(box_of_drawers, obj.category, "desk.n.01", extra=[plinth(box_of_drawers)], surfaces=[])
    drawers = shifted(drawers, (0.0, side * (width - pedestal) / 2, 0.0))
    body = replace(
        drawers.links[0], shapes=(*drawers.links[0].shapes, *slab(whole, _OVERHANG_M, _TOP), *_far_side(whole, side))
    )
    return replace(
        drawers,
        links=(body, *drawers.links[1:]),
        extent_m=whole.extent_m,
        regions=(*drawers.regions, top_of(whole, _OVERHANG_M)),
    )


def _far_side(case: Case, side: float) -> list[Shape]:
    """The panel that carries the top where there are no drawers."""
    (x0, x1), top, y, floor = case.x, case.z[1], case.extent_m[1] / 2, -case.extent_m[2] / 2
    low, high = sorted((-side * y, -side * (y - _PANEL_M)))
    return [box((x0, low, floor), (x1, high, top), _WALNUT)]


ENTRIES = (
    Entry(
        "desk_with_drawers",
        "desk_with_drawers",
        "desk.n.01",
        desk_with_drawers,
        Span(0.60, 0.75),
        Span(1.00, 1.40),
        Span(0.68, 0.76),
        (SIDE, DRAWERS, PEDESTAL_WIDTH, *HANDLE_PARAMETERS),
    ),
)
