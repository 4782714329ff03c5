"""Physics that is moved by an action at a low rate: drive targets move evenly, no faster than planned motions."""

from __future__ import annotations

import numpy as np

from executor.geometry import Array
from executor.primitives.control import FINGER_SPEED_M_S
from executor.primitives.timing import SPEED_LIMITS
from executor.robot.actions import TARGETS, joint_limits
from executor.rollouts.checkpoint import Checkpoint
from executor.world.engine import TIMESTEP_S
from executor.world.physics import STANDARD, Physics
from oag import Scene

SLACK = 1.001  # Of speed limits: recorded targets are rounded.
SPEEDS = np.array([*SPEED_LIMITS, FINGER_SPEED_M_S, FINGER_SPEED_M_S])
"""How fast targets may move: m/s, rad/s; base, arm, fingers."""


def steps_each(rate_hz: float, timestep_s: float = TIMESTEP_S) -> int:
    """Returns how many physics steps an action lasts, as recorded samples are apart."""
    return max(round(1.0 / (rate_hz * timestep_s)), 1)


class Simulation:
    """One episode's physics.

    Args:
        scene: The concrete scene.
        start: Where the episode begins.
        rate_hz: Actions a second of simulated time.
        physics: What an experiment, or a varied demonstration, changed.

    Attributes:
        world: The physics.
        target: (12,) where the drives hold the robot now.
    """

    def __init__(self, scene: Scene, start: Checkpoint, rate_hz: float, physics: Physics = STANDARD) -> None:
        self.world, control = start.restore(scene, lambda: None, physics=physics)
        # The engine finds contacts by stepping, and a restored world has none.
        control.settle(self.world.timestep_s)
        self._each = steps_each(rate_hz, self.world.timestep_s)
        self._joints = list(self.world.robot.active_joints)
        self._low, self._high = joint_limits().T
        self.target = np.concatenate([control.target, np.full(TARGETS - len(control.target), control.finger_target_m)])

    def advance(self, wanted: Array) -> None:
        """Moves the drive targets towards others until the next action is due.

        Between two actions each target moves evenly; faster than its limit it does not move, and then ends short.
        Actions are due at whole multiples of the period, as samples of demonstrations are taken.

        Args:
            wanted: (12,) joint targets.
        """
        world = self.world
        count = self._each - world.steps % self._each
        duration_s = count * world.timestep_s
        start = self.target.copy()
        # Fingers that press are told to be far beyond where they are; they come back from where they are.
        held_m = np.asarray(world.robot.get_qpos(), dtype=float)[10:]
        wanted = np.clip(np.asarray(wanted, dtype=float), self._low, self._high)
        start[10:] = np.clip(held_m, np.minimum(start[10:], wanted[10:]), np.maximum(start[10:], wanted[10:]))
        most = SLACK * duration_s * SPEEDS
        way = np.clip(wanted - start, -most, most)
        for joint, speed in zip(self._joints[:10], (way[:10] / duration_s).tolist(), strict=True):
            joint.set_drive_velocity_target(speed)
        # What is to stay is told once: telling costs a tenth of a physics step.
        moving = [k for k in range(TARGETS) if way[k] or start[k] != self.target[k]]
        joints = [self._joints[k] for k in moving]
        for targets in (start + np.linspace(0.0, 1.0, count + 1)[1:, None] * way)[:, moving].tolist():
            for joint, target in zip(joints, targets, strict=True):
                joint.set_drive_target(target)
            world.step()
        self.target = start + way
