"""Opening and closing by moving the whole robot with the handle: an arc about a hinge, a line along a slide.

The arm stays as it is and the base carries the gripped handle along the joint's own motion, so there are no wrist
limits and nothing slips. It needs free floor, which is checked before the robot moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from executor.assets.model import Joint
from executor.geometry import Array, heading_of
from executor.motion.planning.oracle import JointTarget
from executor.motion.planning.paths import arc_about, base_move, segment

ARC_STEP_M = 0.03
VERTICAL = 0.99
LEVEL = 0.01


@dataclass(frozen=True, slots=True)
class ArticulationPath:
    """A path of the robot and the joint's position at each of its rows.

    Attributes:
        path: (N, 10) configurations, the start first.
        joints: N mappings from (object id, joint name) to a position.
    """

    path: Array
    joints: tuple[dict[JointTarget, float], ...]


def joint_axis(joint: Joint, T_world_root: Array) -> Array:
    """Returns a joint's axis (3,) in the world."""
    return np.asarray(T_world_root[:3, :3] @ np.array(joint.axis))


def driving_carries(joint: Joint, T_world_root: Array) -> bool:
    """Decides whether driving alone moves a joint: its hinge is vertical, or its slide level."""
    upward = abs(float(joint_axis(joint, T_world_root)[2]))
    return upward >= VERTICAL if joint.kind == "revolute" else upward <= LEVEL


def carry_joint(
    q: Array, object_id: str, joint: Joint, T_world_root: Array, start: float, end: float
) -> ArticulationPath:
    """Returns the robot's path that carries a gripped handle from one joint position to another.

    Args:
        q: (10,) with the handle in the gripper.
        object_id: The articulated object.
        joint: A joint that `driving_carries`.
        T_world_root: (4, 4) where the object stands.
        start, end: Joint positions in rad or m.
    """
    axis = joint_axis(joint, T_world_root)
    if joint.kind == "revolute":
        pivot = (T_world_root @ np.array([*joint.position_m, 1.0]))[:3]
        radius_m = max(float(np.hypot(*(q[:2] - pivot[:2]))), 0.5)
        count = max(int(np.ceil(abs(end - start) * radius_m / ARC_STEP_M)), 2)
        path = arc_about(q, pivot, float(np.sign(axis[2])) * (end - start), count)
    else:
        ends = base_move(q, end - start, heading_of(axis))
        path = np.concatenate([ends[:1], segment(ends[0], ends[1])])
    positions = np.linspace(start, end, len(path))
    return ArticulationPath(path, tuple({(object_id, joint.name): float(p)} for p in positions))
