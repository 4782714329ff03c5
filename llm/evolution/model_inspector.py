"""The Inspector behind which a vision-language model stands: it judges each step by pictures, and by measurements.

Source: the paper's Robotic Safety Inspector. That it is given measurements beside the pictures is a departure; without
them it is the paper's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from llm.answers.base import Answer, MaybeStepNumber, Reason, Remark, begins_with_denial
from llm.answers.conversation import INSPECTOR, finding
from llm.answers.describe import primitives_text
from llm.answers.prompting import fenced, render
from llm.errors import RequestError
from llm.evolution.asking import Asking, NoAnswer
from llm.evolution.measured import MeasuredInspector
from llm.evolution.observation import AttemptSeen
from llm.evolution.pictures import Picture, hashes_of, index_of, pictures_of, window
from llm.evolution.telling import critique_text, numbers_text, one_line, steps_text, subtask_text
from oag import Critique, Diagnostic
from oag.revision.grounds import Grounds
from oag.revision.records import Origin

ALL_VIEWS = ("global", "head", "wrist")
LOOK_BACK = 1
MOST_PICTURES = 36


Judgement = Literal["yes", "no", "unclear"]
_MEANINGS: dict[Judgement, bool | None] = {"yes": True, "no": False, "unclear": None}


def _written(value: object) -> object:
    """Returns a judgement in the words of the schema: small letters, yes or no for true or false."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return value.strip().rstrip(".").lower() if isinstance(value, str) else value


class StepCritique(Answer):
    """What was seen of one step.

    Source: the paper's critique m_(tau, j): motion verification, state contrast, anomaly detection, and the observation
    in a sentence or two. The fields stand in the order of thinking: what is there to see before it is judged.

    Attributes:
        step: Number of the step, from 1; None where it is not said, and then it is the one that was asked about.
        state_contrast: What differs between the step's beginning and its end.
        observation: What happened: the diagnosis.
        motion_verified: Whether the robot moved as the primitive means.
        state_reached: Whether the intended change came about.
        anomaly: What happened that should not have; empty for nothing.
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
    """Judges steps by asking a model.

    Attributes:
        asking: Who is asked.
        views: The cameras whose pictures it sees, the paper's C; none: it is told measurements only.
        look_back: How many steps before the judged one it sees as well, the paper's p_1.
        measurements: Whether it is told what was measured.
        most_pictures: Most pictures in a question.

    Raises:
        RequestError: It would be told nothing, a view is unknown, or a number makes no sense.
    """

    asking: Asking
    views: tuple[str, ...] = ALL_VIEWS
    look_back: int = LOOK_BACK
    measurements: bool = True
    most_pictures: int = MOST_PICTURES
    _measured: MeasuredInspector = field(default_factory=MeasuredInspector, init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.views and not self.measurements:
            raise RequestError("an inspector without views and without measurements has nothing to judge by")
        unknown = [view for view in self.views if view not in ALL_VIEWS]
        if unknown:
            raise RequestError(f"there is no view {unknown[0]!r}; the views are {', '.join(ALL_VIEWS)}")
        if self.look_back < 0:
            raise RequestError(f"look_back is 0 or more, not {self.look_back}")
        if self.most_pictures < 1:
            raise RequestError(f"most_pictures is at least 1, not {self.most_pictures}")

    def inspect(self, seen: AttemptSeen, step: int) -> Critique:
        """Returns the critique of one step.

        A model that gives no usable answer leaves the measured critique, where measurements are used, and else one
        that judges nothing; both say why.

        Raises:
            PicturesMissing: There are views, and nothing can draw them.
            ModelError: What only the caller can mend (`Asking.ask`).
        """
        if self.asking.stopped:
            return self._unjudged(seen, step, self.asking.stopped)
        measured = self._measured.inspect(seen, step) if self.measurements else None
        shown = window(step, self.look_back)
        pictures = pictures_of(seen, shown, self.views, self.most_pictures)
        told = ""
        if measured is not None:
            lines = f"{critique_text(measured)}\n{numbers_text(measured.evidence)}".rstrip()
            head = "What was measured of the step (m, rad, s as the names say; it is exact)"
            told = f"{head}:\n{fenced('measured', lines)}\n"
        text = render(
            "evolution/inspector",
            subtask=fenced("subtask", subtask_text(seen)),
            step=str(step + 1),
            flow=fenced("flow", steps_text(seen.steps, shown, numbers_run=self.measurements)),
            primitive=primitives_text(seen.steps[step].asked.primitive),
            measurements=told,
            pictures=index_of(pictures),
        )
        images = [picture.image for picture in pictures]
        answer = self.asking.ask(INSPECTOR, text, StepCritique, lambda given: _wrong(given, step, measured), images)
        if isinstance(answer, NoAnswer):
            return self._unjudged(seen, step, answer.reason)
        return _critique(answer, seen, step, measured, pictures)

    def _unjudged(self, seen: AttemptSeen, step: int, reason: str) -> Critique:
        if not self.measurements:
            primitive = seen.steps[step].asked.primitive
            return Critique(step, primitive, text=f"The model did not judge this step: {reason}", origin="model")
        measured = self._measured.inspect(seen, step)
        return replace(measured, evidence=replace(measured.evidence, model_did_not_judge=reason))


def _critique(
    answer: StepCritique, seen: AttemptSeen, step: int, measured: Critique | None, pictures: Sequence[Picture]
) -> Critique:
    evidence = Grounds(pictures=tuple(hashes_of(pictures)))
    if measured is not None:
        said = {
            "motion_verified": measured.motion_verified,
            "state_reached": measured.state_reached,
            "anomaly": measured.anomaly,
            "text": measured.text,
        }
        evidence = replace(measured.evidence, measured=said, pictures=evidence.pictures)
    # With nothing to look at, the model has judged measurements.
    origin: Origin = "model" if measured is None else "both"
    return Critique(
        step=step,
        primitive=seen.steps[step].asked.primitive,
        motion_verified=_MEANINGS[answer.motion_verified],
        state_reached=_MEANINGS[answer.state_reached],
        state_contrast=answer.state_contrast,
        anomaly=answer.anomaly or None,
        text=answer.observation,
        evidence=evidence,
        origin=origin,
    )


def _wrong(answer: StepCritique, step: int, measured: Critique | None) -> Iterator[Diagnostic]:
    """Yields an answer about another step; and, to be asked about once, what is doubtful or was measured otherwise."""
    if answer.step not in (None, step + 1):
        yield finding("answer/step", f"step {step + 1} is to be judged, and the answer is about {answer.step}", "step")
    if begins_with_denial(answer.anomaly):
        hint = "leave it empty if nothing happened that should not have; otherwise give the same answer again"
        message = f"an anomaly is named that reads like none: {one_line(answer.anomaly, 120)}"
        yield finding("answer/contradictory", message, "anomaly", hint=hint, severity="warning")
    if measured is None:
        return
    said = Critique(
        step,
        measured.primitive,
        _MEANINGS[answer.motion_verified],
        _MEANINGS[answer.state_reached],
        anomaly=answer.anomaly or None,
    )
    if measured.finds_fault and not said.finds_fault:
        message = f"the answer finds no fault, and it was measured that {measured.text}"
        yield _doubt(message, "motion_verified" if measured.motion_verified is False else "state_reached")
    if measured.state_reached is True and said.state_reached is False:
        yield _doubt("the state was measured to be reached, and the answer says that it was not", "state_reached")


def _doubt(message: str, place: str) -> Diagnostic:
    hint = "measurements are exact; a picture may hide what they show, or the other way round"
    return finding("answer/against-measurement", message, place, hint=hint, severity="warning")
