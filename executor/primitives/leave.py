"""RETREAT, and the same motion where another primitive begins with the hand still near something."""

from __future__ import annotations

from executor.motion.planning.withdraw import go_home, withdraw
from executor.records.rollout import Failure, FailureKind
from executor.session.session import Outcome, Session
from oag import Action, Primitive
from oag.revision.measurements import RetreatMeasured, Unplanned

SPEED = 0.9


def retreat(session: Session, action: Action) -> Outcome:
    """Takes the hand away from what it let go of and brings the arm home; with an item in hand it only backs off."""
    if session.held is not None:
        return _retreat_holding(session, action)
    before = session.q
    done = leave(session)
    by = session.q[:2] - before[:2]
    session.arrived_m = (session.arrived_m[0] + float(by[0]), session.arrived_m[1] + float(by[1]))
    return done if done is not None else Outcome(action, (RetreatMeasured(already_home=True),))


def leave(session: Session) -> Outcome | None:
    """Withdraws an empty hand and brings the arm home; None when it is home already or holds something."""
    action = Action(Primitive.RETREAT, None)
    if session.gripped is not None:
        message = f"the gripper holds the handle of {session.gripped}; UNGRASP comes before the robot leaves"
        return Outcome(action, (), Failure(FailureKind.PRECONDITION, message, (Unplanned(gripped=session.gripped),)))
    if session.held is not None or session.is_home:
        return None
    session.look()
    plan = withdraw(session.planner, session.q, allowed=session.released)
    if plan is None:
        hits = session.planner.oracle.hits(session.q)
        near = tuple(hit.other for hit in hits)
        message = "no free way takes the hand back from " + (", ".join(near) if near else "where it is")
        return Outcome(action, (), Failure(FailureKind.NO_PATH, message, (Unplanned(near=near),)))
    failure = session.control.follow(plan.back_off, speed=SPEED, monitor=session.monitor(session.released))
    if failure is None:
        failure = session.control.follow(plan.home, speed=SPEED, monitor=session.monitor())
    session.released = frozenset()
    rows = RetreatMeasured(back_off_rows=len(plan.back_off), home_rows=len(plan.home))
    return Outcome(action, (rows,), failure)


def _retreat_holding(session: Session, action: Action) -> Outcome:
    session.look()
    path = go_home(session.planner, session.q)
    if path is None:
        return Outcome(action, (), Failure(FailureKind.NO_PATH, f"no free way back with {session.held} in the hand"))
    return Outcome(action, (), session.control.follow(path, speed=SPEED, monitor=session.monitor(session.lifted_from)))
