"""Where the elbow goes while the hand keeps its way: off what is near, off the joints' limits, and else towards home.

With the hand where it is wanted, one motion of the arm's seven joints is left, and this says how far along it the arm
shall go next: the weighted mean of what three kinds of wish ask for. Each link between shoulder and hand is to keep
`CLEAR_M` from everything solid, each joint `SPARE_RAD` from its limits, and where the hand moves the arm is to go
towards home. What is looked at is the present state alone, so that equal episodes have equal elbows.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from executor.envs.obstacles import Obstacles
from executor.geometry import Array, rotation_z
from executor.robot.actions import joint_limits
from executor.robot.description import ARM_HOME, BASE_LINK, robot_urdf
from executor.robot.tracking import ArmChain
from executor.world.engine import pose_matrix
from executor.world.world import World

CLEAR_M = 0.06
"""Hands come on by up to 5 cm an action; an elbow that keeps clear of more goes round to worse places."""

SPARE_RAD = 0.3
"""Beyond this wrists turned into their limits, from where no motion of the elbow leads back."""

LINKS = {"panda_link3": 3, "panda_link4": 4, "panda_link5": 5, "panda_link6": 6}
"""What the elbow's motion moves, with how many joints move it; the last link goes where the hand goes."""

_POINTS = 16  # On each link: 3 to 5 cm apart.
_HOMEWARD = 0.1  # Share of the way home that the elbow goes an action: within a second it is on its side.
_HOME, _SPARE, _CLEAR = 1.0, 4.0, 400.0  # Weights, for rad, rad and m, squared: 5 cm are worth a radian.
_LONGEST_RAD = 0.2  # As far as one action moves a joint.
_ARM = slice(3, 10)


class Elbow:
    """What the elbow of one world's robot is to do.

    Args:
        world: Where it stands.
    """

    def __init__(self, world: World) -> None:
        urdf = robot_urdf(world.scene.robot.scale, visual=False)
        self._limits = joint_limits(world.scene.robot.scale)[_ARM]
        self._obstacles = Obstacles(world)
        # From link to link: each joint is gone through once.
        self._chains = [ArmChain(urdf, *ends) for ends in pairwise((BASE_LINK, *LINKS))]
        points = [_points(world, link) for link in LINKS]
        self._points, self._ends = points, np.cumsum([len(own) for own in points])[:-1]
        self._moved_by = np.concatenate([np.full(len(own), k) for own, k in zip(points, LINKS.values(), strict=True)])

    def wish(self, base: Array, arm: Array, hand_m: Array, jacobian: Array, *, homeward: bool) -> Array:
        """Returns the (7,) change of posture, rad, that leaves the hand where it is.

        Args:
            base: (3,) x, y [m] and yaw [rad] of the base.
            arm: (7,) the posture, rad.
            hand_m: (3,) where the hand is then, seen from the base.
            jacobian: (6, 7) how it moves and turns with the joints, in the base's axes.
            homeward: Whether the arm shall go home, where nothing is in the way.
        """
        way = np.linalg.svd(jacobian)[2][-1]
        home = _HOMEWARD * float(way @ (np.array(ARM_HOME) - arm)) if homeward else 0.0
        cleared = self._cleared(base, arm, hand_m, jacobian * way)
        weight, rate, wanted = np.array([(_HOME, 1.0, home), *self._spared(arm, way), *cleared]).T
        step = float((weight * rate * wanted).sum() / (weight * rate * rate).sum())
        return np.asarray(np.clip(step, -_LONGEST_RAD, _LONGEST_RAD) * way)

    def _cleared(self, base: Array, arm: Array, hand_m: Array, speeds: Array) -> Iterator[tuple[float, float, float]]:
        """Yields weight, growth a step along the way, and wanted growth of each link's gap that is too small, m.

        Args:
            base, arm, hand_m: As for `wish`.
            speeds: (6, 7) what each joint does to the hand in a step along the way.
        """
        T, placed, first = np.eye(4), [], 0
        for chain, points, joints in zip(self._chains, self._points, LINKS.values(), strict=True):
            T, first = T @ chain.forward(arm[None, first:joints])[0], joints
            placed.append(points @ T[:3, :3].T + T[:3, 3])
        R, points = rotation_z(float(base[2])), np.concatenate(placed)
        gaps = self._obstacles.nearest(points @ R.T + [base[0], base[1], 0.0], CLEAR_M)
        for own in np.split(np.arange(len(points)), self._ends):
            nearest = own[int(gaps.distance_m[own].argmin())]
            if (gap_m := float(gaps.distance_m[nearest])) < CLEAR_M:
                # As the hand would move if it were there, by the joints before that link.
                move, turn = speeds[:, : self._moved_by[nearest]].sum(axis=1).reshape(2, 3)
                speed = R @ (move + np.cross(turn, points[nearest] - hand_m))
                yield _CLEAR, float(speed @ gaps.away[nearest]), CLEAR_M - gap_m

    def _spared(self, arm: Array, way: Array) -> Iterator[tuple[float, float, float]]:
        """Yields weight, growth and wanted growth of the room of joints that are near a limit, rad."""
        low, high = self._limits.T
        for room, sign in ((arm - low, 1.0), (high - arm, -1.0)):
            for joint in np.flatnonzero(room < SPARE_RAD):
                yield _SPARE, sign * float(way[joint]), SPARE_RAD - float(room[joint])


def _points(world: World, link: str) -> Array:
    """Returns (N, 3) corners of what collides of a link of the robot, in its frame, each far from the others."""
    meshes = [shape for shape in world.robot.find_link_by_name(link).collision_shapes if hasattr(shape, "vertices")]
    placed = [(np.asarray(mesh.vertices) * np.asarray(mesh.scale), pose_matrix(mesh.local_pose)) for mesh in meshes]
    corners = np.concatenate([points @ T[:3, :3].T + T[:3, 3] for points, T in placed])
    chosen, gap_m = [0], np.linalg.norm(corners - corners[0], axis=1)
    while len(chosen) < min(_POINTS, len(corners)):
        chosen.append(int(gap_m.argmax()))
        gap_m = np.minimum(gap_m, np.linalg.norm(corners - corners[chosen[-1]], axis=1))
    return np.asarray(corners[chosen])
