"""LeRobotDatasets that this program wrote, read back as the episodes that they were written from.

Files are found by the names that the format gives them, not by the patterns that a data set says.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bddl.files import opened
from executor.datasets.formats.lerobot_features import (
    ABOUT,
    DATA_PATHS,
    EPISODES,
    IN_A_CHUNK,
    LINES,
    VIDEO_PATHS,
    picture_key,
)
from executor.datasets.formats.stream import (
    CLOUD,
    CLOUD_SHAPE,
    MOST_EPISODE_BYTES,
    SCALARS,
    FoldedEpisode,
    Survey,
    about_lines,
    told_rows,
)
from executor.datasets.formats.videos import Clip, ReadClip, VideoClip
from executor.machine.extras import require
from executor.machine.files import read_json

_PACKED = frozenset({"SNAPPY", "UNCOMPRESSED"})
"""How tables of this program are packed. Others give a thousand bytes for one, these twenty."""

_AT_ONCE = 16  # Rows with pictures, and lines about episodes, that are in memory.
_BUFFER_BYTES = 1 << 20
_END_BYTES = 8  # How long a table's description is, and its mark.
_MOST_ABOUT_BYTES = 16_000_000


def read_lerobot(folder: Path) -> tuple[Survey, Callable[[], Iterator[FoldedEpisode]]]:
    """Returns what a data set of version 3.0 or 2.1 has in common, and what goes through its episodes.

    Args:
        folder: The data set.

    Raises:
        OSError, ValueError, KeyError, TypeError, IndexError: It is none that this program wrote, here or later.
        MissingExtra: pyarrow is not installed.
    """
    found = Survey.from_json(read_json(folder / ABOUT))
    version = read_json(folder / "meta" / "info.json")["codebase_version"]
    if version not in VIDEO_PATHS:
        raise ValueError(f"its version is {version!r}: expected {' or '.join(VIDEO_PATHS)}")
    return found, partial(_episodes, folder, found, _new_places if version == "v3.0" else _old_places)


@dataclass(frozen=True, slots=True)
class _Place:
    """Where an episode is.

    Attributes:
        file: The parquet file, opened.
        group: The group of its rows.
        videos: View -> its video, and the number of its first picture there.
    """

    file: Any
    group: int
    videos: Mapping[str, tuple[Path, int]]

    def check(self, widths: Mapping[str, int], found: Survey) -> int:
        """Return how many rows the episode has, where as much as it says can be read.

        Args:
            widths: Column -> how many numbers a row of it has.
            found: What all episodes have in common.

        Raises:
            ValueError: It would take too much memory, or is packed as no file of this program is.
        """
        about, size = self.file.metadata.row_group(self.group), 0
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

    def read(self, names: Collection[str]) -> Any:
        """Return the table of some columns."""
        return self.file.read_row_group(self.group, columns=list(names), use_threads=False)

    def pictures(self, key: str, size: tuple[int, int]) -> Iterator[NDArray[np.uint16]]:
        """Yield a column's pictures of a width and height, some at a time.

        Raises:
            ValueError: One is of another size.
        """
        for batch in self.file.iter_batches(_AT_ONCE, [self.group], columns=[key], use_threads=False):
            for encoded in batch.column(0).field("bytes"):
                with Image.open(io.BytesIO(encoded.as_py()), formats=("PNG",)) as picture:
                    if picture.size != size:
                        raise ValueError(f"a picture has {picture.size[0]} x {picture.size[1]} pixels")
                    yield np.array(picture, np.uint16)


def _episodes(
    folder: Path, found: Survey, places: Callable[[Path, Survey], Iterator[_Place]]
) -> Iterator[FoldedEpisode]:
    widths = {**{name: len(numbers) for name, numbers in found.vectors.items()}, **dict.fromkeys(SCALARS, 1)}
    widths |= {CLOUD: math.prod(CLOUD_SHAPE)} if found.point_cloud else {}
    for index, (about, place) in enumerate(zip(about_lines(folder / LINES), places(folder, found), strict=True)):
        count = place.check(widths, found)
        table = place.read(widths)
        columns = {name: _column(table, name, (count, len(numbers))) for name, numbers in found.vectors.items()}
        if found.point_cloud:
            columns[CLOUD] = _column(table, CLOUD, (count, *CLOUD_SHAPE))
        columns |= {name: _column(table, name, (count,)) for name in SCALARS}
        # Here it counts the sentences of the whole data set.
        columns["subtask_index"] = told_rows(about, count)["subtask_index"]
        clips: dict[tuple[str, str], Clip] = {}
        for view, kind in found.clips:
            if kind:
                key = picture_key(view, kind)
                clips[view, kind] = ReadClip(f"{folder}, {key}", partial(place.pictures, key, found.views[view]))
            else:
                video, first = place.videos[view]
                clips[view, kind] = VideoClip(video, found.rate_hz, first, count)
        yield FoldedEpisode(index, columns, clips, about)


def _new_places(folder: Path, found: Survey) -> Iterator[_Place]:
    """Yield where the episodes of version 3.0 are: row groups of shared files, stretches of shared videos."""
    keys = {view: f"videos/{picture_key(view, '')}" for view in found.views}
    parts = ("chunk_index", "file_index", "from_timestamp")
    wanted = ["data/chunk_index", "data/file_index", *(f"{key}/{name}" for key in keys.values() for name in parts)]
    rows: Any = None
    at: dict[str, int] | None = None
    group = 0
    batches = _parquet_file(folder / EPISODES).iter_batches(_AT_ONCE, columns=wanted, use_threads=False)
    for line in (line for batch in batches for line in batch.to_pylist()):
        where = {"chunk_index": int(line["data/chunk_index"]), "file_index": int(line["data/file_index"])}
        if where != at:
            rows, at, group = _parquet_file(folder / DATA_PATHS["v3.0"].format(**where)), where, 0
        videos = {}
        for view, key in keys.items():
            numbers = {name: int(line[f"{key}/{name}"]) for name in parts[:2]}
            path = VIDEO_PATHS["v3.0"].format(video_key=picture_key(view, ""), **numbers)
            videos[view] = folder / path, round(line[f"{key}/from_timestamp"] * found.rate_hz)
        yield _Place(rows, group, videos)
        group += 1


def _old_places(folder: Path, found: Survey) -> Iterator[_Place]:
    """Yield where the episodes of version 2.1 are: a table and a video each."""
    for index in range(found.count):
        numbers = {"episode_chunk": index // IN_A_CHUNK, "episode_index": index}
        videos = {
            view: (folder / VIDEO_PATHS["v2.1"].format(video_key=picture_key(view, ""), **numbers), 0)
            for view in found.views
        }
        rows = _parquet_file(folder / DATA_PATHS["v2.1"].format(**numbers))
        if rows.num_row_groups != 1:
            raise ValueError(f"the table of episode {index} has {rows.num_row_groups} groups of rows")
        yield _Place(rows, 0, videos)


def _parquet_file(path: Path) -> Any:
    """Return a parquet file, opened: the file alone, since a folder named "chunk=..." would become a column.

    Raises:
        ValueError: What it says of itself is too much to be read.
        OSError: It cannot be read.
    """
    parquet: Any = require("pyarrow.parquet", "data")
    with opened(path) as stream:
        stream.seek(max(stream.seek(0, 2) - _END_BYTES, 0))
        end = stream.read(_END_BYTES)
    if int.from_bytes(end[:4], "little") > _MOST_ABOUT_BYTES:
        raise ValueError(f"what {path.name} says of itself is longer than {_MOST_ABOUT_BYTES // 1_000_000} MB")
    return parquet.ParquetFile(path, buffer_size=_BUFFER_BYTES, pre_buffer=False)


def _column(table: Any, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Returns the rows of a column as (rows, ...) numbers.

    Raises:
        KeyError: There is no such column.
        ValueError: It is of another shape.
    """
    values = table[name].combine_chunks()
    while hasattr(values, "flatten") and values.type.num_fields:
        values = values.flatten()
    return np.asarray(values.to_numpy(zero_copy_only=False)).reshape(shape)
