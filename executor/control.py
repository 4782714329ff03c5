"""Drives the robot's joints along timed paths, one physics step at a time."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from executor.geometry import Array
from executor.monitors import Monitor, stall
from executor.motion.timing import time_path
from executor.records import Failure
from executor.world import World

CHECK_EVERY = 5
"""Physics steps between two looks of a monitor."""

SETTLE_S = 0.15
GRIP_S = 0.6

Tick = Callable[[], None]


class Controller:
    """Sets drive targets and steps the world.

    Args:
        world: The world that moves.
        target: (10,) joint targets to begin with.
        finger_target_m: Target of each finger.
        after_step: Called after every physics step (the recorder).

    Attributes:
        moving_wall_s: Wall time spent on stepping so far; what a primitive needs beyond it is planning.
    """

    def __init__(self, world: World, target: Array, finger_target_m: float, after_step: Tick) -> None:
        self.world = world
        self.target = np.array(target, dtype=float)
        self.finger_target_m = float(finger_target_m)
        self.moving_wall_s = 0.0
        self._after_step = after_step
        self._joints = list(world.robot.active_joints)
        self._command(self.target, np.zeros(10))

    @property
    def q(self) -> Array:
        """Measured base and arm positions, (10,)."""
        return np.asarray(self.world.robot.get_qpos(), dtype=float)[:10]

    def follow(self, path: Array, *, speed: float = 1.0, monitor: Monitor | None = None) -> Failure | None:
        """Moves along a path and returns why it ended early, or None when it arrived.

        Args:
            path: (N, 10) waypoints, the first one being the present target.
            speed: Fraction of the speed limits.
            monitor: Ends the motion when it has to end; the robot then holds where it is.
        """
        began = time.perf_counter()
        positions, velocities = time_path(path, self.world.timestep_s, speed)
        for k, (q, v) in enumerate(zip(positions, velocities, strict=True)):
            self._command(q, v)
            self._step()
            if monitor is not None and k % CHECK_EVERY == 0 and (failure := monitor.check()):
                self._command(q, np.zeros(10))
                self.moving_wall_s += time.perf_counter() - began
                self.settle(SETTLE_S)
                return failure
        self._command(path[-1], np.zeros(10))
        self.moving_wall_s += time.perf_counter() - began
        return self.settle(SETTLE_S, monitor) or stall(self.q, self.target)

    def grip(self, finger_target_m: float, duration_s: float = GRIP_S) -> Array:
        """Sends the fingers to a position, waits, and returns where both are (2,), in metres from the middle."""
        self.finger_target_m = float(finger_target_m)
        self._command(self.target, np.zeros(10))
        self.settle(duration_s)
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
            self._step()
            if monitor is not None and k % CHECK_EVERY == 0 and (failure := monitor.check()):
                return failure
        return None

    def _command(self, q: Array, velocity: Array) -> None:
        for joint, position, speed in zip(self._joints[:10], q, velocity, strict=True):
            joint.set_drive_target(float(position))
            joint.set_drive_velocity_target(float(speed))
        for joint in self._joints[10:]:
            joint.set_drive_target(self.finger_target_m)
        self.target = np.array(q, dtype=float)

    def _step(self) -> None:
        self.world.step()
        self._after_step()
