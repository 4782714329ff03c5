"""A piece that stands out, taken apart: what stands on a row of furniture, and the row where its parts differ.

Furniture in a row touches, so that depths alone do not part it. What differs from one to the next is how high it is,
how far its front stands out, and the colours of its top and of its front just below that.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array
from executor.photo.space.observation import Observation
from executor.photo.space.walls import Wall

_HIGH_M = 0.35  # From which on a piece that reaches the floor is looked at as a row of furniture.
_ON_FLOOR_M = 0.15
_TOP_M, _LEAST_FRONTS = 0.06, 0.4  # Of a row more is seen than tops; of a table hardly anything else.
_BIN_M, _LEAST_BINS = 0.02, 14  # A row is looked at in upright strips; furniture is no narrower than so many.
_BESIDE_BINS = 3  # On both sides of a step; over more of them what stands askew looks like one.
_STEP_M, _STEP_SIGMAS = 0.025, 1.0  # Between heights or fronts of neighbours.
_LEAST_POINTS = 12
_FRONT_M, _SMOOTH_BINS = 0.08, 7  # Of a strip, what is so near to its front is the furniture itself.
_UPON_M = 0.03  # Above the top of what is in front: something stands on it.
_BAND_M = (0.15, 0.04)  # Below a top, where fronts of drawers and doors are of one colour.
_SHARES_STEP, _LIGHT_STEP = 0.0075, 1.0
"""Between colours of neighbours: shares of red and green, and how often the light doubles. Shadows change less."""

_AT_WALL_M = 1.0  # So near to a wall a piece stands along it.


@dataclass(frozen=True)
class _Strips:
    """A piece in upright strips along the way it stands: N points, M strips.

    Attributes:
        of: (N,) which strip a point is in.
        top_m: (M,) height of each strip's front.
        profiles: Each (M,), in steps: what differs by one and more is not of one piece of furniture.
    """

    of: NDArray[np.intp]
    top_m: Array
    profiles: tuple[Array, ...]


def parted(piece: NDArray[np.bool_], seen: Observation, walls: Sequence[Wall]) -> Iterator[NDArray[np.bool_]]:
    """Yields the parts (H, W) of a piece that is a row of furniture and what stands on it; anything else as it is.

    Args:
        piece: (H, W) its pixels.
        seen: The picture, with depth.
        walls: Along which rows stand.
    """
    points = seen.points_m[piece]
    low, high = np.percentile(points[:, 2], [2.0, 98.0])
    fronts_share = float((points[:, 2] < high - _TOP_M).mean())
    if low > _ON_FLOOR_M or high < _HIGH_M or fronts_share < _LEAST_FRONTS:
        yield piece
        return
    step_m = max(_STEP_M, _STEP_SIGMAS * float(np.median(seen.sigma_m[piece])))
    strips = _strips(points, seen.rgb[piece] / 255.0, walls, step_m)
    upon = points[:, 2] > strips.top_m[strips.of] + _UPON_M
    yield _of(piece, upon)
    for first, last in itertools.pairwise([0, *_steps(strips.profiles), len(strips.top_m)]):
        yield _of(piece, ~upon & (strips.of >= first) & (strips.of < last))


def _of(piece: NDArray[np.bool_], some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    part = np.zeros(piece.shape, dtype=bool)
    part[piece] = some
    return part


def _strips(points: Array, rgb: Array, walls: Sequence[Wall], step_m: float) -> _Strips:
    flat = points[:, :2]
    middle = np.median(flat, axis=0)
    along = _along(flat, middle, walls)
    out = np.array([-along[1], along[0]])
    out *= np.sign(-middle @ out) or 1.0
    of = np.floor((flat @ along) / _BIN_M).astype(int)
    of -= of.min()
    across, count = flat @ out, int(of.max()) + 1
    fronts, tops = np.full(count, np.nan), np.full(count, np.nan)
    for strip, members in _by_strip(of, np.ones(len(of), dtype=bool), _LEAST_POINTS):
        fronts[strip] = np.percentile(across[members], 95.0)
        near = members[across[members] > fronts[strip] - _FRONT_M]
        tops[strip] = np.percentile(points[near, 2], 97.0)
    tops = _smooth(tops)
    below_m = tops[of] - points[:, 2]
    in_band = (across > fronts[of] - _FRONT_M) & (below_m < _BAND_M[0]) & (below_m > _BAND_M[1])
    profiles = [tops / step_m, fronts / step_m]
    for chosen in (np.abs(below_m) < _UPON_M, in_band):
        colours = np.full((count, 3), np.nan)
        for strip, members in _by_strip(of, chosen, _LEAST_POINTS // 2):
            colours[strip] = np.median(rgb[members], axis=0)
        light = np.maximum(colours.sum(axis=1), 1e-3)
        profiles += [np.log2(light) / _LIGHT_STEP, *(colours[:, :2].T / light / _SHARES_STEP)]
    return _Strips(of, np.where(np.isfinite(tops), tops, np.inf), tuple(_smooth(one) for one in profiles))


def _by_strip(of: NDArray[np.intp], chosen: NDArray[np.bool_], least: int) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Yields a strip and the chosen points of it, for every strip that has so many."""
    order = np.flatnonzero(chosen)[np.argsort(of[chosen], kind="stable")]
    for members in np.split(order, np.flatnonzero(np.diff(of[order])) + 1):
        if len(members) >= least:
            yield int(of[members[0]]), members


def _along(flat: Array, middle: Array, walls: Sequence[Wall]) -> Array:
    """(2,) the way a row goes: along the wall that it stands at, else its own longer axis."""
    near = [wall for wall in walls if float(np.percentile(flat @ wall.normal, 2.0)) - wall.offset_m < _AT_WALL_M]
    if near:
        return min(near, key=lambda wall: float(middle @ wall.normal) - wall.offset_m).along
    _, _, axes = np.linalg.svd(flat - middle, full_matrices=False)
    return np.asarray(axes[0])


def _smooth(values: Array) -> Array:
    """(M,) the middle one of each strip and its neighbours: what is narrower is a handle, or stands on the row."""
    beyond = np.pad(values, _SMOOTH_BINS // 2, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(beyond, _SMOOTH_BINS)
    known = np.isfinite(windows).any(axis=1)
    smooth = np.full(len(values), np.nan)
    smooth[known] = np.nanmedian(windows[known], axis=1)
    return smooth


def _steps(profiles: Sequence[Array]) -> list[int]:
    """Where neighbours differ, the clearest steps first taken, each at least a piece's width from the others."""
    count = len(profiles[0])
    apart = np.zeros(count)
    for at in range(_LEAST_BINS, count - _LEAST_BINS):
        for profile in profiles:
            before, after = profile[at - _BESIDE_BINS - 1 : at - 1], profile[at + 1 : at + _BESIDE_BINS + 1]
            if np.isfinite(before).any() and np.isfinite(after).any():
                spread = max(float(np.nanstd(before)), float(np.nanstd(after)))
                step = abs(float(np.nanmedian(before)) - float(np.nanmedian(after)))
                apart[at] = max(apart[at], step if spread < step / 3 else 0.0)
    found: list[int] = []
    for at in np.argsort(-apart, kind="stable"):
        if apart[at] > 1.0 and all(abs(int(at) - other) >= _LEAST_BINS for other in found):
            found.append(int(at))
    return sorted(found)
