"""Whole runs through the command line: files, hashes, exit codes, interruption, machines without a renderer."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from executor.cli import app
from executor.system import vulkan
from tests.executor.cli.conftest import Command, environment, scene_of

pytestmark = [pytest.mark.physics, pytest.mark.slow]
QUERY = "open the refrigerator"
# Without a model and without evolution.
FILES = {
    "proposal.json",
    "certificate.json",
    "scene.json",
    "task.json",
    "rollout.json",
    "episode.hdf5",
    "video.mp4",
    "report.html",
}


def opening_task(fraction: float) -> dict[str, Any]:
    """Return a task of one subtask that pulls the door open to a fraction of its range."""
    subtask = {
        "task_activity_name": "open_refrigerator",
        "target": "refrigerator_0",
        "init": "(not (open refrigerator_0))",
        "goal": "(open refrigerator_0)",
        "flow": [17, 1, 2, 3, {"4": [0.0, fraction]}, 5, 6],
    }
    return {"task_activity_name": "open", "goal": "(open refrigerator_0)", "sub_tasks": [subtask]}


def test_a_run_leaves_everything_and_can_be_repeated(command: Command, tmp_path: Path) -> None:
    answer = command("run", QUERY, "--scene", "kitchen_t1", "--seed", 3, "--out", "r", "--no-video", "--json")
    assert answer.code == 0 and answer.err == ""
    data = answer.data
    assert data["ok"] is True and data["verdict"] == "PROVED" and data["rollout"]["succeeded"] is True
    assert sorted(data["files"]) == sorted(FILES - {"video.mp4"})
    assert sorted(data["files"]) == sorted(path.name for path in (tmp_path / "r").iterdir())
    assert "switched off" in data["pictures"]
    again = command("rollout", "r/task.json", "--scene", "r/scene.json", "--seed", 3, "--json")
    assert again.code == 0
    assert again.data["episodes"][0]["state_hash"] == data["rollout"]["state_hash"]
    checked = command("recheck", "r/certificate.json", "--task", "r/task.json", "--scene", "r/scene.json")
    assert checked.code == 0, checked.out
    assert command("run", QUERY, "--scene", "kitchen_t1", "--out", "r", "--no-video").code == 2


def test_the_summary_fits_a_terminal(command: Command) -> None:
    answer = command("run", QUERY, "--scene", "kitchen_t1", "--out", "r", "--no-video")
    lines = answer.out.splitlines()
    assert len(lines) <= 24 and max(map(len, lines)) <= 80
    assert lines[0].startswith("PROVED") and lines[1].startswith("SUCCEEDED")
    assert "NAVIGATE_TO_TARGET" in answer.err


def test_without_a_renderer_everything_but_pictures_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(vulkan, "find_renderer", lambda: vulkan.Renderer("none", "no driver was found"))
    code = app.run(["run", QUERY, "--scene", "kitchen_t1", "--out", str(tmp_path / "r"), "--json"])
    data = json.loads(capsys.readouterr().out)
    assert code == 0 and data["ok"] is True
    assert data["pictures"].startswith("Nothing here can draw pictures: no driver was found")
    assert "No pictures: Nothing here can draw pictures" in (tmp_path / "r" / "report.html").read_text()


def test_ctrl_c_keeps_what_was_done(tmp_path: Path) -> None:
    words = ["run", QUERY, "--scene", "kitchen_t1", "--out", "r", "--no-video"]
    process = subprocess.Popen(
        [sys.executable, "-m", "executor.cli.app", *words],
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    seen = []
    assert process.stderr is not None
    for line in process.stderr:
        seen.append(line)
        if "CONVERGE" in line:
            process.send_signal(signal.SIGINT)
            break
    out, err = process.communicate(timeout=600)
    assert process.returncode == 130, "".join(seen) + err
    assert "Traceback" not in err and "interrupted" in err
    assert "INTERRUPTED" in out
    kept = json.loads((tmp_path / "r" / "rollout.json").read_text())
    assert kept["samples"] > 10 and kept["succeeded"] is False
    assert (tmp_path / "r" / "report.html").exists() and (tmp_path / "r" / "episode.hdf5").exists()


def test_a_failed_rollout_has_its_reason_and_numbers(command: Command, tmp_path: Path, door: Path) -> None:
    answer = command("rollout", door, "--scene", scene_of(door), "--json", "--out", "r")
    assert answer.code == 1
    assert answer.data["failures"] == {"goal-not-reached": 1}
    assert answer.data["interval_95"] == pytest.approx([0.0, 0.975])
    report = (tmp_path / "r" / "seed_00000" / "report.html").read_text()
    assert "Why it failed" in report
    assert json.loads((tmp_path / "r" / "summary.json").read_text())["trials"] == 1


def test_processes_give_the_same_episodes_as_one(command: Command, tmp_path: Path) -> None:
    (tmp_path / "task.json").write_text(json.dumps(opening_task(0.8)))
    words = ["rollout", "task.json", "--scene", "kitchen_t1", "--seed", "4", "--episodes", "2", "--json"]
    here, apart = command(*words), command(*words, "--workers", "2")
    assert here.code == apart.code == 0
    hashes = [[episode["state_hash"] for episode in answer.data["episodes"]] for answer in (here, apart)]
    assert hashes[0] == hashes[1] and len(set(hashes[0])) == 2
    assert [episode["seed"] for episode in apart.data["episodes"]] == [4, 5]


@pytest.mark.render
def test_a_run_with_pictures_has_a_video_of_every_sample(command: Command, tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    h5py = pytest.importorskip("h5py")
    words = ["--size", "64", "48", "--record-hz", "2"]
    answer = command("run", QUERY, "--scene", "kitchen_t1", "--out", "r", "--json", *words)
    assert answer.code == 0 and sorted(answer.data["files"]) == sorted(FILES)
    samples = answer.data["rollout"]["samples"]
    with av.open(str(tmp_path / "r" / "video.mp4")) as container:
        assert sum(1 for _ in container.decode(video=0)) == samples
    with h5py.File(tmp_path / "r" / "episode.hdf5") as file:
        assert file["data/demo_0/obs/wrist_image"].shape == (samples - 1, 48, 64, 3)
    report = (tmp_path / "r" / "report.html").read_text()
    # Pictures of a step that did not fail are in the video, one click away.
    assert "data:video/mp4;base64," in report and "<img" not in report and report.count("data-at=") > 10
