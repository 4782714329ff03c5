"""Letting go of a handle and taking the next one, or the same door elsewhere, in the middle of an articulation."""

from __future__ import annotations

from executor.assets.model import Handle
from executor.motion.articulation.doors import handles_to_close, standing_open
from executor.motion.articulation.ways import articulation_stances
from executor.motion.articulation.why import why_not
from executor.motion.articulation.work import Work
from executor.primitives.grasp import grasp, ungrasp
from executor.primitives.leave import leave
from executor.primitives.navigate import adopt_first
from executor.primitives.reach import approach, converge
from executor.records.rollout import Failure
from executor.session.session import Session
from oag import Action, Primitive

MOST_STAGES = 6


def next_handles(session: Session, action: Action, done: set[str]) -> tuple[Handle, ...]:
    """Returns the handles of what still stands open when closing, those joints left out that were seen to."""
    target = session.subtask.target
    if action.primitive is not Primitive.ARTICULATE_CLOSE or not standing_open(session.world, target):
        return ()
    return tuple(handle for handle in handles_to_close(session.world, target) if handle.joint not in done)


def take_up(session: Session, action: Action, handles: tuple[Handle, ...], *, going_on: bool) -> Failure | None:
    """Lets go, goes to one of some handles, or before its panel, and takes hold; returns why not, or None.

    Args:
        session: The subtask.
        action: The articulation.
        handles: Those that will do, the preferred one first.
        going_on: Whether an earlier stage has brought the joint part of the way.
    """
    target = session.subtask.target
    ungrasp(session, Action(Primitive.UNGRASP))
    away = leave(session)
    if away is not None and away.failure is not None:
        return away.failure
    session.stance, session.pending = None, None
    session.look()
    planner, world, here = session.planner, session.believed, session.q[:3]
    ways = articulation_stances(planner, world, target, handles, action, here, going_on=going_on)
    if adopt_first(session, ways) is not None:
        return why_not(Work(planner, world, target, handles[0], action), here)
    for step in (approach, converge, grasp):
        outcome = step(session, Action(Primitive[step.__name__.upper()]))
        if outcome.failure is not None:
            return outcome.failure
    return None
