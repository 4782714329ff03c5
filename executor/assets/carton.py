"""A closed carton, and an open box that holds things."""

from __future__ import annotations

from executor.assets.entry import Entry, Option, Quantity, Span
from executor.assets.model import Asset, Link, Region, Shape
from executor.assets.parameters import require_size
from executor.assets.placing import shorter_sides
from executor.assets.shapes import box
from oag import SceneObject

COLOR = Option("color", ("cardboard", "blue", "yellow"))
WALL = Quantity("wall_m", 0.005, 0.004, 0.008)
_COLORS = {"cardboard": (0.52, 0.36, 0.20), "blue": (0.12, 0.24, 0.45), "yellow": (0.72, 0.55, 0.10)}
_TAPE = (0.68, 0.60, 0.46)
_TAPE_M = 0.0004
_FRICTION = 0.8
_FULL_KG_M3, _BOARD_KG_M3 = 350.0, 700.0


def carton(obj: SceneObject) -> Asset:
    """Returns a closed carton as large as the object.

    Raises:
        AssetError: When it is too small.
    """
    extent = require_size(obj, (0.01, 0.01, 0.01))
    x, y, z = (value / 2 for value in extent)
    color = _COLORS[COLOR.read(obj)]
    whole = box((-x, -y, -z), (x, y, z), color, friction=_FRICTION, density_kg_m3=_FULL_KG_M3, visible=False)
    look = box((-x, -y, -z), (x, y, z - _TAPE_M), color, collides=False)
    tape = box((-0.999 * x, -0.12 * y, z - 2 * _TAPE_M), (0.999 * x, 0.12 * y, z), _TAPE, collides=False)
    return _packed(obj, (whole, look, tape), extent, ())


def open_box(obj: SceneObject) -> Asset:
    """Returns a box without a lid.

    Raises:
        AssetError: When it is too small for its walls.
    """
    extent = require_size(obj, (0.03, 0.03, 0.02))
    x, y, z = (value / 2 for value in extent)
    t, color = WALL.read(obj), _COLORS[COLOR.read(obj)]

    def board(low: tuple[float, float, float], high: tuple[float, float, float]) -> Shape:
        return box(low, high, color, friction=_FRICTION, density_kg_m3=_BOARD_KG_M3)

    shapes = (
        board((-x, -y, -z), (x, y, -z + t)),
        board((-x, -y, -z + t), (-x + t, y, z)),
        board((x - t, -y, -z + t), (x, y, z)),
        board((-x + t, -y, -z + t), (x - t, -y + t, z)),
        board((-x + t, y - t, -z + t), (x - t, y, z)),
    )
    region = Region(
        name="hollow",
        kind="interior",
        link="box",
        center_m=(0.0, 0.0, t / 2),
        half_extents_m=(x - t, y - t, z - t / 2),
        opening=(0.0, 0.0, 1.0),
    )
    return _packed(obj, shapes, extent, (region,))


def _packed(
    obj: SceneObject, shapes: tuple[Shape, ...], extent: tuple[float, float, float], regions: tuple[Region, ...]
) -> Asset:
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("box", shapes),),
        extent_m=extent,
        regions=regions,
        graspable_width_m=min(extent[:2]),
        synset="box.n.01",
        grasp_axes=shorter_sides(extent),
    )


ENTRIES = (
    Entry("carton", "box", "box.n.01", carton, Span(0.060, 0.120), Span(0.040, 0.060), Span(0.060, 0.160), (COLOR,)),
    Entry(
        "open_box",
        "box",
        "box.n.01",
        open_box,
        Span(0.140, 0.240),
        Span(0.120, 0.180),
        Span(0.060, 0.100),
        (COLOR, WALL),
    ),
)
