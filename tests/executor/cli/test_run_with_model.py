"""Runs whose plan comes from a model: over the wire once, then replayed without a server to the same state."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.executor.cli.conftest import Command
from tests.llm.live import KEY, KEY_VARIABLE
from tests.llm.model_server import ModelServer, fails, replies
from tests.llm.scripted_modules import QUERIES, as_reply, right_answers

MODEL = "openai-compatible:test-model"


def point_to(server: ModelServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes the command line talk to a server on this machine."""
    monkeypatch.setenv("SCENE2DEMO_MODEL_URL", server.address)
    monkeypatch.setenv(KEY_VARIABLE, KEY)


@pytest.mark.physics
@pytest.mark.slow
def test_a_recorded_run_replays_to_the_same_state(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The scene with models calls its refrigerator by its full name.
    acts = [replies(as_reply(answer).replace('"fridge"', '"refrigerator"')) for answer in right_answers("T1").values()]
    with ModelServer(*acts, key=KEY) as server:
        point_to(server, monkeypatch)
        live = command(
            "run", QUERIES["T1"], "--scene", "kitchen_t1", "--out", "live", "--model", MODEL, "--no-video", "--json"
        )
    written = "".join(path.read_text() for path in (tmp_path / "live").glob("*.json*"))
    assert KEY not in written + live.out + live.err
    replay = f"replay:{tmp_path / 'live' / 'exchanges.jsonl'}"
    again = command(
        "run", QUERIES["T1"], "--scene", "kitchen_t1", "--out", "again", "--model", replay, "--no-video", "--json"
    )
    # The paper's own numbers do not close the door in physics; what counts here is that both runs are the same.
    assert live.code == again.code and live.data["verdict"] == again.data["verdict"] == "PROVED"
    assert live.data["rollout"]["state_hash"] == again.data["rollout"]["state_hash"]
    assert not (tmp_path / "again" / "exchanges.jsonl").exists()


def test_a_model_that_cannot_be_reached_ends_in_one_sentence(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ModelServer(*[fails(500)] * 8, key=KEY) as server:
        point_to(server, monkeypatch)
        answer = command(
            "run", "open the refrigerator", "--scene", "kitchen_t1", "--out", "r", "--model", MODEL, "--no-video"
        )
    assert answer.code == 1 and MODEL in answer.err and KEY not in answer.err
    assert (tmp_path / "r" / "conversation.json").is_file()


def test_answers_that_never_hold_end_with_what_was_wrong(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ModelServer(*[replies(f"I would rather not, {turn}.") for turn in range(8)], key=KEY) as server:
        point_to(server, monkeypatch)
        answer = command(
            "run", "open the refrigerator", "--scene", "kitchen_t1", "--out", "r", "--model", MODEL, "--no-video"
        )
    assert answer.code == 1 and "module 1" in answer.err.lower()
    story = json.loads((tmp_path / "r" / "conversation.json").read_text())
    assert len(story["entries"]) > 1


@pytest.mark.parametrize(
    ("model", "word"),
    [
        ("openia:gpt-5.2", "openai"),
        ("openai", "provider:model"),
        ("replay:missing.jsonl", "missing.jsonl"),
        ("openai:gpt-5.2", "OPENAI_API_KEY"),
    ],
)
def test_a_model_that_is_not_configured_is_misuse(
    command: Command, monkeypatch: pytest.MonkeyPatch, model: str, word: str
) -> None:
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    answer = command(
        "run", "open the refrigerator", "--scene", "kitchen_t1", "--out", "r", "--model", model, "--no-video"
    )
    assert answer.code == 2 and word in answer.err
