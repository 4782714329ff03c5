"""What stands out of all that is known: pieces of the picture that somebody has to explain, found in depths alone."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, label, median_filter, uniform_filter

from executor.geometry import Array
from executor.photo.space.observation import Observation
from executor.photo.space.walls import Wall
from llm.sight.forms import Box

LEAST_PX = 120
"""Of a piece that is looked at: smaller ones are mostly edges of what was fitted a little off."""

_NEARER_M, _NEARER_SIGMA = 0.015, 1.5  # Than all that is known, in the mean of a window: a third of a pixel's noise.
_MEAN_PX, _MOST_GAP_M = 3, 0.1  # The window; what is far nearer counts no more than this in it.
_WALL_M, _WALL_SIGMA = 0.05, 3.0  # Off the plane of a wall: what is nearer is of the wall, or its skirting.
_FARTHEST_M = 6.0  # Beyond that, noise stands out too.
_CORE_PX, _CORE_SHARE = 2, 0.15  # Slivers have nothing so far inside them.
_HIGH_M = 0.35  # From which on a piece that reaches the floor is looked at as a row of furniture.
_ON_FLOOR_M = 0.15
_TOP_M, _LEAST_FRONTS = 0.06, 0.4  # Of a row more is seen than tops; of a table hardly anything else.
_BIN_M, _LEAST_BINS = 0.02, 14  # A row is looked at in upright strips; furniture is no narrower than so many.
_BESIDE_BINS = 3  # On both sides of a step; over more of them what stands askew looks like one.
_STEP_M = 0.035  # Between heights or fronts of neighbours.
_LEAST_POINTS = 12


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
    # Holes of a pixel would cut what is thin.
    out = median_filter(out.astype(np.uint8), size=3).astype(bool)
    pieces, count = label(out & ~seen.edges)
    sizes = np.bincount(pieces.ravel(), minlength=count + 1)
    found: list[NDArray[np.bool_]] = []
    for number in range(1, count + 1):
        if sizes[number] < LEAST_PX:
            continue
        piece = pieces == number
        core = int(binary_erosion(piece, iterations=_CORE_PX).sum())
        if core > _CORE_SHARE * sizes[number]:
            found.extend(_parted(piece, seen) if parted else [piece])
    return sorted(found, key=lambda one: -int(one.sum()))


def box_of(mask: NDArray[np.bool_]) -> Box:
    """Returns the box around a mask."""
    rows, columns = np.nonzero(mask)
    return float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1)


def are_alike(mask: NDArray[np.bool_], other: NDArray[np.bool_]) -> bool:
    """Decides whether two masks (H, W) have more than half of their pixels in common."""
    return bool((mask & other).sum() > (mask | other).sum() / 2)


def _parted(piece: NDArray[np.bool_], seen: Observation) -> Iterator[NDArray[np.bool_]]:
    """A row of furniture in its parts, where heights or fronts of neighbours differ; anything else as it is."""
    points = seen.points_m[piece]
    low, high = np.percentile(points[:, 2], [2.0, 98.0])
    fronts_share = float((points[:, 2] < high - _TOP_M).mean())
    if low > _ON_FLOOR_M or high < _HIGH_M or fronts_share < _LEAST_FRONTS:
        yield piece
        return
    flat = points[:, :2] - np.median(points[:, :2], axis=0)
    _, _, axes = np.linalg.svd(flat, full_matrices=False)
    bins = np.floor((flat @ axes[0]) / _BIN_M).astype(int)
    bins -= bins.min()
    across = flat @ axes[1]
    towards = -np.median(points[:, :2], axis=0) @ axes[1]
    tops, fronts = (np.full(int(bins.max()) + 1, np.nan) for _ in range(2))
    for one in range(len(tops)):
        of = bins == one
        if int(of.sum()) >= _LEAST_POINTS:
            tops[one] = np.percentile(points[of, 2], 97.0)
            fronts[one] = np.percentile(across[of] * np.sign(towards), 95.0)
    cuts = [0, *_steps(tops, fronts), len(tops)]
    for first, last in itertools.pairwise(cuts):
        part = np.zeros(piece.shape, dtype=bool)
        part[piece] = (bins >= first) & (bins < last)
        if int(part.sum()) >= LEAST_PX:
            yield part


def _steps(tops: Array, fronts: Array) -> list[int]:
    """Where two neighbours' tops or fronts differ, at least a piece's width apart."""
    found: list[int] = []
    for at in range(_LEAST_BINS, len(tops) - _LEAST_BINS):
        apart = 0.0
        for profile in (tops, fronts):
            before, after = profile[at - _BESIDE_BINS : at], profile[at : at + _BESIDE_BINS]
            if np.isfinite(before).any() and np.isfinite(after).any():
                spread = max(float(np.nanstd(before)), float(np.nanstd(after)))
                step = abs(float(np.nanmedian(before)) - float(np.nanmedian(after)))
                apart = max(apart, step if spread < step / 3 else 0.0)
        if apart > _STEP_M and (not found or at - found[-1] >= _LEAST_BINS):
            found.append(at)
    return found
