"""Decide before a grasp whether the hand, at the grasp's pitch, can also place the item where a later subtask wants it.

Most things are put down upright, so the hand keeps the pitch of the grasp. High tops are out of reach of steep hands,
and compartments of tilted ones.
"""

from __future__ import annotations

import itertools

import numpy as np

from executor.assets.asset_geometry import rolls_freely
from executor.assets.model import Region
from executor.geometry import Array, pitch_of
from executor.planning.cargo import cargo_of, carried_by
from executor.planning.paths import base_move, segment
from executor.planning.place_search import (
    CLEARANCE_M,
    MOST_CANDIDATES,
    OVER_M,
    TURNS_RAD,
    HeadingStatistics,
    reaches_into,
    rise_m,
)
from executor.planning.placements import placement_goals
from executor.planning.planner import BASE_MARGINS_M, Planner
from executor.planning.stances import (
    ArmSolver,
    BaseCandidate,
    BlockedGoals,
    FreeFloor,
    HandGoal,
    base_candidates,
)
from executor.sim.world import World

LOOKAHEAD_RESTARTS = 8  # Of the inverse kinematics: half of a plan's, since this is only a forecast.
LOOKED_AT = 40
"""How many configurations over its places are examined before one of many grasps counts as infeasible.

Enough where some grasp allows many placements. Where none has any among so few, as many are examined as in the search
for a place: into a deep drawer next to a table a steep hand gets from one side alone.
"""

FORECAST_CANDIDATES = 200
"""The same where sides on which the arm had no room come last: of what is left, so many are enough."""

SLIDE_M = 0.25  # How far before its place the hand slides in from.


class PlacementLookahead:
    """Decides which pitches of a grasp allow a later placement; no paths are planned.

    Args:
        planner: Synchronised with the world.
        item: What is about to be taken.
        goals: The hand poses that would hold it.
        support: Id of what it will be put on or in.
        regions: The support's regions in question.
        here: (B,) where the base stands.
        slid: (4, 4) by what the regions will have moved until then, in the world: with a drawer that is to be opened.
    """

    def __init__(
        self,
        planner: Planner,
        world: World,
        item: str,
        goals: list[HandGoal],
        support: str,
        regions: list[Region],
        here: Array,
        slid: Array | None = None,
    ) -> None:
        self._slid = np.eye(4) if slid is None else slid
        self._planner, self._world, self._item = planner, world, item
        self._cargo = cargo_of(world, item)
        self._support, self._regions, self._here = support, regions, here
        self._solver, self._floor = (
            ArmSolver(planner, restarts=LOOKAHEAD_RESTARTS),
            FreeFloor(planner, BASE_MARGINS_M[-1], coarse=not planner.robot.keeps_order),
        )
        self._examples: dict[float, HandGoal] = {}
        for goal in goals:
            self._examples.setdefault(_key(goal.T_world_eef), goal)
        self._known: dict[tuple[float, int], bool] = {}

    def allows_placement(self, T_world_eef: Array) -> bool:
        """Return whether a hand at this pose can place the item; true for all where no pitch can."""
        if rolls_freely(self._world.assets[self._item]):
            return True
        key = _key(T_world_eef)
        for budget in (LOOKED_AT, MOST_CANDIDATES):
            if self._allows_placement(key, budget):
                return True
            if any(self._allows_placement(other, budget) for other in self._examples):
                return False
        return True

    def allows_any_placement(self) -> bool:
        """Return whether a hand at any of the pitches can place the item."""
        # What rolls is put down at other pitches than it was taken at.
        enough = 1 if rolls_freely(self._world.assets[self._item]) else None
        return any(self._allows_placement(key, MOST_CANDIDATES) for key in itertools.islice(self._examples, enough))

    def _allows_placement(self, key: float, budget: int) -> bool:
        if (key, budget) not in self._known:
            example = self._examples.get(key)
            allows, exhausted = (True, False) if example is None else self._can_be_put(example, budget)
            self._known[key, budget] = allows
            if exhausted:
                self._known[key, MOST_CANDIDATES] = False
        return self._known[key, budget]

    def _can_be_put(self, goal: HandGoal, budget: int) -> tuple[bool, bool]:
        """Return whether a hand can place the item, and whether all candidates were looked at within the budget."""
        world, oracle = self._world, self._planner.oracle
        carried = carried_by(world, self._item, goal.T_world_eef, self._cargo)
        robot, height_m = (
            self._planner.robot,
            0.0 if self._planner.robot.keeps_order else world.assets[self._item].extent_m[2],
        )
        rises_m = {r.name: OVER_M if r.opens_upward else rise_m(r, height_m) for r in self._regions}
        wanted = placement_goals(
            world,
            carried,
            self._support,
            self._regions,
            self._here,
            pitch_of(goal.T_world_eef),
            seed=self._planner.seed,
            forecast=True,
            slid=self._slid,
        )
        oracle.carried = carried
        try:
            candidates, looked_at = (
                base_candidates(robot, wanted, self._here, TURNS_RAD, reaches_into(robot, self._regions)),
                0,
            )
            blocked, sides = BlockedGoals(robot), HeadingStatistics(robot)
            budget = budget if robot.keeps_order else min(budget, FORECAST_CANDIDATES)
            for candidate in candidates if robot.keeps_order else sides.roomy_first(candidates):
                raised_m = rises_m[candidate.goal.region]
                if robot.keeps_order:
                    way_in = self._has_way_in(candidate, raised_m)
                else:
                    way_in = self._leads_in(candidate, raised_m, blocked, sides)
                if way_in:
                    return True, False
                looked_at += way_in is not None
                if looked_at == budget:
                    return False, False
            return False, True
        finally:
            oracle.carried = None

    def _has_way_in(self, candidate: BaseCandidate, raised_m: float) -> bool | None:
        """Return whether a release posture and a slide in above it are free; None where it has no posture."""
        above = candidate.goal.T_world_eef.copy()
        above[2, 3] += raised_m
        base = candidate.base
        entries = self._solver.solve(above, base, either_side=False)[:2]
        if not (entries and self._floor.at(base)):
            return None
        oracle = self._planner.oracle
        released = (
            oracle.is_free(np.concatenate([base, solution.arm]), margin_m=CLEARANCE_M)
            for solution in self._solver.solve(candidate.goal.T_world_eef, base, either_side=False)[:2]
        )
        return any(released) and any(self._slides_in(np.concatenate([base, s.arm])) for s in entries)

    def _leads_in(
        self, candidate: BaseCandidate, raised_m: float, blocked: BlockedGoals, sides: HeadingStatistics
    ) -> bool | None:
        """Decide the same as `_has_way_in`; ask first what excludes most: a hand that meets something, the floor.

        None where a place is excluded for all bases, or the base has no room.
        """
        goal, base, oracle = candidate.goal, candidate.base, self._planner.oracle
        if goal in blocked or not self._floor.at(base):
            return None
        free = False
        for solution in self._solver.solve(goal.T_world_eef, base, either_side=False)[:2]:
            hits = oracle.hits(np.concatenate([base, solution.arm]), margin_m=CLEARANCE_M)
            blocked.learn(goal, hits)
            sides.learn(goal, hits)
            free = free or not hits
        if not free:
            return False
        above = goal.T_world_eef.copy()
        above[2, 3] += raised_m
        entries = self._solver.solve(above, base, either_side=False)[:2]
        return any(self._slides_in(np.concatenate([base, solution.arm])) for solution in entries)

    def _slides_in(self, q: Array) -> bool:
        out = base_move(q, SLIDE_M, float(q[2]) + np.pi)
        return self._planner.oracle.is_path_free(segment(self._planner.robot, out[1], q), margin_m=CLEARANCE_M)


def _key(T_world_eef: Array) -> float:
    return float(np.round(pitch_of(T_world_eef), 2))
