"""Elementary paths in configuration space: straight segments, base moves, turns and arcs about a hinge."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np

from executor.geometry import Array, rotation_z

BASE_STEP_M = 0.02  # A drive keeps 3 cm at such steps, less at shorter ones.
BASE_STEP_RAD = np.deg2rad(2.0)  # An arm of 0.6 m sweeps 2 cm with it.
ARM_STEP_RAD = 0.05
FINE_ARM_STEP_RAD = 0.012
"""With the arm stretched out the hand moves 7 mm in a step of this size, 3 cm in one of the size above."""


def segment(start: Array, end: Array, arm_step_rad: float = ARM_STEP_RAD, *, base_share: float = 1.0) -> Array:
    """Returns (N, 10) configurations from start (left out) to end, no farther apart than the step of each joint.

    Args:
        start, end: (10,) configurations.
        arm_step_rad: Step of the arm's joints.
        base_share: Fraction of the base's usual steps to use.
    """
    base_step = [base_share * BASE_STEP_M] * 2 + [base_share * BASE_STEP_RAD]
    step = np.array(base_step + [arm_step_rad] * 7)
    count = max(int(np.ceil(np.max(np.abs(end - start) / step))), 1)
    return start + (end - start) * (np.arange(1, count + 1) / count)[:, None]


def polyline(waypoints: Array, arm_step_rad: float = ARM_STEP_RAD, *, base_share: float = 1.0) -> Array:
    """Returns (N, 10) configurations along waypoints (M, 10), the first one left out; steps as for `segment`."""
    return np.concatenate([segment(a, b, arm_step_rad, base_share=base_share) for a, b in pairwise(waypoints)])


@cache
def spread_out(count: int) -> tuple[int, ...]:
    """Returns the indices below a count: the last one, then the middle, then the quarters, and so on."""
    order, waiting = [count - 1] if count else [], [(0, count - 1)]
    for low, high in waiting:
        if low < high:
            middle = (low + high) // 2
            order.append(middle)
            waiting += [(low, middle), (middle + 1, high)]
    return tuple(order)


def base_move(q: Array, distance_m: float, heading_rad: float) -> Array:
    """Returns (2, 10): the configuration and the one after sliding the base along a world heading."""
    end = q.copy()
    end[:2] += distance_m * np.array([np.cos(heading_rad), np.sin(heading_rad)])
    return np.stack([q, end])


def base_turn(q: Array, angle_rad: float) -> Array:
    """Returns (2, 10): the configuration and the one after turning the base on the spot."""
    end = q.copy()
    end[2] += angle_rad
    return np.stack([q, end])


def arc_about(q: Array, pivot_m: Array, angle_rad: float, count: int) -> Array:
    """Returns (count + 1, 10) configurations that carry the whole robot rigidly about a vertical axis.

    Args:
        q: (10,) start.
        pivot_m: (2,) or (3,) point on the axis.
        angle_rad: How far, counter-clockwise.
        count: Number of waypoints after the start.
    """
    pivot = np.asarray(pivot_m)[:2]
    path = np.tile(q, (count + 1, 1))
    for k in range(1, count + 1):
        turned = angle_rad * k / count
        path[k, :2] = pivot + rotation_z(turned)[:2, :2] @ (q[:2] - pivot)
        path[k, 2] = q[2] + turned
    return path
