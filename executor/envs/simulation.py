"""Physics that is moved by an action at a low rate: drive targets move evenly, no faster than they may."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from executor.envs.following import ARM_SPEEDS_RAD_S
from executor.geometry import Array
from executor.primitives.control import FINGER_SPEED_M_S
from executor.primitives.timing import SPEED_LIMITS
from executor.robot.actions import TARGETS, joint_limits
from executor.rollouts.checkpoint import Checkpoint
from executor.world.engine import TIMESTEP_S
from executor.world.physics import STANDARD, Physics
from executor.world.world import World
from oag import Scene

SLACK = 1.001  # Of speed limits: recorded targets are rounded.
SPEEDS = np.array([*SPEED_LIMITS, FINGER_SPEED_M_S, FINGER_SPEED_M_S])
"""How fast targets may move: m/s, rad/s; base, arm, fingers. As fast as planned motions do."""

FOLLOWING_SPEEDS = np.concatenate([SPEEDS[:3], ARM_SPEEDS_RAD_S, SPEEDS[10:]])
"""The same where an arm follows its hand."""

_MOVERS = 10  # Base and arm; fingers press, and have no speed that is told.


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
        speeds: (12,) how fast targets may move, m/s and rad/s.

    Attributes:
        world: The physics.
        target: (12,) where the drives hold the robot now.
        period_s: How long an action lasts.
        before_step: Called before every step of the physics: what pushes on things.
    """

    def __init__(
        self, scene: Scene, start: Checkpoint, rate_hz: float, physics: Physics = STANDARD, speeds: Array = SPEEDS
    ) -> None:
        self.world, control = start.restore(scene, lambda: None, physics=physics)
        # The engine finds contacts by stepping, and a restored world has none.
        control.settle(self.world.timestep_s)
        self._each = steps_each(rate_hz, self.world.timestep_s)
        self.period_s = self._each * self.world.timestep_s
        self._joints = list(self.world.robot.active_joints)
        self._low, self._high = joint_limits(scene.robot.scale).T
        self._speeds = speeds
        self.before_step: Callable[[World], None] = lambda world: None
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
        held_m = np.asarray(world.robot.get_qpos(), dtype=float)[_MOVERS:]
        wanted = np.clip(np.asarray(wanted, dtype=float), self._low, self._high)
        start[_MOVERS:] = np.clip(
            held_m, np.minimum(start[_MOVERS:], wanted[_MOVERS:]), np.maximum(start[_MOVERS:], wanted[_MOVERS:])
        )
        most = SLACK * duration_s * self._speeds
        way = np.clip(wanted - start, -most, most)
        for joint, speed in zip(self._joints[:_MOVERS], (way[:_MOVERS] / duration_s).tolist(), strict=True):
            joint.set_drive_velocity_target(speed)
        # What is to stay is told once: telling costs a tenth of a physics step.
        moving = [k for k in range(TARGETS) if way[k] or start[k] != self.target[k]]
        tell = [self._joints[k].set_drive_target for k in moving]
        for targets in (start + np.linspace(0.0, 1.0, count + 1)[1:, None] * way)[:, moving].tolist():
            for tell_joint, target in zip(tell, targets, strict=True):
                tell_joint(target)
            self.before_step(world)
            world.step()
        self.target = start + way
