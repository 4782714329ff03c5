"""The Supervisor behind which a vision-language model stands: root cause, revised flow, reason.

A revision leaves here only when `oag.admissible` allows it; else the model is told why, with numbered diagnostics. So
an invented primitive, a plan that no longer reaches its goal or a flow that failed already gets to no simulator.

Source: the paper's Robotic Task Supervisor. That it is told what was measured is a departure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from llm.answers.base import LONGEST_NAME, MOST_ACTIONS
from llm.answers.revision import RevisedFlow
from llm.conversation import SUPERVISOR
from llm.describe import primitives_text, scene_table
from llm.errors import RequestError
from llm.evolution.asking import Asking, NoAnswer
from llm.evolution.model_inspector import ALL_VIEWS
from llm.evolution.pictures import Picture, index_of, pictures_of
from llm.evolution.refusals import refusals
from llm.evolution.revision_check import blamed_attempt, blamed_subtask, wrong
from llm.evolution.supervisor import GiveUp, Situation
from llm.evolution.telling import critique_text, flow_text, history_text, numbers_text, one_line, start_text, task_text
from llm.prompting import fenced, render
from oag import Attempt, Revision, Tolerance, change_between

MOST_PICTURES = 24
NO_ANSWER = "the model gave no usable answer"


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
        pictures = self._pictures(situation)
        asked_before = len(self.asking.conversation.rounds)
        answer = self.asking.ask(
            SUPERVISOR,
            self._question(situation, pictures),
            RevisedFlow,
            lambda given: tuple(wrong(given, situation, told_failures=self.measurements)),
            [picture.image for picture in pictures],
        )
        refused = refusals(self.asking.conversation.rounds[asked_before:])
        if isinstance(answer, NoAnswer):
            return GiveUp(answer.reason, NO_ANSWER, refused=refused)
        if answer.problem:
            return GiveUp(f"{answer.problem} ({answer.reason})", answer.root_cause, refused=refused)
        blamed, index = blamed_attempt(answer, situation), blamed_subtask(answer, situation)
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

    def _pictures(self, situation: Situation) -> tuple[Picture, ...]:
        seen = situation.seen
        if seen is None:
            return ()
        return pictures_of(seen, range(len(seen.steps)), self.views, self.most_pictures)

    def _question(self, situation: Situation, pictures: Sequence[Picture]) -> str:
        attempt = situation.attempt
        return render(
            "supervisor",
            number=str(situation.subtask + 1),
            task=fenced("task", task_text(situation.task)),
            scene=fenced("scene", scene_table(situation.scene)),
            start=_start(situation) if self.measurements else "",
            flow=fenced("flow", flow_text(attempt.flow)),
            critiques=fenced("critiques", self._critiques(attempt)),
            earlier=_earlier(situation),
            failure=_failure(attempt) if self.measurements else "",
            history=_section(
                "What was tried before, in order", history_text(situation.history, told_failures=self.measurements)
            ),
            notes=self._notes(situation),
            objections=_objections(situation.objections),
            pictures=index_of(pictures),
            primitives=primitives_text(),
            longest=str(MOST_ACTIONS),
            tolerance=str(Tolerance()),
        )

    def _critiques(self, attempt: Attempt) -> str:
        if not attempt.critiques:
            return "no step was judged"
        lines = []
        for critique in attempt.critiques:
            lines.append(critique_text(critique))
            numbers = numbers_text(critique.evidence) if self.measurements and critique.finds_fault else ""
            if numbers:
                lines.append(f"  measured: {numbers}")
        return "\n".join(lines)

    def _notes(self, situation: Situation) -> str:
        lines = () if self.notes is None else tuple(self.notes(situation))
        if not lines:
            return ""
        head = "What helped in similar cases of earlier runs; it may not fit this one"
        return _section(head, "\n".join(one_line(line, 1_000) for line in lines), label="notes")


def _start(situation: Situation) -> str:
    """Returns how it was when the failed attempt began, and is again when the next one does."""
    if situation.seen is None or situation.seen.start is None:
        return ""
    head = f"How it was when simple task {situation.subtask + 1} began; it begins so again"
    return _section(head, start_text(situation.seen.start), label="start")


def _earlier(situation: Situation) -> str:
    """Returns the flows of the simple tasks before, which succeeded: how they did may be the cause."""
    lines = [
        f"simple task {history.subtask + 1}: {flow_text(history.iterations[-1].attempt.flow).partition(chr(10))[0]}"
        for history in situation.earlier
        if history.iterations
    ]
    return (
        _section("The flows of the simple tasks before, which reached their goals", "\n".join(lines)) if lines else ""
    )


def _failure(attempt: Attempt) -> str:
    where = "" if attempt.failed_step is None else f"step {attempt.failed_step + 1}: "
    said = [f"{where}{one_line(attempt.message or attempt.failure)}"]
    if attempt.filled is not None and attempt.filled != attempt.flow:
        said.append(f"with the numbers that were run: {flow_text(attempt.filled).partition(chr(10))[0]}")
    return _section("How it ended", "\n".join(said), label="failure")


def _objections(objections: Sequence[str]) -> str:
    if not objections:
        return ""
    lines = [one_line(line) for objection in objections for line in objection.splitlines()]
    return _section("Answers of yours to this question that could not run, and why", "\n".join(lines))


def _section(head: str, text: str, *, label: str = "earlier") -> str:
    return f"{head}:\n{fenced(label, text)}\n"
