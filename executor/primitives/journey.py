"""Driving the legs of a planned journey."""

from __future__ import annotations

from executor.geometry import Array
from executor.motion.contacts import NOTHING
from executor.records import Failure
from executor.session import Session

CANDIDATES = 6
"""How many stances or placements are tried for a free way before giving up."""

DRIVE_SPEED = 1.0
ARM_SPEED = 1.0


def follow_legs(session: Session, legs: list[tuple[str, Array]]) -> Failure | None:
    """Moves along the legs of a journey; returns why one ended early, or None."""
    for name, path in legs:
        speed = DRIVE_SPEED if name == "drive" else ARM_SPEED
        allowed = session.lifted_from if name == "back out" else NOTHING
        failure = session.control.follow(path, speed=speed, monitor=session.monitor(allowed))
        if failure is not None:
            return failure
    return None
