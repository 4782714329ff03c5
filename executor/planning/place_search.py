"""Search for a placement: spot, hand pose, base, entry and the numbers of the moves in between, chosen together.

Planning runs backwards. From a configuration that holds the thing over its spot, the flow's moves are undone to find
where NAVIGATE_TO_SUPPORT has to end. Then the moves are run forwards, exactly as the primitives will run them, and
checked. Numbers that the flow gives are kept; unfilled ones are chosen from short lists. A search that fails explains
itself by the obstacles it met at the configurations over the spots.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from executor.assets.model import Region
from executor.geometry import Array, inverse, pitch_of
from executor.planning.cargo import HELD, Carried
from executor.planning.collision import Hit, fingers_may_touch
from executor.planning.drives import leads_away
from executor.planning.paths import FINE_ARM_STEP_RAD, polyline
from executor.planning.placements import placement_goals
from executor.planning.planner import BASE_MARGINS_M, Planner, run_moves, undo_moves
from executor.planning.stances import (
    ENOUGH_SCORE_RAD,
    ROOMY_M,
    ArmSolver,
    BaseCandidate,
    BlockedGoals,
    FreeFloor,
    HandGoal,
    base_candidates,
    best_first,
    candidates_of,
    nearest_miss,
    tightness_cost,
)
from executor.records import Failure, FailureKind
from executor.sim.detectors import box_around
from executor.sim.world import World
from oag import Action, Primitive
from oag.measurements import Unplanned
from oag.model.robots import Robot

LENGTHS_M: dict[Primitive, tuple[float, ...]] = {
    Primitive.MOVE_BASE_FORWARD: (0.45, 0.35, 0.25),
    Primitive.LIFT_EEF_DOWN: (0.03, 0.08),
}
LOW_M = 0.012
"""How far a thing comes down where a usual length does not fit between it and the board above."""

OTHER_LENGTHS_M = (0.10, 0.05)  # Short: the base has brought the hand near.
OVER_RIM_M = 0.03
"""How far above the rim of a drawer a thing is brought in: arms are off their paths by millimetres, and things lean."""

OVER_M, THROUGH_M = 0.08, 0.03
"""How much higher the hand comes in: over the rim of what is open at the top, or through an opening."""
UNDER_BOARD_M = 0.008  # What a thing keeps from the board above and, before it is let go of, from the one below.
TURNS_RAD = (0.0, 0.15, -0.15, 0.35, -0.35)  # How far the base may face away from its place, straight ahead first.
RELEASE_TOLERANCE_M = 0.004  # Between the wanted release and where the moves, run forwards, end.
CLEARANCE_M = 0.003  # More than the robot is off its path.
OPENED_CLEARANCE_M = 0.002  # Of the fingers as they open.
FINE_SHARE = 0.25  # Of the base's usual steps: thin things are not stepped over.
OPTION_COST = 0.03  # For each filling of open numbers after the preferred one.
RESTARTS = 16  # Of the inverse kinematics.
CANDIDATES_PER_BATCH = 80  # Examined before a plan that is not comfortable is taken.
MOST_CANDIDATES = 400
"""How many configurations over a spot are examined before given numbers count as infeasible."""

MORE_CANDIDATES = 800
"""How many more where numbers are open, from the sides first on which the arm had room."""

MOST_STUCK = 5
"""How many plans are put back from whose release nothing straight leads home."""

COLLISIONS_OF_TAKEN_SIDE = 12
"""After so many postures whose arm hit something, and none that did not, a side counts as taken."""

EXPLAINING_CONFIGURATIONS = 100
"""How many configurations are examined to explain a failure, and of how many bases that have room."""

ALIKE = np.array([0.005, 0.005, 0.02, 0.1, 0.1, 0.1])
"""Of places [m] and upward axes: what is let go of so alike falls alike."""

LANDING_S = 0.15  # Effort to find out where a thing ends.
LEAST_LANDINGS = 4  # Of which none stays, before a thing counts as one that stays nowhere.
MOST_LANDINGS = 24
"""In how many ways a thing is let go of at most; where it may stay at all, it does so in a third of them."""

MISS_CANDIDATES = 40  # Base poses among which the nearest miss of an unreachable spot is searched.
MOST_NAMED_BLOCKERS = 3  # Named in a failure, the most frequent first.


@dataclass(frozen=True, slots=True)
class PlacePlan:
    """A plan for the placement of a held thing.

    Attributes:
        robot: The record of whose plan it is.
        entry: (Q,) where NAVIGATE_TO_SUPPORT ends.
        path: (N, Q) waypoints of the moves, entry first, release last.
        moves: The moves with all numbers filled in.
        region: Name of the region.
        margin_rad: Smallest joint margin along the moves.
        clearance_m: Smallest clearance on the way in, at most `ROOMY_M`.
        score: Joint margin less costs.
    """

    robot: Robot
    entry: Array
    path: Array
    moves: tuple[Action, ...]
    region: str
    margin_rad: float
    clearance_m: float
    score: float

    @property
    def base(self) -> Array:
        """Where the base stands when NAVIGATE_TO_SUPPORT ends, (B,)."""
        return self.entry[self.robot.base]


class HeadingStatistics:
    """Experience with each heading: a bowl near one edge of a table is reached over that edge alone."""

    def __init__(self, robot: Robot) -> None:
        self._of_hand = {*robot.gripper_links, HELD}
        self._met: Counter[tuple[str, float]] = Counter()
        self._free: set[tuple[str, float]] = set()

    def learn(self, goal: HandGoal, hits: list[Hit]) -> None:
        """Record the hits of a posture at a hand pose; hits of the hand alone do not count against its side."""
        if not hits:
            self._free.add(_side(goal))
        elif any(hit.mover not in self._of_hand for hit in hits):
            self._met[_side(goal)] += 1

    def is_taken(self, goal: HandGoal) -> bool:
        """Return whether the arm has hit something in all of many postures from this side."""
        side = _side(goal)
        return side not in self._free and self._met[side] >= COLLISIONS_OF_TAKEN_SIDE

    def roomy_first(self, candidates: Iterable[BaseCandidate]) -> Iterator[BaseCandidate]:
        """Yield candidates in their order, but last those whose side counts as taken when their turn comes."""
        waiting: list[BaseCandidate] = []
        for candidate in candidates:
            if self.is_taken(candidate.goal):
                waiting.append(candidate)
            else:
                yield candidate
        yield from waiting


def _side(goal: HandGoal) -> tuple[str, float]:
    return goal.region, _rounded(goal.heading_rad)


@cache  # Asked for hundreds of thousands of candidates, of a few dozen headings.
def _rounded(heading_rad: float) -> float:
    return float(np.round(np.mod(heading_rad, 2 * np.pi), 2))


@dataclass(frozen=True, slots=True)
class PlaceSearch:
    """The search for a placement of what is in the gripper.

    Attributes:
        planner: Its oracle must be synchronised and know what is carried.
        world: Where things are.
        support: Id of what the thing is put on or in.
        regions: The support's regions to try.
        q: (Q,) where the robot is, holding the thing.
        to_come_m: Width of the widest thing that is put there later; 0 where nothing is.
        ends: A test of where (4, 4) the thing is let go of; None where all of the regions will do.
        landed: What was found out so far of where the thing ends (`Planner.lands`), by how it is let go of.
    """

    planner: Planner
    world: World
    support: str
    regions: list[Region]
    q: Array
    to_come_m: float = 0.0
    ends: Callable[[Array], bool] | None = None
    landed: dict[tuple[int, ...], bool] = field(default_factory=dict)

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
        """Yield plans that put the thing into or onto the regions, good ones first.

        Args:
            moves: The flow's moves between navigation and release, filled or not.

        Raises:
            ValueError: Nothing is carried.
        """
        goals, options = self._goals(), fill_options(moves, self._lowerings_m())
        solver, floor = ArmSolver(self.planner, RESTARTS), FreeFloor(self.planner, BASE_MARGINS_M[-1])
        robot = self.planner.robot
        blocked, sides = BlockedGoals(robot), HeadingStatistics(robot)
        room: dict[int, bool] = {}

        def has_room(goal: HandGoal) -> bool:
            if id(goal) not in room:
                room[id(goal)] = self._hand_has_room(goal, solver, blocked)
            return room[id(goal)] and self._may_land(goal)

        def examine(candidates: Iterable[BaseCandidate]) -> Iterator[PlacePlan | None]:
            roomy = (candidate for candidate in candidates if has_room(candidate.goal))
            for candidate, releases in _releases(roomy, solver, floor, blocked):
                yield self._first_plan(candidate, releases, options, blocked, sides)

        candidates = candidates_of(self.planner, goals, self.q, TURNS_RAD, reaches_into(robot, self.regions))
        first = itertools.islice(examine(candidates), MOST_CANDIDATES)
        # Numbers that are given and lead nowhere are for the flow's author to correct.
        more_count = MORE_CANDIDATES if any(action.parameter is None for action in moves) else 0
        more = itertools.islice(examine(sides.roomy_first(candidates)), more_count)
        stuck: list[PlacePlan] = []
        for plan in itertools.chain(best_first(first, CANDIDATES_PER_BATCH), best_first(more, CANDIDATES_PER_BATCH)):
            fine = plan.path
            if len(fine) > 1:
                fine = polyline(robot, fine, FINE_ARM_STEP_RAD, base_share=FINE_SHARE)
            if not self.planner.oracle.is_path_free(fine, margin_m=CLEARANCE_M):
                continue
            if len(stuck) < MOST_STUCK and not self._leads_away(plan):
                stuck.append(plan)
            else:
                yield plan
        yield from stuck

    def _leads_away(self, plan: PlacePlan) -> bool:
        """Return whether the hand gets home from where it lets go inside of something; True for other places.

        A hand that points straight down over a can gets in below a board, and not out again over the can.
        """
        robot, release = self.planner.robot, plan.path[-1]
        within = any(one.name == plan.region and one.kind == "interior" for one in self.regions)
        if not within or robot.keeps_order:
            return True
        fingers = fingers_may_touch(robot, self.carried.object_id)
        with self.planner.oracle.released_at(release):
            return leads_away(self.planner, release, allowed=fingers)

    def explain_failure(self, moves: tuple[Action, ...]) -> Failure:
        """Return a failure: no free spot, how far the hand stays off all of them, or the obstacle.

        Args:
            moves: As for `plans`, which found none that could be driven to.

        Raises:
            ValueError: Nothing is carried.
        """
        goals, item = self._goals(), self.carried.object_id
        what = f"no place for {item} at {self.support} was found"
        found = Unplanned(target=item, support=self.support)
        if not goals:
            if not self.planner.robot.keeps_order and (standing_there := self._occupants()):
                found = replace(found, in_the_way=standing_there)
            return Failure(FailureKind.NO_PATH, f"{what}: no spot is free on which it would stand", (found,))
        if self.stays_nowhere:
            message = f"{what}: let go of in {len(self.landed)} ways, it would not stay there"
            return Failure(FailureKind.NO_PATH, message, (found,))
        candidates = base_candidates(self.planner.robot, goals, self.q, TURNS_RAD)
        solver, floor = ArmSolver(self.planner, RESTARTS), FreeFloor(self.planner, BASE_MARGINS_M[-1])
        standing = [c for c in itertools.islice(candidates, 20 * EXPLAINING_CONFIGURATIONS) if floor.at(c.base)]
        if not standing:
            return Failure(FailureKind.NO_PATH, f"{what}: the floor before all spots is taken", (found,))
        releases = itertools.islice(
            _releases(standing, solver, floor, BlockedGoals(self.planner.robot)), EXPLAINING_CONFIGURATIONS
        )
        options = fill_options(moves, self._lowerings_m())
        met = [self._met(release, options[0]) for _, (release, *_) in releases]
        if not met:
            miss = nearest_miss(self.planner.kinematics, standing[:MISS_CANDIDATES])
            return Failure(FailureKind.UNREACHABLE, f"{what}: {miss.describe('it')}", (miss.added_to(found),))
        common = Counter(met).most_common(MOST_NAMED_BLOCKERS)
        found = replace(found, looked_at=len(met), in_the_way=dict(common))
        first, count = common[0]
        return Failure(FailureKind.NO_PATH, f"{what}: {first} in {count} of {len(met)} configurations", (found,))

    def _occupants(self) -> tuple[str, ...]:
        """Return the items whose middles are over the regions, with what would meet them."""
        middles = {name: box_around(self.world, name)[0] for name in self.world.dynamic_ids}
        others = {name: middle for name, middle in middles.items() if name not in (*self.carried.ids, self.support)}
        found = dict[str, None]()
        for region in self.regions:
            T_link_world = inverse(self.world.T_world_link(self.support, region.link))
            for name, middle in others.items():
                off_m = np.abs((T_link_world @ np.array([*middle, 1.0]))[:3] - np.array(region.center_m))
                if (off_m <= np.array(region.half_extents_m)).all():
                    found[name] = None
        return tuple(f"{HELD} and {name}" for name in found)

    def _lowerings_m(self) -> tuple[float, ...]:
        height_m = self.world.assets[self.carried.object_id].extent_m[2]
        return lowerings_m(self.regions, 0.0 if self.planner.robot.keeps_order else height_m)

    def _goals(self) -> list[HandGoal]:
        pitch_rad = pitch_of(self.planner.kinematics.forward(self.q))
        goals = placement_goals(
            self.world,
            self.carried,
            self.support,
            self.regions,
            self.q,
            pitch_rad,
            seed=self.planner.seed,
            to_come_m=self.to_come_m,
        )
        if (ends := self.ends) is not None:
            # What is longer than wide is a disc for the regions, and may end too far off by its narrow side.
            goals = [goal for goal in goals if ends(goal.T_world_eef @ self.carried.T_eef_object)]
        near = self.planner.near
        if near is None or self.support not in self.world.dynamic_ids:
            return goals
        # In a bowl a thing that is let go of a centimetre beside the choice may fall over.
        off_m = [float(np.linalg.norm(goal.T_world_eef[:3, 3] - near.T_world_eef[:3, 3])) for goal in goals]
        least_m = min(off_m, default=0.0)
        return [goal for goal, off in zip(goals, off_m, strict=True) if off <= least_m + RELEASE_TOLERANCE_M]

    @property
    def stays_nowhere(self) -> bool:
        """Whether the thing ended elsewhere however it was let go of: by another grasp it would do the same."""
        return len(self.landed) >= LEAST_LANDINGS and not any(self.landed.values())

    def _lands(self, goal: HandGoal) -> bool:
        """Return whether the thing ends in its place if it is let go of by a hand at a goal; True where undecided."""
        if self.planner.lands is None:
            return True
        key = self._fall_of(goal)
        if key not in self.landed and len(self.landed) < MOST_LANDINGS:
            self.planner.effort.add(LANDING_S)
            self.landed[key] = self.planner.lands(goal.T_world_eef @ self.carried.T_eef_object)
        return self.landed.get(key, False)

    def _may_land(self, goal: HandGoal) -> bool:
        """Return whether it is not known that the thing ends elsewhere, if it is let go of by a hand at a goal."""
        if self.planner.lands is None:
            return True
        return self.landed.get(self._fall_of(goal), len(self.landed) < MOST_LANDINGS)

    def _fall_of(self, goal: HandGoal) -> tuple[int, ...]:
        T = goal.T_world_eef @ self.carried.T_eef_object
        return tuple(np.round(np.concatenate([T[:3, 3], T[:3, 2]]) / ALIKE).astype(int).tolist())

    def _hand_has_room(self, goal: HandGoal, solver: ArmSolver, blocked: BlockedGoals) -> bool:
        """Return whether hand and thing have room over a spot, before any floor is examined; True where undecided.

        What they meet they meet wherever the base stands. So the base may stand within furniture here.
        """
        base = goal.base_before(self.planner.robot, self.planner.robot.reaches_m[0], 0.0)
        for solution in solver.solve(goal.T_world_eef, base, either_side=False)[:1]:
            blocked.learn(goal, self._hits(np.concatenate([base, solution.arm])))
        return goal not in blocked

    def _hits(self, release: Array) -> list[Hit]:
        """Return the hits at a configuration over a spot, or as the fingers open there."""
        oracle, opened_m = self.planner.oracle, self.planner.kinematics.finger_upper_m
        hits = oracle.hits(release, margin_m=CLEARANCE_M)
        return hits or oracle.hits(release, opening_m=opened_m, margin_m=OPENED_CLEARANCE_M)

    def _first_plan(
        self,
        candidate: BaseCandidate,
        releases: list[Array],
        options: list[tuple[Action, ...]],
        blocked: BlockedGoals,
        sides: HeadingStatistics,
    ) -> PlacePlan | None:
        """Return the plan of the first free and reachable configuration over the spot, or None."""
        for release in releases:
            hits = self._hits(release)
            sides.learn(candidate.goal, hits)
            if hits:
                blocked.learn(candidate.goal, hits)
            elif plan := self._approach(release, options, candidate):
                return plan if self._lands(candidate.goal) else None
        return None

    def _approach(
        self, release: Array, options: list[tuple[Action, ...]], candidate: BaseCandidate
    ) -> PlacePlan | None:
        """Return the plan that ends in a release configuration, or None where no filling of the moves is free."""
        oracle, kinematics = self.planner.oracle, self.planner.kinematics
        wanted = kinematics.forward(release)[:3, 3]
        for rank, filled in enumerate(options):
            entry = undo_moves(self.planner, release, list(filled))
            if entry is None or not oracle.is_free(entry, margin_m=BASE_MARGINS_M[-2]):
                continue
            path = run_moves(self.planner, entry, list(filled))
            if path is None or np.linalg.norm(kinematics.forward(path[-1])[:3, 3] - wanted) > RELEASE_TOLERANCE_M:
                continue
            if len(path) > 1 and not oracle.is_path_free(polyline(self.planner.robot, path), margin_m=CLEARANCE_M):
                continue
            margin = kinematics.margin(path[:, self.planner.robot.arm])
            clearance_m = oracle.gap_m(_before_lowering(self.planner.robot, path), ROOMY_M)
            score = min(margin, ENOUGH_SCORE_RAD) - candidate.cost - OPTION_COST * rank - tightness_cost(clearance_m)
            return PlacePlan(self.planner.robot, entry, path, filled, candidate.goal.region, margin, clearance_m, score)
        return None

    def _met(self, release: Array, filled: tuple[Action, ...]) -> str:
        """Return in words why a configuration over a spot cannot be used, with the moves' numbers filled."""
        if hits := self._hits(release):
            return f"{_words(hits)} meet over the spot"
        entry = undo_moves(self.planner, release, list(filled))
        path = None if entry is None else run_moves(self.planner, entry, list(filled))
        if path is None:
            return "the arm does not reach the moves to the spot"
        way = polyline(self.planner.robot, path) if len(path) > 1 else path
        if hit := self.planner.oracle.first_hit(way, margin_m=CLEARANCE_M):
            return f"{_words([hit])} meet on the way in"
        return "the way there is not free"


def reaches_into(robot: Robot, regions: Collection[Region]) -> tuple[float, ...]:
    """Return how far before the hand the base may be over some regions, the preferred distance first.

    Deep in a compartment over a counter nothing but a nearly stretched arm gets there.
    """
    behind_a_front = any(not region.opens_upward for region in regions)
    return robot.reaches_m + robot.far_reaches_m * (behind_a_front and not robot.keeps_order)


def lowerings_m(regions: Collection[Region], height_m: float = 0.0) -> tuple[float, ...]:
    """Return the candidate lengths of LIFT_EEF_DOWN over some regions, the preferred one first.

    Into what is deep and open at the top, such as a drawer, the hand may come down by all of the depth: it gets in over
    the front, which is as high. Under a board there may be no room for more than a little.

    Args:
        regions: Where something is put.
        height_m: Its height.
    """
    usual = LENGTHS_M[Primitive.LIFT_EEF_DOWN]
    if any(rise_m(region, height_m) < min(usual) for region in regions):
        usual = (*usual, LOW_M)
    depths_m = {2 * r.half_extents_m[2] for r in regions if r.kind == "interior" and r.opens_upward}
    return usual + tuple(round(depth_m + OVER_RIM_M, 2) for depth_m in sorted(depths_m) if depth_m > max(usual))


def rise_m(region: Region, height_m: float) -> float:
    """Return by how much a thing of a height may be raised on its way into a region: at most `THROUGH_M`."""
    room_m = 2 * region.half_extents_m[2] - height_m - UNDER_BOARD_M
    fits = not region.opens_upward and room_m >= LOW_M
    return min(room_m, THROUGH_M) if fits else THROUGH_M


def fill_options(moves: tuple[Action, ...], downs_m: tuple[float, ...]) -> list[tuple[Action, ...]]:
    """Return the fillings of the open numbers of moves, the preferred one first; given numbers are kept.

    Args:
        downs_m: Candidates of an open LIFT_EEF_DOWN, the preferred one first.
    """
    lengths_m = {**LENGTHS_M, Primitive.LIFT_EEF_DOWN: downs_m}
    values = [lengths_m.get(a.primitive, OTHER_LENGTHS_M) if a.parameter is None else (a.parameter,) for a in moves]
    return [
        tuple(replace(a, parameter=v) for a, v in zip(moves, chosen, strict=True))
        for chosen in itertools.product(*values)
    ]


def _releases(
    candidates: Iterable[BaseCandidate], solver: ArmSolver, floor: FreeFloor, blocked: BlockedGoals
) -> Iterator[tuple[BaseCandidate, list[Array]]]:
    """Yield the candidates with room for the base, each with one or two configurations (Q,) over its spot."""
    for candidate in candidates:
        if candidate.goal not in blocked and floor.at(candidate.base):
            solutions = solver.solve(candidate.goal.T_world_eef, candidate.base, either_side=False)[:2]
            if solutions:
                yield candidate, [np.concatenate([candidate.base, solution.arm]) for solution in solutions]


def _before_lowering(robot: Robot, path: Array) -> Array:
    """Return the first configuration (Q,) with the base where the release is: what comes after is the arm's."""
    moved = np.abs(path[:, robot.base] - path[-1, robot.base]).max(axis=1) > 1e-6
    arrived = int(np.flatnonzero(moved)[-1]) + 1 if moved.any() else 0
    return np.asarray(path[min(arrived, len(path) - 1)])


def _words(hits: list[Hit]) -> str:
    hit = min(hits, key=lambda hit: hit.separation_m)
    return f"{hit.mover} and {hit.other}"
