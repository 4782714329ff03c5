"""The supervisor that needs no model: it searches the admissible revisions that the measured cause calls for."""

from __future__ import annotations

import math

from llm.evolution.beyond import beyond, known_by_now
from llm.evolution.cause import CauseKind, RootCause, diagnose
from llm.evolution.corrections.by_cause import corrections
from llm.evolution.hindsight import earlier_causes
from llm.evolution.observation import GiveUp, Situation
from oag import ActionFlow, Attempt, Hindsight, History, Revision, admissible, change_between

_OF_NUMBERS = frozenset(
    {CauseKind.BLOCKED, CauseKind.MISPLACED, CauseKind.OUT_OF_REACH, CauseKind.JOINT_SHORT, CauseKind.IN_THE_WAY}
)


class SearchSupervisor:
    """Goes on from the attempt that came furthest, and takes its first correction that was not tried yet.

    An attempt came further than another when fewer of its steps were left, and among equals when its items were
    nearer to their places. So a correction that made things worse is not built upon. Where measurements of an earlier
    subtask say that the cause lies there, it goes back to that subtask; without such evidence only when nothing is
    left to try in this one. Nothing is drawn by chance.
    """

    def revise(self, situation: Situation) -> Revision | GiveUp:
        """Returns the first admissible correction, or why there is none."""
        if (hopeless := beyond(situation)) is not None:
            return hopeless
        causes: list[str] = []
        for evident in (True, None, False):
            found = _here(situation, causes) if evident is None else _before(situation, evident, causes)
            if found is not None:
                return found
        if not causes:
            return GiveUp("no step of any attempt was found at fault, so there is nothing to correct")
        known = ", ".join(dict.fromkeys(causes))
        reason = f"no admissible correction for what was measured ({known}) is left to be tried; the last attempt: "
        return GiveUp(reason + situation.attempt.message, causes[0])


def _here(situation: Situation, causes: list[str]) -> Revision | None:
    tried = situation.history.add(situation.attempt)
    # What was run from another start says nothing here.
    attempts = [a for a, _ in tried.iterations if a.start == situation.attempt.start]
    # The latest of equals first: it carries the corrections made so far.
    ordered = sorted(enumerate(attempts), key=lambda entry: (_left_undone(entry[1]), -entry[0]))
    for number, attempt in ordered:
        cause = diagnose(attempt)
        if cause is None:
            continue
        causes.append(cause.kind.value)
        cause = known_by_now(cause, attempts)
        for flow, words in corrections(cause, _numbers_run(attempt, cause)):
            if _may_run(situation, situation.subtask, flow, tried):
                return Revision(
                    flow=flow,
                    change=change_between(situation.attempt.flow, flow),
                    explanation=_explanation(cause, words, attempt, number, len(attempts)),
                    cause=cause.kind.value,
                    cause_step=cause.step,
                )
    return None


def _before(situation: Situation, evident: bool, causes: list[str]) -> Revision | None:
    cause = diagnose(situation.attempt)
    if cause is None:
        return None
    for found in earlier_causes(situation.task, situation.subtask, situation.attempt, cause, situation.earlier):
        history = situation.earlier[found.subtask]
        if found.evident is not evident or history.exhausted:
            continue
        causes.append(found.cause.kind.value)
        failed = situation.attempt
        blamed, before = history.reopened(Hindsight(situation.subtask, failed.failure, failed.message))
        tried = before.add(blamed)
        for flow, words in corrections(found.cause, _numbers_run(blamed, found.cause)):
            if _may_run(situation, found.subtask, flow, tried):
                step = f"step {found.cause.step + 1} of T{found.subtask + 1}, {blamed.flow[found.cause.step]}"
                why = f"{found.cause.kind.value}{_numbers(found.cause)}. It shows only now: {failed.message}"
                return Revision(
                    flow=flow,
                    change=change_between(blamed.flow, flow),
                    explanation=f"Root cause at {step}: {why}. Therefore {words}.",
                    cause=found.cause.kind.value,
                    cause_step=found.cause.step,
                    subtask=found.subtask,
                )
    return None


def _may_run(situation: Situation, subtask: int, flow: ActionFlow, tried: History) -> bool:
    admission = admissible(situation.task, subtask, flow, scene=situation.scene, history=tried)
    return bool(admission and admission.report)


def _numbers(cause: RootCause) -> str:
    grip, joint = cause.grip, cause.joint
    numbers = {} if grip is None else {"held_off_m": grip.held_off_m, "grip_force_n": grip.grip_force_n}
    numbers |= {} if joint is None else {"fraction_reached": joint.fraction_reached}
    shown = [f"{name} {number:.3g}" for name, number in numbers.items() if number is not None]
    return f" ({', '.join(shown)})" if shown else ""


def _left_undone(attempt: Attempt) -> tuple[int, float]:
    """Returns how much an attempt left undone: steps, then metres or fractions of a range."""
    steps = 0 if attempt.failed_step is None else len(attempt.flow) - attempt.failed_step
    cause = diagnose(attempt)
    if cause is None:
        return steps, math.inf
    if cause.kind is CauseKind.NOWHERE:
        # From a nominal place the moves after it lead nowhere, however many of them ran.
        steps = len(attempt.flow) - cause.step
    missed = max((miss.distance_m for miss in cause.misses), default=math.inf)
    return steps, min(missed, cause.open_fraction or math.inf)


def _numbers_run(attempt: Attempt, cause: RootCause) -> ActionFlow:
    return attempt.filled if attempt.filled is not None and cause.kind in _OF_NUMBERS else attempt.flow


def _explanation(cause: RootCause, words: str, attempt: Attempt, number: int, count: int) -> str:
    step = f"step {cause.step + 1}, {attempt.flow[cause.step].primitive.name}"
    back = "" if number == count - 1 else f" (in attempt {number + 1}, which came furthest)"
    ended = "" if attempt.failed_step in (None, cause.step) else f" In the end {attempt.message}."
    return f"Root cause at {step}{back}: {cause.kind.value}. {cause.words}{ended} Therefore {words}."
