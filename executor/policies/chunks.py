"""Actions as a policy foretells them: several in a row, as seen from where the robot is when it decides.

A chunk of joint targets is (H, 11): base x, y (m) and yaw (rad) as seen from the base where it stands, seven arm joints
less what they are (rad), and how far each finger is from the middle (m). A chunk of hand actions is (H, 10), as it is.

Where the hand is foretold too, 6 more numbers say where it is to be, and the joints are put right by it. Seven joints
that are foretold one by one put a hand centimetres off where each posture is new, as in rooms that are drawn; how a
hand moves as seen from itself hardly depends on the posture. So the joints say where the elbow is, and the hand's
motion says where the hand is. From joints to the hand and back it goes by pytorch-kinematics, many postures at once.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.geometry import Array
from executor.machine.extras import require
from executor.policies.seen.features import Numbers
from executor.policies.settings import Acts
from executor.robot.actions import HAND_NUMBERS, joint_limits
from executor.robot.description import BASE_LINK, TCP_LINK, robot_urdf
from executor.robot.tracking import pose_error
from oag.model.scenefile import FULL_SCALE, PAPER_SCALE

TARGET_NUMBERS, POSE_NUMBERS = 11, 6

_ARM = slice(3, 10)
_DAMPING = 1e-4  # m and rad squared: where the arm is stretched out, elbows stay where they were foretold.
_ITERATIONS = 3
_MOST_RAD = 0.2
"""How far a step puts a joint right."""


def numbers_each(acts: Acts) -> int:
    """Returns how many numbers an action has in a chunk."""
    if acts.kind == "paper":
        return HAND_NUMBERS
    return TARGET_NUMBERS + (POSE_NUMBERS if acts.hand else 0)


def targets_from_here(qpos: NDArray, targets: NDArray) -> Numbers:
    """Returns (N, H, 11): joint targets as seen from where the robot is.

    Args:
        qpos: (N, 12) joint positions.
        targets: (N, H, 12) joint targets.
    """
    ahead = targets[..., :10] - qpos[:, None, :10]
    cosine, sine = np.cos(qpos[:, 2, None]), np.sin(qpos[:, 2, None])
    x, y = ahead[..., 0].copy(), ahead[..., 1].copy()
    ahead[..., 0], ahead[..., 1] = cosine * x + sine * y, cosine * y - sine * x
    return np.concatenate([ahead, targets[..., 10:].mean(axis=-1, keepdims=True)], axis=-1, dtype=np.float32)


def targets_in_the_room(qpos: NDArray, chunk: NDArray, scale: float = PAPER_SCALE) -> NDArray[np.float64]:
    """Returns the (H, 12) joint targets, within the joints' limits, of a chunk that was foretold at a posture.

    Args:
        qpos: (12,) joint positions.
        chunk: (H, 11), or 17 where the hand was foretold too.
        scale: The robot's, of a Panda's full size.
    """
    cosine, sine = np.cos(qpos[2]), np.sin(qpos[2])
    ahead = np.array(chunk[:, :10], dtype=float)
    x, y = ahead[:, 0].copy(), ahead[:, 1].copy()
    ahead[:, 0], ahead[:, 1] = cosine * x - sine * y, sine * x + cosine * y
    ahead += qpos[:10]
    if chunk.shape[1] > TARGET_NUMBERS:
        ahead[:, 3:] = arms_put_right(qpos, ahead[:, 3:], chunk[:, TARGET_NUMBERS:], scale)
    fingers = np.repeat(chunk[:, 10:11], 2, axis=1)
    # The environment cuts what a smaller hand cannot do.
    low, high = joint_limits(FULL_SCALE).T
    return np.clip(np.concatenate([ahead, fingers], axis=1), low, high)


def hand_poses(joints: NDArray, scale: float) -> NDArray[np.float32]:
    """Returns (N, 4, 4) the hand from the base.

    Args:
        joints: (N, 12) joint positions or targets.
        scale: The robot's, of a Panda's full size.
    """
    return _reached(np.asarray(joints[:, _ARM], float), scale).astype(np.float32)


def hands_from_here(now: NDArray, later: NDArray) -> NDArray[np.float32]:
    """Returns (N, POSE_NUMBERS) where hands are to be, as seen from where each is: m, and rotation vectors in rad.

    Args:
        now: (N, 4, 4) from the base.
        later: (N, 4, 4) from the base, wherever that is then.
    """
    back = now[:, :3, :3].swapaxes(-1, -2)
    places = (back @ (later[:, :3, 3] - now[:, :3, 3])[..., None])[..., 0]
    turns = Rotation.from_matrix(back @ later[:, :3, :3]).as_rotvec()
    return np.concatenate([places, turns], axis=-1, dtype=np.float32)


def arms_put_right(qpos: NDArray, arms: NDArray, hands: NDArray, scale: float) -> Array:
    """Returns (H, 7) postures near those that were foretold, with the hand where that was foretold to be.

    Args:
        qpos: (12,) joint positions where it was foretold.
        arms: (H, 7) postures, rad.
        hands: (H, POSE_NUMBERS) as `hands_from_here` has them.
        scale: The robot's, of a Panda's full size.
    """
    found, now = np.array(arms, float), _reached(np.asarray(qpos, float)[None, _ARM], scale)[0]
    wanted = np.tile(np.eye(4), (len(found), 1, 1))
    wanted[:, :3, :3] = now[:3, :3] @ Rotation.from_rotvec(hands[:, 3:]).as_matrix()
    wanted[:, :3, 3] = now[:3, 3] + hands[:, :3] @ now[:3, :3].T
    for _ in range(_ITERATIONS):
        moves, poses = _arm(scale).jacobian(torch.from_numpy(found), ret_eef_pose=True)
        jacobians, reached = moves.numpy(), poses.numpy()
        turned = jacobians.swapaxes(-1, -2)
        error = pose_error(wanted, reached)[..., None]
        step = turned @ np.linalg.solve(jacobians @ turned + _DAMPING * np.eye(6), error)
        found += np.clip(step[..., 0], -_MOST_RAD, _MOST_RAD)
    return found


def _reached(arms: Array, scale: float) -> Array:
    """Returns (N, 4, 4) the hand from the base at postures (N, 7)."""
    return np.asarray(_arm(scale).forward_kinematics(torch.from_numpy(arms)).get_matrix())


@cache
def _arm(scale: float) -> Any:
    """Returns pytorch-kinematics' chain from the base to the point between the fingertips, in double precision."""
    build = require("pytorch_kinematics", "learn").build_serial_chain_from_urdf
    robot = robot_urdf(scale, visual=False).read_bytes()
    return build(robot, TCP_LINK, root_link_name=BASE_LINK).to(dtype=torch.float64)
