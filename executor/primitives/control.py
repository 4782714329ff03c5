"""Drives the robot's joints along timed paths, one physics step at a time, and waits until things are at rest."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from executor.geometry import Array
from executor.primitives.monitors import Monitor, stall
from executor.primitives.noise import NoiseStream
from executor.primitives.timing import stop_path, time_path
from executor.records.commands import DriveCommand
from executor.records.rollout import Failure, FailureKind
from executor.world.world import World
from oag.revision.measurements import TimeUp

CHECK_EVERY = 5
"""Physics steps between two looks of a monitor."""

SETTLE_S = 0.15  # The drives come to rest at their target.
GRIP_S = 0.6  # Closing, and coming to press.
FINGER_SPEED_M_S = 0.1  # They do not hit what they close on.
FINGER_STAGE_S = 0.02
LIMIT_S = 120.0
"""Simulated time that one primitive may take."""

Tick = Callable[[], None]
STILL_M = 0.001  # More than what trembles in contact, less than what rolls.
LONGEST_WAIT_S = 5.0  # A glass that lies on its side rolls for seconds.
LOOK_EVERY_S = 0.1


class Controller:
    """Sets drive targets and steps the world.

    Args:
        world: The world that moves.
        target: (10,) joint targets to begin with.
        finger_target_m: Target of each finger.
        after_step: Called after every physics step (the recorder).
        noise: What the drives are told beside the target, in motions.

    Attributes:
        target: (10,) where base and arm are to be.
        told: (10,) the same with noise: the drives' targets.
        given: What the robot was told so far, in order; `repeat` does the same again.
        moving_wall_s: Wall time spent on stepping so far; what a primitive needs beyond it is planning.
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
        self.velocity = np.zeros(10)
        self.finger_target_m = float(finger_target_m)
        self.moving_wall_s = 0.0
        self.deadline_s = math.inf
        self._after_step = after_step
        self._noise = noise
        self._joints = list(world.robot.active_joints)
        self.given: list[DriveCommand] = []
        self._aim(self.target)

    @property
    def q(self) -> Array:
        """Measured base and arm positions, (10,)."""
        return np.asarray(self.world.robot.get_qpos(), dtype=float)[:10]

    def follow(self, path: Array, *, speed: float = 1.0, monitor: Monitor | None = None) -> Failure | None:
        """Moves along a path and returns why it ended early, or None when it arrived.

        A robot that falls behind its path is blocked: it ends there, rather than press on with all its strength.

        Args:
            path: (N, 10) waypoints, the first one being the present target.
            speed: Fraction of the speed limits.
            monitor: Ends the motion when it has to end; the robot then slows down, and holds the posture it comes to.
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
        return self.settle(SETTLE_S, monitor) or stall(self.q, self.target)

    def rest(self) -> None:
        """Holds the robot where it has come to, so that it does not press on against what stopped it."""
        self._aim(self.q)
        self.settle(SETTLE_S)

    def repeat(self, command: DriveCommand) -> None:
        """Does again, step by step, what a controller has done at a command."""
        self.finger_target_m = command.finger_m
        if len(command.path) > 1:
            self._move(command.path, command.speed, lambda step, _: command.stopped and step + 1 == command.followed)
        else:
            self._aim(command.path[0])
        self._hold(command.held)

    def start_primitive(self) -> None:
        """Begins to count the time that a primitive may take."""
        self.deadline_s = self.world.time_s + LIMIT_S

    def _must_end(self, q: Array, monitor: Monitor | None) -> Failure | None:
        """Why a motion cannot go on, at a moment when the robot was told to be at q."""
        return (
            self._timeout()
            or (monitor.check() if monitor else None)
            or stall(self.q, q, self._noise.strays_m if self._noise else 0.0)
        )

    def _timeout(self) -> Failure | None:
        if self.world.time_s <= self.deadline_s:
            return None
        message = f"the primitive was not done after {LIMIT_S:.0f} s"
        return Failure(FailureKind.TIMEOUT, message, (TimeUp(LIMIT_S, round(self.world.time_s, 2)),))

    def grip(self, finger_target_m: float) -> Array:
        """Sends the fingers to a position, waits, and returns where both are (2,), in metres from the middle.

        They go there at a speed at which they do not hit what they close on.
        """
        now_m = float(np.asarray(self.world.robot.get_qpos(), dtype=float)[10:12].mean())
        way_m = float(finger_target_m) - now_m
        stages = max(int(np.ceil(abs(way_m) / (FINGER_SPEED_M_S * FINGER_STAGE_S))), 1)
        for stage in range(1, stages + 1):
            self.finger_target_m = float(finger_target_m) - way_m * (stages - stage) / stages
            self._aim(self.target)
            self.settle(FINGER_STAGE_S if stage < stages else max(GRIP_S - stage * FINGER_STAGE_S, FINGER_STAGE_S))
        return np.asarray(self.world.robot.get_qpos(), dtype=float)[10:12]

    def settle(self, duration_s: float, monitor: Monitor | None = None) -> Failure | None:
        """Lets the world run while the robot holds still; returns what the monitor objects to, or None."""
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
        """Moves along a path to its end, or slows down where, at a step and where the robot is to be then, it ended."""
        positions, velocities = time_path(path, self.world.timestep_s, speed)
        followed, stopped = 0, False
        for q, v in zip(positions, velocities, strict=True):
            left_s = (len(positions) - followed) * self.world.timestep_s
            self._command(q, v, left_s)
            self._step()
            followed += 1
            if ended(followed - 1, q):
                for stop_q, stop_v in zip(*stop_path(q, v, self.world.timestep_s), strict=True):
                    self._command(stop_q, stop_v, left_s)
                    self._step()
                stopped = True
                break
        else:
            self._command(path[-1], np.zeros(10))
        self.given.append(DriveCommand(np.array(path, dtype=float), self.finger_target_m, speed, followed, stopped))

    def _aim(self, q: Array) -> None:
        """Tells the robot where to be, at rest."""
        self._command(q, np.zeros(10))
        self.given.append(DriveCommand(self.target[None], self.finger_target_m))

    def _hold(self, steps: int) -> None:
        for _ in range(steps):
            self._step()
        self.given[-1] = replace(self.given[-1], held=self.given[-1].held + steps)

    def _command(self, q: Array, velocity: Array, left_s: float = 0.0) -> None:
        self.told = np.array(q, dtype=float)
        if self._noise is not None and left_s > 0.0:
            self.told += self._noise.offset(velocity, left_s, gripping=self.finger_target_m <= 0.0)
        for joint, position, speed in zip(self._joints[:10], self.told, velocity, strict=True):
            joint.set_drive_target(float(position))
            joint.set_drive_velocity_target(float(speed))
        for joint in self._joints[10:]:
            joint.set_drive_target(self.finger_target_m)
        self.target = np.array(q, dtype=float)
        self.velocity = np.array(velocity, dtype=float)

    def _step(self) -> None:
        self.world.step()
        self._after_step()


def settle_to_rest(control: Controller, duration_s: float) -> float:
    """Holds the robot still for some simulated time, and on until no item moves; returns the seconds of waiting.

    An item rests when it moved by less than `STILL_M` in the last tenth of a second: velocities do not tell, since
    contacts make resting things tremble. After `LONGEST_WAIT_S` of waiting things are left as they are.

    Args:
        control: The robot's controller.
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
