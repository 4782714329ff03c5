"""What trainers normalise by: least, largest, mean, deviation and quantiles of every column, exact.

Columns wait on the disk, a file a number, and one of these at a time is in memory: some bytes a row.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)
QUANTILE_NAMES = tuple(f"q{round(100 * q):02d}" for q in QUANTILES)
Statistics = dict[str, NDArray]
"""min, max, mean, std and the quantiles, each with a number a column, and the count of rows."""


def statistics(rows: NDArray) -> Statistics:
    """Returns the statistics of (N,) or (N, D) numbers, N at least 1."""
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


class Spool:
    """Columns of a whole data set, on the disk until their statistics are asked for.

    Args:
        folder: Where to keep them; it exists.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._kinds: dict[str, tuple[np.dtype, int]] = {}

    def add(self, name: str, rows: NDArray) -> None:
        """Adds rows (N,) or (N, D) to a column; all of one name are of one kind."""
        flat = rows.reshape(len(rows), -1)
        self._kinds[name] = rows.dtype, flat.shape[1]
        for k, numbers in enumerate(np.ascontiguousarray(flat.T)):
            with self._file(name, k).open("ab") as stream:
                stream.write(numbers.tobytes())

    def statistics(self) -> dict[str, Statistics]:
        """Returns the statistics of each column."""
        return {
            name: _of_columns(np.fromfile(self._file(name, k), dtype) for k in range(width))
            for name, (dtype, width) in self._kinds.items()
        }

    def _file(self, name: str, k: int) -> Path:
        return self._folder / f"{name}.{k}.bin"


class Tones:
    """How often each of the 256 brightnesses occurs in the red, green and blue of pictures: exact, in little memory."""

    def __init__(self) -> None:
        self._counts = np.zeros((3, 256), np.int64)

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Counts a picture (H, W, 3)."""
        for channel in range(3):
            self._counts[channel] += np.bincount(picture[..., channel].ravel(), minlength=256)

    def merge(self, other: Tones) -> None:
        """Counts all that another one has counted."""
        self._counts += other._counts

    def statistics(self) -> Statistics:
        """Returns the statistics of the colours from 0 to 1, (3, 1, 1) as LeRobot has them; a quantile is a tone."""
        tones = np.arange(256) / 255.0
        total = self._counts.sum(axis=1)
        mean = self._counts @ tones / total
        deviation = np.sqrt(np.maximum(self._counts @ tones**2 / total - mean**2, 0.0))
        reached = np.cumsum(self._counts, axis=1) / total[:, None]
        found = {
            "min": tones[(reached > 0).argmax(axis=1)],
            "max": tones[(reached >= 1.0).argmax(axis=1)],
            "mean": mean,
            "std": deviation,
            **{name: tones[(reached >= q).argmax(axis=1)] for q, name in zip(QUANTILES, QUANTILE_NAMES, strict=True)},
        }
        shaped = {name: values.reshape(3, 1, 1) for name, values in found.items()}
        return {**shaped, "count": total[:1]}
