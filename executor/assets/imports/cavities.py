"""Finds the hollows of an asset: the largest boxes of air that are open to one side.

The space is cut into cells, a cell counts as solid when a convex piece comes near to its middle, and for every cell of
the open side the depth of the air behind it is known; the largest box is then a largest rectangle under a bound on the
depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from executor.geometry import Array

MOST_CELLS = 48
"""Cells along the longest side."""
_SOLID_WITHIN = 0.45
"""A cell is solid when a piece is nearer to its middle than this many cells."""


@dataclass(frozen=True, slots=True, eq=False)
class Hollow:
    """A box of air.

    Attributes:
        low_m, high_m: (3,) its corners.
    """

    low_m: Array
    high_m: Array

    @property
    def size_m(self) -> Array:
        """(3,) lengths of its sides."""
        return self.high_m - self.low_m


def hollows(
    pieces: Sequence[Array], low_m: Array, high_m: Array, axis: int, sign: int, smallest_m: float, most: int
) -> list[Hollow]:
    """Returns boxes of air that reach one side of a space, the largest first, none overlapping another.

    Args:
        pieces: Points (N, 3) of the convex pieces that are solid.
        low_m, high_m: (3,) corners of the space.
        axis: The axis that the open side lies across (0, 1 or 2).
        sign: Which of its two sides is open, 1 or -1.
        smallest_m: Sides shorter than this make no hollow.
        most: How many to return at most.
    """
    cell_m = float((high_m - low_m).max()) / MOST_CELLS
    counts = np.maximum(np.round((high_m - low_m) / cell_m).astype(int), 1)
    sides_m = (high_m - low_m) / counts
    air = ~_solid(pieces, low_m, sides_m, counts)
    # The open side first, then inwards.
    inwards = np.moveaxis(air, axis, 0)[:: -sign if sign > 0 else 1]
    across = [i for i in range(3) if i != axis]
    found: list[Hollow] = []
    while len(found) < most:
        depth = np.where(inwards.all(axis=0), inwards.shape[0], np.argmin(inwards, axis=0))
        best = _largest(depth, sides_m[axis], sides_m[across], smallest_m)
        if best is None:
            break
        (a0, a1), (b0, b1), deep = best
        low, high = low_m.copy(), high_m.copy()
        for i, (first, last) in zip(across, ((a0, a1), (b0, b1)), strict=True):
            low[i], high[i] = low_m[i] + first * sides_m[i], low_m[i] + last * sides_m[i]
        if sign > 0:
            low[axis] = high_m[axis] - deep * sides_m[axis]
        else:
            high[axis] = low_m[axis] + deep * sides_m[axis]
        found.append(Hollow(low, high))
        inwards = inwards.copy()
        inwards[:, a0:a1, b0:b1] = False
    return found


def highest_under(pieces: Sequence[Array], low_m: Array, high_m: Array, reach_m: float) -> float | None:
    """Returns the height of the floor under a box: the highest top of the pieces just below it; None when it is uneven.

    Args:
        pieces: Points (N, 3) of convex pieces.
        low_m, high_m: (3,) the box.
        reach_m: How far below the box to look.
    """
    tops = []
    for x in np.linspace(low_m[0], high_m[0], 7)[1:-1]:
        for y in np.linspace(low_m[1], high_m[1], 7)[1:-1]:
            here = [top for piece in pieces if (top := _top_at(piece, x, y, low_m[2] + reach_m)) is not None]
            below = [top for top in here if top >= low_m[2] - reach_m]
            tops.append(max(below, default=-np.inf))
    level = float(np.median(tops))
    even = np.isfinite(level) and float(np.mean(np.abs(np.array(tops) - level) < 0.006)) > 0.8
    return level if even else None


def _largest(
    depth: NDArray[np.int64], deep_m: float, across_m: Array, smallest_m: float
) -> tuple[tuple[int, int], tuple[int, int], int] | None:
    """The rectangle of columns and the depth that enclose most air, or None when all are too small."""
    best, most = None, 0.0
    for deep in range(int(np.ceil(smallest_m / deep_m)), int(depth.max(initial=0)) + 1):
        rectangle = _largest_rectangle(depth >= deep, across_m, smallest_m)
        if rectangle is None:
            continue
        (a0, a1), (b0, b1) = rectangle
        volume = (a1 - a0) * (b1 - b0) * deep
        if volume > most:
            best, most = ((a0, a1), (b0, b1), deep), volume
    return best


def _largest_rectangle(
    free: NDArray[np.bool_], sides_m: Array, smallest_m: float
) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """The largest rectangle of free cells whose sides are long enough, by runs of free rows over every row."""
    least = [int(np.ceil(smallest_m / side)) for side in sides_m]
    runs = np.zeros(free.shape[1], dtype=int)
    best, most = None, 0
    for row in range(free.shape[0]):
        runs = np.where(free[row], runs + 1, 0)
        stack: list[tuple[int, int]] = []
        for column in range(len(runs) + 1):
            height = int(runs[column]) if column < len(runs) else 0
            start = column
            while stack and stack[-1][1] >= height:
                start, tall = stack.pop()
                if tall >= least[0] and column - start >= least[1] and tall * (column - start) > most:
                    most = tall * (column - start)
                    best = ((row + 1 - tall, row + 1), (start, column))
            stack.append((start, height))
    return best


def _solid(pieces: Sequence[Array], low_m: Array, sides_m: Array, counts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which cells (X, Y, Z) a piece fills or comes near to the middle of."""
    solid = np.zeros(counts, dtype=bool)
    near_m = _SOLID_WITHIN * float(sides_m.max())
    for piece in pieces:
        faces = _faces(piece)
        if faces is None:
            continue
        first = np.clip(np.floor((piece.min(axis=0) - near_m - low_m) / sides_m).astype(int), 0, counts)
        last = np.clip(np.ceil((piece.max(axis=0) + near_m - low_m) / sides_m).astype(int), 0, counts)
        if (last <= first).any():
            continue
        middles = [low_m[i] + (np.arange(first[i], last[i]) + 0.5) * sides_m[i] for i in range(3)]
        points = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1)
        inside = (points @ faces[:, :3].T + faces[:, 3] <= near_m).all(axis=-1)
        solid[first[0] : last[0], first[1] : last[1], first[2] : last[2]] |= inside
    return solid


def _top_at(piece: Array, x: float, y: float, below_m: float) -> float | None:
    """The height at which a vertical line leaves a piece, or None when it misses it or that is too high."""
    faces = _faces(piece)
    if faces is None:
        return None
    slope, rest = faces[:, 2], faces[:, :2] @ np.array([x, y]) + faces[:, 3]
    if (rest[np.abs(slope) < 1e-9] > 0.0).any():
        return None
    up, down = slope > 1e-9, slope < -1e-9
    top, bottom = float((-rest[up] / slope[up]).min()), float((-rest[down] / slope[down]).max())
    return top if bottom <= top <= below_m else None


def _faces(piece: Array) -> Array | None:
    """Half-spaces (F, 4) of a piece's hull; None for what is flat."""
    try:
        return np.asarray(ConvexHull(piece).equations)
    except QhullError:
        return None
