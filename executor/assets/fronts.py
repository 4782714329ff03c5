"""What closes an opening: doors with a hinge left, right or below, and drawers.

A door turns about a vertical or level edge of its *outer* face. An open door so stays in front of its own opening
and clears the frame, its neighbours and furniture that stands flush beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from executor.assets.handles import Grip, handle_on
from executor.assets.model import Handle, Joint, Link, Region, Shape
from executor.assets.shapes import box

GAP_M = 0.003
SEAM_M = 0.003
HANDLE_INSET_M = 0.050
DROP_LIMIT_RAD = 1.5
_SIDE_CLEARANCE_M = 0.008
_BOTTOM_CLEARANCE_M = 0.010
_TOP_CLEARANCE_M = 0.015
_BACK_CLEARANCE_M = 0.015
_BOX_WALL_M = 0.010
_TRAVEL_RATIO = 0.75

Color = tuple[float, ...]
Closing = Literal["left", "right", "bottom", "drawer", "open"]


@dataclass(frozen=True, slots=True)
class Opening:
    """A compartment of a carcass and the panel that covers it, in the root frame.

    Attributes:
        y, z: Clear opening between the walls.
        x: Front edge of the walls and inner face of the back.
        panel_y, panel_z: The panel's outline, seams taken off.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    z: tuple[float, float]
    panel_y: tuple[float, float]
    panel_z: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Finish:
    """How panels are made.

    Attributes:
        panel_m: Thickness of doors and drawer fronts.
        handle_z: Where the middle of an upright handle would best be, in the root frame.
        door_limit_rad: How far side-hinged doors open.
    """

    panel_m: float
    density_kg_m3: float
    front: Color
    inner: Color
    handle_z: float
    door_limit_rad: float
    window: Color | None = None


@dataclass(frozen=True, slots=True)
class Moving:
    """A moving part: its link, joint and handle, and the places that it carries."""

    link: Link
    joint: Joint
    handle: Handle
    regions: tuple[Region, ...] = ()


def front(name: str, closing: Closing, opening: Opening, finish: Finish, grip: Grip) -> Moving | None:
    """Returns what closes an opening, or None for an open one.

    Args:
        name: Name of the moving link; the joint is called `<name>_hinge` or `<name>_slide`.
        closing: Where the hinge is for somebody who faces the front (left is +y), "drawer" or "open".
        opening: The compartment.
        finish: Panel thickness, colours, density.
        grip: The handle.
    """
    if closing == "open":
        return None
    if closing == "drawer":
        return _drawer(name, opening, finish, grip)
    return (
        _drop_door(name, opening, finish, grip) if closing == "bottom" else _door(name, closing, opening, finish, grip)
    )


def _door(name: str, closing: Closing, opening: Opening, finish: Finish, grip: Grip) -> Moving:
    side = 1.0 if closing == "left" else -1.0
    (y0, y1), (z0, z1) = opening.panel_y, opening.panel_z
    width, middle, half = y1 - y0, (z0 + z1) / 2, (z1 - z0) / 2
    joint = Joint(
        name=f"{name}_hinge",
        kind="revolute",
        parent="body",
        child=name,
        position_m=(opening.x[0] - GAP_M - finish.panel_m, y1 if side > 0 else y0, middle),
        axis=(0.0, 0.0, -side),
        limits=(0.0, finish.door_limit_rad),
    )
    room = half - min(grip.length_m / 2, half - 0.03) - 0.03
    z = min(max(finish.handle_z - middle, -room), room)
    shapes, handle = handle_on(name, joint.name, grip, -side * (width - HANDLE_INSET_M), z, "z", 2 * half)
    across = (-width, 0.0) if side > 0 else (0.0, width)
    panel = _panel(across, (-half, half), finish)
    return Moving(Link(name, (*panel, *shapes)), joint, handle)


def _drop_door(name: str, opening: Opening, finish: Finish, grip: Grip) -> Moving:
    (y0, y1), (z0, z1) = opening.panel_y, opening.panel_z
    width, height = y1 - y0, z1 - z0
    joint = Joint(
        name=f"{name}_hinge",
        kind="revolute",
        parent="body",
        child=name,
        position_m=(opening.x[0] - GAP_M - finish.panel_m, (y0 + y1) / 2, z0),
        axis=(0.0, -1.0, 0.0),
        limits=(0.0, DROP_LIMIT_RAD),
        balanced=True,
    )
    shapes, handle = handle_on(name, joint.name, grip, 0.0, height - HANDLE_INSET_M, "y", width)
    panel = _panel((-width / 2, width / 2), (0.0, height), finish)
    return Moving(Link(name, (*panel, *shapes)), joint, handle)


def _drawer(name: str, opening: Opening, finish: Finish, grip: Grip) -> Moving:
    (y0, y1), (z0, z1) = opening.panel_y, opening.panel_z
    x0, y, z = opening.x[0] - GAP_M - finish.panel_m, (y0 + y1) / 2, (z0 + z1) / 2
    half_y, half_z = (y1 - y0) / 2, (z1 - z0) / 2
    front_x, back = finish.panel_m, opening.x[1] - _BACK_CLEARANCE_M - x0
    left, right = opening.y[0] + _SIDE_CLEARANCE_M - y, opening.y[1] - _SIDE_CLEARANCE_M - y
    low, ceiling = opening.z[0] + _BOTTOM_CLEARANCE_M - z, opening.z[1] - _TOP_CLEARANCE_M - z
    rim = low + 0.7 * (ceiling - low)
    joint = Joint(
        name=f"{name}_slide",
        kind="prismatic",
        parent="body",
        child=name,
        position_m=(x0, y, z),
        axis=(-1.0, 0.0, 0.0),
        limits=(0.0, round(_TRAVEL_RATIO * (back - front_x), 3)),
        friction=0.5,
        damping=5.0,
    )
    shapes, handle = handle_on(name, joint.name, grip, 0.0, 0.0, "y", 2 * half_y)
    inner_left, inner_right, floor = left + _BOX_WALL_M, right - _BOX_WALL_M, low + _BOX_WALL_M

    def board(corner: tuple[float, float, float], opposite: tuple[float, float, float]) -> Shape:
        return box(corner, opposite, finish.inner, density_kg_m3=finish.density_kg_m3)

    boards = (
        board((front_x, left, low), (back, right, floor)),
        board((front_x, left, floor), (back, inner_left, rim)),
        board((front_x, inner_right, floor), (back, right, rim)),
        board((back - _BOX_WALL_M, inner_left, floor), (back, inner_right, rim)),
    )
    region = Region(
        name=name,
        kind="interior",
        link=name,
        center_m=((front_x + back - _BOX_WALL_M) / 2, (inner_left + inner_right) / 2, (floor + ceiling) / 2),
        half_extents_m=(
            (back - _BOX_WALL_M - front_x) / 2,
            (inner_right - inner_left) / 2,
            (ceiling - floor) / 2,
        ),
        opening=(0.0, 0.0, 1.0),
        joint=joint.name,
    )
    panel = _panel((-half_y, half_y), (-half_z, half_z), finish)
    return Moving(Link(name, (*panel, *boards, *shapes)), joint, handle, (region,))


def _panel(y: tuple[float, float], z: tuple[float, float], finish: Finish) -> list[Shape]:
    """The panel behind the plane x = 0 of its link, with a window where the finish has one."""
    panel = box((0.0, y[0], z[0]), (finish.panel_m, y[1], z[1]), finish.front, density_kg_m3=finish.density_kg_m3)
    if finish.window is None:
        return [panel]
    frame_y, frame_z = 0.16 * (y[1] - y[0]), 0.2 * (z[1] - z[0])
    low, high = (-0.001, y[0] + frame_y, z[0] + frame_z), (0.001, y[1] - frame_y, z[1] - frame_z)
    return [panel, box(low, high, finish.window, collides=False)]
