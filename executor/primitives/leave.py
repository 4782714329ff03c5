"""RETREAT, and the same motion where another primitive begins with the hand still near something."""

from __future__ import annotations

from dataclasses import replace

from executor.motion.planning.contacts import NOTHING
from executor.motion.planning.withdraw import go_home, withdraw
from executor.primitives.session import Outcome, Session
from executor.records.rollout import Failure, FailureKind
from oag import Action, Primitive
from oag.revision.measurements import RetreatMeasured, Unplanned

SPEED = 0.9


def retreat(session: Session, action: Action) -> Outcome:
    """Takes the hand away from what it let go of and brings the arm home; with an item in hand it only backs off."""
    if session.hand.held is not None:
        return _retreat_holding(session, action)
    before = session.q
    left = leave(session)
    by, arrived_m = session.q[:2] - before[:2], session.plan.arrived_m
    plan = replace(session.plan, arrived_m=(arrived_m[0] + float(by[0]), arrived_m[1] + float(by[1])))
    return replace(left, session=replace(left.session, plan=plan), action=action)


def leave(session: Session) -> Outcome:
    """Withdraws an empty hand and brings the arm home; nothing moves where it is home already or holds something."""
    action, hand = Action(Primitive.RETREAT, None), session.hand
    if hand.gripped is not None:
        message = f"the gripper holds the handle of {hand.gripped}; UNGRASP comes before the robot leaves"
        unplanned = Unplanned(gripped=hand.gripped)
        return session.done(action, failure=Failure(FailureKind.PRECONDITION, message, (unplanned,)))
    if hand.held is not None or session.is_home:
        return session.done(action, RetreatMeasured(already_home=True))
    session.look()
    plan = withdraw(session.planner, session.q, allowed=hand.released)
    if plan is None:
        near = tuple(hit.other for hit in session.planner.oracle.hits(session.q))
        message = "no free way takes the hand back from " + (", ".join(near) if near else "where it is")
        return session.done(action, failure=Failure(FailureKind.NO_PATH, message, (Unplanned(near=near),)))
    failure = session.control.follow(plan.back_off, speed=SPEED, monitor=session.monitor(hand.released))
    if failure is None:
        failure = session.control.follow(plan.home, speed=SPEED, monitor=session.monitor())
    rows = RetreatMeasured(back_off_rows=len(plan.back_off), home_rows=len(plan.home))
    return replace(session, hand=replace(hand, released=NOTHING)).done(action, rows, failure=failure)


def _retreat_holding(session: Session, action: Action) -> Outcome:
    session.look()
    path = go_home(session.planner, session.q)
    if path is None:
        message = f"no free way back with {session.hand.held} in the hand"
        return session.done(action, failure=Failure(FailureKind.NO_PATH, message))
    monitor = session.monitor(session.hand.lifted_from)
    return session.done(action, failure=session.control.follow(path, speed=SPEED, monitor=monitor))
