"""Candidates for standing somewhere with the hand at a pose, the order in which they are offered, and near misses."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from executor.geometry import Array, inverse, rotation_z, wrap_angle
from executor.motion.planning.oracle import BASE, GRIPPER, HELD, Hit
from executor.motion.planning.planner import Planner
from executor.robot.description import ARM_HOME, JOINT_NAMES
from executor.robot.kinematics import ARM, ArmSolution, Kinematics
from oag.revision.measurements import Unplanned

REACHES_M = (0.45, 0.40, 0.50, 0.35, 0.55)  # From the base's axis to the hand, the most comfortable first.
CLOSE_REACHES_M = (0.30, 0.25)
"""With the elbow high: from between a chair and the table, where there is no room farther off."""

ENOUGH_MARGIN_RAD = np.deg2rad(40.0)  # With it the search ends.
ENOUGH_CLEARANCE_M = 0.008  # And with it: four times what the robot is off its path.
ROOMY_M = 0.02  # More room than this is worth nothing.
TIGHTNESS_COST = 0.3  # In rad of joint margin, at no clearance at all.
DRIVE_COST_RAD_PER_M = 0.15  # A metre less of driving makes up for 9 degrees of joint margin.
TURN_COST = 0.05  # For each radian that the base faces away.
SHOULDER = frozenset(("panda_link1", "panda_link2"))
LEANING_FORWARD = np.array([*ARM_HOME[:1], 0.5, *ARM_HOME[2:]])
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
TURN_M_PER_RAD = 0.1
"""How many metres off the place a radian off the direction is worth: about the length of the hand."""

AT_LIMIT_RAD = 0.02  # So near to it a joint counts as held by its limit.
INSET_RAD = 1e-3  # Within the limits, so that rounding does not leave them.
SLOPE_RAD = 1e-3
DRAWN, DESCENTS = 1000, 4
"""How many postures are drawn, and from how many of them a descent begins."""


class Scored(Protocol):
    """Something with a joint margin in rad, a clearance and a score; larger is better for all."""

    @property
    def margin_rad(self) -> float:
        """Smallest distance to a joint limit."""

    @property
    def clearance_m(self) -> float:
        """How far the robot is from what it does not mean to touch."""

    @property
    def score(self) -> float:
        """Joint margin less costs."""


Choice = TypeVar("Choice", bound=Scored)


@dataclass(frozen=True, slots=True)
class HandGoal:
    """A wanted hand pose.

    Attributes:
        T_world_eef: (4, 4) the pose.
        heading_rad: The heading from which the robot faces it.
        cost: In rad of joint margin.
        region: Name of the region that a held thing would be put into, for placements.
    """

    T_world_eef: Array
    heading_rad: float
    cost: float = 0.0
    region: str = ""

    def base_before(self, reach_m: float, turn_rad: float) -> Array:
        """Returns the base pose (3,) so far before the hand, turned by so much from the goal's heading."""
        yaw = self.heading_rad + turn_rad
        x, y = self.T_world_eef[:2, 3] - rotation_z(yaw)[:2, 0] * reach_m
        return np.array([x, y, yaw])


@dataclass(frozen=True, slots=True)
class BaseCandidate:
    """A candidate base pose for a hand goal, with its cost."""

    goal: HandGoal
    base: Array
    cost: float


def placements(
    goals: list[HandGoal], here: Array, turns_rad: tuple[float, ...], reaches_m: tuple[float, ...] = REACHES_M
) -> list[BaseCandidate]:
    """Returns base poses for all goals, the cheapest (near, straight ahead, comfortable reach) first.

    Args:
        goals: Wanted hand poses.
        here: (3,) where the base stands now.
        turns_rad: How far the base may face away from the goal's heading.
        reaches_m: How far before the hand the base may be, the preferred distance first.
    """
    found = []
    for goal, (rank, reach_m), turn_rad in itertools.product(goals, enumerate(reaches_m), turns_rad):
        base = goal.base_before(reach_m, turn_rad)
        drive = float(np.hypot(*(base[:2] - here[:2]))) + 0.2 * abs(wrap_angle(float(base[2]) - float(here[2])))
        cost = DRIVE_COST_RAD_PER_M * drive + TURN_COST * abs(turn_rad) + goal.cost + 0.02 * rank
        found.append(BaseCandidate(goal, base, cost))
    return sorted(found, key=lambda p: p.cost)


class Blocked:
    """Hand goals that cannot be, wherever the base stands: there the hand, or what it holds, touches something."""

    def __init__(self) -> None:
        self._goals: set[int] = set()

    def __contains__(self, goal: HandGoal) -> bool:
        return id(goal) in self._goals

    def learn(self, goal: HandGoal, hits: list[Hit]) -> None:
        """Takes note of a goal where one of the hits is the gripper's or the held object's."""
        if any(hit.mover in GRIPPER or hit.mover == HELD for hit in hits):
            self._goals.add(id(goal))


def is_base_free(planner: Planner, base: Array, margin_m: float) -> bool:
    """Decides whether base and shoulder have room at a pose (3,), whatever the rest of the arm does.

    Under a low table there is room for the base alone: what the shoulder meets leaning back, and meets leaning forward
    as well, it meets in all postures.
    """
    near = planner.oracle.hits(np.concatenate([base, ARM_HOME]), margin_m=margin_m)
    movers = {hit.mover for hit in near}
    if BASE & movers:
        return False
    if not movers & SHOULDER:
        return True
    forward = planner.oracle.hits(np.concatenate([base, LEANING_FORWARD]), margin_m=margin_m)
    return not {hit.mover for hit in forward} & SHOULDER


class FreeFloor:
    """Whether the base has room, with a memory: many hand goals lead to the same base pose."""

    def __init__(self, planner: Planner, margin_m: float) -> None:
        self._planner, self._margin_m = planner, margin_m
        self._known: dict[tuple[float, ...], bool] = {}

    def at(self, base: Array) -> bool:
        """Decides whether the base has room at a pose (3,)."""
        key = tuple(np.round(base, 5))
        if key not in self._known:
            self._known[key] = is_base_free(self._planner, base, self._margin_m)
        return self._known[key]


class ArmSolver:
    """Inverse kinematics with a memory: postures depend on the hand's pose in the base frame alone."""

    def __init__(self, planner: Planner, restarts: int = 24) -> None:
        self._planner = planner
        self._restarts = restarts
        self._known: dict[tuple[float, ...], list[ArmSolution]] = {}

    def solve(self, T_world_eef: Array, base: Array, *, either_side: bool) -> list[ArmSolution]:
        """Returns arm postures for a hand pose, best margin first; `either_side` admits the half-turned hand too."""
        kinematics = self._planner.kinematics
        T_base_eef = inverse(kinematics.base_transform(base)) @ T_world_eef
        found: list[ArmSolution] = []
        for T in (T_base_eef, T_base_eef @ HALF_TURN) if either_side else (T_base_eef,):
            key = tuple(np.round(T[:3], 4).ravel())
            if key not in self._known:
                self._known[key] = kinematics.solve(T, np.zeros(3), restarts=self._restarts)
            found += self._known[key]
        return sorted(found, key=lambda s: -s.margin_rad)


def is_comfortable(choice: Scored) -> bool:
    """Decides whether a choice is good enough not to look for a better one."""
    return choice.margin_rad >= ENOUGH_MARGIN_RAD and choice.clearance_m >= ENOUGH_CLEARANCE_M


def tightness_cost(clearance_m: float) -> float:
    """Returns what a clearance costs, in rad of joint margin; nothing from `ROOMY_M` on."""
    return TIGHTNESS_COST * max(0.0, 1.0 - clearance_m / ROOMY_M)


def best_first(examined: Iterable[Choice | None], batch: int) -> Iterator[Choice]:
    """Yields choices, good ones first, while candidates are still being examined.

    The best one so far is yielded as soon as its margin and clearance are comfortable, or when a batch of candidates
    has been looked at since the last one. Asking for the next one means that the last one could not be used.

    Args:
        examined: For every candidate what came of it: a choice, or None.
        batch: How many candidates to look at before settling for less.
    """
    waiting: list[tuple[float, int, Choice]] = []
    order = itertools.count()
    looked_at = 0
    for choice in examined:
        looked_at += 1
        if choice is not None:
            heapq.heappush(waiting, (-choice.score, next(order), choice))
        comfortable = bool(waiting) and is_comfortable(waiting[0][2])
        if waiting and (comfortable or looked_at >= batch):
            yield heapq.heappop(waiting)[2]
            looked_at = 0
    while waiting:
        yield heapq.heappop(waiting)[2]


@dataclass(frozen=True, slots=True)
class NearMiss:
    """The posture that comes nearest to a hand pose.

    Attributes:
        arm: (7,) the posture in rad.
        residual_m: How far the hand is off the place.
        residual_rad: How far it is off the direction.
        at_limit: Joints that are at a limit.
    """

    arm: Array
    residual_m: float
    residual_rad: float
    at_limit: tuple[str, ...]

    @property
    def off_m(self) -> float:
        """Both in one number; smaller is nearer."""
        return float(np.hypot(self.residual_m, TURN_M_PER_RAD * self.residual_rad))

    def words(self, what: str) -> str:
        """Returns the miss as a sentence about the thing that the hand was to get to."""
        held = f", held by {' and '.join(self.at_limit)}" if self.at_limit else ""
        turned = f" and {np.rad2deg(self.residual_rad):.0f} deg"
        return f"the hand stays {self.residual_m * 100:.1f} cm{turned} off {what} from every stance{held}"

    def added_to(self, found: Unplanned) -> Unplanned:
        """Returns what was found with the miss as numbers."""
        residual_m, residual_deg = round(self.residual_m, 4), round(float(np.rad2deg(self.residual_rad)), 1)
        return replace(found, residual_m=residual_m, residual_deg=residual_deg, joints_at_limit=self.at_limit)


def nearest(kinematics: Kinematics, candidates: Iterable[BaseCandidate]) -> NearMiss:
    """Returns what comes nearest to its hand pose over some placements.

    It is looked for among postures that are drawn, always the same ones, and then by descent from the best of them:
    descent alone does not find out of a folded arm.

    Args:
        kinematics: The robot's.
        candidates: At least one placement.
    """
    wanted = [inverse(kinematics.base_transform(c.base)) @ c.goal.T_world_eef for c in candidates]
    lower, upper = kinematics.arm_lower + INSET_RAD, kinematics.arm_upper - INSET_RAD
    arms = np.random.default_rng(0).uniform(lower, upper, (DRAWN, 7))
    hands = np.stack([kinematics.forward(np.concatenate([np.zeros(3), arm])) for arm in arms])
    starts = []
    for number, T in enumerate(wanted):
        off_m = np.linalg.norm(_off(hands, T), axis=1)
        starts += [(float(off_m[k]), number, int(k)) for k in np.argsort(off_m, kind="stable")[:DESCENTS]]
    misses = [_descent(kinematics, wanted[number], arms[k]) for _, number, k in sorted(starts)[:DESCENTS]]
    return min(misses, key=lambda miss: miss.off_m)


def _descent(kinematics: Kinematics, T_base_eef: Array, start: Array) -> NearMiss:
    """Returns where the way from a posture to ever nearer ones ends."""

    def off(arm: Array) -> Array:
        return _off(kinematics.forward(np.concatenate([np.zeros(3), arm]))[None], T_base_eef)[0]

    bounds = (kinematics.arm_lower + INSET_RAD, kinematics.arm_upper - INSET_RAD)
    # Poses have single precision, so that slopes need longer steps than usual.
    found = least_squares(off, start, bounds=bounds, diff_step=SLOPE_RAD, xtol=1e-5, ftol=1e-6)
    arm, error = np.asarray(found.x), np.asarray(found.fun)
    held = np.flatnonzero(np.minimum(arm - kinematics.arm_lower, kinematics.arm_upper - arm) < AT_LIMIT_RAD)
    return NearMiss(
        arm,
        float(np.linalg.norm(error[:3])),
        float(np.linalg.norm(error[3:])) / TURN_M_PER_RAD,
        tuple(JOINT_NAMES[ARM][index] for index in held),
    )


def _off(hands: Array, T_wanted: Array) -> Array:
    """Returns (N, 6): how far hand poses (N, 4, 4) are off one, the turn counted as a length."""
    turns = Rotation.from_matrix(hands[:, :3, :3].transpose(0, 2, 1) @ T_wanted[:3, :3]).as_rotvec()
    return np.concatenate([hands[:, :3, 3] - T_wanted[:3, 3], TURN_M_PER_RAD * turns], axis=1)
