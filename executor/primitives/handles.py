"""Which handle a subtask uses, and what was planned to be done with it."""

from __future__ import annotations

from dataclasses import replace

from executor.assets.model import Handle
from executor.motion.articulation.doors import gripped_handle
from executor.motion.articulation.work import Swing, handle_contacts
from executor.motion.planning.contacts import Allowed, fingers_may_touch
from executor.session.session import Session


def planned_swing(session: Session) -> Swing | None:
    """Returns what the stance was chosen for, or None when it is no articulation."""
    followup = session.stance.followup if session.stance is not None else None
    return followup if isinstance(followup, Swing) else None


def spend_swing(session: Session) -> None:
    """Forgets what the stance was chosen for once it is done: another articulation has numbers of its own."""
    if session.stance is not None and planned_swing(session) is not None:
        session.stance = replace(session.stance, followup=None)


def is_push(session: Session) -> bool:
    """Decides whether the closed gripper is to push the panel, so that there is nothing to grasp."""
    swing = planned_swing(session)
    return swing is not None and swing.motion == "push"


def handle_in_use(session: Session) -> Handle | None:
    """Returns the handle that was planned for, else the one between the fingers, else the first; None without any."""
    swing = planned_swing(session)
    if swing is not None:
        return swing.handle
    target = session.subtask.target
    handles = session.world.assets[target].handles
    return (gripped_handle(session.world, target) or handles[0]) if handles else None


def target_contacts(session: Session) -> Allowed:
    """Returns the contacts that holding the target means: its handle's link, or the item."""
    target, handle = session.subtask.target, handle_in_use(session)
    return handle_contacts(target, handle) if handle is not None else fingers_may_touch(target)
