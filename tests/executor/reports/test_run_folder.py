"""The output folder: never overwrites unasked, never shows half a file, never deletes what is not its own."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import oag
from bddl.files import atomic_path
from executor.cli.execution import summary_lines
from executor.records import Detour, Failure, FailureKind
from executor.reports.run_folder import FolderUnusable, ResultsExist, RunFolder
from executor.rollouts.feasibility import Feasibility, FeasibleSubtask
from executor.rollouts.run_record import RunRecord, filled_task, with_open_numbers
from executor.system.files import json_text
from oag.measurements import Unplanned
from tests.executor.recordings import invented_rollout


def test_earlier_results_stay_unless_forced(tmp_path: Path) -> None:
    (tmp_path / "video.mp4").write_text("old")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ResultsExist, match=r"already has results \(video.mp4\)"):
        RunFolder.prepare(tmp_path)
    folder = RunFolder.prepare(tmp_path, force=True)
    assert folder.written() == ()
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_folder_with_other_files_only_is_taken(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    RunFolder.prepare(tmp_path / "deep" / "er")
    RunFolder.prepare(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["deep", "notes.txt"]


def test_a_file_in_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / "r").write_text("x")
    with pytest.raises(FolderUnusable, match="cannot be used"):
        RunFolder.prepare(tmp_path / "r")


def test_a_write_that_fails_keeps_the_old_file_and_leaves_no_other(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_the_written_files_can_be_read_back(tmp_path: Path) -> None:
    rollout = invented_rollout()
    graph = oag.compose(rollout.task, scene=rollout.scene)
    folder = RunFolder.prepare(tmp_path)
    record = RunRecord(graph, graph.verify(), rollout=rollout)
    folder.write_plan(record)
    folder.write_report(folder.write_rollout(record), None)
    (scaled,) = json.loads((tmp_path / "rollout.json").read_text())["scaled"]
    assert (scaled["object_id"], scaled["factors"]) == ("glass_0", [0.71] * 3)
    scene = oag.Scene.from_json(tmp_path / "scene.json")
    task = oag.Task.from_json(tmp_path / "task.json", scene=scene)
    assert scene == rollout.scene
    assert [subtask.flow for subtask in task.subtasks] == [record.flow for record in rollout.subtasks]
    assert oag.recheck(json.loads((tmp_path / "certificate.json").read_text()))
    written = json.loads((tmp_path / "rollout.json").read_text())
    assert written["state_hash"] == rollout.state_hash
    assert base64.b64decode(written["subtasks"][0]["checkpoint"]) == b"state"
    assert written["subtasks"][0]["steps"][4]["action"] == {"4": [0.0, 0.85]}


def test_the_certificate_is_of_the_plan_that_ran_with_its_numbers_and_what_was_inserted(tmp_path: Path) -> None:
    """The first of the two subtasks counts as one that the rollout inserted; asked for was the second, numbers open."""
    rollout = replace(invented_rollout(), detours=(Detour(0, 1, "the door was shut"),))
    asked = oag.compose(with_open_numbers(rollout.asked_for), scene=rollout.scene)
    assert [subtask.name for subtask in asked.task.subtasks] == ["pick_up_glass"]
    folder = RunFolder.prepare(tmp_path)
    record = RunRecord(asked, asked.verify(), rollout=rollout)
    folder.write_plan(record)
    ran = folder.write_rollout(record)
    folder.write_report(ran, None)
    folder.write_episode(rollout, None)
    certificate = json.loads((tmp_path / "certificate.json").read_text())
    assert oag.recheck(certificate, task=tmp_path / "task.json", scene=tmp_path / "scene.json")
    task = json.loads((tmp_path / "task.json").read_text())
    told = json.loads((tmp_path / "rollout.json").read_text())
    names = ["open_refrigerator", "pick_up_glass"]
    with h5py.File(tmp_path / "episode.hdf5") as file:
        stored = [one["name"] for one in json.loads(file["data/demo_0"].attrs["subtasks"])]
    assert (
        names == [one["task_activity_name"] for one in task["sub_tasks"]] == [one["name"] for one in told["subtasks"]]
    )
    assert names == stored
    assert told["detours"] == [{"first": 0, "count": 1, "reason": "the door was shut"}]
    note = "subtask 1 (open_refrigerator) of 2 was inserted on the way: the door was shut"
    page = (tmp_path / "report.html").read_text()
    assert (
        page.count(note) == 2 and "asked for has 1 subtask, and was proved" in page and "inserted on the way</" in page
    )
    lines = " ".join(line.strip() for line, _ in summary_lines(ran, folder))
    assert "2 of 2 subtasks" in lines and f"detour      {note}" in lines


def test_a_refused_plan_leaves_its_reason_as_data(tmp_path: Path) -> None:
    rollout = invented_rollout()
    why = Failure(FailureKind.UNREACHABLE, "too high", (Unplanned(target="glass_0", residual_m=0.3),))
    folder = RunFolder.prepare(tmp_path)
    record = replace(invented_rollout(failed=True).subtasks[0], readings=())
    gone_through = (FeasibleSubtask(record, None, None, None, 0.1),)
    folder.write_feasibility(Feasibility(rollout.task, gone_through, why, "", (), 0.5))
    written = json.loads((tmp_path / "feasibility.json").read_text())
    assert written["feasible"] is False and written["failure"]["kind"] == "unreachable"
    assert "feasibility.json" in folder.written()


def test_a_plan_without_a_certificate_leaves_none_of_another_plan(tmp_path: Path) -> None:
    rollout = invented_rollout()
    malformed = replace(rollout.task, subtasks=(replace(rollout.task.subtasks[0], target="nothing_0"),))
    folder = RunFolder.prepare(tmp_path)
    for task, has_one in ((rollout.task, True), (malformed, False)):
        graph = oag.compose(task, scene=rollout.scene)
        folder.write_plan(RunRecord(graph, graph.verify()))
        assert ("certificate.json" in folder.written()) is has_one


def test_a_recording_too_short_for_an_episode_leaves_none(tmp_path: Path) -> None:
    folder = RunFolder.prepare(tmp_path)
    folder.write_episode(invented_rollout(samples=1), None)
    assert folder.written() == ()


def test_subtasks_that_did_not_run_keep_their_flows() -> None:
    rollout = invented_rollout(failed=True)
    filled = filled_task(rollout)
    assert len(filled.subtasks) == 2
    assert filled.subtasks[0].flow == rollout.subtasks[0].flow


def test_json_takes_numbers_of_numpy_and_drops_what_json_has_not() -> None:
    value = {"a": np.float32(0.5), "b": np.arange(2), "c": float("inf"), "d": (1, None, True), "e": {"x"}}
    assert json.loads(json_text(value)) == {"a": 0.5, "b": [0, 1], "c": None, "d": [1, None, True], "e": ["x"]}
    with pytest.raises(TypeError, match="expected plain data, got object"):
        json_text({"a": object()})
