"""Refrigerators beyond the one-door classic: freezer above, freezer drawer below, two doors side by side."""

from __future__ import annotations

from executor.assets.casework import Case, Column, Row, assemble
from executor.assets.entry import Entry, Option, Quantity, Span
from executor.assets.fronts import Closing
from executor.assets.handles import HANDLE_PARAMETERS, Grip
from executor.assets.model import Asset
from executor.assets.parameters import require_size
from executor.assets.plinth import plinth
from oag import SceneObject

HINGE = Option("hinge", ("left", "right"))
SHELVES = Quantity("shelves", 2, 1, 3, whole=True)
HANDLE_HEIGHT = Quantity("handle_height_m", 0.74, 0.66, 0.80)
_PARAMETERS = (HINGE, SHELVES, HANDLE_HEIGHT, *HANDLE_PARAMETERS)
_LENGTH, _WIDTH = Span(0.66, 0.74), Span(0.56, 0.68)
_BASE_M = 0.06
_WHITE = (0.80, 0.82, 0.84)
_STEEL = (0.56, 0.59, 0.62)
_SHELF = (0.48, 0.66, 0.72)


def one_door(obj: SceneObject) -> Asset:
    """Returns a refrigerator with one door over its whole height.

    Raises:
        AssetError: When its size or a parameter does not make one; so do the others of this file.
    """
    return _cold(obj, (Column((Row("door", _hinge(obj), shelves=SHELVES.count(obj)),)),))


def top_freezer(obj: SceneObject) -> Asset:
    """Returns a refrigerator with a freezer above it, each with a door of its own, hinged on the same side."""
    main = Row("door", _hinge(obj), 0.68, SHELVES.count(obj))
    return _cold(obj, (Column((main, Row("freezer_door", _hinge(obj), 0.32))),))


def freezer_drawer(obj: SceneObject) -> Asset:
    """Returns a refrigerator with a freezer drawer below its door."""
    main = Row("door", _hinge(obj), 0.68, SHELVES.count(obj))
    return _cold(obj, (Column((Row("freezer_drawer", "drawer", 0.32), main)),))


def side_by_side(obj: SceneObject) -> Asset:
    """Returns a refrigerator on the right and a freezer on the left, hinged at the outer sides."""
    count = SHELVES.count(obj)
    left = Column((Row("left_door", "left", shelves=count),), 0.46)
    return _cold(obj, (left, Column((Row("right_door", "right", shelves=count),), 0.54)))


def _hinge(obj: SceneObject) -> Closing:
    return "left" if HINGE.read(obj) == "left" else "right"


def _cold(obj: SceneObject, columns: tuple[Column, ...]) -> Asset:
    extent = require_size(obj, (0.50, 0.45 if len(columns) == 1 else 0.70, 1.0))
    case = Case(
        extent_m=extent,
        columns=columns,
        grip=Grip.of(obj),
        base_m=_BASE_M,
        wall_m=0.035,
        panel_m=0.050,
        density_kg_m3=200.0,
        handle_height_m=HANDLE_HEIGHT.read(obj),
        shelf_setback_m=0.060,
        body=_WHITE,
        front=_STEEL,
        inner=_SHELF,
    )
    return assemble(case, obj.category, "electric_refrigerator.n.01", extra=[plinth(case)], surfaces=[])


ENTRIES = tuple(
    Entry(model, "refrigerator", "electric_refrigerator.n.01", build, _LENGTH, width, height, parameters)
    for model, build, width, height, parameters in (
        ("fridge_one_door", one_door, _WIDTH, Span(1.15, 1.45), _PARAMETERS),
        ("fridge_top_freezer", top_freezer, _WIDTH, Span(1.40, 1.70), _PARAMETERS),
        ("fridge_freezer_drawer", freezer_drawer, _WIDTH, Span(1.40, 1.70), _PARAMETERS),
        ("fridge_side_by_side", side_by_side, Span(0.80, 0.95), Span(1.40, 1.70), _PARAMETERS[1:]),
    )
)
