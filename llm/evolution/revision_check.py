"""What can be wrong with a model's revision: no such step or subtask, two answers in one, an inadmissible flow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from llm.answers.revision import RevisedFlow
from llm.evolution.supervisor import Situation
from llm.findings import finding
from oag import Attempt, Diagnostic, Hindsight, History, Iteration, admissible


def wrong(answer: RevisedFlow, situation: Situation, *, told_failures: bool) -> Iterator[Diagnostic]:
    """Yields everything with which a revision cannot be used.

    Args:
        answer: The revision.
        situation: What the model was asked about.
        told_failures: Whether findings may repeat what was measured.
    """
    number = blamed_subtask(answer, situation) + 1
    blamed = blamed_attempt(answer, situation)
    if blamed is None:
        last = situation.subtask + 1
        message = f"simple task {last} failed; the flow of a simple task from 1 to {last} can be revised"
        yield finding("answer/step", f"{message}, not of {number}", "sub_task")
        return
    attempt, history = blamed
    ran = len(attempt.flow)
    if answer.root_cause_step is not None and answer.root_cause_step > ran:
        message = f"the flow of simple task {number} has {ran} steps, there is no step {answer.root_cause_step}"
        yield finding("answer/step", message, "root_cause_step")
    if answer.problem and answer.new_sequence:
        hint = "leave problem empty if the flow helps, or give no flow"
        yield finding("answer/contradictory", "a problem and a flow are given", "problem", hint=hint)
    elif not answer.problem and not answer.new_sequence:
        yield finding("answer/empty-flow", "neither a flow nor a problem is given", "new_sequence")
    elif answer.new_sequence:
        history = history.add(attempt)
        yield from _inadmissible(answer, situation, history if told_failures else _untold(history))


def blamed_subtask(answer: RevisedFlow, situation: Situation) -> int:
    """Returns the index of the subtask whose flow a revision changes: the one that failed, unless it names another."""
    return situation.subtask if answer.sub_task is None else answer.sub_task - 1


def blamed_attempt(answer: RevisedFlow, situation: Situation) -> tuple[Attempt, History] | None:
    """Returns the attempt whose flow a revision changes, and the history before it; None where there is none.

    A revision of an earlier subtask is made in hindsight of an attempt that had succeeded.
    """
    index = blamed_subtask(answer, situation)
    if index == situation.subtask:
        return situation.attempt, situation.history
    if index > situation.subtask or index >= len(situation.earlier) or not situation.earlier[index].solved:
        return None
    failed = situation.attempt
    return situation.earlier[index].reopened(Hindsight(situation.subtask, failed.failure, failed.message))


def _inadmissible(answer: RevisedFlow, situation: Situation, history: History) -> Iterator[Diagnostic]:
    index = blamed_subtask(answer, situation)
    admission = admissible(situation.task, index, answer.flow, scene=situation.scene, history=history)
    yield from admission.diagnostics
    if admission and admission.report is not None and not admission.report:
        open_ones = (found for found in admission.report.diagnostics if found.code == "context/open")
        yield from (replace(found, severity="error") for found in open_ones)


def _untold(history: History) -> History:
    """Returns a history without what was measured of failures, which findings would repeat."""
    return replace(
        history,
        iterations=tuple(
            Iteration(replace(attempt, message="", failure="goal-not-reached", failed_step=None), revision)
            for attempt, revision in history.iterations
        ),
    )
