"""Follow hand actions with the arm: distances to solids, elbow posture, and joint targets.

Ten numbers of a hand action leave one of an arm's seven joints free: the null motion with the hand at its target. An
arm of six joints has none, and its elbow is where the hand puts it.
Where nothing is near, the elbow goes a little towards home. Otherwise all postures that hold the hand are searched to
either side, for the hand now and soon, and the arm moves towards the cheapest. Each link between shoulder and hand
should keep `CLEAR_M` from everything solid, each joint `SPARE_RAD` from its limits; elbow motion itself costs, too. A
gradient alone would not do: over a table the forearm has room on one side or the other, and seldom in between. Only the
present state and the present action count, so that equal episodes have equal elbows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from executor.assets.asset_geometry import box_around_shape, farthest_points
from executor.assets.model import Shape
from executor.geometry import Array, rotation_z, transform
from executor.sim.engine import pose_matrix
from executor.sim.robot.actions import BASE_NUMBERS_FROM, OPENING, arm_chain, joint_limits
from executor.sim.robot.kinematics import pose_error
from executor.sim.world import World
from oag.model.robots import Robot

_FLOOR = Shape("box", (50.0, 50.0, 0.5), (0.0, 0.0, -0.5))
_LOOK_EVERY, _ROAM_M = 5, 0.5
"""Interval of pose updates of movable solids beyond a distance [m]: reading poses takes most of the time."""


class Obstacles:
    """Solids of a world without the robot: boxes and cylinders exactly, all else as bounding boxes."""

    def __init__(self, world: World) -> None:
        self._world = world
        bodies = [
            (name, link.name, shapes)
            for name, asset in world.assets.items()
            for link in asset.links
            if (shapes := [shape for shape in link.shapes if shape.collides])
        ]
        # Movable bodies come last, one after the other.
        moving = {*world.dynamic_ids, *world.articulated_ids}
        bodies.sort(key=lambda body: body[0] in moving)
        ends = 1 + np.cumsum([len(own) for *_, own in bodies])
        placed = [(name, link, slice(end - len(own), end)) for (name, link, own), end in zip(bodies, ends, strict=True)]
        shapes = [_FLOOR, *(shape for *_, own in bodies for shape in own)]
        self._is_round = np.array([shape.kind == "cylinder" for shape in shapes])
        boxes = [box_around_shape(shape) for shape in shapes]
        self._T_body_solid, self._half_m = np.stack([T for T, _ in boxes]), np.stack([half for _, half in boxes])
        self._T_world_solid = self._T_body_solid.copy()
        self._movers = [body for body in placed if body[0] in moving]
        self._starts = [rows.start for *_, rows in self._movers]
        self._asked = 0
        for body in placed:
            self._place(*body)

    def distances_m(self, points: Array, within_m: float) -> Array:
        """Return (N,) distances to the nearest solid [m]; negative inside, infinite beyond `within_m`.

        Args:
            points: (N, 3) in the world, close together.
            within_m: Solids farther than this from a point may be ignored.
        """
        middle = points.mean(axis=0)
        within_m += float(np.sqrt(((points - middle) ** 2).sum(axis=1).max()))
        gap_m = self._gap_m(middle)
        if self._movers:
            every = self._asked % _LOOK_EVERY == 0
            updated = every | (np.minimum.reduceat(gap_m, self._starts) < within_m + _ROAM_M)
            for k in np.flatnonzero(updated):
                self._place(*self._movers[k])
            gap_m = self._gap_m(middle)
        self._asked += 1
        near = np.flatnonzero(gap_m < within_m)
        return self._to(points, near) if len(near) else np.full(len(points), np.inf)

    def _gap_m(self, point: Array) -> Array:
        """Return (S,) distances of each solid, or its bounding box, from a point [m]; 0 inside."""
        local = ((point - self._T_world_solid[:, :3, 3])[:, None] @ self._T_world_solid[:, :3, :3])[:, 0]
        beyond = np.maximum(np.abs(local) - self._half_m, 0.0)
        return np.asarray(np.sqrt((beyond**2).sum(axis=1)))

    def _to(self, points: Array, near: NDArray[np.intp]) -> Array:
        """Return (N,) distances of points from the nearest of some solids, given by their numbers."""
        local = (points - self._T_world_solid[near, None, :3, 3]) @ self._T_world_solid[near, :3, :3]  # (S, N, 3)
        beyond = np.abs(local) - self._half_m[near, None]
        is_round = self._is_round[near]
        if is_round.any():
            # For cylinders x is the radial distance, and y is unused.
            beyond[is_round, :, 0] = (
                np.hypot(local[is_round, :, 0], local[is_round, :, 1]) - self._half_m[near][is_round, :1]
            )
            beyond[is_round, :, 1] = -np.inf
        inside = beyond.max(axis=2)
        outside = np.sqrt((np.maximum(beyond, 0.0) ** 2).sum(axis=2))
        return np.asarray(np.where(inside > 0.0, outside, inside).min(axis=0))

    def _place(self, name: str, link: str, rows: slice) -> None:
        self._T_world_solid[rows] = self._world.T_world_link(name, link) @ self._T_body_solid[rows]


CLEAR_M = 0.06
"""Clearance of the arm: hands move by up to 5 cm per action; an elbow with more clearance moves to worse places."""

SPARE_RAD = 0.3
"""Reserve of joint limits: with less, wrists turned into their limits, from where no elbow motion leads back."""

FIRST_FREE_LINK = 3
"""Links from this one to the one before the last are moved by the null motion; each has as many joints before it."""

_HAND_FREEDOMS = 6  # An arm of more joints moves its elbow with the hand in place.
_POINTS = 16  # On each link: 3 to 5 cm apart.
_HOMEWARD = 0.1  # Share of the distance home per action: within a second the elbow is on its home side.
_SPARE, _CLEAR = 4.0, 1200.0  # Weights for rad and m, squared; elbow motion in rad has 1: 3 cm are worth a radian.
_DEEPEST_M = 0.04  # Maximum penetration in costs: deeper inside, the nearest face means little.
_POSTURE_STEP_RAD, _STEPS = 0.25, 6  # Searched postures to either side: up to 1.5 rad, the observed range of elbows.
_LONGEST_RAD = 0.2  # Maximum joint motion of an action.
_DAMPING, _FLAT = 1e-4, 1e-12


@dataclass(frozen=True, slots=True)
class HandTarget:
    """Present pose of a hand in the base frame, and its targets now and soon.

    Attributes:
        jacobian: (6, A) motion and turn of the hand per joint, in the base's axes.
        errors: (2, 6) pose errors, m and rad.
        wanted: (2, 4, 4) target now, and soon at the present motion.
        bases: (2, B) coordinates of the base then.
    """

    jacobian: Array
    errors: Array
    wanted: Array
    bases: Array


class Elbow:
    """Elbow posture control of one world's robot."""

    def __init__(self, world: World) -> None:
        robot = world.model
        self._chain, self._limits = arm_chain(robot), joint_limits(robot)[robot.arm]
        self._home = np.array(robot.home)
        self._obstacles = Obstacles(world)
        links = robot.arm_links[FIRST_FREE_LINK : len(robot.arm_joints)]
        # (L, 3, P) in link frames; a joint's frame is that of the link it turns.
        self._points = np.stack([_points(world, link).T for link in links])[:, None, None]
        self._turned_by = np.arange(FIRST_FREE_LINK, FIRST_FREE_LINK + len(links)) - 1

    def posture_change(self, arm: Array, hand: HandTarget, *, homeward: bool) -> Array:
        """Return the (A,) change of posture [rad] that leaves the hand in place.

        Args:
            arm: (A,) the posture [rad].
            homeward: Whether the arm goes home where nothing is in the way.
        """
        if len(arm) <= _HAND_FREEDOMS:
            return np.zeros(len(arm))
        null_motions, back = _null_motions_and_inverses(hand.jacobian[None])
        home = _HOMEWARD * float(null_motions[0] @ (self._home - arm)) if homeward else 0.0
        arms = arm + _steps(back, hand.errors)
        step = self._cheapest(arms, null_motions[0], hand, home) if self._costs(arms[None], hand.bases).any() else home
        return np.asarray(np.clip(step, -_LONGEST_RAD, _LONGEST_RAD) * null_motions[0])

    def _cheapest(self, arms: Array, null_motion: Array, hand: HandTarget, home: float) -> float:
        """Return the distance along the null motion [rad] to the posture of lowest cost.

        Args:
            arms: (2, A) postures near those with the hand at its target, now and soon.
            null_motion: (A,) the null motion: it leaves the hand in place.
            home: Distance to go where all else is equal [rad].
        """
        frames = self._chain.frames(arms)
        arms = arms + _steps(
            _null_motions_and_inverses(self._chain.jacobian(frames))[1], pose_error(hand.wanted, frames[-1])
        )
        gone, null_motions, found = (
            np.stack([arms, arms]),
            np.stack([null_motion, -null_motion])[:, None],
            [np.stack([arms, arms])],
        )
        for _ in range(_STEPS):
            frames = self._chain.frames(gone.reshape(4, -1))
            along, back = _null_motions_and_inverses(self._chain.jacobian(frames))
            along = along.reshape(gone.shape)
            null_motions = np.where((along * null_motions).sum(axis=2, keepdims=True) < 0.0, -along, along)
            error = pose_error(np.tile(hand.wanted, (2, 1, 1)), frames[-1])
            gone = gone + _steps(back, error).reshape(gone.shape) + _POSTURE_STEP_RAD * null_motions
            found.append(gone)
        costs = self._costs(np.concatenate(found), hand.bases).reshape(_STEPS + 1, 2, 2)
        # Now the arm has to pass all postures between; later it is there already.
        both = np.maximum.accumulate(costs[:, :, 0], axis=0) + costs[:, :, 1]
        cost = np.concatenate([both[:0:-1, 1], both[:, 0]])
        along_rad = _POSTURE_STEP_RAD * np.arange(-_STEPS, _STEPS + 1)
        cost += (along_rad - home) ** 2
        k = int(cost.argmin())
        if k in (0, len(cost) - 1):
            return float(along_rad[k])
        # The lowest point of a parabola through it and its neighbours.
        bend = max(float(cost[k - 1] - 2.0 * cost[k] + cost[k + 1]), _FLAT)
        return float(along_rad[k]) + _POSTURE_STEP_RAD * float(cost[k - 1] - cost[k + 1]) / (2.0 * bend)

    def _costs(self, arms: Array, bases: Array) -> Array:
        """Return (M, 2) costs of missing clearance of postures (M, 2, A) over (2, B) bases."""
        shape = arms.shape[:2]
        frames = self._chain.frames(arms.reshape(-1, arms.shape[-1]))[self._turned_by].reshape(-1, *shape, 4, 4)
        frames = (
            np.stack([transform(rotation_z(yaw), [x, y, sum(lift)]) for x, y, yaw, *lift in bases.tolist()]) @ frames
        )
        places = (frames[..., :3, :3] @ self._points + frames[..., :3, 3:]).swapaxes(-1, -2)
        gaps = self._obstacles.distances_m(places.reshape(-1, 3), CLEAR_M).reshape(places.shape[:-1])
        short_m = np.clip(CLEAR_M - gaps.min(axis=-1), 0.0, CLEAR_M + _DEEPEST_M)
        short_rad = np.maximum(SPARE_RAD - np.minimum(arms - self._limits[:, 0], self._limits[:, 1] - arms), 0.0)
        return np.asarray(_CLEAR * (short_m**2).sum(axis=0) + _SPARE * (short_rad**2).sum(axis=-1))


def _null_motions_and_inverses(jacobians: Array) -> tuple[Array, Array]:
    """Return, for N postures, (N, A) null motions of the hand, and (N, A, 6) damped inverse Jacobians."""
    U, sizes, V = np.linalg.svd(jacobians)
    damped = sizes / (sizes**2 + _DAMPING)
    return V[:, -1], (V[:, :6].swapaxes(1, 2) * damped[:, None]) @ U.swapaxes(1, 2)


def _steps(back: Array, error: Array) -> Array:
    return np.asarray((back @ error[:, :, None])[:, :, 0])


def _points(world: World, link: str) -> Array:
    """Return (N, 3) collision corners of a link of the robot, in its frame, spread by farthest-point sampling."""
    meshes = [shape for shape in world.robot.find_link_by_name(link).collision_shapes if hasattr(shape, "vertices")]
    placed = [(np.asarray(mesh.vertices) * np.asarray(mesh.scale), pose_matrix(mesh.local_pose)) for mesh in meshes]
    corners = np.concatenate([points @ T[:3, :3].T + T[:3, 3] for points, T in placed])
    return np.asarray(corners[farthest_points(corners, _POINTS, 0)])


def arm_speeds(robot: Robot) -> Array:
    """Return (A,) the speed limits of a robot's arm that follows hand actions [rad/s]: its maker's.

    With an elbow unlike the demonstration's, the same hand motion needs twice the speed in some joint. At the 1.2 rad/s
    of planned motions hands fell 5 cm behind.
    """
    arm, wrist = robot.speeds_rad_s
    return np.array([arm] * (len(robot.arm_joints) - robot.wrist) + [wrist] * robot.wrist)


OWED_M, OWED_RAD = 0.05, 0.3
"""Maximum lead of the hand's target over the arm: what half a second can catch up."""

AHEAD_S = 0.3
"""Prediction horizon of the elbow, at constant motion of hand and base: the time of a change of side. With a longer
one, hands that will have stopped seem to run into things."""

_INSET_RAD = 0.002  # Distance of commands from the arm's limits.
_FREE = 1e-4  # Weight of the elbow relative to the hand, m and rad squared: 0.1 rad costs the hand 0.01 mm.
_FINE = 1e-6
_ITERATIONS = 3  # After one iteration an unconstrained hand is within 0.01 mm.
_NEAR, _REACHED = 1e-3, 1e-5  # Below the first the Jacobian is exact to a thousandth; the second counts as there.
_APART_RAD = 1e-12  # Slack of bounds: those of a fixed joint coincide.


class HandFollower:
    """Follows hand targets, action by action; later actions catch up what one leaves undone.

    Args:
        target: (J,) initial joint targets.
        period_s: Duration of an action [s].
    """

    def __init__(self, robot: Robot, target: Array, period_s: float, elbow: Elbow) -> None:
        self._elbow = elbow
        self._chain, self._limits = arm_chain(robot), joint_limits(robot)
        self._robot = robot
        self._wanted = self._chain.forward(np.asarray(target, float)[None, robot.arm])[0]
        self._most_rad = arm_speeds(robot) * period_s
        self._ahead = AHEAD_S / period_s
        self._now_and_soon = np.array([[1.0], [1.0 + self._ahead]])

    def joint_target(self, before: Array, action: Array) -> Array:
        """Return the (J,) joint targets of a hand action.

        The arm takes a posture near the previous one, within its limits and speeds, with its elbow moving to its own
        target. Where the hand cannot get all the way at once, it gets as near as it can, and owes the rest, up to
        `OWED_M` and `OWED_RAD`.

        Args:
            before: (J,) present joint targets of the drives.
            action: (H,) a hand action, see `executor.sim.robot.actions`.
        """
        before, action = np.asarray(before, float), np.asarray(action, float)
        cosine, sine = np.cos(before[2]), np.sin(before[2])
        ahead, aside, *more = action[BASE_NUMBERS_FROM:]
        was = before[self._robot.base]
        base = was + [cosine * ahead - sine * aside, sine * ahead + cosine * aside, *more]
        fingers = np.full(2, action[OPENING] * self._limits[-1, 1])
        wanted = _move_pose(self._wanted, self._now_and_soon * action[:6])
        self._wanted = wanted[0]
        bases = np.stack([base, base + self._ahead * (base - was)])
        moves = bool(action[:6].any())
        return np.concatenate([base, self._posture(before[self._robot.arm], wanted, bases, moves=moves), fingers])

    def _posture(self, before: Array, wanted: Array, bases: Array, *, moves: bool) -> Array:
        """Return the (A,) next posture with the hand at its target now, or as near as possible."""
        limits = self._limits[self._robot.arm]
        low, high = limits[:, 0] + _INSET_RAD, limits[:, 1] - _INSET_RAD
        low = np.maximum(np.minimum(low, before), before - self._most_rad)
        high = np.minimum(np.maximum(high, before), before + self._most_rad)
        reached, jacobians = self._chain.forward_and_jacobian(before[None])
        errors = pose_error(wanted, reached)
        posture_change = self._elbow.posture_change(
            before, HandTarget(jacobians[0], errors, wanted, bases), homeward=moves
        )
        step = _solve_within_bounds(jacobians[0], errors[0], _FREE, posture_change, low - before, high - before)
        arm = np.clip(before + step, low, high)
        for _ in range(_ITERATIONS):
            reached, jacobians = self._chain.forward_and_jacobian(arm[None])
            error = pose_error(wanted[:1], reached)[0]
            step = _solve_within_bounds(jacobians[0], error, _FINE, np.zeros_like(arm), low - arm, high - arm)
            arm = np.clip(arm + step, low, high)
            if _norm(error) < _NEAR and _norm(error - jacobians[0] @ step) < _REACHED:
                return arm
        self._forgive(arm)
        return arm

    def _forgive(self, arm: Array) -> None:
        """Reduce the owed motion to what a posture can still catch up."""
        reached = self._chain.forward(arm[None])
        owed = pose_error(self._wanted[None], reached)[0]
        for part, most in ((owed[:3], OWED_M), (owed[3:], OWED_RAD)):
            part *= min(1.0, most / max(_norm(part), _APART_RAD))
        self._wanted = _move_pose(reached[0], owed[None])[0]


def _move_pose(T: Array, motions: Array) -> Array:
    """Return a (4, 4) pose after each of N motions (N, 6): moved (m) and turned in place (rotation vector, rad)."""
    after = np.empty((len(motions), 4, 4))
    after[:] = T
    after[:, :3, 3] += motions[:, :3]
    after[:, :3, :3] = Rotation.from_rotvec(motions[:, 3:]).as_matrix() @ T[:3, :3]
    return after


def _norm(vector: Array) -> float:
    return math.sqrt(float(vector @ vector))


def _solve_within_bounds(jacobian: Array, error: Array, weight: float, wish: Array, low: Array, high: Array) -> Array:
    """Solve for the (A,) change of posture within bounds that brings a hand nearest to its target.

    Args:
        jacobian: (6, A) motion and turn of the hand per joint.
        error: (6,) pose error, m and rad.
        weight: Weight of rad squared off the elbow's change, relative to m and rad squared of the hand.
        wish: (A,) the elbow's preferred change.
        low, high: (A,) bounds.
    """
    joints = np.eye(len(wish))  # Equal weights of the arm's joints.
    free = np.linalg.solve(jacobian.T @ jacobian + weight * joints, jacobian.T @ error + weight * wish)
    if (np.clip(free, low - _APART_RAD, high + _APART_RAD) == free).all():
        return np.asarray(free)
    # The unbounded solution takes a tenth of the time.
    rows = np.concatenate([jacobian, np.sqrt(weight) * joints])
    sought = np.concatenate([error, np.sqrt(weight) * wish])
    return np.asarray(lsq_linear(rows, sought, (low - _APART_RAD, high + _APART_RAD), method="bvls").x)
