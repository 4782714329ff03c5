"""LeRobotDataset v3.0 and v2.1: names of files and columns, writer (pyarrow, no trainer's library), and reader.

v3.0 has many episodes per file, one row group per episode, and video frames located by `from_timestamp`. v2.1 has one
parquet file and one video per episode, as openpi and GR00T's own loader read it. Depth and segmentation are 16-bit PNG
in the rows, features of the type `image`, without loss. Both versions have `meta/scene2demo.json` for metadata that the
format has no place for, and `meta/scene2demo_episodes.jsonl` with a line per episode. The reader finds files by the
format's names, not by the patterns that a data set states.

Source: lerobot 0.6.1, `src/lerobot/datasets/`, for v3.0; lerobot 0.3.3 for v2.1; Isaac-GR00T's guide to data that it
reads, for `modality.json`.
"""

from __future__ import annotations

import io
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bddl.files import open_input
from executor.data.episode import CLOUD, SCALARS, Clip, Episode, derived_columns, metadata_line
from executor.data.formats.statistics import ColumnSpool, IntensityHistogram, Statistics, statistics, subsample_rows
from executor.data.formats.table import CLOUD_SHAPE, MOST_EPISODE_BYTES, DatasetSpec, read_metadata_lines
from executor.data.formats.videos import VideoClip, VideoWriter, depth_histogram
from executor.data.views import DEPTH
from executor.sim.robot.actions import BASE_NUMBERS_FROM, OPENING, hand_numbers
from executor.system.extras import require
from executor.system.files import plain, read_json, write_json
from oag.model.robots import FULL_SIZE, PAPER_ROBOT, Robot

Version = Literal["v3.0", "v2.1"]

EPISODES_PER_CHUNK = 1000
ABOUT, LINES = "meta/scene2demo.json", "meta/scene2demo_episodes.jsonl"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
VIDEO_PATHS = {
    "v3.0": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    "v2.1": "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
}
DATA_PATHS = {
    "v3.0": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "v2.1": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
}
_COUNTERS = ("timestamp", "frame_index", "episode_index", "index", "task_index")
_HAND_PARTS = {"hand_position": (0, 3), "hand_turn": (3, 6), "gripper": (OPENING, BASE_NUMBERS_FROM)}


def features_of(found: DatasetSpec, version: Version) -> dict[str, dict[str, Any]]:
    """Return the features of `info.json`, in the order of the columns."""
    counters = {name: "float32" if name == "timestamp" else "int64" for name in _COUNTERS}
    features: dict[str, dict[str, Any]] = {
        name: {"dtype": "float32", "shape": [len(names)], "names": list(names)} for name, names in found.vectors.items()
    }
    if found.point_cloud:
        features[CLOUD] = {"dtype": "float32", "shape": list(CLOUD_SHAPE), "names": ["point", "x_y_z_hand"]}
    features |= {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in {**SCALARS, **counters}.items()}
    channels = "channels" if version == "v3.0" else "channel"
    for view, kind in found.clips:
        width, height = found.views[view]
        picture_info = {
            "video.height": height,
            "video.width": width,
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": fps_number(found),
            "video.channels": 3,
            "has_audio": False,
        }
        if kind:
            picture_info = {"is_depth_map": kind == DEPTH, **({"depth_unit": "mm"} if kind == DEPTH else {})}
        features[picture_key(view, kind)] = {
            "dtype": "image" if kind else "video",
            "shape": [height, width, 1 if kind else 3],
            "names": ["height", "width", channels],
            "info": picture_info,
        }
    return features


def picture_key(view: str, kind: str) -> str:
    """Return the feature name of a view's pictures of a kind."""
    # The name must not make a policy take segmentation for colours.
    return f"observation.{kind}.{view}" if kind else f"observation.images.{view}"


def robot_type(robot: Robot) -> str:
    """Return the type of a robot in `info.json`: that of the Pandas without a lift is the one that it always was."""
    return "scene2demo_mobile_panda" if robot in (PAPER_ROBOT, FULL_SIZE) else f"scene2demo_{robot.name}"


def modalities_of(found: DatasetSpec) -> dict[str, Any]:
    """Return `modality.json`, GR00T's description of the numbers of state and actions."""

    def parts(named: dict[str, tuple[int, int]], column: str) -> dict[str, Any]:
        return {name: {"start": first, "end": end, "original_key": column} for name, (first, end) in named.items()}

    robot = found.robot_record
    joints = len(robot.joint_names)
    slices = {"base": robot.base, "arm": robot.arm, "fingers": robot.fingers}
    of_joints = {name: (part.start, part.stop) for name, part in slices.items()}
    state = of_joints | {"hand_position": (joints, joints + 3), "hand_quaternion": (joints + 3, joints + 7)}
    action = _HAND_PARTS | {"base": (BASE_NUMBERS_FROM, hand_numbers(robot))}
    targets = {f"{name}_target": span for name, span in of_joints.items()}
    return {
        "state": parts(state, "observation.state"),
        "action": parts(action, "action") | parts(targets, "action.joint_target"),
        "video": {view: {"original_key": picture_key(view, "")} for view in found.views},
        "annotation": {"human.task_description": {"original_key": "task_index"}},
    }


def fps_number(found: DatasetSpec) -> float | int:
    """Return rows per second, as an integer where it is one."""
    return int(found.rate_hz) if found.rate_hz.is_integer() else found.rate_hz


DATA_FILE_BYTES, VIDEO_FILE_BYTES = 100_000_000, 200_000_000
"""Size at which a new file begins."""
_LINES_PER_BATCH = 20  # Lines of the list of episodes in memory at once.
_PNG_LEVEL = 3  # Half the time of the usual level, for 5 % more bytes.


def write_lerobot(
    episodes: Iterable[Episode], found: DatasetSpec, folder: Path, aside: Path, version: Version = "v3.0"
) -> None:
    """Write a LeRobotDataset into an empty folder.

    Args:
        episodes: The episodes, in order.
        found: Their common properties.
        folder: An existing folder.
        aside: Another empty folder, for temporary files.
        version: Version of the format.

    Raises:
        VideoFailed: An episode's video is unreadable.
        MissingExtra: pyarrow or PyAV is not installed.
        OSError: The folder cannot be written.
    """
    with ExitStack() as open_files:
        _Writer(found, folder, aside, version, open_files).write(episodes)


class _Writer:
    """Files of one data set."""

    def __init__(self, found: DatasetSpec, folder: Path, aside: Path, version: Version, open_files: ExitStack) -> None:
        self._pa: Any = require("pyarrow", "data")
        self._parquet: Any = require("pyarrow.parquet", "data")
        self._found, self._folder, self._version = found, folder, version
        self._features = features_of(found, version)
        self._schema = self._pa.schema(
            [(name, self._kind(feature)) for name, feature in self._columns().items()], metadata=self._marks()
        )
        self._spool = ColumnSpool(aside)
        self._histograms: dict[str, IntensityHistogram] = {}
        self._tasks: dict[str, int] = {}
        self._episodes_of: Counter[str] = Counter()
        self._subtasks: dict[str, int] = {}
        self._open_files = open_files
        self._data: Any = None
        self._data_file = -1
        self._videos: dict[str, tuple[int, VideoWriter]] = {}
        self._rows = self._count = 0
        (folder / "meta").mkdir()

    def write(self, episodes: Iterable[Episode]) -> None:
        with (self._folder / LINES).open("w", encoding="utf-8") as about:
            self._write_episodes(self._one_by_one(episodes, about))
        self._open_files.close()
        self._write_texts("task", self._tasks)
        self._write_texts("subtask", self._subtasks)
        stats = {name: self._shaped(name, one) for name, one in self._spool.statistics().items()}
        stats |= {key: histogram.statistics() for key, histogram in self._histograms.items()}
        write_json(self._folder / "meta" / "stats.json", stats)
        write_json(self._folder / "meta" / "info.json", self._info())
        write_json(self._folder / ABOUT, self._found.to_json())
        if self._version == "v2.1":
            write_json(self._folder / "meta" / "modality.json", modalities_of(self._found))

    def _columns(self) -> dict[str, dict[str, Any]]:
        return {name: feature for name, feature in self._features.items() if feature["dtype"] != "video"}

    def _kind(self, feature: Mapping[str, Any]) -> Any:
        pa = self._pa
        if feature["dtype"] == "image":
            return pa.struct([("bytes", pa.binary()), ("path", pa.string())])
        one = {"float32": pa.float32, "int64": pa.int64, "bool": pa.bool_}[feature["dtype"]]()
        # Readers expect a scalar for one number per row, and refuse a list of one.
        if feature["shape"] == [1]:
            return one
        return pa.list_(one, feature["shape"][0]) if len(feature["shape"]) == 1 else pa.list_(pa.list_(one))

    def _marks(self) -> dict[str, str] | None:
        """Return the schema metadata that marks picture columns for readers without `info.json`."""
        pictures = {
            name: {"_type": "Image"} for name, feature in self._columns().items() if feature["dtype"] == "image"
        }
        return {"huggingface": json.dumps({"info": {"features": pictures}})} if pictures else None

    def _shaped(self, name: str, found: Statistics) -> Statistics:
        """Reshape statistics of a column to the shape of its rows."""
        if len(self._features[name]["shape"]) == 1:
            return found
        return {what: numbers if what == "count" else numbers[None] for what, numbers in found.items()}

    def _one_by_one(self, episodes: Iterable[Episode], about: Any) -> Iterator[dict[str, Any]]:
        """Write each episode's rows and videos, and yield its line in the list of episodes."""
        for episode in episodes:
            sentence = self._sentence(episode)
            rows = self._rows_of(episode, sentence)
            stats = {name: self._shaped(name, statistics(subsample_rows(values))) for name, values in rows.items()}
            encoded: dict[str, list[bytes]] = {}
            for view, kind in self._found.clips:
                if kind:
                    key = picture_key(view, kind)
                    encoded[key], histogram = _encode_png(episode.clips[view, kind], episode.length)
                    self._histograms.setdefault(key, IntensityHistogram(1, 1 << 16, 1.0)).merge(histogram)
                    stats[key] = histogram.statistics()
            line = {
                "episode_index": episode.index,
                "tasks": [sentence],
                "length": episode.length,
                **self._write_rows({**rows, **encoded}, episode.index),
                "dataset_from_index": self._rows,
                "dataset_to_index": self._rows + episode.length,
            }
            for view in self._found.views:
                key = picture_key(view, "")
                written, histogram = self._write_video(view, episode)
                line |= written
                self._histograms.setdefault(key, IntensityHistogram()).merge(histogram)
                stats[key] = histogram.statistics()
            for name, values in rows.items():
                self._spool.add(name, subsample_rows(values))
            about.write(metadata_line(episode.about) + "\n")
            self._rows += episode.length
            self._count += 1
            yield line | {"stats": stats}

    def _sentence(self, episode: Episode) -> str:
        """Return an episode's task text: for the episodes of one query, the query and its paraphrases in turn."""
        sentences = (episode.task, *(episode.about["paraphrases"] or ()))
        place = self._episodes_of[episode.task]
        self._episodes_of[episode.task] += 1
        return sentences[place % len(sentences)]

    def _rows_of(self, episode: Episode, sentence: str) -> dict[str, Any]:
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
            path = self._place(DATA_PATHS["v2.1"], episode_chunk=index // EPISODES_PER_CHUNK, episode_index=index)
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
        """Return the rows of a column as an array of its type."""
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

    def _write_video(self, view: str, episode: Episode) -> tuple[dict[str, Any], IntensityHistogram]:
        """Write an episode's colour pictures; return their location and intensity histogram."""
        key, pattern, rate_hz = picture_key(view, ""), VIDEO_PATHS[self._version], self._found.rate_hz
        clip = episode.clips[view, ""]
        assert isinstance(clip, VideoClip)
        place: dict[str, Any] = {}
        if self._version == "v2.1":
            number = {"episode_chunk": episode.index // EPISODES_PER_CHUNK, "episode_index": episode.index}
            with closing(VideoWriter(self._place(pattern, video_key=key, **number), rate_hz)) as writer_of_episode:
                writer_of_episode.add(clip)
        else:
            file, writer = self._video(view)
            begins_s, ends_s = writer.add(clip)
            place = {**_numbers(file), "from_timestamp": begins_s, "to_timestamp": ends_s}
        return {f"videos/{key}/{name}": value for name, value in place.items()}, clip.histogram()

    def _video(self, view: str) -> tuple[int, VideoWriter]:
        """Return the current video file of a view, and its number."""
        file, writer = self._videos.get(view, (-1, None))
        if writer is None or writer.bytes >= VIDEO_FILE_BYTES:
            if writer is not None:
                writer.close()
            file += 1
            place = self._place(VIDEO_PATHS["v3.0"], video_key=picture_key(view, ""), **_numbers(file))
            writer = VideoWriter(place, self._found.rate_hz)
            self._open_files.callback(writer.close)
            self._videos[view] = file, writer
        return file, writer

    def _write_episodes(self, episode_lines: Iterator[dict[str, Any]]) -> None:
        """Write the list of episodes, in batches."""
        if self._version == "v2.1":
            meta = self._folder / "meta"
            with (meta / "episodes.jsonl").open("w") as lines, (meta / "episodes_stats.jsonl").open("w") as stats:
                for one in episode_lines:
                    short = {name: one[name] for name in ("episode_index", "tasks", "length")}
                    lines.write(json.dumps(short, ensure_ascii=False) + "\n")
                    full = {"episode_index": one["episode_index"], "stats": plain(one["stats"])}
                    stats.write(json.dumps(full) + "\n")
            return
        path = self._place(EPISODES)
        writer: Any = None
        batch: list[dict[str, Any]] = []
        for one in episode_lines:
            batch.append(_flat(one))
            if len(batch) == _LINES_PER_BATCH:
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
        """Write the sentences of an index; v3.0 as a table that pandas reads with its index."""
        if self._version == "v2.1":
            lines = [json.dumps({f"{name}_index": k, name: text}, ensure_ascii=False) for text, k in texts.items()]
            (self._folder / "meta" / f"{name}s.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
            return
        pa, number = self._pa, f"{name}_index"
        table = pa.table({number: pa.array(list(texts.values()), pa.int64()), name: list(texts)})
        column = {"field_name": number, "name": number, "pandas_type": "int64", "numpy_type": "int64", "metadata": None}
        label = {"field_name": name, "name": name, "pandas_type": "unicode", "numpy_type": "object", "metadata": None}
        pandas_schema = {
            "index_columns": [name],
            "column_indexes": [],
            "columns": [column, label],
            "pandas_version": "2.0.0",
        }
        table = table.replace_schema_metadata({b"pandas": json.dumps(pandas_schema).encode()})
        self._parquet.write_table(table, self._folder / "meta" / f"{name}s.parquet")

    def _info(self) -> dict[str, Any]:
        splits = {name: f"{part.start}:{part.stop}" for name, part in self._found.splits.items() if part}
        old = {
            "total_videos": self._count * len(self._found.views),
            "total_chunks": -(-self._count // EPISODES_PER_CHUNK),
        }
        new = {"data_files_size_in_mb": DATA_FILE_BYTES // 10**6, "video_files_size_in_mb": VIDEO_FILE_BYTES // 10**6}
        return {
            "codebase_version": self._version,
            "robot_type": robot_type(self._found.robot_record),
            "total_episodes": self._count,
            "total_frames": self._rows,
            "total_tasks": len(self._tasks),
            "chunks_size": EPISODES_PER_CHUNK,
            "fps": fps_number(self._found),
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


def _encode_png(clip: Clip, count: int) -> tuple[list[bytes], IntensityHistogram]:
    """Return an episode's one-channel pictures as PNG, and their histogram."""
    made: list[bytes] = []

    def encode_each() -> Iterator[NDArray[np.uint16]]:
        for picture in clip.pictures():
            stream = io.BytesIO()
            Image.fromarray(picture).save(stream, "PNG", compress_level=_PNG_LEVEL)
            made.append(stream.getvalue())
            yield picture

    return made, depth_histogram(encode_each(), count)


def _numbers(file: int) -> dict[str, int]:
    return {"chunk_index": file // EPISODES_PER_CHUNK, "file_index": file % EPISODES_PER_CHUNK}


def _flat(line: Mapping[str, Any]) -> dict[str, Any]:
    """Flatten a line of the list of episodes, one column per statistic."""
    stats: Mapping[str, Statistics] = line["stats"]
    return {
        **{name: value for name, value in line.items() if name != "stats"},
        **{
            f"stats/{feature}/{name}": values.tolist() for feature, one in stats.items() for name, values in one.items()
        },
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }


_PACKED = frozenset({"SNAPPY", "UNCOMPRESSED"})
"""Compressions of this program's tables. Others expand a byte to a thousand, these to twenty."""

_LINES_AT_ONCE = 16  # Lines of the list of episodes in memory at once.
_BUFFER_BYTES = 1 << 20
_END_BYTES = 8  # Length of a table's metadata, and the magic number.
_MOST_ABOUT_BYTES = 16_000_000

_RowGroup = tuple[Any, int]
"""An opened parquet file, and the number of an episode's row group in it."""


def read_lerobot(folder: Path) -> tuple[DatasetSpec, Callable[[], Iterator[Episode]]]:
    """Read a data set of version 3.0 or 2.1 without its pictures: common properties, and an iteration over episodes.

    Args:
        folder: The data set.

    Raises:
        OSError, ValueError, KeyError, TypeError, IndexError: It was not written by this program; raised here or during
            the iteration.
        MissingExtra: pyarrow is not installed.
    """
    found = DatasetSpec.from_json(read_json(folder / ABOUT))
    version = read_json(folder / "meta" / "info.json")["codebase_version"]
    if version not in DATA_PATHS:
        raise ValueError(f"its version is {version!r}: expected {' or '.join(DATA_PATHS)}")
    return found, partial(_read_episodes, folder, found, version)


def _read_episodes(folder: Path, found: DatasetSpec, version: Version) -> Iterator[Episode]:
    widths = {**{name: len(numbers) for name, numbers in found.vectors.items()}, **dict.fromkeys(SCALARS, 1)}
    widths |= {CLOUD: math.prod(CLOUD_SHAPE)} if found.point_cloud else {}
    groups = _row_groups_v30(folder) if version == "v3.0" else _row_groups_v21(folder, found.count)
    for index, (about, group) in enumerate(zip(read_metadata_lines(folder / LINES), groups, strict=True)):
        count = _check(group, widths, found)
        table = group[0].read_row_group(group[1], columns=list(widths), use_threads=False)
        columns = {name: _column(table, name, (count, len(numbers))) for name, numbers in found.vectors.items()}
        if found.point_cloud:
            columns[CLOUD] = _column(table, CLOUD, (count, *CLOUD_SHAPE))
        columns |= {name: _column(table, name, (count,)) for name in SCALARS}
        # In the file it indexes the sentences of the whole data set.
        columns["subtask_index"] = derived_columns(about, count)["subtask_index"]
        yield Episode(index, columns, {}, about)


def _check(group: _RowGroup, widths: Mapping[str, int], found: DatasetSpec) -> int:
    """Return an episode's number of rows, if as much as its metadata states can be read.

    Args:
        group: Where it lies.
        widths: Column -> numbers per row.
        found: Common properties of the set.

    Raises:
        ValueError: It would take too much memory, or has a compression that this program does not use.
    """
    about, size = group[0].metadata.row_group(group[1]), 0
    for column in map(about.column, range(about.num_columns)):
        if column.compression not in _PACKED:
            raise ValueError(f"{column.path_in_schema} is packed by {column.compression}")
        if (name := column.path_in_schema.partition(".list.")[0]) in widths:
            size += column.total_uncompressed_size
            if column.num_values != widths[name] * about.num_rows:
                raise ValueError(f"{name} has {column.num_values} numbers in {about.num_rows} rows")
    if size > 2 * MOST_EPISODE_BYTES:
        raise ValueError(f"the numbers of an episode take {size // 1_000_000} MB")
    return found.check_length(about.num_rows)


def _row_groups_v30(folder: Path) -> Iterator[_RowGroup]:
    """Yield the row groups of the episodes of version 3.0, in shared files."""
    rows: Any = None
    at: dict[str, int] | None = None
    group = 0
    wanted = ["data/chunk_index", "data/file_index"]
    batches = _parquet_file(folder / EPISODES).iter_batches(_LINES_AT_ONCE, columns=wanted, use_threads=False)
    for line in (line for batch in batches for line in batch.to_pylist()):
        where = {name.removeprefix("data/"): int(line[name]) for name in wanted}
        if where != at:
            rows, at, group = _parquet_file(folder / DATA_PATHS["v3.0"].format(**where)), where, 0
        yield rows, group
        group += 1


def _row_groups_v21(folder: Path, count: int) -> Iterator[_RowGroup]:
    """Yield the row groups of the episodes of version 2.1, a file each."""
    for index in range(count):
        numbers = {"episode_chunk": index // EPISODES_PER_CHUNK, "episode_index": index}
        rows = _parquet_file(folder / DATA_PATHS["v2.1"].format(**numbers))
        if rows.num_row_groups != 1:
            raise ValueError(f"the table of episode {index} has {rows.num_row_groups} groups of rows")
        yield rows, 0


def _parquet_file(path: Path) -> Any:
    """Open a parquet file: the file alone, since a folder named "chunk=..." would become a column.

    Raises:
        ValueError: Its metadata is too large.
        OSError: It is unreadable.
    """
    parquet: Any = require("pyarrow.parquet", "data")
    with open_input(path) as stream:
        stream.seek(max(stream.seek(0, 2) - _END_BYTES, 0))
        end = stream.read(_END_BYTES)
    if int.from_bytes(end[:4], "little") > _MOST_ABOUT_BYTES:
        raise ValueError(f"what {path.name} says of itself is longer than {_MOST_ABOUT_BYTES // 1_000_000} MB")
    return parquet.ParquetFile(path, buffer_size=_BUFFER_BYTES, pre_buffer=False)


def _column(table: Any, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return the rows of a column as (rows, ...) numbers.

    Raises:
        KeyError: There is no such column.
        ValueError: It is of another shape.
    """
    values = table[name].combine_chunks()
    while hasattr(values, "flatten") and values.type.num_fields:
        values = values.flatten()
    return np.asarray(values.to_numpy(zero_copy_only=False)).reshape(shape)
