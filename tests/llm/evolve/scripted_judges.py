"""A model that judges and revises by script: it says what it is told to, and keeps what it was asked."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from llm.client.transport import ChatReply, ChatRequest
from llm.evolve import AttemptObservation, GoalReading, StepObservation
from oag.measurements import AtomMeasured
from oag.revision import Attempt, Critique
from tests.llm.evolve.attempts import measured, paper_task
from tests.llm.live import PNG

JPEG = b"\xff\xd8\xff\xe0"


def critique_answer(step: int, **changes: Any) -> dict[str, Any]:
    """Return a right answer of the Inspector about a step, from 1, with some fields changed."""
    fields = {
        "step": step,
        "motion_verified": "yes",
        "state_contrast": "the door is where it was",
        "state_reached": "unclear",
        "anomaly": "",
        "observation": "The robot moved as asked.",
    }
    return fields | changes


def revision_answer(flow: Sequence[Any], **changes: Any) -> dict[str, Any]:
    """Return a right answer of the Supervisor with a flow, and some fields changed."""
    fields = {
        "sub_task": 4,
        "root_cause_step": 5,
        "root_cause": "limits too narrow",
        "reason": "The door was left ajar, so it is closed further.",
        "problem": "",
        "new_sequence": list(flow),
    }
    return fields | changes


def asks_inspector(request: ChatRequest) -> bool:
    """True when it is the Inspector that asks."""
    return question(request).startswith("Inspector:")


def question(request: ChatRequest) -> str:
    """Return the text of the question itself."""
    return str(request.messages[0].parts[0])


def asked_step(text: str) -> int:
    """Return the number of the step that the Inspector's question is about."""
    found = re.search(r"from which you judge step (\d+)", text)
    assert found is not None
    return int(found[1])


def as_reply(answer: object) -> str:
    """Return an answer as a model writes it."""
    return answer if isinstance(answer, str) else json.dumps(answer)


@dataclass
class Judge:
    """Answers the Inspector with `critique` of the step, and the Supervisor with `revisions` in turn, the last again.

    Attributes:
        revisions: Answers, or their texts.
        critique: Returns the answer, or its text, about a step.
        asked: Every request.
    """

    revisions: Sequence[object] = ()
    critique: Callable[[int], object] = critique_answer
    asked: list[ChatRequest] = field(default_factory=list)

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the scripted answer."""
        number = len(self.supervised)
        self.asked.append(request)
        if asks_inspector(request):
            return ChatReply(as_reply(self.critique(asked_step(question(request)))), 100, 20, 0.5)
        return ChatReply(as_reply(self.revisions[min(number, len(self.revisions) - 1)]), 200, 40, 1.5)

    @property
    def supervised(self) -> list[ChatRequest]:
        """The Supervisor's requests."""
        return [request for request in self.asked if not asks_inspector(request)]


def door(fraction: float) -> tuple[GoalReading, ...]:
    """Return what is read of a door that is to be closed."""
    return (GoalReading("(open refrigerator_0)", False, fraction > 0.05, AtomMeasured(open_fraction=fraction), "open"),)


def ajar(views: Sequence[str] = (), pictures: int = 2) -> AttemptObservation:
    """Return an attempt at closing the refrigerator of T1 that left it ajar, with pictures of some views."""
    task = paper_task("T1")
    flow = task.subtasks[3].flow or ()
    steps = []
    for step, action in enumerate(flow):
        left = 0.85 if step < 4 else 0.35
        told: dict[str, Any] = {"before": door(0.85 if step < 5 else 0.35), "after": door(left)}
        if step == 4:
            told["measurements"] = measured(fraction_reached=0.35, fraction_asked=0.35)
        if step == 5:
            told |= {"failure": "goal-not-reached", "message": "close_refrigerator ran, but it is open"}
        told["frames"] = {v: tuple(PNG + f"{step} {v} {k}".encode() for k in range(pictures)) for v in views}
        steps.append(StepObservation(step, action, action, **told))
    return AttemptObservation(task, 3, flow, tuple(steps), door(0.35))


def attempt_of(seen: AttemptObservation, critiques: Sequence[Critique]) -> Attempt:
    """Return the record of an attempt."""
    return Attempt(
        flow=seen.flow,
        outcome="failed",
        failure="goal-not-reached",
        message="close_refrigerator ran, but it is open",
        critiques=tuple(critiques),
        filled=seen.flow,
        seed=17000,
    )
