"""Point clouds of the models' surfaces in the world's present state: nothing is drawn, and nothing hides anything.

The points are chosen once an episode, on the models, and then move with the bodies that they are on. So a point is the
same point of the same thing from one observation to the next, and a cloud costs little more than a product of matrices.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.assets.model import Asset
from executor.assets.surface import surface_of
from executor.geometry import Array, inverse
from executor.machine.extras import require
from executor.robot.description import FINGER_LINKS, HAND_LINK
from executor.world.engine import ROBOT, pose_matrix
from executor.world.world import World

POINTS = 1024
HAND_POINTS = 128
"""Points on hand and fingers, those whose mask is 1."""

NAMED_POINTS = 576
"""Points on what the task names, shared evenly; what is left of `POINTS` lies on everything else, by its area."""

HANDLE_SHARE = 0.25
"""Of a named thing's points, those near the bars of its handles, shared evenly: by area alone a refrigerator's handle
would get two or three, and the hand has to find it to a centimetre."""

_NEAR_BAR_M = 0.03  # From the bar's middle line: the bar itself, and where its posts begin.
_TRIED = 20_000  # Points on a door of 1 m2, of which a bar of 20 cm then has 200.

_HAND = (HAND_LINK, *FINGER_LINKS)


class CloudReader:
    """Reads one world into a cloud.

    Args:
        world: Where things are.
        named: Ids of the things that get most points.
        seed: Of the choice of points.
    """

    def __init__(self, world: World, named: Sequence[str], seed: int) -> None:
        self._world = world
        rng = np.random.default_rng(seed)
        bodies = {(name, link.name) for name, asset in world.assets.items() for link in asset.links}
        surfaces = {(name, link): _surface(world, name, link) for name, link in sorted(bodies)}
        surfaces = {body: mesh for body, mesh in surfaces.items() if mesh is not None}
        hands = {(ROBOT, link): _robot_surface(world, link) for link in _HAND}
        first = [name for name in named if name in world.assets]
        shares = _shared(NAMED_POINTS, [1.0] * len(first))
        self._parts: list[tuple[str, str, Array]] = list(_sampled(hands, HAND_POINTS, rng))
        for name, share in zip(first, shares, strict=True):
            own = {body: mesh for body, mesh in surfaces.items() if body[0] == name}
            at_handles = list(_at_handles(own, world.assets[name], name, round(HANDLE_SHARE * share), rng))
            left = share - sum(len(points) for *_, points in at_handles)
            self._parts += [*at_handles, *_sampled(own, left, rng)]
        others = {body: mesh for body, mesh in surfaces.items() if body[0] not in first}
        so_far = sum(len(points) for *_, points in self._parts)
        self._parts += _sampled(others or surfaces, POINTS - so_far, rng)
        self._mask = np.concatenate([np.full((len(points), 1), owner == ROBOT) for owner, _, points in self._parts])

    def read(self) -> NDArray[np.float32]:
        """Returns (POINTS, 4): x y z in the frame of the robot's base (m), and 1 for the hand, 0 for all else."""
        T_base_world = inverse(self._world.T_world_link(ROBOT))
        placed = []
        for owner, link, points in self._parts:
            T = T_base_world @ self._world.T_world_link(owner, link)
            placed.append(points @ T[:3, :3].T + T[:3, 3])
        return np.concatenate([np.concatenate(placed), self._mask], axis=1).astype(np.float32)


def _sampled(
    surfaces: dict[tuple[str, str], Any], count: int, rng: np.random.Generator
) -> Iterator[tuple[str, str, Array]]:
    """Yields owner, link and points (N, 3) in its frame, `count` in all, as many on each as its area is large."""
    sample = require("trimesh.sample", "sim").sample_surface
    shares = _shared(count, [mesh.area for mesh in surfaces.values()])
    for ((owner, link), mesh), share in zip(surfaces.items(), shares, strict=True):
        if share:
            points, _ = sample(mesh, share, seed=int(rng.integers(2**31)))
            yield owner, link, np.asarray(points, dtype=float)


def _at_handles(
    surfaces: dict[tuple[str, str], Any], asset: Asset, name: str, count: int, rng: np.random.Generator
) -> Iterator[tuple[str, str, Array]]:
    """Yields owner, link and points (N, 3) in its frame near the bars of its handles, at most `count` in all."""
    sample = require("trimesh.sample", "sim").sample_surface
    bars = [handle for handle in asset.handles if (name, handle.link) in surfaces]
    for handle, share in zip(bars, _shared(count, [1.0] * len(bars)), strict=True):
        points, _ = sample(surfaces[name, handle.link], _TRIED, seed=int(rng.integers(2**31)))
        points = np.asarray(points, dtype=float)
        from_middle_m = points - np.asarray(handle.position_m)
        along_m = from_middle_m @ np.asarray(handle.axis)
        along_m = np.clip(along_m, -handle.length_m / 2.0, handle.length_m / 2.0)
        near = np.linalg.norm(from_middle_m - along_m[:, None] * np.asarray(handle.axis), axis=1) <= _NEAR_BAR_M
        yield name, handle.link, points[near][:share]


def _shared(count: int, weights: Sequence[float]) -> list[int]:
    """Returns whole numbers with a sum, in proportion to weights."""
    ends = np.round(count * np.cumsum(weights) / max(sum(weights), 1e-12)).astype(int) if weights else np.array([], int)
    return [int(n) for n in np.diff(ends, prepend=0)]


def _surface(world: World, name: str, link: str) -> Any | None:
    """Returns what cameras would see of an object's link, in its frame; None where there is nothing."""
    shapes = next(part.shapes for part in world.assets[name].links if part.name == link)
    meshes = [surface_of(shape) for shape in shapes if shape.visible]
    return require("trimesh.util", "sim").concatenate(meshes) if meshes else None


def _robot_surface(world: World, link: str) -> Any:
    """Returns what collides of a link of the robot, in the link's frame."""
    trimesh = require("trimesh", "sim")
    meshes = []
    for shape in world.robot.find_link_by_name(link).collision_shapes:
        if hasattr(shape, "half_size"):  # The fingers are boxes, the hand is a hull.
            mesh = trimesh.creation.box(2.0 * np.asarray(shape.half_size))
        else:
            mesh = trimesh.Trimesh(np.asarray(shape.vertices) * np.asarray(shape.scale), shape.triangles)
        meshes.append(mesh.apply_transform(pose_matrix(shape.local_pose)))
    return trimesh.util.concatenate(meshes)
