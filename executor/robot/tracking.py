"""Straight hand motions with the arm alone, by damped least squares on pytorch-kinematics' batched Jacobians.

All waypoints of a line are solved at once, each from the posture at the start of the line: a batch of thirty costs
little more than a single pose, and short lines stay on one branch, which is checked.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from executor.geometry import Array, inverse
from executor.robot.description import TCP_LINK
from executor.robot.kinematics import ARM, Kinematics

POSITION_TOLERANCE_M = 5e-4
ROTATION_TOLERANCE_RAD = 3e-3
BRANCH_JUMP_RAD = 0.35


class LineTracker:
    """Follows Cartesian lines with the seven arm joints, the base standing still.

    Args:
        urdf: The generated robot description (physics variant).
        kinematics: Limits and base frame.
    """

    def __init__(self, urdf: Path, kinematics: Kinematics) -> None:
        import pytorch_kinematics as pk
        import torch

        torch.set_num_threads(1)
        text = re.sub(r"<(visual|collision)>.*?</\1>", "", urdf.read_text(), flags=re.S)
        chain = pk.build_serial_chain_from_urdf(text.encode(), TCP_LINK, root_link_name="base_body")
        self._chain: Any = chain.to(dtype=torch.float64)
        self._kinematics = kinematics
        self._torch = torch
        self._lower = torch.as_tensor(kinematics.arm_lower + 0.005)
        self._upper = torch.as_tensor(kinematics.arm_upper - 0.005)

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
        torch = self._torch
        T_base_world = inverse(self._kinematics.base_transform(q[:3]))
        targets = torch.as_tensor(np.stack([T_base_world @ T for T in poses]))
        start = torch.as_tensor(q[ARM].copy())
        arm = start.expand(len(poses), 7).clone()
        damping = 1e-6 * torch.eye(6, dtype=torch.float64)
        residual_m = np.inf
        for _ in range(iterations):
            reached = self._chain.forward_kinematics(arm, end_only=True).get_matrix()
            error = self._error(targets, reached)
            position, rotation = error[:, :3].norm(dim=1), error[:, 3:].norm(dim=1)
            residual_m = float(position.max())
            if residual_m < POSITION_TOLERANCE_M and float(rotation.max()) < ROTATION_TOLERANCE_RAD:
                path = np.concatenate([start[None].numpy(), arm.numpy()])
                if np.abs(np.diff(path, axis=0)).max() > BRANCH_JUMP_RAD:
                    return None, residual_m
                return np.concatenate([np.tile(q[:3], (len(poses), 1)), path[1:]], axis=1), residual_m
            jacobian = self._chain.jacobian(arm)
            transposed = jacobian.transpose(1, 2)
            step = transposed @ torch.linalg.solve(jacobian @ transposed + damping, error[:, :, None])
            arm = torch.minimum(torch.maximum(arm + step[:, :, 0].clamp(-0.2, 0.2), self._lower), self._upper)
        return None, residual_m

    def _error(self, targets: Any, reached: Any) -> Any:
        """Returns (N, 6): position error and small-angle rotation error, in the base frame."""
        torch = self._torch
        E = targets[:, :3, :3] @ reached[:, :3, :3].transpose(1, 2)
        axis = 0.5 * torch.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], dim=1)
        sine = axis.norm(dim=1).clamp_min(1e-12)
        cosine = 0.5 * (E.diagonal(dim1=1, dim2=2).sum(1) - 1.0)
        angle = torch.atan2(sine, cosine)
        return torch.cat([targets[:, :3, 3] - reached[:, :3, 3], axis * (angle / sine)[:, None]], dim=1)
