"""Actions as a policy foretells them: several in a row, as seen from where the robot is when it decides.

A chunk of joint targets is (H, 11): base x, y (m) and yaw (rad) as seen from the base where it stands, seven arm joints
less what they are (rad), and how far each finger is from the middle (m). Where a policy also foretells the hand there
are nine numbers more: where the point between the fingertips shall be (m) and the first two axes of the hand, as seen
from the hand where it is. A millimetre beside a thing is a simple function of where the hand is from it, and a crooked
one of seven joints; so the joints say which posture, and the hand where it ends. A chunk of hand actions is (H, 10), as
it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.geometry import Array, inverse
from executor.policies.features import Numbers
from executor.policies.settings import Acts
from executor.robot.actions import HAND_NUMBERS, arm_chain, joint_limits
from oag.model.scenefile import FULL_SCALE

TARGET_NUMBERS, POSE_NUMBERS = 11, 9

FOLLOWS_RAD = 0.15
"""How far any joint goes from the posture that was foretold, for the hand to be where it was: some 5 cm of hand. What
asks for more is no matter of precision."""

_ARM = slice(3, 10)
_DAMPING = 1e-4  # m and rad squared: near a singular posture a millimetre is not worth a radian.
_ITERATIONS = 3  # After two the hand is within 0.1 mm.


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


def targets_in_the_room(qpos: NDArray, chunk: NDArray) -> NDArray[np.float64]:
    """Returns the (H, 12) joint targets, within the joints' limits, of a chunk that was foretold at a posture.

    Args:
        qpos: (12,) joint positions.
        chunk: (H, 11).
    """
    cosine, sine = np.cos(qpos[2]), np.sin(qpos[2])
    ahead = np.array(chunk[:, :10], dtype=float)
    x, y = ahead[:, 0].copy(), ahead[:, 1].copy()
    ahead[:, 0], ahead[:, 1] = cosine * x - sine * y, sine * x + cosine * y
    fingers = np.repeat(chunk[:, 10:11], 2, axis=1)
    # The environment cuts what a smaller hand cannot do.
    low, high = joint_limits(FULL_SCALE).T
    return np.clip(np.concatenate([ahead + qpos[:10], fingers], axis=1), low, high)


def hand_poses(scale: float, joints: NDArray) -> Array:
    """Returns (N, 4, 4) where joints have the hand in the world.

    Args:
        scale: The robot's, of a Panda's full size.
        joints: (N, 12) joint positions or targets.
    """
    joints = np.asarray(joints, float)
    return np.asarray(_base_poses(joints) @ arm_chain(scale).forward(joints[:, _ARM]))


def strayed(scale: float, agents: NDArray, offsets: NDArray) -> NDArray[np.float64]:
    """Returns (N, AGENT) robots as they are observed, their bases and arms somewhere else.

    Args:
        scale: The robot's, of a Panda's full size.
        agents: (N, AGENT) robots (`executor.datasets.formats.observations`).
        offsets: (N, 10) by how much base and arm are off, m and rad.
    """
    found = np.array(agents, float)
    found[:, :10] += offsets
    hands = hand_poses(scale, found[:, :12])
    found[:, 12:15] = hands[:, :3, 3]
    found[:, 15:19] = Rotation.from_matrix(hands[:, :3, :3]).as_quat(canonical=True)
    return found


def poses_from_here(here: NDArray, poses: NDArray) -> Numbers:
    """Returns (N, H, 9): hand poses as seen from where the hand is.

    Args:
        here: (N, 4, 4) the hand in the world.
        poses: (N, H, 4, 4) where it shall be.
    """
    back = here[:, None, :3, :3].swapaxes(-1, -2)
    moved = (back @ (poses[..., :3, 3] - here[:, None, :3, 3])[..., None])[..., 0]
    axes = (back @ poses[..., :3, :3])[..., :2]
    return np.concatenate([moved, axes.reshape(*axes.shape[:-2], 6)], axis=-1, dtype=np.float32)


def poses_in_the_room(here: Array, numbers: NDArray) -> Array:
    """Returns the (H, 4, 4) hand poses of numbers (H, 9) that were foretold with the hand at a pose (4, 4)."""
    axes = np.asarray(numbers[:, 3:], float).reshape(-1, 3, 2)
    first = axes[..., 0] / np.linalg.norm(axes[..., 0], axis=-1, keepdims=True)
    second = axes[..., 1] - (axes[..., 1] * first).sum(axis=-1, keepdims=True) * first
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    seen = np.tile(np.eye(4), (len(numbers), 1, 1))
    seen[:, :3, :3] = np.stack([first, second, np.cross(first, second)], axis=-1)
    seen[:, :3, 3] = numbers[:, :3]
    return np.asarray(here @ seen)


def with_the_hand_at(scale: float, targets: Array, poses: Array) -> Array:
    """Returns the (H, 12) joint targets near others that have the hand where it shall be, the base as it was.

    Args:
        scale: The robot's, of a Panda's full size.
        targets: (H, 12) joint targets.
        poses: (H, 4, 4) where the hand shall be in the world.
    """
    low, high = joint_limits(scale)[_ARM].T
    begun = targets[:, _ARM]
    low, high = np.maximum(low, begun - FOLLOWS_RAD), np.minimum(high, begun + FOLLOWS_RAD)
    wanted = np.stack([inverse(base) for base in _base_poses(targets)]) @ poses
    arm = begun
    for _ in range(_ITERATIONS):
        reached, jacobian = arm_chain(scale).forward_and_jacobian(arm)
        turn = Rotation.from_matrix(wanted[:, :3, :3] @ reached[:, :3, :3].swapaxes(-1, -2)).as_rotvec()
        error = np.concatenate([wanted[:, :3, 3] - reached[:, :3, 3], turn], axis=1)[..., None]
        transposed = jacobian.swapaxes(-1, -2)
        step = transposed @ np.linalg.solve(jacobian @ transposed + _DAMPING * np.eye(6), error)
        arm = np.clip(arm + step[..., 0], low, high)
    return np.concatenate([targets[:, :3], arm, targets[:, 10:]], axis=1)


def _base_poses(joints: NDArray) -> Array:
    """Returns (N, 4, 4) where joints have the base in the world."""
    poses = np.tile(np.eye(4), (len(joints), 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("z", joints[:, 2:3]).as_matrix()
    poses[:, :2, 3] = joints[:, :2]
    return poses
