"""What no flow corrects: said as soon as it is measured, with what it would take instead.

The library's primitives move hand and base and set joint limits. None of them measures a thing anew, presses harder,
or takes something away that nobody knows of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from llm.evolution.cause import CauseKind, diagnose
from llm.evolution.observation import Situation
from llm.evolution.pulling import UNMOVED, followed
from llm.evolution.stops import LOST, TIMES, lost_openings, stopped_at
from oag import Attempt, History
from oag.model.primitives import ARTICULATIONS

_KEPT_OUT = frozenset({CauseKind.NO_WAY, CauseKind.NOWHERE, CauseKind.OUT_OF_REACH, CauseKind.BLOCKED})


@dataclass(frozen=True, slots=True)
class Beyond:
    """Why no flow helps.

    Attributes:
        why: What was measured, as a sentence without its full stop.
        needed: What it would take, as half a sentence.
        cause: The root cause in a few words.
    """

    why: str
    needed: str
    cause: str


def beyond(situation: Situation) -> Beyond | None:
    """Returns why no flow of the library corrects a failure; None as long as that is not evident."""
    cause = diagnose(situation.attempt)
    if cause is None:
        return None
    target = situation.task.subtasks[situation.subtask].target
    if cause.kind is CauseKind.TOO_WIDE:
        needed = "a narrower thing, or its size measured anew, and no primitive does either"
        return Beyond(situation.attempt.message, needed, cause.kind.value)
    tried = _attempts(situation.history.add(situation.attempt))
    if cause.kind in LOST and situation.attempt.flow[cause.step].primitive in ARTICULATIONS:
        if _unmoved(tried):
            return Beyond(
                f"the fingers slid off {target} before its joint had moved, in {TIMES} attempts, the last one of them "
                "in the shortest steps",
                "fingers that press harder, and no primitive sets their force",
                cause.kind.value,
            )
        return None
    if cause.kind in _KEPT_OUT:
        for earlier in situation.earlier:
            fixture = situation.task.subtasks[earlier.subtask].target
            if (place := stopped_at(_attempts(earlier))) is not None:
                return Beyond(
                    f"the door of {fixture} ends at {place:.2f} of its range however far it is to be opened, which "
                    "lets no hand in",
                    "a free door, and no primitive takes away what nobody knows of",
                    CauseKind.OPENED_LITTLE.value,
                )
    return None


def _attempts(history: History) -> list[Attempt]:
    return [attempt for attempt, _ in history.iterations]


def _unmoved(attempts: Sequence[Attempt]) -> bool:
    moved = [followed(cause) for cause in lost_openings(attempts)]
    return len(moved) >= TIMES and all(way is not None and way < UNMOVED for way in moved)
