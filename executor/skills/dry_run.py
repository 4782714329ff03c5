"""A world and a controller without dynamics: the primitives run on them, and only geometry decides.

A motion puts the robot where its path ends, together with what it holds, or with the joint that it is meant to move.
The fingers close until they touch; what both touch is held. What is let go of comes down onto what is below it. The
bodies are those of the physics, and so are the contacts that monitors and detectors read; forces are not: fingers
press, a touch is no push, and an overlap is a collision.

Only how something comes to rest in a bowl or box is left to physics, of these few things alone. There it slides, leans
and pushes aside what lies there, and no geometry tells where to.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.assets.asset_geometry import rolls_freely
from executor.geometry import Array, inverse, pose_vector
from executor.planning.cargo import cargo_of, riders
from executor.records import Failure, FailureKind
from executor.sim.detectors import touching_bodies
from executor.sim.engine import GROUND, ROBOT, BodyRef, Contact
from executor.sim.robot.kinematics import Kinematics
from executor.sim.world import World
from executor.skills.control import SETTLE_S, Carriage, Controller, Monitor, Pushed, settle_to_rest
from oag import Scene
from oag.measurements import Unplanned

GRIP_N = 30.0
"""Force of a finger on what it holds [N]."""

PUSH_N = 100.0
"""Force of an overlap [N]: more than any monitor lets pass."""

OVERLAP_M = 0.002
"""Deeper overlaps are collisions; planning keeps a clearance, and contact solvers allow less."""

FINGER_TOUCH_M = 0.0003  # Fingers that come so near to something press on it.
HALVINGS = 12  # Of the way of a finger: to a hundredth of a millimetre.
WALL_STEPS = 20  # Of the same way, where walls are looked for: 2 mm, thinner than walls are.
LOOKS = 6  # Configurations of a path at which its monitor looks.
FALL_STEP_M = 0.004  # Thinner than what things are put on.
SUNK_M = 0.0002
MOST_FALL_M = 2.5
MOST_RISE_M = 0.03  # By which a thing that is set upright, or was pressed down, is raised at most.
FALL_S = 0.5  # From the largest height at which a thing is let go of it falls for a third of this.
FAR_M = 50.0  # So far off the robot stands by while things come to rest.

OVER_IT_M = np.array([0.03, 0.03, 0.10])
"""Beyond a bowl's inside: what leans on its rim from within, or stands on what is in it, comes to rest in physics."""

RIGHTS_ITSELF_DEG = 25.0
"""A thing that is let go of with less tilt stands up; with more it stays as it is, and the goal's reading counts."""


@dataclass(frozen=True)
class DryState:
    """All that changes in a dry world: what a subtask starts from."""

    q: Array
    fingers_m: Array
    poses: dict[str, Array]
    joints: dict[str, Array]
    between: BodyRef | None
    along: tuple[str, ...]


class DryWorld(World):
    """A world whose things are where they were put; contacts are those of the bodies there.

    Args:
        scene: A concrete scene.
        packed: The state of a world of that scene at rest.

    Attributes:
        along: Ids of the items that move with the hand: the held one first, then what stands in or on it.
    """

    def __init__(self, scene: Scene, packed: bytes) -> None:
        super().__init__(scene, oracle=True)
        self.unpack(packed)
        self._poses = {name: World.T_world_link(self, name) for name in self.dynamic_ids}
        self._joints = {name: np.array(self._articulation(name).get_qpos(), float) for name in self.articulated_ids}
        qpos = np.asarray(self.robot.get_qpos(), dtype=float)
        self._q, self._fingers_m = qpos[: self.model.movers], qpos[self.model.fingers]
        self._between: BodyRef | None = None
        self.along: tuple[str, ...] = ()
        self._kinematics = Kinematics(self.robot, self.model)
        self._stale = True
        self._disturbed = {*self._poses, *self._joints}

    @property
    def state(self) -> DryState:
        """The present state."""
        poses, joints = dict(self._poses), {name: q.copy() for name, q in self._joints.items()}
        return DryState(self._q.copy(), self._fingers_m.copy(), poses, joints, self._between, self.along)

    def restore(self, state: DryState) -> None:
        """Return to a state that this world had before."""
        self._q, self._fingers_m = state.q.copy(), state.fingers_m.copy()
        self._poses, self._joints = dict(state.poses), {name: q.copy() for name, q in state.joints.items()}
        self._between, self.along = state.between, state.along
        self._disturbed = {*self._poses, *self._joints}
        self._stale = True

    def T_world_link(self, object_id: str, link: str | None = None) -> Array:
        """Return the (4, 4) pose of a link's frame, of the root link without a name."""
        if object_id == ROBOT:
            self._look()
        elif object_id in self._poses:
            return self._poses[object_id].copy()
        return super().T_world_link(object_id, link)

    def joint_position(self, object_id: str, joint: str) -> float:
        """Return a joint's position, in rad or m; 0 is shut."""
        return float(self._joints[object_id][self._joint_index(object_id, joint)])

    def put(self, object_id: str, T_world_root: Array) -> None:
        """Put an item somewhere."""
        self._poses[object_id] = T_world_root
        self._disturbed.add(object_id)
        self._stale = True

    def place_robot(self, q: Array, fingers_m: Array | None = None) -> None:
        """Put base and arm (Q,), and the fingers (2,) where given, with what is held."""
        T_before = self._kinematics.forward(self._q)
        self._q = np.array(q, dtype=float)
        self._fingers_m = self._fingers_m if fingers_m is None else np.array(fingers_m, dtype=float)
        moved = self._kinematics.forward(self._q) @ inverse(T_before)
        for item in self.along:
            self.put(item, moved @ self._poses[item])
        qpos = np.concatenate([self._q, self._fingers_m]).astype(np.float32)
        self.robot.set_qpos(qpos)
        self._stale = True

    def move_joint(self, object_id: str, joint: str, position: float) -> tuple[str, ...]:
        """Move a joint, with what its link carries; return the ids of that."""
        link = self.assets[object_id].joint(joint).child
        carried, T_before = riders(self, object_id, link), self.T_world_link(object_id, link)
        self._joints[object_id][self._joint_index(object_id, joint)] = position
        moved = self.T_world_link(object_id, link) @ inverse(T_before)
        for item in carried:
            self.put(item, moved @ self._poses[item])
        self._disturbed.add(object_id)
        self._stale = True
        return carried

    def carry(self, object_id: str, joint: str, position: float) -> Failure | None:
        """Move a joint, or leave it and return why: what its link carries would end within something."""
        before = self.state
        riding = set(riders(self, object_id, self.assets[object_id].joint(joint).child))
        self._look()
        met_before = {frozenset(pair[:2]) for pair in self.near(riding, -OVERLAP_M)}
        carried = self.move_joint(object_id, joint, position)
        self._look()
        met = [
            pair
            for pair in self.near(set(carried), -OVERLAP_M)
            if ROBOT not in (pair[0].owner, pair[1].owner) and frozenset(pair[:2]) not in met_before
        ]
        if not met:
            return None
        self.restore(before)
        a, b, gap_m = min(met, key=lambda pair: (pair[2], pair[0].owner, pair[1].owner))
        item, other = (a, b) if a.owner in carried else (b, a)
        pair = f"{item.owner} and {other.owner}/{other.link}"
        message = f"{pair} meet by {-1000 * gap_m:.0f} mm where {joint} would end"
        return Failure(FailureKind.NO_PATH, message, (Unplanned(target=object_id, in_the_way=(pair,)),))

    def contacts(self, owners: Container[str] | None = None) -> tuple[Contact, ...]:
        """Return the pairs of bodies that touch or nearly do, with the forces that are taken for granted."""
        self._look()
        held = self._between
        found = []
        for contact in super().contacts(owners):
            if held is not None and contact.a.link in self.model.finger_links and contact.b.owner == held.owner:
                continue
            force_n = PUSH_N if contact.separation_m < -OVERLAP_M else 0.0
            found.append(replace(contact, impulse_ns=force_n * self.timestep_s))
        if held is not None and (owners is None or ROBOT in owners or held.owner in owners):
            pressing = GRIP_N * self.timestep_s
            found += [Contact(BodyRef(ROBOT, finger), held, 0.0, pressing) for finger in self.model.finger_links]
        return tuple(found)

    def close_fingers(self, least_m: float) -> None:
        """Close each finger until it touches something, and hold what both touch."""
        free_m, met_m = self._fingers_m.copy(), np.full(2, max(least_m, 0.0))
        touched = self._touched(met_m)
        if None in touched:
            self._stop_at_walls(free_m, met_m, touched)
        for _ in range(HALVINGS):
            middle_m = np.array([(a + b) / 2 if t else b for a, b, t in zip(free_m, met_m, touched, strict=True)])
            now = self._touched(middle_m)
            for k in range(2):
                if touched[k] is None:
                    continue
                if now[k] is None:
                    free_m[k] = middle_m[k]
                else:
                    met_m[k], touched[k] = middle_m[k], now[k]
        self.place_robot(self._q, met_m)
        first, second = touched
        if first is None or second is None or first.owner != second.owner:
            return
        self._between = first
        if first.owner in self._poses:
            self.along = (first.owner, *cargo_of(self, first.owner))

    def _stop_at_walls(self, free_m: Array, met_m: Array, touched: list[BodyRef | None]) -> None:
        """Find what the fingers that touch nothing once shut meet on their way: the wall of a mug that is hollow there.

        Args:
            free_m: (2,) where each finger is open; set to the last position before it touches something.
            met_m: (2,) where each finger is shut; set to the first position where it touches something.
            touched: What each finger touches at `met_m`; filled in.
        """
        open_m, shut_m, last_m = free_m.copy(), met_m.copy(), free_m.copy()
        for share in np.arange(1, WALL_STEPS) / WALL_STEPS:
            now_m = open_m + share * (shut_m - open_m)
            now = self._touched(now_m)
            for k in range(2):
                if touched[k] is None and now[k] is not None:
                    free_m[k], met_m[k], touched[k] = last_m[k], now_m[k], now[k]
            last_m = now_m

    def open_fingers(self, opening_m: float) -> tuple[str, ...]:
        """Open the fingers, and return what is loose now."""
        loose, self.along, self._between = self.along, (), None
        self.place_robot(self._q, np.full(2, opening_m))
        return loose

    def come_down(self, items: tuple[str, ...]) -> None:
        """Let an item, with what stands in or on it, stand up and sink onto what is below it."""
        item, released = items[0], {name: self._poses[name] for name in items}
        if not rolls_freely(self.assets[item]):
            T = self._poses[item]
            up = np.round(T[2, :3]) if np.abs(T[2, :3]).max() > np.cos(np.deg2rad(RIGHTS_ITSELF_DEG)) else T[2, :3]
            about_rad = np.cross(T[:3, :3] @ up, [0.0, 0.0, 1.0])
            sine = float(np.linalg.norm(about_rad))
            if sine > 1e-6:
                turn = np.eye(4)
                turn[:3, :3] = Rotation.from_rotvec(about_rad * np.arcsin(min(sine, 1.0)) / sine).as_matrix()
                turn[:3, 3] = T[:3, 3] - turn[:3, :3] @ T[:3, 3]
                self._move(items, turn)
        risen_m = 0.0
        while self._sunk(items) and risen_m < MOST_RISE_M:
            self._lift(items, FALL_STEP_M / 2)
            risen_m += FALL_STEP_M / 2
        self._fall(items)
        if (vessel := self._vessel_around(item)) is not None:
            with at_rest_within(self, released, vessel) as rested:
                for name in rested.dynamic_ids:
                    self.put(name, rested.T_world_link(name))

    def _fall(self, items: tuple[str, ...]) -> None:
        fallen_m, step_m = 0.0, FALL_STEP_M
        while fallen_m < MOST_FALL_M and step_m > SUNK_M / 2:
            self._lift(items, -step_m)
            if self._sunk(items):
                self._lift(items, step_m)
                step_m /= 2
            else:
                fallen_m += step_m

    def _vessel_around(self, item: str) -> str | None:
        """Return the bowl or box that an item is in or over; None where it is over none."""
        for vessel in self.dynamic_ids:
            for region in self.assets[vessel].regions if vessel != item else ():
                T_region_item = inverse(self.T_world_link(vessel, region.link)) @ self._poses[item]
                off = np.abs(T_region_item[:3, 3] - np.array(region.center_m))
                if region.kind == "interior" and (off <= np.array(region.half_extents_m) + OVER_IT_M).all():
                    return vessel
        return None

    def _move(self, items: Iterable[str], T: Array) -> None:
        for item in items:
            self.put(item, T @ self._poses[item])

    def _lift(self, items: Iterable[str], by_m: float) -> None:
        T = np.eye(4)
        T[2, 3] = by_m
        self._move(items, T)

    def _sunk(self, items: tuple[str, ...]) -> bool:
        """Return whether items overlap with anything but the robot and each other."""
        self._look()
        inside = {*items, ROBOT}
        return any(
            a.owner not in inside or b.owner not in inside
            for a, b, _ in self.near(set(items), -SUNK_M)
            if ROBOT not in (a.owner, b.owner)
        )

    def _touched(self, fingers_m: Array) -> list[BodyRef | None]:
        """Return what each finger would touch at a position of each."""
        self.place_robot(self._q, fingers_m)
        self._look()
        nearest: dict[str, tuple[float, BodyRef]] = {}
        for a, b, gap_m in self.near({ROBOT}, FINGER_TOUCH_M):
            if a.link in self.model.finger_links and b.owner not in (ROBOT, GROUND):
                nearest[a.link] = min(nearest.get(a.link, (gap_m, b)), (gap_m, b))
        return [nearest[finger][1] if finger in nearest else None for finger in self.model.finger_links]

    def _look(self) -> None:
        """Find the contacts of the present state; whatever the engine moves at that is put back before the next."""
        if not self._stale:
            return
        for name in self._disturbed:
            if name in self._poses:
                self.set_object_pose(name, self._poses[name])
            else:
                self.set_joint_positions(name, self._joints[name])
        self.robot.set_qpos(np.concatenate([self._q, self._fingers_m]).astype(np.float32))
        self.robot.set_qvel(np.zeros(len(self.model.joint_names), dtype=np.float32))
        self.step()
        met = {ref.owner for a, b, _ in self.near({*self.assets, ROBOT}, OVERLAP_M) for ref in (a, b)}
        self._disturbed = met & {*self._poses, *self._joints}
        self._stale = False

    def root_poses(self, object_ids: Iterable[str]) -> NDArray[np.float32]:
        """Return (N, 7) where the root links of some objects are: position and quaternion w x y z."""
        return np.array([pose_vector(self.T_world_link(name, None)) for name in object_ids], dtype=np.float32)


class DryController(Controller):
    """A controller of a dry world: motions are done at once, or end where something is in the way."""

    world: DryWorld

    def __init__(self, world: DryWorld, target: Array, finger_target_m: float) -> None:
        super().__init__(world, target, finger_target_m, lambda: None)
        self._loose: tuple[str, ...] = ()

    def follow(
        self,
        path: Array,
        *,
        speed: float = 1.0,
        monitor: Monitor | None = None,
        carries: Carriage | Pushed | None = None,
    ) -> Failure | None:
        """Put the robot at a path's end; return why it ended early, or None."""
        if carries is not None:
            if len(carries) == 3:
                if (failure := self.world.carry(*carries)) is not None:
                    return failure
            else:
                self.world.put(*carries)
            self._go(path[-1])
            return self.settle(SETTLE_S, monitor)
        rows = np.unique(np.linspace(0, len(path) - 1, min(LOOKS, len(path))).round().astype(int))[1:]
        for row in rows if monitor is not None else rows[-1:]:
            self._go(path[row])
            if monitor is not None and (failure := monitor.check()) is not None:
                return failure
        return None

    def grip(self, finger_target_m: float) -> Array:
        """Close the fingers on what is between them, or open them; return their positions (2,) [m]."""
        opens = finger_target_m > float(self.world.state.fingers_m.mean())
        self.finger_target_m = float(finger_target_m)
        if opens:
            self._loose = self.world.open_fingers(finger_target_m)
        else:
            self.world.close_fingers(finger_target_m)
        return self.world.state.fingers_m

    def settle(self, duration_s: float, monitor: Monitor | None = None) -> Failure | None:
        """Let what is loose come down; return the monitor's failure, or None."""
        loose, self._loose = self._loose, ()
        if loose:
            self.world.come_down(loose)
        return monitor.check() if monitor is not None else None

    def rest(self) -> None:
        """Stay."""

    def _go(self, q: Array) -> None:
        self.target = np.array(q, dtype=float)
        self.world.place_robot(self.target)


@contextmanager
def at_rest_within(world: World, released: Mapping[str, Array], vessel: str) -> Iterator[World]:
    """Yield a physical world in which items came to rest that were let go of over a bowl or box.

    It has these, and what touches them or each other down to what cannot move.

    Args:
        world: Where things are now.
        released: id -> (4, 4) where an item was let go of.
        vessel: Id of the bowl or box.
    """
    names, waiting = {GROUND, ROBOT}, [vessel, *released]
    while waiting:
        names.add(name := waiting.pop())
        near = touching_bodies(world, name) if name in world.dynamic_ids else ()
        waiting += [other for other in near if other not in names]
    objects = {name: thing for name, thing in world.scene.objects.items() if name in names}
    parked = replace(world.scene.robot, position=(FAR_M, FAR_M, 0.0))
    with World(replace(world.scene, objects=objects, facts=(), robot=parked)) as rested:
        for name in rested.articulated_ids:
            for joint in rested.assets[name].joints:
                rested.set_joint_position(name, joint.name, world.joint_position(name, joint.name))
        for name in rested.dynamic_ids:
            rested.set_object_pose(name, released[name] if name in released else world.T_world_link(name))
        start = np.array(parked.model.start(FAR_M, FAR_M, parked.yaw_rad))
        opening_m = float(rested.robot.get_qlimits()[-1, 1])
        settle_to_rest(Controller(rested, start, opening_m, lambda: None), FALL_S)
        yield rested
