"""Replay buffer of Diffusion Policy and DP3: a zarr group of format 2, with all episodes concatenated.

    data/state, data/velocity, data/environment_state, data/object_poses, data/joint_positions, data/action,
    data/joint_target, data/reward, data/done, data/subtask_index, data/primitive_index, data/camera_pose_<view>,
    data/point_cloud                             (rows, ...) see `executor.data.episode`
    data/<view>_image                            (rows, H, W, 3) uint8
    data/<view>_depth, data/<view>_segmentation  (rows, H, W) uint16
    meta/episode_ends                            (E,) the row after the last of each episode
    .zattrs, episodes.jsonl                      metadata that the format has no place for

Format 2 is a folder of small JSON files and zlib-compressed chunks. It is written here directly.

Source: the specification of zarr's storage format 2; `diffusion_policy/common/replay_buffer.py`.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.data.episode import Episode, metadata_line
from executor.data.formats.table import DatasetSpec
from executor.system.files import write_json

_CHUNK_BYTES = 1_000_000  # Uncompressed; a trainer's window of rows then lies in one or two files.
_LEVEL = 4


def write_zarr(episodes: Iterable[Episode], found: DatasetSpec, folder: Path) -> None:
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
    with (folder / "episodes.jsonl").open("w", encoding="utf-8") as about:
        for episode in episodes:
            for name, values in episode.columns.items():
                add(_place(name), values)
            for (view, kind), clip in episode.clips.items():
                for picture in clip.pictures():
                    add(_picture_place(view, kind), picture[None])
            rows += episode.length
            add("meta/episode_ends", np.array([rows], np.int64))
            about.write(metadata_line(episode.about) + "\n")
    for array in arrays.values():
        array.close()
    write_json(folder / ".zattrs", found.to_json())


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


def _chunk_name(number: int, sides: int) -> str:
    return ".".join([str(number), *("0" for _ in range(sides))])
