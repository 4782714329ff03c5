"""Choices of a dry run that the physical run makes again: where the base stands, and how the hand is placed.

Physics leaves things millimetres off where the dry run had them. So no configuration is kept: a search looks first at
its own candidates near a choice, as exactly as at all others, and goes on to the others where none of those will do.
The arm's posture is where its own solutions start from: on another branch of the arm a door opens less far.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from executor.geometry import Array, wrap_angle

SAME_PLACE_M, SAME_HEADING_RAD = 0.03, 0.06
"""Nearer to each other, two base poses are one choice: physics leaves things less far off."""

SAME_HAND_M, SAME_APPROACH_COSINE = 0.02, 0.98


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """What was chosen for a step of a flow.

    Attributes:
        step: Index of the step.
        base: (B,) where the base stands.
        T_anchor_eef: (4, 4) the hand there, in the frame of the step's target or support.
        arm: (A,) the posture of the arm there.
        drives: (N, B) waypoints of the drives that were found on the way to it.
    """

    step: int
    base: Array
    T_anchor_eef: Array
    arm: Array
    drives: tuple[Array, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Near:
    """The neighbourhood of a choice, to which a search is narrowed.

    Attributes:
        base: (B,) where the base stands.
        T_world_eef: (4, 4) the hand.
        arm: (A,) the posture of the arm.
        drives: (N, B) waypoints of drives that led there.
    """

    base: Array
    T_world_eef: Array
    arm: Array
    drives: tuple[Array, ...] = ()

    def has_hand(self, T_world_eef: Array) -> bool:
        """Return whether a hand pose (4, 4) is nearly the chosen one, whichever way the fingers close."""
        off_m = float(np.linalg.norm(T_world_eef[:3, 3] - self.T_world_eef[:3, 3]))
        return off_m < SAME_HAND_M and float(T_world_eef[:3, 2] @ self.T_world_eef[:3, 2]) > SAME_APPROACH_COSINE

    def has_base(self, base: Array) -> bool:
        """Return whether base coordinates (B,) are nearly the chosen ones."""
        return _are_near(base, self.base)

    def drives_between(self, start: Array, goal: Array) -> Iterator[list[Array]]:
        """Yield the waypoints (B,) of known drives between nearly the same base poses, with these as their ends."""
        for known in self.drives:
            if _are_near(start, known[0]) and _are_near(goal, known[-1]):
                turn_rad = 2 * np.pi * round(float(start[2] - known[0, 2]) / (2 * np.pi))
                between = known[1:-1] + np.eye(known.shape[1])[2] * turn_rad
                yield [start, *between, goal]


def _are_near(one: Array, other: Array) -> bool:
    off_m = np.delete(one - other, 2)
    return bool(np.abs(off_m).max() < SAME_PLACE_M) and abs(wrap_angle(one[2] - other[2])) < SAME_HEADING_RAD
