"""Forward kinematics and Jacobians of the arm for many postures at once, with arrays alone.

A line of thirty hand poses needs thirty Jacobians for every Newton step. Written out for a chain of turning joints they
cost a tenth of a millisecond together.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from executor.geometry import Array, transform


class ArmChain:
    """The turning joints between two links of a robot description.

    Args:
        urdf: The description.
        base: Link whose frame the poses are in.
        tip: Link whose pose is asked for; fixed joints in between are folded in.

    Raises:
        ValueError: The description has no chain between the two, or one with a sliding joint.
    """

    def __init__(self, urdf: Path, base: str, tip: str) -> None:
        joints = {_name(joint, "child"): joint for joint in ET.parse(urdf).getroot().findall("joint")}
        path: list[ET.Element] = []
        link = tip
        while link != base:
            if link not in joints:
                raise ValueError(f"{urdf.name} has no joints from {base} to {tip}: nothing leads to {link}")
            path.append(joints[link])
            link = _name(joints[link], "parent")
        fixed = np.eye(4)
        steps: list[tuple[Array, Array, Array, Array]] = []
        for joint in reversed(path):
            fixed = fixed @ _origin(joint)
            if joint.get("type") == "fixed":
                continue
            if joint.get("type") not in ("revolute", "continuous"):
                raise ValueError(f"joint {joint.get('name')} is {joint.get('type')}, not one that turns")
            x, y, z = axis = _numbers(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
            K = np.zeros((4, 4))
            K[:3, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
            # A turn by q after the fixed part is F + sin(q) F K + (1 - cos(q)) F K^2.
            steps.append((fixed, fixed @ K, fixed @ K @ K, np.array(axis)))
            fixed = np.eye(4)
        self._steps = steps
        self._tip = fixed

    @property
    def joints(self) -> int:
        """How many joints turn."""
        return len(self._steps)

    def forward(self, arms: Array) -> Array:
        """Returns (N, 4, 4) poses of the tip for postures (N, J)."""
        return self._frames(arms)[-1]

    def forward_and_jacobian(self, arms: Array) -> tuple[Array, Array]:
        """Returns (N, 4, 4) poses of the tip and (N, 6, J) Jacobians for postures (N, J).

        Rows of a Jacobian are the tip's velocity and angular velocity, in the base's axes.
        """
        frames = self._frames(arms)
        tip = frames[-1]
        axes = np.stack([T[:, :3, :3] @ step[3] for T, step in zip(frames, self._steps, strict=False)], axis=2)
        arm_to_tip = np.stack([tip[:, :3, 3] - T[:, :3, 3] for T in frames[:-1]], axis=2)
        # np.cross moves axes about, which costs more than the products.
        x, y, z = axes[:, 0], axes[:, 1], axes[:, 2]
        u, v, w = arm_to_tip[:, 0], arm_to_tip[:, 1], arm_to_tip[:, 2]
        return tip, np.stack([y * w - z * v, z * u - x * w, x * v - y * u, x, y, z], axis=1)

    def _frames(self, arms: Array) -> list[Array]:
        """Returns the frames after each joint (N, 4, 4), and the tip's last."""
        sines, cosines = np.sin(arms)[:, :, None, None], 1.0 - np.cos(arms)[:, :, None, None]
        T = np.broadcast_to(np.eye(4), (len(arms), 4, 4))
        frames = []
        for j, (F, FK, FKK, _) in enumerate(self._steps):
            T = T @ (F + sines[:, j] * FK + cosines[:, j] * FKK)
            frames.append(T)
        return [*frames, T @ self._tip]


def _name(joint: ET.Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")


def _origin(joint: ET.Element) -> Array:
    origin = joint.find("origin")
    turn = Rotation.from_euler("xyz", _numbers(origin, "rpy", (0.0, 0.0, 0.0))).as_matrix()
    return transform(turn, _numbers(origin, "xyz", (0.0, 0.0, 0.0)))


def _numbers(element: ET.Element | None, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    text = None if element is None else element.get(key)
    return default if text is None else tuple(float(value) for value in text.split())
