"""What ends a motion early: contacts that are not meant to be, a grasp that slips, a robot that does not follow."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from executor.geometry import Array, inverse, wrap_angle
from executor.motion.articulation.work import riders
from executor.motion.planning.oracle import FINGERS, HELD, NOTHING, Allowed, Carried, is_allowed
from executor.primitives.noise import RAD_PER_M
from executor.records.rollout import Failure, FailureKind
from executor.robot.kinematics import ARM, Kinematics
from executor.world.detectors import fingers_touching, touching_bodies
from executor.world.world import World
from oag.revision.measurements import GripLoss, RobotStall, SideEffect, UnmeantContact

CONTACT_FORCE_N = 8.0
"""A contact that is not meant to be ends a motion above this force."""

SLIP_M = 0.02  # A sound grip creeps by less.
LOST_CHECKS = 4  # In a row: contacts tremble.
DISPLACED_M = 0.05  # More than what a light touch moves.
NOTICED_M = 0.002  # Things settle by less.
TIPPED_DEG = 37.0  # From here on most things fall.
BASE_STALL_M = 0.02  # Ten times what it is off its path.
YAW_STALL_RAD = 0.03  # 1.7 degrees; 2 cm at the hand.
ARM_STALL_RAD = 0.05  # 2.9 degrees.


@dataclass
class Monitor:
    """Watches one motion.

    Attributes:
        world: The world that moves.
        kinematics: For the hand's pose.
        carried: What the gripper holds and where in the hand it was at the start, or None.
        gripped: Id of the object that must stay between the fingers, such as a door; None when nothing must.
        allowed: Contacts that are meant to be.
    """

    world: World
    kinematics: Kinematics
    carried: Carried | None = None
    gripped: str | None = None
    allowed: Allowed = NOTHING
    _lost: int = field(default=0)

    def check(self) -> Failure | None:
        """Returns why the motion has to stop now, or None."""
        return self._contacts() or self._grip()

    def _contacts(self) -> Failure | None:
        carried = self.carried.object_id if self.carried else None
        for contact in self.world.contacts({"robot", carried or "robot"}):
            for near, far in ((contact.a, contact.b), (contact.b, contact.a)):
                if near.owner == "robot":
                    mover = near.link
                elif near.owner == carried:
                    mover = HELD
                else:
                    continue
                if far.owner in ("robot", carried) or (near.owner == "robot" and far.owner == "ground"):
                    continue
                if is_allowed(self.allowed, mover, far.owner, far.link):
                    continue
                force_n = contact.impulse_ns / self.world.timestep_s
                if force_n > CONTACT_FORCE_N:
                    what = (carried or HELD) if mover == HELD else mover
                    return Failure(
                        FailureKind.COLLISION,
                        f"{what} ran into {far.owner} ({far.link}) with {force_n:.0f} N",
                        (UnmeantContact(what, far.owner, far.link, round(force_n, 2)),),
                    )
        return None

    def _grip(self) -> Failure | None:
        owner = self.carried.object_id if self.carried else self.gripped
        if owner is None:
            return None
        self._lost = 0 if fingers_touching(self.world, owner) == len(FINGERS) else self._lost + 1
        if self._lost >= LOST_CHECKS:
            kind = FailureKind.DROPPED if self.carried else FailureKind.SLIPPED
            message = f"the fingers lost {owner} at {self.world.time_s:.1f} s"
            return Failure(kind, message, (GripLoss(time_s=round(self.world.time_s, 2)),))
        if self.carried is not None:
            slip_m = float(np.linalg.norm(self.offset_in_hand(self.carried)))
            if slip_m > SLIP_M:
                message = f"{owner} slipped {slip_m * 1000:.0f} mm in the fingers at {self.world.time_s:.1f} s"
                loss = GripLoss(slip_m=round(slip_m, 4), time_s=round(self.world.time_s, 2))
                return Failure(FailureKind.SLIPPED, message, (loss,))
        return None

    def offset_in_hand(self, carried: Carried) -> Array:
        """Returns (3,): how far the carried object has moved in the hand's frame."""
        T_world_eef = self.kinematics.forward(np.asarray(self.world.robot.get_qpos(), dtype=float))
        T_eef_object = inverse(T_world_eef) @ self.world.T_world_link(carried.object_id)
        return np.asarray(T_eef_object[:3, 3] - carried.T_eef_object[:3, 3])


class Bystanders:
    """The items that a subtask has nothing to do with: they must stay where they are.

    Args:
        world: The world at the subtask's start.
        target: The item or fixture that the subtask is about.
    """

    def __init__(self, world: World, target: str) -> None:
        self._world = world
        poses = {i: world.T_world_link(i) for i in world.dynamic_ids}
        along = {target}
        if target in poses:
            # What stands on or in an item that is moved goes along with it.
            touching = (i for i in touching_bodies(world, target) if i in poses)
            along |= {i for i in touching if poses[i][2, 3] > poses[target][2, 3]}
        else:
            along.update(riders(world, target))
        self._before = {i: T for i, T in poses.items() if i not in along}

    def moved_m(self) -> dict[str, float]:
        """Returns how far each item has moved, in metres, of those that did by more than `NOTICED_M`."""
        offsets = {i: self._world.T_world_link(i)[:3, 3] - before[:3, 3] for i, before in self._before.items()}
        distances = {i: float(np.linalg.norm(offset)) for i, offset in offsets.items()}
        return {i: round(distance, 4) for i, distance in distances.items() if distance > NOTICED_M}

    def check(self) -> Failure | None:
        """Returns a failure that names the first item that moved too far or tipped over, or None."""
        for object_id, before in self._before.items():
            now = self._world.T_world_link(object_id)
            moved_m = float(np.linalg.norm(now[:3, 3] - before[:3, 3]))
            tilted = float(now[:3, 2] @ before[:3, 2]) < float(np.cos(np.deg2rad(TIPPED_DEG)))
            if moved_m > DISPLACED_M or tilted:
                how = f"moved {moved_m * 100:.0f} cm" + (" and tipped over" if tilted else "")
                moved = SideEffect(object_id, round(moved_m, 3), tilted)
                return Failure(FailureKind.SIDE_EFFECT, f"{object_id} {how}", (moved,))
        return None


def stall(q: Array, target: Array, strays_m: float = 0.0) -> Failure | None:
    """Returns a failure when the robot is not where it was told to be: blocked, or too weak.

    Args:
        q: (10,) or longer: where it is.
        target: (10,) where it was told to be.
        strays_m: By how far noise may have sent it elsewhere (`executor.primitives.noise`).
    """
    strays_rad = RAD_PER_M * strays_m
    base_m = float(np.hypot(*(q[:2] - target[:2])))
    yaw_rad = abs(wrap_angle(float(q[2] - target[2])))
    arm_rad = float(np.abs(q[ARM] - target[ARM]).max())
    base_ok = base_m <= BASE_STALL_M + math.sqrt(2.0) * strays_m
    if base_ok and yaw_rad <= YAW_STALL_RAD + strays_rad and arm_rad <= ARM_STALL_RAD + strays_rad:
        return None
    yaw_deg, arm_deg = float(np.rad2deg(yaw_rad)), float(np.rad2deg(arm_rad))
    return Failure(
        FailureKind.STALLED,
        f"the robot stalled: base {base_m * 100:.1f} cm and {yaw_deg:.1f} deg, arm {arm_deg:.1f} deg short",
        (RobotStall(round(base_m, 4), round(yaw_deg, 2), round(arm_deg, 2)),),
    )
