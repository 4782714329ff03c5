"""What the audit sees: hooks on SAPIEN's own classes that catch forbidden calls and log every step of the physics.

Nothing of the project's recorder, controller or detectors is used. A world is *live* from its first step, or from the
state that it was made to go on from; what steps by less than 0.1 ms is a collision oracle, in which nothing moves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.system.extras import load_sapien

sapien: Any = load_sapien()
ROBOT = "robot"
CONTACTS_EVERY = 5
MAKEUP_EVERY = 250
_ORACLE_STEP_S = 1e-4
_FINGERS = ("panda_leftfinger", "panda_rightfinger")

# Class -> what must not be called on anything in a live world: states, forces, bonds, and what decides the physics.
_physx = sapien.physx
FORBIDDEN: tuple[tuple[type, tuple[str, ...]], ...] = (
    (
        _physx.PhysxArticulation,
        ("set_qpos", "set_qvel", "set_qacc", "set_pose", "set_root_pose", "set_root_linear_velocity")
        + ("set_root_angular_velocity", "create_fixed_tendon"),
    ),
    (
        _physx.PhysxArticulationJoint,
        ("set_drive_properties", "set_drive_property", "set_friction", "set_limits", "set_limit", "set_armature")
        + ("set_pose_in_parent", "set_pose_in_child", "set_type", "set_max_velocity"),
    ),
    (
        _physx.PhysxRigidDynamicComponent,
        ("set_linear_velocity", "set_angular_velocity", "set_kinematic", "set_kinematic_target")
        + ("set_locked_motion_axes", "put_to_sleep"),
    ),
    (
        _physx.PhysxRigidBodyComponent,
        ("add_force_torque", "add_force_at_point", "set_mass", "set_inertia", "set_disable_gravity")
        + ("set_linear_damping", "set_angular_damping", "set_cmass_local_pose", "set_max_linear_velocity")
        + ("set_max_angular_velocity", "set_max_depenetration_velocity", "set_max_contact_impulse"),
    ),
    (sapien.Entity, ("set_pose", "add_component", "remove_component", "add_to_scene", "remove_from_scene")),
    (sapien.Component, ("set_pose", "set_entity_pose", "enable", "disable")),
    (sapien.Scene, ("create_drive", "create_connection", "create_gear", "set_timestep")),
    (sapien.pysapien.Scene, ("unpack_poses",)),
    (_physx.PhysxSystem, ("set_timestep",)),
)
BONDS = (_physx.PhysxDriveComponent, _physx.PhysxDistanceJointComponent, _physx.PhysxGearComponent)
"""Components that tie two bodies together; none may ever be made."""

MOTORS = ("set_drive_target", "set_drive_velocity_target")
"""Of joints: the robot's own alone."""


@dataclass
class StepLog:
    """One live world, from its first step to its last.

    Attributes:
        dt_s: Length of a step.
        item_names: (I,) the free bodies.
        joint_owners: (J,) the object of each joint that is not the robot's.
        owners: Per-scene id of an entity -> what it belongs to.
        robot: Rows of (60,): joint positions, velocities, drive targets, velocity targets, and what the joint
            transmits along its axis (N or Nm), 12 each.
        items: Rows of (I, 13): position, quaternion w x y z, linear and angular velocity.
        joints: Rows of (J, 3): position, velocity, applied force.
        touching: Every fifth step: pairs of owners between which a force has acted since the one before.
        force_limits: (12,) of the robot's joints.
        makeup: What decides the physics, at the first step and every second.
    """

    dt_s: float
    item_names: tuple[str, ...]
    joint_owners: tuple[str, ...]
    owners: dict[int, str]
    force_limits: NDArray[np.float64]
    robot: list[NDArray[np.float64]] = field(default_factory=list)
    items: list[NDArray[np.float64]] = field(default_factory=list)
    joints: list[NDArray[np.float64]] = field(default_factory=list)
    touching: list[frozenset[tuple[str, str]]] = field(default_factory=list)
    makeup: list[str] = field(default_factory=list)


@dataclass
class Watch:
    """What was caught and logged.

    Attributes:
        caught: Forbidden calls, as "Class.method on owner".
        restored: How many worlds went on from a state that the one before had packed.
        logs: One for each live world, in order.
    """

    caught: list[str] = field(default_factory=list)
    restored: int = 0
    logs: list[StepLog] = field(default_factory=list)
    _live: set[int] = field(default_factory=set)
    _packed: set[bytes] = field(default_factory=set)
    _system: Any = None
    _parts: tuple[Any, ...] = ()
    _touched: set[tuple[str, str]] = field(default_factory=set)

    def note(self, name: str, thing: Any) -> None:
        """Note a call when its object is part of a live world."""
        scene = _scene_of(thing)
        if scene is not None and scene.id in self._live:
            self.caught.append(f"{name} on {_owner_of(thing)}")

    def motor(self, name: str, joint: Any) -> None:
        """Note a drive target of a joint that is not the robot's."""
        if joint.child_link.articulation.name != ROBOT:
            self.note(name, joint)

    def packed(self, state: bytes) -> None:
        """Remembers a state that a live world was in."""
        self._packed.add(state)

    def unpacked(self, system: Any, state: bytes) -> None:
        """Note a state that is set on a live world, or that no live world was in."""
        scene = _scene_of_system(system)
        if system.timestep < _ORACLE_STEP_S:
            return
        if scene.id in self._live or state not in self._packed:
            self.caught.append("PhysxCpuSystem.unpack on world")
        else:
            self.restored += 1
        self._live.add(scene.id)

    def stepped(self, system: Any) -> None:
        """Logs the state after a step."""
        if system.timestep < _ORACLE_STEP_S:
            return
        if system is not self._system:
            self._begin(system)
        robot, robot_joints, robot_rows, bodies, furniture = self._parts
        log = self.logs[-1]
        forces = np.asarray(robot.get_link_incoming_joint_forces())
        targets = [(joint.drive_target[0], joint.drive_velocity_target[0]) for joint in robot_joints]
        along = [forces[link, axis] for link, axis in robot_rows]
        log.robot.append(np.concatenate([robot.qpos, robot.qvel, *zip(*targets, strict=True), along]))
        states = [(b.entity.pose.p, b.entity.pose.q, b.linear_velocity, b.angular_velocity) for b in bodies]
        log.items.append(np.array([np.concatenate(state) for state in states]).reshape(-1, 13))
        rows = [np.stack([each.qpos, each.qvel, each.qf], axis=1) for each in furniture]
        log.joints.append(np.concatenate(rows) if rows else np.empty((0, 3)))
        count = len(log.robot)
        # A bounce lasts a step or two.
        self._touched |= _touching(system, log.owners)
        if count % CONTACTS_EVERY == 1:
            log.touching.append(frozenset(self._touched))
            self._touched.clear()
        if count % MAKEUP_EVERY == 1:
            log.makeup.append(_makeup(system))

    def _begin(self, system: Any) -> None:
        scene = _scene_of_system(system)
        self._system = system
        self._touched.clear()
        self._live.add(scene.id)
        articulations = {link.articulation.name: link.articulation for link in system.articulation_link_components}
        robot = articulations.pop(ROBOT)
        links = list(robot.links)
        joints = list(robot.active_joints)
        rows = [(links.index(j.child_link), 3 if "revolute" in str(j.type) else 0) for j in joints]
        bodies = list(system.rigid_dynamic_components)
        furniture = [each for _, each in sorted(articulations.items()) if each.dof]
        self._parts = (robot, joints, rows, bodies, furniture)
        everything = [*bodies, *system.rigid_static_components, *system.articulation_link_components]
        self.logs.append(
            StepLog(
                dt_s=float(system.timestep),
                item_names=tuple(body.entity.name for body in bodies),
                joint_owners=tuple(each.name for each in furniture for _ in range(each.dof)),
                owners={body.entity.per_scene_id: _owner_of(body) for body in everything},
                force_limits=np.array([joint.force_limit for joint in joints], dtype=float),
            )
        )


@contextmanager
def watching() -> Iterator[Watch]:
    """Give a watch over all physics of the process until the block ends."""
    watch = Watch()
    undo: list[tuple[type, str, Any]] = []

    def replace(owner: type, name: str, make: Callable[[Any], Any]) -> None:
        before = owner.__dict__.get(name)
        original = getattr(owner, name)
        undo.append((owner, name, before))
        setattr(owner, name, make(original))

    def forbidding(name: str, note: Callable[[str, Any], None]) -> Callable[[Any], Any]:
        def make(original: Any) -> Any:
            def call(self: Any, *arguments: Any, **named: Any) -> Any:
                note(name, self)
                return original(self, *arguments, **named)

            return call

        return make

    def assigning(name: str, note: Callable[[str, Any], None]) -> Callable[[Any], Any]:
        return lambda original: property(original.fget, forbidding(name, note)(original.fset))

    for owner, names in (*FORBIDDEN, (_physx.PhysxArticulationJoint, MOTORS)):
        for name in names:
            note = watch.motor if name in MOTORS else watch.note
            replace(owner, name, forbidding(f"{owner.__name__}.{name}", note))
            plain = name.removeprefix("set_")
            if name.startswith("set_") and isinstance(known := owner.__dict__.get(plain), property) and known.fset:
                replace(owner, plain, assigning(f"{owner.__name__}.{plain}", note))
    for bond in BONDS:
        replace(bond, "__init__", _caught_at_birth(watch, bond.__name__))

    def packing(original: Any) -> Any:
        def pack(self: Any) -> Any:
            state = original(self)
            if self.timestep >= _ORACLE_STEP_S:
                watch.packed(bytes(state))
            return state

        return pack

    def unpacking(original: Any) -> Any:
        def unpack(self: Any, state: bytes) -> Any:
            watch.unpacked(self, bytes(state))
            return original(self, state)

        return unpack

    def stepping(original: Any) -> Any:
        def step(self: Any) -> Any:
            done = original(self)
            watch.stepped(self)
            return done

        return step

    replace(_physx.PhysxCpuSystem, "pack", packing)
    replace(_physx.PhysxCpuSystem, "unpack", unpacking)
    replace(_physx.PhysxCpuSystem, "step", stepping)
    try:
        yield watch
    finally:
        for owner, name, before in reversed(undo):
            if before is None:
                delattr(owner, name)
            else:
                setattr(owner, name, before)
        watch._system, watch._parts = None, ()


def _caught_at_birth(watch: Watch, name: str) -> Callable[[Any], Any]:
    def make(original: Any) -> Any:
        def init(self: Any, *arguments: Any, **named: Any) -> None:
            watch.caught.append(f"{name} made")
            original(self, *arguments, **named)

        return init

    return make


def _scene_of(thing: Any) -> Any:
    if isinstance(thing, sapien.pysapien.Scene):
        return thing
    if isinstance(thing, sapien.Entity):
        return thing.scene
    if isinstance(thing, _physx.PhysxSystem):
        return _scene_of_system(thing)
    if isinstance(thing, _physx.PhysxArticulation):
        thing = thing.links[0] if thing.links else None
    elif isinstance(thing, _physx.PhysxArticulationJoint):
        thing = thing.child_link
    entity = None if thing is None else thing.entity
    return None if entity is None else entity.scene


def _scene_of_system(system: Any) -> Any:
    bodies = system.articulation_link_components or system.rigid_static_components or system.rigid_dynamic_components
    return bodies[0].entity.scene if bodies else None


def _owner_of(thing: Any) -> str:
    if isinstance(thing, _physx.PhysxArticulationJoint):
        thing = thing.child_link
    if isinstance(thing, _physx.PhysxArticulationLinkComponent):
        link = str(thing.entity.name)
        return f"{ROBOT}/{link}" if thing.articulation.name == ROBOT else str(thing.articulation.name)
    if isinstance(thing, (_physx.PhysxArticulation, sapien.Entity)):
        return str(thing.name)
    return str(thing.entity.name) if isinstance(thing, sapien.Component) else "world"


def _touching(system: Any, owners: dict[int, str]) -> set[tuple[str, str]]:
    """Return pairs of owners between which a force acted in the last step."""
    pairs = set()
    for contact in system.get_contacts():
        if any(float(np.abs(point.impulse).max()) > 0.0 for point in contact.points):
            first, second = (owners[body.entity.per_scene_id] for body in contact.bodies)
            pairs.add((first, second))
    return pairs


def _makeup(system: Any) -> str:
    """Return what decides the physics of a world beside its state, as text."""
    parts: list[Any] = [system.timestep]
    links = system.articulation_link_components
    for body in [*system.rigid_dynamic_components, *links]:
        parts += [body.mass, body.inertia, body.disable_gravity, body.linear_damping, body.angular_damping]
    for body in system.rigid_dynamic_components:
        parts += [body.kinematic, body.locked_motion_axes]
    for body in [*system.rigid_dynamic_components, *system.rigid_static_components, *links]:
        parts += [sorted(type(component).__name__ for component in body.entity.components)]
        for shape in body.collision_shapes:
            material = shape.physical_material
            parts += [shape.collision_groups, shape.local_pose.p, shape.local_pose.q, shape.density]
            parts += [material.static_friction, material.dynamic_friction, material.restitution]
    for link in links:
        if link.joint is not None and link.joint.dof:
            joint = link.joint
            parts += [joint.friction, joint.limits, joint.stiffness, joint.damping, joint.force_limit, joint.armature]
    return repr([part.tolist() if isinstance(part, np.ndarray) else part for part in parts])
