"""Inspector and Supervisor that ask a vision-language model, and the session with the model that both share.

    team = judges("openai:gpt-5.2", task="put the glass away")
    executor.evolve(graph, scene, inspector=team.inspector, supervisor=team.supervisor)
    team.conversation.to_json()

Source: the paper's Robotic Safety Inspector and Robotic Task Supervisor.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Literal, TypeVar

from pydantic import BeforeValidator, Field, ValidationError

from llm.client.recording import connect
from llm.client.transport import Image, Transport
from llm.errors import CassetteError, ModelCancelled, ModelConfigError, ModelError, RequestError
from llm.evolve.observation import (
    AttemptObservation,
    GiveUp,
    Picture,
    Situation,
    critique_text,
    flow_text,
    history_text,
    numbers_text,
    one_line,
    picture_index_text,
    select_pictures,
    start_text,
    steps_text,
    subtask_text,
    task_text,
    window,
)
from llm.evolve.rules import GOAL_NOT_REACHED, MeasuredInspector
from llm.memory import SkillMemory, notes_for
from llm.structured.ask import Log, ask, extract
from llm.structured.conversation import (
    INSPECTOR,
    REPLY_LIMIT,
    SUPERVISOR,
    AnswersRefused,
    Conversation,
    Round,
    errors_of,
    finding,
)
from llm.structured.prompting import Prompt, fenced, primitives_text, render, scene_table
from llm.structured.schema import (
    LONGEST_NAME,
    MOST_ACTIONS,
    Answer,
    MaybeLine,
    MaybeNumber,
    MaybeStepNumber,
    Reason,
    Remark,
    WireStep,
    begins_with_denial,
)
from oag import (
    ActionFlow,
    Attempt,
    Critique,
    Diagnostic,
    Hindsight,
    History,
    Iteration,
    Revision,
    Tolerance,
    admissible,
    change_between,
    flow_to_json,
)
from oag.measurements import MeasuredEvidence
from oag.revision import Origin

AnswerT = TypeVar("AnswerT", bound=Answer)
ROUNDS = 3
_SYSTEM = "evolve/system"


@dataclass(slots=True)
class JudgeSession:
    """Session with one model; it stops asking after the model has failed.

    A model without a reply ends an evolution but does not discard its results: the reason goes into the record, and
    nothing more is asked.

    Attributes:
        transport: Transport to the model; it also keeps the budget.
        conversation: Record of every round.
        rounds: Most questions for one answer.
        stopped: Why the model is no longer asked; empty while it is.
    """

    transport: Transport
    conversation: Conversation
    rounds: int = ROUNDS
    stopped: str = ""
    _log: Log = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._log = Log(self.conversation)

    def ask(
        self,
        module: int,
        text: str,
        schema: type[AnswerT],
        check: Callable[[AnswerT], Iterable[Diagnostic]],
        images: Sequence[Image] = (),
    ) -> AnswerT | str:
        """Return an answer in which `check` finds nothing wrong, or in a sentence or two why there is none.

        Raises:
            ModelConfigError, CassetteError, ModelCancelled: Failures that only the caller can fix, or requested.
        """
        if self.stopped:
            return self.stopped
        # Empty sections leave blank lines.
        prompt = Prompt(module, render(_SYSTEM), re.sub(r"\n{3,}", "\n\n", text), tuple(images))
        try:
            return ask(self.transport, prompt, schema, check, rounds=self.rounds, log=self._log)
        except AnswersRefused as refusal:
            last = "; ".join(found.message for found in refusal.findings[:3])
            cut_off = any(found.code == "answer/cut-off" for found in refusal.findings)
            advice = f". {REPLY_LIMIT}" if cut_off else ""
            return f"no answer held in {self.rounds} rounds; the last one: {last}{advice}"
        except (ModelConfigError, CassetteError, ModelCancelled):
            raise
        except ModelError as error:
            # Without the usage, so that a replay gives the same record.
            self.stopped = f"{error.model}: {error.problem}"
            return self.stopped


ALL_VIEWS = ("global", "head", "wrist")
LOOK_BACK = 1
MOST_INSPECTED = 36


Judgement = Literal["yes", "no", "unclear"]
_MEANINGS: dict[Judgement, bool | None] = {"yes": True, "no": False, "unclear": None}


def _written(value: object) -> object:
    """Normalise a judgement to the words of the schema: lower case, yes or no for true or false."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return value.strip().rstrip(".").lower() if isinstance(value, str) else value


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

    Raises:
        RequestError: Neither views nor measurements, an unknown view, or an invalid number.
    """

    session: JudgeSession
    views: tuple[str, ...] = ALL_VIEWS
    look_back: int = LOOK_BACK
    measurements: bool = True
    most_pictures: int = MOST_INSPECTED
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
        shown = window(step, self.look_back)
        pictures = select_pictures(attempt, shown, self.views, self.most_pictures)
        section = ""
        if measured is not None:
            lines = f"{critique_text(measured)}\n{numbers_text(measured.evidence)}".rstrip()
            head = "What was measured of the step (m, rad, s as the names say; it is exact)"
            section = f"{head}:\n{fenced('measured', lines)}\n"
        text = render(
            "evolve/inspector",
            subtask=fenced("subtask", subtask_text(attempt)),
            step=str(step + 1),
            flow=fenced("flow", steps_text(attempt.steps, shown, numbers_run=self.measurements)),
            primitive=primitives_text(attempt.steps[step].asked.primitive),
            measurements=section,
            pictures=picture_index_text(pictures),
        )
        images = [picture.image for picture in pictures]
        answer = self.session.ask(
            INSPECTOR, text, StepCritique, lambda given: _critique_findings(given, step, measured), images
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


MOST_SUPERVISED = 24
NO_ANSWER = "the model gave no usable answer"
_MOST_FINDINGS = 3


class RevisedFlow(Answer):
    """A supervisor's answer to a failed attempt.

    The fields are in the order of reasoning: the cause before the flow, and a problem only if no flow was found. The
    paper's two are enough.

    Source: the paper's raw outputs, `"reason"` and `"new_sequence"`; its three reasoning steps are root cause,
    revision, library. Without a `sub_task` the failed one is meant, else an earlier one to blame.
    """

    root_cause: MaybeLine = Field(default="", description="the root cause in a few words")
    sub_task: MaybeNumber = Field(default=None, description="number of the simple task whose flow is revised")
    root_cause_step: MaybeStepNumber = Field(default=None, description="number of the earliest failed or risky step")
    reason: Reason = Field(description="why it failed, what is changed, and why that helps")
    new_sequence: Annotated[list[WireStep], BeforeValidator(lambda value: [] if value is None else value)] = Field(
        default=[], max_length=MOST_ACTIONS
    )
    problem: Remark = Field(default="", description="why no flow can help; empty if one is given")

    @property
    def flow(self) -> ActionFlow:
        """The revised flow."""
        return tuple(step.action() for step in self.new_sequence)


@dataclass(slots=True)
class ModelSupervisor:
    """Revise flows by asking a model.

    A revision is returned only if `oag.admissible` allows it; otherwise the model gets numbered diagnostics. So no
    simulator runs an invented primitive, a plan that no longer reaches its goal, or a flow that failed already. That
    measurements are sent is a departure from the paper.

    Attributes:
        session: Session with the model.
        views: Cameras whose pictures of the failed attempt are sent; may be none.
        measurements: Whether measured failures are sent, or the critiques alone.
        most_pictures: Most pictures in a question; there are at most six for each step and view.
        notes: Returns notes about similar failures, a line each; None for no memory.

    Raises:
        RequestError: `most_pictures` is below 1.
    """

    session: JudgeSession
    views: tuple[str, ...] = ALL_VIEWS
    measurements: bool = True
    most_pictures: int = MOST_SUPERVISED
    notes: Callable[[Situation], Sequence[str]] | None = None

    def __post_init__(self) -> None:
        if self.most_pictures < 1:
            raise RequestError(f"most_pictures is at least 1, not {self.most_pictures}")

    def revise(self, situation: Situation) -> Revision | GiveUp:
        """Return the model's revision, which is admissible, or why there is none.

        Raises:
            PicturesMissing: There are views, and nothing can render them.
            ModelError: Failures that only the caller can fix (`JudgeSession.ask`).
        """
        if self.session.stopped:
            return GiveUp(self.session.stopped, NO_ANSWER)
        observation = situation.observation
        pictures = (
            ()
            if observation is None
            else select_pictures(observation, range(len(observation.steps)), self.views, self.most_pictures)
        )
        asked_before = len(self.session.conversation.rounds)
        answer = self.session.ask(
            SUPERVISOR,
            self._question(situation, pictures),
            RevisedFlow,
            lambda given: _revision_findings(given, situation, show_failures=self.measurements),
            [picture.image for picture in pictures],
        )
        refused = refusals(self.session.conversation.rounds[asked_before:])
        if isinstance(answer, str):
            return GiveUp(answer, NO_ANSWER, refused=refused)
        if answer.problem:
            return GiveUp(f"{answer.problem} ({answer.reason})", answer.root_cause, refused=refused)
        blamed, index = _blamed_attempt(answer, situation), _blamed_subtask(answer, situation)
        step = answer.root_cause_step
        return Revision(
            flow=answer.flow,
            change=change_between((situation.attempt if blamed is None else blamed[0]).flow, answer.flow),
            explanation=answer.reason,
            cause=answer.root_cause or one_line(answer.reason, LONGEST_NAME),
            cause_step=None if step is None else step - 1,
            origin="model",
            subtask=None if index == situation.subtask else index,
            refused=refused,
        )

    def _question(self, situation: Situation, pictures: Sequence[Picture]) -> str:
        attempt, start = situation.attempt, None if situation.observation is None else situation.observation.start
        number = situation.subtask + 1
        # The flows of the successful subtasks before may contain the cause.
        earlier = [
            f"simple task {history.subtask + 1}: {_first_line(history.iterations[-1].attempt.flow)}"
            for history in situation.earlier
            if history.iterations
        ]
        notes = () if self.notes is None else self.notes(situation)
        objections = [one_line(line) for objection in situation.objections for line in objection.splitlines()]
        tried = history_text(situation.history, show_failures=self.measurements)
        with_failures = self.measurements
        return render(
            "evolve/supervisor",
            number=str(number),
            task=fenced("task", task_text(situation.task)),
            scene=fenced("scene", scene_table(situation.scene)),
            start=_section(
                f"How it was when simple task {number} began; it begins so again",
                start_text(start) if with_failures and start is not None else "",
                label="start",
            ),
            flow=fenced("flow", flow_text(attempt.flow)),
            critiques=fenced("critiques", self._critiques(attempt)),
            earlier=_section("The flows of the simple tasks before, which reached their goals", "\n".join(earlier)),
            failure=_section("How it ended", _failure(attempt) if with_failures else "", label="failure"),
            history=_section("What was tried before, in order", tried),
            notes=_section(
                "What helped in similar cases of earlier runs; it may not fit this one",
                "\n".join(one_line(line, 1_000) for line in notes),
                label="notes",
            ),
            objections=_section("Answers of yours to this question that could not run, and why", "\n".join(objections)),
            pictures=picture_index_text(pictures),
            primitives=primitives_text(),
            longest=str(MOST_ACTIONS),
            tolerance=str(Tolerance()),
        )

    def _critiques(self, attempt: Attempt) -> str:
        lines = []
        for critique in attempt.critiques:
            lines.append(critique_text(critique))
            numbers = numbers_text(critique.evidence) if self.measurements and critique.finds_fault else ""
            if numbers:
                lines.append(f"  measured: {numbers}")
        return "\n".join(lines) or "no step was judged"


def _section(head: str, text: str, *, label: str = "earlier") -> str:
    return f"{head}:\n{fenced(label, text)}\n" if text else ""


def _first_line(flow: ActionFlow) -> str:
    return flow_text(flow).partition("\n")[0]


def _failure(attempt: Attempt) -> str:
    where = "" if attempt.failed_step is None else f"step {attempt.failed_step + 1}: "
    text = f"{where}{one_line(attempt.message or attempt.failure)}"
    if attempt.filled is None or attempt.filled == attempt.flow:
        return text
    return f"{text}\nwith the numbers that were run: {_first_line(attempt.filled)}"


def _revision_findings(answer: RevisedFlow, situation: Situation, *, show_failures: bool) -> Iterator[Diagnostic]:
    """Yield the findings that make a revision unusable: unknown step or subtask, two answers in one, its flow."""
    index = _blamed_subtask(answer, situation)
    blamed = _blamed_attempt(answer, situation)
    if blamed is None:
        last = situation.subtask + 1
        message = f"simple task {last} failed; the flow of a simple task from 1 to {last} can be revised"
        yield finding("answer/step", f"{message}, not of {index + 1}", "sub_task")
        return
    attempt, history = blamed
    ran = len(attempt.flow)
    if answer.root_cause_step is not None and answer.root_cause_step > ran:
        message = f"the flow of simple task {index + 1} has {ran} steps, there is no step {answer.root_cause_step}"
        yield finding("answer/step", message, "root_cause_step")
    if answer.problem and answer.new_sequence:
        hint = "leave problem empty if the flow helps, or give no flow"
        yield finding("answer/contradictory", "a problem and a flow are given", "problem", hint=hint)
    elif not answer.problem and not answer.new_sequence:
        yield finding("answer/empty-flow", "neither a flow nor a problem is given", "new_sequence")
    elif answer.new_sequence:
        history = history.add(attempt)
        known = history if show_failures else _hide_failures(history)
        admission = admissible(situation.task, index, answer.flow, scene=situation.scene, history=known)
        yield from admission.diagnostics
        if admission and admission.report is not None and not admission.report:
            open_ones = (found for found in admission.report.diagnostics if found.code == "context/open")
            yield from (replace(found, severity="error") for found in open_ones)


def _blamed_subtask(answer: RevisedFlow, situation: Situation) -> int:
    return situation.subtask if answer.sub_task is None else answer.sub_task - 1


def _blamed_attempt(answer: RevisedFlow, situation: Situation) -> tuple[Attempt, History] | None:
    """Return the attempt whose flow is revised and the history before it; None if there is none.

    A revision of an earlier subtask refers to an attempt that had succeeded.
    """
    index = _blamed_subtask(answer, situation)
    if index == situation.subtask:
        return situation.attempt, situation.history
    if index > situation.subtask or index >= len(situation.earlier) or not situation.earlier[index].solved:
        return None
    failed = situation.attempt
    return situation.earlier[index].reopened(Hindsight(situation.subtask, failed.failure, failed.message))


def _hide_failures(history: History) -> History:
    """Return a history without measured failures, which findings would repeat."""
    hidden = (
        Iteration(replace(attempt, message="", failure=GOAL_NOT_REACHED, failed_step=None), revision)
        for attempt, revision in history.iterations
    )
    return replace(history, iterations=tuple(hidden))


def refusals(rounds: Sequence[Round]) -> tuple[str, ...]:
    """Return the unusable answers among some rounds, a line each, in order.

    An answer that was questioned because of warnings alone, and may have been accepted then, is not among them.
    """
    return tuple(_refusal(entry) for entry in rounds if errors_of(entry.findings))


def _refusal(entry: Round) -> str:
    asked_for = f"an answer without a flow that can be read ({one_line(entry.reply, 60)})"
    found = extract(entry.reply, RevisedFlow.found_in, cut_off=entry.finish_reason == "length")
    if not isinstance(found, Diagnostic):
        with suppress(ValidationError, RecursionError):
            asked_for = json.dumps(flow_to_json(RevisedFlow.model_validate(found).flow))
    errors = errors_of(entry.findings)
    listed = [f"{error.code}: {error.message}" for error in errors[:_MOST_FINDINGS]]
    more = len(errors) - len(listed)
    return f"{asked_for}: {one_line('; '.join([*listed, *([f'and {more} more'] if more else [])]))}"


@dataclass(frozen=True, slots=True)
class Judges:
    """Inspector and Supervisor of one model, and their conversation."""

    inspector: ModelInspector
    supervisor: ModelSupervisor
    session: JudgeSession

    @property
    def conversation(self) -> Conversation:
        """Rounds of both."""
        return self.session.conversation

    @property
    def stopped(self) -> str:
        """Why the model is no longer asked; empty while it is."""
        return self.session.stopped


def judges(
    model: str | Transport,
    *,
    name: str = "",
    task: str = "",
    scene: str = "",
    views: Sequence[str] = ALL_VIEWS,
    look_back: int = LOOK_BACK,
    measurements: bool = True,
    rounds: int = ROUNDS,
    most_pictures: int | None = None,
    memory: SkillMemory | None = None,
    listen: Callable[[Round], None] | None = None,
) -> Judges:
    """Set up an Inspector and a Supervisor that ask one model.

    Args:
        model: A configuration such as "openai:gpt-5.2" or "replay:FILE"; or the result of `connect`, with a budget
            and a recording.
        name: Name of the model in records; by default the configuration.
        task: Subject of the evolution, for the record.
        scene: Name of the scene, for the record.
        views, look_back, measurements, rounds: See `ModelInspector`, `ModelSupervisor` and `JudgeSession`.
        most_pictures: Most pictures in a question; by default 36 for the Inspector, 24 for the Supervisor.
        memory: Notes for the Supervisor's prompt.
        listen: Called with every round.

    Raises:
        ModelConfigError: Provider, model, key, address or library is unknown or missing.
        CassetteError: A recording cannot be read.
        RequestError: Neither views nor measurements, an unknown view, or an invalid number.
    """
    transport = connect(model) if isinstance(model, str) else model
    called = name or (model if isinstance(model, str) else "model")
    session = JudgeSession(transport, Conversation(called, task, scene, listen=listen), rounds)
    inspected, supervised = (
        (MOST_INSPECTED, MOST_SUPERVISED) if most_pictures is None else (most_pictures, most_pictures)
    )
    inspector = ModelInspector(session, tuple(views), look_back, measurements, inspected)
    notes = None if memory is None else partial(notes_for, memory)
    supervisor = ModelSupervisor(session, tuple(views), measurements, supervised, notes)
    return Judges(inspector, supervisor, session)
