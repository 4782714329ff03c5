"""Paths in configuration space: segments, base moves, turns and arcs about a hinge, and the tree search between two
ends.

The search grows rapidly-exploring random trees from both ends (RRT-Connect) and shortens what they find.

Source: Kuffner and LaValle, RRT-Connect: an efficient approach to single-query path planning, ICRA 2000.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np

from executor.geometry import Array, rotation_z
from oag.model.robots import Robot

BASE_STEP_M = 0.02  # A drive keeps 3 cm at such steps, less at shorter ones.
BASE_STEP_RAD = np.deg2rad(2.0)  # An arm of 0.6 m sweeps 2 cm with it.
ARM_STEP_RAD = 0.05
FINE_ARM_STEP_RAD = 0.012
"""With the arm stretched out the hand moves 7 mm in a step of this size, 3 cm in one of the size above."""


def segment(
    robot: Robot, start: Array, end: Array, arm_step_rad: float = ARM_STEP_RAD, *, base_share: float = 1.0
) -> Array:
    """Return (N, Q) configurations from start (left out) to end, no farther apart than the step of each joint.

    Args:
        robot: Its record.
        start, end: (Q,) configurations.
        arm_step_rad: Step of the arm's joints.
        base_share: Fraction of the base's usual steps to use.
    """
    lift_step = [base_share * BASE_STEP_M] * (len(robot.base_joints) - 3)
    base_step = [base_share * BASE_STEP_M] * 2 + [base_share * BASE_STEP_RAD] + lift_step
    step = np.array(base_step + [arm_step_rad] * len(robot.arm_joints))
    count = max(int(np.ceil(np.max(np.abs(end - start) / step))), 1)
    return start + (end - start) * (np.arange(1, count + 1) / count)[:, None]


def polyline(robot: Robot, waypoints: Array, arm_step_rad: float = ARM_STEP_RAD, *, base_share: float = 1.0) -> Array:
    """Return (N, Q) configurations along waypoints (M, Q), the first one left out; steps as for `segment`."""
    return np.concatenate([segment(robot, a, b, arm_step_rad, base_share=base_share) for a, b in pairwise(waypoints)])


@cache
def spread_out(count: int) -> tuple[int, ...]:
    """Return the indices below a count: the last one, then the middle, then the quarters, and so on."""
    order, waiting = [count - 1] if count else [], [(0, count - 1)]
    for low, high in waiting:
        if low < high:
            middle = (low + high) // 2
            order.append(middle)
            waiting += [(low, middle), (middle + 1, high)]
    return tuple(order)


def base_move(q: Array, distance_m: float, heading_rad: float) -> Array:
    """Return (2, Q): the configuration and the one after sliding the base along a world heading."""
    end = q.copy()
    end[:2] += distance_m * np.array([np.cos(heading_rad), np.sin(heading_rad)])
    return np.stack([q, end])


def base_turn(q: Array, angle_rad: float) -> Array:
    """Return (2, Q): the configuration and the one after turning the base on the spot."""
    end = q.copy()
    end[2] += angle_rad
    return np.stack([q, end])


def arc_about(q: Array, pivot_m: Array, angle_rad: float, count: int) -> Array:
    """Return (count + 1, Q) configurations that carry the whole robot rigidly about a vertical axis.

    Args:
        q: (Q,) start.
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


EdgeCheck = Callable[[Array, Array], bool]
Sampler = Callable[[], Array]


class _Tree:
    def __init__(self, root: Array) -> None:
        self.points = [root]
        self.parents = [-1]

    def nearest(self, point: Array, weights: Array) -> int:
        return int(np.argmin(np.max(np.abs(np.stack(self.points) - point) * weights, axis=1)))

    def add(self, point: Array, parent: int) -> int:
        self.points.append(point)
        self.parents.append(parent)
        return len(self.points) - 1

    def branch(self, index: int) -> list[Array]:
        """Return the points from the root to a node."""
        way: list[Array] = []
        while index >= 0:
            way.append(self.points[index])
            index = self.parents[index]
        return way[::-1]


def connect(
    start: Array,
    goal: Array,
    *,
    edge_is_free: EdgeCheck,
    sample: Sampler,
    weights: Array,
    step: float,
    iterations: int,
    patience: int | None = None,
) -> list[Array] | None:
    """Return waypoints from start to goal whose segments are all free, or None when none was found.

    Args:
        start: (D,) free configuration.
        goal: (D,) free configuration.
        edge_is_free: Decides whether a straight segment is free.
        sample: Draws a configuration (D,).
        weights: (D,) weights of the maximum norm in which lengths are measured.
        step: Longest extension of a tree, in that norm.
        iterations: How many samples to draw before giving up.
        patience: After how many of them a start or goal that nothing leads away from is given up.
    """
    if edge_is_free(start, goal):
        return [start, goal]
    trees = (_Tree(start), _Tree(goal))
    forward = True
    for count in range(iterations):
        if count == patience and min(len(tree.points) for tree in trees) == 1:
            return None
        growing, other = trees if forward else trees[::-1]
        node = _extend(growing, sample(), edge_is_free, weights, step)
        if node is not None:
            target = growing.points[node]
            while True:
                reached = _extend(other, target, edge_is_free, weights, step)
                if reached is None:
                    break
                if np.array_equal(other.points[reached], target):
                    near, far = growing.branch(node), other.branch(reached)
                    way = near + far[-2::-1]
                    return way if forward else way[::-1]
        forward = not forward
    return None


def _extend(tree: _Tree, target: Array, edge_is_free: EdgeCheck, weights: Array, step: float) -> int | None:
    nearest = tree.nearest(target, weights)
    origin = tree.points[nearest]
    length = float(np.max(np.abs(target - origin) * weights))
    if length < 1e-9:
        return None
    point = target if length <= step else origin + (target - origin) * (step / length)
    return tree.add(point, nearest) if edge_is_free(origin, point) else None


def shorten(way: list[Array], *, edge_is_free: EdgeCheck, rng: np.random.Generator, attempts: int) -> list[Array]:
    """Return the waypoints with corners cut wherever a straight segment between two of their points is free."""
    way = list(way)
    for _ in range(attempts):
        if len(way) < 3:
            break
        i, j = sorted(rng.choice(len(way), size=2, replace=False))
        if j - i > 1 and edge_is_free(way[i], way[j]):
            way = way[: i + 1] + way[j:]
            continue
        a = int(rng.integers(0, len(way) - 2))
        first, last = rng.uniform(size=2)
        p = way[a] + first * (way[a + 1] - way[a])
        q = way[a + 1] + last * (way[a + 2] - way[a + 1])
        if edge_is_free(p, q) and edge_is_free(way[a], p) and edge_is_free(q, way[a + 2]):
            way = [*way[: a + 1], p, q, *way[a + 2 :]]
            # Cutting a corner adds a point; dropping collinear ones happens by the first rule.
    return way
