"""The arm where hand actions want the hand: ten numbers leave one of its seven joints free, and this decides it."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from executor.envs.elbow import Elbow
from executor.geometry import Array
from executor.robot.actions import arm_chain, joint_limits

ARM_SPEEDS_RAD_S = np.array([2.175] * 4 + [2.61] * 3)
"""What Franka Robotics allows a Panda's joints. Where an elbow is elsewhere than a demonstration's was, the same motion
of the hand asks some joint for twice the speed; at the 1.2 rad/s of planned motions hands fell 5 cm behind."""

OWED_M, OWED_RAD = 0.05, 0.3
"""How far beyond what the arm reaches a wish may go on growing: as much as comes back within half a second."""

_ARM = slice(3, 10)
_INSET_RAD = 0.002  # Commands end so far before a limit of the arm.
_FREE = 1e-4  # Weight of the elbow beside the hand, m and rad squared: a wish of 0.1 rad costs the hand 0.01 mm.
_FINE = 1e-6
_ITERATIONS = 4  # After two the hand is within 0.01 mm.
_REACHED = 1e-5
_APART_RAD = 1e-12  # A joint that must not move has no room between its bounds.


class HandFollower:
    """Where the hand is wanted, action by action; what one action leaves undone, the next ones catch up with.

    Args:
        scale: The robot's, of a Panda's full size.
        target: (12,) joint targets to begin with.
        period_s: How long an action lasts.
        elbow: Says where the elbow is to be.
    """

    def __init__(self, scale: float, target: Array, period_s: float, elbow: Elbow) -> None:
        self._elbow = elbow
        self._chain, self._limits = arm_chain(scale), joint_limits(scale)
        self._wanted = self._chain.forward(np.asarray(target, float)[None, _ARM])[0]
        self._most_rad = ARM_SPEEDS_RAD_S * period_s

    def joint_target(self, before: Array, action: Array) -> Array:
        """Returns the (12,) joint targets that a hand action asks for.

        The arm takes a posture near the one before, within its limits and speeds, its elbow on the way to where it is
        to be. Where the hand cannot get all the way at once, it gets as near as it can, and owes the rest, up to
        `OWED_M` and `OWED_RAD`.

        Args:
            before: (12,) joint targets that the drives hold.
            action: (10,) a hand action, as `executor.robot.actions` defines it.
        """
        before, action = np.asarray(before, float), np.asarray(action, float)
        cosine, sine = np.cos(before[2]), np.sin(before[2])
        ahead, aside = action[7:9]
        base = before[:3] + [cosine * ahead - sine * aside, sine * ahead + cosine * aside, action[9]]
        fingers = np.full(2, action[6] * self._limits[-1, 1])
        self._wanted[:3, 3] += action[:3]
        self._wanted[:3, :3] = Rotation.from_rotvec(action[3:6]).as_matrix() @ self._wanted[:3, :3]
        return np.concatenate([base, self._posture(base, before[_ARM], moves=bool(action[:6].any())), fingers])

    def _posture(self, base: Array, before: Array, *, moves: bool) -> Array:
        """Returns the (7,) posture after one with the hand where it is wanted, or as near as may be."""
        low, high = self._limits[_ARM, 0] + _INSET_RAD, self._limits[_ARM, 1] - _INSET_RAD
        low = np.maximum(np.minimum(low, before), before - self._most_rad)
        high = np.minimum(np.maximum(high, before), before + self._most_rad)
        arm, weight, wish = before, _FREE, np.zeros(len(before))
        for number in range(_ITERATIONS):
            reached, jacobian = (found[0] for found in self._chain.forward_and_jacobian(arm[None]))
            error = np.concatenate([self._wanted[:3, 3] - reached[:3, 3], self._turn(reached)])
            if weight == _FINE and np.linalg.norm(error) < _REACHED:
                return arm
            if number == 0:
                wish = self._elbow.wish(base, arm, reached[:3, 3], jacobian, homeward=moves)
            rows = np.concatenate([jacobian, np.sqrt(weight) * np.eye(len(arm))])
            sought = np.concatenate([error, np.sqrt(weight) * wish])
            arm = np.clip(arm + _solved(rows, sought, low - arm - _APART_RAD, high - arm + _APART_RAD), low, high)
            weight, wish = _FINE, np.zeros(len(arm))
        self._forgive(arm)
        return arm

    def _forgive(self, arm: Array) -> None:
        """Brings what is wanted back to what a posture can still catch up with."""
        reached = self._chain.forward(arm[None])[0]
        owed_m, owed_rad = self._wanted[:3, 3] - reached[:3, 3], self._turn(reached)
        if (length_m := float(np.linalg.norm(owed_m))) > OWED_M:
            self._wanted[:3, 3] = reached[:3, 3] + owed_m * OWED_M / length_m
        if (angle_rad := float(np.linalg.norm(owed_rad))) > OWED_RAD:
            turn = Rotation.from_rotvec(owed_rad * OWED_RAD / angle_rad)
            self._wanted[:3, :3] = turn.as_matrix() @ reached[:3, :3]

    def _turn(self, reached: Array) -> Array:
        """Returns the (3,) rotation vector from a hand pose to the one wanted, rad."""
        return np.asarray(Rotation.from_matrix(self._wanted[:3, :3] @ reached[:3, :3].T).as_rotvec())


def _solved(rows: Array, sought: Array, low: Array, high: Array) -> Array:
    """Returns the solution of a least-squares problem within bounds; without bounds it takes a tenth of the time."""
    free = np.linalg.lstsq(rows, sought, rcond=None)[0]
    if ((low <= free) & (free <= high)).all():
        return np.asarray(free)
    return np.asarray(lsq_linear(rows, sought, (low, high), method="bvls").x)
