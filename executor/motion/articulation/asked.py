"""What an articulation's numbers ask for, and which numbers say what was done."""

from __future__ import annotations

from executor.assets.model import Joint
from oag import Action, Primitive

OPEN_FRACTIONS = (0.85, 0.75, 0.65, 0.55)
"""How far an unfilled ARTICULATE_OPEN opens, the widest feasible one first."""

SMALLER_FRACTIONS = (0.45, 0.35, 0.25, 0.15)
"""How far it opens where the floor or the arm allows no more; what stands ajar is then pushed on from inside."""

LEAST_STAGE = 0.06
"""A stage moves a joint by at least this part of its range, and leaves at least this much to the next."""


def end_fractions(action: Action, joint: Joint, now: float) -> tuple[float, ...]:
    """Returns where an articulation may end, as fractions of the joint's range, the preferred one first.

    An interval [a, b] opens to b, or closes by b - a of the range but not below a; no interval opens wide and closes
    fully. Limits up to 1 are fractions of the range, larger ones radians (or metres).

    Source: appendix, "Articulated-Object Interaction"; the reading of the interval is ours (docs/departures.md).

    Args:
        action: ARTICULATE_OPEN or ARTICULATE_CLOSE.
        joint: The joint that moves.
        now: The joint's fraction now.
    """
    interval = action.parameter
    if isinstance(interval, tuple):
        low, high = interval
        if high > 1.0:
            low, high = joint.fraction(low), min(joint.fraction(high), 1.0)
        return (high,) if action.primitive is Primitive.ARTICULATE_OPEN else (max(now - (high - low), low),)
    if action.primitive is Primitive.ARTICULATE_OPEN:
        return tuple(f for f in OPEN_FRACTIONS if f > now) or (1.0,)
    return (0.0,)


def smaller_fractions(action: Action, joint: Joint, now: float) -> tuple[float, ...]:
    """Returns where a first stage may end when what is asked for cannot be had in one motion, the nearest first.

    Args:
        action: ARTICULATE_OPEN or ARTICULATE_CLOSE.
        joint: The joint that moves.
        now: The joint's fraction now.
    """
    end = end_fractions(action, joint, now)[-1]
    if action.primitive is Primitive.ARTICULATE_OPEN:
        steps = (*OPEN_FRACTIONS, *SMALLER_FRACTIONS)
        return tuple(f for f in steps if now + LEAST_STAGE < f < end - LEAST_STAGE)
    steps = (*SMALLER_FRACTIONS[::-1], *OPEN_FRACTIONS[::-1])
    return tuple(f for f in steps if end + LEAST_STAGE < f < now - LEAST_STAGE)


def interval(start: float, end: float) -> tuple[float, float]:
    """Returns the interval that says what was done, rounded so that reading it back does the same or more."""
    low, high = sorted((max(0.0, start), end))
    return (round(low, 2), min(round(high + 0.005, 2), 1.0))
