"""LeRobotDataset, v3.0 and v2.1, written with pyarrow: no trainer's library is needed for it.

v3.0: many episodes a file, one row group an episode, frames of videos found by `from_timestamp`. v2.1: a parquet file
and a video an episode, as openpi and GR00T's own loader read it. Depth and segmentation are PNG of 16 bits in the rows,
features of the type `image`, so that no number of them is lost. Both versions have `meta/scene2demo.json` with what the
format has no place for, and `meta/scene2demo_episodes.jsonl` with a line an episode.

Source: lerobot 0.6.1, `src/lerobot/datasets/`, for v3.0; lerobot 0.3.3 for v2.1.
"""

from __future__ import annotations

import io
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from executor.datasets.formats.lerobot_features import (
    ABOUT,
    DATA_PATHS,
    EPISODES,
    IN_A_CHUNK,
    LINES,
    VIDEO_PATHS,
    Version,
    features_of,
    modalities_of,
    picture_key,
    whole_fps,
)
from executor.datasets.formats.statistics import Spool, Statistics, Tones, statistics, thinned
from executor.datasets.formats.stream import FoldedEpisode, Survey, about_text
from executor.datasets.formats.videos import Clip, Reel, as_video, depth_tones
from executor.machine.extras import require
from executor.machine.files import plain, write_json

DATA_FILE_BYTES, VIDEO_FILE_BYTES = 100_000_000, 200_000_000
"""A file that has become so large is followed by another one."""
_IN_A_BATCH = 20  # Lines about episodes that are in memory at once.
_PNG_LEVEL = 3  # Half the time of the usual level, for 5 % more bytes.


def write_lerobot(
    episodes: Iterable[FoldedEpisode], found: Survey, folder: Path, aside: Path, version: Version = "v3.0"
) -> None:
    """Writes a LeRobotDataset into an empty folder.

    Args:
        episodes: In order.
        found: What they have in common.
        folder: It exists.
        aside: Another empty folder, for what is needed while writing.
        version: Of the format.

    Raises:
        VideoFailed: An episode's video cannot be read.
        MissingExtra: pyarrow or PyAV is not installed.
        OSError: The folder cannot be written.
    """
    with ExitStack() as open_files:
        _Writer(found, folder, aside, version, open_files).write(episodes)


class _Writer:
    """The files of one data set."""

    def __init__(self, found: Survey, folder: Path, aside: Path, version: Version, open_files: ExitStack) -> None:
        self._pa: Any = require("pyarrow", "data")
        self._parquet: Any = require("pyarrow.parquet", "data")
        self._found, self._folder, self._version = found, folder, version
        self._features = features_of(found, version)
        self._schema = self._pa.schema(
            [(name, self._kind(told)) for name, told in self._columns().items()], metadata=self._marks()
        )
        self._spool, self._aside = Spool(aside), aside
        self._tones: dict[str, Tones] = {}
        self._tasks: dict[str, int] = {}
        self._episodes_of: Counter[str] = Counter()
        self._subtasks: dict[str, int] = {}
        self._open_files = open_files
        self._data: Any = None
        self._data_file = -1
        self._reels: dict[str, tuple[int, Reel]] = {}
        self._rows = self._count = 0
        (folder / "meta").mkdir()

    def write(self, episodes: Iterable[FoldedEpisode]) -> None:
        with (self._folder / LINES).open("w", encoding="utf-8") as about:
            self._write_episodes(self._one_by_one(episodes, about))
        self._open_files.close()
        self._write_texts("task", self._tasks)
        self._write_texts("subtask", self._subtasks)
        stats = {name: self._shaped(name, one) for name, one in self._spool.statistics().items()}
        stats |= {key: tones.statistics() for key, tones in self._tones.items()}
        write_json(self._folder / "meta" / "stats.json", stats)
        write_json(self._folder / "meta" / "info.json", self._info())
        write_json(self._folder / ABOUT, self._found.to_json())
        if self._version == "v2.1":
            write_json(self._folder / "meta" / "modality.json", modalities_of(self._found))

    def _columns(self) -> dict[str, dict[str, Any]]:
        return {name: told for name, told in self._features.items() if told["dtype"] != "video"}

    def _kind(self, told: Mapping[str, Any]) -> Any:
        pa = self._pa
        if told["dtype"] == "image":
            return pa.struct([("bytes", pa.binary()), ("path", pa.string())])
        one = {"float32": pa.float32, "int64": pa.int64, "bool": pa.bool_}[told["dtype"]]()
        # Readers take what has one number a row for a number, and refuse a list of one.
        if told["shape"] == [1]:
            return one
        return pa.list_(one, told["shape"][0]) if len(told["shape"]) == 1 else pa.list_(pa.list_(one))

    def _marks(self) -> dict[str, str] | None:
        """Returns what tells readers that do not look into `info.json` which columns are pictures."""
        pictures = {name: {"_type": "Image"} for name, told in self._columns().items() if told["dtype"] == "image"}
        return {"huggingface": json.dumps({"info": {"features": pictures}})} if pictures else None

    def _shaped(self, name: str, found: Statistics) -> Statistics:
        """Returns statistics of a column in the shape that its rows are divided by."""
        if len(self._features[name]["shape"]) == 1:
            return found
        return {what: numbers if what == "count" else numbers[None] for what, numbers in found.items()}

    def _one_by_one(self, episodes: Iterable[FoldedEpisode], about: Any) -> Iterator[dict[str, Any]]:
        """Writes each episode's rows and videos, and yields what the list of episodes says of it."""
        for episode in episodes:
            sentence = self._sentence(episode)
            rows = self._rows_of(episode, sentence)
            stats = {name: self._shaped(name, statistics(thinned(values))) for name, values in rows.items()}
            encoded: dict[str, list[bytes]] = {}
            for view, kind in self._found.clips:
                if kind:
                    key = picture_key(view, kind)
                    encoded[key], tones = _encoded(episode.clips[view, kind], episode.length)
                    self._tones.setdefault(key, Tones(1, 1 << 16, 1.0)).merge(tones)
                    stats[key] = tones.statistics()
            told = {
                "episode_index": episode.index,
                "tasks": [sentence],
                "length": episode.length,
                **self._write_rows({**rows, **encoded}, episode.index),
                "dataset_from_index": self._rows,
                "dataset_to_index": self._rows + episode.length,
            }
            for view in self._found.views:
                key = picture_key(view, "")
                written, tones = self._write_video(view, episode)
                told |= written
                self._tones.setdefault(key, Tones()).merge(tones)
                stats[key] = tones.statistics()
            for name, values in rows.items():
                self._spool.add(name, thinned(values))
            about.write(about_text(episode.about) + "\n")
            self._rows += episode.length
            self._count += 1
            yield told | {"stats": stats}

    def _sentence(self, episode: FoldedEpisode) -> str:
        """Return what an episode's task is called: of those of one query, the query, then each paraphrase in turn."""
        sentences = (episode.task, *(episode.about["paraphrases"] or ()))
        place = self._episodes_of[episode.task]
        self._episodes_of[episode.task] += 1
        return sentences[place % len(sentences)]

    def _rows_of(self, episode: FoldedEpisode, sentence: str) -> dict[str, Any]:
        count = episode.length
        frames = np.arange(count, dtype=np.int64)
        task = self._tasks.setdefault(sentence, len(self._tasks))
        texts = np.array([self._subtasks.setdefault(text, len(self._subtasks)) for text in episode.subtasks])
        columns = dict(episode.columns)
        columns["subtask_index"] = texts[columns["subtask_index"]].astype(np.int64)
        columns |= {
            "timestamp": (frames / self._found.rate_hz).astype(np.float32),
            "frame_index": frames,
            "episode_index": np.full(count, episode.index, np.int64),
            "index": frames + self._rows,
            "task_index": np.full(count, task, np.int64),
        }
        return {name: columns[name] for name in self._columns() if name in columns}

    def _write_rows(self, rows: Mapping[str, Sequence[bytes] | NDArray[Any]], index: int) -> dict[str, int]:
        table = self._pa.Table.from_arrays(
            [self._array(rows[name], kind) for name, kind in zip(self._schema.names, self._schema.types, strict=True)],
            schema=self._schema,
        )
        if self._version == "v2.1":
            path = self._place(DATA_PATHS["v2.1"], episode_chunk=index // IN_A_CHUNK, episode_index=index)
            self._parquet.write_table(table, path)
            return {}
        if self._data is None or self._data_path().stat().st_size >= DATA_FILE_BYTES:
            if self._data is not None:
                self._data.close()
            self._data_file += 1
            self._data = self._open_files.enter_context(self._parquet.ParquetWriter(self._data_path(), self._schema))
        # Readers fetch an episode by the number of its row group.
        self._data.write_table(table, row_group_size=max(len(table), 1))
        return {f"data/{name}": value for name, value in _numbers(self._data_file).items()}

    def _array(self, values: Sequence[bytes] | NDArray[Any], kind: Any) -> Any:
        """Returns the rows of a column as an array of its kind."""
        pa = self._pa
        if not isinstance(values, np.ndarray):
            paths = pa.nulls(len(values), pa.string())
            return pa.StructArray.from_arrays([pa.array(values, pa.binary()), paths], fields=list(kind))
        if kind in (pa.float32(), pa.int64(), pa.bool_()):
            return pa.array(values.reshape(-1))
        numbers = pa.array(np.ascontiguousarray(values).ravel())
        if values.ndim == 2:
            return pa.FixedSizeListArray.from_arrays(numbers, values.shape[1])
        count, points, width = values.shape
        inner = pa.ListArray.from_arrays(np.arange(count * points + 1, dtype=np.int32) * width, numbers)
        return pa.ListArray.from_arrays(np.arange(count + 1, dtype=np.int32) * points, inner)

    def _data_path(self) -> Path:
        return self._place(DATA_PATHS["v3.0"], **_numbers(self._data_file))

    def _write_video(self, view: str, episode: FoldedEpisode) -> tuple[dict[str, Any], Tones]:
        """Writes an episode's pictures in colours; returns where they are, and how bright."""
        key, pattern, rate_hz = picture_key(view, ""), VIDEO_PATHS[self._version], self._found.rate_hz
        made = self._aside / f"{view}.mp4"
        clip = as_video(episode.clips[view, ""], made, rate_hz, episode.length)
        told: dict[str, Any] = {}
        if self._version == "v2.1":
            number = {"episode_chunk": episode.index // IN_A_CHUNK, "episode_index": episode.index}
            with closing(Reel(self._place(pattern, video_key=key, **number), rate_hz)) as alone:
                alone.add(clip)
        else:
            file, reel = self._reel(view)
            begins_s, ends_s = reel.add(clip)
            told = {**_numbers(file), "from_timestamp": begins_s, "to_timestamp": ends_s}
        tones = clip.tones()
        made.unlink(missing_ok=True)
        return {f"videos/{key}/{name}": value for name, value in told.items()}, tones

    def _reel(self, view: str) -> tuple[int, Reel]:
        """Returns the video that a view's pictures go to, and its number."""
        file, reel = self._reels.get(view, (-1, None))
        if reel is None or reel.bytes >= VIDEO_FILE_BYTES:
            if reel is not None:
                reel.close()
            file += 1
            place = self._place(VIDEO_PATHS["v3.0"], video_key=picture_key(view, ""), **_numbers(file))
            reel = Reel(place, self._found.rate_hz)
            self._open_files.callback(reel.close)
            self._reels[view] = file, reel
        return file, reel

    def _write_episodes(self, told: Iterator[dict[str, Any]]) -> None:
        """Writes the list of episodes, some at a time."""
        if self._version == "v2.1":
            meta = self._folder / "meta"
            with (meta / "episodes.jsonl").open("w") as lines, (meta / "episodes_stats.jsonl").open("w") as stats:
                for one in told:
                    short = {name: one[name] for name in ("episode_index", "tasks", "length")}
                    lines.write(json.dumps(short, ensure_ascii=False) + "\n")
                    full = {"episode_index": one["episode_index"], "stats": plain(one["stats"])}
                    stats.write(json.dumps(full) + "\n")
            return
        path = self._place(EPISODES)
        writer: Any = None
        batch: list[dict[str, Any]] = []
        for one in told:
            batch.append(_flat(one))
            if len(batch) == _IN_A_BATCH:
                writer = self._write_batch(writer, path, batch)
        if batch:
            self._write_batch(writer, path, batch)

    def _write_batch(self, writer: Any, path: Path, batch: list[dict[str, Any]]) -> Any:
        table = self._pa.Table.from_pylist(batch, schema=None if writer is None else writer.schema)
        if writer is None:
            writer = self._open_files.enter_context(self._parquet.ParquetWriter(path, table.schema))
        writer.write_table(table)
        batch.clear()
        return writer

    def _write_texts(self, name: str, texts: Mapping[str, int]) -> None:
        """Writes the sentences that an index stands for: v3.0 as a table that pandas reads with its index."""
        if self._version == "v2.1":
            lines = [json.dumps({f"{name}_index": k, name: text}, ensure_ascii=False) for text, k in texts.items()]
            (self._folder / "meta" / f"{name}s.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
            return
        pa, number = self._pa, f"{name}_index"
        table = pa.table({number: pa.array(list(texts.values()), pa.int64()), name: list(texts)})
        column = {"field_name": number, "name": number, "pandas_type": "int64", "numpy_type": "int64", "metadata": None}
        label = {"field_name": name, "name": name, "pandas_type": "unicode", "numpy_type": "object", "metadata": None}
        told = {"index_columns": [name], "column_indexes": [], "columns": [column, label], "pandas_version": "2.0.0"}
        table = table.replace_schema_metadata({b"pandas": json.dumps(told).encode()})
        self._parquet.write_table(table, self._folder / "meta" / f"{name}s.parquet")

    def _info(self) -> dict[str, Any]:
        splits = {name: f"{part.start}:{part.stop}" for name, part in self._found.splits.items() if part}
        old = {
            "total_videos": self._count * len(self._found.views),
            "total_chunks": -(-self._count // IN_A_CHUNK),
        }
        new = {"data_files_size_in_mb": DATA_FILE_BYTES // 10**6, "video_files_size_in_mb": VIDEO_FILE_BYTES // 10**6}
        return {
            "codebase_version": self._version,
            "robot_type": "scene2demo_mobile_panda",
            "total_episodes": self._count,
            "total_frames": self._rows,
            "total_tasks": len(self._tasks),
            "chunks_size": IN_A_CHUNK,
            "fps": whole_fps(self._found),
            "splits": splits,
            "data_path": DATA_PATHS[self._version],
            "video_path": VIDEO_PATHS[self._version] if self._found.views else None,
            "features": self._features,
            **(old if self._version == "v2.1" else new),
        }

    def _place(self, pattern: str, **numbers: object) -> Path:
        path = self._folder / pattern.format(**numbers)
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


def _encoded(clip: Clip, count: int) -> tuple[list[bytes], Tones]:
    """Returns an episode's pictures of one number a point as PNG, and how often each number occurs."""
    made: list[bytes] = []

    def seen() -> Iterator[NDArray[np.uint16]]:
        for picture in clip.pictures():
            stream = io.BytesIO()
            Image.fromarray(picture).save(stream, "PNG", compress_level=_PNG_LEVEL)
            made.append(stream.getvalue())
            yield picture

    return made, depth_tones(seen(), count)


def _numbers(file: int) -> dict[str, int]:
    return {"chunk_index": file // IN_A_CHUNK, "file_index": file % IN_A_CHUNK}


def _flat(told: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a line of the list of episodes, a column a number of its statistics."""
    stats: Mapping[str, Statistics] = told["stats"]
    return {
        **{name: value for name, value in told.items() if name != "stats"},
        **{
            f"stats/{feature}/{name}": values.tolist() for feature, one in stats.items() for name, values in one.items()
        },
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
