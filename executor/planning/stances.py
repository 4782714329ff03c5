"""Stances: base pose, arm posture and approach for a hand pose; candidates in order of preference; near misses."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from executor.geometry import Array, inverse, rotation_z, wrap_angle
from executor.planning.cargo import HELD
from executor.planning.collision import NOTHING, Allowed, Hit
from executor.planning.planner import Planner
from executor.sim.robot.description import base_links
from executor.sim.robot.kinematics import ArmSolution, Kinematics
from executor.system.effort import CANDIDATE_S
from oag.measurements import Unplanned
from oag.model.robots import Robot

ENOUGH_MARGIN_RAD = np.deg2rad(40.0)  # With it the search ends.
ENOUGH_CLEARANCE_M = 0.008  # And with it: four times what the robot is off its path.
ROOMY_M = 0.02  # More room than this is worth nothing.
TIGHTNESS_COST = 0.3  # In rad of joint margin, at no clearance at all.
DRIVE_COST_RAD_PER_M = 0.15  # A metre less of driving makes up for 9 degrees of joint margin.
TURN_COST = 0.05  # For each radian that the base faces away.
LIFT_COST = 0.5  # A metre of lifting, against a metre of driving.
OTHER_LIFTS_M = (0.15, -0.15)  # Off the most comfortable height, where that leads nowhere.
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
TURN_M_PER_RAD = 0.1
"""How many metres off the place a radian off the direction is worth: about the length of the hand."""

AT_LIMIT_RAD = 0.02  # So near to it a joint counts as held by its limit.
INSET_RAD = 1e-3  # Within the limits, so that rounding does not leave them.
SLOPE_RAD = 1e-3
DRAWN, DESCENTS = 1000, 4
"""How many postures are sampled, and from how many of them a descent begins."""


class Scored(Protocol):
    """Something with a joint margin in rad, a clearance and a score; larger is better for all."""

    @property
    def margin_rad(self) -> float:
        """Smallest distance to a joint limit."""

    @property
    def clearance_m(self) -> float:
        """Distance of the robot to everything that it must not touch."""

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
        opening_m: Position of each finger as the hand comes; None for fingers that are open all the way.
    """

    T_world_eef: Array
    heading_rad: float
    cost: float = 0.0
    region: str = ""
    opening_m: float | None = None

    def base_before(self, robot: Robot, reach_m: float, turn_rad: float) -> Array:
        """Return the base's coordinates (B,) at a distance before the hand, turned from the goal's heading."""
        yaw = self.heading_rad + turn_rad
        x, y = self.T_world_eef[:2, 3] - rotation_z(yaw)[:2, 0] * reach_m
        return np.array([x, y, yaw, *self.lifts_m(robot)[:1]])

    def lifts_m(self, robot: Robot) -> list[float]:
        """Return heights of a robot's lift for it, the most comfortable one first; none without a lift."""
        if not robot.lift_m:
            return []
        wrist_m = self.T_world_eef[2, 3] - robot.wrist_m * self.T_world_eef[2, 2]
        level_m, down_m = robot.comfort_m
        comfort_m = level_m + (down_m - level_m) * max(-float(self.T_world_eef[2, 2]), 0.0)
        best_m = float(wrist_m) - comfort_m - robot.mount_m
        heights = (float(np.clip(best_m + off_m, 0.0, robot.lift_m)) for off_m in (0.0, *OTHER_LIFTS_M))
        return list(dict.fromkeys(round(height_m, 3) for height_m in heights))


class BaseCandidate(NamedTuple):
    """A candidate base pose for a hand goal, with its cost."""

    goal: HandGoal
    base: Array
    cost: float


def base_candidates(
    robot: Robot,
    goals: list[HandGoal],
    here: Array,
    turns_rad: tuple[float, ...],
    reaches_m: tuple[float, ...] | None = None,
) -> Iterator[BaseCandidate]:
    """Yield base poses for all goals, the cheapest (near, straight ahead, comfortable reach) first.

    Args:
        robot: Its record.
        here: (B,) where the base stands now, or more of its configuration.
        turns_rad: How far the base may face away from the goal's heading.
        reaches_m: How far before the hand the base may be, the preferred distance first; by default the robot's.
    """
    if not goals:
        return
    reaches_m = robot.reaches_m if reaches_m is None else reaches_m
    lifted = [(goal, lift_m, rank) for goal in goals for rank, lift_m in enumerate(goal.lifts_m(robot))]
    goals = [goal for goal, _, _ in lifted] or goals
    # Thousands of candidates, of which few are looked at: what differs by reach alone is computed for all at once.
    shape = (len(goals), len(reaches_m), len(turns_rad))
    yaws = np.array([[goal.heading_rad + turn_rad for turn_rad in turns_rad] for goal in goals])
    facing = np.array([[(np.cos(yaw), np.sin(yaw)) for yaw in row] for row in yaws.tolist()])
    turning = np.array([[0.2 * abs(wrap_angle(yaw - float(here[2]))) for yaw in row] for row in yaws.tolist()])
    hands = np.array([goal.T_world_eef[:2, 3] for goal in goals])
    places = hands[:, None, None] - facing[:, None] * np.array(reaches_m)[:, None, None]
    drives = np.hypot(places[..., 0] - here[0], places[..., 1] - here[1]) + turning[:, None]
    costs = DRIVE_COST_RAD_PER_M * drives + TURN_COST * np.abs(turns_rad)
    costs = costs + np.array([goal.cost for goal in goals])[:, None, None]
    if lifted:
        lifts = np.array([[abs(lift_m - float(here[3])), rank] for _, lift_m, rank in lifted])
        costs = costs + (lifts @ [DRIVE_COST_RAD_PER_M * LIFT_COST, 0.03])[:, None, None]
    costs = (costs + 0.02 * np.arange(len(reaches_m))[:, None]).ravel()
    bases = np.concatenate([places, np.broadcast_to(yaws[:, None, :, None], (*shape, 1))], axis=-1).reshape(-1, 3)
    if lifted:
        heights = np.repeat([lift_m for _, lift_m, _ in lifted], len(reaches_m) * len(turns_rad))
        bases = np.concatenate([bases, heights[:, None]], axis=1)
    each = len(reaches_m) * len(turns_rad)
    order = np.argsort(costs, kind="stable").tolist()
    for k in order:
        yield BaseCandidate(goals[k // each], bases[k], float(costs[k]))


def candidates_of(
    planner: Planner,
    goals: list[HandGoal],
    here: Array,
    turns_rad: tuple[float, ...],
    reaches_m: tuple[float, ...] | None = None,
) -> Iterator[BaseCandidate]:
    """Return an iterator over the base candidates of a search.

    Those of a narrowed one (`Planner.narrowed_to`) are near the choice.
    """
    near = planner.near
    if near is None:
        return base_candidates(planner.robot, goals, here, turns_rad, reaches_m)
    goals = [goal for goal in goals if near.has_hand(goal.T_world_eef)]
    found = base_candidates(planner.robot, goals, here, turns_rad, reaches_m)
    return (candidate for candidate in found if near.has_base(candidate.base))


class BlockedGoals:
    """Hand goals that are infeasible for every base pose: there the hand, or what it holds, touches something."""

    def __init__(self, robot: Robot) -> None:
        self._of_hand = {*robot.gripper_links, HELD}
        self._goals: set[int] = set()

    def __contains__(self, goal: HandGoal) -> bool:
        return id(goal) in self._goals

    def learn(self, goal: HandGoal, hits: list[Hit]) -> None:
        """Record a goal where one of the hits is the gripper's or the held object's."""
        if any(hit.mover in self._of_hand for hit in hits):
            self._goals.add(id(goal))


def is_base_free(planner: Planner, base: Array, margin_m: float) -> bool:
    """Return whether base and shoulder have room at coordinates (B,), whatever the rest of the arm does.

    Under a low table there is room for the base alone: what the shoulder meets leaning back, and meets leaning forward
    as well, it meets in all postures.
    """
    return _room(planner, base, margin_m)[0]


def _room(planner: Planner, base: Array, margin_m: float) -> tuple[bool, float]:
    """Return whether base and shoulder have room, and how deep the base is within something (negative), if it is."""
    robot = planner.robot
    near = planner.oracle.hits(np.concatenate([base, robot.home]), margin_m=margin_m)
    movers, shoulder, own = {hit.mover for hit in near}, set(robot.arm_links[1:3]), base_links(robot)
    if own & movers:
        return False, min(hit.separation_m for hit in near if hit.mover in own)
    if not movers & shoulder:
        return True, 0.0
    leaning = (robot.home[0], robot.leaning_rad, *robot.home[2:])
    forward = planner.oracle.hits(np.concatenate([base, leaning]), margin_m=margin_m)
    return not {hit.mover for hit in forward} & shoulder, 0.0


CELL, DEEP_M = np.array([0.03, 0.03, 0.12, 0.15]), 0.03
"""Base poses in one cell [m, rad], of which one is so deep within something, are taken without asking the engine."""


class FreeFloor:
    """Cached test of the base's room: many hand goals lead to the same base pose.

    Args:
        planner: Knows the floor.
        margin_m: What the base keeps.
        coarse: Whether one pose answers for its cell, as is enough for a forecast.
    """

    def __init__(self, planner: Planner, margin_m: float, *, coarse: bool = False) -> None:
        self._planner, self._margin_m, self._coarse = planner, margin_m, coarse
        self._known: dict[tuple[float, ...], bool] = {}
        self._deep: set[tuple[float, ...]] = set()

    def at(self, base: Array) -> bool:
        """Return whether the base has room at coordinates (B,)."""
        self._planner.effort.add(CANDIDATE_S)
        cell = tuple(np.round(base / CELL[: len(base)]))
        key = cell if self._coarse else tuple(np.round(base, 5))
        if key not in self._known:
            taken = cell in self._deep or bool(self._planner.floor.taken(base[None])[0])
            free, within_m = (False, 0.0) if taken else _room(self._planner, base, self._margin_m)
            self._known[key] = free
            if within_m < -DEEP_M and not self._planner.robot.keeps_order:
                self._deep.add(cell)
        return self._known[key]


SAME_BRANCH_RAD = 0.5
"""A posture is on the branch of another one if no joint differs by more; within a choice joints differ by a tenth."""


class ArmSolver:
    """Cached inverse kinematics: postures depend on the hand's pose in the base frame alone."""

    def __init__(self, planner: Planner, restarts: int = 24) -> None:
        self._planner = planner
        self._restarts = restarts
        self._known: dict[tuple[float, ...], list[ArmSolution]] = {}

    def solve(self, T_world_eef: Array, base: Array, *, either_side: bool) -> list[ArmSolution]:
        """Return arm postures for a hand pose, best margin first; `either_side` admits the half-turned hand too.

        In a narrowed search those on the branch of the choice are all, where there is one.
        """
        kinematics = self._planner.kinematics
        self._planner.effort.add(CANDIDATE_S)
        T_base_eef = inverse(kinematics.base_transform(base)) @ T_world_eef
        ways = (T_base_eef, T_base_eef @ HALF_TURN) if either_side else (T_base_eef,)
        found = [one for T in ways for one in self._on_its_branch(T)]
        for T in () if found else ways:
            key = tuple(np.round(T[:3], 4).ravel())
            if key not in self._known:
                self._known[key] = kinematics.solve(T, _origin(kinematics), restarts=self._restarts)
            found += self._known[key]
        return sorted(found, key=lambda s: -s.margin_rad)

    def _on_its_branch(self, T_base_eef: Array) -> list[ArmSolution]:
        near, kinematics = self._planner.near, self._planner.kinematics
        if near is None:
            return []
        found = kinematics.solve(T_base_eef, _origin(kinematics), near=near.arm, restarts=1)
        return [one for one in found if np.abs(one.arm - near.arm).max() < SAME_BRANCH_RAD]


def is_comfortable(choice: Scored) -> bool:
    """Return whether a choice is good enough to stop searching for a better one."""
    return choice.margin_rad >= ENOUGH_MARGIN_RAD and choice.clearance_m >= ENOUGH_CLEARANCE_M


def tightness_cost(clearance_m: float) -> float:
    """Return the cost of a clearance in [rad] of joint margin; nothing from `ROOMY_M` on."""
    return TIGHTNESS_COST * max(0.0, 1.0 - clearance_m / ROOMY_M)


def best_first(examined: Iterable[Choice | None], batch: int) -> Iterator[Choice]:
    """Yield choices, good ones first, while candidates are still being examined.

    The best one so far is yielded as soon as its margin and clearance are comfortable. Else it is yielded when a batch
    of candidates has been examined since the last one. Asking for the next one means that the last one could not be
    used.

    Args:
        examined: The result for every candidate: a choice, or None.
        batch: How many candidates to examine before settling for less.
    """
    waiting: list[tuple[float, int, Choice]] = []
    order = itertools.count()
    examined_count = 0
    for choice in examined:
        examined_count += 1
        if choice is not None:
            heapq.heappush(waiting, (-choice.score, next(order), choice))
        comfortable = bool(waiting) and is_comfortable(waiting[0][2])
        if waiting and (comfortable or examined_count >= batch):
            yield heapq.heappop(waiting)[2]
            examined_count = 0
    while waiting:
        yield heapq.heappop(waiting)[2]


@dataclass(frozen=True, slots=True)
class NearMiss:
    """The posture that comes nearest to a hand pose.

    Attributes:
        arm: (A,) the posture in rad.
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
        """Both residuals in one number [m]; smaller is nearer."""
        return float(np.hypot(self.residual_m, TURN_M_PER_RAD * self.residual_rad))

    def describe(self, what: str) -> str:
        """Return the miss as a sentence about the thing that the hand was to get to."""
        held = f", held by {' and '.join(self.at_limit)}" if self.at_limit else ""
        turned = f" and {np.rad2deg(self.residual_rad):.0f} deg"
        return f"the hand stays {self.residual_m * 100:.1f} cm{turned} off {what} from every stance{held}"

    def added_to(self, found: Unplanned) -> Unplanned:
        """Return a measurement with the miss added as numbers."""
        residual_m, residual_deg = round(self.residual_m, 4), round(float(np.rad2deg(self.residual_rad)), 1)
        return replace(found, residual_m=residual_m, residual_deg=residual_deg, joints_at_limit=self.at_limit)


def nearest_miss(kinematics: Kinematics, candidates: Iterable[BaseCandidate]) -> NearMiss:
    """Return the posture that comes nearest to its hand pose over some candidates.

    It is searched for among sampled postures, always the same ones, and then by descent from the best of them. Descent
    alone does not find out of a folded arm.

    Args:
        candidates: At least one.
    """
    wanted = [inverse(kinematics.base_transform(c.base)) @ c.goal.T_world_eef for c in candidates]
    lower, upper = kinematics.arm_lower + INSET_RAD, kinematics.arm_upper - INSET_RAD
    arms = np.random.default_rng(0).uniform(lower, upper, (DRAWN, len(lower)))
    hands = np.stack([kinematics.forward(np.concatenate([_origin(kinematics), arm])) for arm in arms])
    starts = []
    for number, T in enumerate(wanted):
        off_m = np.linalg.norm(_off(hands, T), axis=1)
        starts += [(float(off_m[k]), number, int(k)) for k in np.argsort(off_m, kind="stable")[:DESCENTS]]
    misses = [_descent(kinematics, wanted[number], arms[k]) for _, number, k in sorted(starts)[:DESCENTS]]
    return min(misses, key=lambda miss: miss.off_m)


def _descent(kinematics: Kinematics, T_base_eef: Array, start: Array) -> NearMiss:
    def off(arm: Array) -> Array:
        return _off(kinematics.forward(np.concatenate([_origin(kinematics), arm]))[None], T_base_eef)[0]

    bounds = (kinematics.arm_lower + INSET_RAD, kinematics.arm_upper - INSET_RAD)
    # Poses have single precision, so that slopes need longer steps than usual.
    found = least_squares(off, start, bounds=bounds, diff_step=SLOPE_RAD, xtol=1e-5, ftol=1e-6)
    arm, error = np.asarray(found.x), np.asarray(found.fun)
    held = np.flatnonzero(np.minimum(arm - kinematics.arm_lower, kinematics.arm_upper - arm) < AT_LIMIT_RAD)
    return NearMiss(
        arm,
        float(np.linalg.norm(error[:3])),
        float(np.linalg.norm(error[3:])) / TURN_M_PER_RAD,
        tuple(kinematics.robot.arm_joints[index] for index in held),
    )


def _origin(kinematics: Kinematics) -> Array:
    """Return the base's coordinates (B,) at which its frame is the world's."""
    return np.zeros(len(kinematics.robot.base_joints))


def _off(hands: Array, T_wanted: Array) -> Array:
    """Return (N, 6) pose errors of hand poses (N, 4, 4) against one pose, the turn counted as a length."""
    turns = Rotation.from_matrix(hands[:, :3, :3].transpose(0, 2, 1) @ T_wanted[:3, :3]).as_rotvec()
    return np.concatenate([hands[:, :3, 3] - T_wanted[:3, 3], TURN_M_PER_RAD * turns], axis=1)


PARKED_CLEARANCE_M = 0.02  # Of the base where it stands to work.
PRE_GRASP_CLEARANCE_M = 0.002  # What the robot is off its path.
GRASP_CLEARANCE_M = 0.0015  # Less, where the fingers are around a thing.
APPROACH_M = 0.10
"""Length of the straight approach: the fingers come from clear of the thing."""

ENOUGH_SCORE_RAD = 0.9
"""Joint margin beyond this does not make a stance better."""

Followup = TypeVar("Followup")
Validate = Callable[[Array], tuple[Followup, float] | None]


@dataclass(frozen=True, slots=True)
class Stance(Generic[Followup]):
    """A base pose with an arm posture that reaches a hand goal.

    Attributes:
        robot: The record of whose stance it is.
        q: (Q,) base and arm at the goal.
        approach: (N, Q) straight approach, from the pre-grasp configuration to q.
        margin_rad: Smallest distance to a joint limit along the approach.
        clearance_m: Distance of the robot at the goal to everything that it must not touch, at most `ROOMY_M`.
        followup: The validation's plan for the motion that comes after.
        score: Joint margin less costs; larger is better.
        opening_m: Position of each finger during the approach; None for fingers that are open all the way.
    """

    robot: Robot
    q: Array
    approach: Array
    margin_rad: float
    clearance_m: float
    followup: Followup
    score: float
    opening_m: float | None = None

    @property
    def base(self) -> Array:
        """Where the base stands, (B,)."""
        return self.q[self.robot.base]

    def turned(self, angle_rad: float) -> Stance[Followup]:
        """Return the same stance with the base's yaw shifted by whole turns."""
        q, approach = self.q.copy(), self.approach.copy()
        q[2] += angle_rad
        approach[:, 2] += angle_rad
        return replace(self, q=q, approach=approach)

    def shifted(self, by_m: Array) -> Stance[Followup]:
        """Return the same stance with the base, and so the hand, moved by (2,) in the world."""
        q, approach = self.q.copy(), self.approach.copy()
        q[:2] += by_m
        approach[:, :2] += by_m
        return replace(self, q=q, approach=approach)


def search_stances(
    planner: Planner,
    goals: list[HandGoal],
    here: Array,
    *,
    validate: Validate[Followup],
    allowed: Allowed = NOTHING,
    turns_rad: tuple[float, ...] = (0.0, 0.3, -0.3),
    reaches_m: tuple[float, ...] | None = None,
    batch: int = 60,
    admits: Callable[[BaseCandidate], bool] | None = None,
) -> Iterator[Stance[Followup]]:
    """Yield stances, good ones first; asking for the next one means that the last one could not be used.

    Args:
        planner: Oracle and kinematics.
        here: (B,) where the base stands now.
        validate: Examines the configuration at the goal (Q,). It returns the motion that comes after with an extra
            cost, or None where that is impossible.
        allowed: Intended contacts during the approach's end.
        turns_rad: How far the base may face away from the goal's heading.
        reaches_m: How far before the hand the base may be.
        batch: How many free base poses to examine before settling for less.
        admits: Whether a candidate allows what comes after, asked before any posture is solved for; None where all do.
    """
    solver = ArmSolver(planner)
    blocked, floor = BlockedGoals(planner.robot), FreeFloor(planner, PARKED_CLEARANCE_M)

    def examine() -> Iterator[Stance[Followup] | None]:
        for candidate in candidates_of(planner, goals, here, turns_rad, reaches_m):
            if candidate.goal in blocked or not floor.at(candidate.base):
                continue
            if admits is None or admits(candidate):
                yield _stance(planner, solver, candidate, validate, allowed, blocked)

    return best_first(examine(), batch)


def _stance(
    planner: Planner,
    solver: ArmSolver,
    candidate: BaseCandidate,
    validate: Validate[Followup],
    allowed: Allowed,
    blocked: BlockedGoals,
) -> Stance[Followup] | None:
    """Return the first stance at a base pose whose approach is free and whose follow-up is possible, or None."""
    oracle, kinematics = planner.oracle, planner.kinematics
    narrowed_m = candidate.goal.opening_m
    opening_m = kinematics.finger_upper_m if narrowed_m is None else narrowed_m
    for solution in solver.solve(candidate.goal.T_world_eef, candidate.base, either_side=True)[:3]:
        q = np.concatenate([candidate.base, solution.arm])
        if hits := oracle.hits(q, opening_m=opening_m, margin_m=GRASP_CLEARANCE_M, allowed=allowed):
            blocked.learn(candidate.goal, hits)
            continue
        T_back = kinematics.forward(q)
        T_back[:3, 3] -= APPROACH_M * T_back[:3, 2]
        line = planner.line(q, T_back).path
        if line is None:
            continue
        # Only at its end may the open fingers be that close to what they take: on the way they would push it aside.
        if hit := oracle.first_hit(line, opening_m=opening_m):
            blocked.learn(candidate.goal, [hit])
            continue
        if hits := oracle.hits(line[-1], opening_m=opening_m, margin_m=PRE_GRASP_CLEARANCE_M):
            blocked.learn(candidate.goal, hits)
            continue
        checked = validate(q)
        if checked is None:
            continue
        followup, extra = checked
        margin = kinematics.margin(line[:, planner.robot.arm])
        clearance_m = oracle.gap_m(q, ROOMY_M, opening_m=opening_m, allowed=allowed)
        score = min(margin, ENOUGH_SCORE_RAD) - candidate.cost - extra - tightness_cost(clearance_m)
        return Stance(planner.robot, q, line[::-1].copy(), margin, clearance_m, followup, score, narrowed_m)
    return None
