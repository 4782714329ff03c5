"""Driving the legs of a planned journey, and which stances are worth looking for one."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Protocol, TypeVar

import numpy as np

from executor.geometry import Array
from executor.motion.planning.contacts import NOTHING
from executor.records.rollout import Failure
from executor.session.session import Session

CANDIDATES = 6
"""How many stances or placements are tried for a free way before giving up."""

LOOKED_AT = 30
ARTICULATIONS_LOOKED_AT = 12
"""How many choices are looked at for one that stands elsewhere; a door's whole way is checked for each of its own."""

ELSEWHERE_M = 0.25
DRIVE_SPEED = 1.0
ARM_SPEED = 1.0


class Standing(Protocol):
    """Something that has the base stand somewhere."""

    @property
    def base(self) -> Array:
        """The base's pose (3,) that is driven to."""


Choice = TypeVar("Choice", bound=Standing)


def elsewhere_first(
    choices: Iterator[Choice], unreached: list[Array] | None = None, looked_at: int = LOOKED_AT
) -> Iterator[Choice]:
    """Yields choices in their order, but those near to an earlier one last: where no way led to that, none leads there.

    Args:
        choices: Good ones first; each is asked for when the one before could not be driven to.
        unreached: Bases that no way led to before; those of the choices are added.
        looked_at: How many choices are looked at for one that stands elsewhere.
    """
    bases = [] if unreached is None else unreached
    waiting: list[Choice] = []
    for choice in itertools.islice(choices, looked_at):
        base = choice.base[:2]
        if any(np.hypot(*(base - other)) < ELSEWHERE_M for other in bases):
            waiting.append(choice)
            continue
        bases.append(base)
        yield choice
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
