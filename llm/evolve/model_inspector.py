"""Inspector that asks a vision-language model to judge the steps of an attempt.

Source: the paper's Robotic Safety Inspector.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from llm.errors import RequestError
from llm.evolve.judge_session import ALL_VIEWS, JudgeSession
from llm.evolve.observation import (
    AttemptObservation,
    Picture,
    captioned,
    numbers_text,
    one_line,
    picture_text,
    select_pictures,
    steps_text,
    subtask_text,
    window,
)
from llm.evolve.rules import MeasuredInspector
from llm.structured.conversation import (
    INSPECTOR,
    finding,
)
from llm.structured.prompting import fenced, primitives_text, render
from llm.structured.schema import (
    Answer,
    MaybeStepNumber,
    Reason,
    Remark,
    begins_with_denial,
)
from oag import Diagnostic, Primitive
from oag.measurements import MeasuredEvidence
from oag.model.domain import own_of
from oag.model.symbols import ARTICULATIONS
from oag.revision import Critique, Origin

LOOK_BACK = 1
MOST_INSPECTED = 36


Judgement = Literal["yes", "no", "unclear"]
_CHANGES_OBJECTS = frozenset({Primitive.GRASP, Primitive.UNGRASP, *ARTICULATIONS})
_MEANINGS: dict[Judgement, bool | None] = {"yes": True, "no": False, "unclear": None}


def _written(value: object) -> object:
    """Normalise a judgement to the words of the schema: lower case, yes or no for true or false."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    word = value.strip().rstrip(".").lower() if isinstance(value, str) else value
    return {"true": "yes", "false": "no"}.get(word, word) if isinstance(word, str) else word


class StepCritique(Answer):
    """A model's critique of one step.

    Source: the paper's critique m_(tau, j): motion verification, state contrast, anomaly detection, and the
    observation in a sentence or two. The fields are in the order of reasoning: observation before judgement. Without a
    number the step in question is meant.
    """

    step: MaybeStepNumber = Field(default=None, description="number of the judged step")
    state_contrast: Remark = Field(default="", description="what differs between the step's beginning and its end")
    observation: Reason = Field(description="what happened, in one or two sentences")
    motion_verified: Annotated[Judgement, BeforeValidator(_written)] = Field(
        description="yes, no or unclear: the robot moved as the primitive means"
    )
    state_reached: Annotated[Judgement, BeforeValidator(_written)] = Field(
        description="yes, no or unclear: the intended change came about"
    )
    anomaly: Remark = Field(default="", description="what happened that should not have; empty if nothing did")


@dataclass(slots=True)
class ModelInspector:
    """Judge steps by asking a model.

    That it is given measurements in addition to pictures is a departure; without them it is the paper's Inspector.

    Attributes:
        session: Session with the model.
        views: Cameras whose pictures are sent, the paper's C; none for measurements only.
        look_back: Number of steps before the judged one that are sent too, the paper's p_1.
        measurements: Whether measurements are sent.
        most_pictures: Most pictures in a question.
        only_faulty: Whether only steps are asked about whose measurements find a fault, or leave open what they did
            to an object; the critiques of the others are the measured ones.

    Raises:
        RequestError: Neither views nor measurements, an unknown view, or an invalid number.
    """

    session: JudgeSession
    views: tuple[str, ...] = ALL_VIEWS
    look_back: int = LOOK_BACK
    measurements: bool = True
    most_pictures: int = MOST_INSPECTED
    only_faulty: bool = False
    _measured: MeasuredInspector = field(default_factory=MeasuredInspector, init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.views and not self.measurements:
            raise RequestError("an inspector without views and without measurements has nothing to judge by")
        if self.only_faulty and not self.measurements:
            raise RequestError("without measurements nothing tells which steps are faulty, so that all are asked about")
        unknown = [view for view in self.views if view not in ALL_VIEWS]
        if unknown:
            raise RequestError(f"there is no view {unknown[0]!r}; the views are {', '.join(ALL_VIEWS)}")
        if self.look_back < 0:
            raise RequestError(f"look_back is 0 or more, not {self.look_back}")
        if self.most_pictures < 1:
            raise RequestError(f"most_pictures is at least 1, not {self.most_pictures}")

    def inspect(self, attempt: AttemptObservation, step: int) -> Critique:
        """Return the critique of one step.

        If the model gives no usable answer, the result is the measured critique where measurements are used, else
        one without judgements. Both state the reason.

        Raises:
            PicturesMissing: There are views, and nothing can render them.
            ModelError: Failures that only the caller can fix (`JudgeSession.ask`).
        """
        if self.session.stopped:
            return self._unjudged(attempt, step, self.session.stopped)
        measured = self._measured.inspect(attempt, step) if self.measurements else None
        if self.only_faulty and measured is not None and not (measured.finds_fault or _is_uncertain(measured)):
            return measured
        shown = window(step, self.look_back)
        pictures = select_pictures(attempt, shown, self.views, self.most_pictures)
        section = ""
        if measured is not None:
            # Readings and the recorded failure are evidence; the judgement of the step is the model's own.
            lines = f"the goal's conditions: {measured.state_contrast}\n{numbers_text(measured.evidence)}".rstrip()
            head = "What was measured of the step (m, rad, s as the names say; it is exact)"
            section = f"{head}:\n{fenced('measured', lines)}\n"
        text = render(
            "evolve/inspector",
            subtask=fenced("subtask", subtask_text(attempt)),
            step=str(step + 1),
            flow=fenced("flow", steps_text(attempt.steps, shown, numbers_run=self.measurements)),
            primitive=primitives_text(attempt.steps[step].asked.primitive),
            measurements=section,
            pictures=picture_text(pictures),
        )
        answer = self.session.ask(
            INSPECTOR, text, StepCritique, lambda given: _critique_findings(given, step, measured), captioned(pictures)
        )
        if isinstance(answer, str):
            return self._unjudged(attempt, step, answer)
        return _critique(answer, attempt, step, measured, pictures)

    def _unjudged(self, attempt: AttemptObservation, step: int, reason: str) -> Critique:
        if not self.measurements:
            primitive = attempt.steps[step].asked.primitive
            return Critique(step, primitive, text=f"The model did not judge this step: {reason}", origin="model")
        measured = self._measured.inspect(attempt, step)
        return replace(measured, evidence=replace(measured.evidence, model_did_not_judge=reason))


def _is_uncertain(measured: Critique) -> bool:
    """Decide whether a step is there to change an object, and nothing was measured of the change."""
    changes = measured.primitive in _CHANGES_OBJECTS or own_of(measured.primitive) is not None
    return measured.state_reached is None and changes


def _critique(
    answer: StepCritique, attempt: AttemptObservation, step: int, measured: Critique | None, pictures: Sequence[Picture]
) -> Critique:
    shown = ({"step": shot.step, "view": shot.view, "sha256": shot.image.sha256} for shot in pictures)
    evidence = MeasuredEvidence(pictures=tuple(shown))
    if measured is not None:
        measured_values = {
            "motion_verified": measured.motion_verified,
            "state_reached": measured.state_reached,
            "anomaly": measured.anomaly,
            "text": measured.text,
        }
        evidence = replace(measured.evidence, measured=measured_values, pictures=evidence.pictures)
    # Without pictures, the model has judged measurements.
    origin: Origin = "model" if measured is None else "both"
    return Critique(
        step=step,
        primitive=attempt.steps[step].asked.primitive,
        motion_verified=_MEANINGS[answer.motion_verified],
        state_reached=_MEANINGS[answer.state_reached],
        state_contrast=answer.state_contrast,
        anomaly=answer.anomaly or None,
        text=answer.observation,
        evidence=evidence,
        origin=origin,
    )


def _critique_findings(answer: StepCritique, step: int, measured: Critique | None) -> Iterator[Diagnostic]:
    if answer.step not in (None, step + 1):
        yield finding("answer/step", f"step {step + 1} is to be judged, and the answer is about {answer.step}", "step")
    if begins_with_denial(answer.anomaly):
        hint = "leave it empty if nothing happened that should not have; otherwise give the same answer again"
        message = f"an anomaly is named that reads like none: {one_line(answer.anomaly, 120)}"
        yield finding("answer/contradictory", message, "anomaly", hint=hint, severity="warning")
    if measured is None:
        return
    answered = Critique(
        step,
        measured.primitive,
        _MEANINGS[answer.motion_verified],
        _MEANINGS[answer.state_reached],
        anomaly=answer.anomaly or None,
    )
    if measured.finds_fault and not answered.finds_fault:
        message = f"the answer finds no fault, and it was measured that {measured.text}"
        yield _doubt(message, "motion_verified" if measured.motion_verified is False else "state_reached")
    if measured.state_reached is True and answered.state_reached is False:
        yield _doubt("the state was measured to be reached, and the answer says that it was not", "state_reached")


def _doubt(message: str, place: str) -> Diagnostic:
    hint = "measurements are exact; a picture may hide what they show, or the other way round"
    return finding("answer/against-measurement", message, place, hint=hint, severity="warning")
