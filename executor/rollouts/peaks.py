"""The most that was asked of the robot: forces, torques, speeds and accelerations, at every step of the physics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from executor.geometry import Array
from executor.primitives.control import Controller
from executor.records.rollout import Peaks
from executor.robot.description import drives
from executor.world.world import World

OVER_STEPS = 5
"""An acceleration is a change of speed over 20 ms: from one step to the next, contacts make any number of it."""


class PeakWatch:
    """Follows one world; what it has seen is taken out sample by sample."""

    def __init__(self) -> None:
        self._world: World | None = None
        self._stiffness, self._damping, self._limits = np.zeros((3, 12))
        self._velocities: list[Array] = []
        self._row = np.zeros(11)

    def look(self, world: World, control: Controller) -> None:
        """Looks at the state after a physics step.

        What the drives press with is what their law says of that state, within the limits that the engine has.
        """
        if self._world is not world:
            self._world, self._velocities = world, []
            self._stiffness, self._damping, _ = np.array(drives(world.scene.robot.scale)).T
            self._limits = np.array([joint.force_limit for joint in world.robot.active_joints])
        q, v = np.asarray(world.robot.get_qpos(), float), np.asarray(world.robot.get_qvel(), float)
        off = np.concatenate([control.told, [control.finger_target_m] * 2]) - q
        slower = np.concatenate([control.velocity, [0.0, 0.0]]) - v
        f = np.minimum(np.abs(self._stiffness * off + self._damping * slower), self._limits)
        self._velocities.append(v)
        a = np.zeros(12)
        if len(self._velocities) > OVER_STEPS:
            a = np.abs(v - self._velocities.pop(0)) / (OVER_STEPS * world.timestep_s)
        s = np.abs(v)
        seen = (np.hypot(s[0], s[1]), s[2], s[3:10].max(), np.hypot(a[0], a[1]), a[2], a[3:10].max())
        pressed = (np.hypot(f[0], f[1]), f[2], f[3:7].max(), f[7:10].max(), f[10:].max())
        self._row = np.maximum(self._row, (*seen, *pressed))

    def take(self) -> Array:
        """Returns (11,) the largest figures since it was asked last, in the order of `Peaks`."""
        row, self._row = self._row, np.zeros(11)
        return row


def summary(rows: Sequence[Array]) -> Peaks:
    """Returns the figures of an episode."""
    return Peaks(*(round(float(value), 3) for value in np.max(rows, axis=0))) if rows else Peaks()
