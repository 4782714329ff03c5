"""Control of the robot's joints along timed paths, and the monitors that end a motion early.

The controller advances one physics step at a time and waits until things are at rest. Monitors detect unintended
contacts, a grasp that slips, and a robot that does not follow.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from executor.geometry import Array, inverse, wrap_angle
from executor.planning.cargo import HELD, Carried, cargo_of, riders
from executor.planning.collision import NOTHING, Allowed, is_allowed
from executor.records import DriveCommand, Failure, FailureKind
from executor.sim.detectors import fingers_touching, touching_bodies
from executor.sim.engine import GROUND, ROBOT
from executor.sim.robot.description import base_links
from executor.sim.robot.kinematics import Kinematics
from executor.sim.world import World
from executor.skills.trajectories import RAD_PER_M, NoiseStream, stop_path, time_path
from oag.measurements import GripLoss, RobotStall, SideEffect, TimeUp, UnmeantContact
from oag.model.robots import Robot

CONTACT_FORCE_N = 8.0
"""An unintended contact above this force ends a motion."""

SLIP_M = 0.02  # A sound grip creeps by less.
LOST_CHECKS = 4  # In a row: contacts tremble.
BAR_SHARE = 0.75  # Of a handle's thickness: fingers that are less far apart have lost it.
DISPLACED_M = 0.05  # More than what a light touch moves.
NOTICED_M = 0.002  # Things settle by less.
TIPPED_DEG = 37.0  # From here on most things fall.
BASE_STALL_M = 0.02  # Ten times what it is off its path.
YAW_STALL_RAD = 0.03  # 1.7 degrees; 2 cm at the hand.
ARM_STALL_RAD = 0.05  # 2.9 degrees.


@dataclass
class Monitor:
    """Monitor of one motion.

    Attributes:
        world: The world that moves.
        kinematics: For the hand's pose.
        carried: What the gripper holds, with its cargo, and where in the hand it was at the start; or None.
        gripped: Id of the object that must stay between the fingers, such as a door; None when nothing must.
        bar_m: Thickness of the gripped handle, which may hang on one finger; None where both have to press.
        allowed: Intended contacts.
    """

    world: World
    kinematics: Kinematics
    carried: Carried | None = None
    gripped: str | None = None
    bar_m: float | None = None
    allowed: Allowed = NOTHING
    _lost: int = field(default=0)

    def __post_init__(self) -> None:
        self._standing = base_links(self.world.model)

    def check(self) -> Failure | None:
        """Return why the motion has to stop now, or None."""
        return self._contacts() or self._grip()

    def _contacts(self) -> Failure | None:
        carried = self.carried.ids if self.carried else ()
        for contact in self.world.contacts({"robot", *carried}):
            for near, far in ((contact.a, contact.b), (contact.b, contact.a)):
                if near.owner == "robot":
                    mover = near.link
                elif near.owner in carried:
                    mover = HELD
                else:
                    continue
                if far.owner in (ROBOT, *carried[:1]) or (far.owner == GROUND and near.link in self._standing):
                    continue
                if far.owner in carried and (near.owner in carried or near.link in self.world.model.gripper_links):
                    continue
                if is_allowed(self.allowed, mover, far.owner, far.link):
                    continue
                force_n = contact.impulse_ns / self.world.timestep_s
                if force_n > CONTACT_FORCE_N:
                    what = near.owner if mover == HELD else mover
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
        self._lost = 0 if self._holds(owner) else self._lost + 1
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

    def _holds(self, owner: str) -> bool:
        """Return whether what the gripper holds is still between its fingers.

        A handle that is pulled along the way the fingers close hangs on one of them: they are coupled as those of the
        real hand are, so that beyond its grip force the other presses on nothing (a refrigerator that is opened from
        its side resists with 40 N). While the fingers are as far apart as the handle is thick, it is between them.
        """
        touching = fingers_touching(self.world, owner)
        if touching == len(self.world.model.finger_links) or self.bar_m is None:
            return touching == len(self.world.model.finger_links)
        opening_m = float(np.asarray(self.world.robot.get_qpos(), dtype=float)[self.world.model.fingers].sum())
        return touching > 0 and opening_m > BAR_SHARE * self.bar_m

    def offset_in_hand(self, carried: Carried) -> Array:
        """Return (3,): how far the carried object has moved in the hand's frame."""
        T_world_eef = self.kinematics.forward(np.asarray(self.world.robot.get_qpos(), dtype=float))
        T_eef_object = inverse(T_world_eef) @ self.world.T_world_link(carried.object_id)
        return np.asarray(T_eef_object[:3, 3] - carried.T_eef_object[:3, 3])


class Bystanders:
    """Items that a subtask does not involve: they must stay where they are, and cargo where it rides.

    Args:
        world: The world at the subtask's start.
        target: The item or fixture that the subtask is about.
    """

    def __init__(self, world: World, target: str) -> None:
        self._world, self._target = world, target
        self._cargo: dict[str, Array] = {}
        poses = {i: world.T_world_link(i) for i in world.dynamic_ids}
        along = {target}
        if target in poses:
            # What stands on or in an item that is moved goes along with it.
            touching = (i for i in touching_bodies(world, target) if i in poses)
            along |= {i for i in touching if poses[i][2, 3] > poses[target][2, 3]}
            self._cargo = {item: self._in_target(item) for item in cargo_of(world, target)}
            along |= self._cargo.keys()
        else:
            along.update(riders(world, target))
        self._before = {i: T for i, T in poses.items() if i not in along}

    def moved_m(self) -> dict[str, float]:
        """Return how far each item has moved, in metres, of those that did by more than `NOTICED_M`."""
        offsets = {i: self._world.T_world_link(i)[:3, 3] - before[:3, 3] for i, before in self._before.items()}
        distances = {i: float(np.linalg.norm(offset)) for i, offset in offsets.items()}
        return {i: round(distance, 4) for i, distance in distances.items() if distance > NOTICED_M}

    def check(self) -> Failure | None:
        """Return a failure that names the first item that moved too far, tipped over or left its carrier, or None."""
        for object_id, before in self._before.items():
            moved_m, tipped = _moved(before, self._world.T_world_link(object_id))
            if moved_m > DISPLACED_M or tipped:
                how = f"moved {moved_m * 100:.0f} cm" + (" and tipped over" if tipped else "")
                found = SideEffect(object_id, round(moved_m, 3), tipped)
                return Failure(FailureKind.SIDE_EFFECT, f"{object_id} {how}", (found,))
        for object_id, before in self._cargo.items():
            moved_m, tipped = _moved(before, self._in_target(object_id))
            if moved_m > DISPLACED_M and object_id not in cargo_of(self._world, self._target):
                found = SideEffect(object_id, round(moved_m, 3), tipped)
                return Failure(FailureKind.SIDE_EFFECT, f"{object_id} fell off {self._target}", (found,))
        return None

    def _in_target(self, object_id: str) -> Array:
        """Return the (4, 4) pose of an item in the target's frame."""
        return inverse(self._world.T_world_link(self._target)) @ self._world.T_world_link(object_id)


def _moved(before: Array, now: Array) -> tuple[float, bool]:
    """Return how far an item has moved between two poses (4, 4), in metres, and whether it tipped over."""
    moved_m = float(np.linalg.norm(now[:3, 3] - before[:3, 3]))
    return moved_m, float(now[:3, 2] @ before[:3, 2]) < float(np.cos(np.deg2rad(TIPPED_DEG)))


def stall(robot: Robot, q: Array, target: Array, max_offset_m: float = 0.0) -> Failure | None:
    """Return a failure when the robot is not at its target: blocked, or too weak.

    Args:
        robot: Its record.
        q: (Q,) or longer: where it is.
        target: (Q,) where it should be.
        max_offset_m: Largest deviation by noise (`CommandNoise`).
    """
    strays_rad = RAD_PER_M * max_offset_m
    base_m = float(np.hypot(*(q[:2] - target[:2])))
    if robot.lift_m:
        base_m = max(base_m, abs(float(q[3] - target[3])))
    yaw_rad = abs(wrap_angle(float(q[2] - target[2])))
    arm_rad = float(np.abs(q[robot.arm] - target[robot.arm]).max())
    base_ok = base_m <= BASE_STALL_M + math.sqrt(2.0) * max_offset_m
    if base_ok and yaw_rad <= YAW_STALL_RAD + strays_rad and arm_rad <= ARM_STALL_RAD + strays_rad:
        return None
    yaw_deg, arm_deg = float(np.rad2deg(yaw_rad)), float(np.rad2deg(arm_rad))
    return Failure(
        FailureKind.STALLED,
        f"the robot stalled: base {base_m * 100:.1f} cm and {yaw_deg:.1f} deg, arm {arm_deg:.1f} deg short",
        (RobotStall(round(base_m, 4), round(yaw_deg, 2), round(arm_deg, 2)),),
    )


CHECK_EVERY = 5
"""Physics steps between two checks of a monitor."""

SETTLE_S = 0.15  # The drives come to rest at their target.
GRIP_S = 0.6  # Closing, and coming to press.
FINGER_SPEED_M_S = 0.1  # They do not hit what they close on.
FINGER_STAGE_S = 0.02
LIMIT_S = 120.0
"""Simulated time that one primitive may take."""

Tick = Callable[[], None]
Carriage = tuple[str, str, float]
"""A joint that a motion moves along: its object's id, its name, and the position [rad or m] to which it is meant to."""

Pushed = tuple[str, Array]
"""An item that a motion pushes along: its id, and the (4, 4) pose in the world to which it is meant to."""

STILL_M = 0.001  # More than what trembles in contact, less than what rolls.
LONGEST_WAIT_S = 5.0  # A glass that lies on its side rolls for seconds.
LOOK_EVERY_S = 0.1


class Controller:
    """Sets drive targets and steps the world.

    Args:
        world: The world that moves.
        target: (Q,) joint targets to begin with.
        finger_target_m: Target of each finger.
        after_step: Called after every physics step (the recorder).
        noise: Noise that is added to the drive targets during motions.

    Attributes:
        target: (Q,) where base and arm are to be.
        drive_target: (Q,) the same with noise: the drives' targets.
        command_log: The commands so far, in order; `repeat` does the same again.
        moving_wall_s: Wall time spent on stepping so far; the rest of a primitive's time is planning.
        deadline_s: Simulated time at which a motion ends, finished or not.
    """

    def __init__(
        self,
        world: World,
        target: Array,
        finger_target_m: float,
        after_step: Tick,
        noise: NoiseStream | None = None,
    ) -> None:
        self.world = world
        self.target = np.array(target, dtype=float)
        self.velocity = np.zeros(world.model.movers)
        self.finger_target_m = float(finger_target_m)
        self.moving_wall_s = 0.0
        self.deadline_s = math.inf
        self._after_step = after_step
        self._noise = noise
        self._joints = list(world.robot.active_joints)
        self.command_log: list[DriveCommand] = []
        self._aim(self.target)

    @property
    def q(self) -> Array:
        """Measured base and arm positions, (Q,)."""
        return np.asarray(self.world.robot.get_qpos(), dtype=float)[: self.world.model.movers]

    def follow(
        self,
        path: Array,
        *,
        speed: float = 1.0,
        monitor: Monitor | None = None,
        carries: Carriage | Pushed | None = None,
    ) -> Failure | None:
        """Move along a path; return why it ended early, or None when it arrived.

        A robot that falls behind its path is blocked: it ends there, rather than press on with all its strength.

        Args:
            path: (N, Q) waypoints, the first one being the present target.
            speed: Fraction of the speed limits.
            monitor: Ends the motion when it has to end; the robot then slows down, and holds the posture it comes to.
            carries: What the motion is meant to do to a joint or an item. Physics decides that; a dry run takes it for
                done.
        """
        began = time.perf_counter()
        failure: Failure | None = None

        def ended(step: int, q: Array) -> bool:
            nonlocal failure
            failure = self._must_end(q, monitor) if step % CHECK_EVERY == 0 else None
            return failure is not None

        self._move(path, speed, ended)
        self.moving_wall_s += time.perf_counter() - began
        if failure is not None:
            self.settle(SETTLE_S)
            return failure
        return self.settle(SETTLE_S, monitor) or stall(self.world.model, self.q, self.target)

    def rest(self) -> None:
        """Hold the robot at its present position, so that it does not press on against what stopped it."""
        self._aim(self.q)
        self.settle(SETTLE_S)

    def repeat(self, command: DriveCommand) -> None:
        """Repeat, step by step, what a controller has done at a command."""
        self.finger_target_m = command.finger_m
        if len(command.path) > 1:
            self._move(command.path, command.speed, lambda step, _: command.stopped and step + 1 == command.followed)
        else:
            self._aim(command.path[0])
        self._hold(command.held)

    def start_primitive(self) -> None:
        """Start the time limit of a primitive."""
        self.deadline_s = self.world.time_s + LIMIT_S

    def _must_end(self, q: Array, monitor: Monitor | None) -> Failure | None:
        """Return why a motion cannot go on at a moment whose target is q, or None."""
        return (
            self._timeout()
            or (monitor.check() if monitor else None)
            or stall(self.world.model, self.q, q, self._noise.max_offset_m if self._noise else 0.0)
        )

    def _timeout(self) -> Failure | None:
        if self.world.time_s <= self.deadline_s:
            return None
        message = f"the primitive was not done after {LIMIT_S:.0f} s"
        return Failure(FailureKind.TIMEOUT, message, (TimeUp(LIMIT_S, round(self.world.time_s, 2)),))

    def grip(self, finger_target_m: float) -> Array:
        """Move the fingers to a position, wait, and return the positions of both (2,), in metres from the middle.

        Their speed is low enough not to knock what they close on.
        """
        now_m = float(np.asarray(self.world.robot.get_qpos(), dtype=float)[self.world.model.fingers].mean())
        way_m = float(finger_target_m) - now_m
        stages = max(int(np.ceil(abs(way_m) / (FINGER_SPEED_M_S * FINGER_STAGE_S))), 1)
        for stage in range(1, stages + 1):
            self.finger_target_m = float(finger_target_m) - way_m * (stages - stage) / stages
            self._aim(self.target)
            self.settle(FINGER_STAGE_S if stage < stages else max(GRIP_S - stage * FINGER_STAGE_S, FINGER_STAGE_S))
        return np.asarray(self.world.robot.get_qpos(), dtype=float)[self.world.model.fingers]

    def settle(self, duration_s: float, monitor: Monitor | None = None) -> Failure | None:
        """Step the world while the robot holds still; return the monitor's failure, or None."""
        began = time.perf_counter()
        try:
            return self._settle(duration_s, monitor)
        finally:
            self.moving_wall_s += time.perf_counter() - began

    def _settle(self, duration_s: float, monitor: Monitor | None) -> Failure | None:
        for k in range(max(round(duration_s / self.world.timestep_s), 1)):
            self._hold(1)
            if monitor is not None and k % CHECK_EVERY == 0 and (failure := monitor.check()):
                return failure
        return None

    def _move(self, path: Array, speed: float, ended: Callable[[int, Array], bool]) -> None:
        """Move along a path to its end, or slow down at the first step at which `ended` is true."""
        positions, velocities = time_path(self.world.model, path, self.world.timestep_s, speed)
        followed, stopped = 0, False
        for q, v in zip(positions, velocities, strict=True):
            left_s = (len(positions) - followed) * self.world.timestep_s
            self._command(q, v, left_s)
            self._step()
            followed += 1
            if ended(followed - 1, q):
                for stop_q, stop_v in zip(*stop_path(self.world.model, q, v, self.world.timestep_s), strict=True):
                    self._command(stop_q, stop_v, left_s)
                    self._step()
                stopped = True
                break
        else:
            self._command(path[-1], np.zeros(path.shape[1]))
        self.command_log.append(
            DriveCommand(np.array(path, dtype=float), self.finger_target_m, speed, followed, stopped)
        )

    def _aim(self, q: Array) -> None:
        """Command a position at rest."""
        self._command(q, np.zeros(len(self.target)))
        self.command_log.append(DriveCommand(self.target[None], self.finger_target_m))

    def _hold(self, steps: int) -> None:
        for _ in range(steps):
            self._step()
        self.command_log[-1] = replace(self.command_log[-1], held=self.command_log[-1].held + steps)

    def _command(self, q: Array, velocity: Array, left_s: float = 0.0) -> None:
        self.drive_target = np.array(q, dtype=float)
        if self._noise is not None and left_s > 0.0:
            self.drive_target += self._noise.offset(velocity, left_s, gripping=self.finger_target_m <= 0.0)
        for joint, position, speed in zip(self._joints[: len(self.target)], self.drive_target, velocity, strict=True):
            joint.set_drive_target(float(position))
            joint.set_drive_velocity_target(float(speed))
        for joint in self._joints[len(self.target) :]:
            joint.set_drive_target(self.finger_target_m)
        self.target = np.array(q, dtype=float)
        self.velocity = np.array(velocity, dtype=float)

    def _step(self) -> None:
        self.world.step()
        self._after_step()


def settle_to_rest(control: Controller, duration_s: float) -> float:
    """Hold the robot still for some simulated time, and on until no item moves; return the seconds of waiting.

    An item rests when it moved by less than `STILL_M` in the last tenth of a second. Velocities are no criterion, since
    contacts make resting things tremble. After `LONGEST_WAIT_S` of waiting things are left as they are.

    Args:
        duration_s: How long in any case, at least a tenth of a second.
    """
    world = control.world
    control.settle(duration_s - LOOK_EVERY_S)
    waited_s = -LOOK_EVERY_S
    moved_m = np.inf
    while moved_m > STILL_M and waited_s < LONGEST_WAIT_S:
        before = _positions(world)
        control.settle(LOOK_EVERY_S)
        waited_s += LOOK_EVERY_S
        moved_m = max(
            (float(np.linalg.norm(after - p)) for p, after in zip(before, _positions(world), strict=True)), default=0.0
        )
    return waited_s


def _positions(world: World) -> list[Array]:
    return [world.T_world_link(name)[:3, 3] for name in world.dynamic_ids]
