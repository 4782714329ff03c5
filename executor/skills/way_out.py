"""The way out of what a thing is taken from: is it out, whither was its drawer pulled, from which stances it leads."""

from __future__ import annotations

import numpy as np

from executor.geometry import Array, heading_of
from executor.planning.cargo import is_outside
from executor.planning.drives import leads_straight_home
from executor.planning.openings import open_joints
from executor.skills.session import Session

MOST_STUCK = 5
"""How many stances from which nothing straight leads out with what was taken are passed over."""


class WayOut:
    """A test whether the hand gets straight out with the target from where it was lifted to.

    Out of a drawer one stance may lead over the front, and another one has the forearm within it. After several that do
    not, all others count as ones that do: searching has an end.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.stuck = 0

    def leads_out(self, lifted: Array) -> bool:
        """Return whether it does so from a configuration (Q,), with the target in the oracle's hand."""
        session = self._session
        leads = self.stuck >= MOST_STUCK or leads_straight_home(
            session.planner, lifted, lambda end: is_out(session, end), pulled_rad(session)
        )
        self.stuck += not leads
        return leads


def is_out(session: Session, end: Array) -> bool:
    """Return whether what is held is outside of what it is taken out of, at a configuration (Q,)."""
    carried, within = session.planner.oracle.carried, session.subtask.support_init
    if carried is None or within is None or within not in session.believed.assets:
        return True
    return is_outside(session.believed, carried, within, session.planner.kinematics.forward(end))


def pulled_rad(session: Session) -> float | None:
    """Return the heading in which the drawer was pulled that the target lies in; None where it lies in none."""
    world, within = session.believed, session.subtask.support_init
    if within is None or within not in world.articulated_ids:
        return None
    slides = [joint for joint in open_joints(world, within) if joint.kind == "prismatic"]
    return heading_of(world.T_world_link(within)[:3, :3] @ np.array(slides[0].axis)) if slides else None
