"""Whatever form an answer is written in: it is read as what it says, or refused with a finding, and nothing crashes."""

from __future__ import annotations

import json
from dataclasses import dataclass, field

import pytest

from llm.client.completion import read_answer
from llm.client.transport import ChatReply, ChatRequest, Transport
from llm.evolve import Situation
from llm.evolve.judges import judges
from llm.proposing.model_proposer import ModelProposer
from llm.structured.conversation import Conversation
from oag.revision import History, Revision
from tests.llm.evolve.scripted_judges import Judge, ajar, asks_inspector, attempt_of
from tests.llm.forms import FORMS, INSPECTOR, KINDS, SUPERVISOR, Form, draft, right_answer
from tests.llm.scripted_modules import QUERIES, Script, module_of, right_answers, scene_of
from tests.oag.paper import scene

SEEN = ajar()
SITUATION = Situation(SEEN.task, 3, scene("T1"), attempt_of(SEEN, ()), History(3), observation=SEEN)
STEP = 5
CASES = [(name, kind) for name, form in FORMS.items() for kind in form.kinds]


@dataclass
class Formed:
    """Gives a reply to the first question of a kind, and leaves the others to another transport.

    Attributes:
        kind: Which module, INSPECTOR or SUPERVISOR.
        reply: What it is told.
        rest: Who answers everything else.
    """

    kind: int
    reply: ChatReply
    rest: Transport
    given: bool = field(default=False)

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the reply."""
        judged = self.kind in (INSPECTOR, SUPERVISOR)
        kind = (INSPECTOR if asks_inspector(request) else SUPERVISOR) if judged else module_of(request)
        if kind != self.kind or self.given:
            return self.rest.complete(request)
        self.given = True
        return self.reply


def reply_of(form: Form, kind: int) -> ChatReply:
    """Return a reply of a form as it comes from a server."""
    made = form.make(right_answer(kind), kind)
    said = made if isinstance(made, dict) else {"content": made}
    body = {"choices": [{"message": {"role": "assistant", **said}, "finish_reason": form.finish}]}
    completion = read_answer(json.dumps(body).encode(), "application/json")
    assert isinstance(completion, ChatReply)
    return ChatReply(completion.text, finish_reason=completion.finish_reason)


def outcome(kind: int, reply: ChatReply | None) -> tuple[object, Conversation]:
    """Return what comes of a reply to a kind of question, and what was said; None replies rightly at once."""
    if kind == INSPECTOR:
        right: Transport = Judge((), lambda step: right_answer(INSPECTOR))
    elif kind == SUPERVISOR:
        right = Judge((right_answer(SUPERVISOR),))
    else:
        right = Script(right_answers("T1"))
    model = right if reply is None else Formed(kind, reply, right)
    if kind == INSPECTOR:
        team = judges(model)
        said = team.inspector.inspect(SEEN, STEP - 1)
        assert said.origin == "both"
        return (said.step, said.motion_verified, said.state_reached, said.anomaly), team.conversation
    if kind == SUPERVISOR:
        team = judges(model)
        revision = team.supervisor.revise(SITUATION)
        assert isinstance(revision, Revision) and revision.explanation
        return (revision.flow, revision.subtask), team.conversation
    proposer = ModelProposer(model, cross_check=False)
    task = proposer.propose(QUERIES["T1"], scene_of("T1")).task
    parts = [(p.target, p.support_init, p.support_goal, p.init, p.goal, p.flow) for p in task.subtasks]
    assert proposer.conversation is not None
    return (task.goal, parts, task.scales), proposer.conversation


RIGHT = {kind: outcome(kind, None) for kind in KINDS}


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_a_form_is_read_rightly_or_refused_with_a_finding(name: str, kind: int) -> None:
    form = FORMS[name]
    came, conversation = outcome(kind, reply_of(form, kind))
    right, shortest = RIGHT[kind]
    assert came == right
    first = next(entry for entry in conversation.rounds if entry.module == kind)
    assert first.accepted is form.reads, first.findings
    if form.reads:
        # What was misread would have been mended by further questions.
        assert len(conversation.entries) == len(shortest.entries)
    else:
        assert first.findings and all(found.message for found in first.findings)


@pytest.mark.parametrize("kind", KINDS)
def test_a_draft_that_is_taken_would_be_seen(kind: int) -> None:
    """Else the forms that hold drafts would prove nothing."""
    came, conversation = outcome(kind, ChatReply(json.dumps(draft(kind))))
    right, shortest = RIGHT[kind]
    assert came != right or len(conversation.entries) > len(shortest.entries)


def test_the_table_of_forms_has_not_shrunk() -> None:
    assert len(FORMS) >= 86
