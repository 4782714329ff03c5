"""How to take the open hand away from what it has just let go of, and bring the arm home."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from executor.geometry import Array, heading_of, pitch_of
from executor.motion.contacts import NOTHING, Allowed
from executor.motion.oracle import BASE_CLEARANCE_M
from executor.motion.paths import base_move, segment
from executor.motion.planner import Planner
from executor.robot.description import ARM_HOME

BACK_OFF_M = (0.15, 0.12, 0.09, 0.06)
SIDE_STEPS_RAD = (0.0, 0.4, -0.4, 0.8, -0.8)
WITHDRAW_M = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.65)


@dataclass(frozen=True, slots=True)
class Withdrawal:
    """Two paths (N, 10): away from the object, then home with the arm (by way of a base move where needed)."""

    back_off: Array
    home: Array


def back_off(planner: Planner, q: Array, *, allowed: Allowed = NOTHING) -> Array | None:
    """Returns a free path (N, 10) along the hand's own axis, away from what it holds or held, or None.

    Level hands back off with the base, steep ones with the arm; the other way is tried next. Stepping aside is the
    last resort, because it drags a finger along the object.
    """
    T = planner.kinematics.forward(q)
    level = abs(pitch_of(T)) < np.deg2rad(50.0)
    straight = [_by_base(q, T, d, 0.0) for d in BACK_OFF_M]
    by_arm = [_by_arm(planner, q, T, d) for d in BACK_OFF_M]
    aside = [_by_base(q, T, d, turn) for turn in SIDE_STEPS_RAD[1:] for d in BACK_OFF_M]
    for path in [*straight, *by_arm, *aside] if level else [*by_arm, *straight, *aside]:
        if path is not None and planner.oracle.first_hit(path, allowed=allowed) is None:
            return path
    return None


def withdraw(planner: Planner, q: Array, *, allowed: Allowed = NOTHING) -> Withdrawal | None:
    """Returns how the hand leaves and the arm goes home, or None when no free way was found.

    Where a flow's own numbers have brought the base very near to something, its usual clearance is given up.

    Args:
        planner: The planner; its oracle must know where things are now.
        q: (10,) where the robot is, gripper open.
        allowed: Contacts of the fingers with the released object, while backing off.
    """
    usual_m = planner.oracle.base_clearance_m
    try:
        return _withdraw(planner, q, allowed) or _withdraw(planner, q, allowed, base_clearance_m=0.0)
    finally:
        planner.oracle.base_clearance_m = usual_m


def _withdraw(
    planner: Planner, q: Array, allowed: Allowed, base_clearance_m: float = BASE_CLEARANCE_M
) -> Withdrawal | None:
    planner.oracle.base_clearance_m = base_clearance_m
    away = back_off(planner, q, allowed=allowed)
    home = None if away is None else go_home(planner, away[-1])
    return None if away is None or home is None else Withdrawal(away, home)


def go_home(planner: Planner, q: Array) -> Array | None:
    """Returns a free path (N, 10), q first, to the arm's home posture, backing out with the base where needed."""
    T = planner.kinematics.forward(q)
    headings = [float(q[2]) + np.pi]
    if abs(pitch_of(T)) < np.deg2rad(60.0):
        headings.append(heading_of(-T[:3, 2]))
    for distance_m in WITHDRAW_M:
        for heading in headings:
            out = base_move(q, distance_m, heading)
            if distance_m and planner.oracle.first_hit(segment(out[0], out[1])) is not None:
                continue
            iterations = 150 if distance_m < WITHDRAW_M[-1] else 600
            path = planner.arm_path(out[1], np.array(ARM_HOME), iterations=iterations)
            if path is not None:
                return np.concatenate([out[:1], path]) if distance_m else path
            if not distance_m:
                break
    return None


def _by_base(q: Array, T_world_eef: Array, distance_m: float, turn_rad: float) -> Array:
    ends = base_move(q, distance_m, heading_of(-T_world_eef[:3, 2]) + turn_rad)
    return np.concatenate([ends[:1], segment(ends[0], ends[1])])


def _by_arm(planner: Planner, q: Array, T_world_eef: Array, distance_m: float) -> Array | None:
    T = T_world_eef.copy()
    T[:3, 3] -= distance_m * T[:3, 2]
    return planner.line(q, T).path
