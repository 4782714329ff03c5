"""What closes an opening: doors with a hinge left, right or below, and drawers, each with a bar to take hold of.

A door turns about a vertical or level edge of its *outer* face. An open door so stays in front of its own opening
and clears the frame, its neighbours and furniture that stands flush beside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Literal

from executor.assets.model import IDENTITY, Handle, Joint, Link, Region, Shape
from executor.assets.parts.layout import GAP_M, Case, Grip, Opening
from executor.assets.parts.shapes import UP, box

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
class Moving:
    """A moving part: its link, joint and handle, and the places that it carries."""

    link: Link
    joint: Joint
    handle: Handle
    regions: tuple[Region, ...] = ()


def front(case: Case, opening: Opening) -> Moving | None:
    """Returns what closes an opening of a case, or None for an open one.

    The link has the row's name; the joint is called `<name>_hinge` or `<name>_slide`.
    """
    closing = opening.row.closing
    if closing == "open":
        return None
    if closing == "drawer":
        return _drawer(case, opening)
    return _drop_door(case, opening) if closing == "bottom" else _door(case, opening)


def _door(case: Case, opening: Opening) -> Moving:
    name, side = opening.row.name, 1.0 if opening.row.closing == "left" else -1.0
    (y0, y1), (z0, z1) = opening.panel_y, opening.panel_z
    width, middle, half = y1 - y0, (z0 + z1) / 2, (z1 - z0) / 2
    edge = (opening.x[0] - GAP_M - case.panel_m, y1 if side > 0 else y0, middle)
    limits = (0.0, _INNER_LIMIT_RAD if opening.beside_hinge else _DOOR_LIMIT_RAD)
    joint = Joint(f"{name}_hinge", "revolute", "body", name, edge, (0.0, 0.0, -side), limits)
    room = half - min(case.grip.length_m / 2, half - 0.03) - 0.03
    z = min(max(case.handle_height_m - case.extent_m[2] / 2 - middle, -room), room)
    shapes, handle = _handle_on(joint, case.grip, -side * (width - _HANDLE_INSET_M), z, "z", 2 * half)
    panel = _panel(case, (-width, 0.0) if side > 0 else (0.0, width), (-half, half))
    return Moving(Link(name, (*panel, *shapes)), joint, handle)


def _drop_door(case: Case, opening: Opening) -> Moving:
    name, (y0, y1), (z0, z1) = opening.row.name, opening.panel_y, opening.panel_z
    width, height = y1 - y0, z1 - z0
    edge = (opening.x[0] - GAP_M - case.panel_m, (y0 + y1) / 2, z0)
    limits = (0.0, _DROP_LIMIT_RAD)
    joint = Joint(f"{name}_hinge", "revolute", "body", name, edge, (0.0, -1.0, 0.0), limits, balanced=True)
    shapes, handle = _handle_on(joint, case.grip, 0.0, height - _HANDLE_INSET_M, "y", width)
    panel = _panel(case, (-width / 2, width / 2), (0.0, height))
    return Moving(Link(name, (*panel, *shapes)), joint, handle)


def _drawer(case: Case, opening: Opening) -> Moving:
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
    return Moving(Link(name, (*panel, *boards, *shapes)), joint, handle, (region,))


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
    """The shapes of a handle on a panel whose outer face is its link's plane x = 0, facing -x, and the handle.

    `y_m`, `z_m` are the middle of the bar in the link frame, `along` is the axis that it lies along; its length is cut
    to `room_m`, that of the panel along this axis.
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
