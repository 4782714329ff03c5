"""Runs whose plan comes from a model: over the wire once, then replayed without a server to the same state."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.executor.cli.conftest import Command
from tests.llm.live import BAD_PICTURES, KEY, KEY_VARIABLE, PNG
from tests.llm.model_server import Act, ModelServer, fails, replies
from tests.llm.scripted_modules import QUERIES, as_reply, right_answers

MODEL = "openai-compatible:m"


def point_to(server: ModelServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the command line talk to a server on this machine."""
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


def test_a_recording_whose_last_line_was_cut_off_is_said(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("run", "open the refrigerator", "--scene", "kitchen_t1", "--no-video")
    with ModelServer(*[replies(f"I would rather not, {turn}.") for turn in range(8)], key=KEY) as server:
        point_to(server, monkeypatch)
        command(*words, "--out", "live", "--model", MODEL)
    recording = tmp_path / "live" / "exchanges.jsonl"
    whole = command(*words, "--out", "whole", "--model", f"replay:{recording}")
    recording.write_bytes(recording.read_bytes()[:-20])
    cut = command(*words, "--out", "cut", "--model", f"replay:{recording}")
    assert "the last line was cut off" not in whole.err
    assert f"{recording}: the last line was cut off (" in cut.err and cut.err.count("is left out") == 1


def test_a_model_that_cannot_be_reached_ends_in_one_sentence(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ModelServer(*[fails(429, "slow down", retry_after="0.01")] * 8, key=KEY) as server:
        point_to(server, monkeypatch)
        answer = command(
            "run", "open the refrigerator", "--scene", "kitchen_t1", "--out", "r", "--model", MODEL, "--no-video"
        )
    # A colon on both sides of a name makes no picture of it.
    assert answer.code == 1 and f"{MODEL}: " in answer.err and KEY not in answer.err
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


def test_a_picture_of_the_scene_goes_along_with_the_query(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = tmp_path / "scene.png"
    picture.write_bytes(PNG)
    words = ("run", "open the refrigerator", "--scene", "kitchen_t1", "--no-video", "--image", str(picture))
    with ModelServer(replies("no idea"), key=KEY) as server:
        point_to(server, monkeypatch)
        answer = command(*words, "--out", "r", "--model", MODEL)
    assert answer.code == 1
    assert server.seen[0].images == (picture.read_bytes(),)
    with_nobody = command(*words, "--out", "s")
    assert with_nobody.code == 2 and "--model" in with_nobody.err and not (tmp_path / "s").exists()


@pytest.mark.parametrize("name", BAD_PICTURES)
def test_a_picture_that_nobody_can_look_at_is_refused_before_anything_is_sent(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    data, word = BAD_PICTURES[name]
    (tmp_path / "scene.png").write_bytes(data)
    words = ("run", "open the refrigerator", "--scene", "kitchen_t1", "--no-video", "--image", "scene.png")
    with ModelServer(replies("no idea"), key=KEY) as server:
        point_to(server, monkeypatch)
        answer = command(*words, "--out", "s", "--model", MODEL)
    assert answer.code == 2 and not server.seen and not (tmp_path / "s").exists()
    assert "scene.png" in answer.err and word in answer.err


def test_half_a_character_in_an_answer_is_asked_about_and_kept(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    half = b'{"choices": [{"message": {"content": "\\ud83d is no JSON"}, "finish_reason": "stop"}]}'
    with ModelServer(Act(body=half), key=KEY) as server:
        point_to(server, monkeypatch)
        answer = command(
            "run", "open the refrigerator", "--scene", "kitchen_t1", "--out", "r", "--model", MODEL, "--no-video"
        )
    assert answer.code == 1 and len(server.seen) == 4
    assert "\ufffd is no JSON" in server.seen[1].texts
    story = json.loads((tmp_path / "r" / "conversation.json").read_text())
    assert story["entries"][0]["reply"] == "\ud83d is no JSON"


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
