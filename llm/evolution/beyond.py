"""What no flow corrects: said as soon as it is measured, with what it would take instead.

The library's primitives move hand and base and set joint limits. None of them measures a thing anew, presses harder,
or takes something away that nobody knows of. A single loss of grip does not tell weak fingers from a door that met
something; a second one at the same place does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from llm.evolution.cause import CauseKind, RootCause, diagnose
from llm.evolution.observation import GiveUp, Situation
from oag import Attempt, History, Primitive
from oag.model.primitives import ARTICULATIONS

TIMES = 2
"""How many attempts have to end in the same way before that is taken for how it is."""

# Two ends of one door that differ by less are at the same place: readings of a joint at rest are much finer.
SAME_PLACE = 0.01
AJAR = (0.03, 0.1)
"""Between these fractions of its range a door that meets something is open by too little for a hand to go in; before
them it has not come off its gasket."""

_LOST = frozenset({CauseKind.GRIP_LOST, CauseKind.JOINT_STALLED})
_KEPT_OUT = frozenset({CauseKind.NO_WAY, CauseKind.NOWHERE, CauseKind.OUT_OF_REACH, CauseKind.BLOCKED})


def beyond(situation: Situation) -> GiveUp | None:
    """Returns why no flow of the library corrects a failure; None as long as that is not evident."""
    cause = diagnose(situation.attempt)
    if cause is None:
        return None
    target = situation.task.subtasks[situation.subtask].target
    if cause.kind is CauseKind.TOO_WIDE:
        needed = "a narrower thing, or its size measured anew, and no primitive does either"
        return _hopeless(situation.attempt.message, needed, cause.kind)
    if cause.kind in _LOST and situation.attempt.flow[cause.step].primitive in ARTICULATIONS:
        tried = _attempts(situation.history.add(situation.attempt))
        joints = [lost.joint for lost in _lost_openings(tried)]
        if len(joints) < TIMES or any(joint is None or joint.fraction_reached >= AJAR[0] for joint in joints):
            return None
        why = f"the fingers slid off {target} before it was ajar, in {len(joints)} attempts"
        return _hopeless(why, "fingers that press harder, and no primitive sets their force", cause.kind)
    for earlier in situation.earlier if cause.kind in _KEPT_OUT else ():
        place = stopped_at(_attempts(earlier))
        if place is not None:
            fixture = situation.task.subtasks[earlier.subtask].target
            why = (
                f"the door of {fixture} ends at {place:.2f} of its range however far it is to be opened, which lets no"
            )
            needed = "a free door, and no primitive takes away what nobody knows of"
            return _hopeless(f"{why} hand in", needed, CauseKind.OPENED_LITTLE)
    return None


def _hopeless(why: str, needed: str, cause: CauseKind) -> GiveUp:
    return GiveUp(f"no flow of the library corrects this: {why}; it would take {needed}", cause.value, needed)


def _attempts(history: History) -> list[Attempt]:
    return [attempt for attempt, _ in history.iterations]


def _lost_openings(attempts: Sequence[Attempt]) -> Iterator[RootCause]:
    """Yields the causes of those attempts that failed since a joint did not open as far as it was asked to."""
    for attempt in attempts:
        cause = diagnose(attempt)
        opening = cause is not None and attempt.flow[cause.step].primitive is Primitive.ARTICULATE_OPEN
        if cause is not None and opening and cause.kind in _LOST:
            yield cause


def stopped_at(attempts: Sequence[Attempt]) -> float | None:
    """Returns the fraction of its range at which a door ended in several attempts, ajar; None where it did not."""
    reached = [cause.joint.fraction_reached for cause in _lost_openings(attempts) if cause.joint is not None]
    if len(reached) < TIMES or not all(AJAR[0] <= place <= AJAR[1] for place in reached):
        return None
    return max(reached) if max(reached) - min(reached) <= SAME_PLACE else None


def known_by_now(cause: RootCause, attempts: Sequence[Attempt]) -> RootCause:
    """Returns a cause with what several attempts say of it: where a door ends whatever is asked."""
    stopped = cause.kind in _LOST and stopped_at(attempts) is not None
    return replace(cause, stopped=True) if stopped else cause
