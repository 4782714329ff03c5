"""The mirror image of a demonstration: the room, and the robot with it, as seen in a mirror along the room's x axis.

The arm and its hand are the same on either side of the plane that their base and the arm's first axis span. So what is
done in a room is done in the room's mirror image by the mirror image of each motion, and a policy that learns from both
learns twice of each door's hinge and each side that a hand comes from. Neither physics nor planner is asked: only what
some joint could not do is left out.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from executor.datasets.formats.observations import HANDLES, THINGS
from executor.datasets.formats.stream import CLOUD
from executor.robot.actions import joint_limits
from oag.model.primitives import OPPOSITE, Primitive
from oag.model.scenefile import FULL_SCALE

Columns = Mapping[str, NDArray]

_JOINTS = np.array([1, -1, -1, -1, 1, -1, 1, -1, 1, -1, 1, 1], dtype=np.float32)
_WRIST, _WRIST_MIDDLE_RAD = 9, np.pi / 4
"""The last joint of the arm, and where it holds the hand straight."""

_PLACE = np.array([1, -1, 1], dtype=np.float32)
_TURN = np.array([-1, 1, -1], dtype=np.float32)  # Of a rotation vector, and of a quaternion's x y z.
_POSE = np.concatenate([_PLACE, _TURN, [1]]).astype(np.float32)
_AGENT = np.concatenate([np.ones(12), _POSE, [1]]).astype(np.float32)
_THING = np.concatenate([[1], _POSE, [1, 1, 1], _PLACE]).astype(np.float32)
_HANDLE = np.concatenate([[1, 1, 1], _PLACE]).astype(np.float32)
_ENVIRONMENT = np.concatenate([*[_THING] * THINGS, *[_HANDLE] * HANDLES])
_HAND_ACTION = np.concatenate([_PLACE, _TURN, [1, 1, -1, -1]]).astype(np.float32)
_LEFTWARDS = (Primitive.MOVE_EEF_LEFT, Primitive.MOVE_BASE_LEFT, Primitive.TURN_BASE_LEFT)
_OTHER_SIDE = {one: OPPOSITE[one] for left in _LEFTWARDS for one in (left, OPPOSITE[left])}
_PRIMITIVES = np.array([_OTHER_SIDE.get(number, number) for number in (0, *Primitive)])  # 0 where none goes on.
_POINT = np.append(_PLACE, 1).astype(np.float32)


def mirrored(columns: Columns) -> dict[str, NDArray] | None:
    """Returns what policies learn from of an episode's columns (`executor.datasets.formats.stream`), mirrored; None
    where a joint would be beyond its limits.

    Args:
        columns: Of the episode; those that policies do not see stay as they are.
    """
    found = dict(columns)
    agent = columns["observation.state"] * _AGENT
    agent[:, :12] = mirrored_joints(columns["observation.state"][:, :12])
    found["observation.state"] = agent
    found["action.joint_target"] = mirrored_joints(columns["action.joint_target"])
    low, high = joint_limits(FULL_SCALE).T.astype(np.float32)
    arm = slice(3, 10)
    for joints in (agent[:, arm], found["action.joint_target"][:, arm]):
        if (joints < low[arm]).any() or (joints > high[arm]).any():
            return None
    found["observation.environment_state"] = columns["observation.environment_state"] * _ENVIRONMENT
    found["action"] = columns["action"] * _HAND_ACTION
    found["primitive_index"] = _PRIMITIVES[columns["primitive_index"]]
    if CLOUD in columns:
        found[CLOUD] = columns[CLOUD] * _POINT
    return found


def mirrored_joints(joints: NDArray) -> NDArray:
    """Returns (N, 12) joints of the robot's mirror image: base x, y (m) and yaw (rad), arm (rad), fingers (m)."""
    found = joints * _JOINTS
    found[:, _WRIST] += 2 * _WRIST_MIDDLE_RAD
    return found
