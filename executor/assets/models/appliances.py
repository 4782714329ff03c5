"""Kitchen appliances: a microwave with a side hinge, an oven and a dishwasher whose doors fold down."""

from __future__ import annotations

from dataclasses import replace

from executor.assets.model import Asset, Vector
from executor.assets.parameters import Quantity, require_size
from executor.assets.parts.casework import assemble, plinth, slab, top_of
from executor.assets.parts.layout import GAP_M, Case, Column, Compartment, Grip
from executor.assets.parts.shapes import Color, box
from oag import SceneObject

RACKS = Quantity("racks", 1, 0, 2, whole=True)
_OVERHANG_M = 0.020
_STEEL, _WHITE, _BLACK = (0.50, 0.52, 0.55), (0.78, 0.79, 0.80), (0.06, 0.06, 0.07)
_LIGHT, _RACK, _KNOB = (0.10, 0.35, 0.30), (0.42, 0.43, 0.45), (0.30, 0.31, 0.33)


def microwave(obj: SceneObject) -> Asset:
    """Returns a microwave oven: its door is hinged on the left, its buttons are on the right."""
    extent = require_size(obj, (0.35, 0.40, 0.22))
    case = Case(
        extent_m=extent,
        columns=(Column((Compartment("door", "left"),), 0.76), Column((Compartment("electronics", "open"),), 0.24)),
        grip=Grip.of(obj),
        base_m=0.012,
        wall_m=0.020,
        panel_m=0.028,
        density_kg_m3=900.0,
        handle_height_m=extent[2] / 2,
        body=_STEEL,
        front=_STEEL,
        window=_BLACK,
    )
    (x0, x1), (z0, z1), y = case.x, case.z, extent[1] / 2
    # The columns go from the left, so that the panel takes the last 24 hundredths of the width.
    edge, outer = -y + 0.24 * 2 * y - 0.003, x0 - GAP_M - case.panel_m
    extra = [
        box((x0 + 0.02, -y + 0.02, -extent[2] / 2), (x1 - 0.02, y - 0.02, z0), _BLACK),
        box((outer, -y, z0), (x0 - 0.0005, edge, z1), _BLACK),
        box((outer - 0.002, -y + 0.02, z1 - 0.07), (outer, edge - 0.02, z1 - 0.03), _LIGHT, collides=False),
    ]
    asset = assemble(case, obj.category, "microwave.n.02", extra=extra)
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
        middle, z = y * (index - 1.5) / 2.2, (top + high) / 2
        extra.append(box((panel_x - 0.020, middle - 0.018, z - 0.018), (panel_x, middle + 0.018, z + 0.018), _KNOB))
    return assemble(case, obj.category, "oven.n.01", extra=extra, surfaces=[top_of(case)])


def dishwasher(obj: SceneObject) -> Asset:
    """Returns a dishwasher whose door folds down, under a countertop."""
    extent = require_size(obj, (0.50, 0.42, 0.70))
    case = _folding(obj, extent, base_m=0.12, top_m=0.030, front=_WHITE, window=None)
    extra, top = [plinth(case), slab(case, _OVERHANG_M)], top_of(case, _OVERHANG_M)
    return assemble(case, obj.category, "dishwasher.n.01", extra=extra, surfaces=[top])


def _folding(
    obj: SceneObject, extent: Vector, *, base_m: float, top_m: float, front: Color, window: Color | None
) -> Case:
    """A case with one door that folds down; the handle stays clear of the floor when it is open."""
    return Case(
        extent_m=extent,
        columns=(Column((Compartment("door", "bottom", shelves=RACKS.count(obj)),)),),
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
