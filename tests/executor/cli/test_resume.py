"""Runs with a model that ended early: what was paid for is used again, nothing is asked twice, all of it is shown."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from executor.cli import app
from executor.records import Rollout
from executor.reports.run_folder import RunFolder
from tests.executor.cli.conftest import environment
from tests.executor.cli.judge_server import point_to
from tests.executor.cli.test_full_disk import room_for
from tests.executor.recordings import invented_rollout
from tests.llm.live import KEY
from tests.llm.model_server import Act, ModelServer, Seen, fails, replies
from tests.llm.scripted_modules import QUERIES, as_reply, right_answers

MODEL = "openai-compatible:m"
# The scene with models calls its refrigerator by its full name.
ANSWERS = [as_reply(answer).replace('"fridge"', '"refrigerator"') for answer in right_answers("T1").values()]


class Answering:
    """A server's model that answers the five modules rightly, except where an act is put in its place.

    Attributes:
        acts: Position of a request, from 0 -> what happens then.
        asked: How many requests came.
    """

    def __init__(self, acts: dict[int, Act] | None = None) -> None:
        self.acts, self.asked = acts or {}, 0

    def __call__(self, seen: Seen) -> Act:
        self.asked += 1
        (module,) = (n for n in range(1, 6) if f"Module {n} of 5" in seen.texts[1] + seen.texts[0])
        return self.acts.get(self.asked - 1) or replies(ANSWERS[module - 1])


@pytest.fixture
def invented(monkeypatch: pytest.MonkeyPatch) -> Rollout:
    """Make rollouts cost nothing."""
    recorded = invented_rollout()
    monkeypatch.setattr(
        "executor.rollouts.rollout.rollout", lambda graph, scene, seed, **_: replace(recorded, seed=seed)
    )
    return recorded


def run(out: Path, *words: str, query: str = QUERIES["T1"]) -> int:
    # The paper's numbers leave the door ajar, which geometry knows; here a recorded rollout stands for the physics.
    words = ("--model", MODEL, "--no-video", "--anyway", *words)
    return app.run(["run", query, "--scene", "kitchen_t1", "--out", str(out), *words])


def answers_in(file: Path) -> int:
    return sum("reply" in json.loads(line) for line in file.read_text().splitlines())


@pytest.mark.usefixtures("invented")
def test_rounds_with_seconds_tokens_and_cost_are_in_text_json_and_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with ModelServer(decide=Answering(), key=KEY) as server:
        point_to(server, monkeypatch)
        run(tmp_path / "text")
        text = capsys.readouterr()
        (tmp_path / "p.toml").write_text(
            '[openai-compatible.models.m]\nprice = { input = 2.0, output = 10.0, date = "2026-11-01" }\n'
        )
        monkeypatch.setenv("SCENE2DEMO_PROFILES", str(tmp_path / "p.toml"))
        run(tmp_path / "json", "--json")
        priced = json.loads(capsys.readouterr().out)["usage"]
    rounds = [line for line in text.err.splitlines() if line.startswith("  module ")]
    assert len(rounds) == 5 and all("round 1" in line and " tokens, price unknown" in line for line in rounds)
    assert "5 requests" in text.out and "cost unknown" in text.out
    page = (tmp_path / "text" / "report.html").read_text()
    assert page.count("price unknown") == 5 and "What the model took" in page
    assert [entry["asked_by"] for entry in priced["rounds"]] == [f"module {number}" for number in range(1, 6)]
    for entry in priced["rounds"]:
        assert entry["seconds"] > 0 and not entry["recorded"]
        assert entry["cost_usd"] == pytest.approx((2 * entry["input_tokens"] + 10 * entry["output_tokens"]) / 1e6)
    assert priced["cost_usd"] == pytest.approx(sum(entry["cost_usd"] for entry in priced["rounds"]))
    kept = json.loads((tmp_path / "json" / "usage.json").read_text())
    assert {**kept, "elapsed_s": 0.0} == {**priced, "elapsed_s": 0.0}
    assert priced["price"] == {"input": 2.0, "output": 10.0, "date": "2026-11-01"}
    assert "list prices of 2026-11-01" in (tmp_path / "json" / "report.html").read_text()


@pytest.mark.usefixtures("invented")
@pytest.mark.parametrize("after", range(5))
def test_a_run_whose_server_failed_goes_on_and_asks_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], after: int
) -> None:
    out, model = tmp_path / "r", Answering({after: fails(400, "no")})
    with ModelServer(decide=model, key=KEY) as server:
        point_to(server, monkeypatch)
        assert run(out) == 1
        told = capsys.readouterr().err
        assert f"{after + 1} request" in told and ("--resume" in told) == (after > 0)
        # Typed again, nothing is asked or replaced.
        assert run(out) == 2 and model.asked == after + 1
        assert "--resume" in capsys.readouterr().err
        assert run(out, "--resume", "--json") == 0
    usage = json.loads(capsys.readouterr().out)["usage"]
    assert model.asked == 6 and usage["recorded"] == after and len(usage["rounds"]) == 5
    assert answers_in(out / "exchanges.jsonl") == 5
    again = app.run(
        [
            "run",
            "--anyway",
            QUERIES["T1"],
            "--scene",
            "kitchen_t1",
            "--out",
            str(tmp_path / "again"),
            "--no-video",
            "--json",
            "--anyway",
        ]
        + ["--model", f"replay:{out / 'exchanges.jsonl'}"]
    )
    replayed = json.loads(capsys.readouterr().out)["usage"]
    assert again == 0 and replayed["recorded"] == 5 and replayed["cost_usd"] == 0.0


def test_a_failure_tells_what_was_used_as_json_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with ModelServer(decide=Answering({2: fails(400, "no")}), key=KEY) as server:
        point_to(server, monkeypatch)
        assert run(tmp_path / "r", "--json") == 1
    told = json.loads(capsys.readouterr().out)
    assert told["error"]["kind"] == "ModelRefused"
    assert (told["usage"]["requests"], told["usage"]["failures"], len(told["usage"]["rounds"])) == (3, 1, 2)


@pytest.mark.parametrize("ending", [signal.SIGKILL, pytest.param(signal.SIGINT, marks=pytest.mark.slow)])
def test_a_run_that_was_ended_from_outside_goes_on(
    invented: Rollout,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    ending: signal.Signals,
) -> None:
    out, model = tmp_path / "r", Answering({2: replies("{}", wait_s=30.0)})
    with ModelServer(decide=model, key=KEY) as server:
        point_to(server, monkeypatch)
        words = ["run", QUERIES["T1"], "--scene", "kitchen_t1", "--out", str(out), "--model", MODEL, "--no-video"]
        process = subprocess.Popen(
            [sys.executable, "-m", "executor", *words], env=environment(), stderr=subprocess.PIPE, text=True
        )
        for _ in range(1_200):
            if model.asked > 2 or process.poll() is not None:
                break
            server.closing.wait(0.05)
        os.kill(process.pid, ending)
        _, said = process.communicate(timeout=60)
        assert model.asked == 3
        if ending is signal.SIGINT:
            assert process.returncode == 130 and "--resume" in said and "2 failed" not in said
        assert run(out, "--resume") == 0
    assert model.asked == 3 + 3 and answers_in(out / "exchanges.jsonl") == 5


def test_a_full_disk_costs_no_answer(
    invented: Rollout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, model = tmp_path / "r", Answering()
    write_report = RunFolder.write_report

    def is_disk_full(self: RunFolder, *arguments: Any) -> None:
        with room_for(50):
            write_report(self, *arguments)

    with ModelServer(decide=model, key=KEY) as server:
        point_to(server, monkeypatch)
        with room_for(280_000):
            assert run(out) == 3
        asked = model.asked
        assert asked == answers_in(out / "exchanges.jsonl") < 5
        monkeypatch.setattr(RunFolder, "write_report", is_disk_full)
        assert run(out, "--resume") == 3 and model.asked == 5
        assert "--resume goes on from it" in capsys.readouterr().err
        assert [path.name for path in out.iterdir()] == ["exchanges.jsonl"]
        monkeypatch.setattr(RunFolder, "write_report", write_report)
        assert run(out, "--resume") == 0
    assert model.asked == 5


def test_force_keeps_what_was_paid_for_and_says_where(
    invented: Rollout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, model = tmp_path / "r", Answering()
    with ModelServer(decide=model, key=KEY) as server:
        point_to(server, monkeypatch)
        run(out)
        paid = (out / "exchanges.jsonl").read_bytes()
        assert run(out, "--force", "--resume") == 2 and "--resume" in capsys.readouterr().err
        run(out, "--force")
        assert model.asked == 10
    kept = out / "exchanges_2.jsonl"
    assert f"kept in {kept}" in capsys.readouterr().err and kept.read_bytes() == paid
    # A recording that is replayed into its own folder is not lost either.
    words = ["run", QUERIES["T1"], "--scene", "kitchen_t1", "--out", str(out), "--no-video", "--force"]
    assert app.run([*words, "--anyway", "--model", f"replay:{out / 'exchanges.jsonl'}"]) == 0
    assert {path.name for path in out.glob("exchanges*")} == {"exchanges_2.jsonl", "exchanges_3.jsonl"}


def test_another_run_is_not_gone_on_with_and_loses_nothing(
    invented: Rollout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, model = tmp_path / "r", Answering()
    with ModelServer(decide=model, key=KEY) as server:
        point_to(server, monkeypatch)
        run(out)
        before = {path.name: path.read_bytes() for path in out.iterdir()}
        assert run(out, "--resume", query="open the refrigerator") == 2
        assert f"not of {QUERIES['T1']!r}" in capsys.readouterr().err
        (out / "proposal.json").unlink()
        del before["proposal.json"]
        assert run(out, "--resume", query="open the refrigerator") == 2
        assert "another run's" in capsys.readouterr().err and model.asked == 5
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
