"""A LeRobot data set that was exported is read back: the same numbers, and the same episode in the environment."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from executor.cli.app import run
from executor.data.formats.export import Format, open_set, write_set
from executor.data.formats.store_reader import stream_of
from executor.data.formats.table import EpisodeStream, Extra
from executor.data.store import EpisodeStore, NotADataset
from tests.executor.data.test_formats import files

pytest.importorskip("pyarrow")
pytest.importorskip("av")

pytestmark = pytest.mark.physics
READ: tuple[Format, ...] = ("lerobot", "lerobot-v2.1")


@pytest.fixture(scope="module")
def stream(filmed_store: EpisodeStore, tmp_path_factory: pytest.TempPathFactory) -> EpisodeStream:
    """Return two episodes with all that there can be."""
    store = EpisodeStore(tmp_path_factory.mktemp("two") / "s")
    store.add_requests([])
    for episode in list(filmed_store.episodes())[::2]:
        shutil.copytree(episode.path, store.path / "units" / episode.name)
    found = stream_of(store, get_args(Extra))
    kept = list(found.episodes())
    return EpisodeStream(found.found, lambda: iter(kept), found.page)


@pytest.fixture(scope="module")
def sets(stream: EpisodeStream, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a data set of each version."""
    out = tmp_path_factory.mktemp("sets")
    for kind in READ:
        write_set(stream, kind, out / kind)
    return out


@pytest.mark.parametrize("kind", READ)
def test_what_is_read_is_what_was_written(sets: Path, stream: EpisodeStream, kind: Format) -> None:
    found = open_set(sets / kind)
    assert found.found == stream.found
    for again, first in zip(found.episodes(), stream.episodes(), strict=True):
        assert again.about == first.about and again.index == first.index
        assert again.columns.keys() == first.columns.keys()
        for name, rows in first.columns.items():
            assert np.array_equal(again.columns[name], rows) and again.columns[name].dtype == rows.dtype, name


@pytest.mark.slow
@pytest.mark.parametrize("kind", READ)
def test_what_was_exported_succeeds_again_in_the_environment(
    sets: Path, kind: Format, capsys: pytest.CaptureFixture[str]
) -> None:
    actions = ["--actions", "paper"] if kind == "lerobot" else []
    assert run(["replay", str(sets / kind), "--through", "env", "--json", *actions]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["replayed"], told["good"], told["failed"]) == (2, 2, [])
    assert run(["replay", str(sets / kind)]) == 2
    assert "it has actions, and no commands" in capsys.readouterr().err


@pytest.mark.parametrize("where", [".", "sub", "..", "../link", "../link/sub"])
def test_what_is_read_is_never_written_over(
    where: str, filmed_store: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "around" / "s"
    shutil.copytree(filmed_store.path, source)
    (tmp_path / "around" / "link").symlink_to(source)
    before = files(source)
    asked = ["dataset", "export", str(source), "--format", "zarr", "--out", str(source / where), "--force"]
    assert run(asked) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "expected another folder than STORE, neither around it nor within it" in told
    assert files(source) == before


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


SPOILED = {
    "no lines": ("lerobot", "meta/scene2demo_episodes.jsonl", Path.unlink),
    "short lines": ("lerobot", "meta/scene2demo_episodes.jsonl", cut),
    "torn rows": ("lerobot", "data/chunk-000/file-000.parquet", cut),
    "no rows": ("lerobot-v2.1", "data/chunk-000/episode_000001.parquet", Path.unlink),
    "no metadata of ours": ("lerobot", "meta/scene2demo.json", lambda path: path.write_text('{"mine": 1}')),
}


@pytest.mark.parametrize("what", SPOILED)
def test_what_is_broken_is_one_clear_message(
    sets: Path, what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch")
    kind, name, spoil = SPOILED[what]
    folder = Path(shutil.copytree(sets / kind, tmp_path / "set"))
    spoil(folder / name)
    with pytest.raises(NotADataset):
        list(open_set(folder).episodes())
    assert run(["train", "state", "--data", str(folder), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert str(folder) in said and "export it again" in said and "Traceback" not in said
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


@pytest.mark.parametrize("kind", ["robomimic", "zarr"])
def test_a_folder_of_something_else_is_refused(kind: Format, stream: EpisodeStream, tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    write_set(stream, kind, tmp_path / "mine")
    with pytest.raises(NotADataset, match="is no store of episodes, nor a LeRobot data set"):
        open_set(tmp_path / "mine")
