"""A disk without room: one sentence with the path, an exit code of its own, and nothing that stops the next run.

A limit on the size of files stands for the disk: whatever passes it fails as on a full one.
"""

from __future__ import annotations

import json
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bddl.files import atomic_path
from executor.cli import app
from executor.cli.errors import explain
from executor.data.episode import Episode
from executor.data.formats.robomimic import write_robomimic
from executor.records import Rollout
from executor.reports.run_folder import ResultsExist, RunFolder
from executor.system.files import write_json
from tests.executor.cli.conftest import ROOT
from tests.executor.recordings import invented_rollout, scripted_rollout

DISK_FULL = 3
QUERY = "put the glass into the refrigerator"


@contextmanager
def room_for(size: int) -> Iterator[None]:
    """Let no file grow beyond a number of bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def invented(monkeypatch: pytest.MonkeyPatch) -> Rollout:
    """Make rollouts cost nothing."""
    recorded = invented_rollout()

    def executed(graph: object, scene: object, seed: int, **_: object) -> Rollout:
        return replace(recorded, seed=seed)

    monkeypatch.setattr("executor.rollouts.rollout.rollout", executed)
    return recorded


def run(tmp_path: Path) -> int:
    return app.run(["run", QUERY, "--scene", "kitchen_t1", "--out", str(tmp_path / "r"), "--no-video"])


@pytest.mark.parametrize(
    "size", [pytest.param(100, marks=pytest.mark.slow), 2_000, pytest.param(20_000, marks=pytest.mark.slow)]
)
@pytest.mark.slow
def test_a_run_leaves_no_half_of_it(
    invented: Rollout, tmp_path: Path, capsys: pytest.CaptureFixture[str], size: int
) -> None:
    with room_for(size):
        assert run(tmp_path) == DISK_FULL
    said = capsys.readouterr().err.splitlines()[-1]
    assert str(tmp_path / "r") in said and "Traceback" not in said
    assert list((tmp_path / "r").iterdir()) == []
    assert run(tmp_path) == 0
    assert (tmp_path / "r" / "episode.hdf5").exists()


def test_finished_episodes_stay_and_the_half_one_goes(
    invented: Rollout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    task = tmp_path / "task.json"
    write_json(task, {**invented.task.to_json(), "goal": "(not (ontop glass_0 table_0))"})
    out = tmp_path / "r"
    write_report = RunFolder.write_report

    def second_has_no_room(self: RunFolder, *arguments: Any) -> None:
        with room_for(50 if self.path.name == "seed_00001" else 10**9):
            write_report(self, *arguments)

    monkeypatch.setattr(RunFolder, "write_report", second_has_no_room)
    words = ["rollout", str(task), "--scene", "kitchen_t1", "--episodes", "3", "--out", str(out), "--json"]
    assert app.run(words) == DISK_FULL
    said = json.loads(capsys.readouterr().out)
    assert said["exit_code"] == DISK_FULL and said["error"]["kind"] == "disk-full"
    assert str(out / "seed_00001" / "report.html") in said["error"]["message"]
    assert (out / "seed_00000" / "report.html").exists()
    assert list((out / "seed_00001").iterdir()) == list((out / "seed_00002").iterdir()) == []


def test_what_a_model_answered_stays_and_is_kept_aside_when_a_run_is_begun_anew(tmp_path: Path) -> None:
    folder = RunFolder.prepare(tmp_path)
    for number in (2, 3):
        with pytest.raises(OSError) as full, folder.filling():
            folder.exchanges.write_text("paid for")
            write_json(tmp_path / "rollout.json", {})
            raise OSError(28, "No space left on device")
        assert f"{folder.exchanges}; --resume goes on from it" in explain(full.value).message
        assert not (tmp_path / "rollout.json").exists()
        with pytest.raises(ResultsExist, match="--resume"):
            RunFolder.prepare(tmp_path)
        RunFolder.prepare(tmp_path, resume=True).clear()
        assert folder.exchanges.read_text() == "paid for"
        folder = RunFolder.prepare(tmp_path, force=True)
        assert folder.kept_aside == tmp_path / f"exchanges_{number}.jsonl"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["exchanges_2.jsonl", "exchanges_3.jsonl"]


def test_other_commands_name_the_file_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "deep" / "c.json"
    with room_for(100):
        assert app.run(["verify", str(ROOT / "tests/data/T1.json"), "--certificate", str(target)]) == DISK_FULL
    said = capsys.readouterr().err
    assert str(target) in said and ".part" not in said
    assert list(target.parent.iterdir()) == []
    with room_for(0):
        words = ["bench", "T3", "--out", str(tmp_path / "b"), "--episodes", "1"]
        assert app.run(words) == DISK_FULL
    assert str(tmp_path / "b" / "bench.json") in capsys.readouterr().err


def test_libraries_that_lose_the_number_do_not_hide_a_full_disk(tmp_path: Path) -> None:
    path = tmp_path / "episode.hdf5"
    episode = Episode.from_rollout(scripted_rollout())
    with room_for(4_000), pytest.raises(OSError, match=r"episode\.hdf5") as full:
        write_robomimic(path, [episode])
    assert full.value.errno is not None and full.value.filename == str(path)
    assert list(tmp_path.iterdir()) == []
    with room_for(10_000), pytest.raises(ZeroDivisionError), atomic_path(path) as temporary:
        temporary.write_bytes(bytes(1_000))
        raise ZeroDivisionError
    with room_for(10_000), pytest.raises(OSError, match="File too large"), atomic_path(path) as temporary:
        temporary.write_bytes(bytes(9_000))
        raise ZeroDivisionError
