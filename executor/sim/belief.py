"""The world as planning believes it to be under faults: wrong sizes, wrong places, and unknown obstacles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from executor.assets.asset_geometry import joint_transform
from executor.assets.library import asset_for
from executor.assets.model import Asset
from executor.geometry import Array, heading_of, pose_vector, rotation_z, transform, transform_from_quaternion
from executor.sim.faults import BlockedDoor, Fault, FaultUnfit, PoseError, WeakGrip, WrongScale
from executor.sim.robot.description import FINGER_DRIVE
from executor.sim.world import World
from oag import Scene, SceneObject

OBSTACLE = "unseen_box_0"
OBSTACLE_M = (0.25, 0.25, 0.9)
OBSTACLE_RADIUS_M = 0.25
"""How far from the hinge it stands: the door meets it, and the robot that leads the door's edge does not."""

DOOR_THICKNESS_M = 0.07


def true_scene(scene: Scene, faults: Iterable[Fault]) -> Scene:
    """Return the true scene: with the unknown obstacle that blocks a door.

    Raises:
        FaultUnfit: A door is to be blocked where there is no hinged one.
    """
    for fault in faults:
        if isinstance(fault, PoseError | WrongScale):
            scene[fault.object_id]
        elif isinstance(fault, BlockedDoor):
            scene = replace(scene, objects={**scene.objects, OBSTACLE: _obstacle(scene[fault.object_id], fault)})
    return scene


def believed_scene(scene: Scene, faults: Iterable[Fault]) -> Scene:
    """Return the scene as planning believes it to be at first: no unseen thing, items of their believed sizes."""
    known = replace(scene, objects={name: obj for name, obj in scene.objects.items() if name != OBSTACLE})
    return known.with_scales({f.object_id: f.factor for f in faults if isinstance(f, WrongScale)})


def weaken_grip(world: World, faults: Iterable[Fault]) -> None:
    """Limit the finger force of a world by its faults; a world that was built or restored has a sound gripper."""
    stiffness, damping, _ = FINGER_DRIVE
    for fault in faults:
        if isinstance(fault, WeakGrip):
            for joint in world.robot.active_joints[world.model.fingers]:
                joint.set_drive_properties(stiffness, damping, fault.force_n)


class BelievedWorld:
    """A world as it is believed to be: places and sizes of some items differ, and unseen things are missing.

    Args:
        faults: Deliberate faults; kinds that do not concern belief change nothing.
        held: Ids of the things that the hand has held: where they are is known. Their size is not: the fingers measure
            a width, and planning goes by the height.
    """

    def __init__(self, world: World, faults: Iterable[Fault], held: frozenset[str] = frozenset()) -> None:
        self._world = world
        self._offsets: dict[str, Array] = {}
        self.assets: dict[str, Asset] = {name: a for name, a in world.assets.items() if name != OBSTACLE}
        for fault in faults:
            if isinstance(fault, PoseError) and fault.object_id not in held:
                self._shift(fault.object_id, np.array([fault.dx_m, fault.dy_m, 0.0]))
            elif isinstance(fault, WrongScale):
                item = world.scene[fault.object_id]
                taken_for = item.scaled(fault.factor)
                self.assets[fault.object_id] = asset_for(taken_for)
                if fault.object_id not in held:
                    self._shift(fault.object_id, np.array([0.0, 0.0, (taken_for.height_m - item.height_m) / 2]))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._world, name)

    def T_world_link(self, object_id: str, link: str | None = None) -> Array:
        """Return where a link is believed to be."""
        T = self._world.T_world_link(object_id, link).copy()
        T[:3, 3] += self._offsets.get(object_id, 0.0)
        return T

    def _shift(self, object_id: str, by_m: Array) -> None:
        self._offsets[object_id] = self._offsets.get(object_id, np.zeros(3)) + by_m


def has_belief_fault(faults: Iterable[Fault]) -> bool:
    """Return whether any fault is one of belief."""
    return any(isinstance(fault, PoseError | WrongScale | BlockedDoor) for fault in faults)


def _obstacle(obj: SceneObject, fault: BlockedDoor) -> SceneObject:
    """Return the box whose face the door's outer side meets at the fault's fraction."""
    asset = asset_for(obj)
    handle = asset.handles[0] if asset.handles else None
    joint = asset.joint(handle.joint) if handle is not None else None
    if handle is None or joint is None or joint.kind != "revolute" or abs(joint.axis[2]) < 0.9:
        raise FaultUnfit(f"{fault.object_id} has no door with an upright hinge that could be blocked")
    T_world_door = transform_from_quaternion(obj.position, obj.orientation) @ joint_transform(
        joint, joint.position(fault.fraction)
    )
    # In the door's frame the hinge is the origin; the handle gives its direction and its outer side.
    outward = T_world_door[:3, :3] @ np.array(handle.outward)
    along = T_world_door[:3, :3] @ np.array([handle.position_m[0], handle.position_m[1], 0.0])
    along -= outward * float(along @ outward)
    along /= np.linalg.norm(along)
    x, y, _ = T_world_door[:3, 3] + OBSTACLE_RADIUS_M * along + (DOOR_THICKNESS_M + OBSTACLE_M[0] / 2) * outward
    pose = pose_vector(transform(rotation_z(heading_of(outward)), [x, y, OBSTACLE_M[2] / 2]))
    px, py, pz, w, i, j, k = (float(value) for value in pose)
    return SceneObject(
        id=OBSTACLE,
        category="cabinet",
        model="unseen",
        position=(px, py, pz),
        orientation=(w, i, j, k),
        bbox_extent=OBSTACLE_M,
        scale=(1.0, 1.0, 1.0),
    )
