"""Modules 1 to 5 against a server that speaks the real protocol, and misbehaves on the way."""

from __future__ import annotations

from pathlib import Path

import pytest

import oag
from llm.client.recording import Recorder, Replay
from llm.client.transport import Image
from llm.proposing.model_proposer import ModelProposer
from tests.llm.live import KEY, PNG, transport_to
from tests.llm.model_server import ModelServer, fails, replies
from tests.llm.scripted_modules import QUERIES, as_reply, right_answers, scene_of, without_subtask

T1 = right_answers("T1")
PICTURE = PNG + bytes(range(256))


@pytest.mark.parametrize("mode", ["json_schema", "json_object", "plain"])
def test_a_server_that_misbehaves_still_gives_a_proved_plan(
    mode: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = {module: as_reply(answer) for module, answer in T1.items()}
    acts = [
        fails(429, retry_after="0"),
        replies(f"Here you are:\n```json\n{right[1]}\n```"),
        replies(as_reply(without_subtask(T1, 2, 3))),
        fails(500),
        replies(as_reply(without_subtask(T1, 3, 3))),
        replies(right[2]),
        replies(right[3]),
        replies('{"sub_tasks": [{"sub_task": 1, "target"'),
        replies(right[4]),
        replies(f"<think>{{}}</think>{right[5]}"),
    ]
    file = tmp_path / "run.jsonl"
    with ModelServer(*acts, key=KEY) as server:
        transport = Recorder(transport_to(server, monkeypatch, mode=mode), file)
        proposer = ModelProposer(transport, name="server", images=(Image(PICTURE),))
        proposal = proposer.propose(QUERIES["T1"], scene_of("T1"))
    assert oag.compose(proposal.task).verify().verdict is oag.Verdict.PROVED
    assert [request.images for request in server.seen] == [(PICTURE,), (PICTURE,), *[()] * 8]
    assert 'insert "close refrigerator_0" at the end' in server.seen[5].texts[-1]
    assert proposal.conversation is not None
    assert [entry.module for entry in proposal.conversation.rounds] == [1, 2, 3, 2, 3, 4, 4, 5]
    assert KEY not in str(proposal.conversation.to_json())
    again = ModelProposer(Replay(file), name="server", images=(Image(PICTURE),))
    assert again.propose(QUERIES["T1"], scene_of("T1")) == proposal
