"""Where the hand is to be, foretold beside the arm's joints, and the joints put right by it.

Seven joints that are foretold one by one put a hand centimetres off where each posture is new, as in rooms that are
drawn; how a hand moves as seen from itself hardly depends on the posture. So the joints that are foretold say where the
elbow is, and the hand's motion says where the hand is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.geometry import Array
from executor.robot.actions import arm_chain
from executor.robot.tracking import pose_error

HAND_NUMBERS = 6

_ARM = slice(3, 10)
_DAMPING = 1e-4  # m and rad squared: where the arm is stretched out, elbows stay where they were foretold.
_ITERATIONS = 3
_MOST_RAD = 0.2
"""How far a step puts a joint right."""


def hand_poses(joints: NDArray, scale: float) -> NDArray[np.float32]:
    """Returns (N, 4, 4) the hand from the base.

    Args:
        joints: (N, 12) joint positions or targets.
        scale: The robot's, of a Panda's full size.
    """
    return np.asarray(arm_chain(scale).forward(np.asarray(joints[:, _ARM], float)), np.float32)


def hands_from_here(now: NDArray, later: NDArray) -> NDArray[np.float32]:
    """Returns (N, HAND_NUMBERS) where hands are to be, as seen from where each is: m, and rotation vectors in rad.

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
        hands: (H, HAND_NUMBERS) as `hands_from_here` has them.
        scale: The robot's, of a Panda's full size.
    """
    chain, found = arm_chain(scale), np.array(arms, float)
    now = chain.forward(np.asarray(qpos, float)[None, _ARM])[0]
    wanted = np.tile(np.eye(4), (len(found), 1, 1))
    wanted[:, :3, :3] = now[:3, :3] @ Rotation.from_rotvec(hands[:, 3:]).as_matrix()
    wanted[:, :3, 3] = now[:3, 3] + hands[:, :3] @ now[:3, :3].T
    for _ in range(_ITERATIONS):
        reached, jacobians = chain.forward_and_jacobian(found)
        turned = jacobians.swapaxes(-1, -2)
        error = pose_error(wanted, reached)[..., None]
        step = turned @ np.linalg.solve(jacobians @ turned + _DAMPING * np.eye(6), error)
        found += np.clip(step[..., 0], -_MOST_RAD, _MOST_RAD)
    return found
