"""APPROACH and CONVERGE: to the pre-grasp pose, then straight onto the handle or the item."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from executor.geometry import Array, rotation_z
from executor.motion.grasping.why import in_the_way
from executor.motion.planning.carry import drive_to
from executor.motion.planning.moves import BASE_HEADINGS_RAD
from executor.primitives.driving import follow_legs
from executor.primitives.grasp import target_contacts
from executor.primitives.navigate import with_stance
from executor.primitives.session import Outcome, Plan, Session
from executor.records.rollout import Failure, FailureKind
from oag import Action, Primitive
from oag.revision.measurements import HandMeasured, Unplanned

CONVERGE_SPEED = 0.5
AT_PRE_GRASP_RAD = 0.02
NO_OFFSET_M = 1e-6


def approach(session: Session, action: Action) -> Outcome:
    """Moves the hand to the pre-grasp pose; drives there first where the flow did not navigate."""
    planned = with_stance(session) if session.plan.stance is None else session
    if isinstance(planned, Failure):
        return session.done(action, failure=planned)
    session = replace(planned, plan=_with_base_moves(planned))
    stance, journey = session.plan.stance, session.plan.journey
    if stance is None:
        raise RuntimeError("a stance must have been planned")
    start = stance.approach[0]
    if journey is not None and not np.allclose(journey.legs[0][1][0], session.q, atol=1e-6):
        # The flow has moved the robot since the journey was planned.
        journey = None
    if journey is None and not _is_at(session.q, start):
        session.look()
        journey = drive_to(session.planner, session.q, start)
        if journey is None:
            return session.done(action, failure=_no_way(session, start))
    failure = None if journey is None else follow_legs(session, journey.legs)
    plan = replace(session.plan, journey=None)
    if failure is None:
        # The journey may have counted the base's yaw in another turn than the stance did.
        plan = replace(plan, stance=stance.turned(float(session.q[2] - start[2])))
    return replace(session, plan=plan).done(action, _hand(session), failure=failure)


def _no_way(session: Session, start: Array) -> Failure:
    blockers = in_the_way(session.planner, session.q, start[:2])
    found = Unplanned(target=session.subtask.target, in_the_way=blockers)
    return Failure(FailureKind.NO_PATH, "no free way leads to the pre-grasp pose", (found,))


def converge(session: Session, action: Action) -> Outcome:
    """Moves the hand straight from the pre-grasp pose to the grasp."""
    stance = session.plan.stance
    if stance is None or not _is_at(session.q, stance.approach[0]):
        message = f"the hand is not at the pre-grasp pose of {session.subtask.target}"
        return session.done(action, failure=Failure(FailureKind.PRECONDITION, message))
    session.look()
    off = _off_the_aim(session)
    path = np.concatenate([session.q[None], stance.approach])
    failure = session.control.follow(path, speed=CONVERGE_SPEED, monitor=session.monitor(target_contacts(session)))
    wanted = session.planner.kinematics.forward(stance.q)[:3, 3]
    reached = session.planner.kinematics.forward(session.control.q)[:3, 3]
    measured = replace(_hand(session), residual_m=round(float(np.linalg.norm(wanted - reached)), 5))
    if off is not None:
        forward, left, up = (round(float(way), 4) for way in off)
        measured = replace(measured, target_forward_m=forward, target_left_m=left, target_up_m=up)
    return session.done(action, measured, failure=failure)


# What may stand between NAVIGATE_TO_TARGET and APPROACH besides slides: a RETREAT's own way is not counted as one.
_KEEPING = frozenset({*BASE_HEADINGS_RAD, Primitive.RETREAT})


def _with_base_moves(session: Session) -> Plan:
    """Shifts the stance by the base slides that the flow has made since NAVIGATE_TO_TARGET: corrections, to be kept."""
    before, plan = session.step - 1, session.plan
    slid = False
    while before >= 0 and session.flow[before].primitive in _KEEPING:
        slid = slid or session.flow[before].primitive in BASE_HEADINGS_RAD
        before -= 1
    moved = slid and before >= 0 and session.flow[before].primitive is Primitive.NAVIGATE_TO_TARGET
    if not moved or plan.stance is None:
        return plan
    by = session.q[:2] - plan.arrived_m
    return replace(plan, stance=plan.stance.beside(by), aside_m=(float(by[0]), float(by[1])))


def _off_the_aim(session: Session) -> Array | None:
    """Returns how far the target is from where it is aimed at (3,), in the base's directions; None when it is there."""
    target, aside = session.subtask.target, np.array([*session.plan.aside_m, 0.0])
    off = session.world.T_world_link(target)[:3, 3] - session.believed.T_world_link(target)[:3, 3] - aside
    if np.abs(off).max() < NO_OFFSET_M:
        return None
    return np.asarray(rotation_z(float(session.q[2])).T @ off)


def _is_at(q: Array, start: Array) -> bool:
    difference = q - start
    difference[2] = (difference[2] + np.pi) % (2 * np.pi) - np.pi
    return bool(np.abs(difference).max() < AT_PRE_GRASP_RAD)


def _hand(session: Session) -> HandMeasured:
    position = session.planner.kinematics.forward(session.control.q)[:3, 3]
    return HandMeasured(tuple(round(float(v), 4) for v in position))
