"""Stances for picking an item up, chosen together with the moves right after; and explanations where there is none."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from bddl import Atom
from executor.assets.model import Asset
from executor.geometry import Array, heading_of
from executor.planning.cargo import cargo_of, carried_by, touching_any
from executor.planning.collision import fingers_may_touch, held_may_touch
from executor.planning.grasps import (
    LEANS_RAD,
    SIDEWAYS_RAD,
    deep_goals,
    item_goals,
    narrowed_goals,
    rim_goals,
    room_below_m,
    top_goals,
)
from executor.planning.paths import base_move, polyline, segment
from executor.planning.planner import Planner, run_moves
from executor.planning.stances import (
    BaseCandidate,
    HandGoal,
    Stance,
    Validate,
    base_candidates,
    nearest_miss,
    search_stances,
)
from executor.planning.standing_up import is_rolled_over, standing_up_goals
from executor.records import Failure, FailureKind
from executor.sim.detectors import box_around, read
from executor.sim.world import World
from oag import Action
from oag.measurements import TooWide, Unplanned
from oag.model.robots import HandShape
from oag.sizes import Gripper

TURNS_RAD = (0.0, 0.3, -0.3)
WIDE_TURNS_RAD = (0.6, -0.6, 0.9, -0.9)
"""How far the base faces away from where the hand comes from; far only where nothing else is free."""

ACROSS_TURNS_RAD = (np.pi / 2, -np.pi / 2, 1.2, -1.2)
"""The same of a base before a compartment while the hand points along it: a hand is 20 cm wide along the line on which
its fingers close, so that next to a side wall it fits in that way alone.
"""

OUT_M = 0.01
"""How far above the rim of a bowl or box the middle of a thing is that was lifted out of it."""

LIFT_CLEARANCE_M = 0.001  # Little: the item stands on its support as it is lifted.
FINE_SHARE = 0.25  # Of the base's usual steps: thin things are not stepped over.
LIFTS_M = (0.15, 0.12, 0.10, 0.08, 0.05, 0.03)
"""How far an unfilled LIFT_EEF_UP lifts, the highest feasible one first."""

LOW_LIFTS_M = (*LIFTS_M, 0.02, 0.01)
"""The same where the hand backs out with the thing: off what it stood on is enough."""

HIGH_LIFTS_M = (0.15, 0.13, 0.105)
"""The same where a plan ends with the thing in the hand: as high as counts as picked up, and the arm's error more."""

LOOKED_AT = 60  # Enough to find the obstacle.
MOST_NAMED_BLOCKERS = 3
STANDOFF_M = 0.6  # The last part of a path, which the arm reaches over.


@dataclass(frozen=True, slots=True)
class Lift:
    """The moves of a picking subtask after the grasp.

    Attributes:
        moves: The moves with all numbers filled in.
        at_rim: Whether the grasp is at the thing's wall, not around all of it.
        suits_place: False where a hand in another grasp could put the item into its place, and this one cannot.
    """

    moves: tuple[Action, ...]
    at_rim: bool = False
    suits_place: bool | None = None


@dataclass(frozen=True, slots=True)
class Pick:
    """An item to pick, with the moves after the grasp: the common input of all its strategies.

    Attributes:
        planner: Synchronised with the world.
        world: Where things are.
        item: The item's id.
        moves: The parameterised moves between the grasp and the end of the flow; unfilled lifts are chosen here.
        here: (B,) where the base stands.
        lifts_m: Candidates of an unfilled lift, the preferred one first; out of a bowl it is as high as needed.
        leads_out: Whether the hand gets out with the item from where it was lifted to (Q,); None where it need not.
    """

    planner: Planner
    world: World
    item: str
    moves: tuple[Action, ...]
    here: Array
    lifts_m: tuple[float, ...] = LIFTS_M
    leads_out: Callable[[Array], bool] | None = None

    def stances(self, allows_placement: Callable[[Array], bool] | None = None) -> Iterator[Stance[Lift]]:
        """Yield stances from which the hand can close around all of the item, and the moves after can be made.

        Args:
            allows_placement: Whether a hand at a pose (4, 4) can also place the item later; other stances come last.
        """
        goals, lift = item_goals(self._hand, self._asset, self._T_item), self._lifting()
        if allows_placement is None:
            yield from self._search(goals, lift)
            return
        allows, forward = allows_placement, self.planner.kinematics.forward

        def unsuited(q: Array) -> tuple[Lift, float] | None:
            found = lift(q)
            return None if found is None else (replace(found[0], suits_place=False), found[1])

        for wanted, validate in ((True, lift), (False, unsuited)):

            def suited(q: Array, found: Validate[Lift] = validate, wanted: bool = wanted) -> tuple[Lift, float] | None:
                return found(q) if allows(forward(q)) is wanted else None

            def admits(candidate: BaseCandidate, wanted: bool = wanted) -> bool:
                return allows(candidate.goal.T_world_eef) is wanted

            ordered = self.planner.robot.keeps_order
            yield from self._search(goals, suited, admits=None if ordered else admits)

    def standing_up_stances(self, allows_placement: Callable[[Array], bool] | None = None) -> Iterator[Stance[Lift]]:
        """Yield stances from which an item that lies can be taken and stood up.

        Args:
            allows_placement: Whether a hand at a pose (4, 4) can also put the item down upright.
        """
        goals = standing_up_goals(self._hand, self._asset, self._T_item)
        fitting = [goal for goal in goals if allows_placement is None or allows_placement(goal.T_world_eef)]
        lift, forward = self._lifting(), self.planner.kinematics.forward

        def lift_where(rolled: bool) -> Validate[Lift]:
            return lambda q: lift(q) if is_rolled_over(forward(q), self._T_item) is rolled else None

        for rolled in (False, True):
            yield from self._search(fitting, lift_where(rolled))

    def rim_stances(self, allows_placement: Callable[[Array], bool] | None = None) -> Iterator[Stance[Lift]]:
        """Yield stances from which the item can be taken by its wall, if it has one.

        Args:
            allows_placement: Whether a hand at a pose (4, 4) can also place the item later. Where no usual one can, a
                hand that comes sideways along the rim may.
        """
        if self._asset.rim is None:
            return
        lift = self._lifting(at_rim=True)
        usual = rim_goals(self._asset, self._T_item)
        sideways = [] if self.planner.robot.keeps_order else rim_goals(self._asset, self._T_item, SIDEWAYS_RAD)
        if allows_placement is not None:
            for goals in (usual, sideways):
                yield from self._search([goal for goal in goals if allows_placement(goal.T_world_eef)], lift)
        yield from self._search(usual, lift)
        yield from self._search(sideways, lift)

    def last_stances(self) -> Iterator[Stance[Lift]]:
        """Yield stances of last resort: near the item's top, steep in a box, from close by, or nearly stretched."""
        lift, robot = self._lifting(), self.planner.robot
        yield from self._search(top_goals(self._asset, self._T_item), lift)
        along_rad = None if robot.keeps_order else walls_rad(self.world, self.item)
        if along_rad is not None:
            yield from self._search(deep_goals(self._asset, self._T_item, along_rad), lift)
        goals = item_goals(self._hand, self._asset, self._T_item)
        for reaches_m in (robot.close_reaches_m, robot.far_reaches_m):
            if reaches_m:
                yield from self._search(goals, lift, reaches_m)
        if not robot.keeps_order:
            yield from self._search(goals, lift, all_turns_rad=(ACROSS_TURNS_RAD,))
            if along_rad is not None:
                goals += deep_goals(self._asset, self._T_item, along_rad)
            yield from self._search(self._narrowed(goals), lift)

    def narrow_rim_stances(self) -> Iterator[Stance[Lift]]:
        """Yield stances from which the item can be taken by its wall with fingers that are open little wider."""
        if self._asset.rim is not None and not self.planner.robot.keeps_order:
            goals = rim_goals(self._asset, self._T_item, (*LEANS_RAD, *SIDEWAYS_RAD))
            yield from self._search(self._narrowed(goals, self._asset.rim.thickness_m), self._lifting(at_rim=True))

    def _narrowed(self, goals: list[HandGoal], width_m: float | None = None) -> list[HandGoal]:
        width_m = self._width_m if width_m is None else width_m
        return narrowed_goals(goals, width_m, self.planner.kinematics.finger_upper_m)

    @property
    def _width_m(self) -> float:
        return self._asset.graspable_width_m or min(self._asset.extent_m[:2])

    @property
    def _hand(self) -> HandShape:
        return self.planner.robot.hand

    @property
    def _asset(self) -> Asset:
        return self.world.assets[self.item]

    @property
    def _T_item(self) -> Array:
        return self.world.T_world_link(self.item)

    def _search(
        self,
        goals: list[HandGoal],
        validate: Validate[Lift],
        reaches_m: tuple[float, ...] | None = None,
        all_turns_rad: tuple[tuple[float, ...], ...] = (TURNS_RAD, WIDE_TURNS_RAD),
        admits: Callable[[BaseCandidate], bool] | None = None,
    ) -> Iterator[Stance[Lift]]:
        fingers = fingers_may_touch(self.planner.robot, self.item)
        for turns_rad in all_turns_rad:
            yield from search_stances(
                self.planner,
                goals,
                self.here,
                validate=validate,
                allowed=fingers,
                turns_rad=turns_rad,
                reaches_m=reaches_m,
                admits=admits,
            )

    def _lifting(self, *, at_rim: bool = False) -> Validate[Lift]:
        """Return a validation of the lift: whether the moves can lift the item, held around it or at its wall."""
        asset, oracle = self._asset, self.planner.oracle
        opening_m = (asset.rim.thickness_m if at_rim and asset.rim else self._width_m) / 2
        cargo = cargo_of(self.world, self.item)
        resting = held_may_touch(touching_any(self.world, (self.item, *cargo)))
        lifts_m = lifts_out_m(self.lifts_m, self.world, self.item)
        options = [
            tuple(
                replace(a, parameter=v) if a.parameter is None else a for a, v in zip(self.moves, values, strict=True)
            )
            for values in itertools.product(*(lifts_m if a.parameter is None else (None,) for a in self.moves))
        ]

        def lift(q: Array) -> tuple[Lift, float] | None:
            oracle.carried = carried_by(self.world, self.item, self.planner.kinematics.forward(q), cargo)
            try:
                return first_lift(q)
            finally:
                oracle.carried = None

        def first_lift(q: Array) -> tuple[Lift, float] | None:
            along: tuple[Lift, float] | None = None
            for rank, filled in enumerate(options):
                path = run_moves(self.planner, q, list(filled))
                if path is None:
                    continue
                way = polyline(self.planner.robot, path, base_share=FINE_SHARE) if len(path) > 1 else path[:0]
                if oracle.first_hit(way, allowed=resting, opening_m=opening_m, margin_m=LIFT_CLEARANCE_M):
                    continue
                end = way[-1] if len(way) else q
                clear = not oracle.hits(end, opening_m=opening_m, margin_m=LIFT_CLEARANCE_M)
                if (clear or along is None) and not presses(q, way):
                    found = Lift(filled, at_rim), 0.02 * rank
                    if clear:
                        return found if self.leads_out is None or self.leads_out(end) else None
                    along = found  # It stands against something, and may be lifted along that.
            return along

        def presses(q: Array, way: Array) -> bool:
            """Return whether the item gets into what it touches, such as the board above it."""
            with oracle.leaving(q, opening_m=opening_m, margin_m=LIFT_CLEARANCE_M):
                return oracle.first_hit(way, opening_m=opening_m, margin_m=LIFT_CLEARANCE_M) is not None

        return lift


def walls_rad(world: World, item: str) -> float | None:
    """Return the heading of a wall of the bowl, box or drawer that an item lies in; None where it lies in none."""
    for name in (*world.dynamic_ids, *world.articulated_ids):
        found = read(Atom("inside", (item, name)), world) if name != item else None
        if found is not None and found.value:
            region = next(one for one in world.assets[name].regions if one.name == found.measurements.region)
            if region.opens_upward:
                return heading_of(world.T_world_link(name, region.link)[:3, 0])
    return None


def lifts_out_m(lifts_m: tuple[float, ...], world: World, item: str) -> tuple[float, ...]:
    """Return those of some lifts that take an item out of a vessel that is open at the top, else one that does.

    Args:
        lifts_m: The preferred one first.
        item: The item's id; what is in no bowl or box is out already.
    """
    centre_m = float(box_around(world, item)[0][2])
    least_m = 0.0
    for vessel in world.dynamic_ids:
        found = read(Atom("inside", (item, vessel)), world) if vessel != item else None
        if found is not None and found.value:
            region = next(one for one in world.assets[vessel].regions if one.name == found.measurements.region)
            top_m = world.T_world_link(vessel, region.link) @ (*region.center_m, 1.0)
            least_m = max(least_m, float(top_m[2]) + region.half_extents_m[2] - centre_m + OUT_M)
    enough = tuple(lift_m for lift_m in lifts_m if lift_m >= least_m)
    return enough or (math.ceil(100.0 * least_m) / 100.0,)


def explain_pick_failure(planner: Planner, item: str, goals: list[HandGoal], here: Array) -> Failure:
    """Return a failure: how far the hand stays off and at which joint limits, or the obstacle.

    Args:
        planner: Synchronised with the world.
        goals: The hand poses that would hold it.
        here: (B,) where the base stands.
    """
    if not goals:
        message = f"no side of {item} that the fingers can close around leaves the palm room"
        return Failure(FailureKind.UNREACHABLE, message, (Unplanned(target=item),))
    oracle, kinematics = planner.oracle, planner.kinematics
    blockers: Counter[str] = Counter()
    candidates = list(itertools.islice(base_candidates(planner.robot, goals, here, TURNS_RAD), LOOKED_AT))
    reached = False
    for candidate in candidates:
        solutions = kinematics.solve(candidate.goal.T_world_eef, candidate.base, restarts=8, enough=1)
        reached = reached or bool(solutions)
        for solution in solutions:
            q = np.concatenate([candidate.base, solution.arm])
            hits = oracle.hits(q, opening_m=kinematics.finger_upper_m, allowed=fingers_may_touch(planner.robot, item))
            blockers.update(f"{hit.mover} and {hit.other}" for hit in hits)
    found = Unplanned(target=item)
    if not reached:
        miss = nearest_miss(kinematics, candidates)
        return Failure(FailureKind.UNREACHABLE, miss.describe(item), (miss.added_to(found),))
    named = [name for name, _ in blockers.most_common(MOST_NAMED_BLOCKERS)]
    if not planner.robot.keeps_order:
        # Furniture is met most often, and what can be moved aside is told all the same.
        pairs, loose = [pair for pair, _ in blockers.most_common()], set(oracle.world.dynamic_ids)
        movable = [pair for pair in pairs if loose & {part.partition("/")[0] for part in pair.split()}]
        named = list(dict.fromkeys((*named, *movable[:MOST_NAMED_BLOCKERS])))
    found = replace(found, in_the_way=tuple(named))
    if not blockers:
        message = f"{item} can be reached, but what the flow does next is not free or out of reach from every stance"
        return Failure(FailureKind.UNREACHABLE, message, (found,))
    return Failure(FailureKind.NO_PATH, f"no way to take {item}: {blockers.most_common(1)[0][0]} meet", (found,))


def explain_rim_failure(planner: Planner, world: World, item: str, here: Array) -> Failure:
    """Return a failure: an item's wall is too low over its support, or another reason that keeps the hand from it.

    Args:
        planner: Synchronised with the world.
        item: What was to be taken; it has a rim and is too wide for the gripper.
        here: (B,) where the base stands.
    """
    asset = world.assets[item]
    goals = rim_goals(asset, world.T_world_link(item))
    width_m, opening_m = min(asset.extent_m[:2]), Gripper.of(world.scene.robot).opening_m
    wide = f"{item} is {width_m * 1000:.0f} mm wide, the gripper opens to {opening_m * 1000:.0f} mm"
    measured = TooWide(round(width_m, 4), opening_m)
    if not goals:
        return Failure(FailureKind.TOO_WIDE, f"{wide}; it does not stand, so that no finger gets inside", (measured,))
    room_m, needed_m = room_below_m(planner.robot.hand, asset)
    if room_m >= needed_m:
        return explain_pick_failure(planner, item, goals, here)
    message = (
        f"{wide}, and its rim is {room_m * 1000:.0f} mm above what it stands on: "
        f"a finger below it needs {needed_m * 1000:.0f} mm"
    )
    measured = replace(measured, rim_height_m=round(room_m, 4), rim_height_needed_m=round(needed_m, 4))
    return Failure(FailureKind.TOO_WIDE, message, (measured,))


def in_the_way(planner: Planner, q: Array, towards_m: Array) -> tuple[str, ...]:
    """Return the obstacles on the straight path of the base towards a point; empty where it is free.

    The arm keeps its posture.

    Args:
        planner: Synchronised with the world.
        q: (Q,) where the robot is.
        towards_m: (2,) the point; the last `STANDOFF_M` before it are left out.
    """
    offset = np.asarray(towards_m) - q[:2]
    length_m = float(np.hypot(*offset))
    way = base_move(q, max(length_m - STANDOFF_M, 0.0), float(np.arctan2(offset[1], offset[0])))
    for row in segment(planner.robot, way[0], way[1]):
        if hits := planner.oracle.hits(row):
            return tuple(f"{hit.mover} and {hit.other}" for hit in hits[:MOST_NAMED_BLOCKERS])
    return ()
