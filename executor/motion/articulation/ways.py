"""In which order the ways of opening and closing are tried, over all handles that will do; and why none was found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from executor.assets.model import Handle
from executor.geometry import Array
from executor.motion.articulation.doors import Serves
from executor.motion.articulation.grips import tilted_goals
from executor.motion.articulation.joint_motion import carry_joint, driving_carries
from executor.motion.articulation.stances import (
    HANDLE_TURNS_RAD,
    HOLDING_OPENING_M,
    edge_stances,
    push_stances,
    rigid_stances,
    tracked_stances,
)
from executor.motion.articulation.work import Swing, Work, door_meets, handle_contacts, possible_fractions
from executor.motion.grasping.grasps import handle_goals
from executor.motion.planning.candidates import nearest, placements
from executor.motion.planning.planner import Planner
from executor.motion.planning.stance import Stance
from executor.records.rollout import Failure, FailureKind
from executor.world.world import World
from oag import Action, Primitive
from oag.revision.measurements import Unplanned

Way = Callable[[Work, Array], Iterator[Stance[Swing]]]
OPENING: tuple[tuple[Way, bool], ...] = (
    (rigid_stances, False),
    (tracked_stances, False),
    (rigid_stances, True),
    (tracked_stances, True),
    (push_stances, False),
    (push_stances, True),
)
"""Each way with whether it may do less than was asked; what is missing is left to another stage."""

CLOSING: tuple[tuple[Way, bool], ...] = (
    (rigid_stances, False),
    (tracked_stances, False),
    (push_stances, False),
    (edge_stances, False),
    (rigid_stances, True),
    (tracked_stances, True),
    (push_stances, True),
    (edge_stances, True),
)
GOING_ON: tuple[tuple[Way, bool], ...] = (
    (push_stances, False),
    (rigid_stances, False),
    (tracked_stances, False),
    (push_stances, True),
)
"""For a joint that an earlier stage has brought part of the way."""

LOOKED_AT = 40  # Enough to tell what is in the way.


def articulation_stances(
    planner: Planner,
    world: World,
    object_id: str,
    handles: tuple[Handle, ...],
    action: Action,
    here: Array,
    *,
    going_on: bool = False,
    serves: Serves = lambda _: True,
) -> Iterator[Iterator[Stance[Swing]]]:
    """Yields, for one way of moving a joint after the other, the stances from which it can be done.

    Args:
        planner: Synchronised with the world.
        world: Where things are.
        object_id: The articulated object.
        handles: Those that will do, the preferred one first.
        action: ARTICULATE_OPEN or ARTICULATE_CLOSE, filled or not.
        here: (3,) where the base stands.
        going_on: Whether an earlier stage has brought the joint part of the way.
        serves: Whether a handle is one that later subtasks can do with; asked only where there are several. Others
            are tried last.
    """
    first = OPENING if action.primitive is Primitive.ARTICULATE_OPEN else CLOSING
    for useful in (True, False):
        for way, partial in GOING_ON if going_on else first:
            for handle in handles:
                if (len(handles) == 1 or serves(handle)) is not useful:
                    continue
                work = Work(planner, world, object_id, handle, action, partial)
                if not partial or _has_a_rest(work):
                    yield way(work, here)


def _has_a_rest(work: Work) -> bool:
    """Decides whether doing less is of use: later stages can do the rest, or the flow leaves open how much it is."""
    wanted = work.action.parameter is None or bool(possible_fractions(replace(work, partial=False)))
    return wanted and bool(work.smaller)


def why_not(work: Work, here: Array) -> Failure:
    """Returns a failure: how far the hand stays off the handle and which joints hold it, or what is in the way.

    Args:
        work: What was to be moved.
        here: (3,) where the base stands.
    """
    oracle, kinematics, handle = work.planner.oracle, work.planner.kinematics, work.handle
    T_link = work.world.T_world_link(work.object_id, handle.link)
    rigid = driving_carries(work.joint, work.T_root)
    goals = handle_goals(handle, T_link) if rigid else tilted_goals(handle, work.T_root, T_link, facing=handle.outward)
    holding = handle_contacts(work.object_id, handle)
    found = Unplanned(target=work.object_id, joint=work.joint.name)
    meets = door_meets(work)
    now = work.joint.fraction(work.now)
    if meets is not None and abs(meets[0] - now) < abs(work.fractions[-1] - now):
        message = f"{work.joint.name} of {work.object_id} meets {meets[1]} at {meets[0]:.2f} of its range"
        found = replace(found, in_the_way=(meets[1],), free_to_fraction=round(meets[0], 2))
        return Failure(FailureKind.NO_PATH, message, (found,))
    at_grasp: Counter[str] = Counter()
    on_the_way: Counter[str] = Counter()
    out_of_reach = True
    candidates = placements(goals, here, HANDLE_TURNS_RAD)[:LOOKED_AT]
    for candidate in candidates:
        solutions = kinematics.solve(candidate.goal.T_world_eef, candidate.base, restarts=8)
        out_of_reach = out_of_reach and not solutions
        for solution in solutions[:1]:
            q = np.concatenate([candidate.base, solution.arm])
            hits = oracle.hits(q, opening_m=kinematics.finger_upper_m, allowed=holding)
            at_grasp.update(hit.other for hit in hits)
            if hits or not rigid:
                continue
            end = work.joint.position(work.fractions[-1])
            arc = carry_joint(q, work.object_id, work.joint, work.T_root, work.now, end)
            hit = oracle.first_hit(arc.path, allowed=holding, joints=arc.joints, opening_m=HOLDING_OPENING_M)
            on_the_way.update([f"{hit.mover} and {hit.other}"] if hit is not None else [])
    what = f"no way to move {work.joint.name} of {work.object_id}"
    if out_of_reach:
        miss = nearest(kinematics, candidates)
        return Failure(FailureKind.UNREACHABLE, f"{what}: {miss.words('its handle')}", (miss.added_to(found),))
    for when, met in (("at the handle", at_grasp), ("on the way", on_the_way)):
        if met:
            found = replace(found, in_the_way=tuple(name for name, _ in met.most_common(3)))
            return Failure(FailureKind.NO_PATH, f"{what}: {met.most_common(1)[0][0]} in the way {when}", (found,))
    message = f"{what}: the arm does not follow it from any stance that is free"
    return Failure(FailureKind.UNREACHABLE, message, (found,))
