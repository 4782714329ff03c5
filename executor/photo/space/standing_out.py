"""What stands out of all that is known: pieces of the picture that somebody has to explain, found in depths alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, label, median_filter, uniform_filter

from executor.geometry import Array
from executor.photo.space.observation import Observation
from executor.photo.space.rows import parted as parts_of_row
from executor.photo.space.walls import Wall
from llm.sight.forms import Box

LEAST_PX = 80
"""Of a piece that is looked at: smaller ones are mostly edges of what was fitted a little off."""

_NEARER_M, _NEARER_SIGMA = 0.015, 1.5  # Than all that is known, in the mean of a window: a third of a pixel's noise.
_MEAN_PX, _MOST_GAP_M = 3, 0.1  # The window; what is far nearer counts no more than this in it.
_WALL_M, _WALL_SIGMA = 0.05, 3.0  # Off the plane of a wall: what is nearer is of the wall, or its skirting.
_FARTHEST_M = 6.0  # Beyond that, noise stands out too.
_CORE_PX, _CORE_SHARE = 2, 0.15  # Slivers have nothing so far inside them.
_ALIKE = 0.8  # Of the pixels of two pieces together: what has been found beside one may leave less of it.


def standing_out(
    seen: Observation, other_m: Array, walls: Sequence[Wall] = (), *, parted: bool = True
) -> list[NDArray[np.bool_]]:
    """Returns masks (H, W) of the pieces that stand out, the largest first.

    Args:
        seen: The picture, with depth.
        other_m: (H, W) depth of everything that is known.
        walls: The walls, which may go on beyond where they were seen for sure.
        parted: Whether rows of furniture are taken apart; a bed with its head is of several heights and fronts too.
    """
    gap_m = np.clip(other_m - seen.z_m, -_MOST_GAP_M, _MOST_GAP_M)
    weight = uniform_filter(seen.measured.astype(float), _MEAN_PX)
    mean_m = uniform_filter(np.where(seen.measured, gap_m, 0.0), _MEAN_PX) / np.maximum(weight, 1e-6)
    nearer = mean_m > np.maximum(_NEARER_M, _NEARER_SIGMA * seen.sigma_m)
    out = seen.measured & (seen.z_m < _FARTHEST_M) & nearer
    for wall in walls:
        off_m = np.abs(seen.points_m[..., :2] @ wall.normal - wall.offset_m)
        out &= off_m > _WALL_M + _WALL_SIGMA * seen.sigma_m
    # Holes of a pixel would cut what is thin, and what is small to pieces.
    out = median_filter(out.astype(np.uint8), size=3).astype(bool)
    pieces, count = label(out & ~seen.measured_edges)
    sizes = np.bincount(pieces.ravel(), minlength=count + 1)
    found: list[NDArray[np.bool_]] = []
    for number in range(1, count + 1):
        if sizes[number] < LEAST_PX:
            continue
        piece = pieces == number
        core = int(binary_erosion(piece, iterations=_CORE_PX).sum())
        if core > _CORE_SHARE * sizes[number]:
            parts = parts_of_row(piece, seen, walls) if parted else [piece]
            found.extend(part for part in parts if int(part.sum()) >= LEAST_PX)
    return sorted(found, key=lambda one: -int(one.sum()))


def box_of(mask: NDArray[np.bool_]) -> Box:
    """Returns the box around a mask."""
    rows, columns = np.nonzero(mask)
    return float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1)


def are_alike(mask: NDArray[np.bool_], other: NDArray[np.bool_]) -> bool:
    """Decides whether two masks (H, W) have nearly all of their pixels in common."""
    return bool((mask & other).sum() > _ALIKE * (mask | other).sum())
