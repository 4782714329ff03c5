"""One physics scene with the robot and the scene's objects; only this file owns a `sapien.Scene` for physics.

Without cameras nothing of Vulkan is touched. The same scene builds the same bodies in the same order with and without
visuals. So a state that one world packs unpacks in the other, and equal commands give equal bits.
"""

from __future__ import annotations

import atexit
import itertools
import weakref
from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from executor.assets.asset_geometry import joint_transform, stands_by_nature
from executor.assets.build import BuiltAsset, build_asset, merge_opaque_meshes
from executor.assets.library import asset_for
from executor.assets.model import Asset, Shape
from executor.assets.parameters import number
from executor.geometry import Array, transform_from_quaternion
from executor.sim.engine import (
    FURNITURE_CONTACT_OFFSET_M,
    GROUND,
    ORACLE_TIMESTEP_S,
    ROBOT,
    STANDARD,
    BodyRef,
    Contact,
    Physics,
    ShapeBox,
    add_ground,
    collide,
    contacts_of,
    empty_scene,
    pairs_nearer,
    pose_matrix,
    shape_box,
)
from executor.sim.latches import latches_of
from executor.sim.robot.description import BASE_LINK, load_robot
from executor.system.extras import load_sapien
from oag import Scene, SceneObject
from oag.model.scene import UPRIGHT_DEG

_LIVE: weakref.WeakSet[World] = weakref.WeakSet()


ROLLING_DAMPING = 20.0
"""Damping [1/s] of the rotation of a thing that lies. With the usual 3 / s a can or a glass on its side may roll by
3 cm/s over a level top for as long as one looks, driven by how the engine finds the contacts of cylinders; with 8 / s
one of twenty did, with 15 / s none. Rolling resistance, for which it stands in, is what holds a can on a table."""


def _resting(obj: SceneObject) -> Asset:
    """Return the asset of an object; one that stands by nature and lies rolls less."""
    asset = asset_for(obj)
    if asset.motion != "dynamic" or obj.lean_deg <= UPRIGHT_DEG or not stands_by_nature(asset):
        return asset
    return replace(asset, angular_damping=max(asset.angular_damping, ROLLING_DAMPING))


class World:
    """Physics of one concrete scene.

    Args:
        scene: The scene, after variation and scaling.
        visual: Whether cameras can see it; needs a Vulkan renderer.
        physics: Settings of an experiment; an oracle takes none.
        oracle: Builds the same bodies for exact collision queries. Gravity is off for every body and a step moves
            nothing, so that after setting poses one step reports the contacts of exactly these poses.
        paint: Makes the looks of an object's shape; by default it has its own colour.

    Raises:
        RobotDataMissing: When the robot's description is not installed.
        RendererMissing: When `visual` is true and there is nothing to draw with.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        visual: bool = False,
        physics: Physics = STANDARD,
        oracle: bool = False,
        paint: Callable[[SceneObject, Shape], Any] | None = None,
    ) -> None:
        self.scene = scene
        self.model = scene.robot.model
        self._paint = paint
        self.timestep_s = ORACLE_TIMESTEP_S if oracle else physics.timestep_s
        self.assets: dict[str, Asset] = {name: physics.of(_resting(obj)) for name, obj in scene.objects.items()}
        self.steps = 0
        self.sapien_scene: Any = empty_scene(visual=visual, oracle=oracle)
        _LIVE.add(self)
        self.sapien_scene.set_timestep(self.timestep_s)
        self._system: Any = self.sapien_scene.physx_system
        self._owner_of: dict[Any, BodyRef] = {}
        self._owner_of[add_ground(self.sapien_scene)] = BodyRef(GROUND, GROUND)
        self.robot: Any = load_robot(self.sapien_scene, self.model, visual=visual)
        for link in self.robot.links if visual else ():
            merge_opaque_meshes(link.entity)
        physics.tune(self.robot, self.model)
        self._owner_of.update({link: BodyRef(ROBOT, link.name) for link in self.robot.links})
        self._built: dict[str, BuiltAsset] = {}
        for name, asset in self.assets.items():
            self._add_object(name, asset, visual=visual, oracle=oracle)
        self.dynamic_ids = tuple(name for name, asset in self.assets.items() if asset.motion == "dynamic")
        self.articulated_ids = tuple(n for n, asset in self.assets.items() if asset.motion == "articulated")
        # An oracle's step moves nothing, so nothing need pull in it.
        self._gaskets = [
            (self._articulation(name), self.assets[name].joints)
            for name in self.articulated_ids
            if not oracle and any(joint.gasket for joint in self.assets[name].joints)
        ]
        moving = [(name, self._articulation(name)) for name in self.articulated_ids if not oracle]
        self._latches = latches_of(moving, self.assets)
        for (name, joint), latch in self._latches.items():
            latch.put(self.joint_position(name, joint))
        self._pulls: dict[Any, tuple[bytes, bytes]] = {}  # Of objects with gaskets: last position, and applied force.
        self._start_robot()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @property
    def time_s(self) -> float:
        """Simulated time since the world was built."""
        return self.steps * self.timestep_s

    def step(self) -> None:
        """Advance the physics by one time step."""
        for articulation, joints in self._gaskets:
            positions = articulation.get_qpos()
            known, applied = self._pulls.get(articulation, (b"", b""))
            if (at := positions.tobytes()) == known:
                continue
            pulls = np.array([joint.pull(q) for joint, q in zip(joints, positions.tolist(), strict=True)], np.float32)
            # The engine keeps a force; setting it again would keep awake all that rests on the boards.
            if (pull := pulls.tobytes()) != applied:
                articulation.set_qf(pulls)
            self._pulls[articulation] = at, pull
        self._system.step()
        self.steps += 1
        for latch in self._latches.values():
            latch.update()

    def close(self) -> None:
        """Release the simulator's objects; the world cannot be used afterwards.

        A scene that is alive while the interpreter shuts down can abort the process, so this must not be left to it.
        """
        self._owner_of = {}
        self._built = {}
        self._gaskets, self._pulls, self._latches = [], {}, {}
        self.robot = None
        self._system = None
        self.sapien_scene = None
        _LIVE.discard(self)

    def pack(self) -> bytes:
        """Return the physical state: poses, velocities, joints and drive targets, but no contact caches."""
        return bytes(self._system.pack())

    def unpack(self, state: bytes) -> None:
        """Restore a packed state of a world that was built from an equal scene.

        Raises:
            ValueError: When the state is not one of such a world.
        """
        expected = len(self._system.pack())
        if len(state) != expected:
            raise ValueError(
                f"the packed state has {len(state)} bytes, this world's have {expected}: "
                "it was packed from a scene with other objects; rebuild the world from that scene"
            )
        self._system.unpack(state)
        self._pulls.clear()
        for latch in self._latches.values():
            latch.forget()

    def bodies_by_number(self) -> dict[int, BodyRef]:
        """Return the body of each number in a segmentation."""
        return {int(body.entity.per_scene_id): ref for body, ref in self._owner_of.items()}

    def T_world_link(self, object_id: str, link: str | None = None) -> Array:
        """Return the (4, 4) pose of a link's frame, of the root link without a name.

        Args:
            object_id: An object's id, or "robot" (whose link poses are those of the last step or `set_qpos`).

        Raises:
            KeyError: When the scene has no such object or the object no such link.
        """
        if object_id == ROBOT:
            return pose_matrix(self.robot.find_link_by_name(link or BASE_LINK).entity_pose)
        built, asset = self._built[object_id], self.assets[object_id]
        T_world_root = pose_matrix(built.root.pose)
        if link is None or link == asset.links[0].name:
            return T_world_root
        joint = next((joint for joint in asset.joints if joint.child == link), None)
        if joint is None:
            names = ", ".join(part.name for part in asset.links)
            raise KeyError(f"{object_id} has no link {link!r}; it has {names}")
        # Link poses of the engine lag behind joint positions that were set; joints and the root do not.
        return T_world_root @ joint_transform(joint, self.joint_position(object_id, joint.name))

    def root_poses(self, object_ids: Iterable[str]) -> NDArray[np.float32]:
        """Return (N, 7) where the root links of some objects are, at least one: position and quaternion w x y z."""
        poses = (self._built[name].root.pose for name in object_ids)
        return np.concatenate([part for pose in poses for part in (pose.p, pose.q)]).reshape(-1, 7)

    def joint_position(self, object_id: str, joint: str) -> float:
        """Return a joint's position, in rad or m; 0 is shut."""
        index = self._joint_index(object_id, joint)
        return float(self._articulation(object_id).get_qpos()[index])

    def set_object_pose(self, object_id: str, T_world_root: Array) -> None:
        """Put a dynamic object somewhere, at rest.

        Raises:
            ValueError: When the object cannot move freely.
        """
        if object_id not in self.dynamic_ids:
            raise ValueError(f"{object_id} is not a dynamic object; those are {', '.join(self.dynamic_ids)}")
        sapien = load_sapien()

        built = self._built[object_id]
        built.root.set_pose(sapien.Pose(np.asarray(T_world_root, dtype=np.float32)))
        body = self._body(object_id)
        if not body.get_kinematic():
            body.set_linear_velocity([0.0, 0.0, 0.0])
            body.set_angular_velocity([0.0, 0.0, 0.0])

    def set_joint_position(self, object_id: str, joint: str, position: float) -> None:
        """Put a joint of an articulated object somewhere (rad or m), at rest."""
        index = self._joint_index(object_id, joint)
        positions = self._articulation(object_id).get_qpos()
        positions[index] = position
        self.set_joint_positions(object_id, positions)

    def set_joint_positions(self, object_id: str, positions: ArrayLike) -> None:
        """Put all joints of an articulated object somewhere (rad or m, in the asset's order), at rest."""
        articulation = self._articulation(object_id)
        qpos = np.asarray(positions, dtype=np.float32)
        articulation.set_qpos(qpos)
        articulation.set_qvel(np.zeros_like(qpos))
        for joint, position in zip(self.assets[object_id].joints, qpos, strict=True) if self._latches else ():
            if (latch := self._latches.get((object_id, joint.name))) is not None:
                latch.put(float(position))

    def hold(self, object_id: str, *, still: bool) -> None:
        """Set whether a dynamic object stays where it is put, whatever touches it.

        For oracles: contacts of held objects with other held and with static ones are not reported, so a step costs
        less; and they need not be put back after it.
        """
        self._body(object_id).set_kinematic(still)

    def near(self, owners: Container[str], within_m: float) -> Iterator[tuple[BodyRef, BodyRef, float]]:
        """Return an iterator over pairs of bodies nearer than a distance, with the gap, in the engine's order.

        Args:
            owners: Only pairs of which one body's owner is in it.
            within_m: The distance; the engine sees no farther than twice its contact offset.
        """
        return pairs_nearer(self._system.get_contacts(), self._owner_of, owners, within_m)

    def collision_boxes(self) -> list[tuple[BodyRef, ShapeBox]]:
        """Return each collision shape's body and box, but for the floor."""
        bodies = ((ref, body) for body, ref in self._owner_of.items() if ref.owner != GROUND)
        return [(ref, shape_box(shape)) for ref, body in bodies for shape in body.collision_shapes]

    def self_collisions(self) -> frozenset[frozenset[str]]:
        """Return the pairs of the robot's links that the engine lets collide."""
        links = [link for link in self.robot.links if link.collision_shapes]
        pairs = ((a, b) for a, b in itertools.combinations(links, 2) if a not in (b.parent, b) and b != a.parent)
        return frozenset(frozenset((a.name, b.name)) for a, b in pairs if collide(a, b))

    def contacts(self, owners: Container[str] | None = None) -> tuple[Contact, ...]:
        """Return the pairs of bodies that have contact points after the last step, in a fixed order.

        Points exist from about 2 cm of separation on, at furniture from 1 cm, and between two pieces of it from 1 mm;
        `separation_m` distinguishes a touch from nearness. A world that was unpacked has none before its next step. The
        robot's own links do not collide with each other, its fingers excepted.

        Args:
            owners: When given, only pairs of which one body's owner is in it. Saves most of the time in scenes where
                things of many shapes rest on each other.
        """
        return contacts_of(self._system.get_contacts(), self._owner_of, owners)

    def state_vector(self) -> NDArray[np.float32]:
        """Return everything that moves: robot, joints, then dynamic bodies, in the scene's order."""
        parts = [self.robot.get_qpos(), self.robot.get_qvel()]
        for name in self.articulated_ids:
            articulation = self._articulation(name)
            parts += [articulation.get_qpos(), articulation.get_qvel()]
        for name in self.dynamic_ids:
            pose = self._built[name].root.pose
            body = self._body(name)
            parts += [pose.p, pose.q, body.linear_velocity, body.angular_velocity]
        return np.concatenate(parts, dtype=np.float32)

    def _articulation(self, object_id: str) -> Any:
        return self._built[object_id].articulation

    def _body(self, object_id: str) -> Any:
        return next(iter(self._built[object_id].bodies.values()))

    def _joint_index(self, object_id: str, joint: str) -> int:
        names = [known.name for known in self.assets[object_id].joints]
        if joint not in names:
            raise KeyError(f"{object_id} has no joint {joint!r}; it has {', '.join(names) or 'none'}")
        return names.index(joint)

    def _add_object(self, name: str, asset: Asset, *, visual: bool, oracle: bool) -> None:
        obj = self.scene.objects[name]
        T_world_root = transform_from_quaternion(obj.position, obj.orientation)
        paint = None if self._paint is None else partial(self._paint, obj)
        built = build_asset(
            self.sapien_scene, name, asset, T_world_root, visual=visual, gravity=not oracle, paint=paint
        )
        self._built[name] = built
        if not oracle and asset.motion != "dynamic":
            for shape in (shape for body in built.bodies.values() for shape in body.collision_shapes):
                shape.set_contact_offset(FURNITURE_CONTACT_OFFSET_M)
        self._owner_of.update({body: BodyRef(name, link) for link, body in built.bodies.items()})
        if built.articulation is not None:
            fraction = number(obj, "open_fraction", 0.0, 0.0, 1.0)
            built.articulation.set_qpos([joint.start(fraction) for joint in asset.joints])

    def _start_robot(self) -> None:
        """Put the robot at the scene's pose, arm at home, gripper open, drives holding it there."""
        pose = self.scene.robot
        opening = float(self.robot.get_qlimits()[-1, 1])
        start = [*self.model.start(pose.position[0], pose.position[1], pose.yaw_rad), opening, opening]
        self.robot.set_qpos(np.array(start, dtype=np.float32))
        self.robot.set_qvel(np.zeros(len(start), dtype=np.float32))
        for joint, target in zip(self.robot.active_joints, start, strict=True):
            joint.set_drive_target(float(target))


def _close_all() -> None:
    for world in list(_LIVE):
        world.close()


atexit.register(_close_all)
