"""Kitchen appliances: a microwave, an oven, a dishwasher, and refrigerators.

The microwave has a side hinge; the doors of oven and dishwasher fold down. Refrigerators are the one-door classic, and
those with a freezer above, a freezer drawer, or two doors side by side. Every builder raises AssetError where a size or
a parameter does not fit.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from executor.assets.families.casework import (
    GAP_M,
    HINGE,
    Case,
    Column,
    Compartment,
    Grip,
    assemble,
    hinge_of,
    plinth,
    slab,
    top_of,
)
from executor.assets.families.controls import CONTROL, with_control
from executor.assets.families.shapes import Color, box
from executor.assets.model import Asset, Handle, Joint, Link, Region, Shape, Vector
from executor.assets.parameters import AssetError, NumericParameter, number, require_size
from oag import SceneObject

RACKS = NumericParameter("racks", 1, 0, 2, whole=True)
_OVERHANG_M = 0.020
_STEEL, _WHITE, _BLACK = (0.50, 0.52, 0.55), (0.78, 0.79, 0.80), (0.06, 0.06, 0.07)
_LIGHT, _RACK, _KNOB = (0.10, 0.35, 0.30), (0.42, 0.43, 0.45), (0.30, 0.31, 0.33)


def microwave(obj: SceneObject) -> Asset:
    """Return a microwave oven: its door is hinged on the left, its display and its button or knob are on the right."""
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
    # Beside an upright handle the hand is upright, too.
    at_m, across = (outer, (edge - y) / 2, z0 + 0.4 * (z1 - z0)), (0.0, 0.0, 1.0)
    return with_control(obj, replace(asset, regions=(*inside, top_of(case))), at_m, (-1.0, 0.0, 0.0), across)


def oven(obj: SceneObject) -> Asset:
    """Return a cooker: an oven whose door folds down, four fixed knobs above it, four plates on top."""
    extent = require_size(obj, (0.50, 0.45, 0.70))
    case = _folding(obj, extent, base_m=0.14, top_m=0.13, front=_STEEL, window=_BLACK)
    (x0, x1), top, y, high = case.x, case.z[1], extent[1] / 2, extent[2] / 2
    panel_x = x0 - GAP_M - case.panel_m
    extra = [
        plinth(case),
        box((panel_x, -y, top), (x1, y, high - 0.012), _STEEL),
        box((panel_x + 0.004, -y + 0.004, high - 0.012), (x1 - 0.004, y - 0.004, high), _BLACK),
    ]
    z = (top + high) / 2
    middles = [y * (index - 1.5) / 2.2 for index in range(4)]
    # One that is a joint stands in the place of the last fixed one, which is the rightmost for who faces it.
    for middle in middles if CONTROL.read(obj) == "none" else middles[1:]:
        extra.append(box((panel_x - 0.020, middle - 0.018, z - 0.018), (panel_x, middle + 0.018, z + 0.018), _KNOB))
    asset = assemble(case, obj.category, "oven.n.01", extra=extra, surfaces=[top_of(case)])
    return with_control(obj, asset, (panel_x, middles[0], z), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def dishwasher(obj: SceneObject) -> Asset:
    """Return a dishwasher whose door folds down, under a countertop."""
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


SHELVES = NumericParameter("shelves", 2, 1, 3, whole=True)
HANDLE_HEIGHT = NumericParameter("handle_height_m", 0.74, 0.66, 0.80)
# What the library draws; the classic can be built with more.
CLASSIC_HANDLE_HEIGHT = NumericParameter("handle_height_m", 0.75, 0.68, 0.80)
_FRIDGE_WHITE, _FRIDGE_STEEL, _FRIDGE_GLASS = (0.80, 0.82, 0.84), (0.56, 0.59, 0.62), (0.48, 0.66, 0.72)
_LINER, _FRIDGE_DARK = (0.88, 0.90, 0.91), (0.05, 0.05, 0.06)

# Of the classic; its handle is like that of `casework`, with which the trials were made.
_DOOR_JOINT = "door_hinge"
_DOOR_LIMIT_RAD = 2.2
_WALL_M, _DOOR_M, _GASKET_M, _FLOOR_GAP_M = 0.030, 0.050, 0.004, 0.060
_SHELF_M, _SHELF_SETBACK_M = 0.016, 0.080
_STANDOFF_M, _BAR_M, _HANDLE_INSET_M = 0.055, 0.020, 0.050
# Inner faces lie a little apart from each other so that no two of them are drawn in the same plane.
_CLEARANCE_M = 0.001


def refrigerator(obj: SceneObject) -> Asset:
    """Return the classic refrigerator of the published scenes: one door, and shelves at heights given as a parameter.

    Parameters of the scene object (all optional): `hinge` "left" or "right" as seen by somebody who faces the door
    (left is the +y side), `shelf_heights_m` above the floor the refrigerator stands on, `handle_height_m`,
    `handle_length_m`.
    """
    depth, width, height = require_size(obj, (0.35, 0.30, 0.50))
    front = -depth / 2 + (_GASKET_M + _DOOR_M + _STANDOFF_M + _BAR_M / 2)
    back, y, floor, top = depth / 2, width / 2, -height / 2, height / 2
    bottom, inner, liner = floor + _FLOOR_GAP_M, y - _WALL_M, back - _WALL_M
    side = 1.0 if HINGE.read(obj) == "left" else -1.0
    tops = [floor + shelf for shelf in _shelf_heights(obj, height)]
    body = [
        box((front, -y, bottom), (back, -inner, top), _FRIDGE_WHITE),
        box((front, inner, bottom), (back, y, top), _FRIDGE_WHITE),
        box((liner, -inner, bottom), (back, inner, top), _FRIDGE_WHITE),
        box((front, -inner, top - _WALL_M), (liner, inner, top), _FRIDGE_WHITE),
        box((front, -inner, bottom), (liner, inner, bottom + _WALL_M), _LINER),
        # The plinth stands back from the door, as a kick space does.
        box((front + 0.05, -y + 0.02, floor), (back - 0.02, y - 0.02, bottom), _FRIDGE_DARK),
    ]
    reach, setback, ends = inner - _CLEARANCE_M, front + _SHELF_SETBACK_M, liner - _CLEARANCE_M
    body += [box((setback, -reach, z - _SHELF_M), (ends, reach, z), _FRIDGE_GLASS) for z in tops]
    door, handle = _classic_door(obj, side, 2 * y, (bottom, top), height)
    regions = []
    floors, ceilings = [bottom + _WALL_M, *tops], [*(z - _SHELF_M for z in tops), top - _WALL_M]
    for index, (low, high) in enumerate(zip(floors, ceilings, strict=True)):
        start = setback if index else front
        middle, half = ((start + liner) / 2, 0.0, (low + high) / 2), ((liner - start) / 2, inner, (high - low) / 2)
        name = f"shelf_{index}" if index else "bottom"
        regions.append(Region(name, "interior", "body", middle, half, (-1.0, 0.0, 0.0), _DOOR_JOINT))
    hinge = (front, side * y, 0.0)
    limits = (0.0, _DOOR_LIMIT_RAD)
    return Asset(
        category="refrigerator",
        motion="articulated",
        links=(Link("body", tuple(body)), Link("door", door)),
        extent_m=(depth, width, height),
        joints=(Joint(_DOOR_JOINT, "revolute", "body", "door", hinge, (0.0, 0.0, -side), limits),),
        handles=(handle,),
        regions=tuple(regions),
        synset="refrigerator.n.01",
    )


def _shelf_heights(obj: SceneObject, height: float) -> list[float]:
    value = obj.parameters.get("shelf_heights_m", [h for h in (0.42, 0.72) if h < height - 0.15])
    items = value if isinstance(value, list | tuple) else [None]
    heights = [float(item) for item in items if isinstance(item, int | float) and not isinstance(item, bool)]
    if len(heights) != len(items) or heights != sorted(heights):
        problem = f"parameter 'shelf_heights_m' is {value!r}"
        raise AssetError(obj, problem, "expected a list of increasing numbers")
    low, high = _FLOOR_GAP_M + _WALL_M + 0.10, height - _WALL_M - 0.10
    for shelf in heights:
        if not low <= shelf <= high:
            raise AssetError(obj, f"a shelf at {shelf:.3f} m", f"shelves fit from {low:.3f} m to {high:.3f} m")
    return heights


def _classic_door(
    obj: SceneObject, side: float, width: float, z: tuple[float, float], height: float
) -> tuple[tuple[Shape, ...], Handle]:
    """Shapes and handle in the door's frame, whose origin is on the hinge line at mid height."""
    low, high = z[0] + 0.005, z[1] - 0.005
    outer = -_GASKET_M - _DOOR_M

    def across(a: float, b: float) -> tuple[float, float]:
        return (min(-side * a, -side * b), max(-side * a, -side * b))

    (y0, y1), (g0, g1), (l0, l1) = across(0.0, width), across(0.012, width - 0.012), across(0.037, width - 0.037)
    grip_y, half = width - _HANDLE_INSET_M, _BAR_M / 2
    h0, h1 = across(grip_y - half, grip_y + half)
    middle = number(obj, "handle_height_m", min(0.75, 0.65 * height), 0.2, height - 0.2) - height / 2
    length = number(obj, "handle_length_m", 0.34, 0.12, height - 0.3)
    x = outer - _STANDOFF_M
    bar = partial(box, color=_FRIDGE_DARK, friction=1.0, density_kg_m3=500.0)
    shapes = [
        box((outer, y0, low), (-_GASKET_M, y1, high), _FRIDGE_STEEL, density_kg_m3=200.0),
        box((-_GASKET_M, g0, low + 0.012), (-0.002, g1, high - 0.012), _FRIDGE_DARK, collides=False),
        box((-0.002, l0, low + 0.037), (-_CLEARANCE_M, l1, high - 0.037), _LINER, collides=False),
        bar((x - half, h0, middle - length / 2), (x + half, h1, middle + length / 2)),
    ]
    for end in (-1.0, 1.0):
        post = middle + end * (length / 2 - 0.012)
        shapes.append(bar((x + half, h0 + 0.002, post - 0.01), (outer, h1 - 0.002, post + 0.01)))
    position = (x, (h0 + h1) / 2, middle)
    return tuple(shapes), Handle("door", _DOOR_JOINT, position, (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), length, _BAR_M)


def fridge_one_door(obj: SceneObject) -> Asset:
    """Return a refrigerator with one door over its whole height."""
    return cold_appliance(obj, Column((Compartment("door", hinge_of(obj), shelves=SHELVES.count(obj)),)))


def fridge_top_freezer(obj: SceneObject) -> Asset:
    """Return a refrigerator with a freezer above it, each with a door of its own, hinged on the same side."""
    main = Compartment("door", hinge_of(obj), 0.68, SHELVES.count(obj))
    return cold_appliance(obj, Column((main, Compartment("freezer_door", hinge_of(obj), 0.32))))


def fridge_freezer_drawer(obj: SceneObject) -> Asset:
    """Return a refrigerator with a freezer drawer below its door."""
    main = Compartment("door", hinge_of(obj), 0.68, SHELVES.count(obj))
    return cold_appliance(obj, Column((Compartment("freezer_drawer", "drawer", 0.32), main)))


def fridge_side_by_side(obj: SceneObject) -> Asset:
    """Return a refrigerator on the right and a freezer on the left, hinged at the outer sides."""
    count = SHELVES.count(obj)
    left, right = Compartment("left_door", "left", shelves=count), Compartment("right_door", "right", shelves=count)
    return cold_appliance(obj, Column((left,), 0.46), Column((right,), 0.54))


def cold_appliance(obj: SceneObject, *columns: Column) -> Asset:
    """Return a refrigerator of some columns of doors and drawers."""
    case = Case(
        extent_m=require_size(obj, (0.50, 0.45 if len(columns) == 1 else 0.70, 1.0)),
        columns=columns,
        grip=Grip.of(obj),
        base_m=0.06,
        wall_m=0.035,
        panel_m=0.050,
        density_kg_m3=200.0,
        handle_height_m=HANDLE_HEIGHT.read(obj),
        shelf_setback_m=0.060,
        body=_FRIDGE_WHITE,
        front=_FRIDGE_STEEL,
        inner=_FRIDGE_GLASS,
    )
    return assemble(case, obj.category, "electric_refrigerator.n.01", extra=[plinth(case)])
