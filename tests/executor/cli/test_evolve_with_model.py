"""Evolutions whose judge is a model: over the wire once, then replayed without a server to the same state."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from executor.cli import app
from executor.cli.commands.evolve import Options
from executor.cli.execution import typed_command
from executor.cli.options import JudgeOptions
from executor.scenes import library
from executor.system import vulkan
from executor.system.files import write_json
from tests.executor.cli.conftest import scene_of
from tests.executor.cli.judge_server import MODEL, judge, judging_server, point_to
from tests.executor.rollouts.tasks import AJAR, T3_ROLES, graph
from tests.llm.evolve.scripted_judges import revision_answer
from tests.llm.live import KEY
from tests.llm.model_server import Act, ModelServer, Seen, fails, replies

CLOSED = revision_answer([1, 2, 3, {"19": [0.0, 0.6]}, 5], sub_task=1, root_cause_step=4)


def evolve(task: Path, out: Path, *words: str, scene: str = "", seed: int = 17001) -> int:
    """Run the command, and returns its exit code."""
    return app.run(
        ["evolve", str(task), "--scene", scene or scene_of(task), "--seed", str(seed), "--out", str(out), *words]
    )


def story(out: Path, seed: int = 17001) -> dict[str, Any]:
    told: dict[str, Any] = json.loads((out / f"seed_{seed:05}" / "evolution.json").read_text())
    return told


@pytest.mark.slow
@pytest.mark.physics
def test_a_recorded_evolution_replays_to_the_same_states(
    door: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    live, again = tmp_path / "live", tmp_path / "again"
    with judging_server(CLOSED, lambda text, step: step == 4) as server:
        point_to(server, monkeypatch)
        assert evolve(door, live, "--model", MODEL, "--views", "none") == 0
    assert len(server.seen) == len(AJAR) + 1 and all(not request.images for request in server.seen)
    assert evolve(door, again, "--model", f"replay:{live / 'exchanges.jsonl'}", "--views", "none") == 0
    first, second = story(live), story(again)
    assert first["revisions"] == 1 and first["state_hash"] == second["state_hash"]
    assert first["subtasks"][0]["history"] == second["subtasks"][0]["history"]
    revision = first["subtasks"][0]["history"]["iterations"][0]["revision"]
    assert (revision["origin"], revision["cause"]) == ("model", "limits too narrow")
    critiques = first["subtasks"][0]["history"]["iterations"][0]["attempt"]["critiques"]
    assert [critique["origin"] for critique in critiques] == ["both"] * len(AJAR)
    (said,) = json.loads((live / "conversations.json").read_text())
    assert [entry["module"] for entry in said["entries"]] == [6] * len(AJAR) + [7]
    assert not (again / "exchanges.jsonl").exists()
    written = "".join(path.read_text() for path in live.rglob("*.json*"))
    assert KEY not in written + "".join(capsys.readouterr())


@pytest.mark.physics
@pytest.mark.slow
def test_two_subtasks_replay_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # No arm moves its hand backwards by a metre.
    flows: list[list[Any]] = [[17, 1, 2, 3, {"7": None}], [18, {"10": 1.0}, 5]]
    task = graph("kitchen_t3", T3_ROLES, flows, "(inside apple_0 bowl_0)", {"apple_0": 0.62}).task
    path = write_json(tmp_path / "task.json", task.to_json())
    revision = revision_answer([18, {"13": None}, {"8": None}, 5, 6], sub_task=2, root_cause_step=1)
    options = ("--views", "none")
    live, again = tmp_path / "live", tmp_path / "again"
    with judging_server(revision, lambda text, step: step == 1) as server:
        point_to(server, monkeypatch)
        live_code = evolve(path, live, "--model", MODEL, *options, scene="kitchen_t3", seed=17000)
    assert story(live, 17000)["revisions"] == 1 and live_code == 0
    replay = f"replay:{live / 'exchanges.jsonl'}"
    assert evolve(path, again, "--model", replay, *options, scene="kitchen_t3", seed=17000) == 0
    assert story(live, 17000)["state_hash"] == story(again, 17000)["state_hash"]


@pytest.mark.physics
@pytest.mark.render
@pytest.mark.slow
def test_the_model_gets_the_very_pictures_that_are_kept_and_a_replay_needs_no_renderer(
    door: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    live, again = tmp_path / "live", tmp_path / "again"
    with judging_server(CLOSED, lambda text, step: step == 4) as server:
        point_to(server, monkeypatch)
        assert evolve(door, live, "--model", MODEL, "--views", "global,wrist") == 0
    sent = {image for request in server.seen for image in request.images}
    kept = {path.read_bytes() for path in (live / "pictures").rglob("*.jpg")}
    # The report shows the attempt that succeeded as well.
    assert sent < kept and len(sent) > 10
    assert max(len(request.images) for request in server.seen[:-1]) <= 2 * 2 * 6
    nothing = vulkan.Renderer("none", "no driver was found", "install one")
    monkeypatch.setattr(vulkan, "find_renderer", lambda: nothing)
    replay = f"replay:{live / 'exchanges.jsonl'}"
    assert evolve(door, again, "--model", replay, "--views", "global,wrist") == 0
    assert story(live)["state_hash"] == story(again)["state_hash"]


@pytest.mark.physics
@pytest.mark.parametrize(
    ("server", "said"),
    [
        (lambda: ModelServer(*[fails(400, "bad")] * 3, key=KEY), "bad"),
        (lambda: ModelServer(replies("no idea"), key=KEY), "no answer held in 3 rounds"),
    ],
    ids=["gone", "nonsense"],
)
@pytest.mark.slow
def test_a_model_that_does_not_help_ends_with_the_whole_story(
    door: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, server: Any, said: str
) -> None:
    with server() as running:
        point_to(running, monkeypatch)
        assert evolve(door, tmp_path / "out", "--model", MODEL, "--views", "none") == 1
    told = story(tmp_path / "out")["subtasks"][0]
    assert said in told["gave_up"]["reason"] and len(told["records"]) == 1
    assert len(told["gave_up"]["refused"]) == (3 if "rounds" in said else 0)
    critique = told["history"]["iterations"][0]["attempt"]["critiques"][3]
    assert critique["state_reached"] is False and critique["origin"] == "measurements"


@pytest.mark.slow
@pytest.mark.physics
@pytest.mark.parametrize("measurements", [(), ("--no-measurements",)], ids=["told", "untold"])
def test_a_server_that_dies_is_said_and_the_evolution_goes_on_with_what_was_answered(
    door: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    measurements: tuple[str, ...],
) -> None:
    views = "none" if not measurements else "global"
    monkeypatch.setattr("executor.cli.evolution_setup.EvolutionSetup._frames_for_model", lambda self: None)
    asked: list[int] = []
    alive = judge(CLOSED, lambda text, step: step == 4)

    def dies_at_the_third(seen: Seen) -> Act:
        asked.append(len(asked))
        return fails(400, "out of memory") if asked[-1] == 2 else alive(seen)

    out, words = tmp_path / "out", ("--model", MODEL, "--views", views, *measurements)
    with ModelServer(decide=dies_at_the_third, key=KEY) as server:
        point_to(server, monkeypatch)
        # The second episode is not begun.
        assert evolve(door, out, *words, "--episodes", "2") == 1
        told = capsys.readouterr()
        assert told.err.count("stopped answering") == 1 and "out of memory" in told.err and "--resume" in told.err
        assert "3 requests, 1 failed" in told.out and len(asked) == 3
        assert "out of memory" in story(out)["stopped"] and not (out / "seed_17002" / "evolution.json").exists()
        assert evolve(door, out, *words, "--resume", "--json") == 0
    told_again = json.loads(capsys.readouterr().out)
    assert told_again["stopped"] == "" and told_again["usage"]["recorded"] == 2
    assert len(asked) == 1 + len(AJAR) + 1 and story(out)["revisions"] == 1
    again = tmp_path / "again"
    replay = f"replay:{out / 'exchanges.jsonl'}"
    assert evolve(door, again, "--model", replay, "--views", views, *measurements) == 0
    assert story(out)["state_hash"] == story(again)["state_hash"]


@pytest.mark.physics
def test_a_budget_ends_it_with_the_reason(door: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with judging_server(CLOSED, lambda text, step: step == 4) as server:
        point_to(server, monkeypatch)
        words = ("--model", MODEL, "--views", "none", "--max-tokens", "10")
        assert evolve(door, tmp_path / "out", *words) == 1
    assert len(server.seen) == 1
    assert "the budget of 10 tokens is used up" in story(tmp_path / "out")["subtasks"][0]["gave_up"]["reason"]


def test_without_a_renderer_nothing_is_begun_and_the_way_on_is_said(
    door: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    nothing = vulkan.Renderer("none", "no driver was found.", "Install one.")
    monkeypatch.setattr(vulkan, "find_renderer", lambda: nothing)
    with judging_server(CLOSED, lambda text, step: False) as server:
        point_to(server, monkeypatch)
        assert evolve(door, tmp_path / "out", "--model", MODEL) == 2
    assert server.seen == []
    told = capsys.readouterr().err
    assert "no driver was found. Install one." in told and "--views none" in told


def test_a_scene_that_contradicts_itself_is_found_before_a_model_is_asked(
    door: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = library.load("kitchen_t1").to_json()
    scene["facts"] = ["(ontop glass_0 table_0)", "(ontop table_0 glass_0)"]
    path = write_json(tmp_path / "scene.json", scene)
    with judging_server(CLOSED, lambda text, step: False) as server:
        point_to(server, monkeypatch)
        assert evolve(door, tmp_path / "out", "--model", MODEL, "--views", "none", scene=str(path)) == 2
    assert server.seen == []
    assert "table_0 is not on glass_0" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--views", "side"), "--views"),
        (("--views", ""), "--views"),
        (("--look-back", "-1"), "--look-back"),
        (("--views", "none", "--no-measurements"), "--views"),
        (("--model", "openia:gpt"), "openai"),
        (("--model", "replay:missing.jsonl"), "missing.jsonl"),
    ],
)
def test_options_that_make_no_sense_are_misuse(
    door: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    assert evolve(door, tmp_path / "out", *words) == 2
    assert said in capsys.readouterr().err


def test_the_command_that_repeats_a_run_names_its_judges() -> None:
    plain = Options(Path("t.json"), "s.json")
    assert typed_command("evolve", plain, "task") == "scene2demo evolve t.json --scene s.json"
    asked = JudgeOptions(model="openai:gpt-5.2", views="head", measurements=False, max_tokens=9)
    told = replace(plain, fault=("pose:a b", "grip:force_n=2"), judged=asked, json=True)
    assert typed_command("evolve", told, "task") == (
        "scene2demo evolve t.json --scene s.json --fault 'pose:a b' --fault grip:force_n=2 "
        "--model openai:gpt-5.2 --views head --no-measurements"
    )
