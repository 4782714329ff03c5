"""Where to stand and how to hold the arm so that the hand gets to a pose, its approach included."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from executor.geometry import Array
from executor.motion.planning.candidates import (
    REACHES_M,
    ROOMY_M,
    ArmSolver,
    BaseCandidate,
    Blocked,
    FreeFloor,
    HandGoal,
    best_first,
    placements,
    tightness_cost,
)
from executor.motion.planning.oracle import NOTHING, Allowed
from executor.motion.planning.planner import Planner
from executor.robot.kinematics import ARM

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
        q: (10,) base and arm at the goal.
        approach: (N, 10) straight approach, from the pre-grasp configuration to q.
        margin_rad: Smallest distance to a joint limit along the approach.
        clearance_m: How far the robot is at the goal from what it does not mean to touch, at most `ROOMY_M`.
        followup: What the validation found for the motion that comes after.
        score: Joint margin less costs; larger is better.
    """

    q: Array
    approach: Array
    margin_rad: float
    clearance_m: float
    followup: Followup
    score: float

    @property
    def base(self) -> Array:
        """Where the base stands, (3,)."""
        return self.q[:3]

    def turned(self, angle_rad: float) -> Stance[Followup]:
        """Returns the same stance with the base's yaw counted from elsewhere (by whole turns)."""
        q, approach = self.q.copy(), self.approach.copy()
        q[2] += angle_rad
        approach[:, 2] += angle_rad
        return replace(self, q=q, approach=approach)

    def beside(self, by_m: Array) -> Stance[Followup]:
        """Returns the same stance with the base, and so the hand, moved by (2,) in the world."""
        q, approach = self.q.copy(), self.approach.copy()
        q[:2] += by_m
        approach[:, :2] += by_m
        return replace(self, q=q, approach=approach)


def search(
    planner: Planner,
    goals: list[HandGoal],
    here: Array,
    *,
    validate: Validate[Followup],
    allowed: Allowed = NOTHING,
    turns_rad: tuple[float, ...] = (0.0, 0.3, -0.3),
    reaches_m: tuple[float, ...] = REACHES_M,
    batch: int = 60,
) -> Iterator[Stance[Followup]]:
    """Yields stances, good ones first; asking for the next one means that the last one could not be used.

    Args:
        planner: Oracle and kinematics.
        goals: Wanted hand poses.
        here: (3,) where the base stands now.
        validate: Looks at the configuration at the goal (10,) and returns what comes after with an extra cost, or
            None when what comes after is impossible.
        allowed: Contacts that are meant to be during the approach's end.
        turns_rad: How far the base may face away from the goal's heading.
        reaches_m: How far before the hand the base may be.
        batch: How many free base poses to look at before settling for less.
    """
    solver = ArmSolver(planner)
    blocked, floor = Blocked(), FreeFloor(planner, PARKED_CLEARANCE_M)

    def examine() -> Iterator[Stance[Followup] | None]:
        for candidate in placements(goals, here, turns_rad, reaches_m):
            if candidate.goal not in blocked and floor.at(candidate.base):
                yield _stance(planner, solver, candidate, validate, allowed, blocked)

    return best_first(examine(), batch)


def _stance(
    planner: Planner,
    solver: ArmSolver,
    candidate: BaseCandidate,
    validate: Validate[Followup],
    allowed: Allowed,
    blocked: Blocked,
) -> Stance[Followup] | None:
    """Returns the first stance at a base pose whose approach is free and whose follow-up is possible, or None."""
    oracle, kinematics = planner.oracle, planner.kinematics
    opening_m = kinematics.finger_upper_m
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
        margin = kinematics.margin(line[:, ARM])
        clearance_m = oracle.gap_m(q, ROOMY_M, opening_m=opening_m, allowed=allowed)
        score = min(margin, ENOUGH_SCORE_RAD) - candidate.cost - extra - tightness_cost(clearance_m)
        return Stance(q, line[::-1].copy(), margin, clearance_m, followup, score)
    return None
