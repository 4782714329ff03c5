"""The arm where hand actions want the hand: ten numbers leave one of its seven joints free, and this decides it."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from executor.envs.elbow import Elbow, HandWish
from executor.geometry import Array
from executor.robot.actions import arm_chain, joint_limits
from executor.robot.tracking import pose_error

ARM_SPEEDS_RAD_S = np.array([2.175] * 4 + [2.61] * 3)
"""What Franka Robotics allows a Panda's joints. Where an elbow is elsewhere than a demonstration's was, the same motion
of the hand asks some joint for twice the speed; at the 1.2 rad/s of planned motions hands fell 5 cm behind."""

OWED_M, OWED_RAD = 0.05, 0.3
"""How far beyond what the arm reaches a wish may go on growing: as much as comes back within half a second."""

AHEAD_S = 0.3
"""How far ahead elbows look, if hand and base go on as they do: while they go round to another side. Farther ahead,
hands that will have stopped seem to run into things."""

_ARM = slice(3, 10)
_INSET_RAD = 0.002  # Commands end so far before a limit of the arm.
_FREE = 1e-4  # Weight of the elbow beside the hand, m and rad squared: a wish of 0.1 rad costs the hand 0.01 mm.
_FINE = 1e-6
_ITERATIONS = 3  # After one the hand is within 0.01 mm, where nothing holds it up.
_NEAR, _REACHED = 1e-3, 1e-5  # From so near the Jacobian tells the rest to a thousandth; so near is there.
_JOINTS, _STILL = np.eye(7), np.zeros(7)  # Of an arm: weights of all alike, and a wish to stay.
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
        self._ahead = AHEAD_S / period_s
        self._now_and_soon = np.array([[1.0], [1.0 + self._ahead]])

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
        wanted = _moved(self._wanted, self._now_and_soon * action[:6])
        self._wanted = wanted[0]
        bases = np.stack([base, base + self._ahead * (base - before[:3])])
        moves = bool(action[:6].any())
        return np.concatenate([base, self._posture(before[_ARM], wanted, bases, moves=moves), fingers])

    def _posture(self, before: Array, wanted: Array, bases: Array, *, moves: bool) -> Array:
        """Returns the (7,) posture after one with the hand where it is wanted now, or as near as may be."""
        low, high = self._limits[_ARM, 0] + _INSET_RAD, self._limits[_ARM, 1] - _INSET_RAD
        low = np.maximum(np.minimum(low, before), before - self._most_rad)
        high = np.minimum(np.maximum(high, before), before + self._most_rad)
        reached, jacobians = self._chain.forward_and_jacobian(before[None])
        errors = pose_error(wanted, reached)
        wish = self._elbow.wish(before, HandWish(jacobians[0], errors, wanted, bases), homeward=moves)
        step = _solved(jacobians[0], errors[0], _FREE, wish, low - before, high - before)
        arm = np.clip(before + step, low, high)
        for _ in range(_ITERATIONS):
            reached, jacobians = self._chain.forward_and_jacobian(arm[None])
            error = pose_error(wanted[:1], reached)[0]
            step = _solved(jacobians[0], error, _FINE, _STILL, low - arm, high - arm)
            arm = np.clip(arm + step, low, high)
            if _norm(error) < _NEAR and _norm(error - jacobians[0] @ step) < _REACHED:
                return arm
        self._forgive(arm)
        return arm

    def _forgive(self, arm: Array) -> None:
        """Brings what is wanted back to what a posture can still catch up with."""
        reached = self._chain.forward(arm[None])
        owed = pose_error(self._wanted[None], reached)[0]
        for part, most in ((owed[:3], OWED_M), (owed[3:], OWED_RAD)):
            part *= min(1.0, most / max(_norm(part), _APART_RAD))
        self._wanted = _moved(reached[0], owed[None])[0]


def _moved(T: Array, motions: Array) -> Array:
    """Returns a (4, 4) pose after each of N motions (N, 6): moved (m) and turned (rotation vector, rad) where it is."""
    after = np.empty((len(motions), 4, 4))
    after[:] = T
    after[:, :3, 3] += motions[:, :3]
    after[:, :3, :3] = Rotation.from_rotvec(motions[:, 3:]).as_matrix() @ T[:3, :3]
    return after


def _norm(vector: Array) -> float:
    return math.sqrt(float(vector @ vector))


def _solved(jacobian: Array, error: Array, weight: float, wish: Array, low: Array, high: Array) -> Array:
    """Returns the (7,) change of posture within bounds that brings a hand nearest to where it is wanted.

    Args:
        jacobian: (6, 7) how the hand moves and turns with the joints.
        error: (6,) how far it is off, m and rad.
        weight: Of rad squared off the wish beside m and rad squared of the hand.
        wish: (7,) the change that is best for the elbow.
        low, high: (7,) bounds.
    """
    free = np.linalg.solve(jacobian.T @ jacobian + weight * _JOINTS, jacobian.T @ error + weight * wish)
    if (np.clip(free, low - _APART_RAD, high + _APART_RAD) == free).all():
        return np.asarray(free)
    # Without bounds it takes a tenth of the time.
    rows = np.concatenate([jacobian, np.sqrt(weight) * _JOINTS])
    sought = np.concatenate([error, np.sqrt(weight) * wish])
    return np.asarray(lsq_linear(rows, sought, (low - _APART_RAD, high + _APART_RAD), method="bvls").x)
