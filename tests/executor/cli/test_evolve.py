"""`scene2demo evolve`: what it prints, and what it leaves in its folders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import oag
from executor.cli import main
from executor.files import write_json
from tests.executor.rollout.tasks import T1_ROLES, graph


@pytest.fixture
def task(tmp_path: Path) -> Path:
    """A task file whose flow opens the refrigerator by 3 % only."""
    flow: list[Any] = [1, 2, 3, {"4": [0.0, 0.03]}, 5]
    found = graph("kitchen_t1", T1_ROLES[:1], [flow], "(open refrigerator_0)", {})
    return write_json(tmp_path / "task.json", found.task.to_json())


@pytest.mark.physics
def test_it_tells_and_writes_the_attempts(task: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["evolve", str(task), "--scene", "kitchen_t1", "--seed", "7001", "--out", str(tmp_path / "out")]
    assert main.run(words) == 0
    shown = capsys.readouterr().out
    assert "2 attempts" in shown and "open to 0.3 of the range instead of 0.03" in shown
    folder = tmp_path / "out" / "seed_07001"
    story = json.loads((folder / "evolution.json").read_text())
    assert story["schema"] == "scene2demo-evolution/1"
    assert story["succeeded"] is True and story["succeeded_at_once"] is False and story["revisions"] == 1
    assert len(story["subtasks"][0]["records"]) == 2
    oag.History.from_json(story["subtasks"][0]["history"])
    scene = oag.Scene.from_json(folder / "scene.json")
    assert oag.compose(oag.Task.from_json(folder / "task.json", scene=scene)).verify()
    assert oag.recheck(json.loads((folder / "certificate.json").read_text()))


@pytest.mark.physics
def test_without_a_revision_it_is_a_rollout(task: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["evolve", str(task), "--scene", "kitchen_t1", "--seed", "7001", "--limit", "0", "--json"]
    assert main.run(words) == 1
    told = json.loads(capsys.readouterr().out)
    assert (told["trials"], told["successes_before"], told["successes_after"]) == (1, 0, 0)
    gave_up = told["episodes"][0]["subtasks"][0]["gave_up"]["reason"]
    assert gave_up.startswith("0 revisions were tried")


def test_a_plan_that_is_not_proved_is_not_evolved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flow: list[Any] = [1, 2, 3, 5]
    found = graph("kitchen_t1", T1_ROLES[:1], [flow], "(open refrigerator_0)", {})
    path = write_json(tmp_path / "task.json", found.task.to_json())
    assert main.run(["evolve", str(path), "--scene", "kitchen_t1", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["verdict"] == "REFUTED"


def test_a_negative_limit_is_refused(task: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["evolve", str(task), "--scene", "kitchen_t1", "--limit", "-1", "--json"]) == 2
    assert "--limit" in json.loads(capsys.readouterr().out)["error"]["message"]
