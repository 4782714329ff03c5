"""Why no way of opening or closing was found, measured at the stances that come nearest to one."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from executor.geometry import Array
from executor.motion.articulation.grips import tilted_goals
from executor.motion.articulation.rigid import carry_joint, driving_carries
from executor.motion.articulation.stances import HANDLE_TURNS_RAD, HOLDING_OPENING_M
from executor.motion.articulation.work import Work, door_meets, handle_contacts
from executor.motion.grasping.grasps import handle_goals
from executor.motion.stances.candidates import placements
from executor.motion.stances.near_miss import nearest
from executor.records.rollout import Failure, FailureKind
from oag.revision.measurements import Unplanned

LOOKED_AT = 40


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
