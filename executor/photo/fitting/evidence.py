"""Pixel evidence for a hypothesis: depth, colours, edges and the box.

Each pixel of a box has a measured depth, and the depth of everything else in the room. The hypothesis is rendered into
that. It is wrong where something farther is measured through it; something nearer may be another object in front.
Pixels that it covers outside the box cost.

A correct hypothesis ends at edges of the picture, and leaves only colours of the surroundings to others. Both are
computed once for the pixels of a box, so that they add hardly any time to a hypothesis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label, maximum_filter1d

from executor.assets.parameters import ChoiceParameter
from executor.geometry import Array
from executor.photo.fitting.hypothesis import MeshRaycaster, PoseHypothesis, raycaster_of
from executor.photo.geometry.observation import Observation

_SURROUND_SHARE, _LEAST_SURROUND_PX = 0.5, 24.0  # Margin around a box for other colours: share of its sides, pixels.
_SHADE_STEP, _LEAST_SHARE = 16, 0.004  # Step of each colour; least share of the pixels of a colour.
_EDGE_CONTRAST = 0.035  # Of full brightness: a larger difference across two pixels is an edge.
_EDGE_TOLERANCE_PX = 1  # Tolerance of an edge's place.
_VISIBLE_EDGE_SHARE = 0.8  # Share of a model's edges that the picture shows; faces may look alike.
_MOST_CLUTTER_SHARE = 0.5  # Of neighbouring pixels with an edge between them.
_FOOT_MARGIN_SHARE = 0.15  # Margin around a foot for its support, as a share of the box's height.
_LEAST_CHROMA, _SAME_HUE_RAD, _SAME_CHROMA, _SAME_LIGHT = 12.0, 0.15, (0.5, 1.6), 40.0
"""In CIELAB: least chroma, below which colours are grey as floor and walls; differences of faces of one object in
light and shade."""
_INDEPENDENT_EDGE_SHARE = 0.3  # Share of pairs along an edge that are independent measurements.
_BOX_MARGIN_SHARE = 0.12  # Of the box's sides, looked at around it.
_MODEL_ERROR_M = 0.004  # Error of a correct model.
_TRANSPARENCY_COST, _HIDDEN_COST, _OUTSIDE_BOX_COST = 8.0, 5.0, 4.0
"""Largest cost of a pixel: seen through the hypothesis; nearer than everything known; covered outside the box."""

_BOX_SIGMA_SHARE = 0.04  # Of the box's sides: how exact boxes are.
_NONLINEAR_SHARE = 0.3  # Share of the distortion that is not linear around one object.
_LINEAR_DISTORTION = np.array([1.0, 7.0, 7.0])
"""Linear distortion around an object, as shares of the distortion: offset, and slopes per unit of a ray to the left
and up."""

_DISTORTED_WEIGHT = 16.0
"""Number of independent measurements that distorted depth is worth: all its errors are correlated."""

_OUTLIER_SIGMAS = (4.0, 2.0)  # Standard deviations: outliers in the first round, and in the second.
_MASK_ERROR_PX = 1.5  # How exact masks are.
_COLOUR_SIGMA, _MOST_COLOUR_COST = 0.06, 4.0  # Deviation within one face, in 0 to 1; largest cost of a pixel.
_LEAST_SHADED_COST, _SHADED_HUE_TOLERANCE, _BRIGHTNESS_RANGE, _LEAST_SHADED_PIXELS = 2.0, 0.05, (0.45, 2.2), 8
"""Differently lit part of one colour: least cost of a pixel, tolerance of the hue, range of brightness, least
pixels."""

_COLOURS_OF_SHADED_FACE = 3.0  # Extra colours that a face in two lights counts for.
_UNEXPLAINED, _OTHER_FACES = -1, -2  # Groups of pixels: unexplained; then, downwards, faces of other objects.
_MOST_BOX_COST, _MOST_BOX_COST_MONOCULAR = 8.0, 40.0  # Largest cost of a side of the outline.
_NOISE_SHARE = 0.1  # Share of a box's pixels that noise makes stand out at edges.


def distance_to_surroundings(
    rgb: NDArray[np.uint8], box_px: tuple[float, float, float, float], colours: Array
) -> Array:
    """Return (N,) the distance of colours from the nearest colour around a box.

    Args:
        rgb: (H, W, 3) the picture.
        box_px: The box.
        colours: (N, 3) in 0 to 1.
    """
    x0, y0, x1, y1 = box_px
    over_x, over_y = (
        max(_LEAST_SURROUND_PX, _SURROUND_SHARE * (x1 - x0)),
        max(_LEAST_SURROUND_PX, _SURROUND_SHARE * (y1 - y0)),
    )
    height, width = rgb.shape[:2]
    left, right = max(0, int(x0 - over_x)), min(width, math.ceil(x1 + over_x))
    top, bottom = max(0, int(y0 - over_y)), min(height, math.ceil(y1 + over_y))
    surround = np.ones((bottom - top, right - left), dtype=bool)
    rows = slice(max(0, int(y0) - top), max(0, math.ceil(y1) - top))
    columns = slice(max(0, int(x0) - left), max(0, math.ceil(x1) - left))
    surround[rows, columns] = False
    samples = rgb[top:bottom, left:right][surround].astype(np.int64)
    if not len(samples):
        return np.full(len(colours), np.inf)
    shade = (samples // _SHADE_STEP) @ [1, _SHADE_STEP, _SHADE_STEP**2]
    _, which, counts = np.unique(shade, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(which.ravel(), samples[:, k]) for k in range(3)], axis=1) / counts[:, None] / 255.0
    means = means[counts > _LEAST_SHARE * len(samples)]
    if not len(means):
        return np.full(len(colours), np.inf)
    return np.sqrt(((colours[:, None, :] - means[None, :, :]) ** 2).sum(axis=2).min(axis=1))


def of_one_hue(rgb: NDArray[np.uint8], box_px: tuple[float, float, float, float]) -> NDArray[np.bool_] | None:
    """Return (H, W) the segment around a box with the hue next to its foot, and the box; None for grey.

    Args:
        rgb: (H, W, 3) the picture.
        box_px: The box.
    """
    x0, y0, x1, y1 = (round(value) for value in box_px)
    height, width = rgb.shape[:2]
    margin = max(3, round(_FOOT_MARGIN_SHARE * (y1 - y0)))
    low, high = round((y0 + 2 * y1) / 3), y1 + margin
    around = [(x0 - margin, y0), (x1 + margin, y0), (x0 - margin, low), (x1 + margin, low), ((x0 + x1) // 2, high)]
    lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255.0), cv2.COLOR_RGB2LAB)
    samples = [lab[y, x] for x, y in around if 0 <= x < width and 0 <= y < height]
    if not samples:
        return None
    light, a, b = np.median(samples, axis=0)
    own = math.hypot(a, b)
    if own < _LEAST_CHROMA:
        return None
    chroma = np.hypot(lab[..., 1], lab[..., 2])
    # The cosine of the angle between two colours' hues, times both chromas.
    alike = lab[..., 1] * a + lab[..., 2] * b > math.cos(_SAME_HUE_RAD) * own * chroma
    alike &= (chroma > _SAME_CHROMA[0] * own) & (chroma < _SAME_CHROMA[1] * own)
    alike &= np.abs(lab[..., 0] - light) < _SAME_LIGHT
    alike[max(0, y0 - 1) : y1 + 2, max(0, x0 - 1) : x1 + 2] = True
    pieces, _ = label(alike)
    return np.asarray(pieces == pieces[min(height - 1, (y0 + y1) // 2), min(width - 1, (x0 + x1) // 2)])


@dataclass(frozen=True)
class Edges:
    """Pairs of neighbouring pixels, and the gain of predicting an edge between them.

    Attributes:
        first, second: (M,) numbers of pixels.
        worth: (M,) log-likelihood ratio of the picture with and without an edge there.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    worth: Array

    @classmethod
    def between(
        cls, strength: tuple[Array, Array], rows: NDArray[np.int64], columns: NDArray[np.int64], step: int
    ) -> Edges:
        """Return the pairs among some pixels of a grid.

        Args:
            strength: (H, W) twice: how much the picture differs to the right, and below.
            rows, columns: (N,) the pixels.
            step: Spacing of the grid in pixels.
        """
        top, left = int(rows.min()), int(columns.min())
        i, j = (rows - top) // step, (columns - left) // step
        number = np.full((int(i.max()) + 2, int(j.max()) + 2), -1, dtype=np.int64)
        number[i, j] = np.arange(len(rows))
        firsts, seconds, found = [], [], []
        for axis, (down, right) in enumerate(((0, 1), (1, 0))):
            other = number[i + down, j + right]
            here = np.flatnonzero(other >= 0)
            # The edge may be anywhere between the two, or a pixel beside that.
            size = step + 2 * _EDGE_TOLERANCE_PX
            widest = maximum_filter1d(strength[axis], size, axis=1 - axis, origin=-(step // 2))
            firsts.append(here)
            seconds.append(other[here])
            found.append(widest[rows[here], columns[here]])
        is_edge = np.concatenate(found) > _EDGE_CONTRAST
        clutter = min(max(float(is_edge.mean()), 0.01), _MOST_CLUTTER_SHARE)
        worth = np.where(
            is_edge, math.log(_VISIBLE_EDGE_SHARE / clutter), math.log((1.0 - _VISIBLE_EDGE_SHARE) / (1.0 - clutter))
        )
        return cls(np.concatenate(firsts), np.concatenate(seconds), _INDEPENDENT_EDGE_SHARE * worth)

    def border_cost(self, label: NDArray[np.int64]) -> float:
        """Return the cost of borders between pixels (N,) of different labels against the picture's edges."""
        return -float(self.worth[label[self.first] != label[self.second]].sum())


@dataclass(frozen=True)
class PixelEvidence:
    """Pixel evidence of one object: N rays of its part of the picture.

    Attributes:
        observation: The whole picture.
        box_px: The detection's box.
        rays: (N, 3) in the level frame.
        z_m, sigma_m: (N,) measured depth and its standard deviation.
        other_m: (N,) depth of everything else known, infinite for nothing.
        other: (N,) face of everything else, by number.
        inside: (N,) whether the pixel is in the box, or in the mask if there is one.
        claim: (N,) cost of covering a pixel outside the box.
        rgb: (N, 3) in 0 to 1.
        mine: (N,) whether something nearer than everything else was measured in the box.
        weight: How many independent measurements a mean over the pixels stands for.
        has_depth: Whether depth was measured; else box and colours are the only evidence.
        distance_to_surroundings: (N,) if the picture is monocular, the distance of a pixel's colour from the colours
            around the box.
        edges: If the picture is monocular, where borders of objects may be; else None.
    """

    observation: Observation
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
    distance_to_surroundings: Array
    edges: Edges | None

    @classmethod
    def around(
        cls,
        observation: Observation,
        box_px: tuple[float, float, float, float],
        other_m: Array,
        other: NDArray[np.int32],
        most: int,
        foreign: NDArray[np.bool_] | None = None,
        own: NDArray[np.bool_] | None = None,
    ) -> PixelEvidence:
        """Sample at most so many pixels of a box and its surroundings.

        Args:
            observation: The picture.
            box_px: The box.
            other_m, other: (H, W) depth of everything else known, and its face number.
            most: How many pixels, about.
            foreign: (H, W) pixels of other objects, which are no evidence.
            own: (H, W) the object's own pixels, if they are known; they replace the box.
        """
        width, height = observation.size_px
        x0, y0, x1, y1 = box_px
        over_x, over_y = max(4.0, _BOX_MARGIN_SHARE * (x1 - x0)), max(4.0, _BOX_MARGIN_SHARE * (y1 - y0))
        left, right = max(0, int(x0 - over_x)), min(width, math.ceil(x1 + over_x))
        top, bottom = max(0, int(y0 - over_y)), min(height, math.ceil(y1 + over_y))
        step = max(1, int(math.sqrt((right - left) * (bottom - top) / most)))
        rows, columns = np.mgrid[top + step // 2 : bottom : step, left + step // 2 : right : step]
        rows, columns = rows.ravel(), columns.ravel()
        has_depth = observation.has_depth
        keep = observation.measured[rows, columns] if has_depth else np.ones(len(rows), dtype=bool)
        if foreign is not None:
            keep &= ~foreign[rows, columns]
        rows, columns = rows[keep], columns[keep]
        if own is None:
            beyond = _beyond(box_px, rows, columns)
        else:
            window = np.s_[top:bottom, left:right]
            beyond = distance_transform_edt(~own[window])[rows - top, columns - left] / _MASK_ERROR_PX
        inside = beyond <= 0.0
        z, behind = observation.z_m[rows, columns], other_m[rows, columns]
        sigma = np.hypot(
            observation.sigma_m[rows, columns], _MODEL_ERROR_M + _NONLINEAR_SHARE * observation.depth_distortion * z
        )
        mine = inside & (z < behind - np.maximum(0.015, 3.0 * sigma)) if has_depth else inside
        return cls(
            observation,
            box_px,
            observation.rays[rows, columns],
            z,
            sigma,
            behind,
            other[rows, columns],
            inside,
            _OUTSIDE_BOX_COST * np.minimum(1.0, beyond**2),
            observation.rgb[rows, columns] / 255.0,
            mine,
            math.sqrt(max(1, len(rows))) * 6.0,
            has_depth,
            distance_to_surroundings(observation.rgb, box_px, observation.rgb[rows, columns] / 255.0)
            if observation.monocular
            else np.zeros(0),
            Edges.between(observation.edge_strength, rows, columns, step)
            if observation.monocular and len(rows)
            else None,
        )

    @property
    def own_points_m(self) -> Array:
        """(M, 3) all residual points of the box."""
        return np.asarray(self.observation.eye_m + self.rays[self.mine] * self.z_m[self.mine, None])

    def cost(self, guess: PoseHypothesis, body: MeshRaycaster) -> float:
        """Return the depth cost of a hypothesis, as a negative logarithm of likelihood."""
        if not self.has_depth:
            return 0.0
        return self.depth_cost(body.depth(guess, self.observation.eye_m, self.rays))

    def depth_cost(self, depth: Array) -> float:
        """Return the depth cost of a rendered hypothesis (N,), 0 without measured depth."""
        if not self.has_depth:
            return 0.0
        z_m, bend_cost = self._unbent(depth)
        off = (z_m - np.minimum(depth, self.other_m)) / self.sigma_m
        beyond = off > 0.0
        square = np.minimum(0.5 * off * off, np.where(beyond, _TRANSPARENCY_COST, _HIDDEN_COST))
        outside = np.where(beyond, square, 0.0) + np.where(off > -3.0, self.claim, 0.0)
        mean_cost = float(np.where(self.inside, square, outside * (depth < self.other_m)).mean())
        weight = min(self.weight, _DISTORTED_WEIGHT) if self.observation.monocular else self.weight
        return weight * mean_cost + bend_cost

    def _unbent(self, depth: Array) -> tuple[Array, float]:
        """Correct distorted depth linearly around a rendered hypothesis; return (N,) depth and the cost of that.

        One linear distortion covers the object and its known surroundings: where it stands, both have the same error.
        """
        share = self.observation.depth_distortion
        if not share or not len(depth):
            return self.z_m, 0.0
        known = np.minimum(depth, self.other_m)
        off = np.log(self.z_m / np.where(np.isfinite(known), known, 1e-3))
        design = np.column_stack([np.ones(len(off)), self.rays[:, 1:] - self.rays[:, 1:].mean(axis=0)])
        prior = np.diag((_NONLINEAR_SHARE / _LINEAR_DISTORTION) ** 2)
        coefficients, bend = np.zeros(3), np.zeros(len(off))
        for sigmas in _OUTLIER_SIGMAS:
            inliers = np.abs(off - bend) < sigmas * share
            rows = design[inliers]
            coefficients = np.linalg.solve(rows.T @ rows + prior, rows.T @ off[inliers])
            bend = design @ coefficients
        return self.z_m * np.exp(-bend), 0.5 * float(((coefficients / (share * _LINEAR_DISTORTION)) ** 2).sum())

    def explained(self, guess: PoseHypothesis, body: MeshRaycaster) -> float:
        """Return the share of residual pixels in the box that the hypothesis explains within three sigma.

        If hardly any pixel stands out, as for flat and distant objects, it is the share of the pixels that the
        hypothesis shows in the box. Without depth it is the share of the box that the hypothesis covers.
        """
        depth = body.depth(guess, self.observation.eye_m, self.rays)
        if not self.has_depth:
            return float((np.isfinite(depth) & self.mine).sum() / max(1, self.mine.sum()))
        good = np.abs(self._unbent(depth)[0] - depth) < 3.0 * self.sigma_m + 0.01
        of = self.mine
        if self.mine.sum() < _NOISE_SHARE * self.inside.sum():
            of = self.inside & (depth < self.other_m)
        return float((good & of).sum() / max(1, of.sum()))

    def residual_m(self, guess: PoseHypothesis, body: MeshRaycaster) -> float:
        """Return the median distance between measured and hypothesised depth over the visible pixels."""
        depth = body.depth(guess, self.observation.eye_m, self.rays)
        off = np.abs(self._unbent(depth)[0] - depth)
        own = self.inside & (depth < self.other_m) & (off < 0.1)
        return float(np.median(off[own])) if own.any() else math.inf

    def colour_cost(self, depth: Array, group: NDArray[np.int64]) -> float:
        """Return the colour cost of a hypothesis.

        Similar faces should have one colour, and so should the visible part of one wall or of one face of another
        object.

        Args:
            depth: (N,) of the hypothesis.
            group: (N,) its face group in each pixel, see `MeshRaycaster.render_depth`.
        """
        inside = self.inside
        if int(inside.sum()) < 20:
            return 0.0
        if self.observation.monocular:
            return self._picture_cost(depth, group)
        z = self._unbent(depth)[0][inside]
        depth, group = depth[inside], group[inside]
        slack, behind = 0.03 + 3.0 * self.sigma_m[inside], self.other_m[inside]
        own = depth < behind
        kind = np.where(own & (np.abs(z - depth) < slack), group, _UNEXPLAINED)
        kind = np.where(~own & (np.abs(z - behind) < slack), _OTHER_FACES - self.other[inside], kind)
        explained = kind != _UNEXPLAINED
        costs, colours = _of_one_colour(self.rgb[inside][explained], kind[explained])
        costs += _MOST_COLOUR_COST * float((~explained).sum())
        return self.weight * costs / len(self.z_m) + _freedom(colours, len(kind))

    def _picture_cost(self, depth: Array, group: NDArray[np.int64]) -> float:
        """Return the monocular cost: colours of faces, colours left to others, and borders at edges."""
        own = depth < self.other_m
        shown, uncovered = self.inside & own, self.inside & ~own
        costs, colours = _of_one_colour(self.rgb[shown], group[shown], shaded=True)
        costs += float(
            np.minimum(0.5 * (self.distance_to_surroundings[uncovered] / _COLOUR_SIGMA) ** 2, _MOST_COLOUR_COST).sum()
        )
        costs += float(self.claim[own].sum())
        of_colours = self.weight * costs / len(self.z_m) + _freedom(colours, int(self.inside.sum()))
        if self.edges is None:
            return of_colours
        return of_colours + self.edges.border_cost(np.where(own, group, _OTHER_FACES - self.other))

    def box_cost(self, guess: PoseHypothesis) -> float:
        """Return the cost of the outline against the box; hidden parts may reach beyond the box."""
        width, height = self.observation.size_px
        if self.observation.monocular:
            low, high = (side.tolist() for side in self.observation.bounds_px(guess.outline_m()))
        else:
            # With depth the box counts little, and corners are cheaper.
            pixels = self.observation.pixels(guess.corners_m())
            low, high = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
        if not all(map(math.isfinite, (*low, *high))):
            return 4 * _MOST_BOX_COST
        x0, y0, x1, y1 = self.box_px
        total, most_cost = 0.0, _MOST_BOX_COST_MONOCULAR if self.observation.monocular else _MOST_BOX_COST
        for first, last, begin, end, most in ((x0, x1, low[0], high[0], width), (y0, y1, low[1], high[1], height)):
            sigma = (last - first) * _BOX_SIGMA_SHARE + 1.0
            for over in (first - min(max(begin, 0.0), most), min(max(end, 0.0), most) - last):
                square = (over / sigma) ** 2
                total += min(0.25 * square, 0.25 * most_cost) if over > 0.0 else min(0.5 * square, most_cost)
        return total


def _beyond(box_px: tuple[float, float, float, float], rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
    """Return (N,) how far pixels are outside a box, in units of the boxes' accuracy; 0 inside."""
    x0, y0, x1, y1 = box_px
    beyond_x = np.maximum(np.maximum(x0 - columns - 0.5, columns + 0.5 - x1), 0.0) / (x1 - x0)
    beyond_y = np.maximum(np.maximum(y0 - rows - 0.5, rows + 0.5 - y1), 0.0) / (y1 - y0)
    return np.asarray(np.hypot(beyond_x, beyond_y) / _BOX_SIGMA_SHARE)


def _of_one_colour(rgb: Array, kind: NDArray[np.int64], *, shaded: bool = False) -> tuple[float, float]:
    """Return the cost of pixels (N, 3) against the median colour of their kind (N,), and the number of colours.

    With `shaded`, a part of a kind may have that colour in other light: below a top's edge it is dark.
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
    return float(in_shade.sum()), len(ends) + _COLOURS_OF_SHADED_FACE * float((shade != 1.0).sum())


def _off(rgb: Array, middle: Array) -> Array:
    """Return (N,) the cost of pixels (3, N) against colours (3, N)."""
    off = (rgb - middle) / _COLOUR_SIGMA
    return np.minimum(0.5 * (off * off).sum(axis=0), _MOST_COLOUR_COST)


def _shade(rgb: Array, middle: Array, costs: Array, number: NDArray[np.int64], kinds: int) -> Array:
    """Return (K,) the brightness of the differently lit part of each kind, relative to its median; 1 if there is none.

    Args:
        rgb, middle: (3, N) pixels and the median colours of their kinds.
        costs: (N,) their costs against these.
        number: (N,) their kinds.
        kinds: Number of kinds.
    """
    bright = (rgb * middle).sum(axis=0) / np.maximum((middle * middle).sum(axis=0), 1e-6)
    aside = rgb - bright * middle
    alike = (aside * aside).sum(axis=0) < _SHADED_HUE_TOLERANCE**2
    odd = (costs > _LEAST_SHADED_COST) & alike & (bright > _BRIGHTNESS_RANGE[0]) & (bright < _BRIGHTNESS_RANGE[1])
    # Darker and lighter parts.
    side = 2 * number[odd] + (bright[odd] > 1.0)
    counts = np.bincount(side, minlength=2 * kinds).reshape(kinds, 2)
    total = np.bincount(side, bright[odd], minlength=2 * kinds).reshape(kinds, 2)
    most = counts.argmax(axis=1)
    count, of_most = counts[np.arange(kinds), most], total[np.arange(kinds), most]
    return np.where(count >= _LEAST_SHADED_PIXELS, of_most / np.maximum(count, 1), 1.0)


def _freedom(colours: float, pixels: int) -> float:
    """Return the cost of choosing so many colours, each of which makes any picture easier to explain."""
    return 1.5 * colours * math.log(pixels) / 10.0


def _middle(rows: Array) -> Array:
    """Return (M,) the median of each row (M, N), faster than numpy for small rows."""
    half = rows.shape[1] // 2
    if rows.shape[1] % 2:
        return np.asarray(np.partition(rows, half, axis=1)[:, half])
    return np.asarray(np.partition(rows, (half - 1, half), axis=1)[:, half - 1 : half + 1].mean(axis=1))


_OPTION = "color"
_LEAST_COLOUR_PX = 12
_SHARE_OF_LIGHT = 0.15
"""Weight of a doubling of the light against the shares of the colours: a picture shows colours, but hardly how
bright the room was."""


def median_colour(evidence: PixelEvidence, guess: PoseHypothesis) -> tuple[int, int, int] | None:
    """Return the median colour of an object's visible pixels, sRGB from 0 to 255; None if it is hidden."""
    shown, _ = _shown(evidence, guess)
    if len(shown) < _LEAST_COLOUR_PX:
        return None
    red, green, blue = (round(255.0 * float(value)) for value in np.median(shown, axis=0))
    return red, green, blue


def colour_distance(evidence: PixelEvidence, guess: PoseHypothesis) -> float:
    """Return the distance of a model's own colours from the observed ones, 0 to about 2; 0 if it is hidden."""
    shown, own = _shown(evidence, with_colour(evidence, guess))
    return _unlike(_linear(shown), own) if len(shown) >= _LEAST_COLOUR_PX else 0.0


def with_colour(evidence: PixelEvidence, guess: PoseHypothesis) -> PoseHypothesis:
    """Choose the colour option of a model that is nearest to the observed colours, if it has any."""
    option = next(
        (one for one in guess.entry.parameters if isinstance(one, ChoiceParameter) and one.name == _OPTION), None
    )
    if option is None:
        return guess
    rated = []
    for word in option.words:
        one = guess.with_parameters(**{_OPTION: word})
        shown, own = _shown(evidence, one)
        if len(shown) < _LEAST_COLOUR_PX:
            return guess
        rated.append((_unlike(_linear(shown), own), word))
    return guess.with_parameters(**{_OPTION: min(rated)[1]})


def _shown(evidence: PixelEvidence, guess: PoseHypothesis) -> tuple[Array, Array]:
    """Return (N, 3) sRGB in 0 to 1 of an object's visible pixels, and (N, 3) the model's linear colours there."""
    body = raycaster_of(guess)
    if body is None:
        return np.zeros((0, 3)), np.zeros((0, 3))
    depth, colors = body.colours(guess, evidence.observation.eye_m, evidence.rays)
    own = evidence.inside & (depth < evidence.other_m)
    if evidence.has_depth:
        own &= np.abs(evidence.z_m - depth) < 3.0 * evidence.sigma_m + 0.01
    return evidence.rgb[own], colors[own]


def _linear(srgb: Array) -> Array:
    """Convert sRGB to linear intensity (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _unlike(observed: Array, own: Array) -> float:
    """Return the mean colour distance: shares of red, green and blue, and slightly the brightness."""
    observed, own = np.maximum(observed, 1e-3), np.maximum(own, 1e-3)
    shares = np.abs(observed / observed.sum(axis=1, keepdims=True) - own / own.sum(axis=1, keepdims=True)).sum(axis=1)
    light = np.abs(np.log2(observed.sum(axis=1) / own.sum(axis=1)))
    return float(np.mean(shares + _SHARE_OF_LIGHT * light))
