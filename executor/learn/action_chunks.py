"""Action chunks: several actions in a row, relative to the robot's pose at the time of prediction.

A chunk of joint targets is (H, 11): base x, y (m) and yaw (rad) in the present base frame, seven arm joints less their
positions (rad), and each finger's distance from the middle (m). A chunk of hand actions is (H, 10), unchanged.

With a predicted hand, 6 more numbers give its pose, and the joints are refined by it. Seven joints predicted one by one
put a hand centimetres off where each posture is new, as in drawn rooms; a hand's motion in its own frame hardly depends
on the posture. So the joints determine the elbow, and the hand's motion determines the hand. pytorch-kinematics
converts between joints and hand, many postures at once.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.geometry import Array
from executor.learn.observations import Numbers
from executor.learn.settings import Acts
from executor.sim.robot.actions import HAND_NUMBERS, joint_limits
from executor.sim.robot.description import BASE_LINK, TCP_LINK, robot_urdf
from executor.sim.robot.kinematics import pose_error
from executor.system.extras import require
from oag.model.scene import FULL_SCALE, PAPER_SCALE

TARGET_NUMBERS, POSE_NUMBERS = 11, 6

_ARM = slice(3, 10)
_DAMPING = 1e-4  # m and rad squared: near singularities the elbow stays as predicted.
_ITERATIONS = 3
_MOST_RAD = 0.2
"""Maximum correction of a joint per iteration."""


def action_size(acts: Acts) -> int:
    """Return the number of numbers of an action in a chunk."""
    if acts.kind == "paper":
        return HAND_NUMBERS
    return TARGET_NUMBERS + (POSE_NUMBERS if acts.hand else 0)


def to_base_targets(qpos: NDArray, targets: NDArray) -> Numbers:
    """Transform joint targets into the base frame: (N, H, 11).

    Args:
        qpos: (N, 12) joint positions.
        targets: (N, H, 12) joint targets.
    """
    ahead = targets[..., :10] - qpos[:, None, :10]
    cosine, sine = np.cos(qpos[:, 2, None]), np.sin(qpos[:, 2, None])
    x, y = ahead[..., 0].copy(), ahead[..., 1].copy()
    ahead[..., 0], ahead[..., 1] = cosine * x + sine * y, cosine * y - sine * x
    return np.concatenate([ahead, targets[..., 10:].mean(axis=-1, keepdims=True)], axis=-1, dtype=np.float32)


def to_world_targets(qpos: NDArray, chunk: NDArray, scale: float = PAPER_SCALE) -> NDArray[np.float64]:
    """Transform a chunk, predicted at a posture, into (H, 12) joint targets within the joints' limits.

    Args:
        qpos: (12,) joint positions.
        chunk: (H, 11), or 17 with a predicted hand.
        scale: The robot's scale; 1 is a full-size Panda.
    """
    cosine, sine = np.cos(qpos[2]), np.sin(qpos[2])
    ahead = np.array(chunk[:, :10], dtype=float)
    x, y = ahead[:, 0].copy(), ahead[:, 1].copy()
    ahead[:, 0], ahead[:, 1] = cosine * x - sine * y, sine * x + cosine * y
    ahead += qpos[:10]
    if chunk.shape[1] > TARGET_NUMBERS:
        ahead[:, 3:] = refine_arm_by_ik(qpos, ahead[:, 3:], chunk[:, TARGET_NUMBERS:], scale)
    fingers = np.repeat(chunk[:, 10:11], 2, axis=1)
    # The environment clips to a smaller hand's limits.
    low, high = joint_limits(FULL_SCALE).T
    return np.clip(np.concatenate([ahead, fingers], axis=1), low, high)


def hand_poses(joints: NDArray, scale: float) -> NDArray[np.float32]:
    """Return (N, 4, 4) hand poses in the base frame.

    Args:
        joints: (N, 12) joint positions or targets.
        scale: The robot's scale; 1 is a full-size Panda.
    """
    return _hand_of_arm(np.asarray(joints[:, _ARM], float), scale).astype(np.float32)


def to_hand_frame(now: NDArray, later: NDArray) -> NDArray[np.float32]:
    """Return (N, POSE_NUMBERS) later hand poses in the present hand frame: m, and rotation vectors in rad.

    Args:
        now: (N, 4, 4) in the base frame.
        later: (N, 4, 4) in the base frame of that time.
    """
    back = now[:, :3, :3].swapaxes(-1, -2)
    places = (back @ (later[:, :3, 3] - now[:, :3, 3])[..., None])[..., 0]
    turns = Rotation.from_matrix(back @ later[:, :3, :3]).as_rotvec()
    return np.concatenate([places, turns], axis=-1, dtype=np.float32)


def refine_arm_by_ik(qpos: NDArray, arms: NDArray, hands: NDArray, scale: float) -> Array:
    """Refine predicted arm postures by inverse kinematics to the predicted hand poses; return (H, 7).

    Args:
        qpos: (12,) joint positions at the prediction.
        arms: (H, 7) predicted postures [rad].
        hands: (H, POSE_NUMBERS) as from `to_hand_frame`.
        scale: The robot's scale; 1 is a full-size Panda.
    """
    found, now = np.array(arms, float), _hand_of_arm(np.asarray(qpos, float)[None, _ARM], scale)[0]
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


def _hand_of_arm(arms: Array, scale: float) -> Array:
    """Return (N, 4, 4) hand poses of postures (N, 7) in the base frame."""
    return np.asarray(_arm(scale).forward_kinematics(torch.from_numpy(arms)).get_matrix())


@cache
def _arm(scale: float) -> Any:
    """Return pytorch-kinematics' chain from the base to the point between the fingertips, in double precision."""
    build = require("pytorch_kinematics", "learn").build_serial_chain_from_urdf
    robot = robot_urdf(scale, visual=False).read_bytes()
    return build(robot, TCP_LINK, root_link_name=BASE_LINK).to(dtype=torch.float64)
