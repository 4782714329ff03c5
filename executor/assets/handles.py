"""Bars that the gripper closes on: upright ones for side hinges, level ones for drawers and bottom hinges.

Source: a bar 2 cm thick that stands 5.5 cm off its panel was opened by the 56 mm gripper in every one of the trials
behind `docs/results.md`; the fingertips reach 7 mm past the middle of the bar. The ranges stay around these numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from executor.assets.entry import Option, Quantity
from executor.assets.model import IDENTITY, Handle, Shape
from executor.assets.shapes import box
from oag import SceneObject

HANDLE_KIND = Option("handle_kind", ("bar", "rod"))
HANDLE_LENGTH = Quantity("handle_length_m", 0.30, 0.14, 0.36)
HANDLE_THICKNESS = Quantity("handle_thickness_m", 0.020, 0.014, 0.024)
HANDLE_STANDOFF = Quantity("handle_standoff_m", 0.055, 0.048, 0.060)
HANDLE_PARAMETERS = (HANDLE_KIND, HANDLE_LENGTH, HANDLE_THICKNESS, HANDLE_STANDOFF)
END_MARGIN_M = 0.03
SHORTEST_M = 0.10
_POST_M = 0.010
_POST_INSET_M = 0.012
_FRICTION = 1.0
_DENSITY_KG_M3 = 500.0
_METAL = (0.13, 0.13, 0.14)


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

    @property
    def protrusion_m(self) -> float:
        """How far the handle stands out from the panel's face."""
        return self.standoff_m + self.thickness_m / 2

    @classmethod
    def of(cls, obj: SceneObject) -> Grip:
        """Returns what the object's parameters say.

        Raises:
            AssetError: When one of them is not one that a handle can have.
        """
        return cls(
            HANDLE_KIND.read(obj), HANDLE_LENGTH.read(obj), HANDLE_THICKNESS.read(obj), HANDLE_STANDOFF.read(obj)
        )


def handle_on(
    link: str, joint: str, grip: Grip, y_m: float, z_m: float, along: Literal["y", "z"], room_m: float
) -> tuple[tuple[Shape, ...], Handle]:
    """Returns the shapes of a handle on a panel whose outer face is the link's plane x = 0, facing -x, and the handle.

    Args:
        link: The panel's link.
        joint: The joint that moves it.
        grip: Kind and dimensions; the length is cut to what the panel has room for.
        y_m, z_m: Middle of the bar in the link frame.
        along: The axis that the bar lies along.
        room_m: Length of the panel along that axis.
    """
    length = max(SHORTEST_M, min(grip.length_m, room_m - 2 * END_MARGIN_M))
    half, x = grip.thickness_m / 2, -grip.standoff_m
    upright = along == "z"
    if grip.kind == "rod":
        turn = IDENTITY if upright else (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
        rod = Shape(
            kind="cylinder",
            size_m=(half, length / 2),
            position_m=(x, y_m, z_m),
            orientation=turn,
            color=_METAL,
            friction=_FRICTION,
            density_kg_m3=_DENSITY_KG_M3,
        )
        shapes = [rod]
    else:
        shapes = [_piece((x - half, x + half), y_m, z_m, half, length / 2, upright=upright)]
    for end in (-1.0, 1.0):
        offset = end * (length / 2 - _POST_INSET_M)
        y, z = (y_m, z_m + offset) if upright else (y_m + offset, z_m)
        # The post starts inside the rod, whose surface curves away from it.
        start = x + (half if grip.kind == "bar" else 0.0)
        shapes.append(_piece((start, 0.0), y, z, 0.8 * half, _POST_M, upright=upright))
    axis = (0.0, 0.0, 1.0) if upright else (0.0, 1.0, 0.0)
    return tuple(shapes), Handle(link, joint, (x, y_m, z_m), axis, (-1.0, 0.0, 0.0), length, grip.thickness_m)


def _piece(x: tuple[float, float], y: float, z: float, across: float, along: float, *, upright: bool) -> Shape:
    half_y, half_z = (across, along) if upright else (along, across)
    low, high = (x[0], y - half_y, z - half_z), (x[1], y + half_y, z + half_z)
    return box(low, high, _METAL, friction=_FRICTION, density_kg_m3=_DENSITY_KG_M3)
