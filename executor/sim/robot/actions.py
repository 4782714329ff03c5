"""The two action spaces at a low rate, joint targets and hand actions, and the conversion from the first to the second.

Joint targets: (J,) positions of base, arm and fingers when the next action comes, in the order of the robot's
`joint_names`, [m] and [rad].

Hand actions are the paper's ten numbers, and one more for a lift. Three move [m] and three turn (rotation vector [rad])
the point between the fingertips, in the base's axes and relative to the base. One is the opening of the fingers: 0
shut, 1 open, below 0 where they press harder. Three drive (2, [m]) and turn (1, [rad]) the base, in its own axes before
the action. The last one moves the lift [m], and with it the frame that the hand moves in.

All differences are between targets, not between reached positions. So the pressing force of a hand is part of an
action, and many small actions do not drift. The inverse, in which ten numbers leave a joint of the arm free, is in
`executor.envs.hand_control`.

Source: the paper's policy actions of ten degrees of freedom, six of the end effector, one of the gripper, three of the
base. The frames are ours.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from executor.geometry import Array
from executor.sim.robot.description import FINGER_DRIVE, mount_link, robot_urdf
from executor.sim.robot.kinematics import ArmChain
from oag.model.robots import Robot

OPENING, BASE_NUMBERS_FROM = 6, 7
"""Position of the opening in a hand action, and of the first of the base's numbers."""


def hand_numbers(robot: Robot) -> int:
    """Return the length of a robot's hand actions."""
    return BASE_NUMBERS_FROM + len(robot.base_joints)


@cache
def joint_limits(robot: Robot) -> Array:
    """Return (J, 2): the least and the largest target of each joint, [m] or [rad].

    They are the joints' own limits, as the engine reads them. But targets of the fingers may go beyond shut, down to
    where their drives press with all their force whatever is between them.
    """
    limits = {
        joint.attrib["name"]: [float(limit.attrib[end]) for end in ("lower", "upper")]
        for joint in ET.parse(robot_urdf(robot, visual=False)).getroot().findall("joint")
        if (limit := joint.find("limit")) is not None
    }
    found = np.array([limits[name] for name in robot.joint_names])
    stiffness, _, force_n = FINGER_DRIVE
    found[robot.fingers, 0] = -force_n / stiffness
    return found


@cache
def arm_chain(robot: Robot) -> ArmChain:
    """Return a robot's arm, from the base's frame to the point between the fingertips."""
    return ArmChain(robot_urdf(robot, visual=False), mount_link(robot), robot.tip_link)


def hand_actions(robot: Robot, before: Array, after: Array) -> Array:
    """Return (N, H) hand actions between joint targets.

    Args:
        before, after: (N, J) joint targets, before and after each action.
    """
    before, after = np.atleast_2d(np.asarray(before, float)), np.atleast_2d(np.asarray(after, float))
    chain = arm_chain(robot)
    opening = after[:, robot.fingers].mean(axis=1) / joint_limits(robot)[-1, 1]
    T_before, T_after = chain.forward(before[:, robot.arm]), chain.forward(after[:, robot.arm])
    return actions_between(before[:, robot.base], after[:, robot.base], T_before, T_after, opening)


def actions_between(before: Array, after: Array, T_before: Array, T_after: Array, opening: Array) -> Array:
    """Return (N, H) hand actions from one pose of base and hand to another.

    Args:
        before, after: (N, B) the base, x, y [m] and yaw [rad], and a lift [m].
        T_before, T_after: (N, 4, 4) the hand, from the base.
        opening: (N,) opening of the fingers, in the units of hand actions.
    """
    turns = Rotation.from_matrix(T_after[:, :3, :3]) * Rotation.from_matrix(T_before[:, :3, :3]).inv()
    driven = after - before
    turned_back = Rotation.from_euler("z", -before[:, [2]])
    ahead = turned_back.apply(np.concatenate([driven[:, :2], np.zeros((len(driven), 1))], axis=1))
    moved = T_after[:, :3, 3] - T_before[:, :3, 3]
    return np.concatenate([moved, turns.as_rotvec(), opening[:, None], ahead[:, :2], driven[:, 2:]], axis=1)
