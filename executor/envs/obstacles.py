"""What is solid around a robot, and which way leads off what is nearest to some points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from executor.assets.model import Shape
from executor.geometry import Array, transform_from_quaternion
from executor.world.world import World

_FLOOR = Shape("box", (50.0, 50.0, 0.5), (0.0, 0.0, -0.5))
_TINY_M = 1e-9
_LOOK_EVERY, _ROAM_M = 5, 0.5
"""What was so far off is looked for only so often: asking the engine where things are takes most of the time."""


@dataclass(frozen=True, slots=True)
class Gaps:
    """What is nearest to each of N points.

    Attributes:
        distance_m: (N,) how far off it is; negative inside, infinite where nothing is as near as was asked for.
        away: (N, 3) unit vectors that lead off it.
    """

    distance_m: Array
    away: Array


class Obstacles:
    """The solids of a world, the robot left out: boxes and cylinders as they are, all else as the box around it.

    Args:
        world: Where they are; what it has come to counts whenever something is asked.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        solids = [
            (name, link.name, shape)
            for name, asset in world.assets.items()
            for link in asset.links
            for shape in link.shapes
            if shape.collides
        ]
        shapes = [_FLOOR, *(shape for *_, shape in solids)]
        self._is_round = np.array([shape.kind == "cylinder" for shape in shapes])
        self._half_m = np.stack([_half_m(shape) for shape in shapes])
        self._T_body_solid = np.stack([_frame(shape) for shape in shapes])
        self._T_world_solid = self._T_body_solid.copy()
        bodies = dict.fromkeys((name, link) for name, link, _ in solids)
        rows = {body: [k for k, (*own, _) in enumerate(solids, 1) if tuple(own) == body] for body in bodies}
        moving = {*world.dynamic_ids, *world.articulated_ids}
        self._moving = {body: own for body, own in rows.items() if body[0] in moving}
        self._asked = 0
        self._place(rows)

    def nearest(self, points: Array, within_m: float) -> Gaps:
        """Returns what is nearest to each of some points now.

        Args:
            points: (N, 3) in the world, close together.
            within_m: What is farther than this from a point need not be seen.
        """
        middle = points.mean(axis=0)
        within_m += float(np.linalg.norm(points - middle, axis=1).max())
        gap_m = self._gap_m(middle)
        every = self._asked % _LOOK_EVERY == 0
        self._asked += 1
        self._place({body: own for body, own in self._moving.items() if every or gap_m[own].min() < within_m + _ROAM_M})
        near = np.flatnonzero(self._gap_m(middle) < within_m)
        found = Gaps(np.full(len(points), np.inf), np.zeros_like(points))
        if len(near):
            self._look(points, near, found)
        return found

    def _gap_m(self, point: Array) -> Array:
        """Returns (S,) how far off each solid, or the box around it, is from a point; 0 inside."""
        local = ((point - self._T_world_solid[:, :3, 3])[:, None] @ self._T_world_solid[:, :3, :3])[:, 0]
        return np.asarray(np.linalg.norm(np.maximum(np.abs(local) - self._half_m, 0.0), axis=1))

    def _look(self, points: Array, near: NDArray[np.intp], found: Gaps) -> None:
        """Fills in what is nearest to points of S solids, given by their numbers."""
        R, origin = self._T_world_solid[near, :3, :3], self._T_world_solid[near, :3, 3]
        is_round = self._is_round[near]
        local = (points - origin[:, None]) @ R  # (S, N, 3)
        beyond = np.abs(local) - self._half_m[near][:, None]
        # Of what is round, x stands for the radius, and y has no say.
        radius_m = np.maximum(np.hypot(local[is_round, :, 0], local[is_round, :, 1]), _TINY_M)
        beyond[is_round, :, 0] = radius_m - self._half_m[near][is_round, :1]
        beyond[is_round, :, 1] = -np.inf
        direction = np.where(local < 0.0, -1.0, 1.0)
        direction[is_round, :, :2] = local[is_round, :, :2] / radius_m[..., None]
        inside = beyond.max(axis=2)
        distance = np.where(inside > 0.0, np.linalg.norm(np.maximum(beyond, 0.0), axis=2), inside)
        place, rows = distance.argmin(axis=0), np.arange(len(points))
        found.distance_m[:] = distance[place, rows]
        gap = beyond[place, rows]
        # Off a face, an edge or a corner; from inside by the nearest face.
        face = gap == gap.max(axis=1, keepdims=True)
        step = np.where(found.distance_m[:, None] > 0.0, np.maximum(gap, 0.0), face.astype(float))
        step[is_round[place], 1] = step[is_round[place], 0]
        away = np.einsum("nij,nj->ni", R[place], step * direction[place, rows])
        found.away[:] = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), _TINY_M)

    def _place(self, rows: dict[tuple[str, str], list[int]]) -> None:
        for body, own in rows.items():
            self._T_world_solid[own] = self._world.T_world_link(*body) @ self._T_body_solid[own]


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
