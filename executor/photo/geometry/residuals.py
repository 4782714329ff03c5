"""Depth residuals against the known room, and the visibility check of a hypothesis.

Segments nearer than everything known need an explanation. A segment that is a row of furniture is split: pieces in a
row touch, so depth does not separate them. Neighbours differ in height, in how far the front stands out, and in the
colours of the top and of the front just below it.

A hypothesis that explains the pixels it was fitted to may cover others too. An open shelf before a wall explains all
residuals there, but the wall is visible through it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, label, median_filter, uniform_filter

from executor.geometry import Array
from executor.photo.geometry.observation import Observation
from executor.photo.geometry.walls import Wall
from executor.system.extras import require
from llm.vision import Box, overlap

_HIGH_M = 0.35  # From which on a piece that reaches the floor is looked at as a row of furniture.
_ON_FLOOR_M = 0.15
_TOP_M, _LEAST_FRONTS = 0.06, 0.4  # A row shows more than tops; a table hardly anything else.
_BIN_M, _LEAST_BINS = 0.02, 14  # Vertical strips of a row; furniture is no narrower than so many.
_STEP_BINS = 3  # On both sides of a step; over more of them an askew piece looks like one.
_STEP_M, _STEP_SIGMAS = 0.025, 1.0  # Between heights or fronts of neighbours.
_LEAST_POINTS = 12
_FRONT_M, _SMOOTH_BINS = 0.08, 7  # Depth of a strip from its front that is the furniture itself.
_UPON_M = 0.03  # Above the top of the front: something stands on it.
_BAND_M = (0.15, 0.04)  # Below a top, where fronts of drawers and doors are of one colour.
_SHARES_STEP, _LIGHT_STEP = 0.0075, 1.0
"""Between colours of neighbours: shares of red and green, and how often the light doubles. Shadows change less."""

_AT_WALL_M = 1.0  # Distance within which a piece stands along a wall.


@dataclass(frozen=True)
class _Strips:
    """A segment in vertical strips along its row: N points, M strips.

    Attributes:
        of: (N,) strip of each point.
        top_m: (M,) height of each strip's front.
        profiles: Each (M,), in steps: a difference of one and more separates pieces of furniture.
    """

    of: NDArray[np.intp]
    top_m: Array
    profiles: tuple[Array, ...]


def split_row(piece: NDArray[np.bool_], observation: Observation, walls: Sequence[Wall]) -> Iterator[NDArray[np.bool_]]:
    """Yield the parts (H, W) of a segment that is a row of furniture with items on it; any other segment as it is.

    Args:
        piece: (H, W) its pixels.
        observation: The picture, with depth.
        walls: Rows stand along them.
    """
    points = observation.points_m[piece]
    low, high = np.percentile(points[:, 2], [2.0, 98.0])
    fronts_share = float((points[:, 2] < high - _TOP_M).mean())
    if low > _ON_FLOOR_M or high < _HIGH_M or fronts_share < _LEAST_FRONTS:
        yield piece
        return
    step_m = max(_STEP_M, _STEP_SIGMAS * float(np.median(observation.sigma_m[piece])))
    strips = _strips(points, observation.rgb[piece] / 255.0, walls, step_m)
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
    """Yield each strip with its chosen points, if it has enough."""
    order = np.flatnonzero(chosen)[np.argsort(of[chosen], kind="stable")]
    for members in np.split(order, np.flatnonzero(np.diff(of[order])) + 1):
        if len(members) >= least:
            yield int(of[members[0]]), members


def _along(flat: Array, middle: Array, walls: Sequence[Wall]) -> Array:
    """Return (2,) the direction of a row: along the wall behind it, else its own longer axis."""
    near = [wall for wall in walls if float(np.percentile(flat @ wall.normal, 2.0)) - wall.offset_m < _AT_WALL_M]
    if near:
        return min(near, key=lambda wall: float(middle @ wall.normal) - wall.offset_m).along
    _, _, axes = np.linalg.svd(flat - middle, full_matrices=False)
    return np.asarray(axes[0])


def _smooth(values: Array) -> Array:
    """Return (M,) the running median: narrower things are handles, or stand on the row."""
    beyond = np.pad(values, _SMOOTH_BINS // 2, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(beyond, _SMOOTH_BINS)
    known = np.isfinite(windows).any(axis=1)
    smooth = np.full(len(values), np.nan)
    smooth[known] = np.nanmedian(windows[known], axis=1)
    return smooth


def _steps(profiles: Sequence[Array]) -> list[int]:
    """Return where neighbours differ, the clearest steps first taken, each at least a piece's width from the others."""
    count = len(profiles[0])
    apart = np.zeros(count)
    for at in range(_LEAST_BINS, count - _LEAST_BINS):
        for profile in profiles:
            before, after = profile[at - _STEP_BINS - 1 : at - 1], profile[at + 1 : at + _STEP_BINS + 1]
            if np.isfinite(before).any() and np.isfinite(after).any():
                spread = max(float(np.nanstd(before)), float(np.nanstd(after)))
                step = abs(float(np.nanmedian(before)) - float(np.nanmedian(after)))
                apart[at] = max(apart[at], step if spread < step / 3 else 0.0)
    found: list[int] = []
    for at in np.argsort(-apart, kind="stable"):
        if apart[at] > 1.0 and all(abs(int(at) - other) >= _LEAST_BINS for other in found):
            found.append(int(at))
    return sorted(found)


LEAST_PX = 80
"""Least pixels of a segment: smaller ones are mostly edges of inexact fits."""

_NEARER_M, _NEARER_SIGMA = 0.015, 1.5  # Than all that is known, in the mean of a window: a third of a pixel's noise.
_MEAN_PX, _MOST_GAP_M = 3, 0.1  # The window; larger gaps count as this one.
_WALL_M, _WALL_SIGMA = 0.05, 3.0  # Off the plane of a wall: nearer points are of the wall, or its skirting.
_FARTHEST_M = 6.0  # Beyond that, noise stands out too.
_CORE_PX, _CORE_SHARE = 2, 0.15  # Slivers have hardly any pixels so far inside.
_ALIKE = 0.8  # IoU of two equal segments: a new neighbour may shrink one.


def residual_segments(
    observation: Observation, other_m: Array, walls: Sequence[Wall] = (), *, split_rows: bool = True
) -> list[NDArray[np.bool_]]:
    """Return masks (H, W) of the residual segments, the largest first.

    Args:
        observation: The picture, with depth.
        other_m: (H, W) depth of everything known.
        walls: The walls, which may continue beyond their certain part.
        split_rows: Whether rows of furniture are split; a bed with its head has several heights and fronts too.
    """
    gap_m = np.clip(other_m - observation.z_m, -_MOST_GAP_M, _MOST_GAP_M)
    weight = uniform_filter(observation.measured.astype(float), _MEAN_PX)
    mean_m = uniform_filter(np.where(observation.measured, gap_m, 0.0), _MEAN_PX) / np.maximum(weight, 1e-6)
    nearer = mean_m > np.maximum(_NEARER_M, _NEARER_SIGMA * observation.sigma_m)
    out = observation.measured & (observation.z_m < _FARTHEST_M) & nearer
    for wall in walls:
        off_m = np.abs(observation.points_m[..., :2] @ wall.normal - wall.offset_m)
        out &= off_m > _WALL_M + _WALL_SIGMA * observation.sigma_m
    # Holes of a pixel would split thin and small segments.
    out = median_filter(out.astype(np.uint8), size=3).astype(bool)
    pieces, count = label(out & ~observation.measured_edges)
    sizes = np.bincount(pieces.ravel(), minlength=count + 1)
    found: list[NDArray[np.bool_]] = []
    for number in range(1, count + 1):
        if sizes[number] < LEAST_PX:
            continue
        piece = pieces == number
        core = int(binary_erosion(piece, iterations=_CORE_PX).sum())
        if core > _CORE_SHARE * sizes[number]:
            parts = split_row(piece, observation, walls) if split_rows else [piece]
            found.extend(part for part in parts if int(part.sum()) >= LEAST_PX)
    return sorted(found, key=lambda one: -int(one.sum()))


def box_of(mask: NDArray[np.bool_]) -> Box:
    """Return the box around a mask."""
    rows, columns = np.nonzero(mask)
    return float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1)


def are_alike(mask: NDArray[np.bool_], other: NDArray[np.bool_]) -> bool:
    """Return whether two masks (H, W) have nearly all of their pixels in common."""
    return bool((mask & other).sum() > _ALIKE * (mask | other).sum())


_MODEL_M = 0.01  # Error of a correct model.
_SIGMAS = 3.0
_MOST_THROUGH = 0.15
"""Largest share of an object's pixels that show something farther. On ten rooms right fits had at most 0.04, and
wrong ones from 0.08 on."""

_MOST_THROUGH_LABELLED = 0.5  # The same for a labelled object, which may be open, or fitted to distorted depth.
_LEAST_VISIBLE = 0.25
"""Least visible share of an object: with less, at the picture's border or behind something, any plane could be one."""

_PLENTY, _LEVEL_M = 0.02, 0.1
"""Share of the picture from which a level visible part suffices, whatever is outside: of a table before the camera
little more than a corner is in the picture. Walls are not level, nor is noise."""

_LEAST_FREE = 2.0  # Least visible pixels for each one hidden by something unknown.
_LEAST_COMMON = 0.5  # Of two boxes, as for matching detections with things (COCO's AP50).


@dataclass(frozen=True)
class VisibilityCheck:
    """Check of a hypothesis against the image: its visible and seen-through pixels.

    Attributes:
        right_px: Pixels whose depth agrees with the hypothesis.
        through_px: Pixels with something farther, so that the hypothesis is wrong there.
        before_px: Pixels hidden by something nearer and unknown.
        box_px: Box of the agreeing pixels; None if there are none.
        visible_share: Agreeing share of all pixels without occlusion and border.
        level_share: Agreeing pixels as a share of the whole picture if they are of one height; else 0.
    """

    right_px: int
    through_px: int
    before_px: int
    box_px: Box | None
    visible_share: float
    level_share: float

    @classmethod
    def of(cls, observation: Observation, depth_m: Array, other_m: Array, corners_m: Array) -> VisibilityCheck:
        """Check a hypothesis against the image: visible and seen-through pixel shares.

        Args:
            observation: The picture, with depth.
            depth_m: (H, W) depth of the hypothesis, infinite outside it.
            other_m: (H, W) depth of everything else known.
            corners_m: (8, 3) of its box in the level frame.
        """
        shown = observation.measured & (depth_m < other_m)
        off_m = np.where(shown, observation.z_m - depth_m, 0.0)
        slack_m = _MODEL_M + _SIGMAS * observation.depth_distortion_m
        right = shown & (np.abs(off_m) < slack_m)
        through = shown & (off_m >= slack_m)
        share = int(right.sum()) / max(1, int(np.isfinite(depth_m).sum())) * _share_in_picture(observation, corners_m)
        before = int(shown.sum()) - int(right.sum()) - int(through.sum())
        box_px = box_of(right) if right.any() else None
        level = float(right.mean()) if _is_level(observation.points_m[right][:, 2]) else 0.0
        return cls(int(right.sum()), int(through.sum()), before, box_px, share, level)

    @property
    def through_share(self) -> float:
        """Share of its visible pixels with something farther behind."""
        return self.through_px / max(1, self.right_px + self.through_px)

    @property
    def violates_free_space(self) -> bool:
        """Whether too many pixels show something farther through it."""
        return self.through_share > _MOST_THROUGH

    def is_borne_out(self, least_px: int, *, boxed: bool = False) -> bool:
        """Return whether enough of it is visible, more than is hidden by unknown objects, and free space is respected.

        Args:
            least_px: Smallest number of pixels.
            boxed: Whether its box was given: an unknown object may then hide as much of it.
        """
        enough = self.visible_share >= _LEAST_VISIBLE or self.level_share >= _PLENTY
        free = self.right_px >= max(least_px, self.before_px * (1.0 if boxed else _LEAST_FREE))
        return enough and free and not self.violates_free_space

    def is_refuted(self, box_px: Box) -> bool:
        """Return whether it cannot be the object of a box, whatever its label."""
        return self.through_share > _MOST_THROUGH_LABELLED and not self.fills(box_px)

    def fills(self, box_px: Box) -> bool:
        """Return whether it is the object of a box: the two boxes have half of their area in common."""
        return self.box_px is not None and overlap(self.box_px, box_px) >= _LEAST_COMMON


def _is_level(heights_m: Array) -> bool:
    low, high = np.percentile(heights_m, [25.0, 95.0]) if len(heights_m) else (0.0, np.inf)
    return bool(high - low < _LEVEL_M)


def _share_in_picture(observation: Observation, corners_m: Array) -> float:
    """Return the share of the outline of a box (8, 3) inside the picture; 0 if it reaches behind the camera."""
    pixels = observation.pixels(corners_m)
    if not np.isfinite(pixels).all():
        return 0.0
    geometry = require("shapely.geometry", "photo")
    outline = geometry.MultiPoint(pixels).convex_hull
    return float(outline.intersection(geometry.box(0.0, 0.0, *observation.size_px)).area / max(outline.area, 1e-9))


_VIEW_SIGMAS, _VIEW_LEAST_M = 3.0, 0.015  # Nearer than everything known: residual pixels.
_CHANGED = 0.02  # Of a box's pixels.


@dataclass(frozen=True)
class BoxView:
    """Residual pixels at the time of a fit, to detect changes since.

    Attributes:
        out: (H, W) nearer than everything known.
        foreign: (H, W) in boxes of smaller objects.
    """

    out: NDArray[np.bool_]
    foreign: NDArray[np.bool_]

    @classmethod
    def of(cls, observation: Observation, other_m: Array, foreign: NDArray[np.bool_]) -> BoxView:
        """Return the view against the depth (H, W) of everything known."""
        return cls(observation.z_m < other_m - np.maximum(_VIEW_LEAST_M, _VIEW_SIGMAS * observation.sigma_m), foreign)

    def is_like(self, before: BoxView, box_px: Box) -> bool:
        """Return whether hardly a pixel of a box has changed."""
        x0, y0, x1, y1 = (round(value) for value in box_px)
        window = np.s_[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)]
        changed = (self.out[window] != before.out[window]) | (self.foreign[window] != before.foreign[window])
        return bool(changed.mean() < _CHANGED)
