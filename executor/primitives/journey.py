"""Driving the legs of a planned journey, and which stances are worth looking for one."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from executor.geometry import Array
from executor.motion.contacts import NOTHING
from executor.motion.stance import Stance
from executor.records import Failure
from executor.session import Session

CANDIDATES = 6
"""How many stances or placements are tried for a free way before giving up."""

LOOKED_AT = 30
ELSEWHERE_M = 0.25
DRIVE_SPEED = 1.0
ARM_SPEED = 1.0


def elsewhere_first(stances: Iterator[Stance[Any]]) -> Iterator[Stance[Any]]:
    """Yields stances in their order, but those near to an earlier one last: where no way led to that, none leads there.

    Args:
        stances: Good ones first; each is asked for when the one before could not be driven to.
    """
    bases: list[Array] = []
    waiting: list[Stance[Any]] = []
    for stance in itertools.islice(stances, LOOKED_AT):
        base = stance.q[:2]
        if any(np.hypot(*(base - other)) < ELSEWHERE_M for other in bases):
            waiting.append(stance)
            continue
        bases.append(base)
        yield stance
    yield from waiting


def follow_legs(session: Session, legs: list[tuple[str, Array]]) -> Failure | None:
    """Moves along the legs of a journey; returns why one ended early, or None."""
    for name, path in legs:
        speed = DRIVE_SPEED if name == "drive" else ARM_SPEED
        allowed = session.lifted_from if name == "back out" else NOTHING
        failure = session.control.follow(path, speed=speed, monitor=session.monitor(allowed))
        if failure is not None:
            return failure
    return None
