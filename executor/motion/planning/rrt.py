"""Rapidly-exploring random trees from both ends (RRT-Connect), and shortening of what they find.

Source: Kuffner and LaValle, RRT-Connect: an efficient approach to single-query path planning, ICRA 2000.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from executor.geometry import Array

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
        """Returns the points from the root to a node."""
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
) -> list[Array] | None:
    """Returns waypoints from start to goal whose segments are all free, or None when none was found.

    Args:
        start: (D,) free configuration.
        goal: (D,) free configuration.
        edge_is_free: Decides whether a straight segment is free.
        sample: Draws a configuration (D,).
        weights: (D,) weights of the maximum norm in which lengths are measured.
        step: Longest extension of a tree, in that norm.
        iterations: How many samples to draw before giving up.
    """
    if edge_is_free(start, goal):
        return [start, goal]
    trees = (_Tree(start), _Tree(goal))
    forward = True
    for _ in range(iterations):
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
    """Returns the way with corners cut wherever a straight segment between two of its points is free."""
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
