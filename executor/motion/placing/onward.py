"""Whether a hand that takes an item at some pitch can also put it where a later subtask wants it.

Most things are put down upright, so the hand keeps the pitch at which it took them. High tops are out of the reach of
steep hands, and compartments of tilted ones; better to know before taking hold.
"""

from __future__ import annotations

import itertools

import numpy as np

from executor.assets.model import Region
from executor.assets.transforms import rolls_freely
from executor.geometry import Array, inverse, pitch_of
from executor.motion.placing.place import GAPS_M, hands_over
from executor.motion.placing.search import CLEARANCE_M, MOST_CANDIDATES, TURNS_RAD, UPWARD
from executor.motion.planning.candidates import ArmSolver, BaseCandidate, FreeFloor, HandGoal, placements
from executor.motion.planning.oracle import Carried
from executor.motion.planning.paths import base_move, segment
from executor.motion.planning.planner import BASE_MARGINS_M, Planner
from executor.world.world import World

RESTARTS = 8  # Of the inverse kinematics: half of what a plan gets, it is only a forecast.
LOOKED_AT = 40
"""How many configurations over its places are looked at before one of many grasps counts as leading nowhere.

Enough where some grasp has many ways on. Where none has any among so few, as many are looked at as in the search for a
place: into a deep drawer beside a table a steep hand gets from one side alone.
"""

OVER_M, THROUGH_M = 0.08, 0.03
"""How much higher the hand comes in: over the rim of what is open at the top, or through an opening."""
SLIDE_M = 0.25  # How far before its place the hand slides in from.


class Onward:
    """Tells pitches that lead somewhere from those that do not; no ways are looked for.

    Args:
        planner: Synchronised with the world.
        world: Where things are.
        item: What is about to be taken.
        goals: The hand poses that would hold it.
        support: Id of what it will be put on or in.
        regions: The support's regions in question.
        here: (3,) where the base stands.
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
        self._support, self._regions, self._here = support, regions, here
        self._solver, self._floor = ArmSolver(planner, restarts=RESTARTS), FreeFloor(planner, BASE_MARGINS_M[-1])
        self._examples: dict[float, HandGoal] = {}
        for goal in goals:
            self._examples.setdefault(_key(goal.T_world_eef), goal)
        self._known: dict[tuple[float, int], bool] = {}

    def leads_on(self, T_world_eef: Array) -> bool:
        """Decides whether a hand at this pose has a way on; true for all where no pitch has one."""
        if rolls_freely(self._world.assets[self._item]):
            return True
        key = _key(T_world_eef)
        for looked_at in (LOOKED_AT, MOST_CANDIDATES):
            if self._leads_on(key, looked_at):
                return True
            if any(self._leads_on(other, looked_at) for other in self._examples):
                return False
        return True

    def leads_anywhere(self) -> bool:
        """Decides whether a hand at any of the pitches has a way on."""
        # What rolls is put down at other pitches than it was taken at.
        enough = 1 if rolls_freely(self._world.assets[self._item]) else None
        return any(self._leads_on(key, MOST_CANDIDATES) for key in itertools.islice(self._examples, enough))

    def _leads_on(self, key: float, looked_at: int) -> bool:
        if (key, looked_at) not in self._known:
            example = self._examples.get(key)
            self._known[key, looked_at] = example is None or self._can_be_put(example, looked_at)
        return self._known[key, looked_at]

    def _can_be_put(self, goal: HandGoal, looked_at: int) -> bool:
        world, oracle = self._world, self._planner.oracle
        carried = Carried(self._item, inverse(goal.T_world_eef) @ world.T_world_link(self._item))
        upward = {region.name: region.opening[2] > UPWARD for region in self._regions}
        wanted = hands_over(
            world,
            carried,
            self._support,
            self._regions,
            self._here,
            pitch_of(goal.T_world_eef),
            seed=self._planner.seed,
            gaps_m=lambda region: (GAPS_M[-1 if upward[region.name] else 0],),
            slid=self._slid,
        )
        oracle.carried = carried
        try:
            candidates = placements(wanted, self._here, TURNS_RAD)
            ways = (self._has_way_in(c, OVER_M if upward[c.goal.region] else THROUGH_M) for c in candidates)
            return any(itertools.islice((way for way in ways if way is not None), looked_at))
        finally:
            oracle.carried = None

    def _has_way_in(self, candidate: BaseCandidate, rise_m: float) -> bool | None:
        """Decides whether a release posture and a slide in above it are free; None where it has no posture."""
        above = candidate.goal.T_world_eef.copy()
        above[2, 3] += rise_m
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

    def _slides_in(self, q: Array) -> bool:
        out = base_move(q, SLIDE_M, float(q[2]) + np.pi)
        return self._planner.oracle.is_way_free(segment(out[1], q), margin_m=CLEARANCE_M)


def _key(T_world_eef: Array) -> float:
    return float(np.round(pitch_of(T_world_eef), 2))
