"""SET_UPRIGHT: what lay and is held now stands, between the fingers, as it does by nature.

The arm turns it on the way: the placement before this step was planned with the held thing upright over its place.
This step measures how far it leans there, since things turn between fingers, and turns the hand by what is left.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from executor.geometry import Array, transform
from executor.records import Failure, FailureKind
from executor.skills.session import Session, StepResult
from oag import Action, SimpleTask
from oag.measurements import AtomMeasured, Unplanned
from oag.model.domain import own_of
from oag.model.scene import UPRIGHT_DEG

ROW = "SET_UPRIGHT"
STANDS_DEG = 2.0  # What leans less is let go of as it is: it rights itself on its foot.
TURN_SPEED = 0.3  # Of the limits: the foot is next to what it will stand on.


def sets_upright(subtask: SimpleTask) -> bool:
    """Return whether a subtask's flow stands its target up."""
    steps = (own_of(action.primitive) for action in subtask.flow or ())
    return any(own is not None and own.row.name == ROW for own in steps)


def set_upright(session: Session, action: Action) -> StepResult:
    """Turn the hand by what the held thing still leans; it ends where the thing cannot be let go of upright."""
    held = session.hand.held
    if held is None or held != session.subtask.target:
        message = f"the hand does not hold {session.subtask.target}"
        unplanned = Unplanned(target=session.subtask.target)
        return session.done(action, failure=Failure(FailureKind.PRECONDITION, message, (unplanned,)))
    failure: Failure | None = None
    if _lean_deg(session, held) > STANDS_DEG:
        session.sync_planner()
        path = session.planner.line(session.q, _upright_hand(session, held)).path
        if path is not None and not session.planner.oracle.first_hit(path, allowed=session.hand.lifted_from):
            monitor = session.monitor(session.hand.lifted_from)
            failure = session.control.follow(path, speed=TURN_SPEED, monitor=monitor)
    lean_deg = _lean_deg(session, held)
    measured = AtomMeasured(tilted_deg=round(lean_deg, 2))
    if failure is None and lean_deg > UPRIGHT_DEG:
        message = f"{held} leans by {lean_deg:.0f} degrees between the fingers, and would not stand"
        failure = Failure(FailureKind.SLIPPED, message, (measured,))
    return session.done(action, measured, failure=failure)


def _lean_deg(session: Session, held: str) -> float:
    upwards = float(session.world.T_world_link(held)[2, 2])
    return float(np.degrees(np.arccos(np.clip(upwards, -1.0, 1.0))))


def _upright_hand(session: Session, held: str) -> Array:
    """Return the hand's pose (4, 4) in which the held thing stands upright where it is."""
    T_hand, T_thing = session.planner.kinematics.forward(session.control.q), session.world.T_world_link(held)
    about = np.cross(T_thing[:3, 2], [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(about))
    angle_rad = float(np.arctan2(sine, T_thing[2, 2]))
    turn = Rotation.from_rotvec(about / sine * angle_rad).as_matrix()
    middle = T_thing[:3, 3]
    return transform(turn @ T_hand[:3, :3], turn @ (T_hand[:3, 3] - middle) + middle)
