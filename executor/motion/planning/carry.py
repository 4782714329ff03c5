"""How to drive, with something in the gripper or without: where the arm is on the way, and by which way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from executor.geometry import Array, hand_rotation, heading_of, pitch_of, rotation_z, transform
from executor.motion.planning.paths import base_move, segment
from executor.motion.planning.planner import Planner
from executor.robot.kinematics import ARM

BACK_OUT_M = (0.35, 0.3, 0.25, 0.2, 0.15, 0.1, 0.05)  # The farthest that is free, from over a table to before it.
BACK_OUT_TURNS_RAD = (0.0, 0.4, -0.4, 0.8, -0.8)  # Straight back first.
BACK_OUT_CLEARANCE_M = 0.003  # Little: what is carried is still near to what it stood on.
TUCKED_REACH_M = (0.36, 0.40, 0.32)  # Over the base, so that the hand does not sweep.
TUCKED_HEIGHTS_M = (0.80, 0.70, 0.90)  # Above tables of usual height.
SPLIT = 3  # Ways to begin that are tried: each costs a search for the drive.
ROLLED = 0.1
"""How far a hand's closing axis is off the level that holds something by its rim; tucked in, it keeps its roll."""


Leg = tuple[Literal["back out", "take up a posture", "drive", "take up the goal posture"], Array]
"""What a part of a journey is for, and its path (N, 10)."""


@dataclass(frozen=True, slots=True)
class Drive:
    """A journey in legs."""

    legs: tuple[Leg, ...]

    @property
    def end(self) -> Array:
        """Where the journey ends, (10,)."""
        return self.legs[-1][1][-1]


def drive_to(planner: Planner, q: Array, goal: Array) -> Drive | None:
    """Returns a free journey to a configuration (10,), or None.

    With something in the gripper the robot first backs away from where it took it. Then it tries to take up the
    goal's arm posture before driving, then at the end, and last to carry tucked in.

    Args:
        planner: Its oracle knows what is carried and where things are.
        q: (10,) where the robot is.
        goal: (10,) wanted base pose and arm posture.
    """
    for start in _starts(planner, q):
        here = start.end if start.legs else q
        for posture in _postures(planner, here, goal):
            legs = _legs(planner, here, posture, goal)
            if legs is not None:
                return Drive(start.legs + legs)
    return None


def _starts(planner: Planner, q: Array) -> list[Drive]:
    """Returns ways to begin: backing out as far as is free when something is carried, else from where it stands."""
    if planner.oracle.carried is None:
        return [Drive(())]
    heading = float(q[2]) + np.pi
    found = []
    for distance_m in BACK_OUT_M:
        for turn in BACK_OUT_TURNS_RAD:
            out = base_move(q, distance_m, heading + turn)
            if planner.oracle.first_hit(segment(out[0], out[1]), margin_m=BACK_OUT_CLEARANCE_M) is None:
                found.append(Drive((("back out", out),)))
                if len(found) == SPLIT:
                    return found
    return [*found, Drive(())]


def _postures(planner: Planner, q: Array, goal: Array) -> list[Array]:
    """Returns arm postures (7,) to drive with: the goal's, the present one, and one tucked in."""
    postures = [goal[ARM]]
    if planner.oracle.carried is None:
        return [q[ARM], goal[ARM]]
    tucked = _tucked(planner, q)
    return [*postures, *([] if tucked is None else [tucked]), q[ARM]]


def _tucked(planner: Planner, q: Array) -> Array | None:
    """Returns a posture that holds the hand near the base at its present tilt, or None."""
    kinematics = planner.kinematics
    T = kinematics.forward(q)
    base = q[:3]
    yaw = heading_of(T[:3, 2])
    T_turned = T[:3, :3]
    for reach_m in TUCKED_REACH_M:
        for height_m in TUCKED_HEIGHTS_M:
            heading = float(base[2])
            if abs(T_turned[2, 1]) > ROLLED:
                R = rotation_z(heading - yaw) @ T_turned
            else:
                R = hand_rotation(heading, pitch_of(T), flip=_is_flipped(T_turned, yaw, pitch_of(T)))
            point = [base[0] + reach_m * np.cos(heading), base[1] + reach_m * np.sin(heading), height_m]
            for solution in kinematics.solve(transform(R, point), base, near=q[ARM], restarts=8)[:1]:
                if planner.oracle.is_free(np.concatenate([base, solution.arm])):
                    return solution.arm
    return None


def _is_flipped(R: Array, yaw: float, pitch: float) -> bool:
    return float(R[:, 1] @ hand_rotation(yaw, pitch)[:, 1]) < 0.0


def _legs(planner: Planner, q: Array, posture: Array, goal: Array) -> tuple[Leg, ...] | None:
    """Returns legs: take up a posture, drive, take up the goal's posture; or None when one is not free."""
    legs: list[Leg] = []
    here = q
    if np.abs(posture - here[ARM]).max() > 1e-6:
        path = planner.arm_path(here, posture)
        if path is None:
            return None
        legs.append(("take up a posture", path))
        here = path[-1]
    path = planner.base_path(here, goal[:3])
    if path is None:
        return None
    legs.append(("drive", path))
    here = path[-1]
    if np.abs(goal[ARM] - here[ARM]).max() > 1e-6:
        path = planner.arm_path(here, goal[ARM])
        if path is None:
            return None
        legs.append(("take up the goal posture", path))
    return tuple(legs)
