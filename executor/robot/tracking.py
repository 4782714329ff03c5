"""Straight hand motions with the arm alone, by damped least squares on the Jacobians of all waypoints at once.

All waypoints of a line are solved at once, each from the posture at the start of the line: a batch of thirty costs
little more than a single pose, and short lines stay on one branch, which is checked.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from executor.geometry import Array, inverse
from executor.robot.arm_chain import ArmChain
from executor.robot.description import BASE_LINK, TCP_LINK
from executor.robot.kinematics import ARM, Kinematics

POSITION_TOLERANCE_M = 5e-4
ROTATION_TOLERANCE_RAD = 3e-3
BRANCH_JUMP_RAD = 0.35
INSET_RAD = 0.005
DAMPING = 1e-6
AT_LIMIT_RAD = 1e-6
LONGEST_STEP_RAD = 0.2
PATIENCE, PROGRESS = 8, 0.8
"""A line is given up when so many steps have not brought its worst residual below that fraction of what it was."""


class LineTracker:
    """Follows Cartesian lines with the seven arm joints, the base standing still.

    Args:
        urdf: The generated robot description (physics variant).
        kinematics: Limits and base frame.

    Attributes:
        at_limit: Names of the joints that were at a limit where the last line that failed was farthest off.
    """

    def __init__(self, urdf: Path, kinematics: Kinematics) -> None:
        self.at_limit: tuple[str, ...] = ()
        self._chain = ArmChain(urdf, BASE_LINK, TCP_LINK)
        self._kinematics = kinematics
        self._lower = kinematics.arm_lower + INSET_RAD
        self._upper = kinematics.arm_upper - INSET_RAD

    def track(self, q: Array, poses: list[Array], iterations: int = 40) -> tuple[Array | None, float]:
        """Returns the (N, 10) path through the poses and the worst residual in metres.

        Args:
            q: (10,) base and arm where the line starts.
            poses: N hand poses T_world_eef, each near the one before.
            iterations: Upper bound of Newton steps.

        Returns:
            The path, or None when a pose cannot be reached within the joint limits or only on another branch; and the
            largest position residual, which tells how far off it was.
        """
        T_base_world = inverse(self._kinematics.base_transform(q[:3]))
        targets = np.stack([T_base_world @ T for T in poses])
        start = q[ARM]
        arm = np.tile(start, (len(poses), 1))
        damping = DAMPING * np.eye(6)
        residual_m = np.inf
        residuals_m: list[float] = []
        for _ in range(iterations):
            reached, jacobian = self._chain.forward_and_jacobian(arm)
            error = _error(targets, reached)
            residual_m = float(np.linalg.norm(error[:, :3], axis=1).max())
            turned_rad = float(np.linalg.norm(error[:, 3:], axis=1).max())
            if residual_m < POSITION_TOLERANCE_M and turned_rad < ROTATION_TOLERANCE_RAD:
                path = np.concatenate([start[None], arm])
                if np.abs(np.diff(path, axis=0)).max() > BRANCH_JUMP_RAD:
                    return None, residual_m
                return np.concatenate([np.tile(q[:3], (len(poses), 1)), arm], axis=1), residual_m
            residuals_m.append(residual_m)
            if len(residuals_m) > PATIENCE and residual_m > PROGRESS * residuals_m[-1 - PATIENCE]:
                break
            transposed = jacobian.transpose(0, 2, 1)
            step = (transposed @ np.linalg.solve(jacobian @ transposed + damping, error[:, :, None]))[:, :, 0]
            arm = np.clip(arm + np.clip(step, -LONGEST_STEP_RAD, LONGEST_STEP_RAD), self._lower, self._upper)
        worst = arm[int(np.linalg.norm(_error(targets, self._chain.forward(arm))[:, :3], axis=1).argmax())]
        held = np.minimum(worst - self._lower, self._upper - worst) < AT_LIMIT_RAD
        self.at_limit = tuple(f"panda_joint{index + 1}" for index in np.flatnonzero(held))
        return None, residual_m


def _error(targets: Array, reached: Array) -> Array:
    """Returns (N, 6): position error and rotation error as a rotation vector, in the base frame."""
    E = targets[:, :3, :3] @ reached[:, :3, :3].transpose(0, 2, 1)
    axis = 0.5 * np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], axis=1)
    sine = np.maximum(np.linalg.norm(axis, axis=1), 1e-12)
    cosine = 0.5 * (np.trace(E, axis1=1, axis2=2) - 1.0)
    angle = np.arctan2(sine, cosine)
    return np.concatenate([targets[:, :3, 3] - reached[:, :3, 3], axis * (angle / sine)[:, None]], axis=1)
