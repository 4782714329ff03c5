"""Poses of all links of a robot for many configurations at once."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from executor.geometry import Array
from executor.sim.robot.description import robot_urdf
from executor.sim.robot.kinematics import end_of, numbers_of, origin_of
from oag.model.robots import Robot


class LinkFrames:
    """The tree of joints of a robot's description.

    Args:
        robot: Its record.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        joints = {end_of(j, "child"): j for j in ET.parse(robot_urdf(robot, visual=False)).getroot().findall("joint")}
        number = {name: k for k, name in enumerate(robot.joint_names)}
        self._carrier: dict[str, tuple[int, Array]] = {}  # Link -> the joint that moves it, and its pose behind it.
        self._parents: list[tuple[int, int]] = []
        count = len(number)
        self._fixed, self._once, self._twice = np.zeros((3, count, 1, 4, 4))
        self._turns = np.zeros((count, 1), dtype=bool)

        def place(link: str) -> tuple[int, Array]:
            if link not in joints:
                return -1, np.eye(4)
            if link in self._carrier:
                return self._carrier[link]
            joint = joints[link]
            parent, T = place(end_of(joint, "parent"))
            T = T @ origin_of(joint)
            k = number.get(joint.get("name", ""))
            if k is None:
                self._carrier[link] = parent, T
                return self._carrier[link]
            x, y, z = numbers_of(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
            K = np.zeros((4, 4))
            self._turns[k] = joint.get("type") != "prismatic"
            if self._turns[k]:
                # A turn by q is F + sin(q) F K + (1 - cos(q)) F K^2.
                K[:3, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
            else:
                K[:3, 3] = x, y, z
            self._fixed[k, 0], self._once[k, 0], self._twice[k, 0] = T, T @ K, T @ K @ K
            self._parents.append((k, parent))
            self._carrier[link] = k, np.eye(4)
            return self._carrier[link]

        for link in joints:
            place(link)

    def at(self, path: Array, opening_m: float, links: Sequence[str]) -> tuple[Array, Array]:
        """Return poses in the world for configurations (N, Q): of some links (L, N, 4, 4), and of the hand (N, 4, 4).

        Args:
            path: (N, Q) base and arm.
            opening_m: Position of each finger.
            links: The links' names.
        """
        movers = self._robot.movers
        q = np.concatenate([path[:, :movers].T, np.full((2, len(path)), opening_m)])
        once = np.where(self._turns, np.sin(q), q)[:, :, None, None]
        twice = np.where(self._turns, 1.0 - np.cos(q), 0.0)[:, :, None, None]
        T = self._fixed + once * self._once + twice * self._twice
        for k, parent in self._parents:
            if parent >= 0:
                T[k] = T[parent] @ T[k]
        carriers = [self._carrier[link] for link in (*links, self._robot.tip_link)]
        behind = np.stack([behind for _, behind in carriers])
        found = T[[k for k, _ in carriers]] @ behind[:, None]
        return found[:-1], found[-1]
