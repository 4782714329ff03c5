"""What somebody has packed to fill a memory is refused within 300 MB and 10 s, and named."""

from __future__ import annotations

import json
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executor.data import samples
from executor.data.formats.export import write_set
from executor.data.formats.store_reader import stream_of
from executor.data.formats.table import EpisodeStream
from executor.data.store import EpisodeStore, NotADataset
from tests.executor.hostile_packing import BOMB_BYTES, assert_refused, command, xz_bomb, zlib_bomb

h5py = pytest.importorskip("h5py")
pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")
av = pytest.importorskip("av")
pytestmark = pytest.mark.physics

ROWS = 100_000_000


@pytest.fixture
def copied(made_store: EpisodeStore, tmp_path: Path) -> EpisodeStore:
    return EpisodeStore(Path(shutil.copytree(made_store.path, tmp_path / "s")))


def huge(arrays: dict[str, Any]) -> bytes:
    """Very many zeros, as the header says."""
    return xz_bomb(json.dumps({"packed_states": ["|u1", [BOMB_BYTES // 100, 100]]}).encode() + b"\n")


def longer(arrays: dict[str, Any]) -> bytes:
    """More than the header says."""
    return xz_bomb(json.dumps({"time_s": ["<f8", [10]]}).encode() + b"\n")


def lying(arrays: dict[str, Any]) -> bytes:
    """Less than the header says, which is just what may be."""
    return xz_bomb(json.dumps({"time_s": ["|u1", [samples.MOST_BYTES]]}).encode() + b"\n", 1 << 21)


def as_much_as_may_be(arrays: dict[str, Any]) -> bytes:
    rows = samples.MOST_BYTES // 2000
    return samples.packed({"packed_states": np.zeros((rows, 2000), np.uint8)})


def of_a_far_subtask(arrays: dict[str, Any]) -> bytes:
    return samples.packed({**arrays, "command_subtask": np.full_like(arrays["command_subtask"], 2**31 - 1)})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("packed", "said"),
    [
        (huge, "its arrays take 400 MB, more than the 128 MB"),
        (longer, "not a whole file of samples"),
        (lying, "not a whole file of samples"),
        (as_much_as_may_be, "its samples lack"),
        (of_a_far_subtask, "its commands do not belong together"),
    ],
)
def test_samples_that_would_fill_a_memory_are_named(
    copied: EpisodeStore, packed: Callable[[dict[str, Any]], bytes], said: str
) -> None:
    episode = next(copied.episodes())
    (episode.path / "samples.xz").write_bytes(packed(episode.arrays))
    found = command("dataset", "check", copied.path)
    assert_refused(found, 1, said)
    assert episode.name in found.text


def test_what_would_not_be_read_is_not_written() -> None:
    with pytest.raises(samples.BadSamples, match=r"take 160 MB.*record fewer samples a second"):
        samples.packed({"packed_states": np.empty((20_000, 2000), np.float32)})
    assert samples.unpacked(samples.packed({"a": np.ones((7, 3))}))["a"].sum() == 21.0


def test_an_episode_of_very_many_rows_is_not_folded(copied: EpisodeStore) -> None:
    episode = next(copied.episodes())
    arrays = {**episode.arrays, "robot_qpos": np.zeros((200_000, 12), np.float32)}
    (episode.path / "samples.xz").write_bytes(samples.packed(arrays))
    said_otherwise(episode.path / "unit.json", samples=200_000)
    with pytest.raises(NotADataset, match="an episode has 200000 rows: expected 1 to"):
        list(stream_of(copied).episodes())


@pytest.fixture(scope="module")
def sets(filmed_store: EpisodeStore, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a data set of each format."""
    out, found = tmp_path_factory.mktemp("sets"), stream_of(filmed_store, ("depth",))
    kept = list(found.episodes())
    for kind in ("lerobot", "lerobot-v2.1", "robomimic", "zarr"):
        write_set(EpisodeStream(found.found, lambda: iter(kept), found.page), kind, out / kind)
    return out


def said_otherwise(path: Path, **values: Any) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))


def many_rows_of_zarr(folder: Path) -> None:
    for name in ("state", "action", "environment_state"):
        array = folder / "data" / name / ".zarray"
        sides = json.loads(array.read_text())["shape"][1:]
        said_otherwise(array, shape=[ROWS, *sides])
    np_ends = np.full(json.loads((folder / "meta/episode_ends/.zarray").read_text())["chunks"][0], ROWS, "<i8")
    (folder / "meta/episode_ends/0").write_bytes(zlib.compress(np_ends.tobytes()))


def wide_rows_of_zarr(folder: Path) -> None:
    said_otherwise(folder / "data/state/.zarray", shape=[600, 900_000], chunks=[1, 900_000])


def a_bomb_in_zarr(folder: Path) -> None:
    (folder / "data/state/0.0").write_bytes(zlib_bomb())


def a_long_line(folder: Path) -> None:
    with (folder / "episodes.jsonl").open("wb") as file:
        for _ in range(400):
            file.write(b" " * 1_000_000)


def many_things(folder: Path) -> None:
    said_otherwise(folder / ".zattrs", objects=10**8)


def many_rows_of_hdf5(folder: Path) -> None:
    with h5py.File(folder / "demonstrations.hdf5", "r+") as file:
        demo = file["data/demo_0"]
        for name in ("actions_hand", "actions_absolute", "obs/robot_qpos"):
            width = demo[name].shape[1]
            del demo[name]
            demo.create_dataset(name, (ROWS, width), np.float32, chunks=(1000, width), compression="gzip")


def a_bomb_in_hdf5(folder: Path) -> None:
    with h5py.File(folder / "demonstrations.hdf5", "r+") as file:
        demo = file["data/demo_0"]
        shape = demo["obs/environment_state"].shape
        del demo["obs/environment_state"]
        made = demo.create_dataset("obs/environment_state", shape, np.float32, chunks=shape, compression="gzip")
        made.id.write_direct_chunk((0, 0), zlib_bomb())


def large_chunks_of_hdf5(folder: Path) -> None:
    with h5py.File(folder / "demonstrations.hdf5", "r+") as file:
        demo = file["data/demo_0"]
        kept = demo["obs/robot_qvel"][:]
        del demo["obs/robot_qvel"]
        sides = {"maxshape": (None, 12), "chunks": (8_000_000, 12), "compression": "gzip"}
        demo.create_dataset("obs/robot_qvel", data=kept, **sides)


def table_of(folder: Path) -> tuple[Path, Any]:
    path = folder / "data/chunk-000/episode_000000.parquet"
    return path, parquet.read_table(path)


def many_rows_of_parquet(folder: Path) -> None:
    path, _ = table_of(folder)
    rows = 2_000_000
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int8)), pa.array([0.0], pa.float32()))
    lists = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(12 * rows, np.float32)), 12)
    parquet.write_table(pa.table({"action.joint_target": lists, "next.reward": column}), path, row_group_size=rows)


def many_numbers_of_parquet(folder: Path) -> None:
    path, table = table_of(folder)
    count = table.num_rows
    zeros = pa.array(np.zeros(40_000_000, np.float32))
    starts = np.zeros(count + 1, np.int32)
    starts[1:] = len(zeros)
    place = table.schema.get_field_index("action")
    table = table.set_column(place, "action", pa.ListArray.from_arrays(starts, zeros))
    parquet.write_table(table.replace_schema_metadata(None), path)


def packed_tightly(folder: Path) -> None:
    path, table = table_of(folder)
    parquet.write_table(table, path, compression="zstd")


def a_large_picture(folder: Path) -> None:
    path = sorted(folder.rglob("*.mp4"))[0]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 8000, 6000, "yuv420p"
        stream.options = {"preset": "ultrafast"}
        stream.codec_context.thread_count = 1
        frame = av.VideoFrame.from_ndarray(np.zeros((9000, 8000), np.uint8), format="yuv420p")
        container.mux([*stream.encode(frame), *stream.encode()])


HOSTILE: dict[str, tuple[str, Callable[[Path], None], str]] = {
    "rows of zarr": ("zarr", many_rows_of_zarr, "an episode has 100000000 rows"),
    "wide rows of zarr": ("zarr", wide_rows_of_zarr, "state has rows [900000]"),
    "a bomb in zarr": ("zarr", a_bomb_in_zarr, "cannot be read as what was exported"),
    "a long line": ("zarr", a_long_line, "a line of episodes.jsonl is longer than 8 MB"),
    "many things": ("zarr", many_things, "its episodes have 100000000 objects"),
    "rows of HDF5": ("robomimic", many_rows_of_hdf5, "an episode has 100000001 rows"),
    "a bomb in HDF5": ("robomimic", a_bomb_in_hdf5, "a chunk of /data/demo_0/obs/environment_state is torn"),
    "large chunks of HDF5": ("robomimic", large_chunks_of_hdf5, "is not packed as this program does it"),
    "rows of parquet": ("lerobot-v2.1", many_rows_of_parquet, "an episode has 2000000 rows"),
    "numbers of parquet": ("lerobot-v2.1", many_numbers_of_parquet, "action has 40000"),
    "parquet packed tightly": ("lerobot-v2.1", packed_tightly, "is packed by ZSTD"),
    "a large picture": ("lerobot-v2.1", a_large_picture, "mp4"),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", HOSTILE)
def test_data_sets_that_would_fill_a_memory_are_refused(sets: Path, what: str, tmp_path: Path) -> None:
    kind, spoil, said = HOSTILE[what]
    folder = Path(shutil.copytree(sets / kind, tmp_path / "set"))
    spoil(folder)
    found = command("dataset", "convert", folder, "--format", "robomimic", "--out", tmp_path / "out")
    assert_refused(found, 1 if what == "a large picture" else 2, said)
