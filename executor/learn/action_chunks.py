"""Action chunks: several actions in a row, relative to the robot's pose at the time of prediction.

A chunk of joint targets is (H, Q + 1): base x, y (m), yaw (rad) and lift (m) in the present base frame, arm joints less
their positions (rad), and each finger's distance from the middle (m). A chunk of hand actions is unchanged.

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
from executor.sim.robot.actions import hand_numbers, joint_limits
from executor.sim.robot.description import mount_link, robot_urdf
from executor.sim.robot.kinematics import pose_error
from executor.system.extras import require
from oag.model.robots import Robot

POSE_NUMBERS = 6
_DAMPING = 1e-4  # m and rad squared: near singularities the elbow stays as predicted.
_ITERATIONS = 3
_MOST_RAD = 0.2
"""Maximum correction of a joint per iteration."""


def action_size(acts: Acts, robot: Robot) -> int:
    """Return the number of numbers of an action in a chunk."""
    if acts.kind == "paper":
        return hand_numbers(robot)
    return robot.movers + 1 + (POSE_NUMBERS if acts.hand else 0)


def to_base_targets(robot: Robot, qpos: NDArray, targets: NDArray) -> Numbers:
    """Transform joint targets into the base frame: (N, H, Q + 1).

    Args:
        qpos: (N, J) joint positions.
        targets: (N, H, J) joint targets.
    """
    ahead = targets[..., : robot.movers] - qpos[:, None, : robot.movers]
    cosine, sine = np.cos(qpos[:, 2, None]), np.sin(qpos[:, 2, None])
    x, y = ahead[..., 0].copy(), ahead[..., 1].copy()
    ahead[..., 0], ahead[..., 1] = cosine * x + sine * y, cosine * y - sine * x
    return np.concatenate([ahead, targets[..., robot.fingers].mean(axis=-1, keepdims=True)], axis=-1, dtype=np.float32)


def to_world_targets(robot: Robot, qpos: NDArray, chunk: NDArray) -> NDArray[np.float64]:
    """Transform a chunk, predicted at a posture, into (H, J) joint targets within the joints' limits.

    Args:
        qpos: (J,) joint positions.
        chunk: (H, Q + 1), or six more with a predicted hand.
    """
    cosine, sine = np.cos(qpos[2]), np.sin(qpos[2])
    movers, base = robot.movers, robot.base.stop
    ahead = np.array(chunk[:, :movers], dtype=float)
    x, y = ahead[:, 0].copy(), ahead[:, 1].copy()
    ahead[:, 0], ahead[:, 1] = cosine * x - sine * y, sine * x + cosine * y
    ahead += qpos[:movers]
    if chunk.shape[1] > movers + 1:
        ahead[:, base:] = refine_arm_by_ik(qpos, ahead[:, base:], chunk[:, movers + 1 :], robot)
    fingers = np.repeat(chunk[:, movers : movers + 1], 2, axis=1)
    low, high = joint_limits(robot).T
    return np.clip(np.concatenate([ahead, fingers], axis=1), low, high)


def hand_poses(joints: NDArray, robot: Robot) -> NDArray[np.float32]:
    """Return (N, 4, 4) hand poses in the base frame.

    Args:
        joints: (N, J) joint positions or targets.
    """
    return _hand_of_arm(np.asarray(joints[:, robot.arm], float), robot).astype(np.float32)


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


def refine_arm_by_ik(qpos: NDArray, arms: NDArray, hands: NDArray, robot: Robot) -> Array:
    """Refine predicted arm postures by inverse kinematics to the predicted hand poses; return (H, A).

    Args:
        qpos: (J,) joint positions at the prediction.
        arms: (H, A) predicted postures [rad].
        hands: (H, POSE_NUMBERS) as from `to_hand_frame`.
    """
    found, now = np.array(arms, float), _hand_of_arm(np.asarray(qpos, float)[None, robot.arm], robot)[0]
    wanted = np.tile(np.eye(4), (len(found), 1, 1))
    wanted[:, :3, :3] = now[:3, :3] @ Rotation.from_rotvec(hands[:, 3:]).as_matrix()
    wanted[:, :3, 3] = now[:3, 3] + hands[:, :3] @ now[:3, :3].T
    for _ in range(_ITERATIONS):
        moves, poses = _arm(robot).jacobian(torch.from_numpy(found), ret_eef_pose=True)
        jacobians, reached = moves.numpy(), poses.numpy()
        turned = jacobians.swapaxes(-1, -2)
        error = pose_error(wanted, reached)[..., None]
        step = turned @ np.linalg.solve(jacobians @ turned + _DAMPING * np.eye(6), error)
        found += np.clip(step[..., 0], -_MOST_RAD, _MOST_RAD)
    return found


def _hand_of_arm(arms: Array, robot: Robot) -> Array:
    """Return (N, 4, 4) hand poses of postures (N, A) in the base frame."""
    return np.asarray(_arm(robot).forward_kinematics(torch.from_numpy(arms)).get_matrix())


@cache
def _arm(robot: Robot) -> Any:
    """Return pytorch-kinematics' chain from the base to the point between the fingertips, in double precision."""
    build = require("pytorch_kinematics", "learn").build_serial_chain_from_urdf
    urdf = robot_urdf(robot, visual=False).read_bytes()
    return build(urdf, robot.tip_link, root_link_name=mount_link(robot)).to(dtype=torch.float64)
