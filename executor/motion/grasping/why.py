"""Why an item cannot be taken, measured at the stances that come nearest to taking it."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from executor.geometry import Array
from executor.motion.grasping.rims import rim_goals, room_below_m
from executor.motion.planning.contacts import fingers_may_touch
from executor.motion.planning.paths import base_move, segment
from executor.motion.planning.planner import Planner
from executor.motion.stances.candidates import HandGoal, placements
from executor.motion.stances.near_miss import nearest
from executor.records.rollout import Failure, FailureKind
from executor.robot.description import GRIPPER_OPENING_M
from executor.world.world import World
from oag.revision.measurements import TooWide, Unplanned

LOOKED_AT = 60
NAMED = 3
STANDOFF_M = 0.6
TURNS_RAD = (0.0, 0.3, -0.3)


def why_not_taken(planner: Planner, item: str, goals: list[HandGoal], here: Array) -> Failure:
    """Returns a failure: how far the hand stays off and which joints hold it, or what is in the way.

    Args:
        planner: Synchronised with the world.
        item: What was to be taken.
        goals: The hand poses that would hold it.
        here: (3,) where the base stands.
    """
    if not goals:
        message = f"no side of {item} that the fingers can close around leaves the palm room"
        return Failure(FailureKind.UNREACHABLE, message, (Unplanned(target=item),))
    oracle, kinematics = planner.oracle, planner.kinematics
    blockers: Counter[str] = Counter()
    candidates = placements(goals, here, TURNS_RAD)[:LOOKED_AT]
    reached = False
    for candidate in candidates:
        solutions = kinematics.solve(candidate.goal.T_world_eef, candidate.base, restarts=8, enough=1)
        reached = reached or bool(solutions)
        for solution in solutions:
            q = np.concatenate([candidate.base, solution.arm])
            hits = oracle.hits(q, opening_m=kinematics.finger_upper_m, allowed=fingers_may_touch(item))
            blockers.update(f"{hit.mover} and {hit.other}" for hit in hits)
    found = Unplanned(target=item)
    if not reached:
        miss = nearest(kinematics, candidates)
        return Failure(FailureKind.UNREACHABLE, miss.words(item), (miss.added_to(found),))
    found = replace(found, in_the_way=tuple(name for name, _ in blockers.most_common(NAMED)))
    if not blockers:
        message = f"{item} can be reached, but what the flow does next is not free or out of reach from every stance"
        return Failure(FailureKind.UNREACHABLE, message, (found,))
    return Failure(FailureKind.NO_PATH, f"no way to take {item}: {blockers.most_common(1)[0][0]} meet", (found,))


def why_not_by_its_rim(planner: Planner, world: World, item: str, here: Array) -> Failure:
    """Returns a failure: that an item's wall is too low over what it stands on, or what else keeps the hand from it.

    Args:
        planner: Synchronised with the world.
        world: Where things are.
        item: What was to be taken; it has a rim and is too wide for the gripper.
        here: (3,) where the base stands.
    """
    asset = world.assets[item]
    goals = rim_goals(asset, world.T_world_link(item))
    width_m = min(asset.extent_m[:2])
    wide = f"{item} is {width_m * 1000:.0f} mm wide, the gripper opens to {GRIPPER_OPENING_M * 1000:.0f} mm"
    measured = TooWide(round(width_m, 4), GRIPPER_OPENING_M)
    if not goals:
        return Failure(FailureKind.TOO_WIDE, f"{wide}; it does not stand, so that no finger gets inside", (measured,))
    room_m, needed_m = room_below_m(asset)
    if room_m >= needed_m:
        return why_not_taken(planner, item, goals, here)
    message = (
        f"{wide}, and its rim is {room_m * 1000:.0f} mm above what it stands on: "
        f"a finger below it needs {needed_m * 1000:.0f} mm"
    )
    measured = replace(measured, rim_height_m=round(room_m, 4), rim_height_needed_m=round(needed_m, 4))
    return Failure(FailureKind.TOO_WIDE, message, (measured,))


def in_the_way(planner: Planner, q: Array, towards_m: Array) -> tuple[str, ...]:
    """Returns what meets on the straight way of the base towards a point, the arm as it is; nothing where all is free.

    Args:
        planner: Synchronised with the world.
        q: (10,) where the robot is.
        towards_m: (2,) the point; the last `STANDOFF_M` before it are left out.
    """
    offset = np.asarray(towards_m) - q[:2]
    length_m = float(np.hypot(*offset))
    way = base_move(q, max(length_m - STANDOFF_M, 0.0), float(np.arctan2(offset[1], offset[0])))
    for row in segment(way[0], way[1]):
        if hits := planner.oracle.hits(row):
            return tuple(f"{hit.mover} and {hit.other}" for hit in hits[:NAMED])
    return ()
