"""Cupboards: a carcass divided into columns and rows, each row closed by a door or a drawer with a handle.

Refrigerators, cabinets, wardrobes, desks, ovens and shelves are layouts of this carcass, with a base and a top.

The front faces -x. The object's box ends at the handles in front and at the back of the carcass.

A door turns about a vertical or horizontal edge of its *outer* face. An open door therefore stays in front of its own
opening, and clears the frame, its neighbours and furniture that stands flush beside it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Literal

from executor.assets.families.shapes import UP, Color, box, surface
from executor.assets.model import IDENTITY, Asset, Handle, Joint, Link, Region, Shape, Vector
from executor.assets.parameters import ChoiceParameter, NumericParameter
from oag import SceneObject

Closing = Literal["left", "right", "bottom", "drawer", "open"]
GAP_M = 0.003  # Between the carcass and its panels, and around each panel: none touches another.
SEAM_M = 0.003

HINGE = ChoiceParameter("hinge", ("left", "right"))
# A bar 2 cm thick that stands 5.5 cm off its panel was opened by the 56 mm gripper in every one of the trials behind
# docs/results.md; the fingertips reach 7 mm past the middle of the bar. The ranges stay around these numbers.
HANDLE_KIND = ChoiceParameter("handle_kind", ("bar", "rod"))
HANDLE_LENGTH = NumericParameter("handle_length_m", 0.30, 0.14, 0.36)
HANDLE_THICKNESS = NumericParameter("handle_thickness_m", 0.020, 0.014, 0.024)
HANDLE_STANDOFF = NumericParameter("handle_standoff_m", 0.055, 0.048, 0.060)
HANDLE_PARAMETERS = (HANDLE_KIND, HANDLE_LENGTH, HANDLE_THICKNESS, HANDLE_STANDOFF)


def hinge_of(obj: SceneObject) -> Closing:
    """Return the hinge side of an object as seen by somebody who faces its front (left is +y)."""
    return "left" if HINGE.read(obj) == "left" else "right"


@dataclass(frozen=True, slots=True)
class Grip:
    """A handle's kind and dimensions.

    Attributes:
        kind: "bar" (square) or "rod" (round).
        standoff_m: From the panel's face to the middle of the bar.
    """

    kind: str
    length_m: float
    thickness_m: float
    standoff_m: float

    @classmethod
    def of(cls, obj: SceneObject) -> Grip:
        """Return the handle that the object's parameters describe."""
        return cls(
            HANDLE_KIND.read(obj), HANDLE_LENGTH.read(obj), HANDLE_THICKNESS.read(obj), HANDLE_STANDOFF.read(obj)
        )


NO_GRIP = Grip("bar", 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Compartment:
    """One compartment of a column.

    Attributes:
        name: Name of the moving link, or of the niche of an open compartment.
        closing: The hinge side of a door as seen by somebody who faces the front (left is +y), "drawer" or "open".
        share: Its part of the column's height, relative to the sum over the column.
    """

    name: str
    closing: Closing
    share: float = 1.0
    shelves: int = 0


@dataclass(frozen=True, slots=True)
class Column:
    """Compartments from the bottom up; columns are ordered from the left (+y) as seen from the front."""

    rows: tuple[Compartment, ...]
    share: float = 1.0


@dataclass(frozen=True, slots=True)
class Case:
    """Layout and dimensions of a cupboard.

    Attributes:
        base_m: Height of the base under the carcass, above the floor.
        top_m: Thickness of the slab on the carcass.
        wall_m: Thickness of the carcass's boards.
        panel_m: Thickness of doors and drawer fronts.
        handle_height_m: Preferred height of vertical handles above the floor.
        shelf_setback_m: Distance of shelves behind the carcass's front.
        niche: Kind of an open compartment's region: "interior", or "surface" for open shelves.
    """

    extent_m: Vector
    columns: tuple[Column, ...]
    grip: Grip
    base_m: float = 0.08
    top_m: float = 0.0
    wall_m: float = 0.018
    panel_m: float = 0.020
    density_kg_m3: float = 600.0
    handle_height_m: float = 0.72
    shelf_setback_m: float = 0.020
    body: Color = (0.62, 0.63, 0.60)
    front: Color = (0.52, 0.57, 0.55)
    inner: Color = (0.72, 0.64, 0.52)
    window: Color | None = None
    niche: Literal["interior", "surface"] = "interior"

    @property
    def x(self) -> tuple[float, float]:
        """The carcass's front and back planes in the root frame."""
        half = self.extent_m[0] / 2
        closed = any(row.closing != "open" for column in self.columns for row in column.rows)
        handle_m = self.grip.standoff_m + self.grip.thickness_m / 2
        return -half + (GAP_M + self.panel_m + handle_m if closed else 0.0), half

    @property
    def z(self) -> tuple[float, float]:
        """The carcass's bottom and top in the root frame."""
        half = self.extent_m[2] / 2
        return -half + self.base_m, half - self.top_m


@dataclass(frozen=True, slots=True)
class Opening:
    """A compartment of a carcass and the panel that covers it, in the root frame.

    Attributes:
        row: Its compartment in the layout.
        y, z: Clear opening between the walls.
        x: Front edge of the walls and inner face of the back.
        panel_y, panel_z: The panel's outline, without seams.
        hinge_is_inner: Whether another panel lies behind its hinge.
    """

    row: Compartment
    x: tuple[float, float]
    y: tuple[float, float]
    z: tuple[float, float]
    panel_y: tuple[float, float]
    panel_z: tuple[float, float]
    hinge_is_inner: bool


_DOOR_LIMIT_RAD = 1.9
# Doors whose hinge has another panel behind it stop square to the front.
_INNER_LIMIT_RAD = 1.55
_DROP_LIMIT_RAD = 1.5  # Just above level, so that things put onto the door do not slide off.
_HANDLE_INSET_M = 0.050
# A drawer's box keeps off the carcass by so much.
_SIDE_CLEARANCE_M, _BOTTOM_CLEARANCE_M, _TOP_CLEARANCE_M, _BACK_CLEARANCE_M = 0.008, 0.010, 0.015, 0.015
_BOX_WALL_M = 0.010
_TRAVEL_RATIO = 0.75  # A drawer stays on its rails by a quarter of its depth.
_END_MARGIN_M = 0.03
_SHORTEST_M = 0.10  # Of a bar: the hand is narrower.
_POST_M = 0.010
_POST_INSET_M = 0.012
_METAL = (0.13, 0.13, 0.14)


@dataclass(frozen=True, slots=True)
class MovingPart:
    """A moving part: its link, joint and handle, and the regions that it carries."""

    link: Link
    joint: Joint
    handle: Handle
    regions: tuple[Region, ...] = ()


def front(case: Case, opening: Opening) -> MovingPart | None:
    """Return the front that closes an opening of a case, or None for an open one.

    The link has the row's name; the joint is called `<name>_hinge` or `<name>_slide`.
    """
    closing = opening.row.closing
    if closing == "open":
        return None
    if closing == "drawer":
        return _drawer(case, opening)
    return _drop_door(case, opening) if closing == "bottom" else _door(case, opening)


def _door(case: Case, opening: Opening) -> MovingPart:
    name, side = opening.row.name, 1.0 if opening.row.closing == "left" else -1.0
    (y0, y1), (z0, z1) = opening.panel_y, opening.panel_z
    width, middle, half = y1 - y0, (z0 + z1) / 2, (z1 - z0) / 2
    edge = (opening.x[0] - GAP_M - case.panel_m, y1 if side > 0 else y0, middle)
    limits = (0.0, _INNER_LIMIT_RAD if opening.hinge_is_inner else _DOOR_LIMIT_RAD)
    joint = Joint(f"{name}_hinge", "revolute", "body", name, edge, (0.0, 0.0, -side), limits)
    room = half - min(case.grip.length_m / 2, half - 0.03) - 0.03
    z = min(max(case.handle_height_m - case.extent_m[2] / 2 - middle, -room), room)
    shapes, handle = _handle_on(joint, case.grip, -side * (width - _HANDLE_INSET_M), z, "z", 2 * half)
    panel = _panel(case, (-width, 0.0) if side > 0 else (0.0, width), (-half, half))
    return MovingPart(Link(name, (*panel, *shapes)), joint, handle)


def _drop_door(case: Case, opening: Opening) -> MovingPart:
    name, (y0, y1), (z0, z1) = opening.row.name, opening.panel_y, opening.panel_z
    width, height = y1 - y0, z1 - z0
    edge = (opening.x[0] - GAP_M - case.panel_m, (y0 + y1) / 2, z0)
    limits = (0.0, _DROP_LIMIT_RAD)
    joint = Joint(f"{name}_hinge", "revolute", "body", name, edge, (0.0, -1.0, 0.0), limits, balanced=True)
    shapes, handle = _handle_on(joint, case.grip, 0.0, height - _HANDLE_INSET_M, "y", width)
    panel = _panel(case, (-width / 2, width / 2), (0.0, height))
    return MovingPart(Link(name, (*panel, *shapes)), joint, handle)


def _drawer(case: Case, opening: Opening) -> MovingPart:
    name, (y0, y1), (z0, z1) = opening.row.name, opening.panel_y, opening.panel_z
    x0, y, z = opening.x[0] - GAP_M - case.panel_m, (y0 + y1) / 2, (z0 + z1) / 2
    half_y, half_z = (y1 - y0) / 2, (z1 - z0) / 2
    front_x, back = case.panel_m, opening.x[1] - _BACK_CLEARANCE_M - x0
    left, right = opening.y[0] + _SIDE_CLEARANCE_M - y, opening.y[1] - _SIDE_CLEARANCE_M - y
    low, ceiling = opening.z[0] + _BOTTOM_CLEARANCE_M - z, opening.z[1] - _TOP_CLEARANCE_M - z
    rim = low + 0.7 * (ceiling - low)
    limits, axis = (0.0, round(_TRAVEL_RATIO * (back - front_x), 3)), (-1.0, 0.0, 0.0)
    joint = Joint(f"{name}_slide", "prismatic", "body", name, (x0, y, z), axis, limits)
    shapes, handle = _handle_on(joint, case.grip, 0.0, 0.0, "y", 2 * half_y)
    inner_left, inner_right, floor = left + _BOX_WALL_M, right - _BOX_WALL_M, low + _BOX_WALL_M
    board = partial(box, color=case.inner, density_kg_m3=case.density_kg_m3)
    boards = (
        board((front_x, left, low), (back, right, floor)),
        board((front_x, left, floor), (back, inner_left, rim)),
        board((front_x, inner_right, floor), (back, right, rim)),
        board((back - _BOX_WALL_M, inner_left, floor), (back, inner_right, rim)),
    )
    center = ((front_x + back - _BOX_WALL_M) / 2, (inner_left + inner_right) / 2, (floor + ceiling) / 2)
    room = ((back - _BOX_WALL_M - front_x) / 2, (inner_right - inner_left) / 2, (ceiling - floor) / 2)
    region = Region(name, "interior", name, center, room, UP, joint.name)
    panel = _panel(case, (-half_y, half_y), (-half_z, half_z))
    return MovingPart(Link(name, (*panel, *boards, *shapes)), joint, handle, (region,))


def _panel(case: Case, y: tuple[float, float], z: tuple[float, float]) -> list[Shape]:
    """The panel behind the plane x = 0 of its link, with a window where the case has one."""
    panel = box((0.0, y[0], z[0]), (case.panel_m, y[1], z[1]), case.front, density_kg_m3=case.density_kg_m3)
    if case.window is None:
        return [panel]
    frame_y, frame_z = 0.16 * (y[1] - y[0]), 0.2 * (z[1] - z[0])
    low, high = (-0.001, y[0] + frame_y, z[0] + frame_z), (0.001, y[1] - frame_y, z[1] - frame_z)
    return [panel, box(low, high, case.window, collides=False)]


def _handle_on(
    joint: Joint, grip: Grip, y_m: float, z_m: float, along: Literal["y", "z"], room_m: float
) -> tuple[tuple[Shape, ...], Handle]:
    """Return the shapes of a handle on a panel, and the handle.

    The panel's outer face is its link's plane x = 0, facing -x. `y_m`, `z_m` are the middle of the bar in the link
    frame, `along` is the axis of the bar. Its length is cut to `room_m`, the panel's length along this axis.
    """
    length = max(_SHORTEST_M, min(grip.length_m, room_m - 2 * _END_MARGIN_M))
    half, x, upright = grip.thickness_m / 2, -grip.standoff_m, along == "z"

    def piece(x0: float, x1: float, y: float, z: float, across: float, length_m: float) -> Shape:
        half_y, half_z = (across, length_m) if upright else (length_m, across)
        low, high = (x0, y - half_y, z - half_z), (x1, y + half_y, z + half_z)
        return box(low, high, _METAL, friction=1.0, density_kg_m3=500.0)

    if grip.kind == "rod":
        rod = Shape(
            kind="cylinder",
            size_m=(half, length / 2),
            position_m=(x, y_m, z_m),
            orientation=IDENTITY if upright else (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0),
            color=_METAL,
            friction=1.0,
            density_kg_m3=500.0,
        )
        shapes = [rod]
    else:
        shapes = [piece(x - half, x + half, y_m, z_m, half, length / 2)]
    for end in (-1.0, 1.0):
        offset = end * (length / 2 - _POST_INSET_M)
        y, z = (y_m, z_m + offset) if upright else (y_m + offset, z_m)
        # The post starts inside the rod, whose surface curves away from it.
        shapes.append(piece(x + (half if grip.kind == "bar" else 0.0), 0.0, y, z, 0.8 * half, _POST_M))
    axis = UP if upright else (0.0, 1.0, 0.0)
    position = (x, y_m, z_m)
    return tuple(shapes), Handle(joint.child, joint.name, position, axis, (-1.0, 0.0, 0.0), length, grip.thickness_m)


_SHELF_M = 0.014
_CLEARANCE_M = 0.001
_KICK_M = 0.050
_INSET_M = 0.010
_LEG_M = 0.040
_DARK = (0.07, 0.07, 0.08)
_STONE = (0.74, 0.72, 0.68)


def assemble(
    case: Case, category: str, synset: str, *, extra: Sequence[Shape], surfaces: Sequence[Region] = ()
) -> Asset:
    """Assemble the asset: boards, doors and drawers, and a region for every compartment.

    Handles and regions of the larger doors come first.

    Args:
        extra: Further shapes of the body, such as a plinth or a countertop.
        surfaces: Further regions of the body, such as a countertop's.
    """
    boards: list[Shape] = list(_carcass(case))
    moving: list[tuple[float, MovingPart]] = []
    inside: list[tuple[float, Region]] = []
    for opening in _openings(case):
        part, drawer = front(case, opening), opening.row.closing == "drawer"
        size = (opening.y[1] - opening.y[0]) * (opening.z[1] - opening.z[0])
        rank = -size + (100.0 if drawer else 0.0)
        if part is not None:
            moving.append((rank, part))
            inside += [(rank, region) for region in part.regions]
        if not drawer:
            shelves, regions = _shelves(case, opening, None if part is None else part.joint.name)
            boards += shelves
            inside += [(rank, region) for region in regions]
    parts = [part for _, part in sorted(moving, key=lambda pair: pair[0])]
    return Asset(
        category=category,
        motion="articulated" if parts else "static",
        links=(Link("body", (*boards, *extra)), *(part.link for part in parts)),
        extent_m=case.extent_m,
        joints=tuple(part.joint for part in parts),
        handles=tuple(part.handle for part in parts),
        regions=(*(region for _, region in sorted(inside, key=lambda pair: pair[0])), *surfaces),
        synset=synset,
    )


def plinth(case: Case) -> Shape:
    """Return a dark base, set back from the doors like a kick space."""
    (x0, x1), (bottom, _), y, floor = case.x, case.z, case.extent_m[1] / 2, -case.extent_m[2] / 2
    return box((x0 + _KICK_M, -y + _INSET_M, floor), (x1 - _INSET_M, y - _INSET_M, bottom), _DARK)


def legs(case: Case, color: Color) -> list[Shape]:
    """Return four legs under the corners."""
    (x0, x1), (bottom, _), y, floor = case.x, case.z, case.extent_m[1] / 2, -case.extent_m[2] / 2
    return [
        box((x, side, floor), (x + _LEG_M, side + _LEG_M, bottom), color)
        for x in (x0 + _INSET_M, x1 - _INSET_M - _LEG_M)
        for side in (-y + _INSET_M, y - _INSET_M - _LEG_M)
    ]


def slab(case: Case, overhang_m: float, color: Color = _STONE) -> Shape:
    """Return the board on the carcass, `case.top_m` thick, that overhangs the front."""
    (x0, x1), (_, top), y, high = case.x, case.z, case.extent_m[1] / 2, case.extent_m[2] / 2
    return box((x0 - overhang_m, -y, top), (x1, y, high), color)


def top_of(case: Case, overhang_m: float = 0.0) -> Region:
    """Return the region on the cupboard's top."""
    (x0, x1), y, high = case.x, case.extent_m[1] / 2, case.extent_m[2] / 2
    return surface("body", (x1 - x0 + overhang_m) / 2, y, high, x_m=(x0 - overhang_m + x1) / 2)


def _carcass(case: Case) -> Iterator[Shape]:
    """Sides, back, top and bottom; partitions and decks come from the layout."""
    (x0, x1), (z0, z1), y, t = case.x, case.z, case.extent_m[1] / 2, case.wall_m
    yield box((x0, -y, z0), (x1, -y + t, z1), case.body)
    yield box((x0, y - t, z0), (x1, y, z1), case.body)
    yield box((x1 - t, -y + t, z0), (x1, y - t, z1), case.body)
    yield box((x0, -y + t, z1 - t), (x1 - t, y - t, z1), case.body)
    yield box((x0, -y + t, z0), (x1 - t, y - t, z0 + t), case.body)
    edges = _edges([column.share for column in case.columns], y, -y)
    for edge in edges[1:-1]:
        yield box((x0, edge - t / 2, z0 + t), (x1 - t, edge + t / 2, z1 - t), case.body)
    for index, column in enumerate(case.columns):
        high, low = _clear(edges, index, t)
        for level in _edges([row.share for row in column.rows], z0, z1)[1:-1]:
            yield box((x0, low, level - t / 2), (x1 - t, high, level + t / 2), case.body)


def _openings(case: Case) -> Iterator[Opening]:
    (x0, x1), (z0, z1), y, t = case.x, case.z, case.extent_m[1] / 2, case.wall_m
    edges = _edges([column.share for column in case.columns], y, -y)
    last = len(case.columns) - 1
    for index, column in enumerate(case.columns):
        high, low = _clear(edges, index, t)
        levels = _edges([row.share for row in column.rows], z0, z1)
        for place, row in enumerate(column.rows):
            yield Opening(
                row=row,
                x=(x0, x1 - t),
                y=(low, high),
                z=_clear(levels, place, t),
                panel_y=(edges[index + 1] + SEAM_M, edges[index] - SEAM_M),
                panel_z=(levels[place] + SEAM_M, levels[place + 1] - SEAM_M),
                hinge_is_inner=(row.closing == "left" and index > 0) or (row.closing == "right" and index < last),
            )


def _shelves(case: Case, opening: Opening, joint: str | None) -> tuple[list[Shape], list[Region]]:
    """Shelves of one compartment and the places on its floor and on them, from the bottom up."""
    (x0, x1), (y0, y1), (z0, z1), row = opening.x, opening.y, opening.z, opening.row
    tops = [z0 + (z1 - z0) * (index + 1) / (row.shelves + 1) for index in range(row.shelves)]
    front_x, c = x0 + case.shelf_setback_m, _CLEARANCE_M
    boards = [box((front_x, y0 + c, top - _SHELF_M), (x1 - c, y1 - c, top), case.inner) for top in tops]
    floors, ceilings = [z0, *tops], [*(top - _SHELF_M for top in tops), z1]
    regions = []
    for index, (floor, ceiling) in enumerate(zip(floors, ceilings, strict=True)):
        start = x0 if index == 0 else front_x
        center = ((start + x1) / 2, (y0 + y1) / 2, (floor + ceiling) / 2)
        half = ((x1 - start) / 2, (y1 - y0) / 2, (ceiling - floor) / 2)
        name = f"{row.name}_shelf_{index}" if index else f"{row.name}_bottom"
        kind = case.niche if joint is None else "interior"
        regions.append(Region(name, kind, "body", center, half, (-1.0, 0.0, 0.0), joint))
    return boards, regions


def _edges(shares: Sequence[float], start: float, end: float) -> list[float]:
    """Boundaries that divide a length by shares, both ends included."""
    total, edges = sum(shares), [start]
    for share in shares:
        edges.append(edges[-1] + (end - start) * share / total)
    edges[-1] = end
    return edges


def _clear(edges: Sequence[float], index: int, wall: float) -> tuple[float, float]:
    """The clear length between the boards at two neighbouring boundaries; outer boards lie inside their boundary."""
    start, end = list(pairwise(edges))[index]
    inward = 1.0 if end > start else -1.0
    first = wall if index == 0 else wall / 2
    second = wall if index == len(edges) - 2 else wall / 2
    return start + inward * first, end - inward * second
