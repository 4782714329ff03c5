"""Read a world's state as fixed-size vectors, or as a point cloud.

Vectors cover the robot, things, their joints and grasp points. Their lengths do not depend on the scene: rows for
things and handles are fixed in number. Objects that the task names come first, in its order. Unused rows are 0, and the
first number of a row says whether it is used.

Clouds sample the surfaces of the models in their present poses; nothing is rendered, and nothing is occluded. Points
are chosen once per episode, on the models, and move with their bodies. A point is the same point of the same thing in
every observation, and a cloud costs little more than a matrix product.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import bddl
from executor.assets.asset_geometry import shape_mesh
from executor.assets.model import Asset
from executor.geometry import Array, inverse, quaternions_last
from executor.sim.engine import ROBOT, pose_matrix
from executor.sim.world import World
from executor.system.extras import require
from oag import Task
from oag.model.robots import Robot

Vector = NDArray[np.float32]

AGENT_MORE = 7 + 1
"""Numbers of a robot's own state after its joints: hand pose in the world (x y z, quaternion x y z w), opening (m)."""


def agent_numbers(robot: Robot) -> int:
    """Return the length of a robot's own state."""
    return len(robot.joint_names) + AGENT_MORE


THINGS, THING = 12, 14
"""Rows of things: used (1 or 0), position x y z, quaternion x y z w, extent along its axes (3), grasp point x y z."""

HANDLES, HANDLE = 8, 6
"""Rows of handles: used, joint position (rad or m), share of its range (0 shut, 1 open), middle of the bar x y z."""

ENVIRONMENT = THINGS * THING + HANDLES * HANDLE
LARGEST = 1000.0
"""Bound of all numbers: metres and radians, in rooms of at most ten metres."""


def named_objects(task: Task, names: Container[str]) -> tuple[str, ...]:
    """Return those objects out of `names` that a task names, in its order."""
    mentioned = [
        name
        for subtask in task.subtasks
        for name in (subtask.target, subtask.support_init, subtask.support_goal)
        if name is not None
    ]
    mentioned += [name for atom in sorted(bddl.atoms(task.goal), key=bddl.format) for name in atom.args]
    return tuple(dict.fromkeys(name for name in mentioned if name in names))


class StateReader:
    """Read one world into vectors.

    Args:
        world: The world.
        task: Its objects come first.

    Attributes:
        things: Ids of the things, row by row.
        handles: "id/joint" of each row of handles.
    """

    def __init__(self, world: World, task: Task) -> None:
        self._world = world
        names = tuple(dict.fromkeys([*named_objects(task, world.assets), *world.assets]))
        self.things = names[:THINGS]
        self._handles = [(name, handle) for name in names for handle in world.assets[name].handles][:HANDLES]
        self.handles = tuple(f"{name}/{handle.joint}" for name, handle in self._handles)
        self._rows = np.zeros((THINGS, THING), np.float32)
        self._handle_rows = np.zeros((HANDLES, HANDLE), np.float32)
        self._positions: dict[int, float] = {}  # Last joint positions of handles; furniture is fixed.
        self._grasp_points_m = np.array([world.assets[name].grasp_point_m for name in self.things]).reshape(-1, 3)
        self._moving = [row for row, name in enumerate(self.things) if name in world.dynamic_ids]
        for row, name in enumerate(self.things):
            self._rows[row, 0], self._rows[row, 8:11] = 1.0, world.assets[name].extent_m
        # Fixed things are read once.
        self._place(range(len(self.things)))

    def agent(self) -> Vector:
        """Return (J + AGENT_MORE,) the robot's own state: joints, hand pose, opening."""
        qpos = np.asarray(self._world.robot.get_qpos())
        hand = self._world.robot.find_link_by_name(self._world.model.tip_link).entity_pose
        pose = quaternions_last(np.concatenate([hand.p, hand.q]))
        return np.concatenate([qpos, pose, [qpos[self._world.model.fingers].sum()]]).astype(np.float32)

    def environment(self) -> Vector:
        """Return (ENVIRONMENT,) things and handles."""
        self._place(self._moving)
        for row, (name, handle) in enumerate(self._handles):
            position = self._world.joint_position(name, handle.joint)
            if position == self._positions.get(row):
                continue
            self._positions[row] = position
            T_world_link = self._world.T_world_link(name, handle.link)
            bar_m = T_world_link[:3, :3] @ np.asarray(handle.position_m) + T_world_link[:3, 3]
            joint = self._world.assets[name].joint(handle.joint)
            self._handle_rows[row] = [1.0, position, joint.fraction(position), *bar_m]
        return np.concatenate([self._rows.ravel(), self._handle_rows.ravel()])

    def _place(self, rows: Sequence[int]) -> None:
        """Write the poses of the things of these rows."""
        if not len(rows):
            return
        chosen = list(rows)
        poses = self._world.root_poses(self.things[row] for row in chosen)
        turns = Rotation.from_quat(poses[:, 3:], scalar_first=True).as_matrix()
        self._rows[chosen, 1:8] = quaternions_last(poses)
        self._rows[chosen, 11:14] = np.einsum("nij,nj->ni", turns, self._grasp_points_m[chosen]) + poses[:, :3]


POINTS = 1024
HAND_POINTS = 128
"""Points on hand and fingers, those whose mask is 1."""

NAMED_POINTS = 576
"""Points on the task's objects, shared evenly; the rest of `POINTS` is on everything else, in proportion to area."""

HANDLE_SHARE = 0.25
"""Share of a task object's points near the bars of its handles, split evenly: by area alone a refrigerator's handle
would get two or three, and the hand has to find it to a centimetre."""

_NEAR_BAR_M = 0.03  # Distance from the bar's middle line: the bar and the begin of its posts.
_TRIED = 20_000  # Candidates; of those on a door of 1 m2 a bar of 20 cm has 200.


class CloudReader:
    """Read one world into a point cloud.

    Args:
        world: The world.
        named: Ids of the things that get most points.
        seed: Seed of the choice of points.
    """

    def __init__(self, world: World, named: Sequence[str], seed: int) -> None:
        self._world = world
        rng = np.random.default_rng(seed)
        bodies = {(name, link.name) for name, asset in world.assets.items() for link in asset.links}
        surfaces = {(name, link): _surface(world, name, link) for name, link in sorted(bodies)}
        surfaces = {body: mesh for body, mesh in surfaces.items() if mesh is not None}
        hands = {(ROBOT, link): _robot_surface(world, link) for link in world.model.gripper_links}
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
        """Return (POINTS, 4): x y z in the robot's base [m], and 1 on the hand, 0 elsewhere."""
        T_base_world = inverse(self._world.T_world_link(ROBOT))
        placed = []
        for owner, link, points in self._parts:
            T = T_base_world @ self._world.T_world_link(owner, link)
            placed.append(points @ T[:3, :3].T + T[:3, 3])
        return np.concatenate([np.concatenate(placed), self._mask], axis=1).astype(np.float32)


def _sampled(
    surfaces: dict[tuple[str, str], Any], count: int, rng: np.random.Generator
) -> Iterator[tuple[str, str, Array]]:
    """Yield owner, link and points (N, 3) in its frame, `count` in all, in proportion to areas."""
    sample = require("trimesh.sample", "sim").sample_surface
    shares = _shared(count, [mesh.area for mesh in surfaces.values()])
    for ((owner, link), mesh), share in zip(surfaces.items(), shares, strict=True):
        if share:
            points, _ = sample(mesh, share, seed=int(rng.integers(2**31)))
            yield owner, link, np.asarray(points, dtype=float)


def _at_handles(
    surfaces: dict[tuple[str, str], Any], asset: Asset, name: str, count: int, rng: np.random.Generator
) -> Iterator[tuple[str, str, Array]]:
    """Yield owner, link and points (N, 3) in its frame near the bars of handles, at most `count` in all."""
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
    """Split a number into whole parts in proportion to weights."""
    ends = np.round(count * np.cumsum(weights) / max(sum(weights), 1e-12)).astype(int) if weights else np.array([], int)
    return [int(n) for n in np.diff(ends, prepend=0)]


def _surface(world: World, name: str, link: str) -> Any | None:
    """Return the visible surface of an object's link, in its frame; None without one."""
    shapes = next(part.shapes for part in world.assets[name].links if part.name == link)
    meshes = [shape_mesh(shape) for shape in shapes if shape.visible]
    return require("trimesh.util", "sim").concatenate(meshes) if meshes else None


def _robot_surface(world: World, link: str) -> Any:
    """Return the collision surface of a link of the robot, in the link's frame."""
    trimesh = require("trimesh", "sim")
    meshes = []
    for shape in world.robot.find_link_by_name(link).collision_shapes:
        if hasattr(shape, "half_size"):  # The fingers are boxes, the hand is a hull.
            mesh = trimesh.creation.box(2.0 * np.asarray(shape.half_size))
        else:
            mesh = trimesh.Trimesh(np.asarray(shape.vertices) * np.asarray(shape.scale), shape.triangles)
        meshes.append(mesh.apply_transform(pose_matrix(shape.local_pose)))
    return trimesh.util.concatenate(meshes)
