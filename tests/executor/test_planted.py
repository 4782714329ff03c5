"""Folders for results into which somebody has put links, pipes and files: nothing is written where they lead."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bddl.files import NoPlainFile, write_atomically
from executor.bench.folder import BenchFolder
from executor.campaign.claims import LOCK, RUNNING, claim_units, exclusive_lock
from executor.reports.run_folder import FILES, ResultsExist, RunFolder
from executor.rollouts.evolution_record import FOLDER
from executor.system.files import write_json, write_text
from llm.client.recording import Recorder, append_line
from llm.errors import CassetteError

PRECIOUS = "not yours"


@pytest.fixture
def outside(tmp_path: Path) -> Iterator[Path]:
    """Give a file outside the folder, and looks at the end whether it is still the same."""
    path = tmp_path / "elsewhere" / "precious.txt"
    path.parent.mkdir()
    path.write_text(PRECIOUS)
    yield path
    assert path.read_text() == PRECIOUS
    assert list(path.parent.iterdir()) == [path]


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Give the folder for results."""
    path = tmp_path / "out"
    path.mkdir()
    return path


@pytest.mark.parametrize("plant", [Path.symlink_to, lambda path, _: os.mkfifo(path)], ids=["link", "pipe"])
@pytest.mark.parametrize(
    "open_it", [lambda f: exclusive_lock(f).__enter__(), lambda f: claim_units(f, ["u"]).__enter__()]
)
def test_a_lock_is_no_way_out(
    out: Path, outside: Path, plant: Callable[[Path, Path], None], open_it: Callable[[Path], object]
) -> None:
    plant(out / LOCK, outside)
    with pytest.raises(NoPlainFile, match="no plain file"):
        open_it(out)


def test_a_lock_file_is_not_emptied(out: Path) -> None:
    (out / LOCK).write_text("somebody's")
    with exclusive_lock(out):
        pass
    assert (out / LOCK).read_text() == "somebody's"


def test_a_card_is_no_way_out(out: Path, outside: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socket.gethostname", lambda: "here")
    (out / RUNNING).mkdir()
    own = out / RUNNING / f"here-{os.getpid()}.json"
    own.symlink_to(outside.parent / "new.json")
    with pytest.raises(NoPlainFile, match="no plain file"), claim_units(out, ["u"]):
        pass
    own.unlink()
    with claim_units(out, ["u"]):
        assert json.loads(own.read_text())["units"] == ["u"]


@pytest.mark.parametrize("name", [*FILES, FOLDER])
@pytest.mark.parametrize("dangling", [True, False])
def test_a_link_in_a_runs_folder_counts_as_a_result(out: Path, outside: Path, name: str, dangling: bool) -> None:
    (out / name).symlink_to(outside.parent / "new" if dangling else outside)
    with pytest.raises(ResultsExist, match=name.replace(".", r"\.")):
        RunFolder.prepare(out)
    folder = RunFolder.prepare(out, force=True)
    assert list(out.iterdir()) == [] and folder.written() == ()


def test_the_trial_leads_nowhere(out: Path, outside: Path) -> None:
    (out / ".scene2demo-trial").symlink_to(outside.parent / "new")
    RunFolder.prepare(out)
    assert not (outside.parent / "new").exists()


def test_a_pictures_folder_elsewhere_loses_nothing(out: Path, tmp_path: Path) -> None:
    picture = tmp_path / "T1_attempt1_step1_head_1.jpg"
    picture.write_text(PRECIOUS)
    (out / FOLDER).symlink_to(tmp_path)
    RunFolder.prepare(out, force=True)
    assert picture.read_text() == PRECIOUS


WRITERS: dict[str, Callable[[Path], object]] = {
    "text": lambda path: write_text(path, "ours"),
    "json": lambda path: write_json(path, {}),
    "bytes": lambda path: write_atomically(path, b"ours"),
    "index": lambda path: BenchFolder(path.parent).add_series(()),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_writer_replaces_links(out: Path, outside: Path, writer: str) -> None:
    path = out / "bench.json"
    if writer != "index":  # Which is read before it is written.
        path.symlink_to(outside)
    for name in (f".bench.{os.getpid()}.part.json", f"bench.{os.getpid()}.part"):
        (out / name).symlink_to(outside)
    WRITERS[writer](path)
    assert path.is_file() and not path.is_symlink()


def test_a_recording_is_no_way_out(out: Path, outside: Path) -> None:
    for target in (outside, outside.parent / "new"):
        path = out / target.name
        path.symlink_to(target)
        with pytest.raises(CassetteError, match="no plain file"):
            Recorder(lambda request: None, path)  # type: ignore[arg-type]
        with pytest.raises(NoPlainFile):
            append_line(path, "{}\n")
    os.mkfifo(out / "pipe")
    with pytest.raises(CassetteError, match="no plain file"):
        Recorder(lambda request: None, out / "pipe")  # type: ignore[arg-type]
