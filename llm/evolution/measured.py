"""The inspector that needs no model: it judges a step by what was measured while it ran."""

from __future__ import annotations

from llm.evolution.observation import AttemptSeen, StepSeen
from oag import Critique, Primitive
from oag.model.primitives import ARTICULATIONS
from oag.revision.grounds import GoalReading, Grounds, Unmet
from oag.revision.measurements import GripMeasured, SupportDrive, first_of

# Kinds of failure that say something happened which should not have, not only that the wanted thing did not.
_ANOMALIES = frozenset({"unexpected-contact", "side-effect", "slipped", "dropped"})
GOAL_NOT_REACHED = "goal-not-reached"


class MeasuredInspector:
    """Motion verification, state contrast and anomaly detection from residuals, contacts and conditions."""

    def inspect(self, seen: AttemptSeen, step: int) -> Critique:
        """Returns the critique of one step; every statement in it was measured."""
        looked_at = seen.steps[step]
        # A goal that is not reached in the end is no step's own failure: the step that was to bring it is judged.
        own_failure = looked_at.failure if looked_at.failure != GOAL_NOT_REACHED else ""
        anomaly = looked_at.message if own_failure in _ANOMALIES else None
        due = _due(seen, step)
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


def _due(seen: AttemptSeen, step: int) -> tuple[GoalReading, ...]:
    """Returns the conditions of the goal that a step had to bring about, as they were read.

    An articulation brings its fixture's `open`, a release everything that the goal says of where the item is, each at
    the last step of its kind; what still does not hold in the end is due at the last step of the flow.
    """
    looked_at = seen.steps[step]
    primitive = looked_at.asked.primitive
    later = [other.asked.primitive for other in seen.steps[step + 1 :]]
    if primitive in ARTICULATIONS and primitive not in later:
        return tuple(condition for condition in looked_at.after if condition.predicate == "open")
    finished = len(seen.steps) == len(seen.flow)
    if primitive is Primitive.UNGRASP and primitive not in later and finished:
        return tuple(condition for condition in seen.goal if condition.predicate != "open")
    if finished and not later and looked_at.failure == GOAL_NOT_REACHED:
        return seen.unmet
    return ()


def _leads_nowhere(step: StepSeen) -> bool:
    """Decides whether a navigation stands at a nominal place: the moves after it end at no free spot from anywhere."""
    drive = first_of(step.measurements, SupportDrive)
    return drive is not None and drive.nominal


def _contrast(step: StepSeen, due: tuple[GoalReading, ...]) -> str:
    changed = [
        f"{now.literal} became {'true' if now.value else 'false'}"
        for was, now in zip(step.before, step.after, strict=False)
        if was.value != now.value
    ]
    lacking = [f"{condition} does not hold{_numbers(condition)}" for condition in due if not condition.satisfied]
    return "; ".join([*changed, *lacking]) or "nothing that the goal asks about changed"


def _numbers(condition: GoalReading) -> str:
    shown = [
        f"{key} {value:.3g}"
        for key, value in condition.measurements.to_json().items()
        if isinstance(value, float | int) and not isinstance(value, bool)
    ]
    return f" ({', '.join(shown)})" if shown else ""


def _text(step: StepSeen, own_failure: str, due: tuple[GoalReading, ...]) -> str:
    if own_failure:
        return f"{step.done} failed: {step.message}."
    lacking = [str(condition) for condition in due if not condition.satisfied]
    if _leads_nowhere(step):
        return f"{step.done} stopped at a nominal place: with these numbers the moves after it lead to no free spot."
    if lacking:
        return f"{step.done} ran as asked, but {' and '.join(lacking)} does not hold after it."
    return f"{step.done} ran as asked."


def _evidence(step: StepSeen, own_failure: str, due: tuple[GoalReading, ...]) -> Grounds:
    unmet = tuple(Unmet(str(condition), condition.measurements) for condition in due if not condition.satisfied)
    # A release lets the item fall; where it missed to is where it was before.
    misses = step.misses_before if step.asked.primitive is Primitive.UNGRASP else step.misses_after
    return Grounds(
        measurements=step.measurements,
        failure=own_failure,
        failure_measurements=step.failure_measurements if own_failure else (),
        unmet=unmet,
        misses=misses if own_failure or unmet else (),
    )
