"""A second geometry: where everything is in a recorded state, by the engine's own shapes, contacts and velocities.

Nothing of the detectors is used: no region, no handle, no box of an asset. On something: under the middle of mass there
is a face of it, and the lowest point is on that, or on its rim. In a fixture: every vertex within the box around its
carcass, or the middle over a drawer and the lowest point below its rim. In a dish: the middle of mass over it, the
lowest point below its rim. In the gripper: what is between the fingertips belongs to it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from executor.sim.world import World
from executor.system.extras import load_sapien

sapien: Any = load_sapien()
Points = NDArray[np.float64]
ON_M = 0.006
IN_M = 0.006
HELD_M = 0.012
TOUCH_M = 0.002
GROUND, ROBOT = "ground", "robot"
_BALL = 0.85  # Shortest side of the box by its longest: an apple, an orange.
_ROUND = 24


@dataclass(frozen=True, slots=True)
class Touch:
    """Contact of two owners.

    Attributes:
        separation_m: Smallest distance of its points; negative where they overlap.
        impulse_ns: Sum of the impulses of one step.
    """

    separation_m: float
    impulse_ns: float


SWITCHES = ("button", "knob")
"""Names of links that switch an appliance, and close nothing."""

SWITCHED_FRACTION = 0.5
"""An appliance is on from this share of its button's or knob's range on."""


UPRIGHT_COSINE = 0.9659
"""A thing leans by fifteen degrees at most where it stands."""


class Snapshot:
    """Where everything is in one state of a world.

    Args:
        world: A world of the scene; its state is replaced.
        state: A packed state of its physics.

    Attributes:
        hulls: Owner -> (P, 3) points of each of its shapes; a robot's link is an owner of its own.
        poses: Owner -> (4, 4) pose of its root.
        middles: Free body -> its middle of mass.
        open_fraction: Furniture -> its widest door's or drawer's share of the range.
        switched_on: Appliance -> whether its button or knob is at the middle of its range, or beyond.
        speeds: Free body -> its linear [m/s] and angular speed [rad/s].
        joint_speeds: Furniture -> its fastest joint [rad/s or m/s].
        touches: Pair of owners -> their contact; the robot is one owner here.
    """

    def __init__(self, world: World, state: bytes) -> None:
        self._robot = world.model
        self.hulls: dict[str, list[Points]] = {}
        self.root_hulls: dict[str, list[Points]] = {}
        self.drawers: dict[str, list[tuple[Points, Points]]] = {}
        self.middles: dict[str, Points] = {}
        self.poses: dict[str, Points] = {}
        self.open_fraction: dict[str, float] = {}
        self.switched_on: dict[str, bool] = {}
        self.speeds: dict[str, tuple[float, float]] = {}
        self.joint_speeds: dict[str, float] = {}
        world.unpack(state)
        system = world.sapien_scene.physx_system
        for body in system.rigid_dynamic_components:
            linear, angular = np.linalg.norm(body.linear_velocity), np.linalg.norm(body.angular_velocity)
            self.speeds[body.entity.name] = float(linear), float(angular)
        for link in system.articulation_link_components:
            if link.is_root and link.articulation.dof and link.articulation.name != ROBOT:
                self.joint_speeds[link.articulation.name] = float(np.abs(link.articulation.qvel).max())
        world.step()  # Links follow their joints, and contacts are found.
        for body in [*system.rigid_dynamic_components, *system.rigid_static_components]:
            self._add(body.entity.name, body, root=True)
        for link in system.articulation_link_components:
            articulation = link.articulation
            is_robot = articulation.name == ROBOT
            self._add(link.entity.name if is_robot else articulation.name, link, root=link.is_root)
            if not is_robot and articulation.dof:
                low, high = np.asarray(articulation.qlimits).T
                fractions = (np.asarray(articulation.qpos) - low) / (high - low)
                switches = np.array([joint.child_link.name in SWITCHES for joint in articulation.active_joints])
                self.open_fraction[articulation.name] = float(fractions[~switches].max(initial=0.0))
                if switches.any():
                    # A thing has one switch.
                    self.switched_on[articulation.name] = bool(fractions[switches][0] >= SWITCHED_FRACTION)
        self.robot_links = frozenset(link.name for link in world.robot.links)
        self.touches = _touches(system)

    def _add(self, owner: str, body: Any, *, root: bool) -> None:
        T = body.entity.pose.to_transformation_matrix()
        points = [_placed(T, shape) for shape in body.collision_shapes if not _is_plane(shape)]
        self.hulls.setdefault(owner, []).extend(points)
        if root:
            self.root_hulls[owner] = points
            self.poses[owner] = T
        elif points and "prismatic" in str(body.joint.type) and body.name not in SWITCHES:
            self.drawers.setdefault(owner, []).append((T, np.concatenate(points)))
        if isinstance(body, sapien.physx.PhysxRigidDynamicComponent):
            self.middles[owner] = (body.entity.pose * body.cmass_local_pose).p

    def corners(self, owner: str) -> tuple[Points, Points]:
        """Return the low and high corner (3,) of the box around an owner."""
        points = np.concatenate(self.hulls[owner])
        return points.min(axis=0), points.max(axis=0)

    def lowest_m(self, owner: str) -> float:
        """Return the height of a thing's lowest point."""
        return float(self.corners(owner)[0][2])

    def is_upright(self, item: str) -> bool:
        """Decide whether an item's own upward direction is the vertical, within a few degrees, and nothing holds it."""
        upwards = float(self.poses[item][2, 2] / np.linalg.norm(self.poses[item][:3, 2]))
        return bool(upwards >= UPRIGHT_COSINE) and not self.is_held(item)

    def is_on(self, item: str, support: str) -> bool:
        """Decide whether an item rests on a face of a support that is under its middle; the ground is one."""
        middle = self.middles[item]
        tops = [0.0] if support == GROUND else [_top_under(hull, middle) for hull in self.hulls[support]]
        heights = [top for top in tops if top is not None and top < middle[2]]
        stands = bool(heights) and abs(self.lowest_m(item) - max(heights)) <= ON_M
        return stands or (support in self.middles and self._is_on_rim(item, support))

    def _is_on_rim(self, item: str, dish: str) -> bool:
        """Decide whether an item lies across the rim of something hollow; a ball hangs into the mouth."""
        points, middle = np.concatenate(self.hulls[dish]), self.middles[item]
        rim = _top_under(points, middle)
        if rim is None or middle[2] <= rim:
            return False
        mouth = float(np.ptp(points[:, :2], axis=0).min()) / 2  # Without its wall it is a little narrower.
        radius = float(np.ptp(np.concatenate(self.hulls[item]), axis=0).mean()) / 2
        hangs = radius - math.sqrt(radius**2 - mouth**2) if self.is_ball(item) and mouth < radius else 0.0
        return rim - hangs - ON_M <= self.lowest_m(item) <= rim + ON_M

    def is_in(self, item: str, container: str) -> bool:
        """Decide whether an item is inside a fixture's carcass, in one of its drawers, or in a dish."""
        points = np.concatenate(self.hulls[item])
        around = np.concatenate(self.root_hulls[container])
        if container in self.middles:
            return _in_dish(self.middles[item], points, around)
        for T_world_drawer, drawer in self.drawers.get(container, ()):
            T = np.linalg.inv(T_world_drawer)
            if _in_dish(_moved(T, self.middles[item][None])[0], _moved(T, points), _moved(T, drawer)):
                return True
        T = np.linalg.inv(self.poses[container])
        local, box = _moved(T, points), _moved(T, around)
        return bool((local >= box.min(axis=0) - IN_M).all() and (local <= box.max(axis=0) + IN_M).all())

    def is_under(self, item: str, above: str) -> bool:
        """Decide whether an item's middle is below a part of something, and its top below that one's top."""
        return self.corners(item)[1][2] < self.corners(above)[1][2] and self._is_roofed_by(item, (above,))

    def is_next_to(self, first: str, second: str) -> bool:
        """Decide whether two things stand side by side, a sixth of their mean extents apart at most."""
        (low_a, high_a), (low_b, high_b) = self.corners(first), self.corners(second)
        apart = np.maximum(np.maximum(low_a - high_b, low_b - high_a), 0.0)
        overlaps = np.minimum(high_a, high_b) - np.maximum(low_a, low_b) > ON_M
        near = float(np.linalg.norm(apart[:2])) <= float(np.mean(high_a - low_a + high_b - low_b)) / 6.0
        return near and bool(overlaps[2]) and not bool(overlaps.all())

    def is_held(self, item: str) -> bool:
        """Decide whether what is between the fingertips belongs to an item."""
        tips = [max(np.concatenate(self.hulls[finger]), key=self._reach) for finger in self._robot.finger_links]
        middle = np.mean(tips, axis=0)
        hull = ConvexHull(np.concatenate(self.hulls[item]))
        return bool((hull.equations[:, :3] @ middle + hull.equations[:, 3]).max() <= HELD_M)

    def is_touched(self, first: str, second: str) -> bool:
        """Decide whether two owners touch."""
        touch = self.touches.get(frozenset((first, second)))
        return touch is not None and (touch.separation_m <= TOUCH_M or touch.impulse_ns > 0.0)

    def is_pressed(self, item: str) -> bool:
        """Decide whether the robot presses on an item."""
        touch = self.touches.get(frozenset((ROBOT, item)))
        return touch is not None and touch.impulse_ns > 0.0

    @cached_property
    def _hand(self) -> Points:
        return np.concatenate(self.hulls[self._robot.hand_link]).mean(axis=0)

    def _reach(self, point: Points) -> float:
        return float(np.linalg.norm(point - self._hand))

    def tilt_deg(self, item: str, before: Snapshot) -> float:
        """Return how far an item leans from how it stood in another state, or from upright where that is less."""
        up = self.poses[item][:3, 2]
        cosine = max(float(up @ before.poses[item][:3, 2]), float(up[2]))
        return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))

    def is_roofed(self, item: str) -> bool:
        """Decide whether something other than the robot is over an item's middle."""
        return self._is_roofed_by(item, (name for name in self.hulls if name != item and name not in self.robot_links))

    def has_left(self, item: str, before: Snapshot) -> bool:
        """Decide whether nothing that an item rested on in another state, the ground apart, is under its middle."""
        others = [name for name in before.hulls if name != item and name not in before.robot_links]
        rested = [name for name in others if before.is_on(item, name)]
        middle = self.middles[item]
        return bool(rested) and all(_top_under(hull, middle) is None for name in rested for hull in self.hulls[name])

    def _is_roofed_by(self, item: str, others: Iterable[str]) -> bool:
        middle = self.middles[item]
        tops = [_top_under(hull, middle) for name in others for hull in self.hulls[name]]
        return any(top is not None and top > middle[2] for top in tops)

    def is_ball(self, item: str) -> bool:
        """Decide whether an item has no side to stand on."""
        extents = np.ptp(_moved(np.linalg.inv(self.poses[item]), np.concatenate(self.hulls[item])), axis=0)
        return bool(extents.min() / extents.max() > _BALL)


def _in_dish(middle: Points, points: Points, dish: Points) -> bool:
    """Decide whether a thing's middle is over a dish, and its lowest point between the dish's bottom and its rim."""
    low, high = dish.min(axis=0), dish.max(axis=0)
    lowest = points[:, 2].min()
    over = (middle > low)[:2].all() and (middle < high)[:2].all()
    return bool(over and low[2] - IN_M < lowest < high[2] - IN_M)


def _touches(system: Any) -> dict[frozenset[str], Touch]:
    """Return the contacts of the last step between different owners."""
    found: dict[frozenset[str], Touch] = {}
    for contact in system.get_contacts():
        pair = frozenset(_owner(body) for body in contact.bodies)
        if len(pair) == 2 and contact.points:
            separation = float(min(point.separation for point in contact.points))
            impulse = float(sum(np.linalg.norm(point.impulse) for point in contact.points))
            known = found.get(pair)
            if known is not None:
                separation, impulse = min(separation, known.separation_m), impulse + known.impulse_ns
            found[pair] = Touch(separation, impulse)
    return found


def _owner(body: Any) -> str:
    if isinstance(body, sapien.physx.PhysxArticulationLinkComponent):
        return str(body.articulation.name)
    return GROUND if any(map(_is_plane, body.collision_shapes)) else str(body.entity.name)


def _is_plane(shape: Any) -> bool:
    return isinstance(shape, sapien.physx.PhysxCollisionShapePlane)


def _moved(T: NDArray[Any], points: Points) -> Points:
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def _placed(T_world_body: Points, shape: Any) -> Points:
    """Return (P, 3) world points whose hull is a shape."""
    physx = sapien.physx
    if isinstance(shape, physx.PhysxCollisionShapeBox):
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
        points = signs * shape.half_size
    elif isinstance(shape, physx.PhysxCollisionShapeConvexMesh):
        points = np.asarray(shape.vertices, dtype=float) * shape.scale
    elif isinstance(shape, physx.PhysxCollisionShapeCylinder):
        ring = np.array([(shape.radius * np.cos(a), shape.radius * np.sin(a)) for a in _turns(2 * np.pi)])
        points = np.concatenate([np.insert(ring, 0, end * shape.half_length, axis=1) for end in (-1, 1)])
    elif isinstance(shape, physx.PhysxCollisionShapeSphere):
        points = shape.radius * np.array(list(_on_sphere()))
    else:
        raise ValueError(f"no second geometry for a {type(shape).__name__}")
    return _moved(T_world_body @ shape.local_pose.to_transformation_matrix(), points)


def _turns(most: float) -> Points:
    return np.linspace(0.0, most, _ROUND, endpoint=False)


def _on_sphere() -> Iterator[tuple[float, float, float]]:
    for a in np.linspace(0.0, np.pi, _ROUND):
        for b in _turns(2 * np.pi):
            yield np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)


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
