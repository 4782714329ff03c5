"""Why no place was found to put a held thing down, measured at the configurations over its places."""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import replace

import numpy as np

from executor.assets.model import Region
from executor.geometry import Array
from executor.motion.placing.place import (
    CLEARANCE_M,
    OPENED_CLEARANCE_M,
    TURNS_RAD,
    fill_options,
    place_goals,
)
from executor.motion.planning.moves import run_moves, undo_moves
from executor.motion.planning.oracle import Hit
from executor.motion.planning.paths import polyline
from executor.motion.planning.planner import BASE_MARGINS_M, Planner
from executor.motion.stances.candidates import ArmSolver, FreeFloor, placements
from executor.motion.stances.near_miss import nearest
from executor.records.rollout import Failure, FailureKind
from executor.world.world import World
from oag import Action
from oag.revision.measurements import Unplanned

LOOKED_AT = 100
MISSES = 40
NAMED = 3


def why_not_placed(
    planner: Planner, world: World, destination: str, regions: list[Region], moves: tuple[Action, ...], q: Array
) -> Failure:
    """Returns a failure: that there is no free spot, how far the hand stays off all of them, or what is in the way.

    Args:
        planner, world, destination, regions, moves, q: As for `place_plans`.
    """
    carried = planner.oracle.carried
    if carried is None:
        raise ValueError("a placement needs something in the gripper")
    what = f"no place for {carried.object_id} at {destination} was found"
    goals = place_goals(planner, world, destination, regions, q)
    found = Unplanned(target=carried.object_id, support=destination)
    if not goals:
        return Failure(FailureKind.NO_PATH, f"{what}: no spot is free on which it would stand", (found,))
    candidates = placements(goals, q, TURNS_RAD)
    solver, floor = ArmSolver(planner, restarts=16), FreeFloor(planner, BASE_MARGINS_M[-1])
    standing = [c for c in itertools.islice(candidates, 20 * LOOKED_AT) if floor.at(c.base)]
    if not standing:
        return Failure(FailureKind.NO_PATH, f"{what}: the floor before all spots is taken", (found,))
    postures = (
        np.concatenate([c.base, solution.arm])
        for c in standing
        for solution in solver.solve(c.goal.T_world_eef, c.base, either_side=False)[:1]
    )
    met = [_met(planner, release, moves) for release in itertools.islice(postures, LOOKED_AT)]
    if not met:
        miss = nearest(planner.kinematics, standing[:MISSES])
        return Failure(FailureKind.UNREACHABLE, f"{what}: {miss.words('it')}", (miss.added_to(found),))
    common = Counter(met).most_common(NAMED)
    found = replace(found, looked_at=len(met), in_the_way=dict(common))
    first, count = common[0]
    return Failure(FailureKind.NO_PATH, f"{what}: {first} in {count} of {len(met)} configurations", (found,))


def _met(planner: Planner, release: Array, moves: tuple[Action, ...]) -> str:
    """Returns in words what keeps a configuration over a spot from being used."""
    oracle = planner.oracle
    hits = oracle.hits(release, margin_m=CLEARANCE_M)
    hits = hits or oracle.hits(release, opening_m=planner.kinematics.finger_upper_m, margin_m=OPENED_CLEARANCE_M)
    if hits:
        return f"{_words(hits)} meet over the spot"
    for filled in fill_options(moves)[:1]:
        entry = undo_moves(planner, release, list(filled))
        path = None if entry is None else run_moves(planner, entry, list(filled))
        if path is None:
            return "the arm does not reach the moves to the spot"
        if hit := oracle.first_hit(polyline(path) if len(path) > 1 else path, margin_m=CLEARANCE_M):
            return f"{_words([hit])} meet on the way in"
    return "the way there is not free"


def _words(hits: list[Hit]) -> str:
    hit = min(hits, key=lambda hit: hit.separation_m)
    return f"{hit.mover} and {hit.other}"
