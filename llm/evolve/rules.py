"""Inspector and Supervisor without a model: critiques from measurements, and a search over admissible corrections."""

from __future__ import annotations

import math

from llm.evolve.corrections import corrections
from llm.evolve.diagnosis import CauseKind, FailureCause, diagnose, earlier_causes, find_unfixable, mark_stopped
from llm.evolve.observation import AttemptObservation, GiveUp, Situation, StepObservation
from oag import Primitive
from oag.measurements import GoalReading, GripMeasured, MeasuredEvidence, SupportDrive, Unmet, first_of
from oag.model.actions import ActionFlow
from oag.model.symbols import ARTICULATIONS
from oag.revision import Attempt, Critique, Hindsight, History, Revision, admissible, change_between

# Kinds of failure with an unintended event, not only a missing intended one.
_ANOMALIES = frozenset({"unexpected-contact", "side-effect", "slipped", "dropped"})
GOAL_NOT_REACHED = "goal-not-reached"


class MeasuredInspector:
    """Motion verification, state contrast and anomaly detection from residuals, contacts and conditions."""

    def inspect(self, attempt: AttemptObservation, step: int) -> Critique:
        """Return the critique of one step; every statement in it was measured."""
        looked_at = attempt.steps[step]
        # A goal not reached in the end is no step's own failure: the step that had to achieve it is judged.
        own_failure = looked_at.failure if looked_at.failure != GOAL_NOT_REACHED else ""
        anomaly = looked_at.message if own_failure in _ANOMALIES else None
        due = _due(attempt, step)
        reached = None if not due else all(condition.satisfied for condition in due)
        grip = first_of(looked_at.measurements, GripMeasured)
        missed = looked_at.asked.primitive is Primitive.GRASP and grip is not None and grip.fingers_touching in (0, 1)
        if own_failure == "" and reached is None and (missed or _leads_nowhere(looked_at)):
            reached = False
        return Critique(
            step=step,
            primitive=looked_at.asked.primitive,
            motion_verified=own_failure == "" or own_failure in ("side-effect", "grasp-missed"),
            state_reached=False if own_failure == "grasp-missed" else reached,
            state_contrast=_contrast(looked_at, due),
            anomaly=anomaly,
            text=_text(looked_at, own_failure, due),
            evidence=_evidence(looked_at, own_failure, due),
        )


def _due(attempt: AttemptObservation, step: int) -> tuple[GoalReading, ...]:
    """Return the goal's conditions that a step had to achieve, as measured.

    An articulation achieves its fixture's `open`, a release everything that the goal states about the item's place,
    each at the last step of its kind. What still does not hold in the end is due at the last step of the flow.
    """
    looked_at = attempt.steps[step]
    primitive = looked_at.asked.primitive
    later = [other.asked.primitive for other in attempt.steps[step + 1 :]]
    if primitive in ARTICULATIONS and primitive not in later:
        return tuple(condition for condition in looked_at.after if condition.predicate == "open")
    finished = len(attempt.steps) == len(attempt.flow)
    if primitive is Primitive.UNGRASP and primitive not in later and finished:
        return tuple(condition for condition in attempt.goal if condition.predicate != "open")
    if finished and not later and looked_at.failure == GOAL_NOT_REACHED:
        return attempt.unmet
    return ()


def _leads_nowhere(step: StepObservation) -> bool:
    """Decide whether a navigation ended at a nominal place: from nowhere do the moves after it end at a free spot."""
    drive = first_of(step.measurements, SupportDrive)
    return drive is not None and drive.nominal


def _contrast(step: StepObservation, due: tuple[GoalReading, ...]) -> str:
    changed = [
        f"{now.literal} became {'true' if now.value else 'false'}"
        for was, now in zip(step.before, step.after, strict=False)
        if was.value != now.value
    ]
    lacking = [
        f"{condition} does not hold{_condition_numbers(condition)}" for condition in due if not condition.satisfied
    ]
    return "; ".join([*changed, *lacking]) or "nothing that the goal asks about changed"


def _condition_numbers(condition: GoalReading) -> str:
    shown = [
        f"{key} {value:.3g}"
        for key, value in condition.measurements.to_json().items()
        if isinstance(value, float | int) and not isinstance(value, bool)
    ]
    return f" ({', '.join(shown)})" if shown else ""


def _text(step: StepObservation, own_failure: str, due: tuple[GoalReading, ...]) -> str:
    if own_failure:
        return f"{step.done} failed: {step.message}."
    lacking = [str(condition) for condition in due if not condition.satisfied]
    if _leads_nowhere(step):
        return f"{step.done} stopped at a nominal place: with these numbers the moves after it lead to no free spot."
    if lacking:
        return f"{step.done} ran as asked, but {' and '.join(lacking)} does not hold after it."
    return f"{step.done} ran as asked."


def _evidence(step: StepObservation, own_failure: str, due: tuple[GoalReading, ...]) -> MeasuredEvidence:
    unmet = tuple(Unmet(str(condition), condition.measurements) for condition in due if not condition.satisfied)
    # A release lets the item fall; the relevant miss is the one before it.
    misses = step.misses_before if step.asked.primitive is Primitive.UNGRASP else step.misses_after
    return MeasuredEvidence(
        measurements=step.measurements,
        failure=own_failure,
        failure_measurements=step.failure_measurements if own_failure else (),
        unmet=unmet,
        misses=misses if own_failure or unmet else (),
    )


_OF_NUMBERS = frozenset(
    {CauseKind.BLOCKED, CauseKind.MISPLACED, CauseKind.OUT_OF_REACH, CauseKind.JOINT_SHORT, CauseKind.IN_THE_WAY}
)


class SearchSupervisor:
    """Continue from the best attempt with its first correction that was not tried yet.

    An attempt is better if fewer of its steps were left, and among equals if its items were nearer to their places.
    So a correction that made things worse is not continued. If measurements of an earlier subtask show that the
    cause is there, it returns to that subtask; without such evidence only when nothing is left to try in this one.
    Nothing is random.
    """

    def revise(self, situation: Situation) -> Revision | GiveUp:
        """Return the first admissible correction, or why there is none."""
        if (hopeless := find_unfixable(situation)) is not None:
            return hopeless
        causes: list[str] = []
        for evident in (True, None, False):
            found = _revise_here(situation, causes) if evident is None else _revise_earlier(situation, evident, causes)
            if found is not None:
                return found
        if not causes:
            return GiveUp("no step of any attempt was found at fault, so there is nothing to correct")
        known = ", ".join(dict.fromkeys(causes))
        reason = f"no admissible correction for what was measured ({known}) is left to be tried; the last attempt: "
        return GiveUp(reason + situation.attempt.message, causes[0])


def _revise_here(situation: Situation, causes: list[str]) -> Revision | None:
    tried = situation.history.add(situation.attempt)
    # Attempts from another start are not comparable.
    attempts = [a for a, _ in tried.iterations if a.start == situation.attempt.start]
    # Of equals the latest first: it includes the corrections made so far.
    ordered = sorted(enumerate(attempts), key=lambda entry: (_remaining(entry[1]), -entry[0]))
    for number, attempt in ordered:
        cause = diagnose(attempt)
        if cause is None:
            continue
        causes.append(cause.kind.value)
        cause = mark_stopped(cause, attempts)
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


def _revise_earlier(situation: Situation, evident: bool, causes: list[str]) -> Revision | None:
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
                why = f"{found.cause.kind.value}{_cause_numbers(found.cause)}. It shows only now: {failed.message}"
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


def _cause_numbers(cause: FailureCause) -> str:
    grip, joint = cause.grip, cause.joint
    numbers = {} if grip is None else {"held_off_m": grip.held_off_m, "grip_force_n": grip.grip_force_n}
    numbers |= {} if joint is None else {"fraction_reached": joint.fraction_reached}
    shown = [f"{name} {number:.3g}" for name, number in numbers.items() if number is not None]
    return f" ({', '.join(shown)})" if shown else ""


def _remaining(attempt: Attempt) -> tuple[int, float]:
    """Return what an attempt left: steps, then distance [m] or fraction of a range."""
    steps = 0 if attempt.failed_step is None else len(attempt.flow) - attempt.failed_step
    cause = diagnose(attempt)
    if cause is None:
        return steps, math.inf
    if cause.kind is CauseKind.NOWHERE:
        # From a nominal place the moves lead nowhere, however many of them ran.
        steps = len(attempt.flow) - cause.step
    missed = max((miss.distance_m for miss in cause.misses), default=math.inf)
    return steps, min(missed, cause.open_fraction or math.inf)


def _numbers_run(attempt: Attempt, cause: FailureCause) -> ActionFlow:
    return attempt.filled if attempt.filled is not None and cause.kind in _OF_NUMBERS else attempt.flow


def _explanation(cause: FailureCause, words: str, attempt: Attempt, number: int, count: int) -> str:
    step = f"step {cause.step + 1}, {attempt.flow[cause.step].primitive.name}"
    back = "" if number == count - 1 else f" (in attempt {number + 1}, which came furthest)"
    ended = "" if attempt.failed_step in (None, cause.step) else f" In the end {attempt.message}."
    return f"Root cause at {step}{back}: {cause.kind.value}. {cause.words}{ended} Therefore {words}."
