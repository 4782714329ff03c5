"""The replay buffer that Diffusion Policy and DP3 read: a zarr group of format 2, all episodes one after the other.

    data/state, data/velocity, data/environment_state, data/action, data/joint_target, data/reward, data/done,
    data/subtask_index, data/primitive_index     (rows, ...) as `executor.datasets.formats.fold` documents them
    data/<view>_image                            (rows, H, W, 3) uint8
    meta/episode_ends                            (E,) the row after the last of each episode
    .zattrs, episodes.jsonl                      what the format has no place for

Format 2 is a folder of small JSON files and of chunks that zlib has compressed, which is written here as it is.

Source: the specification of zarr's storage format 2; `diffusion_policy/common/replay_buffer.py`.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.datasets.footage import footage_path, pictures
from executor.datasets.formats.fold import FoldedEpisode, Survey
from executor.machine.files import plain, write_json

_CHUNK_BYTES = 1_000_000  # Uncompressed; a trainer that reads windows of rows opens one or two files.
_LEVEL = 4


def write_zarr(episodes: Iterable[FoldedEpisode], found: Survey, folder: Path) -> None:
    """Writes a replay buffer into an empty folder.

    Args:
        episodes: In order; one at a time is in memory.
        found: What they have in common.
        folder: It exists.

    Raises:
        VideoFailed: An episode's video cannot be read.
        MissingExtra: PyAV is not installed, and there are videos.
        OSError: The folder cannot be written.
    """
    for group in (folder, folder / "data", folder / "meta"):
        group.mkdir(exist_ok=True)
        write_json(group / ".zgroup", {"zarr_format": 2})
    arrays: dict[str, _Array] = {}

    def add(name: str, rows: NDArray) -> None:
        if name not in arrays:
            arrays[name] = _Array(folder / name, rows.dtype, rows.shape[1:])
        arrays[name].add(rows)

    rows = 0
    with (folder / "episodes.jsonl").open("w", encoding="utf-8") as about:
        for episode in episodes:
            for name, values in episode.columns.items():
                add(f"data/{name.rpartition('.')[2]}", values)
            for view in found.views:
                for picture in pictures(footage_path(episode.source.path, view)):
                    add(f"data/{view}_image", picture[None])
            rows += episode.length
            add("meta/episode_ends", np.array([rows], np.int64))
            about.write(json.dumps(plain(episode.about), ensure_ascii=False) + "\n")
    for array in arrays.values():
        array.close()
    write_json(folder / ".zattrs", found.to_json())


class _Array:
    """An array that rows are added to at its end; whole chunks are written, the rest waits."""

    def __init__(self, folder: Path, dtype: np.dtype, shape: tuple[int, ...]) -> None:
        self._folder, self._dtype, self._shape = folder, dtype.newbyteorder("<"), shape
        row_bytes = dtype.itemsize * int(np.prod(shape, dtype=np.int64))
        self._chunk = max(_CHUNK_BYTES // max(row_bytes, 1), 1)
        self._waiting: list[NDArray] = []
        self._rows = self._written = 0
        folder.mkdir()

    def add(self, rows: NDArray) -> None:
        """Adds rows."""
        self._waiting.append(rows)
        self._rows += len(rows)
        while self._rows - self._written >= self._chunk:
            kept = np.concatenate(self._waiting)
            self._write(kept[: self._chunk])
            self._waiting = [kept[self._chunk :]]

    def close(self) -> None:
        """Writes the last chunk, filled up with zeros, and what the array is."""
        rest = self._rows - self._written
        if rest:
            filled = np.zeros((self._chunk, *self._shape), self._dtype)
            filled[:rest] = np.concatenate(self._waiting)
            self._write(filled)
        told: dict[str, Any] = {
            "zarr_format": 2,
            "shape": [self._rows, *self._shape],
            "chunks": [self._chunk, *(max(side, 1) for side in self._shape)],
            "dtype": self._dtype.str,
            "compressor": {"id": "zlib", "level": _LEVEL},
            "fill_value": False if self._dtype.kind == "b" else 0,
            "order": "C",
            "filters": None,
        }
        write_json(self._folder / ".zarray", told)

    def _write(self, rows: NDArray) -> None:
        if rows.size:
            name = ".".join([str(self._written // self._chunk), *("0" for _ in self._shape)])
            content = np.ascontiguousarray(rows, self._dtype).tobytes()
            (self._folder / name).write_bytes(zlib.compress(content, _LEVEL))
        self._written += len(rows)
