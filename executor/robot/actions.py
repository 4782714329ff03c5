"""The two ways in which a robot is told what to do at a low rate, and the way from one to the other.

Joint targets: (12,) where base, arm and fingers shall be when the next action comes, in the order of `JOINT_NAMES`, m
and rad. Hand actions, the paper's ten numbers: by how much the point between the fingertips shall move (3, m) and turn
(3, rotation vector, rad), in the axes of the base and as seen from the base; how far the fingers shall be open, 0 shut
and 1 open; and by how much the base shall drive (2, m) and turn (1, rad), in its own axes as they are before. All of it
is from one target to the next, not from where the robot has come to, so that what a hand presses with is told as well,
and many small actions do not drift.

Source: the paper's policy actions of ten degrees of freedom, six of the end effector, one of the gripper, three of the
base. The frames are ours.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from executor.geometry import Array
from executor.robot.description import ARM_HOME, BASE_LINK, JOINT_NAMES, TCP_LINK, robot_urdf
from executor.robot.tracking import ArmChain

TARGETS, HAND_NUMBERS = len(JOINT_NAMES), 10
_ARM = slice(3, 10)
_ITERATIONS = 20
_DAMPING = 1e-6
_NEAR_SINGULAR = 1e-3  # Damping where plain steps grow: a wish beyond reach stretches the arm and does not shake it.
_REACHED_M, _REACHED_RAD = 1e-5, 1e-4
_LONGEST_STEP_RAD = 0.2
_HOMEWARD = 0.3
"""Share of the way home that the elbow goes, where the hand moves: ten numbers say nothing of it, and left to itself it
drifts into limits, 21 cm off the way at the end of a long task; so it arrives within a millimetre."""

_INSET_RAD = 0.002  # Commands end so far before a limit of the arm.


@cache
def joint_limits() -> Array:
    """Returns (12, 2): the least and the largest position of each joint, in m or rad, as the engine reads them.

    Raises:
        RobotDataMissing: The Panda's distribution is not installed.
    """
    limits = {
        joint.attrib["name"]: [float(limit.attrib[end]) for end in ("lower", "upper")]
        for joint in ET.parse(robot_urdf(visual=False)).getroot().findall("joint")
        if (limit := joint.find("limit")) is not None
    }
    return np.array([limits[name] for name in JOINT_NAMES])


@cache
def _chain() -> ArmChain:
    return ArmChain(robot_urdf(visual=False), BASE_LINK, TCP_LINK)


def hand_actions(before: Array, after: Array) -> Array:
    """Returns (N, 10) hand actions between joint targets.

    Args:
        before, after: (N, 12) joint targets, the ones when an action is given and the ones when it has been done.
    """
    before, after = np.atleast_2d(np.asarray(before, float)), np.atleast_2d(np.asarray(after, float))
    T_before, T_after = _chain().forward(before[:, _ARM]), _chain().forward(after[:, _ARM])
    turns = Rotation.from_matrix(T_after[:, :3, :3]) * Rotation.from_matrix(T_before[:, :3, :3]).inv()
    driven = after[:, :3] - before[:, :3]
    turned_back = Rotation.from_euler("z", -before[:, [2]])
    ahead = turned_back.apply(np.concatenate([driven[:, :2], np.zeros((len(driven), 1))], axis=1))
    opening = after[:, 10:].mean(axis=1, keepdims=True) / joint_limits()[-1, 1]
    moved = T_after[:, :3, 3] - T_before[:, :3, 3]
    return np.concatenate([moved, turns.as_rotvec(), opening, ahead[:, :2], driven[:, 2:]], axis=1)


def joint_target(before: Array, action: Array) -> Array:
    """Returns the (12,) joint targets that a hand action asks for, from those before it.

    The arm takes a posture near the one before, within its limits, the elbow on its way home; where the hand cannot get
    all the way, it gets as near as damped steps bring it.

    Args:
        before: (12,) joint targets.
        action: (10,) a hand action.
    """
    before, action = np.asarray(before, float), np.asarray(action, float)
    cosine, sine = np.cos(before[2]), np.sin(before[2])
    ahead, aside = action[7:9]
    base = before[:3] + [cosine * ahead - sine * aside, sine * ahead + cosine * aside, action[9]]
    fingers = np.full(2, np.clip(action[6], 0.0, 1.0) * joint_limits()[-1, 1])
    return np.concatenate([base, _posture(before[_ARM], action[:3], action[3:6]), fingers])


def _posture(arm: Array, move_m: Array, turn_rad: Array) -> Array:
    """Returns the (7,) posture near another one, homeward, with the hand moved and turned in the base's axes."""
    low, high = joint_limits()[_ARM, 0] + _INSET_RAD, joint_limits()[_ARM, 1] - _INSET_RAD
    low, high = np.minimum(low, arm), np.maximum(high, arm)
    T_start, jacobian = (found[0] for found in _chain().forward_and_jacobian(arm[None]))
    wanted_m = T_start[:3, 3] + move_m
    wanted = Rotation.from_rotvec(turn_rad).as_matrix() @ T_start[:3, :3]
    if move_m.any() or turn_rad.any():
        free = np.eye(len(arm)) - np.linalg.pinv(jacobian, rcond=_NEAR_SINGULAR) @ jacobian
        arm = np.clip(arm + _HOMEWARD * free @ (np.array(ARM_HOME) - arm), low, high)
    best, least = arm, np.inf
    for _ in range(_ITERATIONS):
        reached, jacobian = (found[0] for found in _chain().forward_and_jacobian(arm[None]))
        turn = Rotation.from_matrix(wanted @ reached[:3, :3].T).as_rotvec()
        error = np.concatenate([wanted_m - reached[:3, 3], turn])
        off = float(np.linalg.norm(error))
        if off >= least:
            break
        best, least = arm, off
        if np.linalg.norm(error[:3]) < _REACHED_M and np.linalg.norm(turn) < _REACHED_RAD:
            break
        squared = jacobian @ jacobian.T
        damping = _DAMPING if np.linalg.eigvalsh(squared)[0] > _NEAR_SINGULAR else _NEAR_SINGULAR
        step = jacobian.T @ np.linalg.solve(squared + damping * np.eye(6), error)
        arm = np.clip(arm + np.clip(step, -_LONGEST_STEP_RAD, _LONGEST_STEP_RAD), low, high)
    return best
