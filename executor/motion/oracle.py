"""Exact collision answers for any robot configuration, from a second physics scene with the same bodies.

The oracle's world has no gravity and a time step of a microsecond: setting a configuration and stepping once yields
the physics engine's own contacts, so planning and execution can never disagree about geometry. Bodies that are
carried stay dynamic, because kinematic bodies make no contacts with static ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from executor.geometry import Array
from executor.motion.contacts import HELD, NOTHING, Allowed, is_allowed
from executor.robot.kinematics import Kinematics
from executor.world import World

BASE = "base_body"
BASE_CLEARANCE_M = 0.01
"""The base never means to touch anything: it keeps this distance unless a caller gives it up."""

JointTarget = tuple[str, str]
"""An articulated object's id and one of its joints."""


@dataclass(frozen=True, slots=True)
class Hit:
    """Two things that are nearer than the margin.

    Attributes:
        mover: A robot link, "held object", or the moving link of an articulated object as "id/link".
        other: What it is near to, as "id/link".
        separation_m: Gap between them; negative when they overlap.
    """

    mover: str
    other: str
    separation_m: float


@dataclass(frozen=True, slots=True)
class Carried:
    """An object in the gripper: its id and its pose in the hand's frame, (4, 4)."""

    object_id: str
    T_eef_object: Array


class CollisionOracle:
    """Answers whether a robot configuration, with what it carries, is free.

    Args:
        world: A world built with `oracle=True`; the oracle owns its poses.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.kinematics = Kinematics(world.robot)
        self.carried: Carried | None = None
        self.base_clearance_m = BASE_CLEARANCE_M
        self.opening_m = self.kinematics.finger_upper_m
        self.queries = 0
        self._resting: dict[str, Array] = {}
        self._joints: dict[JointTarget, float] = {}

    def synchronize(self, world: World) -> None:
        """Copies where every object and joint of a world is."""
        self._resting = {i: world.T_world_link(i) for i in world.dynamic_ids}
        self._joints = {
            (i, joint.name): world.joint_position(i, joint.name)
            for i in world.articulated_ids
            for joint in world.assets[i].joints
        }

    def joint_position(self, joint: JointTarget) -> float:
        """Returns where the oracle believes an object's joint to be."""
        return self._joints[joint]

    def set_joint(self, joint: JointTarget, position: float) -> None:
        """Makes the oracle believe that an object's joint is elsewhere, to plan for later."""
        self._joints[joint] = position

    def hits(
        self,
        q: Array,
        *,
        opening_m: float | None = None,
        margin_m: float = 0.0,
        allowed: Allowed = NOTHING,
        joints: Mapping[JointTarget, float] | None = None,
    ) -> list[Hit]:
        """Returns everything that the robot, what it holds, or a moved joint's link is nearer to than the margin.

        Args:
            q: (10,) base and arm positions.
            opening_m: Position of each finger; what the gripper was last told by default.
            margin_m: Wanted clearance; 0 asks for contact only (the base keeps `base_clearance_m` all the same).
            allowed: Contacts that are meant to be.
            joints: Positions of objects' joints that differ from the synchronised ones (a door on its way).
        """
        self.queries += 1
        opening = self.opening_m if opening_m is None else opening_m
        self._place(q, opening, joints or {})
        moving = {(i, self.world.assets[i].joint(joint).child) for i, joint in joints} if joints else set()
        watched = {"robot", *(owner for owner, _ in moving)}
        if self.carried is not None:
            watched.add(self.carried.object_id)
        found: list[Hit] = []
        for contact in self.world.contacts(watched):
            if contact.separation_m >= max(margin_m, self.base_clearance_m):
                continue
            for near, far in ((contact.a, contact.b), (contact.b, contact.a)):
                mover = self._mover(near.owner, near.link, moving)
                if mover is None or self._belongs(far.owner, near.owner, mover):
                    continue
                if far.owner == "robot" or is_allowed(allowed, mover, far.owner, far.link):
                    continue
                if near.owner == "robot" and far.owner == "ground":
                    continue
                wanted_m = max(margin_m, self.base_clearance_m) if mover == BASE else margin_m
                if contact.separation_m >= wanted_m:
                    continue
                found.append(Hit(mover, f"{far.owner}/{far.link}", contact.separation_m))
                break
        return found

    def is_free(self, q: Array, *, margin_m: float = 0.0, allowed: Allowed = NOTHING) -> bool:
        """Decides whether one configuration is free."""
        return not self.hits(q, margin_m=margin_m, allowed=allowed)

    def first_hit(
        self,
        path: Iterable[Array],
        *,
        opening_m: float | None = None,
        margin_m: float = 0.0,
        allowed: Allowed = NOTHING,
        joints: Iterable[Mapping[JointTarget, float]] | None = None,
    ) -> Hit | None:
        """Returns the first thing in the way along a path of configurations (10,), or None when all are free."""
        moved = iter(joints) if joints is not None else None
        for q in path:
            hits = self.hits(
                q,
                opening_m=opening_m,
                margin_m=margin_m,
                allowed=allowed,
                joints=next(moved) if moved is not None else None,
            )
            if hits:
                return min(hits, key=lambda hit: hit.separation_m)
        return None

    def _place(self, q: Array, opening_m: float, joints: Mapping[JointTarget, float]) -> None:
        robot = self.world.robot
        robot.set_qpos(np.concatenate([q[:10], [opening_m, opening_m]]).astype(np.float32))
        robot.set_qvel(np.zeros(12, dtype=np.float32))
        for (object_id, joint), position in self._joints.items():
            self.world.set_joint_position(object_id, joint, joints.get((object_id, joint), position))
        for object_id, T in self._resting.items():
            if self.carried is not None and self.carried.object_id == object_id:
                T = self.kinematics.forward(q) @ self.carried.T_eef_object
            self.world.set_object_pose(object_id, T)
        self.world.step()

    def _mover(self, owner: str, link: str, moving: set[tuple[str, str]]) -> str | None:
        if owner == "robot":
            return link
        if self.carried is not None and owner == self.carried.object_id:
            return HELD
        return f"{owner}/{link}" if (owner, link) in moving else None

    def _belongs(self, far_owner: str, near_owner: str, mover: str) -> bool:
        """True for pairs that say nothing: a body with itself, the hand with what it carries."""
        if far_owner == near_owner:
            return True
        carried = self.carried.object_id if self.carried is not None else None
        return near_owner == "robot" and far_owner == carried
