"""The layout of a cupboard: columns of rows, what closes each row, and what its handles are like.

The front faces -x; the object's box ends at the handles in front and at the carcass's back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from executor.assets.model import Vector
from executor.assets.parameters import Option, Quantity
from executor.assets.parts.shapes import Color
from oag import SceneObject

Closing = Literal["left", "right", "bottom", "drawer", "open"]
GAP_M = 0.003  # Between the carcass and its panels, and around each panel: none touches another.
SEAM_M = 0.003

HINGE = Option("hinge", ("left", "right"))
# A bar 2 cm thick that stands 5.5 cm off its panel was opened by the 56 mm gripper in every one of the trials behind
# docs/results.md; the fingertips reach 7 mm past the middle of the bar. The ranges stay around these numbers.
HANDLE_KIND = Option("handle_kind", ("bar", "rod"))
HANDLE_LENGTH = Quantity("handle_length_m", 0.30, 0.14, 0.36)
HANDLE_THICKNESS = Quantity("handle_thickness_m", 0.020, 0.014, 0.024)
HANDLE_STANDOFF = Quantity("handle_standoff_m", 0.055, 0.048, 0.060)
HANDLE_PARAMETERS = (HANDLE_KIND, HANDLE_LENGTH, HANDLE_THICKNESS, HANDLE_STANDOFF)


def hinge_of(obj: SceneObject) -> Closing:
    """Returns the side of an object's hinge for somebody who faces its front (left is +y)."""
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
        """Returns what the object's parameters say.

        Raises:
            AssetError: When one of them is not one that a handle can have.
        """
        return cls(
            HANDLE_KIND.read(obj), HANDLE_LENGTH.read(obj), HANDLE_THICKNESS.read(obj), HANDLE_STANDOFF.read(obj)
        )


NO_GRIP = Grip("bar", 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Compartment:
    """One compartment of a column.

    Attributes:
        name: Name of the moving link, or of the niche where nothing closes it.
        closing: The side of a door's hinge for somebody who faces the front (left is +y), "drawer" or "open".
        share: Its part of the column's height, against the sum of the column's.
        shelves: Shelves inside, at even distances.
    """

    name: str
    closing: Closing
    share: float = 1.0
    shelves: int = 0


@dataclass(frozen=True, slots=True)
class Column:
    """Compartments from the bottom up; columns go from the left (+y) of somebody who faces the front."""

    rows: tuple[Compartment, ...]
    share: float = 1.0


@dataclass(frozen=True, slots=True)
class Case:
    """A cupboard before it is cut into shapes.

    Attributes:
        extent_m: Whole thing, handles included.
        columns: The layout.
        base_m: Height of what carries the carcass, above the floor.
        top_m: Thickness of what lies on the carcass.
        wall_m: Thickness of the carcass's boards.
        panel_m: Thickness of doors and drawer fronts.
        handle_height_m: Where upright handles would best be, above the floor that it stands on.
        shelf_setback_m: How far shelves stand back from the carcass's front.
        niche: What an open compartment is: "interior", or "surface" for open shelves.
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
        row: What the layout says of it.
        y, z: Clear opening between the walls.
        x: Front edge of the walls and inner face of the back.
        panel_y, panel_z: The panel's outline, seams taken off.
        beside_hinge: Whether another panel lies behind its hinge.
    """

    row: Compartment
    x: tuple[float, float]
    y: tuple[float, float]
    z: tuple[float, float]
    panel_y: tuple[float, float]
    panel_z: tuple[float, float]
    beside_hinge: bool
