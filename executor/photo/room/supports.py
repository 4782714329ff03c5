"""What things may stand on: the floor, and the tops and boards of the furniture that was fitted."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from executor.assets.footprint import region_frame
from executor.assets.library import asset_for
from executor.geometry import Array
from executor.photo.fitting.body import Guess
from executor.photo.fitting.likelihood import Fit
from executor.photo.fitting.prior import CARRIED, UNITS
from executor.photo.fitting.starts import foot_of
from executor.photo.inputs.annotations import FLOOR, Sighting
from executor.photo.space.observation import Observation
from oag import Kind, kind_of

SAME_M, EQUAL_M = 0.02, 0.001
"""Between the height of a top and that of what was put on it, however it was moved since, or which one was made of."""

_REACH_M = 0.06  # Over the edge of a top, as far as things may seem to stand.
_HEIGHT_M = 0.13  # Between what is seen of a thing's bottom and a top that it may stand on.
_MOST = 3
_MISJUDGED_M = 0.5
_ON_FLOOR_M = 0.15
_LEVEL_M, _LEVEL_SHARE, _HIGHEST_M = 0.02, 0.05, 2.0  # Bins in which level surfaces have this share of all points.


@dataclass(frozen=True)
class Top:
    """A top or board of a fit: its frame (4, 4), and half its sides (2,)."""

    fit: Fit
    T: Array
    half_m: Array

    @property
    def height_m(self) -> float:
        """Above the floor."""
        return float(self.T[2, 3])

    @property
    def is_uppermost(self) -> bool:
        """Whether it is on top of its furniture, and no board in it."""
        return self.height_m > self.fit.guess.bottom_m + 0.9 * self.fit.guess.size_m[2]

    def is_near(self, at: Array) -> bool:
        """Decides whether a place (2,) is over it, or hardly beside it."""
        return bool((self._over_m(at) < _REACH_M).all())

    def beside_m(self, at: Array) -> float:
        """Returns how far beside it a place (2,) is, 0 over it."""
        return float(np.linalg.norm(np.maximum(self._over_m(at), 0.0)))

    def _over_m(self, at: Array) -> Array:
        local = np.linalg.inv(self.T) @ [*at, self.height_m, 1.0]
        return np.asarray(np.abs(local[:2]) - self.half_m)


def tops_of(fits: Iterable[Fit]) -> Iterator[Top]:
    """Yields the tops and boards of the furniture among some fits."""
    for fit in fits:
        if kind_of(fit.guess.entry.category, fit.guess.size_m[1]) is not Kind.ITEM:
            carrier = fit.guess.as_object()
            for region in asset_for(carrier).regions:
                yield Top(fit, *region_frame(carrier, region))


def is_on_one(guess: Guess, tops: Iterable[Top], within_m: float = SAME_M) -> bool:
    """Decides whether a guess stands on the floor, or within so much of the height of one of some tops."""
    at = np.array([guess.x_m, guess.y_m])
    near = (top for top in tops if abs(top.height_m - guess.bottom_m) < within_m)
    return guess.bottom_m == 0.0 or any(top.is_near(at) for top in near)


def as_exact_as_its_carrier(fit: Fit, tops: Iterable[Top]) -> Fit:
    """Returns a fit whose place, without depth, is known no better than the height of that top which it stands on."""
    if fit.spread_m is None or fit.guess.bottom_m == 0.0:
        return fit
    beneath = [top.fit.spread_m or 0.0 for top in tops if abs(top.height_m - fit.guess.bottom_m) < EQUAL_M]
    return replace(fit, spread_m=math.hypot(fit.spread_m, min(beneath, default=0.0)))


def heights_under(points: Array, tops: Iterable[Top]) -> list[float]:
    """Returns heights of the floor, tops and boards that points (N, 3) may stand on, the nearest first."""
    if not len(points):
        return []
    low = float(np.percentile(points[:, 2], 5.0))
    at = np.median(points[:, :2], axis=0)
    heights = [0.0] if low < _ON_FLOOR_M else []
    heights += [top.height_m for top in tops if abs(top.height_m - low) < _HEIGHT_M and top.is_near(at)]
    return sorted({round(height, 4) for height in heights}, key=lambda height: abs(height - low))[:_MOST]


def level_heights(points: Array) -> list[float]:
    """Returns heights at which many of some points (N, 3) lie, above the floor, the most first: of level surfaces."""
    z = points[:, 2]
    counts, ends = np.histogram(z, np.arange(_ON_FLOOR_M, _HIGHEST_M, _LEVEL_M))
    # A bin's two neighbours may have a part of its surface; an upright face has as many points in each.
    peaks = [
        number
        for number in range(1, len(counts) - 1)
        if counts[number] == counts[number - 1 : number + 2].max() and counts[number] > _LEVEL_SHARE * len(z)
    ]
    likely = sorted(peaks, key=lambda number: -int(counts[number]))[:_MOST]
    near = [z[np.abs(z - ends[number] - _LEVEL_M / 2) < _LEVEL_M] for number in likely]
    return [round(float(np.median(one)), 4) for one in near]


def heights_behind(seen: Observation, detection: Sighting, tops: Sequence[Top], told: Fit | None) -> list[float]:
    """Returns heights of tops, boards and floor that are seen where a box ends, the nearest to the camera first.

    Args:
        seen: The picture, which has no depth.
        detection: Whose box it is.
        tops: All that there are.
        told: What the thing is said to stand on, where somebody says it.
    """
    if detection.on == FLOOR:
        return [0.0]
    found = []
    for top in tops:
        foot = foot_of(seen, detection.box_px, top.height_m)
        if foot is not None and (told is None or top.fit is told):
            beside_m = max(top.beside_m(foot), _REACH_M)
            found.append((beside_m, float(np.hypot(*foot)), round(top.height_m, 4)))
    # A top hides the floor behind it. One that is misjudged may end before what stands on it.
    on = [height for beside_m, _, height in sorted(found) if beside_m <= _REACH_M]
    near = [height for beside_m, _, height in sorted(found)[:1] if beside_m < _MISJUDGED_M or told is not None]
    if detection.category in CARRIED and not near:
        # Nobody puts a microwave on the floor, and units of a kitchen are of one height.
        near = [round(top.height_m, 4) for top in tops if top.fit.guess.entry.category in UNITS and top.is_uppermost]
    return on[:_MOST] or near[:_MOST] or [0.0]
