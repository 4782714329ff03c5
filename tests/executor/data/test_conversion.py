"""What was exported is read back: the same numbers in every other format, and the same episode in the environment."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from executor.cli.app import run
from executor.data.formats.export import FORMATS, Format, open_set, write_set
from executor.data.formats.store_reader import stream_of
from executor.data.formats.table import EpisodeStream, Extra
from executor.data.store import EpisodeStore, NotADataset
from tests.executor.data.test_formats import files

pytest.importorskip("h5py")
pytest.importorskip("pyarrow")
pytest.importorskip("av")

pytestmark = pytest.mark.physics
# Each is read once and written once: what is read is compared with what the store gives, too.
RING: tuple[tuple[Format, Format], ...] = (
    ("lerobot", "lerobot-v2.1"),
    ("lerobot-v2.1", "robomimic"),
    ("robomimic", "zarr"),
    ("zarr", "lerobot"),
)


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
    """Return a folder with a data set of each format."""
    out = tmp_path_factory.mktemp("sets")
    for kind in FORMATS:
        write_set(stream, kind, out / kind)
    return out


def assert_same(found: EpisodeStream, wanted: EpisodeStream, most_off: int = 0) -> None:
    """Compare two data sets, the colours up to so many tones of 255."""
    assert found.found == wanted.found and found.page == wanted.page
    for again, first in zip(found.episodes(), wanted.episodes(), strict=True):
        assert again.about == first.about and again.index == first.index
        assert again.columns.keys() == first.columns.keys() and again.clips.keys() == first.clips.keys()
        for name, rows in first.columns.items():
            assert np.array_equal(again.columns[name], rows) and again.columns[name].dtype == rows.dtype, name
        for key, clip in again.clips.items():
            pairs = list(zip(clip.pictures(), first.clips[key].pictures(), strict=True))
            assert len(pairs) == again.length
            assert max(np.abs(a.astype(int) - b).max() for a, b in pairs) <= (0 if key[1] else most_off), key


@pytest.mark.parametrize("kind", FORMATS)
def test_what_is_read_is_what_was_written(sets: Path, stream: EpisodeStream, kind: Format) -> None:
    assert_same(open_set(sets / kind), stream)


@pytest.mark.parametrize(("before", "after"), RING)
def test_a_conversion_gives_what_the_store_gives(sets: Path, before: Format, after: Format, tmp_path: Path) -> None:
    write_set(open_set(sets / before), after, tmp_path / "out")
    if before == "zarr":
        # It has no videos: colours are encoded once more, and only they are others, by little.
        assert_same(open_set(tmp_path / "out"), open_set(sets / after), most_off=2)
    else:
        assert files(tmp_path / "out") == files(sets / after)


def test_a_file_that_has_pictures_in_next_obs_too_is_read_as_well(
    sets: Path, stream: EpisodeStream, tmp_path: Path
) -> None:
    h5py = pytest.importorskip("h5py")
    folder = Path(shutil.copytree(sets / "robomimic", tmp_path / "set"))
    with h5py.File(folder / "demonstrations.hdf5", "r+") as file:
        for demo in file["data"].values():
            for name, last in demo["last_obs"].items():
                demo[f"next_obs/{name}"] = np.concatenate([demo[f"obs/{name}"][1:], last[:]])
            del demo["last_obs"]
    assert_same(open_set(folder), stream)


@pytest.mark.parametrize("kind", ["robomimic", "zarr"])
def test_what_was_exported_succeeds_again_in_the_environment(
    sets: Path, kind: Format, capsys: pytest.CaptureFixture[str]
) -> None:
    actions = ["--actions", "paper"] if kind == "zarr" else []
    assert run(["replay", str(sets / kind), "--through", "env", "--json", *actions]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["replayed"], told["good"], told["failed"]) == (2, 2, [])


def test_the_command_converts(sets: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, out = str(sets / "zarr"), str(tmp_path / "out")
    assert run(["dataset", "convert", source, "--format", "robomimic", "--out", out, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["episodes"]["train"] + told["episodes"]["validation"] == 2 and told["format"] == "robomimic"
    assert files(tmp_path / "out") == files(sets / "robomimic")
    assert run(["replay", source]) == 2
    assert "it has actions, and no commands" in capsys.readouterr().err


@pytest.mark.parametrize("where", [".", "sub", "..", "../link", "../link/sub"])
@pytest.mark.parametrize("command", ["export", "convert"])
def test_what_is_read_is_never_written_over(
    command: str, where: str, filmed_store: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "around" / "s"
    shutil.copytree(filmed_store.path, source)
    (tmp_path / "around" / "link").symlink_to(source)
    before = files(source)
    asked = ["dataset", command, str(source), "--format", "zarr", "--out", str(source / where), "--force"]
    assert run(asked) == 2
    name = "STORE" if command == "export" else "SOURCE"
    told = " ".join(capsys.readouterr().err.split())
    assert f"expected another folder than {name}, neither around it nor within it" in told
    assert files(source) == before


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def told_otherwise(path: Path) -> None:
    told = json.loads(path.read_text())
    path.write_text(json.dumps({**told, "views": {"../../head": [64, 48]}}))


def longer(path: Path) -> None:
    told = json.loads(path.read_text())
    sides = told["shape"][1:]
    path.write_text(json.dumps({**told, "shape": [10**12, *sides], "chunks": [10**12, *sides]}))


SPOILED = {
    "no lines": ("lerobot", "meta/scene2demo_episodes.jsonl", Path.unlink),
    "short lines": ("lerobot", "meta/scene2demo_episodes.jsonl", cut),
    "torn rows": ("lerobot", "data/chunk-000/file-000.parquet", cut),
    "no rows": ("lerobot-v2.1", "data/chunk-000/episode_000001.parquet", Path.unlink),
    "a view beside the folder": ("lerobot", "meta/scene2demo.json", told_otherwise),
    "torn file": ("robomimic", "demonstrations.hdf5", cut),
    "a torn chunk": ("zarr", "data/state/0.0", cut),
    "no chunk": ("zarr", "data/action/0.0", Path.unlink),
    "a chunk for a whole memory": ("zarr", "data/state/.zarray", longer),
    "attributes of something else": ("zarr", ".zattrs", lambda path: path.write_text('{"mine": 1}')),
}


@pytest.mark.parametrize("what", SPOILED)
def test_what_is_broken_is_one_clear_message(
    sets: Path, what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kind, name, spoil = SPOILED[what]
    folder = Path(shutil.copytree(sets / kind, tmp_path / "set"))
    spoil(folder / name)
    with pytest.raises(NotADataset):
        list(open_set(folder).episodes())
    assert run(["dataset", "convert", str(folder), "--format", "zarr", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert str(folder) in said and "export it anew" in said and "Traceback" not in said
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


def test_a_folder_of_something_else_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "notes.txt").write_text("mine")
    assert run(["dataset", "convert", str(mine), "--out", str(tmp_path / "out")]) == 2
    assert "is no store of episodes, nor exported of one" in capsys.readouterr().err


def test_links_out_of_a_file_are_not_followed(sets: Path, tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    folder = Path(shutil.copytree(sets / "robomimic", tmp_path / "set"))
    with h5py.File(tmp_path / "secret.hdf5", "w") as secret:
        secret["numbers"] = np.zeros((168, 12), np.float32)
    with h5py.File(folder / "demonstrations.hdf5", "r+") as file:
        del file["data/demo_0/obs/robot_qvel"]
        file["data/demo_0/obs/robot_qvel"] = h5py.ExternalLink(str(tmp_path / "secret.hdf5"), "numbers")
    with pytest.raises(NotADataset, match="is kept in another file"):
        list(open_set(folder).episodes())
