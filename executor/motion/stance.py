"""Where to stand and how to hold the arm so that the hand gets to a pose, its approach included."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from executor.geometry import Array, inverse, rotation_z, wrap_angle
from executor.motion.contacts import NOTHING, Allowed
from executor.motion.planner import Planner
from executor.robot.description import ARM_HOME
from executor.robot.kinematics import ArmSolution

Followup = TypeVar("Followup")

REACHES_M = (0.45, 0.40, 0.50, 0.35, 0.55)
ENOUGH_MARGIN_RAD = np.deg2rad(40.0)
BASE_CLEARANCE_M = 0.02
DRIVE_COST_RAD_PER_M = 0.15
TURN_COST = 0.05
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True, slots=True)
class HandGoal:
    """A wanted hand pose, the heading from which the robot faces it, and a cost in rad of joint margin."""

    T_world_eef: Array
    heading_rad: float
    cost: float = 0.0


@dataclass(frozen=True, slots=True)
class Stance(Generic[Followup]):
    """A base pose with an arm posture that reaches a hand goal.

    Attributes:
        q: (10,) base and arm at the goal.
        approach: (N, 10) straight approach, from the pre-grasp configuration to q.
        margin_rad: Smallest distance to a joint limit along the approach.
        followup: What the validation found for the motion that comes after.
        score: Joint margin less costs; larger is better.
    """

    q: Array
    approach: Array
    margin_rad: float
    followup: Followup
    score: float

    def turned(self, angle_rad: float) -> Stance[Followup]:
        """Returns the same stance with the base's yaw counted from elsewhere (by whole turns)."""
        q, approach = self.q.copy(), self.approach.copy()
        q[2] += angle_rad
        approach[:, 2] += angle_rad
        return replace(self, q=q, approach=approach)


@dataclass(frozen=True, slots=True)
class Placement:
    """A candidate base pose for a hand goal, with its cost."""

    goal: HandGoal
    base: Array
    cost: float


def placements(goals: list[HandGoal], here: Array, turns_rad: tuple[float, ...]) -> list[Placement]:
    """Returns base poses for all goals, the cheapest (near, straight ahead, comfortable reach) first.

    Args:
        goals: Wanted hand poses.
        here: (3,) where the base stands now.
        turns_rad: How far the base may face away from the goal's heading.
    """
    found = []
    for goal, (rank, reach_m), turn_rad in itertools.product(goals, enumerate(REACHES_M), turns_rad):
        yaw = goal.heading_rad + turn_rad
        xy = goal.T_world_eef[:2, 3] - rotation_z(yaw)[:2, 0] * reach_m
        drive = float(np.hypot(*(xy - here[:2]))) + 0.2 * abs(wrap_angle(yaw - float(here[2])))
        cost = DRIVE_COST_RAD_PER_M * drive + TURN_COST * abs(turn_rad) + goal.cost + 0.02 * rank
        found.append(Placement(goal, np.array([xy[0], xy[1], yaw]), cost))
    return sorted(found, key=lambda p: p.cost)


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


def search(
    planner: Planner,
    goals: list[HandGoal],
    here: Array,
    *,
    validate: Callable[[Array], tuple[Followup, float] | None],
    standoff_m: float = 0.10,
    allowed: Allowed = NOTHING,
    turns_rad: tuple[float, ...] = (0.0, 0.3, -0.3),
    batch: int = 60,
) -> Iterator[Stance[Followup]]:
    """Yields stances, good ones first; asking for the next one means that the last one could not be used.

    A stance is yielded as soon as its joint margin is comfortable, or when a batch of candidates has been looked at.

    Args:
        planner: Oracle and kinematics.
        goals: Wanted hand poses.
        here: (3,) where the base stands now.
        validate: Looks at the configuration at the goal (10,) and returns what comes after with an extra cost, or
            None when what comes after is impossible.
        standoff_m: Length of the straight approach.
        allowed: Contacts that are meant to be during the approach's end.
        turns_rad: How far the base may face away from the goal's heading.
        batch: How many free base poses to look at before settling for less.
    """
    oracle, kinematics = planner.oracle, planner.kinematics
    opening_m = kinematics.finger_upper_m
    solver = ArmSolver(planner)
    waiting: list[tuple[float, int, Stance[Followup]]] = []
    looked_at = 0
    order = itertools.count()
    for candidate in placements(goals, here, turns_rad):
        parked = np.concatenate([candidate.base, ARM_HOME])
        if any(hit.mover == "base_body" for hit in oracle.hits(parked, margin_m=BASE_CLEARANCE_M)):
            continue
        looked_at += 1
        for solution in solver.solve(candidate.goal.T_world_eef, candidate.base, either_side=True)[:3]:
            q = np.concatenate([candidate.base, solution.arm])
            if oracle.hits(q, opening_m=opening_m, allowed=allowed):
                continue
            T_back = kinematics.forward(q)
            T_back[:3, 3] -= standoff_m * T_back[:3, 2]
            line = planner.line(q, T_back).path
            if line is None or oracle.first_hit(line, opening_m=opening_m, allowed=allowed) is not None:
                continue
            if oracle.hits(line[-1], opening_m=opening_m, margin_m=0.002):
                continue
            checked = validate(q)
            if checked is None:
                continue
            followup, extra = checked
            margin = kinematics.margin(line[:, 3:10])
            stance = Stance(q, line[::-1].copy(), margin, followup, min(margin, 0.9) - candidate.cost - extra)
            heapq.heappush(waiting, (-stance.score, next(order), stance))
            break
        comfortable = waiting and waiting[0][2].margin_rad >= ENOUGH_MARGIN_RAD
        if waiting and (comfortable or looked_at >= batch):
            yield heapq.heappop(waiting)[2]
            looked_at = 0
    while waiting:
        yield heapq.heappop(waiting)[2]
