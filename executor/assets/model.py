"""Asset data: links with shapes, joints, handles, controls, and regions where things can be put.

The module is pure data and needs no simulator. `executor.assets.build` turns an `Asset` into SAPIEN bodies, the planner
reads its handles and regions, and the detectors read its regions and joints. All three use the same numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)


LEAST_TRAVEL: Mapping[str, float] = MappingProxyType({"revolute": 0.2, "prismatic": 0.02})
"""Least range of a door or a drawer, [rad] (11 degrees) or [m]."""


@dataclass(frozen=True, slots=True)
class Shape:
    """One convex primitive of a link, with its own friction and density.

    Attributes:
        kind: "box" (size_m = half extents), "cylinder" (size_m = radius, half length; axis z), "sphere" (size_m =
            radius,), "convex" (physics only: the hull of `vertices_m`) or "mesh" (visual only: `vertices_m` and
            `triangles`).
        size_m: Dimensions [m], as above.
        position_m: Centre in the link frame.
        orientation: Quaternion w x y z in the link frame.
        color: Linear RGB in [0, 1], with an optional alpha.
        density_kg_m3: Density, used for mass and inertia of dynamic bodies and moving links.
    """

    kind: Literal["box", "cylinder", "sphere", "convex", "mesh"]
    size_m: tuple[float, ...] = ()
    position_m: Vector = (0.0, 0.0, 0.0)
    orientation: Quaternion = IDENTITY
    color: tuple[float, ...] = (0.7, 0.7, 0.7)
    friction: float = 0.8
    density_kg_m3: float = 1000.0
    collides: bool = True
    visible: bool = True
    vertices_m: tuple[Vector, ...] = ()
    triangles: tuple[tuple[int, int, int], ...] = ()


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid part of an asset; the first link of an asset is its root and carries the object's frame."""

    name: str
    shapes: tuple[Shape, ...]


@dataclass(frozen=True, slots=True)
class Joint:
    """A revolute or prismatic joint between the root link and a moving link.

    At position 0 the moving link's frame coincides with (`position_m`, axes of the parent). The joint turns about or
    slides along `axis` (unit vector in the parent frame), and positive motion opens it.

    Attributes:
        limits: Lower and upper position, [rad] (revolute) or [m] (prismatic); the lower one is "shut".
        friction: Dry friction, [N m] (revolute) or [N] (prismatic), independent of speed and load.
        gasket: Closing force or torque at the shut position, in the same unit.
        gasket_reach: Position above the lower limit, [rad] or [m], at which the gasket's force reaches zero.
        balanced: Whether springs carry the moving link's weight, as in an oven's door.
    """

    name: str
    kind: Literal["revolute", "prismatic"]
    parent: str
    child: str
    position_m: Vector
    axis: Vector
    limits: tuple[float, float]
    friction: float = 2.0
    balanced: bool = False
    gasket: float = 0.0
    gasket_reach: float = 0.0

    @property
    def opens(self) -> bool:
        """Whether its range suffices for a door or a drawer."""
        return self.limits[1] - self.limits[0] >= LEAST_TRAVEL[self.kind]

    def fraction(self, position: float) -> float:
        """Return the open fraction of the joint's range at a position, 0 to 1."""
        low, high = self.limits
        return (position - low) / (high - low)

    def pull(self, position: float) -> float:
        """Return the gasket's force at a position: 0 or negative, [N m] or [N]."""
        away = position - self.limits[0]
        return -self.gasket * max(1.0 - max(away, 0.0) / self.gasket_reach, 0.0) if self.gasket else 0.0

    def position(self, fraction: float) -> float:
        """Return the position, [rad] or [m], at an open fraction of the joint's range."""
        low, high = self.limits
        return low + fraction * (high - low)

    def start(self, open_fraction: float) -> float:
        """Return the position, [rad] or [m], in a scene where its object is open by a fraction."""
        return self.position(open_fraction)


@dataclass(frozen=True, slots=True)
class Handle:
    """A bar that the gripper can close on.

    Attributes:
        position_m: Centre of the bar in the link frame.
        axis: Unit vector along the bar, in the link frame.
        outward: Unit vector that points away from the front panel, in the link frame (the hand approaches against it).
        thickness_m: Thickness of the bar across the fingers.
    """

    link: str
    joint: str
    position_m: Vector
    axis: Vector
    outward: Vector
    length_m: float
    thickness_m: float


@dataclass(frozen=True, slots=True)
class Control(Joint):
    """A push button (prismatic) or a knob (revolute): a joint that switches its object on and off.

    A button moves inwards. Its latch changes each time that it is pressed past `click`: it then rests at `set_to`, or
    at 0 again. A knob stays where it is turned to.

    Attributes:
        grip: What the hand acts on: a button's face, or the bar across a knob. Its joint is this one.
        on_from: Position, [rad] or [m], from which on the object is switched on.
        set_to: Position of a button that is latched, or to which a knob is turned.
        click: Position past which a button's latch changes; 0 for a knob.
        spring_n_m: Stiffness [N/m] that moves a button to where it rests.
        switched_on: Whether it is switched on at the start.
    """

    grip: Handle = field(kw_only=True)
    on_from: float = field(kw_only=True)
    set_to: float = field(kw_only=True)
    click: float = 0.0
    spring_n_m: float = 0.0
    switched_on: bool = False

    @property
    def opens(self) -> bool:
        """Nothing opens by it."""
        return False

    @property
    def is_button(self) -> bool:
        """Whether it is pressed, and not turned."""
        return self.kind == "prismatic"

    def is_on(self, position: float) -> bool:
        """Return whether a position, [rad] or [m], is that of an object that is switched on."""
        return position >= self.on_from

    def start(self, open_fraction: float) -> float:
        """Return the position, [rad] or [m], at the start, whatever stands open."""
        return self.set_to if self.switched_on else self.limits[0]


UPWARD = 0.5  # Vertical part of the direction of an opening.


@dataclass(frozen=True, slots=True)
class Region:
    """A box in which, or on the bottom of which, things can be put.

    The bottom face of the box is the supporting surface: a thing placed in the region stands on it.

    Attributes:
        kind: "interior" (the volume counts for `inside`) or "surface" (its bottom counts for `ontop`).
        center_m: Centre of the box in the link frame.
        half_extents_m: Half extents of the box in the link frame.
        opening: Unit vector, in the link frame, that points out through the open side (the hand enters against it).
        joint: The joint that closes it, or None for an open container or a surface.
    """

    name: str
    kind: Literal["interior", "surface"]
    link: str
    center_m: Vector
    half_extents_m: Vector
    opening: Vector
    joint: str | None = None

    @property
    def opens_upward(self) -> bool:
        """Whether things come in from above, as into a drawer, and not through a front."""
        return self.opening[2] > UPWARD

    @property
    def floor_m(self) -> Vector:
        """Centre of the supporting surface, in the link frame."""
        x, y, z = self.center_m
        return x, y, z - self.half_extents_m[2]

    @property
    def height_m(self) -> float:
        """Height from the supporting surface to the top of the box."""
        return 2 * self.half_extents_m[2]


@dataclass(frozen=True, slots=True)
class Rim:
    """The wall of a round hollow object, which two fingers can grasp from inside and outside.

    Attributes:
        center_m: Centre of the circle along which the wall's upper edge runs, in the root frame.
        radius_m: Radius of that circle, to the middle of the wall.
        thickness_m: Thickness of the wall.
        slope_rad: Outward lean of the wall; 0 is vertical.
        depth_m: Length of the wall, from its upper edge down along it.
        sides: Number of flat pieces of the wall; the first one faces the root frame's +x.
    """

    center_m: Vector
    radius_m: float
    thickness_m: float
    slope_rad: float
    depth_m: float
    sides: int


@dataclass(frozen=True, slots=True)
class Asset:
    """Geometry of one concrete object, at its final size.

    Attributes:
        category: Scene category, such as "refrigerator".
        motion: "static", "dynamic" (one free rigid body) or "articulated" (root fixed to the world).
        links: Root first.
        extent_m: Bounding box of the whole object, joints shut; the root frame's origin is the centre of this box.
        symmetric_about_z: True if a turn about its own z changes nothing (glass, apple, bowl).
        graspable_width_m: Horizontal width between the fingers, or None where the library does not grasp it.
        grasp_axes: Horizontal unit vectors, in the root frame, along which the fingers can close; empty if all
            directions are alike.
        grasp_point_m: Centre of the grasp, in the root frame. A mug's ear belongs to its box, so that the grasp point
            is off the box's centre.
        rim: Graspable wall of an object that is too wide for the fingers, or None.
        angular_damping: Damping of a dynamic body's rotation [1/s]; it stands in for rolling resistance.
    """

    category: str
    motion: Literal["static", "dynamic", "articulated"]
    links: tuple[Link, ...]
    extent_m: Vector
    joints: tuple[Joint, ...] = ()
    handles: tuple[Handle, ...] = ()
    regions: tuple[Region, ...] = ()
    symmetric_about_z: bool = False
    graspable_width_m: float | None = None
    angular_damping: float = 3.0
    linear_damping: float = 0.1
    synset: str = ""
    grasp_axes: tuple[Vector, ...] = ()
    grasp_point_m: Vector = (0.0, 0.0, 0.0)
    # Not in the repr, whose hash identifies imported assets.
    rim: Rim | None = field(default=None, repr=False)

    @property
    def doors(self) -> tuple[Joint, ...]:
        """The joints of doors and drawers."""
        return tuple(joint for joint in self.joints if not isinstance(joint, Control))

    @property
    def controls(self) -> tuple[Control, ...]:
        """The buttons and knobs."""
        return tuple(joint for joint in self.joints if isinstance(joint, Control))

    def joint(self, name: str) -> Joint:
        """Return a joint by its name.

        Raises:
            KeyError: The asset has no joint of that name; the message lists those that it has.
        """
        for joint in self.joints:
            if joint.name == name:
                return joint
        known = ", ".join(joint.name for joint in self.joints) or "none"
        raise KeyError(f"a {self.category} has no joint {name!r}; it has {known}")
