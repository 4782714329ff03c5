"""Supervisor that asks a vision-language model to revise a flow that failed.

Source: the paper's Robotic Task Supervisor.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated

from pydantic import BeforeValidator, Field, ValidationError

from llm.errors import RequestError
from llm.evolve.judge_session import ALL_VIEWS, JudgeSession
from llm.evolve.observation import (
    GiveUp,
    Picture,
    Situation,
    captioned,
    critique_text,
    flow_text,
    history_text,
    numbers_text,
    one_line,
    picture_text,
    select_pictures,
    start_text,
    task_text,
)
from llm.evolve.rules import GOAL_NOT_REACHED
from llm.structured.ask import extract
from llm.structured.conversation import (
    SUPERVISOR,
    Round,
    errors_of,
    finding,
)
from llm.structured.prompting import fenced, primitives_text, render, scene_table
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
)
from oag import Diagnostic
from oag.model.actions import ActionFlow, flow_to_json
from oag.revision import Attempt, Hindsight, History, Iteration, Revision, Tolerance, admissible, change_between

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

    A revision is returned only if `admissible` allows it; otherwise the model gets numbered diagnostics. So no
    simulator runs an invented primitive, a plan that no longer reaches its goal, or a flow that failed already. That
    measurements are sent is a departure from the paper.

    Attributes:
        session: Session with the model.
        views: Cameras whose pictures of the failed attempt are sent; may be none.
        measurements: Whether measured failures are sent, or the critiques alone.
        most_pictures: Most pictures in a question; there are at most six for each step and view.

    Raises:
        RequestError: `most_pictures` is below 1.
    """

    session: JudgeSession
    views: tuple[str, ...] = ALL_VIEWS
    measurements: bool = True
    most_pictures: int = MOST_SUPERVISED

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
            captioned(pictures),
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
            objections=_section("Answers of yours to this question that could not run, and why", "\n".join(objections)),
            pictures=picture_text(pictures),
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
    found = extract(
        entry.reply,
        RevisedFlow.found_in,
        cut_off=entry.finish_reason == "length",
        fields=tuple(RevisedFlow.model_fields),
    )
    if not isinstance(found, Diagnostic):
        with suppress(ValidationError, RecursionError):
            asked_for = json.dumps(flow_to_json(RevisedFlow.model_validate(found).flow))
    errors = errors_of(entry.findings)
    listed = [f"{error.code}: {error.message}" for error in errors[:_MOST_FINDINGS]]
    more = len(errors) - len(listed)
    return f"{asked_for}: {one_line('; '.join([*listed, *([f'and {more} more'] if more else [])]))}"
