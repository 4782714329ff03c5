"""`scene2demo evolve`: what it prints, and what it leaves in its folders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import oag
from executor.cli import app
from executor.system.files import write_json
from oag.revision import History
from tests.executor.cli.conftest import scene_of
from tests.executor.rollouts.tasks import T1_ROLES, graph


@pytest.mark.physics
def test_it_tells_and_writes_the_attempts(door: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["evolve", str(door), "--scene", scene_of(door), "--seed", "7001", "--out", str(tmp_path / "out")]
    assert app.run(words) == 0
    shown = capsys.readouterr().out
    assert "2 attempts" in shown and "raise the upper limit from 0.3 to 0.5" in shown
    folder = tmp_path / "out" / "seed_07001"
    story = json.loads((folder / "evolution.json").read_text())
    assert story["schema"] == "scene2demo-evolution/2"
    assert story["succeeded"] is True and story["succeeded_at_once"] is False and story["revisions"] == 1
    assert len(story["subtasks"][0]["records"]) == 2
    History.from_json(story["subtasks"][0]["history"])
    scene = oag.Scene.from_json(folder / "scene.json")
    assert oag.compose(oag.Task.from_json(folder / "task.json", scene=scene)).verify()
    assert oag.recheck(json.loads((folder / "certificate.json").read_text()), folder / "task.json", scene)


@pytest.mark.physics
def test_without_a_revision_it_is_a_rollout(door: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["evolve", str(door), "--scene", scene_of(door), "--seed", "7001", "--limit", "0", "--json"]
    assert app.run(words) == 1
    told = json.loads(capsys.readouterr().out)
    assert (told["trials"], told["successes_before"], told["successes_after"]) == (1, 0, 0)
    gave_up = told["episodes"][0]["subtasks"][0]["gave_up"]["reason"]
    assert gave_up.startswith("0 revisions were tried")


@pytest.mark.parametrize("flow", [[1, 2, 3, 5], [1, 2, 3, {"4": [0.0, 0.03]}, 5]], ids=["nothing", "a crack"])
def test_a_plan_that_is_not_proved_is_not_evolved(
    flow: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = graph("kitchen_t1", T1_ROLES[:1], [flow], "(open refrigerator_0)", {})
    path = write_json(tmp_path / "task.json", found.task.to_json())
    assert app.run(["evolve", str(path), "--scene", "kitchen_t1", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["verdict"] == "REFUTED"


def test_a_negative_limit_is_refused(door: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["evolve", str(door), "--scene", scene_of(door), "--limit", "-1", "--json"]) == 2
    assert "--limit" in json.loads(capsys.readouterr().out)["error"]["message"]


@pytest.mark.slow
@pytest.mark.physics
def test_finished_episodes_are_kept_and_the_others_run(
    door: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["evolve", str(door), "--scene", scene_of(door), "--out", str(out), "--fault", "grip:force_n=25"]
    assert app.run([*words, "--seed", "7001"]) == 0
    first = (out / "seed_07001" / "evolution.json").read_bytes()
    assert json.loads(first)["faults"] == [{"kind": "grip", "force_n": 25.0}]
    (out / "seed_07002").mkdir()
    (out / "seed_07002" / "scene.json").write_text("{}")  # What an interrupted episode leaves.
    assert app.run([*words, "--seed", "7001", "--episodes", "2", "--resume"]) == 0
    assert (out / "seed_07001" / "evolution.json").read_bytes() == first
    assert json.loads((out / "seed_07002" / "evolution.json").read_text())["seed"] == 7002
    shown = capsys.readouterr().out
    assert "before" in shown and "2 after evolution" in shown
    other = [word.replace("25", "24") for word in words]
    assert app.run([*other, "--seed", "7001", "--resume", "--json"]) == 2
    assert "same task with the same faults" in json.loads(capsys.readouterr().out)["error"]["message"]


def test_results_are_not_gone_on_from_without_a_folder(door: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["evolve", str(door), "--scene", scene_of(door), "--resume", "--json"]) == 2
    assert "--out" in json.loads(capsys.readouterr().out)["error"]["message"]


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("rain", "there is no kind 'rain'"),
        ("pose:glas_0,size_m=0.02", "did you mean glass_0"),
        ("door:table_0,fraction=0.5", "no door with an upright hinge"),
    ],
)
def test_a_fault_that_cannot_be_is_bad_input(
    door: Path, fault: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run(["evolve", str(door), "--scene", scene_of(door), "--fault", fault, "--json"]) == 2
    assert said in json.loads(capsys.readouterr().out)["error"]["message"]


@pytest.mark.physics
def test_a_sentence_can_be_evolved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = ["run", "open the refrigerator", "--scene", "kitchen_t1", "--seed", "7001", "--evolve", "--no-video"]
    assert app.run([*words, "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["evolution"]["schema"] == "scene2demo-evolution/2" and told["evolution"]["succeeded_at_once"] is True
    assert {"evolution.json", "pairs.jsonl", "report.html"} <= set(told["files"])
    assert (out / "pairs.jsonl").read_text() == ""


@pytest.mark.parametrize("words", [["--evolve", "--limit", "-1"]])
def test_options_of_evolution_that_make_no_sense(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = ["run", "open the refrigerator", "--scene", "kitchen_t1", "--out", str(tmp_path / "out"), "--json", *words]
    assert app.run(whole) == 2
    assert words[-2] in json.loads(capsys.readouterr().out)["error"]["message"]
