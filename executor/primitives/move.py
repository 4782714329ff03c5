"""The parameterised primitives: straight hand motions, base slides and turns, run as their number says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from executor.motion.planning.moves import EEF_DIRECTIONS, TURN_SIGNS, move_path
from executor.primitives.session import Session, StepResult
from executor.records.rollout import Failure, FailureKind
from oag import Action, Primitive
from oag.revision.measurements import MoveMeasured, OutOfReach, UnmeantContact, first_of

EEF_SPEED = 0.6  # Of the limits: these moves end at things.
BASE_SPEED = 0.7  # And so do the base's.
REACH_STEP_M = 0.005


def move(session: Session, action: Action) -> StepResult:
    """Moves by the action's number, or by the one chosen ahead for it, and stops at contact that is not meant."""
    planned = session.plan.numbers.get(session.step)
    amount = action.parameter if action.parameter is not None else planned
    if not isinstance(amount, float | int):
        return session.done(action, failure=_numberless(session, action.primitive))
    filled = replace(action, parameter=float(amount))
    session.look()
    path = move_path(session.planner, session.q, action.primitive, float(amount))
    if path.path is None:
        reach_m = _reach_m(session, action.primitive, float(amount))
        short_m = float(amount) - reach_m
        message = f"the arm reaches {reach_m:.2f} m of {amount:g} m along {action.primitive.name}"
        short = OutOfReach(round(short_m, 4), round(reach_m, 4), float(amount), path.at_limit)
        return session.done(filled, short, failure=Failure(FailureKind.UNREACHABLE, message, (short,)))
    before = session.planner.kinematics.forward(session.control.q)
    allowed = session.hand.lifted_from
    if session.hand.gripped is not None:
        # A hand that still holds a handle moves the door, or presses on it: that contact is what it is for.
        allowed = allowed | session.hand.released
    speed = EEF_SPEED if action.primitive in EEF_DIRECTIONS else BASE_SPEED
    failure = session.control.follow(path.path, speed=speed, monitor=session.monitor(allowed))
    after = session.planner.kinematics.forward(session.control.q)
    turned = action.primitive in TURN_SIGNS
    moved = MoveMeasured(
        asked_m=None if turned else float(amount),
        asked_deg=float(amount) if turned else None,
        eef_moved_m=round(float(np.linalg.norm(after[:3, 3] - before[:3, 3])), 4),
    )
    if failure is not None and _set_down(session, action, failure):
        return session.done(filled, replace(moved, set_down=True), *failure.measurements)
    return session.done(filled, moved, failure=failure)


def _numberless(session: Session, primitive: Primitive) -> Failure:
    """Returns why a move has no number: no place was found, or it stands where no primitive plans ahead for it."""
    unplaced = session.plan.unplaced
    if unplaced is not None:
        return replace(unplaced, message=f"{primitive.name} has no number: {unplaced.message}")
    message = f"{primitive.name} has no number, and nothing was planned ahead for it"
    return Failure(FailureKind.PRECONDITION, message)


def _reach_m(session: Session, primitive: Primitive, amount_m: float) -> float:
    """Returns how far along a straight way the arm does come, to within `REACH_STEP_M`.

    What a line's solver is off by where it ends is no such distance: its waypoints beyond reach end anywhere.
    """
    reached, beyond = 0.0, amount_m
    while beyond - reached > REACH_STEP_M:
        half = (reached + beyond) / 2
        if move_path(session.planner, session.q, primitive, half).path is None:
            beyond = half
        else:
            reached = half
    return reached


def _set_down(session: Session, action: Action, failure: Failure) -> bool:
    """Decides whether a motion ended because what is held came to rest on its support: that is what lowering is for."""
    met = first_of(failure.measurements, UnmeantContact)
    return (
        action.primitive is Primitive.LIFT_EEF_DOWN
        and failure.kind is FailureKind.COLLISION
        and met is not None
        and met.mover == session.hand.held
        and met.other == session.subtask.support_goal
    )
