"""Kitchen appliances: a microwave with a side hinge, an oven and a dishwasher whose doors fold down."""

from __future__ import annotations

from dataclasses import replace

from executor.assets.casework import Case, Column, Row, assemble
from executor.assets.entry import Entry, Quantity, Span
from executor.assets.fronts import GAP_M
from executor.assets.handles import HANDLE_PARAMETERS, Grip
from executor.assets.model import Asset, Shape
from executor.assets.parameters import require_size
from executor.assets.plinth import plinth, slab, top_of
from executor.assets.shapes import box
from oag import SceneObject

RACKS = Quantity("racks", 1, 0, 2, whole=True)
_OVERHANG_M = 0.020
_FEET_M = 0.012
_STEEL, _WHITE, _BLACK = (0.50, 0.52, 0.55), (0.78, 0.79, 0.80), (0.06, 0.06, 0.07)
_LIGHT, _RACK, _KNOB = (0.10, 0.35, 0.30), (0.42, 0.43, 0.45), (0.30, 0.31, 0.33)


def microwave(obj: SceneObject) -> Asset:
    """Returns a microwave oven: its door is hinged on the left, its buttons are on the right.

    Raises:
        AssetError: When its size or a parameter does not make one; so do the others of this file.
    """
    extent = require_size(obj, (0.35, 0.40, 0.22))
    case = Case(
        extent_m=extent,
        columns=(Column((Row("door", "left"),), 0.76), Column((Row("electronics", "open"),), 0.24)),
        grip=Grip.of(obj),
        base_m=_FEET_M,
        wall_m=0.020,
        panel_m=0.028,
        density_kg_m3=900.0,
        handle_height_m=extent[2] / 2,
        body=_STEEL,
        front=_STEEL,
        window=_BLACK,
    )
    asset = assemble(case, obj.category, "microwave.n.02", extra=[_feet(case), *_buttons(case)], surfaces=[])
    inside = tuple(region for region in asset.regions if region.joint is not None)
    return replace(asset, regions=(*inside, top_of(case)))


def oven(obj: SceneObject) -> Asset:
    """Returns a cooker: an oven whose door folds down, knobs above it, four plates on top."""
    extent = require_size(obj, (0.50, 0.45, 0.70))
    case = _folding(obj, extent, base_m=0.14, top_m=0.13, front=_STEEL, window=_BLACK)
    (x0, x1), top, y, high = case.x, case.z[1], extent[1] / 2, extent[2] / 2
    panel_x = x0 - GAP_M - case.panel_m
    extra = [
        plinth(case),
        box((panel_x, -y, top), (x1, y, high - 0.012), _STEEL),
        box((panel_x + 0.004, -y + 0.004, high - 0.012), (x1 - 0.004, y - 0.004, high), _BLACK),
    ]
    for index in range(4):
        middle = y * (index - 1.5) / 2.2
        z = (top + high) / 2
        extra.append(box((panel_x - 0.020, middle - 0.018, z - 0.018), (panel_x, middle + 0.018, z + 0.018), _KNOB))
    return assemble(case, obj.category, "oven.n.01", extra=extra, surfaces=[top_of(case)])


def dishwasher(obj: SceneObject) -> Asset:
    """Returns a dishwasher whose door folds down, under a countertop."""
    extent = require_size(obj, (0.50, 0.42, 0.70))
    case = _folding(obj, extent, base_m=0.12, top_m=0.030, front=_WHITE, window=None)
    extra = [plinth(case), *slab(case, _OVERHANG_M)]
    return assemble(case, obj.category, "dishwasher.n.01", extra=extra, surfaces=[top_of(case, _OVERHANG_M)])


def _folding(
    obj: SceneObject,
    extent: tuple[float, float, float],
    *,
    base_m: float,
    top_m: float,
    front: tuple[float, ...],
    window: tuple[float, ...] | None,
) -> Case:
    """A case with one door that folds down; the handle stays clear of the floor when it is open."""
    return Case(
        extent_m=extent,
        columns=(Column((Row("door", "bottom", shelves=RACKS.count(obj)),)),),
        grip=Grip.of(obj),
        base_m=base_m,
        top_m=top_m,
        wall_m=0.030,
        panel_m=0.030,
        density_kg_m3=400.0,
        shelf_setback_m=0.040,
        body=front,
        front=front,
        inner=_RACK,
        window=window,
    )


def _feet(case: Case) -> Shape:
    (x0, x1), (bottom, _), y, floor = case.x, case.z, case.extent_m[1] / 2, -case.extent_m[2] / 2
    return box((x0 + 0.02, -y + 0.02, floor), (x1 - 0.02, y - 0.02, bottom), _BLACK)


def _buttons(case: Case) -> list[Shape]:
    """The panel beside the door, flush with it, and a display on it."""
    (x0, _), (z0, z1), y = case.x, case.z, case.extent_m[1] / 2
    # The columns go from the left, so that the panel takes the last 24 hundredths of the width.
    edge, outer = -y + 0.24 * 2 * y - 0.003, x0 - GAP_M - case.panel_m
    panel = box((outer, -y, z0), (x0 - 0.0005, edge, z1), _BLACK)
    display = box((outer - 0.002, -y + 0.02, z1 - 0.07), (outer, edge - 0.02, z1 - 0.03), _LIGHT, collides=False)
    return [panel, display]


ENTRIES = (
    Entry(
        "microwave_side_hinge",
        "microwave",
        "microwave.n.02",
        microwave,
        Span(0.42, 0.50),
        Span(0.46, 0.56),
        Span(0.27, 0.33),
        HANDLE_PARAMETERS,
    ),
    Entry(
        "oven_bottom_hinge",
        "oven",
        "oven.n.01",
        oven,
        Span(0.60, 0.70),
        Span(0.54, 0.62),
        Span(0.80, 0.90),
        (RACKS, *HANDLE_PARAMETERS),
    ),
    Entry(
        "dishwasher_bottom_hinge",
        "dishwasher",
        "dishwasher.n.01",
        dishwasher,
        Span(0.60, 0.70),
        Span(0.45, 0.62),
        Span(0.80, 0.90),
        (RACKS, *HANDLE_PARAMETERS),
    ),
)
