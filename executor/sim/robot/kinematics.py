"""Kinematics of the arm on its base: inverse kinematics, straight hand motions, and batched Jacobians.

`Kinematics` uses SAPIEN's rigid-body model. The base is planar and holonomic, and its frame goes up with a lift. So a
hand pose is solved in the base's frame: the answer for one base pose is the answer for all. Random restarts filter by
joint limits, which the solver itself ignores.

`LineTracker` follows a line with the arm alone, by damped least squares on the Jacobians of all waypoints at once. Each
waypoint starts from the posture at the start of the line. A batch of thirty costs little more than a single pose, and
short lines stay on one branch, which is checked.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from executor.geometry import Array, inverse, quaternion_wxyz, rotation_z, transform
from executor.sim.robot.description import drives, mount_link, robot_urdf
from executor.system.effort import LINE_STEP_S, POSTURE_S, Effort
from executor.system.extras import load_sapien
from oag.model.robots import Robot

IK_ITERATIONS = 100
IK_TOLERANCE = 1e-4


@dataclass(frozen=True, slots=True)
class ArmSolution:
    """One arm posture for a hand pose.

    Attributes:
        margin_rad: Distance of the nearest joint to its limit.
    """

    arm: Array
    margin_rad: float


class Kinematics:
    """FK and IK for one robot articulation.

    Args:
        articulation: The SAPIEN articulation of `executor.sim.robot.description`.
        seed: Seed of the restarts, so that equal queries get equal answers.
    """

    def __init__(self, articulation: Any, robot: Robot, seed: int = 0) -> None:
        self.robot = robot
        self._model = articulation.create_pinocchio_model()
        names = [link.name for link in articulation.links]
        self._eef = names.index(robot.tip_link)
        limits = np.asarray(articulation.get_qlimits(), dtype=float)
        self.lower, self.upper = limits[: robot.movers, 0], limits[: robot.movers, 1]
        self.arm_lower, self.arm_upper = self.lower[robot.arm], self.upper[robot.arm]
        self.finger_upper_m = float(limits[robot.movers, 1])
        self._mask = np.zeros(len(limits), dtype=np.int32)
        self._mask[robot.arm] = 1
        self._rng = np.random.default_rng(seed)
        self.effort = Effort()

    def reseed(self, seed: int | list[int]) -> None:
        """Restart the random restarts, at a subtask boundary for instance."""
        self._rng = np.random.default_rng(seed)

    def base_transform(self, base: Array) -> Array:
        """Return the (4, 4) pose of the base for its coordinates (B,): x, y, yaw, and the lift as a height."""
        return transform(rotation_z(float(base[2])), [base[0], base[1], base[3] if len(base) > 3 else 0.0])

    def forward(self, q: Array) -> Array:
        """Return T_world_eef (4, 4) for base and arm positions q."""
        full = np.zeros(len(self._mask))
        full[: self.robot.movers] = q[: self.robot.movers]
        self._model.compute_forward_kinematics(full)
        return np.asarray(self._model.get_link_pose(self._eef).to_transformation_matrix(), dtype=float)

    def margin(self, arms: Array) -> float:
        """Return the distance in rad of the nearest joint to its limit over postures (..., A)."""
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
        """Return distinct arm postures that put the hand at a pose, best joint margin first.

        Args:
            T_world_eef: (4, 4) wanted hand pose.
            base: (B,) the base's coordinates.
            near: (A,) posture to start from first; the home posture by default.
            restarts: How many starting points to try.
            minimum_margin_rad: Postures nearer than this to a joint limit are left out.
            enough: After how many postures to stop; all that the restarts find by default.
        """
        sapien = load_sapien()

        T_base_eef = inverse(self.base_transform(base)) @ T_world_eef
        target = sapien.Pose(T_base_eef[:3, 3], quaternion_wxyz(T_base_eef))
        arm_joints, home = self.robot.arm, np.array(self.robot.home)
        start = np.zeros(len(self._mask))
        found: list[ArmSolution] = []
        for attempt in range(restarts):
            self.effort.add(POSTURE_S)
            if attempt == 0:
                start[arm_joints] = home if near is None else near
            elif attempt % 2:
                start[arm_joints] = home + self._rng.normal(0.0, 0.5, len(home))
            else:
                start[arm_joints] = self._rng.uniform(self.arm_lower, self.arm_upper)
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
            arm = np.array(q[arm_joints], dtype=float)
            margin = self.margin(arm)
            if margin < minimum_margin_rad or any(np.abs(arm - s.arm).max() < 0.05 for s in found):
                continue
            found.append(ArmSolution(arm, margin))
            if len(found) == enough:
                break
        return sorted(found, key=lambda s: -s.margin_rad)


POSITION_TOLERANCE_M = 5e-4
ROTATION_TOLERANCE_RAD = 3e-3
BRANCH_JUMP_RAD = 0.35  # A joint that moves further between two waypoints is on another branch.
INSET_RAD = 0.005  # Lines end so far before a limit.
DAMPING = 1e-6
AT_LIMIT_RAD = 1e-6
LONGEST_STEP_RAD = 0.2
PATIENCE, PROGRESS = 8, 0.8
"""A line is given up when so many steps have not brought its worst residual below that fraction of what it was."""


class LineTracker:
    """Follows Cartesian lines with the arm's joints, the base standing still.

    Args:
        kinematics: The robot's limits and base frame.

    Attributes:
        at_limit: Names of the joints that were at a limit where the last line that failed was farthest off.
    """

    def __init__(self, kinematics: Kinematics) -> None:
        robot = self._robot = kinematics.robot
        self.at_limit: tuple[str, ...] = ()
        self._chain = ArmChain(robot_urdf(robot, visual=False), mount_link(robot), robot.tip_link)
        self._torques_nm = np.array([force_limit for _, _, force_limit in drives(robot)[robot.arm]])
        self._kinematics = kinematics
        self._lower = kinematics.arm_lower + INSET_RAD
        self._upper = kinematics.arm_upper - INSET_RAD

    def load(self, path: Array, forces_n: Array) -> Array:
        """Return (N,) the largest share of torque that any arm joint needs to press with a force.

        Args:
            path: (N, Q) base and arm.
            forces_n: (N, 3) the pressing force in the world, at the point between the fingertips.
        """
        turns = Rotation.from_euler("z", path[:, [2]])
        jacobians = self._chain.forward_and_jacobian(path[:, self._robot.arm])[1]
        torques = np.einsum("nij,ni->nj", jacobians[:, :3], turns.inv().apply(forces_n))
        return np.asarray(np.abs(torques / self._torques_nm).max(axis=1))

    def track(self, q: Array, poses: list[Array], iterations: int = 40) -> tuple[Array | None, float]:
        """Return the (N, Q) path through the poses and the worst residual [m].

        Args:
            q: (Q,) base and arm where the line starts.
            poses: N hand poses T_world_eef, each near the one before.
            iterations: Upper bound of Newton steps.

        Returns:
            The path, or None when a pose cannot be reached within the joint limits or only on another branch; and the
                largest position residual.
        """
        T_base_world = inverse(self._kinematics.base_transform(q[self._robot.base]))
        targets = np.stack([T_base_world @ T for T in poses])
        start = q[self._robot.arm]
        arm = np.tile(start, (len(poses), 1))
        damping = DAMPING * np.eye(6)
        residual_m = np.inf
        residuals_m: list[float] = []
        for _ in range(iterations):
            self._kinematics.effort.add(LINE_STEP_S)
            reached, jacobian = self._chain.forward_and_jacobian(arm)
            error = pose_error(targets, reached)
            residual_m = float(np.linalg.norm(error[:, :3], axis=1).max())
            turned_rad = float(np.linalg.norm(error[:, 3:], axis=1).max())
            if residual_m < POSITION_TOLERANCE_M and turned_rad < ROTATION_TOLERANCE_RAD:
                path = np.concatenate([start[None], arm])
                if np.abs(np.diff(path, axis=0)).max() > BRANCH_JUMP_RAD:
                    return None, residual_m
                return np.concatenate([np.tile(q[self._robot.base], (len(poses), 1)), arm], axis=1), residual_m
            residuals_m.append(residual_m)
            if len(residuals_m) > PATIENCE and residual_m > PROGRESS * residuals_m[-1 - PATIENCE]:
                break
            transposed = jacobian.transpose(0, 2, 1)
            step = (transposed @ np.linalg.solve(jacobian @ transposed + damping, error[:, :, None]))[:, :, 0]
            arm = np.clip(arm + np.clip(step, -LONGEST_STEP_RAD, LONGEST_STEP_RAD), self._lower, self._upper)
        worst = arm[int(np.linalg.norm(pose_error(targets, self._chain.forward(arm))[:, :3], axis=1).argmax())]
        held = np.minimum(worst - self._lower, self._upper - worst) < AT_LIMIT_RAD
        self.at_limit = tuple(self._robot.arm_joints[index] for index in np.flatnonzero(held))
        return None, residual_m


def pose_error(targets: Array, reached: Array) -> Array:
    """Return (N, 6) errors of poses (N, 4, 4) against targets: [m], and a rotation vector [rad], in the base's axes."""
    E = targets[:, :3, :3] @ reached[:, :3, :3].transpose(0, 2, 1)
    axis = 0.5 * np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], axis=1)
    sine = np.maximum(np.linalg.norm(axis, axis=1), 1e-12)
    cosine = 0.5 * (np.trace(E, axis1=1, axis2=2) - 1.0)
    angle = np.arctan2(sine, cosine)
    return np.concatenate([targets[:, :3, 3] - reached[:, :3, 3], axis * (angle / sine)[:, None]], axis=1)


class ArmChain:
    """The turning joints between two links of a robot description, for many postures at once.

    A line of thirty hand poses needs thirty Jacobians for every Newton step. Written out for a chain of turning joints
    they cost a tenth of a millisecond together.

    Args:
        urdf: The description.
        base: Link whose frame the poses are in.
        tip: Link whose pose is asked for; fixed joints in between are folded in.

    Raises:
        ValueError: The description has no chain between the two, or one with a sliding joint.
    """

    def __init__(self, urdf: Path, base: str, tip: str) -> None:
        joints = {end_of(joint, "child"): joint for joint in ET.parse(urdf).getroot().findall("joint")}
        path: list[ET.Element] = []
        link = tip
        while link != base:
            if link not in joints:
                raise ValueError(f"{urdf.name} has no joints from {base} to {tip}: nothing leads to {link}")
            path.append(joints[link])
            link = end_of(joints[link], "parent")
        fixed = np.eye(4)
        steps: list[tuple[Array, Array, Array]] = []
        axes: list[tuple[float, ...]] = []
        for joint in reversed(path):
            fixed = fixed @ origin_of(joint)
            if joint.get("type") == "fixed":
                continue
            if joint.get("type") not in ("revolute", "continuous"):
                raise ValueError(f"joint {joint.get('name')} is {joint.get('type')}, not one that turns")
            x, y, z = axis = numbers_of(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
            K = np.zeros((4, 4))
            K[:3, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
            # A turn by q after the fixed part is F + sin(q) F K + (1 - cos(q)) F K^2.
            steps.append((fixed, fixed @ K, fixed @ K @ K))
            axes.append(axis)
            fixed = np.eye(4)
        self._fixed, self._turned, self._turned_twice = np.array(steps).transpose(1, 0, 2, 3)[:, :, None]
        self._axes, self._tip = np.array(axes), fixed

    def forward(self, arms: Array) -> Array:
        """Return (N, 4, 4) poses of the tip for postures (N, J)."""
        return self.frames(arms)[-1]

    def forward_and_jacobian(self, arms: Array) -> tuple[Array, Array]:
        """Return (N, 4, 4) poses of the tip and (N, 6, J) Jacobians for postures (N, J)."""
        frames = self.frames(arms)
        return frames[-1], self.jacobian(frames)

    def frames(self, arms: Array) -> Array:
        """Return (J + 1, N, 4, 4) frames for postures (N, J): what each joint turns, which is a link, then the tip."""
        sines, cosines = np.sin(arms).T[:, :, None, None], (1.0 - np.cos(arms)).T[:, :, None, None]
        turns = self._fixed + sines * self._turned + cosines * self._turned_twice
        found = np.empty((len(turns) + 1, *turns.shape[1:]))
        T = found[0] = turns[0]
        for j in range(1, len(turns)):
            T = np.matmul(T, turns[j], out=found[j])
        np.matmul(T, self._tip, out=found[-1])
        return found

    def jacobian(self, frames: Array) -> Array:
        """Return (N, 6, J) Jacobians at postures whose `frames` these are.

        Rows are the tip's velocity and angular velocity, in the base's axes.
        """
        # (3, N, J) each; np.cross moves axes about, which costs more than the products.
        x, y, z = (frames[:-1, :, :3, :3] @ self._axes[:, None, :, None])[..., 0].transpose(2, 1, 0)
        u, v, w = (frames[-1, None, :, :3, 3] - frames[:-1, :, :3, 3]).transpose(2, 1, 0)
        return np.stack([y * w - z * v, z * u - x * w, x * v - y * u, x, y, z], axis=1)


def end_of(joint: ET.Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")


def origin_of(joint: ET.Element) -> Array:
    origin = joint.find("origin")
    turn = Rotation.from_euler("xyz", numbers_of(origin, "rpy", (0.0, 0.0, 0.0))).as_matrix()
    return transform(turn, numbers_of(origin, "xyz", (0.0, 0.0, 0.0)))


def numbers_of(element: ET.Element | None, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    text = None if element is None else element.get(key)
    return default if text is None else tuple(float(value) for value in text.split())
