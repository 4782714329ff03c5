"""What `scene2demo rollout` leaves behind when episodes succeed, are interrupted, crash, or cannot be datasets."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from executor.cli import app
from executor.records import Rollout, RolloutInterrupted
from executor.system.files import write_json
from oag import ObjectActionGraph
from oag.model.actions import flow_to_json
from tests.executor.recordings import invented_rollout

Ending = Callable[[Rollout], Rollout]


def as_it_is(done: Rollout) -> Rollout:
    return done


def by_ctrl_c(done: Rollout) -> Rollout:
    raise RolloutInterrupted(done)


def by_a_crash(done: Rollout) -> Rollout:
    raise ZeroDivisionError("division by zero")


@pytest.fixture
def roll(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[int, dict[str, Any]]]:
    """Run the command with invented episodes that end in the given ways; returns exit code and summary."""
    recorded = invented_rollout()
    task = recorded.task.to_json()
    # What was invented ends with the glass in the hand; that is the goal that this plan is proved to reach.
    write_json(tmp_path / "task.json", {**task, "goal": "(not (ontop glass_0 table_0))"})

    def run(*endings: Ending) -> tuple[int, dict[str, Any]]:
        left = list(endings)

        def invented(graph: object, scene: object, seed: int, **_: object) -> Rollout:
            return left.pop(0)(replace(recorded, seed=seed))

        monkeypatch.setattr("executor.rollouts.rollout.rollout", invented)
        words = ["rollout", str(tmp_path / "task.json"), "--scene", "kitchen_t1", "--episodes", str(len(endings))]
        code = app.run([*words, "--out", str(tmp_path / "r")])
        return code, json.loads((tmp_path / "r" / "summary.json").read_text())

    return run


def test_ctrl_c_is_in_the_report_and_the_summary(roll: Any, tmp_path: Path) -> None:
    code, summary = roll(as_it_is, by_ctrl_c, as_it_is)
    assert code == 130 and summary["interrupted"] is True and summary["trials"] == 1
    assert [episode["reason"] for episode in summary["episodes"]] == ["", "interrupted"]
    finished, stopped = ((tmp_path / "r" / f"seed_0000{seed}" / "report.html").read_text() for seed in (0, 1))
    assert "<title>" in stopped and "interrupted" in stopped and "failed in simulation" not in stopped
    assert ">interrupted<" in stopped and ">interrupted<" not in finished
    assert "scene2demo rollout" in stopped and "--seed 1 --out" in stopped


def test_sizes_and_numbers_that_no_seed_changes_are_said(roll: Any, capsys: pytest.CaptureFixture[str]) -> None:
    _, summary = roll(as_it_is, as_it_is)
    told = capsys.readouterr().err
    assert "note: glass_0 is scaled by 0.71, from 70 x 70 x 120 to 50 x 50 x 85 mm" in told
    assert "note: numbers are written into 2 steps (T1.5 ARTICULATE_OPEN, T2.5 LIFT_EEF_UP)" in told
    assert "--open-numbers leaves them to the planner" in told
    assert [f"note: {note}" in told for note in summary["notes"]] == [True, True]


def test_numbers_can_be_left_to_every_seed(
    roll: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    roll(as_it_is)
    seen: list[ObjectActionGraph] = []

    def invented(graph: ObjectActionGraph, scene: object, seed: int, **_: object) -> Rollout:
        seen.append(graph)
        return replace(invented_rollout(), seed=seed)

    monkeypatch.setattr("executor.rollouts.rollout.rollout", invented)
    capsys.readouterr()
    words = ["rollout", str(tmp_path / "task.json"), "--scene", "kitchen_t1", "--open-numbers"]
    assert app.run([*words, "--out", str(tmp_path / "open")]) == 0
    flows = [subtask.flow or () for subtask in seen[0].task.subtasks]
    assert [flow_to_json(flow) for flow in flows] == [[17, 1, 2, 3, {"4": None}, 5, 6], [17, 1, 2, 3, {"7": None}]]
    assert "numbers are written into" not in capsys.readouterr().err
    assert "--open-numbers" in (tmp_path / "open" / "seed_00000" / "report.html").read_text()


def test_a_crash_leaves_the_summary_of_what_was_done(roll: Any, tmp_path: Path) -> None:
    code, summary = roll(as_it_is, by_a_crash)
    assert code == 1 and summary["trials"] == 1
    assert (tmp_path / "r" / "seed_00000" / "report.html").exists()


def test_a_crash_at_once_leaves_an_empty_summary(roll: Any) -> None:
    code, summary = roll(by_a_crash)
    assert code == 1 and summary["trials"] == 0


def test_without_h5py_everything_but_the_dataset_is_there(
    roll: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    code, summary = roll(as_it_is, as_it_is)
    assert code == 0 and summary["successes"] == 2
    assert capsys.readouterr().err.count("no dataset: This needs h5py") == 1
    for seed in (0, 1):
        names = {path.name for path in (tmp_path / "r" / f"seed_0000{seed}").iterdir()}
        assert {"report.html", "rollout.json"} <= names and "episode.hdf5" not in names
