"""What a model was asked and answered is printed for people; `plan` asks a model, and goes on from a recording."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from executor.cli import app
from tests.executor.cli.judge_server import point_to
from tests.executor.cli.test_resume import MODEL, Answering
from tests.llm.live import KEY
from tests.llm.model_server import ModelServer, fails, replies
from tests.llm.scripted_modules import QUERIES


@pytest.fixture(autouse=True)
def _nothing_is_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("executor.rollouts.feasibility.feasible", lambda *_, **__: None)


def planned(*words: str) -> int:
    return app.run(["plan", QUERIES["T1"], "--scene", "kitchen_t1", "--model", MODEL, *words])


def test_a_plan_by_a_model_is_recorded_resumed_and_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, more = tmp_path / "run.jsonl", tmp_path / "more.jsonl"
    model = Answering({0: replies('{"goal": "(open refrigerator_0)"}'), 3: fails(400, "no\x1b[31m")})
    with ModelServer(decide=model, key=KEY) as server:
        point_to(server, monkeypatch)
        assert planned("--record", str(file), "--temperature", "0.5", "--model-seed", "3") == 1
        assert [(seen.body["temperature"], seen.body["seed"]) for seen in server.seen] == [
            (temperature, 3) for temperature in (0.5, 0.5, 0.5, 0.5)
        ]
        capsys.readouterr()
        assert planned("--record", str(file)) == 2 and "does not exist yet" in capsys.readouterr().err
        words = ["--model", f"replay:{file},{MODEL}", "--models", f"5={MODEL}x", "--record", str(more), "--json"]
        words += ["--temperature", "0.5", "--model-seed", "3"]
        app.run(["plan", QUERIES["T1"], "--scene", "kitchen_t1", *words])
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert told["verdict"] == "PROVED" and told["usage"]["recorded"] == 3 and model.asked == 4 + 3
    assert [entry["asked_by"] for entry in told["usage"]["rounds"]] == [f"module {n}" for n in (1, 1, 2, 3, 4, 5)]
    assert [seen.body["model"] for seen in server.seen][-2:] == ["m", "mx"]

    assert app.run(["conversation", str(file)]) == 0
    text = capsys.readouterr().out
    assert "1. module 1: answered" in text and "4. module 3: no reply" in text and "4 rounds" in text
    assert '  "goal": "(open refrigerator_0)"' in text and "\x1b[31m" not in text and "> system" not in text
    assert app.run(["conversation", str(file), "--prompts", "--round", "2"]) == 0
    text = capsys.readouterr().out
    assert "> system: You plan for a mobile robot" in text and "1. module 1" not in text
    assert app.run(["conversation", str(file), "--round", "9"]) == 2
    assert "a round from 1 to 4" in capsys.readouterr().err
    with file.open("a") as more_text:
        more_text.write('{"half')
    assert app.run(["conversation", str(file), "--json", "--round", "2"]) == 0
    printed = capsys.readouterr()
    ((entry,),) = [one["entries"] for one in json.loads(printed.out)["conversations"]]
    assert entry["number"] == 2 and "note: " in printed.err


def test_a_conversation_of_a_run_has_findings_verdicts_and_versions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with ModelServer(replies("I would rather not."), key=KEY) as server:
        point_to(server, monkeypatch)
        words = ["--scene", "kitchen_t1", "--out", str(tmp_path / "r"), "--model", MODEL, "--no-video"]
        assert app.run(["run", "open the refrigerator", *words]) == 1
    capsys.readouterr()
    written = json.loads((tmp_path / "r" / "conversation.json").read_text())
    assert written["version"] and all(len(entry["template_sha256"]) == 64 for entry in written["entries"])
    made_by = json.loads((tmp_path / "r" / "exchanges.jsonl").read_text().splitlines()[0])["made_by"]
    assert made_by == {"module": 1, "template": written["entries"][0]["template_sha256"], "version": written["version"]}
    assert app.run(["conversation", str(tmp_path / "r"), "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["conversations"]
    assert {entry["outcome"] for entry in told["entries"]} == {"refused"}
    assert "answer/no-json" in told["entries"][0]["findings"][0]


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("c.json", "{}", "it is no conversation"),
        ("c.json", "[" * 100_000, "cannot be read"),
        ("c.jsonl", "{}\n", "line 1 is no recorded exchange"),
        ("r/x", "", "the folder has no conversation"),
    ],
)
def test_what_is_no_conversation_is_refused(
    name: str, content: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(content)
    assert app.run(["conversation", str(path if path.parent == tmp_path else path.parent)]) == 2
    assert said in capsys.readouterr().err
