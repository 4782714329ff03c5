"""Actions as a policy foretells them: several in a row, as seen from where the robot is when it decides.

A chunk of joint targets is (H, 11): base x, y (m) and yaw (rad) as seen from the base where it stands, seven arm joints
less what they are (rad), and how far each finger is from the middle (m); where the hand is foretold too, 6 more
(`hands.py`). A chunk of hand actions is (H, 10), as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from executor.policies.features import Numbers
from executor.policies.hands import HAND_NUMBERS as HAND_POSE_NUMBERS
from executor.policies.hands import arms_put_right
from executor.policies.settings import Acts
from executor.robot.actions import HAND_NUMBERS, joint_limits
from oag.model.scenefile import FULL_SCALE, PAPER_SCALE

TARGET_NUMBERS = 11


def numbers_each(acts: Acts) -> int:
    """Returns how many numbers an action has in a chunk."""
    if acts.kind == "paper":
        return HAND_NUMBERS
    return TARGET_NUMBERS + (HAND_POSE_NUMBERS if acts.hand else 0)


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
