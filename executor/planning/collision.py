"""Exact collision queries for any robot configuration, from a second physics scene with the same bodies.

Paths are looked at as a whole first: what boxes around all shapes show to be free (`separation`) is not put to the
engine. It counts as looked at all the same, so that searches end alike.

The oracle's world has no gravity and a time step of a microsecond. Setting a configuration and stepping once yields the
physics engine's own contacts, so planning and execution can never disagree about geometry. What is carried, cargo
included, stays dynamic, because kinematic bodies make no contacts with static ones; everything else that could move is
held still.
What a drawer or door carries is where its joint takes it: a hand that follows a drawer in keeps its distance to what
lies there. Intended contacts of a motion are pairs of a mover and what it may touch.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from executor.assets.asset_geometry import joint_transform
from executor.assets.model import Joint
from executor.geometry import Array, inverse
from executor.planning.cargo import HELD, Carried, riders
from executor.planning.paths import spread_out
from executor.planning.separation import Boxes, Separation, Wanted
from executor.sim.engine import GROUND, ORACLE_CONTACT_OFFSET_M, ROBOT, BodyRef
from executor.sim.robot.description import base_links
from executor.sim.robot.kinematics import Kinematics
from executor.sim.world import World
from executor.system.effort import QUERY_S
from oag.model.robots import Robot

BASE_CLEARANCE_M = 0.01
"""The base must never touch anything: it keeps this distance unless a caller gives it up."""

ARM_CLEARANCE_M = 0.005
"""Nor must the arm before the hand; the robot follows its path to 2 mm."""

SELF_CLEARANCE_M = 0.004  # Of the robot to itself.
LINK_CLEARANCE_M = 0.0005
"""A door or drawer keeps to its joint exactly. It is built to pass its neighbours by 3 mm, of which the corner of a
thick door takes more than 2 as it turns."""

MAX_QUERY_M = 2 * ORACLE_CONTACT_OFFSET_M
"""The oracle reports nothing farther apart than this."""

_DISTURBED_M = 0.001  # A body that stepping moved farther is put back.
_NEARER_M = 0.0005  # Contacts at the start may come no nearer than by this.
JointTarget = tuple[str, str]
"""An articulated object's id and one of its joints."""

Allowed = frozenset[tuple[str, str]]
"""Pairs of a mover and an object's id, or "id/link" for one link of it, that may touch."""

NOTHING: Allowed = frozenset()


@dataclass(slots=True)
class _Ride:
    """Items on a link of an object.

    Attributes:
        joint: The link's joint.
        T_world_parent: (4, 4) where the joint's other link is.
        items: Ids, with poses (4, 4) in the link's frame.
        shown: The joint's position at which the items were put last; NaN where they are to be put again.
    """

    joint: Joint
    T_world_parent: Array
    items: tuple[tuple[str, Array], ...]
    shown: float = math.nan

    def without(self, ids: Collection[str]) -> _Ride:
        """Return the same without some of the items."""
        return replace(self, items=tuple(item for item in self.items if item[0] not in ids))

    def poses(self, position: float) -> Iterator[tuple[str, Array]]:
        """Yield where the items (4, 4) are with the joint at a position."""
        T_world_link = self.T_world_parent @ joint_transform(self.joint, position)
        return ((item, T_world_link @ T_link_item) for item, T_link_item in self.items)


@dataclass(frozen=True, slots=True)
class Hit:
    """Two things that are nearer than the margin.

    Attributes:
        mover: A robot link, "held object", or the moving link of an articulated object as "id/link".
        other: The obstacle as "id/link"; "robot/link" where the robot hits itself.
        separation_m: Gap between them; negative when they overlap.
    """

    mover: str
    other: str
    separation_m: float


class CollisionOracle:
    """Collision queries for robot configurations, with what the robot carries.

    Args:
        world: A world built with `oracle=True`; the oracle owns its poses.

    Attributes:
        carried: What is in the gripper, with its cargo.
        base_clearance_m, arm_clearance_m: What base and arm keep from everything, whatever margin is asked for.
        opening_m: Default position of the fingers in queries.
        slack_m: By how much less of a wanted clearance is enough.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.robot = world.model
        self.kinematics = Kinematics(world.robot, self.robot)
        self._base_links, self._arm_links = base_links(self.robot), frozenset(self.robot.arm_links)
        self._gripper, self._fingers = frozenset(self.robot.gripper_links), frozenset(self.robot.finger_links)
        self.carried: Carried | None = None
        self.base_clearance_m = BASE_CLEARANCE_M
        self.arm_clearance_m = ARM_CLEARANCE_M
        self.opening_m = self.kinematics.finger_upper_m
        self.slack_m = 0.0
        self._resting: dict[str, Array] = {}
        self._joints: dict[JointTarget, float] = {}
        self._shown: dict[str, list[float]] = {}
        self._stale: dict[str, None] = {}
        self._rides: dict[JointTarget, _Ride] = {}
        self._joints_shown = False
        self._loose: tuple[str, ...] = ()
        self._near_at_start: dict[tuple[str, str], float] = {}
        self._separation = Separation(world)
        self._boxes: Boxes | None = None
        for object_id in world.dynamic_ids:
            world.hold(object_id, still=True)

    def synchronize(self, world: World) -> None:
        """Copy where every object and joint of a world is."""
        self._resting = {i: world.T_world_link(i) for i in world.dynamic_ids}
        self._joints = {
            (i, joint.name): world.joint_position(i, joint.name)
            for i in world.articulated_ids
            for joint in world.assets[i].joints
        }
        self._shown, self._joints_shown, self._boxes = {}, False, None
        self._stale = dict.fromkeys(self._resting)
        # Stored results of the paper's robot were found with such items where they were.
        self._rides = {} if self.robot.keeps_order else dict(self._found_rides(world))

    def _found_rides(self, world: World) -> Iterator[tuple[JointTarget, _Ride]]:
        for (object_id, name), now in self._joints.items():
            joint = world.assets[object_id].joint(name)
            T_parent = world.T_world_link(object_id, joint.parent)
            T_link_world = inverse(T_parent @ joint_transform(joint, now))
            items = tuple((item, T_link_world @ self._resting[item]) for item in riders(world, object_id, joint.child))
            if items:
                yield (object_id, name), _Ride(joint, T_parent, items)

    def joint_position(self, joint: JointTarget) -> float:
        """Return the position of an object's joint in the oracle's world."""
        return self._joints[joint]

    def set_joint(self, joint: JointTarget, position: float) -> None:
        """Set an object's joint in the oracle's world, to plan for later."""
        self._joints[joint], self._joints_shown, self._boxes = position, False, None

    @contextmanager
    def released_at(self, q: Array) -> Iterator[None]:
        """Let what is carried rest where an open hand has it in a configuration (Q,), for the duration of the block."""
        carried, before = self.carried, (self._resting, self._rides, self.opening_m)
        if carried is None:
            raise ValueError("nothing is carried that could be released")
        T_world_eef = self.kinematics.forward(q)
        self._resting = self._resting | {i: T_world_eef @ T_eef_object for i, T_eef_object in carried.poses}
        # In a drawer what is held counts among what lies there.
        self._rides = {key: ride.without(carried.ids) for key, ride in self._rides.items()}
        self.opening_m = self.kinematics.finger_upper_m
        self._carry(None)
        self._stale.update(dict.fromkeys(carried.ids))
        try:
            yield
        finally:
            self._resting, self._rides, self.opening_m = before
            self._carry(carried)
            self._stale.update(dict.fromkeys(carried.ids))

    def _carry(self, carried: Carried | None) -> None:
        self.carried, self._boxes = carried, None
        for ride in self._rides.values():
            ride.shown = math.nan

    @contextmanager
    def without_clearance(self) -> Iterator[None]:
        """Reduce the clearance of base and arm to the hand's for the duration of the block."""
        usual = self.base_clearance_m, self.arm_clearance_m
        self.base_clearance_m = self.arm_clearance_m = 0.0
        try:
            yield
        finally:
            self.base_clearance_m, self.arm_clearance_m = usual

    @contextmanager
    def leaving(
        self,
        q: Array,
        *,
        opening_m: float | None = None,
        margin_m: float = 0.0,
        allowed: Allowed = NOTHING,
        joints: Mapping[JointTarget, float] | None = None,
    ) -> Iterator[None]:
        """Permit a motion that starts nearer to things than the margin to leave them, but to come no nearer."""
        before = self._near_at_start
        self._near_at_start = {}
        found = self.hits(q, opening_m=opening_m, margin_m=margin_m, allowed=allowed, joints=joints)
        self._near_at_start = {(hit.mover, hit.other): hit.separation_m - _NEARER_M for hit in found}
        try:
            yield
        finally:
            self._near_at_start = before

    def hits(
        self,
        q: Array,
        *,
        opening_m: float | None = None,
        margin_m: float = 0.0,
        allowed: Allowed = NOTHING,
        joints: Mapping[JointTarget, float] | None = None,
    ) -> list[Hit]:
        """Return everything that the robot, what it holds, or a moved joint's link is nearer to than the margin.

        The robot's own pedestal and upper arm count as obstacles of its forearm, its hand and what it holds.

        Args:
            q: (Q,) base and arm positions.
            opening_m: Position of each finger; by default `self.opening_m`.
            margin_m: Wanted clearance, up to `MAX_QUERY_M`; 0 asks for contact only (base and arm keep their clearance
                all the same).
            joints: Positions of objects' joints that differ from the synchronised ones (a door in motion).
        """
        self._counted()
        opening = self.opening_m if opening_m is None else opening_m
        self._place(q, opening, joints or {})
        moving = {(i, self.world.assets[i].joint(joint).child) for i, joint in joints} if joints else set()
        carried = self.carried.ids if self.carried is not None else ()
        watched = {ROBOT, *(owner for owner, _ in moving), *carried}
        widest_m = max(margin_m, self.base_clearance_m, self.arm_clearance_m, SELF_CLEARANCE_M)
        found: dict[tuple[str, str], float] = {}
        for a, b, gap_m in self.world.near(watched, widest_m):
            if gap_m < _DISTURBED_M:
                for owner in (a.owner, b.owner):
                    if self._shown.pop(owner, None) is not None:
                        self._joints_shown = False
            for near, far in ((a, b), (b, a)):
                mover = self._mover(near, far, carried, moving)
                if mover is None or is_allowed(allowed, mover, far.owner, far.link):
                    continue
                key = (mover, f"{far.owner}/{far.link}")
                if gap_m < min(self._wanted_m(mover, far, margin_m), self._near_at_start.get(key, np.inf)):
                    found[key] = min(gap_m, found.get(key, np.inf))
                    break
        for mover, other in found:
            # An arm that folds onto itself is in nobody's way but its own.
            if not other.startswith(f"{ROBOT}/"):
                self.kinematics.effort.met[f"{mover} and {other}"] += 1
        return [Hit(*pair, gap_m) for pair, gap_m in sorted(found.items())]

    def is_free(self, q: Array, *, margin_m: float = 0.0, allowed: Allowed = NOTHING) -> bool:
        """Return whether one configuration is free."""
        return not self.hits(q, margin_m=margin_m, allowed=allowed)

    def gap_m(self, q: Array, within_m: float, *, opening_m: float | None = None, allowed: Allowed = NOTHING) -> float:
        """Return the smallest distance of everything that moves to everything else, at most the given one."""
        found = self.hits(q, opening_m=opening_m, margin_m=within_m, allowed=allowed)
        return min((hit.separation_m for hit in found), default=within_m)

    def surely_free(
        self, path: Array, *, opening_m: float | None = None, margin_m: float = 0.0, allowed: Allowed = NOTHING
    ) -> NDArray[np.bool_]:
        """Return (N,) which configurations of a path (N, Q) boxes show to be free; the engine may find others free.

        Args:
            path: (N, Q) configurations.
            opening_m, margin_m, allowed: As for `hits`.
        """
        if not len(path):
            return np.zeros(0, dtype=bool)
        if self._boxes is None:
            ridden = (pose for key, ride in self._rides.items() for pose in ride.poses(self._joints[key]))
            self._boxes = self._separation.boxes(self._resting | dict(ridden), self._joints)
        opening = self.opening_m if opening_m is None else opening_m
        wanted = Wanted(lambda mover: self._clearance_m(mover, margin_m), SELF_CLEARANCE_M, self.carried, allowed)
        return self._separation.surely_free(path, opening, self._boxes, wanted)

    def is_path_free(self, path: Array, *, margin_m: float = 0.0, allowed: Allowed = NOTHING) -> bool:
        """Return whether all configurations (N, Q) are free; distant ones come first, which finds walls sooner."""
        surely = self.surely_free(path, margin_m=margin_m, allowed=allowed)
        return all(
            self._counted() if surely[k] else self.is_free(path[k], margin_m=margin_m, allowed=allowed)
            for k in spread_out(len(path))
        )

    def first_hit(
        self,
        path: Iterable[Array],
        *,
        opening_m: float | None = None,
        margin_m: float = 0.0,
        allowed: Allowed = NOTHING,
        joints: Iterable[Mapping[JointTarget, float]] | None = None,
    ) -> Hit | None:
        """Return the first hit along a path of configurations (Q,), or None when all are free."""
        path = np.array(list(path))
        surely = np.zeros(len(path), dtype=bool)
        if joints is None:
            surely = self.surely_free(path, opening_m=opening_m, margin_m=margin_m, allowed=allowed)
        moved = iter(joints) if joints is not None else None
        for q, free in zip(path, surely, strict=True):
            if free:
                self._counted()
                continue
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

    def _counted(self) -> bool:
        """Count a configuration that is looked at; return True."""
        effort = self.kinematics.effort
        effort.queries += 1
        effort.add(QUERY_S)
        return True

    def _place(self, q: Array, opening_m: float, joints: Mapping[JointTarget, float]) -> None:
        robot = self.world.robot
        robot.set_qpos(np.concatenate([q[: self.robot.movers], [opening_m, opening_m]]).astype(np.float32))
        robot.set_qvel(np.zeros(len(self.robot.joint_names), dtype=np.float32))
        for object_id in self.world.articulated_ids if joints or not self._joints_shown else ():
            names = ((object_id, joint.name) for joint in self.world.assets[object_id].joints)
            wanted = [joints.get(name, self._joints.get(name, 0.0)) for name in names]
            if self._shown.get(object_id) != wanted:
                self.world.set_joint_positions(object_id, wanted)
                self._shown[object_id] = wanted
        self._joints_shown = not joints
        carried = self.carried.ids if self.carried is not None else ()
        if carried != self._loose:
            for object_id in self._loose:
                self.world.hold(object_id, still=True)
                self._stale[object_id] = None
            for object_id in carried:
                self.world.hold(object_id, still=False)
            self._loose = carried
            for ride in self._rides.values():
                ride.shown = math.nan
        for object_id in self._stale:
            self.world.set_object_pose(object_id, self._resting[object_id])
        self._stale.clear()
        for key, ride in self._rides.items():
            position = joints.get(key, self._joints[key])
            if ride.shown == position:
                continue
            ride.shown = position
            for object_id, T_world_item in ride.poses(position):
                if object_id not in carried:
                    self.world.set_object_pose(object_id, T_world_item)
        if self.carried is not None:
            T_world_eef = self.kinematics.forward(q)
            for object_id, T_eef_object in self.carried.poses:
                self.world.set_object_pose(object_id, T_world_eef @ T_eef_object)
        self.world.step()

    def _mover(self, near: BodyRef, far: BodyRef, carried: tuple[str, ...], moving: set[tuple[str, str]]) -> str | None:
        """Return a body's name as a mover, or None where its nearness to the other does not count."""
        if near.owner == ROBOT:
            stands = far.owner == GROUND and near.link in self._base_links
            if stands or (far.owner in carried and near.link in self._gripper):
                return None
            fingers = self._fingers
            return None if near.link in fingers and far.link in fingers and far.owner == ROBOT else near.link
        if near.owner in carried:
            return None if far.owner == ROBOT or far.owner in carried else HELD
        moves = (near.owner, near.link) in moving and far.owner not in (ROBOT, near.owner)
        return f"{near.owner}/{near.link}" if moves else None

    def _wanted_m(self, mover: str, far: BodyRef, margin_m: float) -> float:
        if far.owner == ROBOT:
            return SELF_CLEARANCE_M
        wanted_m = self._clearance_m(mover, margin_m)
        return wanted_m if mover in self._base_links or "/" in mover else wanted_m - min(self.slack_m, wanted_m / 2)

    def _clearance_m(self, mover: str, margin_m: float) -> float:
        """Return what a mover has to keep from everything but the robot, without slack."""
        if mover in self._base_links:
            return max(margin_m, self.base_clearance_m)
        if "/" in mover:
            return min(margin_m, LINK_CLEARANCE_M)
        return max(margin_m, self.arm_clearance_m) if mover in self._arm_links else margin_m


def fingers_may_touch(robot: Robot, other: str, *, hand: bool = False) -> Allowed:
    """Return the pairs that let the fingers (and the hand's body, if asked) touch an object or one link of it.

    Args:
        robot: Its record.
        other: An object id, or "id/link" for one link of it.
        hand: Whether the hand's body may touch it as well.
    """
    movers = robot.gripper_links if hand else robot.finger_links
    return frozenset((mover, other) for mover in movers)


def held_may_touch(others: Iterable[str]) -> Allowed:
    """Return the pairs that let the held object and its cargo touch others, such as the support it is lifted from."""
    return frozenset((HELD, other) for other in others)


def is_allowed(allowed: Allowed, mover: str, owner: str, link: str) -> bool:
    """Return whether a mover may touch an object's link: allowed by the object's id or by "id/link"."""
    return (mover, owner) in allowed or (mover, f"{owner}/{link}") in allowed
