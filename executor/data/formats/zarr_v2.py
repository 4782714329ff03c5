"""Replay buffer of Diffusion Policy and DP3: a zarr group of format 2, with all episodes concatenated.

    data/state, data/velocity, data/environment_state, data/object_poses, data/joint_positions, data/action,
    data/joint_target, data/reward, data/done, data/subtask_index, data/primitive_index, data/camera_pose_<view>,
    data/point_cloud                             (rows, ...) see `executor.data.formats.table`
    data/<view>_image                            (rows, H, W, 3) uint8
    data/<view>_depth, data/<view>_segmentation  (rows, H, W) uint16
    meta/episode_ends                            (E,) the row after the last of each episode
    .zattrs, episodes.jsonl                      metadata that the format has no place for

Format 2 is a folder of small JSON files and zlib-compressed chunks. It is written and read here directly:
zarr 3.1 reads a missing chunk as zeros, and unpacks a chunk without a limit (2 GB of memory for one of 1 MB).

Source: the specification of zarr's storage format 2; `diffusion_policy/common/replay_buffer.py`.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bddl.files import read_bounded
from executor.data.formats.table import (
    CLOUD,
    CLOUD_SHAPE,
    SCALARS,
    DatasetSpec,
    EpisodeTable,
    metadata_line,
    read_metadata_lines,
)
from executor.data.formats.videos import Clip, ReadClip
from executor.system.files import read_json, write_json

_CHUNK_BYTES = 1_000_000  # Uncompressed; a trainer's window of rows then lies in one or two files.
_LEVEL = 4
_ENDS, _LINES, _ATTRIBUTES = "meta/episode_ends", "episodes.jsonl", ".zattrs"
_MOST_CHUNK_BYTES = 4 * _CHUNK_BYTES  # One chunk of each array is in memory; the largest picture takes 3 MB.


def write_zarr(episodes: Iterable[EpisodeTable], found: DatasetSpec, folder: Path) -> None:
    """Write a replay buffer into an empty folder.

    Args:
        episodes: The episodes, in order; one at a time is in memory.
        found: Their common properties.
        folder: An existing folder.

    Raises:
        VideoFailed: An episode's video is unreadable.
        MissingExtra: PyAV is not installed, and there are videos.
        OSError: The folder cannot be written.
    """
    for group in (folder, folder / "data", folder / "meta"):
        group.mkdir(exist_ok=True)
        write_json(group / ".zgroup", {"zarr_format": 2})
    arrays: dict[str, _ArrayWriter] = {}

    def add(name: str, rows: NDArray[Any]) -> None:
        if name not in arrays:
            arrays[name] = _ArrayWriter(folder / name, rows.dtype, rows.shape[1:])
        arrays[name].add(rows)

    rows = 0
    with (folder / _LINES).open("w", encoding="utf-8") as about:
        for episode in episodes:
            for name, values in episode.columns.items():
                add(_place(name), values)
            for (view, kind), clip in episode.clips.items():
                for picture in clip.pictures():
                    add(_picture_place(view, kind), picture[None])
            rows += episode.length
            add(_ENDS, np.array([rows], np.int64))
            about.write(metadata_line(episode.about) + "\n")
    for array in arrays.values():
        array.close()
    write_json(folder / _ATTRIBUTES, found.to_json())


def read_zarr(folder: Path) -> tuple[DatasetSpec, Callable[[], Iterator[EpisodeTable]]]:
    """Read a replay buffer of this program: its common properties, and an iteration over its episodes.

    Args:
        folder: The group.

    Raises:
        OSError, ValueError, KeyError, TypeError, IndexError: It was not written by this program; raised here or during
            the iteration.
    """
    found = DatasetSpec.from_json(read_json(folder / _ATTRIBUTES))
    return found, partial(_episodes, folder, found)


def _episodes(folder: Path, found: DatasetSpec) -> Iterator[EpisodeTable]:
    rows_of: dict[str, tuple[str, tuple[int, ...]]] = {name: ("<f4", (len(of),)) for name, of in found.vectors.items()}
    rows_of |= {CLOUD: ("<f4", CLOUD_SHAPE)} if found.point_cloud else {}
    rows_of |= {name: (np.dtype(kind).str, ()) for name, kind in SCALARS.items()}
    columns = {name: _ArrayReader(folder / _place(name), *row) for name, row in rows_of.items()}
    pictures = {}
    for view, kind in found.clips:
        sides = found.views[view][::-1]
        row = ("<u2", sides) if kind else ("|u1", (*sides, 3))
        pictures[view, kind] = _ArrayReader(folder / _picture_place(view, kind), *row)
    ends = _ArrayReader(folder / _ENDS, "<i8", ())
    first = 0
    for index, (about, end) in enumerate(
        zip(read_metadata_lines(folder / _LINES), ends.each(0, found.count), strict=True)
    ):
        last = first + found.check_length(int(end) - first)
        rows = {name: array.rows(first, last) for name, array in columns.items()}
        clips: dict[tuple[str, str], Clip] = {
            clip: ReadClip(array.place, partial(array.each, first, last)) for clip, array in pictures.items()
        }
        yield EpisodeTable(index, rows, clips, about)
        first = last


def _place(column: str) -> str:
    return f"data/{column.rpartition('.')[2]}"


def _picture_place(view: str, kind: str) -> str:
    return f"data/{view}_{kind or 'image'}"


class _ArrayWriter:
    """Array with rows appended at its end; complete chunks are written, the rest waits."""

    def __init__(self, folder: Path, dtype: np.dtype, shape: tuple[int, ...]) -> None:
        self._folder, self._dtype, self._shape = folder, dtype.newbyteorder("<"), shape
        row_bytes = dtype.itemsize * int(np.prod(shape, dtype=np.int64))
        self._chunk = max(_CHUNK_BYTES // max(row_bytes, 1), 1)
        self._waiting: list[NDArray[Any]] = []
        self._rows = self._written = 0
        folder.mkdir()

    def add(self, rows: NDArray[Any]) -> None:
        """Add rows."""
        self._waiting.append(rows)
        self._rows += len(rows)
        while self._rows - self._written >= self._chunk:
            kept = np.concatenate(self._waiting)
            self._write(kept[: self._chunk])
            self._waiting = [kept[self._chunk :]]

    def close(self) -> None:
        """Write the last chunk, padded with zeros, and the array's header."""
        rest = self._rows - self._written
        if rest:
            filled = np.zeros((self._chunk, *self._shape), self._dtype)
            filled[:rest] = np.concatenate(self._waiting)
            self._write(filled)
        header: dict[str, Any] = {
            "zarr_format": 2,
            "shape": [self._rows, *self._shape],
            "chunks": [self._chunk, *self._shape],
            "dtype": self._dtype.str,
            "compressor": {"id": "zlib", "level": _LEVEL},
            "fill_value": False if self._dtype.kind == "b" else 0,
            "order": "C",
            "filters": None,
        }
        write_json(self._folder / ".zarray", header)

    def _write(self, rows: NDArray[Any]) -> None:
        content = np.ascontiguousarray(rows, self._dtype).tobytes()
        (self._folder / _chunk_name(self._written // self._chunk, len(self._shape))).write_bytes(
            zlib.compress(content, _LEVEL)
        )
        self._written += len(rows)


class _ArrayReader:
    """Array of `_ArrayWriter`; the chunk read last is in memory.

    Args:
        folder: Its folder.
        kind, shape: Required dtype and row shape.

    Raises:
        OSError, ValueError, KeyError, TypeError: It is no such array.
    """

    def __init__(self, folder: Path, kind: str, shape: tuple[int, ...]) -> None:
        header = read_json(folder / ".zarray")
        self._folder, self.place = folder, str(folder)
        if header["zarr_format"] != 2 or header["compressor"]["id"] != "zlib":
            raise ValueError(f"{folder.name} is no array of format 2 as this program writes them")
        self._count, *self._shape = (int(side) for side in header["shape"])
        if header["dtype"] != kind or self._shape != list(shape):
            raise ValueError(
                f"{folder.name} has rows {self._shape} of {header['dtype']}: expected {list(shape)} of {kind}"
            )
        self._chunk, self._dtype = int(header["chunks"][0]), np.dtype(header["dtype"])
        self._chunk_bytes = self._chunk * self._dtype.itemsize * math.prod(self._shape)
        if [self._chunk, *self._shape] != header["chunks"] or not 0 < self._chunk_bytes <= _MOST_CHUNK_BYTES:
            raise ValueError(f"{folder.name} has chunks of {header['chunks']}")
        self._read: tuple[int, NDArray[Any]] = (-1, np.zeros(0))

    def rows(self, first: int, end: int) -> NDArray[Any]:
        """Return the rows from `first` up to, but not including, `end`."""
        if not 0 <= first <= end <= self._count:
            raise ValueError(f"{self._folder.name} has {self._count} rows, and not {first} to {end}")
        found = np.empty((end - first, *self._shape), self._dtype)
        at = first
        while at < end:
            number, begin = divmod(at, self._chunk)
            taken = min(self._chunk - begin, end - at)
            found[at - first : at - first + taken] = self._chunk_of(number)[begin : begin + taken]
            at += taken
        return found

    def each(self, first: int, end: int) -> Iterator[NDArray[Any]]:
        """Yield the same rows one after the other."""
        return (self.rows(row, row + 1)[0] for row in range(first, end))

    def _chunk_of(self, number: int) -> NDArray[Any]:
        if self._read[0] != number:
            content = read_bounded(self._folder / _chunk_name(number, len(self._shape)), 2 * _MOST_CHUNK_BYTES)
            try:
                raw = zlib.decompressobj().decompress(content, self._chunk_bytes + 1)
            except zlib.error as problem:
                raise ValueError(f"chunk {number} of {self._folder.name} is torn: {problem}") from None
            rows = np.frombuffer(raw, self._dtype).reshape(self._chunk, *self._shape)
            self._read = number, rows
        return self._read[1]


def _chunk_name(number: int, sides: int) -> str:
    return ".".join([str(number), *("0" for _ in range(sides))])
