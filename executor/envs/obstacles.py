"""What is solid around a robot, and how far it is from some points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from executor.assets.model import Shape
from executor.geometry import Array, transform_from_quaternion
from executor.world.world import World

_FLOOR = Shape("box", (50.0, 50.0, 0.5), (0.0, 0.0, -0.5))
_LOOK_EVERY, _ROAM_M = 5, 0.5
"""What was so far off is looked for only so often: asking the engine where things are takes most of the time."""


class Obstacles:
    """The solids of a world, the robot left out: boxes and cylinders as they are, all else as the box around it.

    Args:
        world: Where they are; what it has come to counts whenever something is asked.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        bodies = [
            (name, link.name, shapes)
            for name, asset in world.assets.items()
            for link in asset.links
            if (shapes := [shape for shape in link.shapes if shape.collides])
        ]
        # What moves comes last, body after body.
        moving = {*world.dynamic_ids, *world.articulated_ids}
        bodies.sort(key=lambda body: body[0] in moving)
        ends = 1 + np.cumsum([len(own) for *_, own in bodies])
        placed = [(name, link, slice(end - len(own), end)) for (name, link, own), end in zip(bodies, ends, strict=True)]
        shapes = [_FLOOR, *(shape for *_, own in bodies for shape in own)]
        self._is_round = np.array([shape.kind == "cylinder" for shape in shapes])
        self._half_m = np.stack([_half_m(shape) for shape in shapes])
        self._T_body_solid = np.stack([_frame(shape) for shape in shapes])
        self._T_world_solid = self._T_body_solid.copy()
        self._movers = [body for body in placed if body[0] in moving]
        self._starts = [rows.start for *_, rows in self._movers]
        self._asked = 0
        for body in placed:
            self._place(*body)

    def distances_m(self, points: Array, within_m: float) -> Array:
        """Returns (N,) how far off the nearest is now; negative inside, infinite where nothing is as near as is asked.

        Args:
            points: (N, 3) in the world, close together.
            within_m: What is farther than this from a point need not be seen.
        """
        middle = points.mean(axis=0)
        within_m += float(np.sqrt(((points - middle) ** 2).sum(axis=1).max()))
        gap_m = self._gap_m(middle)
        if self._movers:
            every = self._asked % _LOOK_EVERY == 0
            seen = every | (np.minimum.reduceat(gap_m, self._starts) < within_m + _ROAM_M)
            for k in np.flatnonzero(seen):
                self._place(*self._movers[k])
            gap_m = self._gap_m(middle)
        self._asked += 1
        near = np.flatnonzero(gap_m < within_m)
        return self._to(points, near) if len(near) else np.full(len(points), np.inf)

    def _gap_m(self, point: Array) -> Array:
        """Returns (S,) how far off each solid, or the box around it, is from a point; 0 inside."""
        local = ((point - self._T_world_solid[:, :3, 3])[:, None] @ self._T_world_solid[:, :3, :3])[:, 0]
        beyond = np.maximum(np.abs(local) - self._half_m, 0.0)
        return np.asarray(np.sqrt((beyond**2).sum(axis=1)))

    def _to(self, points: Array, near: NDArray[np.intp]) -> Array:
        """Returns (N,) how far points are from the nearest of some solids, given by their numbers."""
        local = (points - self._T_world_solid[near, None, :3, 3]) @ self._T_world_solid[near, :3, :3]  # (S, N, 3)
        beyond = np.abs(local) - self._half_m[near, None]
        is_round = self._is_round[near]
        if is_round.any():
            # Of what is round, x stands for the radius, and y has no say.
            beyond[is_round, :, 0] = (
                np.hypot(local[is_round, :, 0], local[is_round, :, 1]) - self._half_m[near][is_round, :1]
            )
            beyond[is_round, :, 1] = -np.inf
        inside = beyond.max(axis=2)
        outside = np.sqrt((np.maximum(beyond, 0.0) ** 2).sum(axis=2))
        return np.asarray(np.where(inside > 0.0, outside, inside).min(axis=0))

    def _place(self, name: str, link: str, rows: slice) -> None:
        self._T_world_solid[rows] = self._world.T_world_link(name, link) @ self._T_body_solid[rows]


def _frame(shape: Shape) -> Array:
    """Returns the (4, 4) frame of a solid, in its middle, seen from its body."""
    T = transform_from_quaternion(shape.position_m, shape.orientation)
    if shape.kind == "convex":
        corners = np.asarray(shape.vertices_m, dtype=float)
        T[:3, 3] += T[:3, :3] @ (corners.min(axis=0) + corners.max(axis=0)) / 2
    return T


def _half_m(shape: Shape) -> Array:
    """Returns (3,) half the sides of a solid; of a cylinder radius, radius and half its length."""
    if shape.kind == "convex":
        return np.asarray(np.ptp(np.asarray(shape.vertices_m, dtype=float), axis=0) / 2)
    if shape.kind == "cylinder":
        return np.array([shape.size_m[0], shape.size_m[0], shape.size_m[1]])
    return np.array(shape.size_m if shape.kind == "box" else [shape.size_m[0]] * 3)
