"""ARTICULATE_OPEN and ARTICULATE_CLOSE: carry the gripped handle along its joint with the whole robot."""

from __future__ import annotations

from dataclasses import replace

from executor.motion.articulate import carry_joint
from executor.motion.reach import Swing, end_fractions, handle_contacts
from executor.records import Failure, FailureKind, JsonValue
from executor.session import Outcome, Session
from oag import Action

SPEED = 1.0
SETTLE_S = 0.2
TOLERANCE = 0.04
"""How far short of the asked fraction of the joint's range counts as a stall."""


def articulate(session: Session, action: Action) -> Outcome:
    """Moves the target's joint to where the action says, measured at the joint."""
    target = session.subtask.target
    asset = session.world.assets[target]
    if session.gripped != target or not asset.handles:
        message = f"the gripper does not hold a handle of {target}"
        return Outcome(action, {}, Failure(FailureKind.PRECONDITION, message, {"target": target}))
    handle = asset.handles[0]
    joint = asset.joint(handle.joint)
    start = session.world.joint_position(target, joint.name)
    now = joint.fraction(start)
    followup = session.stance.followup if session.stance is not None else None
    end = followup.end_fraction if isinstance(followup, Swing) else end_fractions(action, joint, now)[0]
    session.look()
    allowed = handle_contacts(target, handle)
    way = carry_joint(session.q, target, joint, session.world.T_world_link(target), start, joint.position(end))
    failure = session.control.follow(way.path, speed=SPEED, monitor=session.monitor(allowed, gripped=target))
    session.control.settle(SETTLE_S)
    reached = joint.fraction(session.world.joint_position(target, joint.name))
    measurements: dict[str, JsonValue] = {
        "fraction_before": round(now, 4),
        "fraction_asked": round(end, 4),
        "fraction_reached": round(reached, 4),
        "joint_reached": round(session.world.joint_position(target, joint.name), 4),
    }
    if failure is None and abs(reached - end) > TOLERANCE:
        message = f"{joint.name} stalled at {reached:.2f} of its range, {end:.2f} was asked"
        failure = Failure(FailureKind.STALLED, message, measurements)
    filled = action if action.parameter is not None else replace(action, parameter=_interval(now, end))
    return Outcome(filled, measurements, failure)


def _interval(start: float, end: float) -> tuple[float, float]:
    """Returns the interval that says what was done, rounded so that reading it back does the same or more."""
    low, high = sorted((max(start, 0.0), end))
    return (round(low, 2), min(round(high + 0.005, 2), 1.0))
