"""The Supervisor behind which a vision-language model stands: root cause, revised flow, reason.

A revision leaves here only when `oag.admissible` allows it; else the model is told why, with numbered diagnostics. So
an invented primitive, a plan that no longer reaches its goal or a flow that failed already gets to no simulator.

Source: the paper's Robotic Task Supervisor. That it is told what was measured is a departure.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated

from pydantic import BeforeValidator, Field, ValidationError

from llm.answers.actions import WireStep
from llm.answers.base import LONGEST_NAME, MOST_ACTIONS, Answer, MaybeLine, MaybeNumber, MaybeStepNumber, Reason, Remark
from llm.answers.conversation import SUPERVISOR, Round, errors_of, finding
from llm.answers.describe import primitives_text, scene_table
from llm.answers.extract import extract
from llm.answers.prompting import fenced, render
from llm.errors import RequestError
from llm.evolution.asking import Asking, NoAnswer
from llm.evolution.measured import GOAL_NOT_REACHED
from llm.evolution.model_inspector import ALL_VIEWS
from llm.evolution.observation import GiveUp, Situation
from llm.evolution.pictures import Picture, index_of, pictures_of
from llm.evolution.telling import critique_text, flow_text, history_text, numbers_text, one_line, start_text, task_text
from oag import (
    ActionFlow,
    Attempt,
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

MOST_PICTURES = 24
NO_ANSWER = "the model gave no usable answer"
_MOST_FINDINGS = 3


class RevisedFlow(Answer):
    """What a supervisor makes of a failed attempt.

    The fields stand in the order of thinking: the cause before the flow, and a problem only where no flow was found.
    The paper's two are enough.

    Source: the paper's raw outputs, `"reason"` and `"new_sequence"`; its three reasoning steps are root cause,
    revision, library.

    Attributes:
        root_cause: The root cause in a few words; empty where it is not said.
        sub_task: Number of the simple task whose flow is revised: the one that failed, or an earlier one to blame. None
            where it is not said: the one that failed.
        root_cause_step: Number of the earliest failed or risky step of its flow, from 1; None where it is not said.
        reason: Why it failed, what is changed, and why that helps.
        new_sequence: The revised flow; empty when there is a problem.
        problem: Why no flow of the library can help; empty when one is given.
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
    """Revises flows by asking a model.

    Attributes:
        asking: Who is asked.
        views: The cameras whose pictures of the failed attempt it sees; it may be none.
        measurements: Whether it is told the measured failures, or the critiques alone.
        most_pictures: Most pictures in a question; there are at most six for each step and view.
        notes: Returns what is remembered of similar failures as text, a line each; None for no memory.

    Raises:
        RequestError: Most pictures are fewer than 1.
    """

    asking: Asking
    views: tuple[str, ...] = ALL_VIEWS
    measurements: bool = True
    most_pictures: int = MOST_PICTURES
    notes: Callable[[Situation], Sequence[str]] | None = None

    def __post_init__(self) -> None:
        if self.most_pictures < 1:
            raise RequestError(f"most_pictures is at least 1, not {self.most_pictures}")

    def revise(self, situation: Situation) -> Revision | GiveUp:
        """Returns the model's revision, which is admissible, or why there is none.

        Raises:
            PicturesMissing: There are views, and nothing can draw them.
            ModelError: What only the caller can mend (`Asking.ask`).
        """
        if self.asking.stopped:
            return GiveUp(self.asking.stopped, NO_ANSWER)
        seen = situation.seen
        pictures = () if seen is None else pictures_of(seen, range(len(seen.steps)), self.views, self.most_pictures)
        asked_before = len(self.asking.conversation.rounds)
        answer = self.asking.ask(
            SUPERVISOR,
            self._question(situation, pictures),
            RevisedFlow,
            lambda given: _wrong(given, situation, told_failures=self.measurements),
            [picture.image for picture in pictures],
        )
        refused = refusals(self.asking.conversation.rounds[asked_before:])
        if isinstance(answer, NoAnswer):
            return GiveUp(answer.reason, NO_ANSWER, refused=refused)
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
        attempt, start = situation.attempt, None if situation.seen is None else situation.seen.start
        number = situation.subtask + 1
        # How those before did that succeeded may be the cause.
        earlier = [
            f"simple task {history.subtask + 1}: {_first_line(history.iterations[-1].attempt.flow)}"
            for history in situation.earlier
            if history.iterations
        ]
        notes = () if self.notes is None else self.notes(situation)
        objections = [one_line(line) for objection in situation.objections for line in objection.splitlines()]
        tried = history_text(situation.history, told_failures=self.measurements)
        told = self.measurements
        return render(
            "evolution/supervisor",
            number=str(number),
            task=fenced("task", task_text(situation.task)),
            scene=fenced("scene", scene_table(situation.scene)),
            start=_section(
                f"How it was when simple task {number} began; it begins so again",
                start_text(start) if told and start is not None else "",
                label="start",
            ),
            flow=fenced("flow", flow_text(attempt.flow)),
            critiques=fenced("critiques", self._critiques(attempt)),
            earlier=_section("The flows of the simple tasks before, which reached their goals", "\n".join(earlier)),
            failure=_section("How it ended", _failure(attempt) if told else "", label="failure"),
            history=_section("What was tried before, in order", tried),
            notes=_section(
                "What helped in similar cases of earlier runs; it may not fit this one",
                "\n".join(one_line(line, 1_000) for line in notes),
                label="notes",
            ),
            objections=_section("Answers of yours to this question that could not run, and why", "\n".join(objections)),
            pictures=index_of(pictures),
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
    said = f"{where}{one_line(attempt.message or attempt.failure)}"
    if attempt.filled is None or attempt.filled == attempt.flow:
        return said
    return f"{said}\nwith the numbers that were run: {_first_line(attempt.filled)}"


def _wrong(answer: RevisedFlow, situation: Situation, *, told_failures: bool) -> Iterator[Diagnostic]:
    """Yields everything with which a revision cannot be used: no such step or subtask, two answers in one, its flow.

    Args:
        answer: The revision.
        situation: What the model was asked about.
        told_failures: Whether findings may repeat what was measured.
    """
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
        known = history if told_failures else _untold(history)
        admission = admissible(situation.task, index, answer.flow, scene=situation.scene, history=known)
        yield from admission.diagnostics
        if admission and admission.report is not None and not admission.report:
            open_ones = (found for found in admission.report.diagnostics if found.code == "context/open")
            yield from (replace(found, severity="error") for found in open_ones)


def _blamed_subtask(answer: RevisedFlow, situation: Situation) -> int:
    """Returns the index of the subtask whose flow a revision changes: the one that failed, unless it names another."""
    return situation.subtask if answer.sub_task is None else answer.sub_task - 1


def _blamed_attempt(answer: RevisedFlow, situation: Situation) -> tuple[Attempt, History] | None:
    """Returns the attempt whose flow a revision changes, and the history before it; None where there is none.

    A revision of an earlier subtask is made in hindsight of an attempt that had succeeded.
    """
    index = _blamed_subtask(answer, situation)
    if index == situation.subtask:
        return situation.attempt, situation.history
    if index > situation.subtask or index >= len(situation.earlier) or not situation.earlier[index].solved:
        return None
    failed = situation.attempt
    return situation.earlier[index].reopened(Hindsight(situation.subtask, failed.failure, failed.message))


def _untold(history: History) -> History:
    """Returns a history without what was measured of failures, which findings would repeat."""
    untold = (
        Iteration(replace(attempt, message="", failure=GOAL_NOT_REACHED, failed_step=None), revision)
        for attempt, revision in history.iterations
    )
    return replace(history, iterations=tuple(untold))


def refusals(rounds: Sequence[Round]) -> tuple[str, ...]:
    """Returns the answers among some rounds that could not be used, a line each, in their order.

    What was asked about once because of warnings alone, and may have been taken then, is none of them.
    """
    return tuple(_refusal(entry) for entry in rounds if errors_of(entry.findings))


def _refusal(entry: Round) -> str:
    """Returns an answer that could not be used on one line: its flow, or how it begins, and what is wrong."""
    asked_for = f"an answer without a flow that can be read ({one_line(entry.reply, 60)})"
    found = extract(entry.reply, RevisedFlow.found_in, cut_off=entry.finish_reason == "length")
    if not isinstance(found, Diagnostic):
        with suppress(ValidationError, RecursionError):
            asked_for = json.dumps(flow_to_json(RevisedFlow.model_validate(found).flow))
    errors = errors_of(entry.findings)
    said = [f"{error.code}: {error.message}" for error in errors[:_MOST_FINDINGS]]
    more = len(errors) - len(said)
    return f"{asked_for}: {one_line('; '.join([*said, *([f'and {more} more'] if more else [])]))}"
