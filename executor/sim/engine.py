"""The physics engine: empty scenes, contact distances, poses as matrices, contacts, and the settings of experiments.

Without visuals nothing of Vulkan is touched. `Physics` is the one record of what an experiment may change. Planning
does not know it: grasps, forces and speeds are chosen as ever, and the experiment measures what comes of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from executor.assets.model import Asset
from executor.geometry import Array
from executor.sim.robot.description import FINGER_FRICTION
from executor.system.extras import load_sapien
from oag.model.robots import Robot

GROUND = "ground"
ROBOT = "robot"
TIMESTEP_S = 1 / 250
ORACLE_TIMESTEP_S = 1e-6
CONTACT_OFFSET_M = 0.01
"""How far around a shape contacts are looked for; two shapes see each other from twice this on."""

FURNITURE_CONTACT_OFFSET_M = 0.0005
"""The same of furniture, so that a door sees what it passes from a millimetre on.

The engine keeps contact points, with their directions, until bodies have moved by millimetres: an edge that passes
another closely would still be held off by the face that it was before.
"""

ORACLE_CONTACT_OFFSET_M = 0.02
_SOLVER_ITERATIONS = 20
"""With 15 a grasp of half an apple slipped that holds with 20 or more."""


class RendererMissing(RuntimeError):
    """A world with visuals was asked for where the engine finds nothing to draw with."""

    def __init__(self, problem: str) -> None:
        super().__init__(
            f"a world with visuals needs a Vulkan driver, and SAPIEN says: {problem}. `scene2demo doctor` tells what "
            "is missing; call executor.system.vulkan.activate() before the first such world. Physics alone needs none "
            "of it."
        )


def empty_scene(*, visual: bool, oracle: bool) -> Any:
    """Return a `sapien.Scene` without bodies.

    Args:
        oracle: Whether contacts are only read in it, and never solved.

    Raises:
        RendererMissing: When `visual` is true and there is nothing to draw with.
    """
    sapien = load_sapien()

    # These are settings of the process that the next scene takes up; every world sets them, so all are alike.
    sapien.physx.set_scene_config(bounce_threshold=2.0)
    sapien.physx.set_shape_config(contact_offset=ORACLE_CONTACT_OFFSET_M if oracle else CONTACT_OFFSET_M)
    # Contacts are found before they are solved: an oracle, which only reads them, needs no solving.
    iterations = 1 if oracle else _SOLVER_ITERATIONS
    sapien.physx.set_body_config(solver_position_iterations=iterations, solver_velocity_iterations=1)
    if not visual:
        return sapien.Scene([sapien.physx.PhysxCpuSystem()])
    try:
        return sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
    except RuntimeError as problem:
        raise RendererMissing(str(problem)) from problem


def add_ground(sapien_scene: Any) -> Any:
    """Add the floor at height 0 and return its body; rendering adds its looks."""
    ground = sapien_scene.add_ground(0.0, render=False)
    return ground.find_component_by_type(load_sapien().physx.PhysxRigidStaticComponent)


def pose_matrix(pose: Any) -> Array:
    """Return the (4, 4) of an engine pose, written out for speed: every physics step calls it."""
    w, i, j, k = pose.q.tolist()
    x, y, z = pose.p.tolist()
    s = 2.0 / (w * w + i * i + j * j + k * k)
    return np.array(
        [
            [1 - s * (j * j + k * k), s * (i * j - k * w), s * (i * k + j * w), x],
            [s * (i * j + k * w), 1 - s * (i * i + k * k), s * (j * k - i * w), y],
            [s * (i * k - j * w), s * (j * k + i * w), 1 - s * (i * i + j * j), z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


@dataclass(frozen=True, slots=True, eq=False)
class ShapeBox:
    """The box around a collision shape.

    Attributes:
        T_body_box: (4, 4) its pose in the body's frame.
        half_m: (3,) half its sides.
        points_m: (V, 3) points in its frame whose hull contains the shape.
    """

    T_body_box: Array
    half_m: Array
    points_m: Array


def shape_box(shape: Any) -> ShapeBox:
    """Return the box around a collision shape."""
    physx = load_sapien().physx
    T = pose_matrix(shape.local_pose)
    if isinstance(shape, physx.PhysxCollisionShapeConvexMesh):
        points = np.asarray(shape.vertices, dtype=float) * np.asarray(shape.scale, dtype=float)
        low, high = points.min(axis=0), points.max(axis=0)
        T[:3, 3] += T[:3, :3] @ (low + high) / 2
        return ShapeBox(T, (high - low) / 2, points - (low + high) / 2)
    if isinstance(shape, physx.PhysxCollisionShapeBox):
        half = np.asarray(shape.half_size, dtype=float)
    elif isinstance(shape, physx.PhysxCollisionShapeSphere):
        half = np.full(3, float(shape.radius))
    else:
        half = np.array([shape.half_length, shape.radius, shape.radius], dtype=float)
    return ShapeBox(T, half, half * np.array(list(itertools.product((-1.0, 1.0), repeat=3))))


def collide(one: Any, other: Any) -> bool:
    """Return whether any shapes of two bodies share no bit of the ignore group, so that they can collide."""
    bits = ([shape.get_collision_groups()[2] for shape in body.collision_shapes] for body in (one, other))
    return any(not a & b for a, b in itertools.product(*bits))


@dataclass(frozen=True, slots=True, order=True)
class BodyRef:
    """One rigid body.

    Attributes:
        owner: "robot", "ground" or an object's id.
        link: Link name; the asset's root link for a single body, "ground" for the ground.
    """

    owner: str
    link: str


@dataclass(frozen=True, slots=True)
class Contact:
    """Two bodies that touch or nearly do.

    Attributes:
        a, b: The bodies; the robot's comes first, then by name.
        separation_m: Smallest distance over the contact points; negative where they overlap.
        impulse_ns: Sum of the points' impulse norms over the last step, in newton seconds.
    """

    a: BodyRef
    b: BodyRef
    separation_m: float
    impulse_ns: float


def pairs_nearer(
    engine_contacts: Any, owner_of: Mapping[Any, BodyRef], owners: Container[str], within_m: float
) -> Iterator[tuple[BodyRef, BodyRef, float]]:
    """Yield pairs of bodies that are nearer than a distance, with the gap between them, in the engine's order.

    Args:
        engine_contacts: What the engine's `get_contacts` returns.
        owner_of: The engine's bodies -> what they are.
        owners: Only pairs of which one body's owner is in it.
    """
    for contact in engine_contacts:
        first, second = contact.bodies
        a, b = owner_of[first], owner_of[second]
        if a.owner in owners or b.owner in owners:
            gap_m = min([point.separation for point in contact.points], default=math.inf)
            if gap_m < within_m:
                yield (a, b, gap_m) if _comes_first(a, b) else (b, a, gap_m)


def contacts_of(
    engine_contacts: Any, owner_of: Mapping[Any, BodyRef], owners: Container[str] | None
) -> tuple[Contact, ...]:
    """Return the pairs of bodies that have contact points, one contact a pair, sorted.

    Args:
        engine_contacts, owner_of: As for `pairs_nearer`.
        owners: When given, only pairs of which one body's owner is in it.
    """
    found: dict[tuple[int, int], tuple[BodyRef, BodyRef, float, list[float]]] = {}
    for contact in engine_contacts:
        first, second = contact.bodies
        a, b = owner_of[first], owner_of[second]
        if owners is not None and a.owner not in owners and b.owner not in owners:
            continue
        points = contact.points
        if not points:
            continue
        # Identities hash faster than names, and this runs thousands of times a second.
        key = (id(a), id(b)) if id(a) < id(b) else (id(b), id(a))
        _, _, separation, impulses = found.get(key, (a, b, math.inf, []))
        for point in points:
            separation = min(separation, point.separation)
            x, y, z = point.impulse.tolist()
            impulses.append(math.sqrt(x * x + y * y + z * z))
        found[key] = (a, b, separation, impulses)
    # The engine's order of shapes that touch is not always the same; the exactly rounded sum does not depend on it.
    summed = ((a, b, s, math.fsum(i)) for a, b, s, i in found.values())
    ordered = ((a, b, s, i) if _comes_first(a, b) else (b, a, s, i) for a, b, s, i in summed)
    return tuple(Contact(*fields) for fields in sorted(ordered))


def _comes_first(a: BodyRef, b: BodyRef) -> bool:
    return (a.owner != ROBOT, a) <= (b.owner != ROBOT, b)


@dataclass(frozen=True, slots=True)
class Physics:
    """Settings of a world; the defaults are what all rates are measured with.

    Attributes:
        finger_friction: Static and dynamic friction coefficient of the fingertips; with what they hold the engine
            takes the mean of both.
        joint_friction: Factor of what doors and drawers ask of the hand, gaskets included.
        damping: Factor of the damping of items, which stands in for rolling resistance and air.
        item_mass: Factor of the mass and inertia of items.
        item_friction: Factor of the friction coefficient of items.
        base_force, arm_force, grip_force: Factors of the force and torque limits of the drives of base (its turning
            included), arm and fingers.

    Raises:
        ValueError: A setting is not more than 0.
    """

    timestep_s: float = TIMESTEP_S
    finger_friction: float = FINGER_FRICTION
    joint_friction: float = 1.0
    damping: float = 1.0
    item_mass: float = 1.0
    item_friction: float = 1.0
    base_force: float = 1.0
    arm_force: float = 1.0
    grip_force: float = 1.0

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} has to be more than 0, got {getattr(self, name)}")

    def of(self, asset: Asset) -> Asset:
        """Return an asset with these settings; the same object where they are the defaults."""
        if asset.motion == "dynamic" and (self.damping, self.item_mass, self.item_friction) != (1.0,) * 3:
            links = tuple(
                replace(
                    link,
                    shapes=tuple(
                        replace(
                            s,
                            density_kg_m3=self.item_mass * s.density_kg_m3,
                            friction=self.item_friction * s.friction,
                        )
                        for s in link.shapes
                    ),
                )
                for link in asset.links
            )
            slower = {name: self.damping * getattr(asset, name) for name in ("angular_damping", "linear_damping")}
            return replace(asset, links=links, **slower)
        if asset.joints and self.joint_friction != 1.0:
            f = self.joint_friction
            joints = tuple(replace(j, friction=f * j.friction, gasket=f * j.gasket) for j in asset.joints)
            return replace(asset, joints=joints)
        return asset

    def tune(self, loaded: Any, robot: Robot) -> None:
        """Apply the force limits and the finger friction to a robot that was loaded just now."""
        base, arm = len(robot.base_joints), len(robot.arm_joints)
        factors = [self.base_force] * base + [self.arm_force] * arm + [self.grip_force] * 2
        for joint, factor in zip(loaded.active_joints, factors, strict=True):
            if factor != 1.0:
                joint.set_drive_properties(joint.stiffness, joint.damping, factor * joint.force_limit)
        if self.finger_friction != FINGER_FRICTION:
            material = load_sapien().physx.PhysxMaterial(self.finger_friction, self.finger_friction, 0.0)
            for finger in robot.finger_links:
                for shape in loaded.find_link_by_name(finger).collision_shapes:
                    shape.set_physical_material(material)


STANDARD = Physics()
"""The documented values."""
