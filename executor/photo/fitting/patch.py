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
from executor.photo.space.appearance import Edges, unlike_beside
from executor.photo.space.observation import Observation

_MARGIN = 0.12  # Of the box's sides, looked at around it.
_MODEL_M = 0.004  # What a model differs from a thing even where it is right.
_THROUGH, _HIDDEN, _OUTSIDE = 8.0, 5.0, 4.0
"""Most that a pixel costs: seen through the guess; nearer than all that is known; claimed outside the box."""

_CLAIM_SIGMA = 0.04  # Of the box's sides: how exact boxes are.
_WITHIN = 0.3  # Of how far depths are bent over the picture: how far they are by what is not even around one thing.
_EVEN = np.array([1.0, 7.0, 7.0])
"""Of that, too: how far they are in the middle of it, and how much more for each unit of a ray to the left and up."""

_BENT_WEIGHT = 16.0
"""Of how many independent measurements bent depths are worth: they are all wrong together, however many there are."""

_BENT = (4.0, 2.0)  # Standard deviations: what is farther off, at first and then, is something else.
_MASK_PX = 1.5  # How exact masks are.
_COLOUR_SIGMA, _COLOUR_MOST = 0.06, 4.0
_ODD, _SAME_HUE, _SHADES, _LEAST_SHADED = 2.0, 0.05, (0.45, 2.2), 8
"""Of one colour in another light: what costs so much, is hardly of another hue, and is how bright; so many pixels."""

_TONE = 3.0  # Colours that a face in two lights counts for beside its own.
_UNEXPLAINED, _BEYOND = -1, -2  # Groups of pixels: what nothing explains; then, downwards, what is not the thing's.
_BOX_MOST, _BOX_ALONE = 8.0, 40.0
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
        other: (N,) which face of everything else that is, by number.
        inside: (N,) whether the pixel is in the thing's box, or of its mask where there is one.
        claim: (N,) what claiming a pixel outside the box costs.
        rgb: (N, 3) in 0 to 1.
        mine: (N,) whether something nearer than everything else was seen in the box.
        weight: How many independent measurements a mean over the pixels stands for.
        has_depth: Whether depths were measured; else box and colours are all that speaks for a guess.
        unlike_beside: (N,) where the picture tells more than depths, how far a pixel's colour is from all that are seen
            around the box.
        edges: Then, too, where borders of things may be; else None.
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
    unlike_beside: Array
    edges: Edges | None

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
            other_m, other: (H, W) depth of everything else that is known, and of which face, by number.
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
            beyond = _beyond(box_px, rows, columns)
        else:
            window = np.s_[top:bottom, left:right]
            beyond = distance_transform_edt(~own[window])[rows - top, columns - left] / _MASK_PX
        inside = beyond <= 0.0
        z, behind = seen.z_m[rows, columns], other_m[rows, columns]
        sigma = np.hypot(seen.sigma_m[rows, columns], _MODEL_M + _WITHIN * seen.bend_share * z)
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
            unlike_beside(seen.rgb, box_px, seen.rgb[rows, columns] / 255.0) if seen.by_sight else np.zeros(0),
            Edges.between(seen.edge_strength, rows, columns, step) if seen.by_sight and len(rows) else None,
        )

    @property
    def own_points_m(self) -> Array:
        """(M, 3) all that stands out in the box."""
        return np.asarray(self.seen.eye_m + self.rays[self.mine] * self.z_m[self.mine, None])

    def cost(self, guess: Guess, body: Body) -> float:
        """Returns how badly a guess explains the depths, as a negative logarithm of likelihood."""
        if not self.has_depth:
            return 0.0
        return self.depth_cost(body.depth(guess, self.seen.eye_m, self.rays))

    def depth_cost(self, depth: Array) -> float:
        """Returns how badly a guess explains the depths that has these (N,) itself, 0 where none were measured."""
        if not self.has_depth:
            return 0.0
        z_m, bend_cost = self._unbent(depth)
        off = (z_m - np.minimum(depth, self.other_m)) / self.sigma_m
        beyond = off > 0.0
        square = np.minimum(0.5 * off * off, np.where(beyond, _THROUGH, _HIDDEN))
        outside = np.where(beyond, square, 0.0) + np.where(off > -3.0, self.claim, 0.0)
        cost = float(np.where(self.inside, square, outside * (depth < self.other_m)).mean())
        return (min(self.weight, _BENT_WEIGHT) if self.seen.by_sight else self.weight) * cost + bend_cost

    def _unbent(self, depth: Array) -> tuple[Array, float]:
        """(N,) depths put right evenly around a guess that has these, where they are bent, and what that costs.

        One even bend goes over the guess and what is known around it: where it stands, both are equally far off.
        """
        share = self.seen.bend_share
        if not share or not len(depth):
            return self.z_m, 0.0
        known = np.minimum(depth, self.other_m)
        off = np.log(self.z_m / np.where(np.isfinite(known), known, 1e-3))
        ways = np.column_stack([np.ones(len(off)), self.rays[:, 1:] - self.rays[:, 1:].mean(axis=0)])
        even, bend = np.zeros(3), np.zeros(len(off))
        for most in _BENT:
            some = np.abs(off - bend) < most * share
            of = ways[some]
            even = np.linalg.solve(of.T @ of + np.diag((_WITHIN / _EVEN) ** 2), of.T @ off[some])
            bend = ways @ even
        return self.z_m * np.exp(-bend), 0.5 * float(((even / (share * _EVEN)) ** 2).sum())

    def explained(self, guess: Guess, body: Body) -> float:
        """Returns the share of the pixels that stand out in the box which the guess explains within three sigma.

        Where hardly any does, as of what is flat and far, it is the share of what the guess shows in the box. Without
        depth it is the share of the box that the guess covers.
        """
        depth = body.depth(guess, self.seen.eye_m, self.rays)
        if not self.has_depth:
            return float((np.isfinite(depth) & self.mine).sum() / max(1, self.mine.sum()))
        good = np.abs(self._unbent(depth)[0] - depth) < 3.0 * self.sigma_m + 0.01
        of = self.mine
        if self.mine.sum() < _FEW * self.inside.sum():
            of = self.inside & (depth < self.other_m)
        return float((good & of).sum() / max(1, of.sum()))

    def residual_m(self, guess: Guess, body: Body) -> float:
        """Returns the median distance between seen and guessed depths, over the pixels that the guess shows."""
        depth = body.depth(guess, self.seen.eye_m, self.rays)
        off = np.abs(self._unbent(depth)[0] - depth)
        own = self.inside & (depth < self.other_m) & (off < 0.1)
        return float(np.median(off[own])) if own.any() else math.inf

    def colour_cost(self, depth: Array, group: NDArray[np.int64]) -> float:
        """Returns how badly a guess explains the colours of the box.

        Faces of one part that look one way should be of one colour, and so should be what is seen beside the guess of
        one wall or one face of another thing.

        Args:
            depth: (N,) of the guess.
            group: (N,) which of its faces each pixel shows, see `Body.looks`.
        """
        inside = self.inside
        if int(inside.sum()) < 20:
            return 0.0
        if self.seen.by_sight:
            return self._picture_cost(depth, group)
        z = self._unbent(depth)[0][inside]
        depth, group = depth[inside], group[inside]
        slack, behind = 0.03 + 3.0 * self.sigma_m[inside], self.other_m[inside]
        own = depth < behind
        kind = np.where(own & (np.abs(z - depth) < slack), group, _UNEXPLAINED)
        kind = np.where(~own & (np.abs(z - behind) < slack), _BEYOND - self.other[inside], kind)
        explained = kind != _UNEXPLAINED
        costs, colours = _of_one_colour(self.rgb[inside][explained], kind[explained])
        costs += _COLOUR_MOST * float((~explained).sum())
        return self.weight * costs / len(self.z_m) + _freedom(colours, len(kind))

    def _picture_cost(self, depth: Array, group: NDArray[np.int64]) -> float:
        """By sight: the colours of faces, those that are left to others, and edges, where borders are."""
        own = depth < self.other_m
        shown, beside = self.inside & own, self.inside & ~own
        costs, colours = _of_one_colour(self.rgb[shown], group[shown], shaded=True)
        costs += float(np.minimum(0.5 * (self.unlike_beside[beside] / _COLOUR_SIGMA) ** 2, _COLOUR_MOST).sum())
        costs += float(self.claim[own].sum())
        cost = self.weight * costs / len(self.z_m) + _freedom(colours, int(self.inside.sum()))
        return cost if self.edges is None else cost + self.edges.cost(np.where(own, group, _BEYOND - self.other))

    def box_cost(self, guess: Guess) -> float:
        """Returns how badly the guess's outline fits the box; what is hidden may reach further than what was boxed."""
        width, height = self.seen.size_px
        if self.seen.by_sight:
            low, high = (side.tolist() for side in self.seen.bounds_px(guess.outline_m()))
        else:
            # Beside depths boxes count little, and corners are sooner found.
            pixels = self.seen.pixels(guess.corners_m())
            low, high = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
        if not all(map(math.isfinite, (*low, *high))):
            return 4 * _BOX_MOST
        x0, y0, x1, y1 = self.box_px
        cost, most_cost = 0.0, _BOX_ALONE if self.seen.by_sight else _BOX_MOST
        for first, last, begin, end, most in ((x0, x1, low[0], high[0], width), (y0, y1, low[1], high[1], height)):
            sigma = (last - first) * _CLAIM_SIGMA + 1.0
            for over in (first - min(max(begin, 0.0), most), min(max(end, 0.0), most) - last):
                square = (over / sigma) ** 2
                cost += min(0.25 * square, 0.25 * most_cost) if over > 0.0 else min(0.5 * square, most_cost)
        return cost


def _beyond(box_px: tuple[float, float, float, float], rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
    """How far pixels (N,) are outside a box, by how exact boxes are; 0 in it."""
    x0, y0, x1, y1 = box_px
    beyond_x = np.maximum(np.maximum(x0 - columns - 0.5, columns + 0.5 - x1), 0.0) / (x1 - x0)
    beyond_y = np.maximum(np.maximum(y0 - rows - 0.5, rows + 0.5 - y1), 0.0) / (y1 - y0)
    return np.asarray(np.hypot(beyond_x, beyond_y) / _CLAIM_SIGMA)


def _of_one_colour(rgb: Array, kind: NDArray[np.int64], *, shaded: bool = False) -> tuple[float, float]:
    """What pixels (N, 3) cost that are not of the middle colour of their kind (N,), and how many colours there are.

    Where a kind may be shaded, a part of it may have that colour in another light: below a top's edge it is dark.
    """
    if not len(kind):
        return 0.0, 0.0
    # Short numbers are sorted in a time that grows with how many there are.
    order = np.argsort(kind.astype(np.int16), kind="stable")
    rgb = np.ascontiguousarray(rgb[order].T)
    ends = np.append(np.flatnonzero(np.diff(kind[order])) + 1, len(order))
    begins = np.concatenate([[0], ends[:-1]])
    of_one = np.stack([_middle(rgb[:, first:last]) for first, last in zip(begins, ends, strict=True)], axis=1)
    of_all = np.repeat(of_one, ends - begins, axis=1)
    costs = _off(rgb, of_all)
    if not shaded:
        return float(costs.sum()), len(ends)
    number = np.repeat(np.arange(len(ends)), ends - begins)
    shade = _shade(rgb, of_all, costs, number, len(ends))
    in_shade = np.minimum(costs, _off(rgb, shade[number] * of_all))
    return float(in_shade.sum()), len(ends) + _TONE * float((shade != 1.0).sum())


def _off(rgb: Array, middle: Array) -> Array:
    """(N,) what pixels (3, N) cost that are not of these colours (3, N)."""
    off = (rgb - middle) / _COLOUR_SIGMA
    return np.minimum(0.5 * (off * off).sum(axis=0), _COLOUR_MOST)


def _shade(rgb: Array, middle: Array, costs: Array, number: NDArray[np.int64], kinds: int) -> Array:
    """(K,) how bright the part of each kind is, by its middle colour, that is in another light; 1 where there is none.

    Args:
        rgb, middle: (3, N) pixels and the middle colours of their kinds.
        costs: (N,) what they cost beside these.
        number: (N,) which kind each is of.
        kinds: How many there are.
    """
    bright = (rgb * middle).sum(axis=0) / np.maximum((middle * middle).sum(axis=0), 1e-6)
    aside = rgb - bright * middle
    alike = (aside * aside).sum(axis=0) < _SAME_HUE**2
    odd = (costs > _ODD) & alike & (bright > _SHADES[0]) & (bright < _SHADES[1])
    # What is darker, and what is lighter than the rest.
    side = 2 * number[odd] + (bright[odd] > 1.0)
    counts = np.bincount(side, minlength=2 * kinds).reshape(kinds, 2)
    total = np.bincount(side, bright[odd], minlength=2 * kinds).reshape(kinds, 2)
    most = counts.argmax(axis=1)
    count, of_most = counts[np.arange(kinds), most], total[np.arange(kinds), most]
    return np.where(count >= _LEAST_SHADED, of_most / np.maximum(count, 1), 1.0)


def _freedom(colours: float, pixels: int) -> float:
    """What it costs to choose so many colours, each of which makes any picture easier to explain."""
    return 1.5 * colours * math.log(pixels) / 10.0


def _middle(rows: Array) -> Array:
    """(M,) the median of each of some rows (M, N), sooner than numpy finds it in what is small."""
    half = rows.shape[1] // 2
    if rows.shape[1] % 2:
        return np.asarray(np.partition(rows, half, axis=1)[:, half])
    return np.asarray(np.partition(rows, (half - 1, half), axis=1)[:, half - 1 : half + 1].mean(axis=1))
