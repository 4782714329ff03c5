"""Puts the robot into a SAPIEN scene, with drives and friction that hold what it grasps.

Source: gains, force limits and friction of the feasibility study; a grip of 3 N or a finger friction of 0.3
lost the handle there, 10 N to 100 N and 0.5 to 2 did not.
"""

from __future__ import annotations

from typing import Any

from executor.robot.description import FINGER_LINKS, robot_urdf

# Stiffness, damping, force limit: N/m, Ns/m, N for sliding joints and Nm/rad, Nms/rad, Nm for turning ones.
BASE_DRIVE = (6e4, 8e3, 5000.0)
YAW_DRIVE = (2e4, 2e3, 5000.0)
ARM_DRIVE = (2e3, 2e2, 100.0)
FINGER_DRIVE = (2e3, 1e2, 30.0)
FINGER_FRICTION = 2.0
PATCH_RADIUS_M = 0.02
MIN_PATCH_RADIUS_M = 0.01
_MAX_DEPENETRATION_M_S = 10.0
_NEAR_THE_MOUNT, _BEYOND_THE_ELBOW = 1 << 20, 1 << 21
_IGNORED = {
    **dict.fromkeys(("base_body", "panda_link0", "panda_link1", "panda_link2"), _NEAR_THE_MOUNT),
    **dict.fromkeys(("panda_link3", "panda_link4"), _NEAR_THE_MOUNT | _BEYOND_THE_ELBOW),
    **dict.fromkeys(("panda_link5", "panda_link6", "panda_link7", "panda_hand"), _BEYOND_THE_ELBOW),
}


def load_robot(sapien_scene: Any, *, visual: bool) -> Any:
    """Returns the robot's articulation, added to the scene and ready to be driven.

    Args:
        sapien_scene: A `sapien.Scene`; it needs a render system only where `visual` is true.
        visual: Whether cameras shall see the robot.

    Returns:
        `sapien.physx.PhysxArticulation` with 12 active joints in the order of `description.JOINT_NAMES`.

    Raises:
        RobotDataMissing: When the Panda's distribution is not installed.
    """
    loader = sapien_scene.create_urdf_loader()
    loader.fix_root_link = True
    for finger in FINGER_LINKS:
        loader.set_link_material(finger, FINGER_FRICTION, FINGER_FRICTION, 0.0)
        loader.set_link_patch_radius(finger, PATCH_RADIUS_M)
        loader.set_link_min_patch_radius(finger, MIN_PATCH_RADIUS_M)
    robot = loader.load(str(robot_urdf(visual=visual)))
    robot.name = "robot"
    for link in robot.links:
        link.set_disable_gravity(True)
        link.set_max_depenetration_velocity(_MAX_DEPENETRATION_M_S)
        _exclude_self_collision(link)
    for joint in robot.active_joints:
        joint.set_drive_properties(*_drive(joint.name))
        joint.set_friction(0.0)  # The loader's default of 0.05 would leave the arm short of its target.
    return robot


def _drive(joint: str) -> tuple[float, float, float]:
    if joint in ("base_x", "base_y"):
        return BASE_DRIVE
    if joint == "base_yaw":
        return YAW_DRIVE
    return FINGER_DRIVE if "finger" in joint else ARM_DRIVE


def _exclude_self_collision(link: Any) -> None:
    """Marks a link's shapes with bits of the ignore group: shapes that share one do not collide.

    Hulls of neighbouring links overlap by design. Forearm, hand and fingers do collide with base, pedestal, shoulder
    and upper arm. Everything else in the scene lacks the bits and collides with all of the robot.
    """
    for shape in link.collision_shapes:
        contact_type, affinity, ignore, instance = shape.get_collision_groups()
        shape.set_collision_groups([contact_type, affinity, ignore | _IGNORED.get(link.name, 0), instance])
