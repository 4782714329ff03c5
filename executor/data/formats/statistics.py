"""Normalisation statistics: exact minimum, maximum, mean, standard deviation and quantiles of every column.

Columns wait on disk, one file per number, and one of these at a time is in memory: a few bytes per row.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)
QUANTILE_NAMES = tuple(f"q{round(100 * q):02d}" for q in QUANTILES)
Statistics = dict[str, NDArray]
"""min, max, mean, std and quantiles, with one number per column each, and the count of rows."""


_CLOUD_ROWS, _CLOUD_POINTS = 20, 64  # Per episode, and per cloud: enough for quantities that are spread over rooms.


def subsample_rows(rows: NDArray) -> NDArray:
    """Return the rows that a column's statistics are made of: all, or of (N, P, D) clouds some points.

    Returns:
        (M, D) numbers, evenly chosen.
    """
    if rows.ndim < 3:
        return rows
    chosen = rows[:: max(len(rows) // _CLOUD_ROWS, 1), :: max(rows.shape[1] // _CLOUD_POINTS, 1)]
    return chosen.reshape(-1, rows.shape[2])


def statistics(rows: NDArray) -> Statistics:
    """Return the statistics of (N,) or (N, D) numbers, N at least 1."""
    flat = rows.reshape(len(rows), -1)
    return _of_columns(flat[:, k] for k in range(flat.shape[1]))


def _of_columns(numbers: Iterable[NDArray]) -> Statistics:
    count, columns = 0, []
    for column in numbers:
        count = len(column)
        columns.append(_of_one(np.asarray(column, np.float64)))
    found = {name: np.array([column[name] for column in columns]) for name in ("min", "max", "mean", "std")}
    found["count"] = np.array([count])
    quantiles = np.array([column["quantiles"] for column in columns]).reshape(-1, len(QUANTILES))
    return {**found, **{name: quantiles[:, k] for k, name in enumerate(QUANTILE_NAMES)}}


def _of_one(values: NDArray[np.float64]) -> dict[str, NDArray]:
    quantiles = np.quantile(values, QUANTILES)
    return {
        "min": values.min(),
        "max": values.max(),
        "mean": values.mean(),
        "std": values.std(),
        "quantiles": quantiles,
    }


class ColumnSpool:
    """Columns of a whole data set, on disk until their statistics are computed.

    Args:
        folder: An existing folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._kinds: dict[str, tuple[np.dtype, int]] = {}

    def add(self, name: str, rows: NDArray) -> None:
        """Add rows (N,) or (N, D) to a column; all of one name have one dtype."""
        flat = rows.reshape(len(rows), -1)
        self._kinds[name] = rows.dtype, flat.shape[1]
        for k, numbers in enumerate(np.ascontiguousarray(flat.T)):
            with self._file(name, k).open("ab") as stream:
                stream.write(numbers.tobytes())

    def statistics(self) -> dict[str, Statistics]:
        """Return the statistics of each column."""
        return {
            name: _of_columns(np.fromfile(self._file(name, k), dtype) for k in range(width))
            for name, (dtype, width) in self._kinds.items()
        }

    def _file(self, name: str, k: int) -> Path:
        return self._folder / f"{name}.{k}.bin"


class IntensityHistogram:
    """Histogram of the intensities of integer pictures: exact, in little memory.

    Args:
        channels: Numbers of a pixel; by default red, green and blue.
        levels: Number of levels, from 0 on.
        largest: Level that counts as 1 in statistics.
    """

    def __init__(self, channels: int = 3, levels: int = 256, largest: float = 255.0) -> None:
        self._counts = np.zeros((channels, levels), np.int64)
        self._largest = largest

    def add(self, picture: NDArray[np.integer]) -> None:
        """Count a picture (H, W, channels)."""
        for channel, counts in enumerate(self._counts):
            counts += np.bincount(picture[..., channel].ravel(), minlength=len(counts))

    def merge(self, other: IntensityHistogram) -> None:
        """Add the counts of another histogram."""
        self._counts += other._counts

    def statistics(self) -> Statistics:
        """Return the statistics of each channel, (channels, 1, 1) as in LeRobot; quantiles are levels."""
        levels = np.arange(self._counts.shape[1]) / self._largest
        total = self._counts.sum(axis=1)
        mean = self._counts @ levels / total
        deviation = np.sqrt(np.maximum(self._counts @ levels**2 / total - mean**2, 0.0))
        reached = np.cumsum(self._counts, axis=1) / total[:, None]
        found = {
            "min": levels[(reached > 0).argmax(axis=1)],
            "max": levels[(reached >= 1.0).argmax(axis=1)],
            "mean": mean,
            "std": deviation,
            **{name: levels[(reached >= q).argmax(axis=1)] for q, name in zip(QUANTILES, QUANTILE_NAMES, strict=True)},
        }
        shaped = {name: values.reshape(-1, 1, 1) for name, values in found.items()}
        return {**shaped, "count": total[:1]}
