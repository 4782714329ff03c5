"""The supervisor that needs no model: it searches the admissible revisions that the measured cause calls for."""

from __future__ import annotations

import math

from llm.evolution.cause import Cause, CauseKind, diagnose
from llm.evolution.corrections import corrections
from llm.evolution.supervisor import GiveUp, Situation
from oag import ActionFlow, Attempt, Revision, admissible, change_between

_OF_NUMBERS = frozenset({CauseKind.BLOCKED, CauseKind.MISPLACED, CauseKind.OUT_OF_REACH, CauseKind.JOINT_SHORT})


class SearchSupervisor:
    """Goes on from the attempt that came furthest, and takes its first correction that was not tried yet.

    An attempt came further than another when fewer of its steps were left, and among equals when its items were
    nearer to their places. So a correction that made things worse is not built upon. Nothing is drawn by chance.
    """

    def revise(self, situation: Situation) -> Revision | GiveUp:
        """Returns the first admissible correction, or why there is none."""
        tried = situation.history.add(situation.attempt)
        attempts = [iteration.attempt for iteration in tried.iterations]
        # The latest of equals first: it carries the corrections made so far.
        ordered = sorted(enumerate(attempts), key=lambda entry: (_left_undone(entry[1]), -entry[0]))
        causes: list[str] = []
        for number, attempt in ordered:
            cause = diagnose(attempt)
            if cause is None:
                continue
            causes.append(cause.kind.value)
            for correction in corrections(cause, _numbers_run(attempt, cause)):
                admission = admissible(
                    situation.task, situation.subtask, correction.flow, scene=situation.scene, history=tried
                )
                if not (admission and admission.report):
                    continue
                return Revision(
                    flow=correction.flow,
                    change=change_between(situation.attempt.flow, correction.flow),
                    explanation=_explanation(cause, correction.words, attempt, number, len(attempts)),
                    cause=cause.kind.value,
                    cause_step=cause.step,
                )
        if not causes:
            return GiveUp("no step of any attempt was found at fault, so there is nothing to correct")
        known = ", ".join(dict.fromkeys(causes))
        reason = f"no admissible correction for what was measured ({known}) is left to be tried; the last attempt: "
        return GiveUp(reason + situation.attempt.message, causes[0])


def _left_undone(attempt: Attempt) -> tuple[int, float]:
    """Returns how much an attempt left undone: steps, then metres or fractions of a range."""
    steps = 0 if attempt.failed_step is None else len(attempt.flow) - attempt.failed_step
    cause = diagnose(attempt)
    if cause is None:
        return steps, math.inf
    missed = max((miss.distance_m for miss in cause.misses), default=math.inf)
    return steps, min(missed, cause.number("open_fraction") or math.inf)


def _numbers_run(attempt: Attempt, cause: Cause) -> ActionFlow:
    """Returns the flow to correct: with the numbers that were run where the correction is one of numbers."""
    return attempt.filled if attempt.filled is not None and cause.kind in _OF_NUMBERS else attempt.flow


def _explanation(cause: Cause, words: str, attempt: Attempt, number: int, count: int) -> str:
    step = f"step {cause.step + 1}, {attempt.flow[cause.step].primitive.name}"
    back = "" if number == count - 1 else f" (in attempt {number + 1}, which came furthest)"
    ended = "" if attempt.failed_step in (None, cause.step) else f" In the end {attempt.message}."
    return f"Root cause at {step}{back}: {cause.kind.value}. {cause.words}{ended} Therefore {words}."
