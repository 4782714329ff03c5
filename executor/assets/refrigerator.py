"""An upright refrigerator with one door: the front faces -x, and a bar handle stands off the door.

Parameters of the scene object (all optional): `hinge` "left" or "right" as seen by somebody who faces the
door (left is the +y side), `shelf_heights_m` above the floor the refrigerator stands on, `handle_height_m`,
`handle_length_m`.
"""

from __future__ import annotations

from dataclasses import dataclass

from executor.assets.model import Asset, Handle, Joint, Link, Region, Shape
from executor.assets.parameters import AssetError, choice, number, numbers, require_size
from executor.assets.shapes import box
from oag import SceneObject

DOOR_JOINT = "door_hinge"
DOOR_LIMIT_RAD = 2.2
HANDLE_STANDOFF_M = 0.055
HANDLE_THICKNESS_M = 0.020
_WALL_M = 0.030
_DOOR_M = 0.050
_GASKET_M = 0.004
_FLOOR_GAP_M = 0.060
_SHELF_M = 0.016
_SHELF_SETBACK_M = 0.080
_HANDLE_INSET_M = 0.050
# Inner faces lie a little apart from each other so that no two of them are drawn in the same plane.
_CLEARANCE_M = 0.001
_WHITE = (0.80, 0.82, 0.84)
_LINER = (0.88, 0.90, 0.91)
_STEEL = (0.56, 0.59, 0.62)
_DARK = (0.05, 0.05, 0.06)
_GLASS = (0.48, 0.66, 0.72)


@dataclass(frozen=True, slots=True)
class _Frame:
    """Planes of one refrigerator in its own frame; `bottom` is the body's, above the plinth's `floor`."""

    front: float
    back: float
    half_width: float
    floor: float
    bottom: float
    top: float
    side: float  # +1.0 where the hinge is on the +y side, -1.0 on the other.


def refrigerator(obj: SceneObject) -> Asset:
    """Returns the refrigerator's geometry at the object's size.

    Raises:
        AssetError: When a parameter or the size does not make a refrigerator.
    """
    depth, width, height = require_size(obj, (0.35, 0.30, 0.50))
    protrusion = _GASKET_M + _DOOR_M + HANDLE_STANDOFF_M + HANDLE_THICKNESS_M / 2
    frame = _Frame(
        front=-depth / 2 + protrusion,
        back=depth / 2,
        half_width=width / 2,
        floor=-height / 2,
        bottom=-height / 2 + _FLOOR_GAP_M,
        top=height / 2,
        side=1.0 if choice(obj, "hinge", "left", ("left", "right")) == "left" else -1.0,
    )
    shelves = _shelf_tops(obj, frame, height)
    door, handle = _door(obj, frame, height)
    return Asset(
        category="refrigerator",
        motion="articulated",
        links=(Link("body", (*_body(frame), *_shelves(frame, shelves))), Link("door", door)),
        extent_m=(depth, width, height),
        joints=(
            Joint(
                name=DOOR_JOINT,
                kind="revolute",
                parent="body",
                child="door",
                position_m=(frame.front, frame.side * frame.half_width, 0.0),
                axis=(0.0, 0.0, -frame.side),
                limits=(0.0, DOOR_LIMIT_RAD),
            ),
        ),
        handles=(handle,),
        regions=_compartments(frame, shelves),
        synset="refrigerator.n.01",
    )


def _shelf_tops(obj: SceneObject, frame: _Frame, height: float) -> tuple[float, ...]:
    heights = numbers(obj, "shelf_heights_m", tuple(h for h in (0.42, 0.72) if h < height - 0.15))
    low, high = _FLOOR_GAP_M + _WALL_M + 0.10, height - _WALL_M - 0.10
    for shelf in heights:
        if not low <= shelf <= high:
            raise AssetError(obj, f"a shelf at {shelf:.3f} m", f"shelves fit from {low:.3f} m to {high:.3f} m")
    return tuple(frame.floor + shelf for shelf in heights)


def _body(frame: _Frame) -> list[Shape]:
    x0, x1, y, z0, z1 = frame.front, frame.back, frame.half_width, frame.bottom, frame.top
    inner = y - _WALL_M
    return [
        box((x0, -y, z0), (x1, -inner, z1), _WHITE),
        box((x0, inner, z0), (x1, y, z1), _WHITE),
        box((x1 - _WALL_M, -inner, z0), (x1, inner, z1), _WHITE),
        box((x0, -inner, z1 - _WALL_M), (x1 - _WALL_M, inner, z1), _WHITE),
        box((x0, -inner, z0), (x1 - _WALL_M, inner, z0 + _WALL_M), _LINER),
        # The plinth stands back from the door, as a kick space does.
        box((x0 + 0.05, -y + 0.02, frame.floor), (x1 - 0.02, y - 0.02, z0), _DARK),
    ]


def _shelves(frame: _Frame, tops: tuple[float, ...]) -> list[Shape]:
    inner = frame.half_width - _WALL_M - _CLEARANCE_M
    front, back = frame.front + _SHELF_SETBACK_M, frame.back - _WALL_M - _CLEARANCE_M
    return [box((front, -inner, z - _SHELF_M), (back, inner, z), _GLASS) for z in tops]


def _door(obj: SceneObject, frame: _Frame, height: float) -> tuple[tuple[Shape, ...], Handle]:
    """Shapes and handle in the door's frame, whose origin is on the hinge line at mid height."""
    side, width = frame.side, 2 * frame.half_width
    low, high = frame.bottom + 0.005, frame.top - 0.005
    outer = -_GASKET_M - _DOOR_M

    def across(a: float, b: float) -> tuple[float, float]:
        return (min(-side * a, -side * b), max(-side * a, -side * b))

    y0, y1 = across(0.0, width)
    g0, g1 = across(0.012, width - 0.012)
    l0, l1 = across(0.037, width - 0.037)
    grip_y = width - _HANDLE_INSET_M
    h0, h1 = across(grip_y - HANDLE_THICKNESS_M / 2, grip_y + HANDLE_THICKNESS_M / 2)
    middle = number(obj, "handle_height_m", min(0.75, 0.65 * height), 0.2, height - 0.2) + frame.floor
    length = number(obj, "handle_length_m", 0.34, 0.12, height - 0.3)
    bar_x = outer - HANDLE_STANDOFF_M
    half = HANDLE_THICKNESS_M / 2
    shapes = [
        box((outer, y0, low), (-_GASKET_M, y1, high), _STEEL, density_kg_m3=200.0),
        box((-_GASKET_M, g0, low + 0.012), (-0.002, g1, high - 0.012), _DARK, collides=False),
        box((-0.002, l0, low + 0.037), (-_CLEARANCE_M, l1, high - 0.037), _LINER, collides=False),
        _bar((bar_x - half, h0, middle - length / 2), (bar_x + half, h1, middle + length / 2)),
    ]
    for end in (-1.0, 1.0):
        z = middle + end * (length / 2 - 0.012)
        shapes.append(_bar((bar_x + half, h0 + 0.002, z - 0.01), (outer, h1 - 0.002, z + 0.01)))
    handle = Handle(
        link="door",
        joint=DOOR_JOINT,
        position_m=(bar_x, (h0 + h1) / 2, middle),
        axis=(0.0, 0.0, 1.0),
        outward=(-1.0, 0.0, 0.0),
        length_m=length,
        thickness_m=HANDLE_THICKNESS_M,
    )
    return tuple(shapes), handle


def _bar(low: tuple[float, float, float], high: tuple[float, float, float]) -> Shape:
    """A piece of the handle, rougher and lighter than the rest."""
    return box(low, high, _DARK, friction=1.0, density_kg_m3=500.0)


def _compartments(frame: _Frame, tops: tuple[float, ...]) -> tuple[Region, ...]:
    """One interior region for the bottom and one for each shelf, from the bottom up."""
    inner = frame.half_width - _WALL_M
    floors = (frame.bottom + _WALL_M, *tops)
    ceilings = (*(z - _SHELF_M for z in tops), frame.top - _WALL_M)
    back = frame.back - _WALL_M
    regions = []
    for index, (floor, ceiling) in enumerate(zip(floors, ceilings, strict=True)):
        front = frame.front + (_SHELF_SETBACK_M if index else 0.0)
        regions.append(
            Region(
                name="bottom" if index == 0 else f"shelf_{index}",
                kind="interior",
                link="body",
                center_m=((front + back) / 2, 0.0, (floor + ceiling) / 2),
                half_extents_m=((back - front) / 2, inner, (ceiling - floor) / 2),
                opening=(-1.0, 0.0, 0.0),
                joint=DOOR_JOINT,
            )
        )
    return tuple(regions)
