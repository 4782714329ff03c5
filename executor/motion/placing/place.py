"""How to put a held thing down: spot, hand, base, entry and the numbers of the moves in between, chosen together.

Planning runs backwards. From a configuration that holds the thing over its spot, the flow's moves are undone to find
where NAVIGATE_TO_SUPPORT has to end; then the moves are run forwards exactly as the primitives will run them, and
checked. Numbers that the flow gives are kept; unfilled ones are chosen from short lists.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from executor.assets.model import Asset, Region
from executor.geometry import Array, hand_rotation, pitch_of, transform
from executor.motion.grasping.rims import is_held_at_rim, rim_put_goals
from executor.motion.grasping.sides import Sides
from executor.motion.planning.moves import run_moves, undo_moves
from executor.motion.planning.oracle import Carried
from executor.motion.planning.paths import FINE_ARM_STEP_RAD, polyline
from executor.motion.planning.planner import BASE_MARGINS_M, Planner
from executor.motion.stances.candidates import (
    ROOMY_M,
    ArmSolver,
    Blocked,
    FreeFloor,
    HandGoal,
    Placement,
    best_first,
    placements,
    tightness_cost,
)
from executor.motion.stances.spots import Obstacle, Spot, spots
from executor.motion.stances.stance import ENOUGH_SCORE_RAD
from executor.robot.kinematics import ARM
from executor.world.detectors import box_around
from executor.world.world import World
from oag import Action, Primitive

GAPS_M = (0.004, 0.02, 0.04, 0.06)
"""Free fall that is accepted when the gripper opens, the smallest feasible one first."""

LENGTHS_M: dict[Primitive, tuple[float, ...]] = {
    Primitive.MOVE_BASE_FORWARD: (0.45, 0.35, 0.25),
    Primitive.LIFT_EEF_DOWN: (0.03, 0.08),
}
OTHER_LENGTHS_M = (0.10, 0.05)
UPRIGHT_COSINE, LEANING_COSINE = 0.97, 0.80
HOLLOW = "hollow"
"""What bowls call their inside."""

FALLING_COSINE, FALLS_COST = 0.5, 0.3
FREE_PITCHES_DEG = (45.0, 60.0, 75.0, 30.0)
TURNS_RAD = (0.0, 0.15, -0.15, 0.35, -0.35)
RELEASE_TOLERANCE_M = 0.004
CLEARANCE_M = 0.003
OPENED_CLEARANCE_M = 0.002
FINE_SHARE = 0.25
GAP_COST = 0.15
OPTION_COST = 0.03
BATCH = 80
MOST_CANDIDATES = 400
"""How many configurations over a spot are looked at before given numbers count as leading nowhere."""

MORE_CANDIDATES = 800
"""How many more where numbers are open, from the sides first on which the arm had room."""


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


def fill_options(moves: tuple[Action, ...]) -> list[tuple[Action, ...]]:
    """Returns the ways to fill the open numbers of moves, the preferred one first; given numbers are kept."""
    values = [LENGTHS_M.get(a.primitive, OTHER_LENGTHS_M) if a.parameter is None else (a.parameter,) for a in moves]
    return [
        tuple(replace(a, parameter=v) for a, v in zip(moves, chosen, strict=True))
        for chosen in itertools.product(*values)
    ]


def rolls_freely(asset: Asset) -> bool:
    """Decides whether a thing has no upright: all that collides is a sphere."""
    return all(shape.kind == "sphere" for link in asset.links for shape in link.shapes if shape.collides)


def upright_pitch(carried: Carried, *, flip: bool) -> float:
    """Returns the hand's pitch in rad at which what it holds stands as upright as its tilt between the fingers lets it.

    Things turn about the fingers' closing axis when they are taken hold of, so the pitch of the grasp need not be it.
    """
    x, _, z = carried.T_eef_object[:3, 2]
    return float(np.arctan2(-z, x if flip else -x))


def leaning_rad(asset: Asset, carried: Carried) -> float:
    """Returns how far a held thing leans to the side between the fingers, which no tilt of the hand sets upright."""
    x, _, z = carried.T_eef_object[:3, 2]
    return 0.0 if rolls_freely(asset) or is_held_at_rim(asset, carried) else float(np.arccos(min(np.hypot(x, z), 1.0)))


def hand_goals(
    asset: Asset, spot: Spot, gap_m: float, carried: Carried, pitch_rad: float, region: Region
) -> list[HandGoal]:
    """Returns hand poses that hold the thing upright over a spot; leaning too over a hollow, where it lies as it falls.

    Args:
        asset: The thing.
        spot: Where it is to be.
        gap_m: How far above its place it is let go.
        carried: How it is held.
        pitch_rad: The hand's present pitch.
        region: The region that the spot is in.
    """
    if is_held_at_rim(asset, carried):
        return rim_put_goals(asset, spot, gap_m, carried)
    free = rolls_freely(asset)
    x, _, z = carried.T_eef_object[:3, 2]
    # What leans to the side between the fingers cannot be set upright by them; a little is set down all the same.
    upright = max(min(UPRIGHT_COSINE, float(np.hypot(x, z)) - 0.01), LEANING_COSINE)
    low = is_low(asset)
    goals = []
    for turn, yaw in enumerate(spot.headings_rad):
        for flip in (False, True):
            pitches = [pitch_rad] if free else [upright_pitch(carried, flip=flip)]
            if free or (low and region.name == HOLLOW):
                pitches += [np.deg2rad(p) for p in FREE_PITCHES_DEG]
            for rank, pitch in enumerate(pitches):
                R = hand_rotation(yaw, pitch, flip=flip)
                cosine = float((R @ carried.T_eef_object[:3, :3])[2, 2])
                falls = low and region.name == HOLLOW and rank > 0
                if not free and cosine < (FALLING_COSINE if falls else upright):
                    continue
                above_m = (max(asset.extent_m) if falls else asset.extent_m[2]) / 2 + gap_m
                centre = spot.point_m + np.array([0.0, 0.0, above_m])
                offset = R @ carried.T_eef_object[:3, 3]
                cost = spot.cost + 0.02 * rank + 0.01 * turn + (FALLS_COST if falls else 0.0)
                goals.append(HandGoal(transform(R, centre - offset), yaw, cost))
    return goals


def is_low(asset: Asset) -> bool:
    """Decides whether a thing is lower than it is wide, so that it does not stand on its edge."""
    return asset.extent_m[2] < min(asset.extent_m[:2])


def place_plans(
    planner: Planner,
    world: World,
    destination: str,
    regions: list[Region],
    moves: tuple[Action, ...],
    q: Array,
) -> Iterator[PlacePlan]:
    """Yields plans that put the carried thing into or onto regions of a destination, good ones first.

    Args:
        planner: Its oracle must be synchronised and know what is carried.
        world: Where things are.
        destination: Id of the support.
        regions: Regions of the destination to try.
        moves: The flow's moves between navigation and release, filled or not.
        q: (10,) where the robot is, holding the thing.

    Raises:
        ValueError: Nothing is carried.
    """
    goals, options = place_goals(planner, world, destination, regions, q), fill_options(moves)
    solver = ArmSolver(planner, restarts=16)
    blocked, sides, floor = Blocked(), Sides(), FreeFloor(planner, BASE_MARGINS_M[-1])

    def examine(candidates: Iterable[Placement]) -> Iterator[PlacePlan | None]:
        for candidate in candidates:
            if candidate.goal in blocked or not floor.at(candidate.base):
                continue
            solutions = solver.solve(candidate.goal.T_world_eef, candidate.base, either_side=False)
            if solutions:
                yield _first_plan(planner, [s.arm for s in solutions[:2]], options, candidate, blocked, sides)

    candidates = iter(placements(goals, q, TURNS_RAD))
    first = itertools.islice(examine(candidates), MOST_CANDIDATES)
    # Numbers that are given and lead nowhere are for the flow's author to correct.
    more_count = MORE_CANDIDATES if any(action.parameter is None for action in moves) else 0
    more = itertools.islice(examine(sides.roomy_first(candidates)), more_count)
    for plan in itertools.chain(best_first(first, BATCH), best_first(more, BATCH)):
        fine = polyline(plan.path, FINE_ARM_STEP_RAD, base_share=FINE_SHARE) if len(plan.path) > 1 else plan.path
        if planner.oracle.is_way_free(fine, margin_m=CLEARANCE_M):
            yield plan


def place_goals(planner: Planner, world: World, destination: str, regions: list[Region], q: Array) -> list[HandGoal]:
    """Returns the hand poses that hold the carried thing over the free spots of a destination.

    Args:
        planner, world, destination, regions, q: As for `place_plans`.

    Raises:
        ValueError: Nothing is carried.
    """
    carried = planner.oracle.carried
    if carried is None:
        raise ValueError("planning a placement needs something in the gripper")
    asset = world.assets[carried.object_id]
    pitch = pitch_of(planner.kinematics.forward(q))
    others = [
        Obstacle(*box_around(world, other))
        for other in world.dynamic_ids
        if other not in (carried.object_id, destination)
    ]
    return [
        replace(goal, cost=goal.cost + GAP_COST * rank, region=region.name)
        for region in regions
        for spot in spots(
            region,
            world.T_world_link(destination, region.link),
            max(asset.extent_m[:2]),
            q,
            height_m=asset.extent_m[2],
            obstacles=others,
        )
        for rank, gap_m in enumerate(GAPS_M)
        for goal in hand_goals(asset, spot, gap_m, carried, pitch, region)
    ]


def _first_plan(
    planner: Planner,
    arms: list[Array],
    options: list[tuple[Action, ...]],
    candidate: Placement,
    blocked: Blocked,
    sides: Sides,
) -> PlacePlan | None:
    """Returns the plan of the first arm posture over the spot that is free and can be got to, or None."""
    for arm in arms:
        release = np.concatenate([candidate.base, arm])
        opened_m = planner.kinematics.finger_upper_m
        hits = planner.oracle.hits(release, margin_m=CLEARANCE_M)
        hits = hits or planner.oracle.hits(release, opening_m=opened_m, margin_m=OPENED_CLEARANCE_M)
        sides.learn(candidate.goal, hits)
        if hits:
            blocked.learn(candidate.goal, hits)
        elif plan := _approach(planner, release, options, candidate):
            return plan
    return None


def _approach(
    planner: Planner, release: Array, options: list[tuple[Action, ...]], candidate: Placement
) -> PlacePlan | None:
    """Returns the plan that ends in a release configuration, or None when no filling of the moves is free."""
    oracle, kinematics = planner.oracle, planner.kinematics
    wanted = kinematics.forward(release)[:3, 3]
    for rank, filled in enumerate(options):
        entry = undo_moves(planner, release, list(filled))
        if entry is None or not oracle.is_free(entry, margin_m=BASE_MARGINS_M[-2]):
            continue
        path = run_moves(planner, entry, list(filled))
        if path is None or np.linalg.norm(kinematics.forward(path[-1])[:3, 3] - wanted) > RELEASE_TOLERANCE_M:
            continue
        if len(path) > 1 and not oracle.is_way_free(polyline(path), margin_m=CLEARANCE_M):
            continue
        margin = kinematics.margin(path[:, ARM])
        clearance_m = oracle.gap_m(_before_lowering(path), ROOMY_M)
        score = min(margin, ENOUGH_SCORE_RAD) - candidate.cost - OPTION_COST * rank - tightness_cost(clearance_m)
        return PlacePlan(entry, path, filled, candidate.goal.region, margin, clearance_m, score)
    return None


def _before_lowering(path: Array) -> Array:
    """Returns the first configuration (10,) with the base where the release is: what comes after is the arm's."""
    moved = np.abs(path[:, :3] - path[-1, :3]).max(axis=1) > 1e-6
    arrived = int(np.flatnonzero(moved)[-1]) + 1 if moved.any() else 0
    return np.asarray(path[min(arrived, len(path) - 1)])
