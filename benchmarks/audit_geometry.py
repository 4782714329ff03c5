"""A second geometry: whether a goal holds, read off the engine's own collision shapes and nothing of the detectors.

On something: under the middle of mass there is a face of it, and the lowest point is on that. In a fixture: every
vertex within the box around its carcass. In a dish: the middle of mass over it, the lowest point below its rim. In the
gripper: what is between the fingertips belongs to it. What was put somewhere stands upright or as it stood, unless it
is a ball. What was picked up is higher than it was, or no longer under what it was under.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

import bddl
from bddl import Atom, Formula
from executor.sim.world import World
from executor.system.extras import load_sapien
from oag import Scene

sapien: Any = load_sapien()
Points = NDArray[np.float64]
ON_M = 0.006
IN_M = 0.006
HELD_M = 0.012
LIFTED_M = 0.10
OPEN_FRACTION = 0.05
TILT_DEG = 12.0
LEAN_DEG = 45.0
_BALL = 0.85  # Shortest side of the box by its longest: an apple, an orange.
_ROUND = 24


class Snapshot:
    """Where everything is in one state of a scene, from the shapes that the engine has.

    Args:
        scene: The concrete scene.
        state: A packed state of its physics.
    """

    def __init__(self, scene: Scene, state: bytes) -> None:
        self.hulls: dict[str, list[Points]] = {}
        self.root_hulls: dict[str, list[Points]] = {}
        self.middles: dict[str, Points] = {}
        self.poses: dict[str, Points] = {}
        self.open_fraction: dict[str, float] = {}
        with World(scene) as world:
            world.unpack(state)
            world.step()  # Links follow their joints.
            system = world.sapien_scene.physx_system
            for body in [*system.rigid_dynamic_components, *system.rigid_static_components]:
                self._add(body.entity.name, body, root=True)
            for link in system.articulation_link_components:
                articulation = link.articulation
                owner = link.entity.name if articulation.name == "robot" else articulation.name
                self._add(owner, link, root=link.is_root)
                if articulation.name != "robot" and articulation.dof:
                    low, high = np.asarray(articulation.qlimits).T
                    fractions = (np.asarray(articulation.qpos) - low) / (high - low)
                    self.open_fraction[articulation.name] = float(fractions.max())

    def _add(self, owner: str, body: Any, *, root: bool) -> None:
        T = body.entity.pose.to_transformation_matrix()
        points = [_placed(T, shape) for shape in body.collision_shapes if not _is_plane(shape)]
        self.hulls.setdefault(owner, []).extend(points)
        if root:
            self.root_hulls[owner] = points
            self.poses[owner] = T
        if isinstance(body, sapien.physx.PhysxRigidDynamicComponent):
            self.middles[owner] = (body.entity.pose * body.cmass_local_pose).p

    def lowest_m(self, owner: str) -> float:
        """Return the height of a thing's lowest point."""
        return float(min(points[:, 2].min() for points in self.hulls[owner]))

    def is_on(self, item: str, support: str) -> bool:
        """Decide whether an item rests on a face of a support that is under its middle."""
        middle = self.middles[item]
        tops = [_top_under(hull, middle) for hull in self.hulls[support]]
        heights = [top for top in tops if top is not None and top < middle[2]]
        return bool(heights) and abs(self.lowest_m(item) - max(heights)) <= ON_M

    def is_in(self, item: str, container: str) -> bool:
        """Decide whether an item is inside a fixture's carcass, or in a dish."""
        points = np.concatenate(self.hulls[item])
        around = np.concatenate(self.root_hulls[container])
        if container in self.middles:
            low, high = around.min(axis=0), around.max(axis=0)
            middle = self.middles[item]
            return bool((middle > low)[:2].all() and (middle < high)[:2].all() and points[:, 2].min() < high[2] - IN_M)
        T = np.linalg.inv(self.poses[container])
        local, box = (each @ T[:3, :3].T + T[:3, 3] for each in (points, around))
        return bool((local >= box.min(axis=0) - IN_M).all() and (local <= box.max(axis=0) + IN_M).all())

    def is_held(self, item: str) -> bool:
        """Decide whether what is between the fingertips belongs to an item."""
        tips = [max(np.concatenate(self.hulls[f]), key=self._reach) for f in ("panda_leftfinger", "panda_rightfinger")]
        middle = np.mean(tips, axis=0)
        hull = ConvexHull(np.concatenate(self.hulls[item]))
        return bool((hull.equations[:, :3] @ middle + hull.equations[:, 3]).max() <= HELD_M)

    @cached_property
    def _hand(self) -> Points:
        return np.concatenate(self.hulls["panda_hand"]).mean(axis=0)

    def _reach(self, point: Points) -> float:
        return float(np.linalg.norm(point - self._hand))

    def tilt_deg(self, item: str, before: Snapshot) -> float:
        """Return how far an item leans from how it stood in another state, or from upright where that is less."""
        up = self.poses[item][:3, 2]
        cosine = max(float(up @ before.poses[item][:3, 2]), float(up[2]))
        return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))

    def is_roofed(self, item: str) -> bool:
        """Decide whether something other than the robot is over an item's middle."""
        middle, others = self.middles[item], {item, *(name for name in self.hulls if name.startswith("panda"))}
        tops = [_top_under(hull, middle) for name, hulls in self.hulls.items() if name not in others for hull in hulls]
        return any(top is not None and top > middle[2] for top in tops)

    def is_ball(self, item: str) -> bool:
        """Decide whether an item has no side to stand on."""
        T = np.linalg.inv(self.poses[item])
        local = np.concatenate(self.hulls[item]) @ T[:3, :3].T
        extents = np.ptp(local, axis=0)
        return bool(extents.min() / extents.max() > _BALL)


def holds(goal: Formula, scene: Scene, before: Snapshot, after: Snapshot) -> bool:
    """Decide whether a goal holds in a state, what it puts somewhere standing upright, or as it stood before.

    Raises:
        ValueError: The goal has a predicate that this geometry does not know.
    """

    def read(atom: Atom) -> bool:
        name, arguments = atom.predicate, atom.args
        if name == "open":
            return after.open_fraction[arguments[0]] > OPEN_FRACTION
        item, other = arguments
        if name == "inside" and other == "gripper":
            is_up = after.lowest_m(item) - before.lowest_m(item) >= LIFTED_M - IN_M
            return after.is_held(item) and (is_up or (before.is_roofed(item) and not after.is_roofed(item)))
        if name not in ("inside", "ontop"):
            raise ValueError(f"no second geometry for {name}")
        at_place = after.is_in(item, other) if name == "inside" else after.is_on(item, other)
        most_deg = LEAN_DEG if other in after.middles else TILT_DEG
        return at_place and (after.is_ball(item) or after.tilt_deg(item, before) <= most_deg)

    return bddl.evaluate(goal, read, {name: thing.category for name, thing in scene.objects.items()}) is True


def _is_plane(shape: Any) -> bool:
    return isinstance(shape, sapien.physx.PhysxCollisionShapePlane)


def _placed(T_world_body: Points, shape: Any) -> Points:
    """Return (P, 3) world points whose hull is a shape."""
    physx = sapien.physx
    if isinstance(shape, physx.PhysxCollisionShapeBox):
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
        points = signs * shape.half_size
    elif isinstance(shape, physx.PhysxCollisionShapeConvexMesh):
        points = np.asarray(shape.vertices, dtype=float) * shape.scale
    elif isinstance(shape, physx.PhysxCollisionShapeCylinder):
        turns = np.linspace(0.0, 2 * np.pi, _ROUND, endpoint=False)
        ring = shape.radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
        points = np.concatenate([np.insert(ring, 0, end * shape.half_length, axis=1) for end in (-1, 1)])
    elif isinstance(shape, physx.PhysxCollisionShapeSphere):
        turns = np.linspace(0.0, np.pi, _ROUND)
        points = np.array(
            [
                (np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a))
                for a in turns
                for b in np.linspace(0.0, 2 * np.pi, _ROUND, endpoint=False)
            ]
        )
        points = points * shape.radius
    else:
        raise ValueError(f"no second geometry for a {type(shape).__name__}")
    T = T_world_body @ shape.local_pose.to_transformation_matrix()
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def _top_under(points: Points, above: Points) -> float | None:
    """Return the height at which a vertical line through a point leaves a convex shape, or None where it passes it."""
    equations = ConvexHull(points).equations
    slope, offset = equations[:, 2], equations[:, :2] @ above[:2] + equations[:, 3]
    level = np.abs(slope) < 1e-9
    if (offset[level] > 1e-6).any():
        return None
    bounds = -offset[~level] / slope[~level]
    high = bounds[slope[~level] > 0].min(initial=np.inf)
    low = bounds[slope[~level] < 0].max(initial=-np.inf)
    return float(high) if low <= high else None
