"""The pixels of one thing, and how badly a guess explains them.

Each pixel has a depth that was seen and one that everything else in the room would have there. A guess is rendered
into that. Where something is seen through the guess it is wrong; where something nearer was seen, another thing may be
in front of it. Pixels outside the thing's box cost when the guess claims them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from executor.geometry import Array
from executor.photo.fitting.body import Body, Guess
from executor.photo.space.observation import Observation

_MARGIN = 0.12  # Of the box's sides, looked at around it.
_MODEL_M = 0.004  # What a model differs from a thing even where it is right.
_THROUGH, _HIDDEN, _OUTSIDE = 8.0, 5.0, 4.0
"""Most that a pixel costs: seen through the guess; nearer than all that is known; claimed outside the box."""

_CLAIM_SIGMA = 0.04  # Of the box's sides: how exact boxes are.
_MASK_PX = 1.5  # How exact masks are.
_COLOUR_SIGMA, _COLOUR_MOST = 0.06, 4.0
_UNEXPLAINED, _BEYOND = -1, -2  # Groups of pixels: what nothing explains; then, downwards, what is not the thing's.
_BOX_MOST = 8.0
_FEW = 0.1  # Of a box's pixels: noise makes about so many stand out beside a thing's edges.


@dataclass(frozen=True)
class Patch:
    """Rays of one thing's part of the picture; N of them.

    Attributes:
        seen: The whole picture.
        box_px: The thing's box.
        rays: (N, 3) in the level frame.
        z_m, sigma_m: (N,) what was seen there, and its standard deviation.
        other_m: (N,) depth of everything else that is known, infinite for nothing.
        other: (N,) which of everything else that is, by number.
        inside: (N,) whether the pixel is in the thing's box, or of its mask where there is one.
        claim: (N,) what claiming a pixel outside the box costs.
        rgb: (N, 3) in 0 to 1.
        mine: (N,) whether something nearer than everything else was seen in the box.
        weight: How many independent measurements a mean over the pixels stands for.
        has_depth: Whether depths were measured; else box and colours are all that speaks for a guess.
    """

    seen: Observation
    box_px: tuple[float, float, float, float]
    rays: Array
    z_m: Array
    sigma_m: Array
    other_m: Array
    other: NDArray[np.int32]
    inside: NDArray[np.bool_]
    claim: Array
    rgb: Array
    mine: NDArray[np.bool_]
    weight: float
    has_depth: bool

    @classmethod
    def around(
        cls,
        seen: Observation,
        box_px: tuple[float, float, float, float],
        other_m: Array,
        other: NDArray[np.int32],
        most: int,
        foreign: NDArray[np.bool_] | None = None,
        own: NDArray[np.bool_] | None = None,
    ) -> Patch:
        """Returns at most so many pixels of a box and what is around it.

        Args:
            seen: The picture.
            box_px: The box.
            other_m, other: (H, W) depth of everything else that is known, and which of it, by number.
            most: How many pixels, about.
            foreign: (H, W) pixels that are somebody else's, which say nothing of this thing.
            own: (H, W) the thing's own pixels, where they are known; they take the place of the box's.
        """
        width, height = seen.size_px
        x0, y0, x1, y1 = box_px
        over_x, over_y = max(4.0, _MARGIN * (x1 - x0)), max(4.0, _MARGIN * (y1 - y0))
        left, right = max(0, int(x0 - over_x)), min(width, math.ceil(x1 + over_x))
        top, bottom = max(0, int(y0 - over_y)), min(height, math.ceil(y1 + over_y))
        step = max(1, int(math.sqrt((right - left) * (bottom - top) / most)))
        rows, columns = np.mgrid[top + step // 2 : bottom : step, left + step // 2 : right : step]
        rows, columns = rows.ravel(), columns.ravel()
        has_depth = seen.has_depth
        keep = seen.measured[rows, columns] if has_depth else np.ones(len(rows), dtype=bool)
        if foreign is not None:
            keep &= ~foreign[rows, columns]
        rows, columns = rows[keep], columns[keep]
        if own is None:
            beyond_x = np.maximum(np.maximum(x0 - columns - 0.5, columns + 0.5 - x1), 0.0) / (x1 - x0)
            beyond_y = np.maximum(np.maximum(y0 - rows - 0.5, rows + 0.5 - y1), 0.0) / (y1 - y0)
            beyond = np.hypot(beyond_x, beyond_y) / _CLAIM_SIGMA
        else:
            window = np.s_[top:bottom, left:right]
            beyond = distance_transform_edt(~own[window])[rows - top, columns - left] / _MASK_PX
        inside = beyond <= 0.0
        z, behind = seen.z_m[rows, columns], other_m[rows, columns]
        sigma = np.hypot(seen.sigma_m[rows, columns], _MODEL_M)
        mine = inside & (z < behind - np.maximum(0.015, 3.0 * sigma)) if has_depth else inside
        return cls(
            seen,
            box_px,
            seen.rays[rows, columns],
            z,
            sigma,
            behind,
            other[rows, columns],
            inside,
            _OUTSIDE * np.minimum(1.0, beyond**2),
            seen.rgb[rows, columns] / 255.0,
            mine,
            math.sqrt(max(1, len(rows))) * 6.0,
            has_depth,
        )

    @property
    def own_points_m(self) -> Array:
        """(M, 3) all that stands out in the box."""
        return np.asarray(self.seen.eye_m + self.rays[self.mine] * self.z_m[self.mine, None])

    def cost(self, guess: Guess, body: Body) -> float:
        """Returns how badly a guess explains the depths, as a negative logarithm of likelihood."""
        if not self.has_depth:
            return 0.0
        return self.weight * float(np.mean(self._costs(body.depth(guess, self.seen.eye_m, self.rays))))

    def _costs(self, depth: Array) -> Array:
        shown = np.minimum(depth, self.other_m)
        off = (self.z_m - shown) / self.sigma_m
        with np.errstate(invalid="ignore"):
            square = np.where(np.isfinite(off), 0.5 * off * off, np.inf)
        own = depth < self.other_m
        inside = np.where(off > 0, np.minimum(square, _THROUGH), np.minimum(square, _HIDDEN))
        claimed = np.where(off > -3.0, self.claim, 0.0) * own
        outside = np.where(own & (off > 0), np.minimum(square, _THROUGH), 0.0) + claimed
        return np.where(self.inside, inside, outside)

    def explained(self, guess: Guess, body: Body) -> float:
        """Returns the share of the pixels that stand out in the box which the guess explains within three sigma.

        Where hardly any does, as of what is flat and far, it is the share of what the guess shows in the box. Without
        depth it is the share of the box that the guess covers.
        """
        depth = body.depth(guess, self.seen.eye_m, self.rays)
        if not self.has_depth:
            return float((np.isfinite(depth) & self.mine).sum() / max(1, self.mine.sum()))
        good = np.abs(self.z_m - depth) < 3.0 * self.sigma_m + 0.01
        of = self.mine
        if self.mine.sum() < _FEW * self.inside.sum():
            of = self.inside & (depth < self.other_m)
        return float((good & of).sum() / max(1, of.sum()))

    def residual_m(self, guess: Guess, body: Body) -> float:
        """Returns the median distance between seen and guessed depths, over the pixels that the guess shows."""
        depth = body.depth(guess, self.seen.eye_m, self.rays)
        own = self.inside & (depth < self.other_m) & (np.abs(self.z_m - depth) < 0.1)
        return float(np.median(np.abs(self.z_m - depth)[own])) if own.any() else math.inf

    def colour_cost(self, guess: Guess, body: Body) -> float:
        """Returns how badly it explains the colours of the box.

        Faces of one part that look one way should be of one colour, and so should be what is seen beside the guess of
        one wall or one other thing.
        """
        inside = self.inside
        if int(inside.sum()) < 20:
            return 0.0
        depth, group = body.looks(guess, self.seen.eye_m, self.rays[inside])
        z, slack, behind = self.z_m[inside], 0.03 + 3.0 * self.sigma_m[inside], self.other_m[inside]
        own = depth < behind
        as_guessed = np.abs(z - depth) < slack if self.has_depth else own
        as_known = np.abs(z - behind) < slack if self.has_depth else np.isfinite(behind)
        kind = np.where(own & as_guessed, group, _UNEXPLAINED)
        kind = np.where(~own & as_known, _BEYOND - self.other[inside], kind)
        rgb = self.rgb[inside]
        costs = np.full(len(rgb), _COLOUR_MOST)
        count = 0
        for one in np.unique(kind[kind != _UNEXPLAINED]):
            of = kind == one
            off = (rgb[of] - np.median(rgb[of], axis=0)) / _COLOUR_SIGMA
            costs[of] = np.minimum(0.5 * (off * off).sum(axis=1), _COLOUR_MOST)
            count += 1
        # Each colour that may be chosen makes any picture easier to explain.
        freedom = 1.5 * count * math.log(len(rgb)) / 10.0
        return self.weight * float(costs.sum()) / len(self.z_m) + freedom

    def box_cost(self, guess: Guess) -> float:
        """Returns how badly the guess's outline fits the box; what is hidden may reach further than what was boxed."""
        pixels = self.seen.pixels(guess.corners_m())
        if not np.isfinite(pixels).all():
            return 4 * _BOX_MOST
        width, height = self.seen.size_px
        low = np.clip(pixels.min(axis=0), 0.0, [width, height])
        high = np.clip(pixels.max(axis=0), 0.0, [width, height])
        x0, y0, x1, y1 = self.box_px
        sides = np.array([x1 - x0, y1 - y0])
        over = np.concatenate([np.array([x0, y0]) - low, high - np.array([x1, y1])])
        scaled = over / (np.tile(sides, 2) * _CLAIM_SIGMA + 1.0)
        short = 0.5 * np.minimum(scaled, 0.0) ** 2
        long = 0.25 * np.maximum(scaled, 0.0) ** 2
        return float(np.minimum(short, _BOX_MOST).sum() + np.minimum(long, 0.25 * _BOX_MOST).sum())
