"""How to put a held thing down: spot, hand, base, entry and the numbers of the moves in between, chosen together.

Planning runs backwards. From a configuration that holds the thing over its spot, the flow's moves are undone to find
where NAVIGATE_TO_SUPPORT has to end; then the moves are run forwards exactly as the primitives will run them, and
checked. Numbers that the flow gives are kept; unfilled ones are chosen from short lists. Where no way is found, what
was met at the configurations over the spots says why.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from executor.assets.model import Region
from executor.geometry import Array, pitch_of
from executor.motion.placing.place import hands_over
from executor.motion.planning.candidates import (
    REACHES_M,
    ROOMY_M,
    ArmSolver,
    BaseCandidate,
    Blocked,
    FreeFloor,
    HandGoal,
    best_first,
    nearest,
    placements,
    tightness_cost,
)
from executor.motion.planning.moves import run_moves, undo_moves
from executor.motion.planning.oracle import GRIPPER, HELD, Carried, Hit
from executor.motion.planning.paths import FINE_ARM_STEP_RAD, polyline
from executor.motion.planning.planner import BASE_MARGINS_M, Planner
from executor.motion.planning.stance import ENOUGH_SCORE_RAD
from executor.records.rollout import Failure, FailureKind
from executor.robot.kinematics import ARM
from executor.world.world import World
from oag import Action, Primitive
from oag.revision.measurements import Unplanned

LENGTHS_M: dict[Primitive, tuple[float, ...]] = {
    Primitive.MOVE_BASE_FORWARD: (0.45, 0.35, 0.25),
    Primitive.LIFT_EEF_DOWN: (0.03, 0.08),
}
OTHER_LENGTHS_M = (0.10, 0.05)  # Short ways: the base has brought the hand near.
OVER_RIM_M = 0.03
"""How far above the rim of a drawer a thing is brought in: arms are off their paths by millimetres, and things lean."""

TURNS_RAD = (0.0, 0.15, -0.15, 0.35, -0.35)  # How far the base may face away from its place, straight ahead first.
RELEASE_TOLERANCE_M = 0.004  # Between the wanted release and where the moves, run forwards, end.
CLEARANCE_M = 0.003  # More than the robot is off its path.
OPENED_CLEARANCE_M = 0.002  # Of the fingers as they open.
FINE_SHARE = 0.25  # Of the base's usual steps: thin things are not stepped over.
OPTION_COST = 0.03  # For each filling of open numbers after the preferred one.
RESTARTS = 16  # Of the inverse kinematics.
BATCH = 80  # Looked at before a plan that is not comfortable is taken.
MOST_CANDIDATES = 400
"""How many configurations over a spot are looked at before given numbers count as leading nowhere."""

MORE_CANDIDATES = 800
"""How many more where numbers are open, from the sides first on which the arm had room."""

ENOUGH_MET = 12
"""After so many postures that met something with the arm, and none that did not, a side counts as taken."""

EXPLAINED = 100
"""How many configurations are looked at to say what is in the way, and of how many bases that have room."""

MISSES, NAMED = 40, 3
UPWARD = 0.5  # Of an opening's direction: from here on things come in from above.


@dataclass(frozen=True, slots=True)
class PlacePlan:
    """How a held thing gets to its place.

    Attributes:
        entry: (10,) where NAVIGATE_TO_SUPPORT ends.
        path: (N, 10) waypoints of the moves, entry first, release last.
        moves: The moves with all numbers filled in.
        region: Name of the region.
        margin_rad: Smallest joint margin along the moves.
        clearance_m: How far everything is from everything on the way in, at most `ROOMY_M`.
        score: Joint margin less costs.
    """

    entry: Array
    path: Array
    moves: tuple[Action, ...]
    region: str
    margin_rad: float
    clearance_m: float
    score: float

    @property
    def base(self) -> Array:
        """Where the base stands when NAVIGATE_TO_SUPPORT ends, (3,)."""
        return self.entry[:3]


class Sides:
    """What was seen of each heading: a bowl near one edge of a table is reached over that edge alone."""

    def __init__(self) -> None:
        self._met: Counter[tuple[str, float]] = Counter()
        self._free: set[tuple[str, float]] = set()

    def learn(self, goal: HandGoal, hits: list[Hit]) -> None:
        """Takes note of what a posture at a hand pose met; what the hand alone meets says nothing about its side."""
        if not hits:
            self._free.add(_side(goal))
        elif any(hit.mover not in GRIPPER and hit.mover != HELD for hit in hits):
            self._met[_side(goal)] += 1

    def is_taken(self, goal: HandGoal) -> bool:
        """Decides whether the arm has met something in all of many postures from this side."""
        side = _side(goal)
        return side not in self._free and self._met[side] >= ENOUGH_MET

    def roomy_first(self, candidates: Iterable[BaseCandidate]) -> Iterator[BaseCandidate]:
        """Yields candidates in their order, those from sides that count as taken when their turn comes last."""
        waiting: list[BaseCandidate] = []
        for candidate in candidates:
            if self.is_taken(candidate.goal):
                waiting.append(candidate)
            else:
                yield candidate
        yield from waiting


def _side(goal: HandGoal) -> tuple[str, float]:
    return goal.region, float(np.round(np.mod(goal.heading_rad, 2 * np.pi), 2))


@dataclass(frozen=True, slots=True)
class PlaceSearch:
    """The search for a place of what is in the gripper.

    Attributes:
        planner: Its oracle must be synchronised and know what is carried.
        world: Where things are.
        support: Id of what the thing is put on or in.
        regions: The support's regions to try.
        q: (10,) where the robot is, holding the thing.
    """

    planner: Planner
    world: World
    support: str
    regions: list[Region]
    q: Array

    @property
    def carried(self) -> Carried:
        """What is in the gripper.

        Raises:
            ValueError: Nothing is.
        """
        if self.planner.oracle.carried is None:
            raise ValueError("planning a placement needs something in the gripper")
        return self.planner.oracle.carried

    def plans(self, moves: tuple[Action, ...]) -> Iterator[PlacePlan]:
        """Yields plans that put the thing into or onto the regions, good ones first.

        Args:
            moves: The flow's moves between navigation and release, filled or not.

        Raises:
            ValueError: Nothing is carried.
        """
        goals, options = self._goals(), fill_options(moves, lowerings_m(self.regions))
        solver, floor = ArmSolver(self.planner, RESTARTS), FreeFloor(self.planner, BASE_MARGINS_M[-1])
        blocked, sides = Blocked(), Sides()
        room: dict[int, bool] = {}

        def has_room(goal: HandGoal) -> bool:
            if id(goal) not in room:
                room[id(goal)] = self._hand_has_room(goal, solver, blocked)
            return room[id(goal)]

        def examine(candidates: Iterable[BaseCandidate]) -> Iterator[PlacePlan | None]:
            roomy = (candidate for candidate in candidates if has_room(candidate.goal))
            for candidate, releases in _releases(roomy, solver, floor, blocked):
                yield self._first_plan(candidate, releases, options, blocked, sides)

        candidates = iter(placements(goals, self.q, TURNS_RAD))
        first = itertools.islice(examine(candidates), MOST_CANDIDATES)
        # Numbers that are given and lead nowhere are for the flow's author to correct.
        more_count = MORE_CANDIDATES if any(action.parameter is None for action in moves) else 0
        more = itertools.islice(examine(sides.roomy_first(candidates)), more_count)
        for plan in itertools.chain(best_first(first, BATCH), best_first(more, BATCH)):
            fine = polyline(plan.path, FINE_ARM_STEP_RAD, base_share=FINE_SHARE) if len(plan.path) > 1 else plan.path
            if self.planner.oracle.is_way_free(fine, margin_m=CLEARANCE_M):
                yield plan

    def why_not(self, moves: tuple[Action, ...]) -> Failure:
        """Returns a failure: that there is no free spot, how far the hand stays off all of them, or what is in the way.

        Args:
            moves: As for `plans`, which found none that could be driven to.

        Raises:
            ValueError: Nothing is carried.
        """
        goals, item = self._goals(), self.carried.object_id
        what = f"no place for {item} at {self.support} was found"
        found = Unplanned(target=item, support=self.support)
        if not goals:
            return Failure(FailureKind.NO_PATH, f"{what}: no spot is free on which it would stand", (found,))
        candidates = placements(goals, self.q, TURNS_RAD)
        solver, floor = ArmSolver(self.planner, RESTARTS), FreeFloor(self.planner, BASE_MARGINS_M[-1])
        standing = [c for c in itertools.islice(candidates, 20 * EXPLAINED) if floor.at(c.base)]
        if not standing:
            return Failure(FailureKind.NO_PATH, f"{what}: the floor before all spots is taken", (found,))
        releases = itertools.islice(_releases(standing, solver, floor, Blocked()), EXPLAINED)
        options = fill_options(moves, lowerings_m(self.regions))
        met = [self._met(release, options[0]) for _, (release, *_) in releases]
        if not met:
            miss = nearest(self.planner.kinematics, standing[:MISSES])
            return Failure(FailureKind.UNREACHABLE, f"{what}: {miss.words('it')}", (miss.added_to(found),))
        common = Counter(met).most_common(NAMED)
        found = replace(found, looked_at=len(met), in_the_way=dict(common))
        first, count = common[0]
        return Failure(FailureKind.NO_PATH, f"{what}: {first} in {count} of {len(met)} configurations", (found,))

    def _goals(self) -> list[HandGoal]:
        pitch_rad = pitch_of(self.planner.kinematics.forward(self.q))
        seed = self.planner.seed
        return hands_over(self.world, self.carried, self.support, self.regions, self.q, pitch_rad, seed=seed)

    def _hand_has_room(self, goal: HandGoal, solver: ArmSolver, blocked: Blocked) -> bool:
        """Decides whether hand and thing have room over a spot, before any floor is looked at; True where none tells.

        What they meet they meet wherever the base stands. So the base may stand within furniture here.
        """
        base = goal.base_before(REACHES_M[0], 0.0)
        for solution in solver.solve(goal.T_world_eef, base, either_side=False)[:1]:
            blocked.learn(goal, self._hits(np.concatenate([base, solution.arm])))
        return goal not in blocked

    def _hits(self, release: Array) -> list[Hit]:
        """Returns what meets at a configuration over a spot, or as the fingers open there."""
        oracle, opened_m = self.planner.oracle, self.planner.kinematics.finger_upper_m
        hits = oracle.hits(release, margin_m=CLEARANCE_M)
        return hits or oracle.hits(release, opening_m=opened_m, margin_m=OPENED_CLEARANCE_M)

    def _first_plan(
        self,
        candidate: BaseCandidate,
        releases: list[Array],
        options: list[tuple[Action, ...]],
        blocked: Blocked,
        sides: Sides,
    ) -> PlacePlan | None:
        """Returns the plan of the first configuration over the spot that is free and can be got to, or None."""
        for release in releases:
            hits = self._hits(release)
            sides.learn(candidate.goal, hits)
            if hits:
                blocked.learn(candidate.goal, hits)
            elif plan := self._approach(release, options, candidate):
                return plan
        return None

    def _approach(
        self, release: Array, options: list[tuple[Action, ...]], candidate: BaseCandidate
    ) -> PlacePlan | None:
        """Returns the plan that ends in a release configuration, or None when no filling of the moves is free."""
        oracle, kinematics = self.planner.oracle, self.planner.kinematics
        wanted = kinematics.forward(release)[:3, 3]
        for rank, filled in enumerate(options):
            entry = undo_moves(self.planner, release, list(filled))
            if entry is None or not oracle.is_free(entry, margin_m=BASE_MARGINS_M[-2]):
                continue
            path = run_moves(self.planner, entry, list(filled))
            if path is None or np.linalg.norm(kinematics.forward(path[-1])[:3, 3] - wanted) > RELEASE_TOLERANCE_M:
                continue
            if len(path) > 1 and not oracle.is_way_free(polyline(path), margin_m=CLEARANCE_M):
                continue
            margin = kinematics.margin(path[:, ARM])
            clearance_m = oracle.gap_m(_before_lowering(path), ROOMY_M)
            score = min(margin, ENOUGH_SCORE_RAD) - candidate.cost - OPTION_COST * rank - tightness_cost(clearance_m)
            return PlacePlan(entry, path, filled, candidate.goal.region, margin, clearance_m, score)
        return None

    def _met(self, release: Array, filled: tuple[Action, ...]) -> str:
        """Returns in words what keeps a configuration over a spot from being used, by moves with their numbers."""
        if hits := self._hits(release):
            return f"{_words(hits)} meet over the spot"
        entry = undo_moves(self.planner, release, list(filled))
        path = None if entry is None else run_moves(self.planner, entry, list(filled))
        if path is None:
            return "the arm does not reach the moves to the spot"
        way = polyline(path) if len(path) > 1 else path
        if hit := self.planner.oracle.first_hit(way, margin_m=CLEARANCE_M):
            return f"{_words([hit])} meet on the way in"
        return "the way there is not free"


def lowerings_m(regions: Iterable[Region]) -> tuple[float, ...]:
    """Returns how far the hand may come down over some regions, the preferred way first.

    Into what is deep and open at the top, such as a drawer, it may come down by all of the depth: it gets in over the
    front, which is as high.
    """
    usual = LENGTHS_M[Primitive.LIFT_EEF_DOWN]
    depths_m = {2 * r.half_extents_m[2] for r in regions if r.kind == "interior" and r.opening[2] > UPWARD}
    return usual + tuple(round(depth_m + OVER_RIM_M, 2) for depth_m in sorted(depths_m) if depth_m > max(usual))


def fill_options(moves: tuple[Action, ...], downs_m: tuple[float, ...]) -> list[tuple[Action, ...]]:
    """Returns the ways to fill the open numbers of moves, the preferred one first; given numbers are kept.

    Args:
        moves: The flow's moves.
        downs_m: What an open LIFT_EEF_DOWN may be, the preferred one first.
    """
    lengths_m = {**LENGTHS_M, Primitive.LIFT_EEF_DOWN: downs_m}
    values = [lengths_m.get(a.primitive, OTHER_LENGTHS_M) if a.parameter is None else (a.parameter,) for a in moves]
    return [
        tuple(replace(a, parameter=v) for a, v in zip(moves, chosen, strict=True))
        for chosen in itertools.product(*values)
    ]


def _releases(
    candidates: Iterable[BaseCandidate], solver: ArmSolver, floor: FreeFloor, blocked: Blocked
) -> Iterator[tuple[BaseCandidate, list[Array]]]:
    """Yields the candidates with room for the base, each with one or two configurations (10,) over its spot."""
    for candidate in candidates:
        if candidate.goal not in blocked and floor.at(candidate.base):
            solutions = solver.solve(candidate.goal.T_world_eef, candidate.base, either_side=False)[:2]
            if solutions:
                yield candidate, [np.concatenate([candidate.base, solution.arm]) for solution in solutions]


def _before_lowering(path: Array) -> Array:
    """Returns the first configuration (10,) with the base where the release is: what comes after is the arm's."""
    moved = np.abs(path[:, :3] - path[-1, :3]).max(axis=1) > 1e-6
    arrived = int(np.flatnonzero(moved)[-1]) + 1 if moved.any() else 0
    return np.asarray(path[min(arrived, len(path) - 1)])


def _words(hits: list[Hit]) -> str:
    hit = min(hits, key=lambda hit: hit.separation_m)
    return f"{hit.mover} and {hit.other}"
