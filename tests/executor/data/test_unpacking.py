"""What somebody has packed to fill a memory is refused within 300 MB and 10 s, and named."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executor.data import samples
from executor.data.formats.export import write_set
from executor.data.formats.store_reader import stream_of
from executor.data.store import EpisodeStore, NotADataset
from tests.executor.hostile_packing import BOMB_BYTES, assert_refused, command, xz_bomb

pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")
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
def exported(made_store: EpisodeStore, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a data set of a table an episode."""
    out = tmp_path_factory.mktemp("sets") / "set"
    write_set(stream_of(made_store), "lerobot-v2.1", out)
    return out


def said_otherwise(path: Path, **values: Any) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))


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


def a_long_line(folder: Path) -> None:
    with (folder / "meta/scene2demo_episodes.jsonl").open("wb") as file:
        for _ in range(400):
            file.write(b" " * 1_000_000)


def many_things(folder: Path) -> None:
    said_otherwise(folder / "meta/scene2demo.json", objects=10**8)


HOSTILE: dict[str, tuple[Callable[[Path], None], str]] = {
    "a long line": (a_long_line, "a line of scene2demo_episodes.jsonl is longer than 8 MB"),
    "many things": (many_things, "its episodes have 100000000 objects"),
    "rows of parquet": (many_rows_of_parquet, "an episode has 2000000 rows"),
    "numbers of parquet": (many_numbers_of_parquet, "action has 40000"),
    "parquet packed tightly": (packed_tightly, "is packed by ZSTD"),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", HOSTILE)
def test_data_sets_that_would_fill_a_memory_are_refused(exported: Path, what: str, tmp_path: Path) -> None:
    spoil, said = HOSTILE[what]
    folder = Path(shutil.copytree(exported, tmp_path / "set"))
    spoil(folder)
    assert_refused(command("replay", folder, "--through", "env"), 2, said)
