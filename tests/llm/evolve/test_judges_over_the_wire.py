"""Inspector and Supervisor against a server that speaks the real protocol, pictures included, and misbehaves."""

from __future__ import annotations

from pathlib import Path

import pytest

from llm.client.recording import Recorder, Replay
from llm.client.transport import Transport
from llm.errors import ReplayMissing
from llm.evolve import Situation
from llm.evolve.judges import Judges, judges
from oag.model.actions import flow_to_json
from oag.revision import History, Revision
from tests.llm.evolve.scripted_judges import ajar, as_reply, attempt_of, critique_answer, revision_answer
from tests.llm.live import KEY, transport_to
from tests.llm.model_server import Act, ModelServer, fails, replies
from tests.oag.paper import scene

VIEWS = ("global", "wrist")
SEEN = ajar(VIEWS)
CLOSED = [17, 1, 2, 3, {"19": [0.0, 0.9]}, 5]
FAILED = [17, 1, 2, 3, {"19": [0.0, 0.5]}, 5]


def judged(transport: Transport, **options: object) -> tuple[Revision, Judges]:
    """Return the revision of a door that was left ajar, judged and revised by the model, and the judges."""
    both = judges(transport, name="server", views=VIEWS, **options)  # type: ignore[arg-type]
    critiques = [both.inspector.inspect(SEEN, step) for step in range(len(SEEN.steps))]
    told = Situation(SEEN.task, 3, scene("T1"), attempt_of(SEEN, critiques), History(3), observation=SEEN)
    answer = both.supervisor.revise(told)
    assert isinstance(answer, Revision), answer
    return answer, both


def critique(step: int) -> str:
    return as_reply(critique_answer(step, state_reached="no" if step == 5 else "unclear"))


@pytest.mark.parametrize("mode", ["json_schema", "json_object", "plain"])
def test_a_server_that_misbehaves_still_gives_an_admissible_revision(
    mode: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    acts: list[Act] = [
        fails(429, retry_after="0"),
        replies(f"I looked closely.\n```json\n{critique(1)}\n```"),
        replies(critique(2)),
        fails(500),
        replies(critique(3)),
        replies(critique(4)[:40]),
        replies(critique(4)),
        replies(f"<think>{{}}</think>{critique(5)}"),
        replies(critique(6)),
        replies(as_reply(revision_answer(FAILED))),
        replies(as_reply(revision_answer(CLOSED))),
    ]
    file = tmp_path / "run.jsonl"
    with ModelServer(*acts, key=KEY) as server:
        answer, both = judged(Recorder(transport_to(server, monkeypatch, mode=mode), file))
    assert flow_to_json(answer.flow) == CLOSED
    assert len(server.seen) == len(acts)
    # Each step with the one before it, two pictures a view, bit by bit; again with every question that is repeated.
    first = [picture for view in VIEWS for picture in SEEN.steps[0].frames[view]]
    second = [picture for view in VIEWS for picture in SEEN.steps[1].frames[view]]
    shown = [list(request.images) for request in server.seen]
    assert shown[0] == shown[1] == first
    assert shown[2] == first + second
    assert len(shown[-1]) == len(shown[-2]) == 6 * 2 * 2
    assert "attempt 1 ran the same flow" in server.seen[-1].texts[-1]
    assert KEY not in file.read_text() + str(both.conversation.to_json())
    again, _ = judged(Replay(file))
    assert again == answer


def test_a_replay_with_other_pictures_says_what_differs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "run.jsonl"
    with ModelServer(replies(critique(1)), key=KEY) as server:
        both = judges(Recorder(transport_to(server, monkeypatch), file), views=VIEWS)
        both.inspector.inspect(SEEN, 0)
    other = judges(Replay(file), views=("wrist",))
    with pytest.raises(ReplayMissing, match="was not recorded"):
        other.inspector.inspect(SEEN, 0)
