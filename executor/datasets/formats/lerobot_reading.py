"""LeRobotDatasets that this program wrote, read back as the episodes that they were written from.

Files are found by the names that the format gives them, not by the patterns that a data set says.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from functools import partial
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
    picture_key,
)
from executor.datasets.formats.stream import (
    CLOUD,
    CLOUD_SHAPE,
    SCALARS,
    FoldedEpisode,
    Survey,
    about_lines,
    told_rows,
)
from executor.datasets.formats.videos import Clip, ReadClip, VideoClip
from executor.machine.extras import require
from executor.machine.files import read_json


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


Place = tuple[Any, Mapping[str, tuple[Path, int]]]
"""The table of an episode, and view -> its video and the number of its first picture there."""


def _episodes(
    folder: Path, found: Survey, places: Callable[[Path, Survey], Iterator[Place]]
) -> Iterator[FoldedEpisode]:
    told = zip(about_lines(folder / LINES), places(folder, found), strict=True)
    for index, (about, (table, videos)) in enumerate(told):
        count = table.num_rows
        columns = {name: _column(table, name, (count, len(names))) for name, names in found.vectors.items()}
        if found.point_cloud:
            columns[CLOUD] = _column(table, CLOUD, (count, *CLOUD_SHAPE))
        columns |= {name: _column(table, name, (count,)) for name in SCALARS}
        # Here it counts the sentences of the whole data set.
        columns["subtask_index"] = told_rows(about)["subtask_index"]
        clips: dict[tuple[str, str], Clip] = {}
        for view, kind in found.clips:
            if kind:
                key = picture_key(view, kind)
                pictures = table[key].combine_chunks().field("bytes")
                clips[view, kind] = ReadClip(f"{folder}, {key}", partial(_decoded, pictures))
            else:
                video, first = videos[view]
                clips[view, kind] = VideoClip(video, found.rate_hz, first, count)
        yield FoldedEpisode(index, columns, clips, about)


def _new_places(folder: Path, found: Survey) -> Iterator[Place]:
    """Yields where the episodes of version 3.0 are: row groups of shared files, stretches of shared videos."""
    parquet: Any = require("pyarrow.parquet", "data")
    keys = {view: f"videos/{picture_key(view, '')}" for view in found.views}
    told = ("chunk_index", "file_index", "from_timestamp")
    wanted = ["data/chunk_index", "data/file_index", *(f"{key}/{name}" for key in keys.values() for name in told)]
    lines = parquet.read_table(folder / EPISODES, columns=wanted).to_pylist()
    rows: Any = None
    at: dict[str, int] | None = None
    group = 0
    for line in lines:
        place = {"chunk_index": int(line["data/chunk_index"]), "file_index": int(line["data/file_index"])}
        if place != at:
            rows, at, group = parquet.ParquetFile(folder / DATA_PATHS["v3.0"].format(**place)), place, 0
        videos = {}
        for view, key in keys.items():
            numbers = {name: int(line[f"{key}/{name}"]) for name in told[:2]}
            path = VIDEO_PATHS["v3.0"].format(video_key=picture_key(view, ""), **numbers)
            videos[view] = folder / path, round(line[f"{key}/from_timestamp"] * found.rate_hz)
        yield rows.read_row_group(group), videos
        group += 1


def _old_places(folder: Path, found: Survey) -> Iterator[Place]:
    """Yields where the episodes of version 2.1 are: a table and a video each."""
    parquet: Any = require("pyarrow.parquet", "data")
    for index in range(found.count):
        numbers = {"episode_chunk": index // IN_A_CHUNK, "episode_index": index}
        videos = {
            view: (folder / VIDEO_PATHS["v2.1"].format(video_key=picture_key(view, ""), **numbers), 0)
            for view in found.views
        }
        # The file alone: a folder named "chunk=..." beside it would else become a column.
        yield parquet.ParquetFile(folder / DATA_PATHS["v2.1"].format(**numbers)).read(), videos


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


def _decoded(encoded: Any) -> Iterator[NDArray[Any]]:
    for picture in encoded:
        with Image.open(io.BytesIO(picture.as_py()), formats=("PNG",)) as opened:
            yield np.array(opened, np.uint16)
