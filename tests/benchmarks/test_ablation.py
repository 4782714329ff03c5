"""`benchmarks.ablation`: the settings that it runs, what the model is shown in each, and the table."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import oag
from benchmarks import ablation
from executor.cli import evolution_setup
from executor.cli.evolution_setup import EvolutionSetup
from executor.cli.options import JudgeOptions
from executor.system import vulkan
from executor.system.files import write_json
from llm import Metered
from llm.evolve import Situation
from llm.structured.conversation import Spending
from tests.executor.cli.conftest import scene_of
from tests.executor.cli.judge_server import MODEL, judging_server, point_to
from tests.executor.rollouts.tasks import closing
from tests.llm.evolve.scripted_judges import Judge, ajar, attempt_of, revision_answer
from tests.llm.model_server import ModelServer, fails
from tests.oag.paper import scene

VIEWS = ("global", "head", "wrist")
CLOSED = revision_answer([17, 1, 2, 3, {"19": [0.0, 0.9]}, 5])


def one_attempt(*arguments: Any, inspector: Any, supervisor: Any, **options: Any) -> Any:
    """Stands for an evolution: a door that was left ajar is judged and revised once, and then closed."""
    seen = ajar(VIEWS)
    critiques = [inspector.inspect(seen, step) for step in range(len(seen.steps))]
    told = Situation(seen.task, 3, scene("T1"), attempt_of(seen, critiques), oag.History(3), observation=seen)
    solved = isinstance(supervisor.revise(told), oag.Revision)
    return SimpleNamespace(succeeded=solved, succeeded_at_once=False, revisions=int(solved))


@pytest.fixture
def door(tmp_path: Path) -> Path:
    """A task file whose flow leaves a refrigerator's door ajar; its scene is beside it, see `scene_of`."""
    graph = closing()
    write_json(tmp_path / "kitchen.json", graph.scene.to_json())
    return write_json(tmp_path / "task.json", graph.task.to_json())


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the physics and the renderer out of the command."""
    monkeypatch.setattr(evolution_setup, "evolve", one_attempt)
    monkeypatch.setattr(vulkan, "find_renderer", lambda: vulkan.Renderer("system", "a stub"))


def run(what: str, task: Path, *words: str) -> int:
    return ablation.main([what, str(task), "--scene", scene_of(task), "--seed", "17001", *words])


@pytest.mark.usefixtures("quick")
def test_a_model_that_cannot_be_connected_to_costs_nobody_an_earlier_recording(
    door: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    (tmp_path / "exchanges.jsonl").write_text("paid for\n")
    for model in ("openai:gpt-5.2", "nobody:nothing"):
        assert run("views", door, "--model", model, "--out", str(tmp_path), "--force") == 2
    assert (tmp_path / "exchanges.jsonl").read_text() == "paid for\n"


def test_what_was_said_before_a_resumption_is_kept(tmp_path: Path) -> None:
    for _ in range(2):
        options = JudgeOptions(model="a:b", views="none")
        with EvolutionSetup(options, tmp_path, resume=True, spending=Spending(Metered(Judge()))) as evolution_setup:
            evolution_setup.judges("put it away", scene("T1"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["conversations.json", "conversations_2.json"]


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_the_views_are_compared_over_the_wire(
    door: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with judging_server(CLOSED, lambda text, step: step == 5) as server:
        point_to(server, monkeypatch)
        assert run("views", door, "--model", MODEL, "--out", str(out)) == 0
    table = capsys.readouterr().out
    assert [line.split("|")[1].strip() for line in table.splitlines()[2:9]] == [
        "G", "H", "W", "G,H", "G,W", "H,W", "G,H,W"
    ]  # fmt: skip
    told = json.loads((out / "ablation.json").read_text())
    assert told["schema"] == "scene2demo-ablation/1" and told["what"] == "views"
    assert [row["questions"] for row in told["rows"]] == [7] * 7
    assert all((row["trials"], row["successes_after"], row["revisions_mean"]) == (1, 1, 1.0) for row in told["rows"])
    assert all(row["input_tokens"] > 0 and row["latency_s_mean"] > 0 for row in told["rows"])
    # Two pictures of each view for a step and the one before it.
    assert [len(server.seen[7 * k + 1].images) for k in range(7)] == [4, 4, 4, 8, 8, 8, 12]
    assert run("views", door, "--model", MODEL, "--out", str(out)) == 2


@pytest.mark.usefixtures("quick")
def test_the_windows_are_compared_and_replay_without_a_server(
    door: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with judging_server(CLOSED, lambda text, step: step == 5) as server:
        point_to(server, monkeypatch)
        assert run("look-back", door, "--model", MODEL, "--views", "head", "--out", str(out), "--json") == 0
    live = json.loads(capsys.readouterr().out)
    assert [(row["views"], row["look_back"]) for row in live["rows"]] == [(["head"], n) for n in (0, 1, 2)]
    assert [len(server.seen[7 * k + 3].images) for k in range(3)] == [2, 4, 6]
    replay = f"replay:{out / 'exchanges.jsonl'}"
    assert run("look-back", door, "--model", replay, "--views", "head", "--json") == 0
    again = json.loads(capsys.readouterr().out)
    assert again["rows"] == live["rows"]


@pytest.mark.usefixtures("quick")
def test_a_model_that_stops_ends_it_with_what_there_is(
    door: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with ModelServer(fails(400, "no more")) as server:
        point_to(server, monkeypatch)
        assert run("look-back", door, "--model", MODEL, "--json") == 1
    told = json.loads(capsys.readouterr().out)
    assert len(told["rows"]) == 1 and "no more" in told["rows"][0]["stopped"]


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("finished", "rows"), [(0, []), (3, [2, 1]), (4, [2, 2])])
def test_ctrl_c_leaves_a_table_of_what_was_finished(
    door: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    finished: int,
    rows: list[int],
) -> None:
    left = iter([True] * finished)

    def until_ctrl_c(*arguments: Any, **options: Any) -> Any:
        if not next(left, False):
            raise KeyboardInterrupt
        return one_attempt(*arguments, **options)

    monkeypatch.setattr(evolution_setup, "evolve", until_ctrl_c)
    out = tmp_path / "out"
    with judging_server(CLOSED, lambda text, step: step == 5) as server:
        point_to(server, monkeypatch)
        assert run("look-back", door, "--model", MODEL, "--episodes", "2", "--out", str(out)) == 130
    words = capsys.readouterr()
    assert words.err.count("interrupted") == 1 and "Traceback" not in words.err
    assert (out / "ablation.json").exists() is bool(rows)
    if rows:
        told = json.loads((out / "ablation.json").read_text())
        assert [row["trials"] for row in told["rows"]] == rows
        assert len(words.out.splitlines()) >= 2 + len(rows)
    assert len(json.loads((out / "conversations.json").read_text())) == finished + 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["views"], "--model"),
        (["views", "--model", MODEL, "--views", "head"], "--views"),
        (["look-back", "--model", MODEL, "--views", "none"], "--views"),
        (["look-back", "--model", MODEL, "--episodes", "0"], "--episodes"),
        (["look-back", "--model", MODEL, "--limit", "-1"], "--limit"),
    ],
)
@pytest.mark.usefixtures("quick")
def test_what_makes_no_sense_is_misuse(
    door: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    monkeypatch.setenv("SCENE2DEMO_MODEL_URL", "http://127.0.0.1:9/v1")
    assert run(words[0], door, *words[1:]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.physics
@pytest.mark.render
@pytest.mark.slow
def test_the_windows_are_compared_in_physics(
    door: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    closed = revision_answer([1, 2, 3, {"19": [0.0, 0.6]}, 5], sub_task=1, root_cause_step=4)
    with judging_server(closed, lambda text, step: step == 4) as server:
        point_to(server, monkeypatch)
        assert (
            run("look-back", door, "--model", MODEL, "--views", "head", "--out", str(tmp_path / "out"), "--json") == 0
        )
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [(row["successes_before"], row["successes_after"], row["revisions"]) for row in rows] == [(0, 1, [1])] * 3
    # The same motion in every setting, so it was drawn once.
    assert len(list((tmp_path / "out" / "pictures").iterdir())) == 1
