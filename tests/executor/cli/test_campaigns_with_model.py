"""Campaigns whose units a model plans: `generate` and `bench` against a server on this machine."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from executor.bench.folder import BenchFolder
from executor.campaign.planning_model import ModelPlan, PlanningModel
from executor.data.units import DemoUnit, Origin, Variation
from executor.scenes.generators.any_task import draw
from llm import AnswersRefused
from oag.sizes import Sizing
from tests.executor.cli.conftest import Command, environment
from tests.executor.cli.test_run_with_model import MODEL, point_to
from tests.llm.live import KEY
from tests.llm.model_server import Act, ModelServer, Seen, fails, replies
from tests.llm.scripted_modules import as_reply, right_answers

SENTENCE = "open the refrigerator"
OPEN = "(open refrigerator_0)"
OPENING: Mapping[int, Any] = {
    1: {
        "problem": "",
        "task_name": "open the refrigerator: refrigerator_0",
        "task_activity_name": "open_refrigerator",
        "task_message_detail": "Open the refrigerator.",
        "goal": OPEN,
    },
    2: {
        "sub_tasks": [
            {
                "sub_task": 1,
                "task_activity_name": "open_refrigerator",
                "task_detail_message": "Open the refrigerator.",
                "target": "refrigerator_0",
                "support_init": "",
                "support_goal": "",
                "bddl_category": "refrigerator",
            }
        ]
    },
    3: {"sub_tasks": [{"sub_task": 1, "init": f"(not {OPEN})", "goal": OPEN}]},
    5: {"sub_tasks": [{"sub_task": 1, "flow": [17, 1, 2, 3, 4, 5]}]},
}
WORDS = ("generate", SENTENCE, "--scene", "kitchen_t1", "--out", "d", "--model", MODEL)


def module_of(seen: Seen) -> int:
    """Return which module asks."""
    return next(number for number in range(1, 6) if f"Module {number} of 5" in "".join(seen.texts))


def answering(answers: Mapping[int, Any], before: Callable[[int], Act | None] = lambda number: None) -> Any:
    """Return what a server's model does: it answers by module, unless the number of the request has another act."""
    asked = Counter[str]()

    def decide(seen: Seen) -> Act:
        asked["all"] += 1
        return before(asked["all"]) or replies(as_reply(answers[module_of(seen)]))

    return decide


def units_of(store: Path) -> list[dict[str, Any]]:
    """Return the records of a store's units."""
    return [json.loads(path.read_text()) for path in sorted(store.glob("units/*/unit.json"))]


def written_in(folder: Path) -> str:
    """Return all texts of a folder."""
    return "".join(path.read_bytes().decode("utf-8", "replace") for path in folder.rglob("*") if path.is_file())


@pytest.mark.physics
@pytest.mark.slow
def test_a_model_plans_each_unit_and_is_asked_once(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = (*WORDS, "--episodes", "2", "--workers", "2", "--json")
    with ModelServer(decide=answering(OPENING), key=KEY) as server:
        point_to(server, monkeypatch)
        first = command(*words)
        asked = len(server.seen)
        again = command(*words)
        assert len(server.seen) == asked == 8
    assert first.code == 0 and first.data["endings"] == {"succeeded": 2}
    for data in (first.data, again.data):
        usage = data["usage"]
        assert usage["requests"] == 8 and usage["input_tokens"] > 100 and usage["cost_usd"] is None
    for unit in units_of(tmp_path / "d"):
        assert unit["model"]["name"] == MODEL and unit["model"]["requests"] == 4
        assert unit["unit"]["model"]["name"] == MODEL and len(unit["unit"]["model"]["templates"]) == 16
    assert len(list((tmp_path / "d" / "answers").glob("*/exchanges.jsonl"))) == 2
    assert KEY not in written_in(tmp_path / "d") + first.out + first.err + again.out
    # Another temperature may answer otherwise.
    with ModelServer(replies("no"), key=KEY) as server:
        point_to(server, monkeypatch)
        command(*words, "--temperature", "0.5")
        assert server.seen


def test_a_unit_whose_answers_do_not_hold_is_a_failed_one(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = (*WORDS, "--episodes", "1", "--workers", "1")
    with ModelServer(replies("I would rather not."), key=KEY) as server:
        point_to(server, monkeypatch)
        answer, asked = command(*words, "--json"), len(server.seen)
        assert command(*words).code == 1 and len(server.seen) == asked
    assert answer.code == 1 and answer.data["failures"] == {"answers-refused": 1}
    (unit,) = units_of(tmp_path / "d")
    assert unit["ended"] == "failed" and "module 1" in unit["failure"]["message"]
    assert unit["model"]["requests"] == asked


def test_a_budget_is_one_of_the_whole_campaign(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = (*WORDS, "--episodes", "4", "--workers", "2", "--json")
    with ModelServer(decide=answering({**OPENING, 1: "no"}), key=KEY) as server:
        point_to(server, monkeypatch)
        answer = command(*words, "--max-tokens", "1")
        # Each process may send the request that exceeds it, and no more.
        assert 1 <= len(server.seen) <= 2
        asked = len(server.seen)
        assert command(*words, "--max-tokens", "1").code == 1 and len(server.seen) == asked
    assert answer.code == 1 and answer.data["stopped_by"] == "model budget" and not answer.data["endings"]
    assert not units_of(tmp_path / "d") and answer.data["usage"]["requests"] == asked
    unknown = command(*words, "--max-cost-usd", "1")
    assert unknown.code == 2 and "price" in unknown.err + unknown.out


def test_a_limit_in_dollars_stops_and_a_higher_one_goes_on(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    profiles = tmp_path / "models.toml"
    profiles.write_text("[openai-compatible.models.m]\nprice = { input = 1, output = 2 }\n")
    monkeypatch.setenv("SCENE2DEMO_PROFILES", str(profiles))
    words = (*WORDS, "--episodes", "1", "--workers", "1")
    with ModelServer(decide=answering({**OPENING, 2: "I would rather not."}), key=KEY) as server:
        point_to(server, monkeypatch)
        first = command(*words, "--max-cost-usd", "0.000001")
        assert [module_of(seen) for seen in server.seen] == [1]
        assert first.code == 1 and "model budget is used up" in " ".join(first.err.split())
        assert "with a higher limit goes on" in " ".join(first.err.split())
        assert "1 request" in first.out and "$0.00" in first.out
        second = command(*words, "--max-cost-usd", "1", "--json")
        # Module 1 was paid for.
        assert {module_of(seen) for seen in server.seen[1:]} == {2}
    usage = second.data["usage"]
    assert second.data["failures"] == {"answers-refused": 1} and usage["requests"] == len(server.seen)
    spent_usd = (usage["input_tokens"] + 2 * usage["output_tokens"]) / 1e6
    assert usage["cost_usd"] == pytest.approx(spent_usd)
    (unit,) = units_of(tmp_path / "d")
    assert unit["model"]["cost_usd"] == pytest.approx(spent_usd)


def test_a_dead_server_ends_the_campaign(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = (*WORDS, "--episodes", "9", "--workers", "1", "--json")
    with ModelServer(fails(400, "no such model"), key=KEY) as server:
        point_to(server, monkeypatch)
        answer = command(*words)
        assert len(server.seen) == 3
        assert command(*words).data["stopped_by"] == "model" and len(server.seen) == 6
    assert not units_of(tmp_path / "d")
    assert answer.code == 1 and answer.data["stopped_by"] == "model"
    assert answer.data["endings"] == {"error": 3} and answer.data["failures"] == {"model-failed": 3}


def _children(process: int) -> list[int]:
    """Return the processes that a process has started."""
    texts = (path.read_text() for path in Path(f"/proc/{process}/task").glob("*/children"))
    return [int(word) for text in texts for word in text.split()]


@pytest.mark.physics
@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="the system does not tell which processes there are")
@pytest.mark.parametrize("worker_lives", [False, True])
def test_what_a_killed_campaign_paid_is_not_asked_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, worker_lives: bool
) -> None:
    words = [sys.executable, "-m", "executor", *WORDS, "--episodes", "1", "--workers", "1", "--json"]
    with ModelServer(
        decide=answering(OPENING, lambda number: Act(as_reply(OPENING[3]), wait_s=15.0) if number == 3 else None),
        key=KEY,
    ) as server:
        point_to(server, monkeypatch)
        process = subprocess.Popen(words, cwd=tmp_path, env=environment())
        until = time.monotonic() + 120.0
        while len(server.seen) < 3 and time.monotonic() < until:
            time.sleep(0.05)
        workers = _children(process.pid)
        for one in (process.pid, *(() if worker_lives else workers)):
            os.kill(one, signal.SIGKILL)
        process.wait()
        assert len(server.seen) == 3 and not units_of(tmp_path / "d")
        done = subprocess.run(words, cwd=tmp_path, env=environment(), capture_output=True, timeout=300, check=False)
        # The third answer, of module 3, comes late; a worker that lives waits for it, and goes on to module 5.
        assert [module_of(seen) for seen in server.seen[3:]] == ([5] if worker_lives else [3, 5])
    assert done.returncode == 0, done.stderr
    (unit,) = units_of(tmp_path / "d")
    assert unit["ended"] == "succeeded" and unit["model"]["requests"] == 4
    # A request whose answer was lost with its process was not counted.
    assert json.loads(done.stdout)["usage"]["requests"] == 4


@pytest.mark.physics
@pytest.mark.slow
def test_a_bench_says_what_a_model_proved_and_took(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = right_answers("T3")
    answers[5]["sub_tasks"][0]["flow"] = [17, 1, 2, 3, {"7": 0.2}]
    for part in answers[2]["sub_tasks"]:
        part["bddl_category"] = "half_apple"  # As this seed's scene calls it.
    words = ("bench", "T3", "--seed", "14002", "--episodes", "1", "--workers", "1", "--out", "b", "--model", MODEL)
    with ModelServer(decide=answering(answers), key=KEY) as server:
        point_to(server, monkeypatch)
        summary = command(*words, "--json")
        asked = len(server.seen)
        text = command(*words)
        assert len(server.seen) == asked
    (cell,) = summary.data["cells"]
    assert cell["proved"]["successes"] == 1 and cell["model"]["requests"] == asked == summary.data["usage"]["requests"]
    assert cell["setting"]["model"]["name"] == MODEL and "planned by openai-compatible:m" in text.out
    assert "plan proved, of those asked for" in text.out and f"{asked} requests" in text.out
    (path,) = (tmp_path / "b" / "units").glob("*.json")
    again = command("bench", "replay", "b", path.name, "--out", "again", "--no-video", "--json")
    assert again.data["same_states"] is True
    assert KEY not in written_in(tmp_path / "b") + summary.out + text.out + text.err


@pytest.mark.parametrize("folder", ["b c", "b,openai:gpt-5.2"])
def test_a_wish_is_planned_again_by_its_answers(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str
) -> None:
    words = ("bench", "T7", "--seed", "3", "--episodes", "1", "--workers", "1", "--out", folder, "--model", MODEL)
    with ModelServer(replies("I would rather not."), key=KEY) as server:
        point_to(server, monkeypatch)
        summary = command(*words, "--temperature", "0.5", "--json")
        asked = len(server.seen)
    (cell,) = summary.data["cells"]
    assert cell["proved"]["trials"] == 1 and cell["proved"]["successes"] == 0
    bench = BenchFolder(tmp_path / folder)
    (series,) = bench.series()
    (result,) = bench.results(series)
    commands = [shlex.split(words) for _, words in bench.commands(result)]
    # A path with a provider in it names no recording; what repeats units takes the path itself.
    assert len(commands) == ("," not in folder)
    for shown in commands:
        answer = command(*shown[1:], "--json")
        assert answer.code == summary.code == 1 and asked > 1
        told, recorded = answer.data["error"]["message"], result["failure"]["message"]
        # It names the recording in place of the model.
        assert told.partition(" does not solve ")[2] == recorded.partition(" does not solve ")[2] != ""
    refusal = command("bench", "replay", folder, result["name"])
    assert refusal.code == 2 and ("replay:" in refusal.err) is bool(commands)
    wish = draw(result["seed"])
    model = PlanningModel(MODEL, temperature=0.5)
    with pytest.raises(AnswersRefused) as refused:
        ModelPlan.repeated(model, bench.answers(result))(wish.query, wish.scene, Sizing(keep=True))
    assert str(refused.value) == result["failure"]["message"]


@pytest.mark.parametrize("before", [WORDS, ("bench", "T1", "--out", "d", "--model", MODEL)])
def test_usage_that_cannot_be_read_ends_the_command(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: tuple[str, ...]
) -> None:
    (tmp_path / "d" / "answers").mkdir(parents=True)
    (tmp_path / "d" / "answers" / "used.json").write_text("{")
    with ModelServer(replies("no"), key=KEY) as server:
        point_to(server, monkeypatch)
        answer = command(*before, "--episodes", "1")
        assert not server.seen
    assert answer.code == 2 and "does not say what was used" in " ".join(answer.err.split())
    assert [path.name for path in (tmp_path / "d").iterdir()] == ["answers"]


def test_a_file_of_a_model_is_checked_before_the_first_unit(command: Command, tmp_path: Path) -> None:
    (tmp_path / "a.gguf").write_text("text")
    for name, problem in (("none.gguf", "cannot be read"), ("a.gguf", "no GGUF file")):
        answer = command("bench", "T1", "--episodes", "1", "--workers", "1", "--model", f"local:{name}", "--out", "d")
        assert answer.code == 2 and problem in " ".join(answer.err.split())
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--repair", "scene"), "--repair"),
        (("--vary", "target"), "target"),
        (("--models", "supervisor=openai-compatible:n"), "modules 1 to 5"),
    ],
)
def test_what_needs_the_offline_planner_is_refused(
    command: Command, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], named: str
) -> None:
    with ModelServer(replies("no"), key=KEY) as server:
        point_to(server, monkeypatch)
        answer = command(*WORDS, *words)
        assert not server.seen
    assert answer.code == 2 and named in answer.err


def test_options_of_a_model_need_one(command: Command) -> None:
    for command_words in (("generate", SENTENCE, "--scene", "kitchen_t1"), ("bench", "T1")):
        answer = command(*command_words, "--out", "d", "--max-cost-usd", "1")
        assert answer.code == 2 and "--max-cost-usd" in answer.err and "--model" in answer.err


def test_a_units_id_follows_from_its_model() -> None:
    origin = Origin(query=SENTENCE, scene="kitchen_t1")
    models = [
        None,
        PlanningModel(MODEL),
        PlanningModel(MODEL, temperature=0.5),
        PlanningModel(MODEL, seed=1),
        PlanningModel(MODEL, models=((3, "openai:gpt-5.2"),)),
        PlanningModel(MODEL, templates="0" * 16),
    ]
    units = [DemoUnit(origin, 0, model=model) for model in models]
    assert len({unit.id("v") for unit in units}) == len(models)
    for unit in units:
        assert DemoUnit.from_json(json.loads(json.dumps(unit.to_json()))) == unit
    assert "model" not in units[0].to_json()
    with pytest.raises(ValueError, match="neither its target varies"):
        DemoUnit(origin, 0, variation=Variation(target=True), model=PlanningModel(MODEL))
