"""A door that ends at one place in every attempt: something stands there that nobody knows of.

A single loss of grip does not tell weak fingers from a door that met something; a second one at the same place does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from llm.evolution.cause import Cause, CauseKind, diagnose
from oag import Attempt, Primitive

TIMES = 2
"""How many attempts have to end in the same way before that is taken for how it is."""

SAME_PLACE = 0.01
AJAR = (0.03, 0.1)
"""Between these fractions of its range a door that meets something is open by too little for a hand to go in."""

LOST = frozenset({CauseKind.GRIP_LOST, CauseKind.JOINT_STALLED})


def lost_openings(attempts: Sequence[Attempt]) -> Iterator[Cause]:
    """Yields the causes of those attempts that failed since a joint did not open as far as it was asked to."""
    for attempt in attempts:
        cause = diagnose(attempt)
        if cause is None or cause.kind not in LOST:
            continue
        if attempt.flow[cause.step].primitive is Primitive.ARTICULATE_OPEN:
            yield cause


def stopped_at(attempts: Sequence[Attempt]) -> float | None:
    """Returns the fraction of its range at which a door ended in several attempts, ajar; None where it did not."""
    reached = [cause.joint.fraction_reached for cause in lost_openings(attempts) if cause.joint is not None]
    if len(reached) < TIMES or not all(AJAR[0] <= place <= AJAR[1] for place in reached):
        return None
    return max(reached) if max(reached) - min(reached) <= SAME_PLACE else None


def known_by_now(cause: Cause, attempts: Sequence[Attempt]) -> Cause:
    """Returns a cause with what several attempts say of it: where a door ends whatever is asked."""
    if cause.kind not in LOST or stopped_at(attempts) is None:
        return cause
    return replace(cause, stopped=True)
