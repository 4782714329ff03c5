"""Forward and inverse kinematics of the arm on its base, through SAPIEN's rigid-body model.

The base is planar and holonomic, so a hand pose is solved in the base's frame: the answer for one base pose is the
answer for all. Random restarts filter by joint limits, which the solver itself ignores.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from executor.geometry import Array, inverse, quaternion_wxyz, rotation_z, transform
from executor.machine.extras import load_sapien
from executor.robot.description import ARM_HOME, TCP_LINK

ARM = slice(3, 10)
DOF = 12
IK_ITERATIONS = 100
IK_TOLERANCE = 1e-4


@dataclass(frozen=True, slots=True)
class ArmSolution:
    """One arm posture for a hand pose.

    Attributes:
        arm: (7,) joint positions in rad.
        margin_rad: Distance of the nearest joint to its limit.
    """

    arm: Array
    margin_rad: float


class Kinematics:
    """FK and IK for one robot articulation.

    Args:
        articulation: The SAPIEN articulation of `executor.robot.description`.
        seed: Seed of the restarts, so that equal questions get equal answers.
    """

    def __init__(self, articulation: Any, seed: int = 0) -> None:
        self._model = articulation.create_pinocchio_model()
        names = [link.name for link in articulation.links]
        self._eef = names.index(TCP_LINK)
        limits = np.asarray(articulation.get_qlimits(), dtype=float)
        self.lower, self.upper = limits[:10, 0], limits[:10, 1]
        self.arm_lower, self.arm_upper = self.lower[ARM], self.upper[ARM]
        self.finger_upper_m = float(limits[10, 1])
        self._mask = np.array([0] * 3 + [1] * 7 + [0] * 2, dtype=np.int32)
        self._rng = np.random.default_rng(seed)

    def reseed(self, seed: int | list[int]) -> None:
        """Restarts the random restarts, at a subtask boundary for instance."""
        self._rng = np.random.default_rng(seed)

    def base_transform(self, base: Array) -> Array:
        """Returns the (4, 4) pose of the base for (x, y, yaw)."""
        return transform(rotation_z(float(base[2])), [base[0], base[1], 0.0])

    def forward(self, q: Array) -> Array:
        """Returns T_world_eef (4, 4) for base and arm positions q (10,)."""
        full = np.zeros(DOF)
        full[:10] = q[:10]
        self._model.compute_forward_kinematics(full)
        return np.asarray(self._model.get_link_pose(self._eef).to_transformation_matrix(), dtype=float)

    def margin(self, arms: Array) -> float:
        """Returns the distance in rad of the nearest joint to its limit over postures (..., 7)."""
        return float(min((arms - self.arm_lower).min(), (self.arm_upper - arms).min()))

    def solve(
        self,
        T_world_eef: Array,
        base: Array,
        *,
        near: Array | None = None,
        restarts: int = 24,
        minimum_margin_rad: float = 0.03,
        enough: int | None = None,
    ) -> list[ArmSolution]:
        """Returns distinct arm postures that put the hand at a pose, best joint margin first.

        Args:
            T_world_eef: (4, 4) wanted hand pose.
            base: (3,) base x, y, yaw.
            near: (7,) posture to start from first; the home posture by default.
            restarts: How many starting points to try.
            minimum_margin_rad: Postures nearer than this to a joint limit are left out.
            enough: After how many postures to stop; all that the restarts find by default.
        """
        sapien = load_sapien()

        T_base_eef = inverse(self.base_transform(base)) @ T_world_eef
        target = sapien.Pose(T_base_eef[:3, 3], quaternion_wxyz(T_base_eef))
        home = np.array(ARM_HOME)
        start = np.zeros(DOF)
        found: list[ArmSolution] = []
        for attempt in range(restarts):
            if attempt == 0:
                start[ARM] = home if near is None else near
            elif attempt % 2:
                start[ARM] = home + self._rng.normal(0.0, 0.5, 7)
            else:
                start[ARM] = self._rng.uniform(self.arm_lower, self.arm_upper)
            q, converged, _ = self._model.compute_inverse_kinematics(
                self._eef,
                target,
                initial_qpos=start,
                active_qmask=self._mask,
                max_iterations=IK_ITERATIONS,
                eps=IK_TOLERANCE,
                dt=0.3,
                damp=1e-6,
            )
            if not converged:
                continue
            arm = np.array(q[ARM], dtype=float)
            margin = self.margin(arm)
            if margin < minimum_margin_rad or any(np.abs(arm - s.arm).max() < 0.05 for s in found):
                continue
            found.append(ArmSolution(arm, margin))
            if len(found) == enough:
                break
        return sorted(found, key=lambda s: -s.margin_rad)
