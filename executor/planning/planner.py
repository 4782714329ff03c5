"""The planner: free paths for the arm and for the base, straight hand motions, and the paths of parameterised
primitives.

A parameterised primitive is a number in metres or degrees, in the robot's own frame.

Source: the paper's primitive library. "Forward" and "left" are the base's heading and its left side, for the hand too;
"up" and "down" are vertical. Turns are about the base's own axis.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from executor.assets.asset_geometry import bounds
from executor.geometry import Array, interpolate_poses, inverse, nearest_turn, rotation_z
from executor.planning.choices import Choice, Near
from executor.planning.collision import CollisionOracle
from executor.planning.floor import FloorPlan
from executor.planning.paths import (
    ARM_STEP_RAD,
    FINE_ARM_STEP_RAD,
    EdgeCheck,
    base_move,
    base_turn,
    connect,
    segment,
    shorten,
)
from executor.sim.robot.kinematics import Kinematics, LineTracker
from executor.sim.world import World
from executor.system.effort import CANDIDATE_S
from oag import Action, Primitive

BASE_MARGINS_M = (0.03, 0.012, 0.006)
"""What the base path keeps, with steps so short that no body moves farther than twice that from one to the next."""

BASE_SHARES = (1.0, 0.5, 0.25)  # Of the usual steps, for each of the margins above.
ARM_MARGIN_M = 0.004  # Twice what the robot is off its path.
BASE_WEIGHTS = (1.0, 1.0, 0.4, 1.0)  # A radian of turning counts as 0.4 m of driving, or of the lift.
PATIENCE = 100
"""After so many samples a drive is given up whose start or goal is walled in."""

SLACK_M = 0.001
"""What a choice of the dry run may be tighter in physics: things are a little off. The robot still touches nothing."""

SHORTENINGS, FEW_SHORTENINGS = 60, 16  # Of a drive; most of its corners are cut by the first few.
BASE_ROOM_M = 1.2  # Around start and goal, where the search begins.
NEAR_SAMPLES = 300
"""So many samples search for a path of the base near by; from then on every other one covers all furniture."""

AROUND_M = 0.8  # Around all furniture, so that paths lead round it.
MOST_LINES, LINE_DIGITS = 64, 9
"""How many lines are remembered, and to how many digits [m, rad] their ends are the same."""

WAYPOINT_M = 0.01  # Between waypoints of a line.
SPILL_COSINE = float(np.cos(np.deg2rad(20.0)))
"""Of how far a carrier may lean on its way: less than the walls of bowls rise, and what stands on a plate tips over."""


@dataclass(frozen=True, slots=True)
class LinePlan:
    """A straight hand motion: the path (N, Q) or None, the worst residual [m], and the joints at their limits.

    Attributes:
        at_limit: Joints at a limit where the hand was farthest off; empty for a line that succeeded.
    """

    path: Array | None
    residual_m: float
    at_limit: tuple[str, ...] = ()


class Planner:
    """Plans against one collision oracle; equal queries after equal reseeding get equal answers.

    Attributes:
        robot: Its record.
        seed: Of the episode.
        floor: Where the base cannot stand, without asking the oracle.
        effort: What planning has taken so far; a search that exceeds its limit ends (`SearchExhausted`).
        patience_s: Effort after which a search for a grasp gives up, where things that may be moved are met.
        gave_up: Whether a search of the subtask was ended so.
        chosen: What was chosen in the subtask so far.
        near: What searches are narrowed to; None where they look everywhere.
        lands: Whether what is held ends in its place if it is let go of at a pose (4, 4); None where nothing is asked.
    """

    def __init__(self, oracle: CollisionOracle) -> None:
        self.oracle = oracle
        self.kinematics: Kinematics = oracle.kinematics
        self.robot = oracle.robot
        self.tracker = LineTracker(oracle.kinematics)
        self.floor = FloorPlan(oracle)
        self.effort = self.kinematics.effort
        self.patience_s, self.gave_up = math.inf, False
        self.seed = 0
        self.rng = np.random.default_rng(0)
        self.chosen: list[Choice] = []
        self._drives: list[Array] = []
        self.near: Near | None = None
        self.lands: Callable[[Array], bool] | None = None
        self._lines: dict[bytes, LinePlan] = {}
        self._around = _around_everything(oracle.world)

    def start_subtask(self, world: World, seed: int, index: int) -> None:
        """Synchronise with the world and restarts all randomness for a subtask."""
        self.oracle.synchronize(world)
        self.chosen, self._drives, self.gave_up = [], [], False
        self._lines.clear()
        self._index = index
        self.reseed(seed)

    def reseed(self, seed: int) -> None:
        """Restart all randomness of the subtask, with another seed."""
        self.seed = seed
        self.kinematics.reseed([seed, self._index, 1])
        self.rng = np.random.default_rng([seed, self._index, 2])

    def choose(self, step: int, q: Array, T_world_anchor: Array) -> None:
        """Note that a step's hand goal is to be reached in a configuration (Q,), by its target's or support's pose."""
        T_anchor_eef = inverse(T_world_anchor) @ self.kinematics.forward(q)
        self.chosen.append(Choice(step, q[self.robot.base], T_anchor_eef, q[self.robot.arm], tuple(self._drives)))

    @contextmanager
    def narrowed_to(self, choice: Choice, T_world_anchor: Array) -> Iterator[None]:
        """Narrow the searches in the block to candidates near a choice, which may be a little tighter than it was."""
        self.near = Near(choice.base, T_world_anchor @ choice.T_anchor_eef, choice.arm, choice.drives)
        self.oracle.slack_m = SLACK_M
        try:
            yield
        finally:
            self.near, self.oracle.slack_m = None, 0.0

    def line(self, q: Array, T_world_eef: Array) -> LinePlan:
        """Plan a straight hand motion to a pose with the arm alone, not checked for collisions.

        Returns:
            The path with q as its first row.
        """
        if self.robot.keeps_order:
            return self._line(q, T_world_eef)
        # Moves of several lengths before and after each other have most of their lines in common.
        key = np.round(np.concatenate([q, T_world_eef.ravel()]), LINE_DIGITS).tobytes()
        if key not in self._lines:
            if len(self._lines) >= MOST_LINES:
                self._lines.clear()
            self._lines[key] = self._line(q, T_world_eef)
        return self._lines[key]

    def _line(self, q: Array, T_world_eef: Array) -> LinePlan:
        poses = interpolate_poses(self.kinematics.forward(q), T_world_eef, WAYPOINT_M)
        path, residual_m = self.tracker.track(q, poses)
        if path is None:
            return LinePlan(None, residual_m, self.tracker.at_limit)
        return LinePlan(np.concatenate([q[None], path]), residual_m)

    def arm_path(self, q: Array, arm: Array, *, iterations: int = 400) -> Array | None:
        """Return free waypoints (N, Q) that bring the arm to a posture with the base standing still, or None.

        What carries cargo is kept upright on the way.

        Args:
            q: (Q,) start.
            arm: (A,) wanted posture.
            iterations: Samples of the tree search.
        """
        # The clearance is given up at the start, where the hand may be nearer to things already.
        with self.oracle.leaving(q, margin_m=ARM_MARGIN_M):
            return self._arm_path(q, arm, iterations)

    def _arm_path(self, q: Array, arm: Array, iterations: int) -> Array | None:
        base, here = q[self.robot.base], q[self.robot.arm]
        goal = np.concatenate([base, arm])
        if self._spills(goal[None]) or not self.oracle.is_free(goal, margin_m=ARM_MARGIN_M):
            return None
        lower, upper = self.kinematics.arm_lower + 0.02, self.kinematics.arm_upper - 0.02
        middle, spread = (here + arm) / 2, np.abs(here - arm) / 2 + 0.5

        def sample() -> Array:
            if self.rng.uniform() < 0.5:
                return np.clip(middle + spread * self.rng.normal(0.0, 0.6, len(arm)), lower, upper)
            return np.asarray(self.rng.uniform(lower, upper))

        # Coarse steps find a path fast; only one that fine steps confirm is taken, else fine steps search again.
        for step_rad in (ARM_STEP_RAD, FINE_ARM_STEP_RAD):

            def edge_is_free(a: Array, b: Array, step_rad: float = step_rad) -> bool:
                ends = np.concatenate([base, a]), np.concatenate([base, b])
                way = segment(self.robot, *ends, arm_step_rad=step_rad)
                return not self._spills(way) and self.oracle.is_path_free(way, margin_m=ARM_MARGIN_M)

            way = self._simple_way(here, arm, edge_is_free) or connect(
                here,
                arm,
                edge_is_free=edge_is_free,
                sample=sample,
                weights=np.ones(len(arm)),
                step=0.4,
                iterations=iterations,
            )
            if way is None:
                return None
            way = shorten(way, edge_is_free=edge_is_free, rng=self.rng, attempts=40)
            if all(edge_is_free(a, b, FINE_ARM_STEP_RAD) for a, b in pairwise(way)):
                return np.stack([np.concatenate([base, posture]) for posture in way])
        return None

    def _simple_way(self, here: Array, arm: Array, edge_is_free: EdgeCheck) -> list[Array] | None:
        """Return the straight way to a posture, else that by the home posture that leans forward, or None.

        An arm that is turned aside meets the mast behind it where it leans back too early.
        """
        if self.robot.keeps_order:
            return None
        home = self.robot.home
        leaning = np.array([home[0], self.robot.leaning_rad, *home[2:]])
        ways = [here, arm], [here, leaning, arm]
        return next((way for way in ways if all(edge_is_free(a, b) for a, b in pairwise(way))), None)

    def _spills(self, way: Array) -> bool:
        """Return whether what is carried loses its cargo on a way (N, Q), since it leans too far."""
        carried = self.oracle.carried
        if carried is None or carried.upward is None:
            return False
        return any(float(self.kinematics.forward(q)[2, :3] @ carried.upward) < SPILL_COSINE for q in way)

    def base_path(self, q: Array, base: Array, *, iterations: int = 800) -> Array | None:
        """Return free waypoints (N, Q) that drive to a base pose with the arm as it is, or None.

        The whole robot and what it carries are checked every 2 cm and 2 degrees. The clearance is larger than what a
        body can move in between. Less clearance, with shorter steps, is tried only where no path has more; where the
        robot starts nearer to something, it may leave.

        Args:
            q: (Q,) start.
            base: (B,) the goal; its yaw is shifted by whole turns to the nearest one.
            iterations: Samples of the tree search.
        """
        goal = np.array([*base[:2], nearest_turn(float(base[2]), float(q[2])), *base[3:]])
        for margin_m, share in zip(BASE_MARGINS_M, BASE_SHARES, strict=True):
            with self.oracle.leaving(q, margin_m=margin_m):
                path = self._base_path(q, goal, margin_m, share, iterations)
            if path is not None:
                return path
        return None

    def _base_path(self, q: Array, goal: Array, margin_m: float, share: float, iterations: int) -> Array | None:
        here, arm = q[self.robot.base], q[self.robot.arm]
        room = np.array([BASE_ROOM_M, BASE_ROOM_M, np.pi, 0.0][: len(here)])
        low, high = np.minimum(here, goal) - room, np.maximum(here, goal) + room
        lowest, highest = low.copy(), high.copy()
        lowest[:2], highest[:2] = np.minimum(low[:2], self._around[0]), np.maximum(high[:2], self._around[1])
        drawn = itertools.count()

        def full(pose: Array) -> Array:
            return np.concatenate([pose, arm])

        def sample() -> Array:
            count = next(drawn)
            far = count >= NEAR_SAMPLES and bool(count % 2)
            return self.rng.uniform(lowest, highest) if far else self.rng.uniform(low, high)

        def edge_is_free(a: Array, b: Array) -> bool:
            way = segment(self.robot, full(a), full(b), base_share=share)
            if self.floor.taken(way[:, :3]).any():
                self.effort.add(CANDIDATE_S)
                return False
            return self.oracle.is_path_free(way, margin_m=margin_m)

        if not self.oracle.is_free(full(goal), margin_m=margin_m):
            return None
        for known in self.near.drives_between(here, goal) if self.near is not None else ():
            if all(edge_is_free(a, b) for a, b in pairwise(known)):
                return np.stack([full(pose) for pose in known])
        way = connect(
            here.copy(),
            goal,
            edge_is_free=edge_is_free,
            sample=sample,
            weights=np.array(BASE_WEIGHTS[: len(here)]),
            step=0.4,
            iterations=iterations,
            patience=None if self.robot.keeps_order else PATIENCE,
        )
        if way is None:
            return None
        attempts = SHORTENINGS if self.robot.keeps_order else FEW_SHORTENINGS
        way = shorten(way, edge_is_free=edge_is_free, rng=self.rng, attempts=attempts)
        self._drives.append(np.stack(way))
        return np.stack([full(pose) for pose in way])


def _around_everything(world: World) -> tuple[Array, Array]:
    """Return the corners (2,) of the floor area of all things, with room to drive around each of them."""
    corners = [np.zeros((1, 2))]
    for name, asset in world.assets.items():
        T = world.T_world_link(name)
        corners.append(T[:2, 3] + np.stack(bounds(asset, T[:3, :3]))[:, :2])
    every = np.concatenate(corners)
    return every.min(axis=0) - AROUND_M, every.max(axis=0) + AROUND_M


EEF_DIRECTIONS: dict[Primitive, tuple[float, float, float]] = {
    Primitive.LIFT_EEF_UP: (0.0, 0.0, 1.0),
    Primitive.LIFT_EEF_DOWN: (0.0, 0.0, -1.0),
    Primitive.MOVE_EEF_FORWARD: (1.0, 0.0, 0.0),
    Primitive.MOVE_EEF_BACKWARD: (-1.0, 0.0, 0.0),
    Primitive.MOVE_EEF_LEFT: (0.0, 1.0, 0.0),
    Primitive.MOVE_EEF_RIGHT: (0.0, -1.0, 0.0),
}
"""Unit directions of the hand's translations in the base frame."""

BASE_HEADINGS_RAD: dict[Primitive, float] = {
    Primitive.MOVE_BASE_FORWARD: 0.0,
    Primitive.MOVE_BASE_BACKWARD: np.pi,
    Primitive.MOVE_BASE_LEFT: np.pi / 2,
    Primitive.MOVE_BASE_RIGHT: -np.pi / 2,
}
"""Headings of the base's translations, relative to where it faces."""

TURN_SIGNS: dict[Primitive, float] = {Primitive.TURN_BASE_LEFT: 1.0, Primitive.TURN_BASE_RIGHT: -1.0}
"""Counter-clockwise is positive."""

MOVES = frozenset([*EEF_DIRECTIONS, *BASE_HEADINGS_RAD, *TURN_SIGNS])
"""The primitives whose effect is a number in the robot's own frame."""


def move_path(planner: Planner, q: Array, primitive: Primitive, amount: float) -> LinePlan:
    """Return the path (N, Q), q first, of a parameterised primitive; not checked for collisions.

    Args:
        planner: Solves the hand's straight motions.
        q: (Q,) where the robot is.
        primitive: One of `MOVES`.
        amount: Metres, or degrees for turns; a negative amount reverses the direction (used to plan backwards).
    """
    if primitive in EEF_DIRECTIONS:
        direction = rotation_z(float(q[2])) @ np.array(EEF_DIRECTIONS[primitive])
        T = planner.kinematics.forward(q)
        T[:3, 3] += amount * direction
        return planner.line(q, T)
    if primitive in BASE_HEADINGS_RAD:
        return LinePlan(base_move(q, amount, float(q[2]) + BASE_HEADINGS_RAD[primitive]), 0.0)
    return LinePlan(base_turn(q, TURN_SIGNS[primitive] * np.deg2rad(amount)), 0.0)


def run_moves(planner: Planner, q: Array, moves: list[Action]) -> Array | None:
    """Return the waypoints (N, Q), q first, of filled moves one after another, or None when one is out of reach."""
    path = q[None]
    for action in moves:
        amount = action.parameter
        if not isinstance(amount, float | int):
            raise ValueError(f"{action.primitive.name} has no number to run")
        step = move_path(planner, path[-1], action.primitive, float(amount)).path
        if step is None:
            return None
        path = np.concatenate([path, step[1:]])
    return path


def undo_moves(planner: Planner, q: Array, moves: list[Action]) -> Array | None:
    """Return the configuration (Q,) from which filled moves lead to q, or None when there is none within reach."""
    for action in reversed(moves):
        amount = action.parameter
        if not isinstance(amount, float | int):
            raise ValueError(f"{action.primitive.name} has no number to undo")
        step = move_path(planner, q, action.primitive, -float(amount)).path
        if step is None:
            return None
        q = step[-1]
    return q
