"""Where the elbow goes while the hand keeps its way: off what is near, off the joints' limits, and else towards home.

With the hand where it is wanted, one motion of the arm's seven joints is left, and this says how far along it the arm
shall go next. Where nothing is near, that is a little towards home. Else all postures that hold the hand are gone
through to either side, for the hand as it is and as it will be soon, and the one is made for that costs least: each
link between shoulder and hand is to keep `CLEAR_M` from everything solid, each joint `SPARE_RAD` from its limits, and
the elbow is to go no farther than that is worth. A slope alone would not do: over a table the forearm has room on one
side or the other, and seldom in between. What is looked at is the present state and the present action, so that equal
episodes have equal elbows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from executor.envs.obstacles import Obstacles
from executor.geometry import Array, rotation_z, transform
from executor.robot.actions import arm_chain, joint_limits
from executor.robot.description import ARM_HOME
from executor.robot.tracking import pose_error
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
_SPARE, _CLEAR = 4.0, 1200.0  # Weights, for rad and m, squared, beside 1 for rad to go: 3 cm are worth a radian.
_DEEPEST_M = 0.04  # Inside solids what is deeper costs no more: which face is the nearest says little there.
_APART_RAD, _STEPS = 0.25, 6  # Postures that are gone through to either side: to 1.5 rad, as far as elbows went.
_LONGEST_RAD = 0.2  # As far as one action moves a joint.
_DAMPING, _FLAT = 1e-4, 1e-12
_ARM = slice(3, 10)


@dataclass(frozen=True, slots=True)
class HandWish:
    """Where a hand is, seen from the base, and where it is wanted now and soon.

    Attributes:
        jacobian: (6, 7) how it moves and turns with the arm's joints, in the base's axes.
        errors: (2, 6) how far it is off, m and rad.
        wanted: (2, 4, 4) where it is to be now, and where it will be soon if it goes on as it does.
        bases: (2, 3) x, y [m] and yaw [rad] of the base then.
    """

    jacobian: Array
    errors: Array
    wanted: Array
    bases: Array


class Elbow:
    """What the elbow of one world's robot is to do.

    Args:
        world: Where it stands.
    """

    def __init__(self, world: World) -> None:
        scale = world.scene.robot.scale
        self._chain, self._limits = arm_chain(scale), joint_limits(scale)[_ARM]
        self._obstacles = Obstacles(world)
        # (L, 3, P) in frames of links; the frame of what a joint turns is that link's.
        self._points = np.stack([_points(world, link).T for link in LINKS])[:, None, None]
        self._turned_by = np.array(list(LINKS.values())) - 1

    def wish(self, arm: Array, hand: HandWish, *, homeward: bool) -> Array:
        """Returns the (7,) change of posture, rad, that leaves the hand where it is.

        Args:
            arm: (7,) the posture, rad.
            hand: Where the hand is, and is wanted.
            homeward: Whether the arm shall go home, where nothing is in the way.
        """
        ways, back = _freed(hand.jacobian[None])
        home = _HOMEWARD * float(ways[0] @ (np.array(ARM_HOME) - arm)) if homeward else 0.0
        arms = arm + _steps(back, hand.errors)
        step = self._cheapest(arms, ways[0], hand, home) if self._costs(arms[None], hand.bases).any() else home
        return np.asarray(np.clip(step, -_LONGEST_RAD, _LONGEST_RAD) * ways[0])

    def _cheapest(self, arms: Array, way: Array, hand: HandWish, home: float) -> float:
        """Returns how far along a way, rad, to the posture that costs least.

        Args:
            arms: (2, 7) postures near those that have the hand where it is wanted, now and soon.
            way: (7,) the motion that leaves the hand where it is.
            hand: Where it is wanted.
            home: How far to go where all else is equal.
        """
        frames = self._chain.frames(arms)
        arms = arms + _steps(_freed(self._chain.jacobian(frames))[1], pose_error(hand.wanted, frames[-1]))
        gone, ways, found = np.stack([arms, arms]), np.stack([way, -way])[:, None], [np.stack([arms, arms])]
        for _ in range(_STEPS):
            frames = self._chain.frames(gone.reshape(4, -1))
            along, back = _freed(self._chain.jacobian(frames))
            along = along.reshape(gone.shape)
            ways = np.where((along * ways).sum(axis=2, keepdims=True) < 0.0, -along, along)
            error = pose_error(np.tile(hand.wanted, (2, 1, 1)), frames[-1])
            gone = gone + _steps(back, error).reshape(gone.shape) + _APART_RAD * ways
            found.append(gone)
        costs = self._costs(np.concatenate(found), hand.bases).reshape(_STEPS + 1, 2, 2)
        # From where it is, the arm has to pass all that lies between; later it is there already.
        both = np.maximum.accumulate(costs[:, :, 0], axis=0) + costs[:, :, 1]
        cost = np.concatenate([both[:0:-1, 1], both[:, 0]])
        along_rad = _APART_RAD * np.arange(-_STEPS, _STEPS + 1)
        cost += (along_rad - home) ** 2
        k = int(cost.argmin())
        if k in (0, len(cost) - 1):
            return float(along_rad[k])
        # The lowest point of a parabola through it and its neighbours.
        bend = max(float(cost[k - 1] - 2.0 * cost[k] + cost[k + 1]), _FLAT)
        return float(along_rad[k]) + _APART_RAD * float(cost[k - 1] - cost[k + 1]) / (2.0 * bend)

    def _costs(self, arms: Array, bases: Array) -> Array:
        """Returns (M, 2) what postures (M, 2, 7) over (2, 3) bases lack of the room that is wished for around them."""
        shape = arms.shape[:2]
        frames = self._chain.frames(arms.reshape(-1, arms.shape[-1]))[self._turned_by].reshape(-1, *shape, 4, 4)
        frames = np.stack([transform(rotation_z(yaw), [x, y, 0.0]) for x, y, yaw in bases.tolist()]) @ frames
        places = (frames[..., :3, :3] @ self._points + frames[..., :3, 3:]).swapaxes(-1, -2)
        gaps = self._obstacles.distances_m(places.reshape(-1, 3), CLEAR_M).reshape(places.shape[:-1])
        short_m = np.clip(CLEAR_M - gaps.min(axis=-1), 0.0, CLEAR_M + _DEEPEST_M)
        short_rad = np.maximum(SPARE_RAD - np.minimum(arms - self._limits[:, 0], self._limits[:, 1] - arms), 0.0)
        return np.asarray(_CLEAR * (short_m**2).sum(axis=0) + _SPARE * (short_rad**2).sum(axis=-1))


def _freed(jacobians: Array) -> tuple[Array, Array]:
    """Returns, of N postures, (N, 7) motions that leave the hand where it is, and (N, 7, 6) least ones that move it."""
    U, sizes, V = np.linalg.svd(jacobians)
    damped = sizes / (sizes**2 + _DAMPING)
    return V[:, 6], (V[:, :6].swapaxes(1, 2) * damped[:, None]) @ U.swapaxes(1, 2)


def _steps(back: Array, error: Array) -> Array:
    return np.asarray((back @ error[:, :, None])[:, :, 0])


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
