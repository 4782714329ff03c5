"""Pixel evidence for a hypothesis: depth, colours and the box.

Each pixel of a box has a measured depth, and the depth of everything else in the room. The hypothesis is rendered into
that. It is wrong where something farther is measured through it; something nearer may be another object in front.
Pixels that it covers outside the box cost. Without depth the pixels tell only colours.
"""

from __future__ import annotations

import colorsys
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from executor.assets.families.generic import GENERIC
from executor.assets.parameters import ChoiceParameter
from executor.geometry import Array
from executor.photo.fitting.hypothesis import MeshRaycaster, PoseHypothesis, raycaster_of
from executor.photo.geometry.observation import Observation

_BOX_MARGIN_SHARE = 0.2  # Of the box's sides, looked at around it.
_MODEL_ERROR_M = 0.004  # Error of a correct model.
_TRANSPARENCY_COST, _HIDDEN_COST, _OUTSIDE_BOX_COST = 8.0, 5.0, 4.0
"""Largest cost of a pixel: seen through the hypothesis; nearer than everything known; covered outside the box."""

_BOX_SIGMA_SHARE = 0.04  # Of the box's sides: how exact boxes are.
_MASK_ERROR_PX = 1.5  # How exact masks are.
_COLOUR_SIGMA, _MOST_COLOUR_COST = 0.06, 4.0  # Deviation within one face, in 0 to 1; largest cost of a pixel.
_UNEXPLAINED, _OTHER_FACES = -1, -2  # Groups of pixels: unexplained; then, downwards, faces of other objects.
_BEYOND_WEIGHT, _MOST_BEYOND = 0.25, 8.0  # A part beyond a side of the box may be hidden.
_SHORT_SIGMAS = 3.0  # From there on, the cost of an outline that ends before its box grows in proportion.
_NOT_SHOWN = 1e4  # Cost of an outline that is nowhere in the picture.
_NOISE_SHARE = 0.1  # Share of a box's pixels that noise makes stand out at edges.


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
        has_depth: Whether depth was measured; else its pixels tell only colours.
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
        sigma = np.hypot(observation.depth_distortion_m[rows, columns], _MODEL_ERROR_M)
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
        )

    @property
    def own_points_m(self) -> Array:
        """(M, 3) all residual points of the box."""
        return np.asarray(self.observation.eye_m + self.rays[self.mine] * self.z_m[self.mine, None])

    def cost(self, guess: PoseHypothesis, body: MeshRaycaster) -> float:
        """Return the depth cost of a hypothesis, as a negative logarithm of likelihood."""
        return self.depth_cost(body.depth(guess, self.observation.eye_m, self.rays))

    def depth_cost(self, depth: Array) -> float:
        """Return the depth cost of a rendered hypothesis (N,)."""
        off = (self.z_m - np.minimum(depth, self.other_m)) / self.sigma_m
        beyond = off > 0.0
        square = np.minimum(0.5 * off * off, np.where(beyond, _TRANSPARENCY_COST, _HIDDEN_COST))
        outside = np.where(beyond, square, 0.0) + np.where(off > -3.0, self.claim, 0.0)
        return self.weight * float(np.where(self.inside, square, outside * (depth < self.other_m)).mean())

    def explained(self, guess: PoseHypothesis, body: MeshRaycaster) -> float:
        """Return the share of residual pixels in the box that the hypothesis explains within three sigma.

        If hardly any pixel stands out, as for flat and distant objects, it is the share of the pixels that the
        hypothesis shows in the box. Without depth it is the share of the box that the hypothesis covers.
        """
        depth = body.depth(guess, self.observation.eye_m, self.rays)
        if not self.has_depth:
            return float((np.isfinite(depth) & self.mine).sum() / max(1, self.mine.sum()))
        good = np.abs(self.z_m - depth) < 3.0 * self.sigma_m + 0.01
        of = self.mine
        if self.mine.sum() < _NOISE_SHARE * self.inside.sum():
            of = self.inside & (depth < self.other_m)
        return float((good & of).sum() / max(1, of.sum()))

    def residual_m(self, guess: PoseHypothesis, body: MeshRaycaster) -> float:
        """Return the median distance between measured and hypothesised depth over the visible pixels."""
        depth = body.depth(guess, self.observation.eye_m, self.rays)
        off = np.abs(self.z_m - depth)
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
        z = self.z_m[inside]
        depth, group = depth[inside], group[inside]
        slack, behind = 0.03 + 3.0 * self.sigma_m[inside], self.other_m[inside]
        own = depth < behind
        kind = np.where(own & (np.abs(z - depth) < slack), group, _UNEXPLAINED)
        kind = np.where(~own & (np.abs(z - behind) < slack), _OTHER_FACES - self.other[inside], kind)
        explained = kind != _UNEXPLAINED
        costs, colours = _of_one_colour(self.rgb[inside][explained], kind[explained])
        costs += _MOST_COLOUR_COST * float((~explained).sum())
        return self.weight * costs / len(self.z_m) + _freedom(colours, len(kind))

    def box_cost(self, guess: PoseHypothesis) -> float:
        """Return the cost of the outline against the box.

        The outline has to reach every side of the box, for so far the object is seen. What is beyond a side may be
        hidden: pixels that show otherwise cost as well.
        """
        low, high = (side.tolist() for side in self.observation.bounds_px(guess.outline_m()))
        if not all(map(math.isfinite, (*low, *high))):
            return _NOT_SHOWN
        width, height = self.observation.size_px
        x0, y0, x1, y1 = self.box_px
        total = 0.0
        for first, last, begin, end, most in ((x0, x1, low[0], high[0], width), (y0, y1, low[1], high[1], height)):
            sigma = (last - first) * _BOX_SIGMA_SHARE + 1.0
            for over in (first - min(max(begin, 0.0), most), min(max(end, 0.0), most) - last):
                off = abs(over) / sigma
                if over > 0.0:
                    total += min(_BEYOND_WEIGHT * off * off, _MOST_BEYOND)
                elif off < _SHORT_SIGMAS:
                    total += 0.5 * off * off
                else:
                    total += _SHORT_SIGMAS * (off - 0.5 * _SHORT_SIGMAS)
        return total


def _beyond(box_px: tuple[float, float, float, float], rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
    """Return (N,) how far pixels are outside a box, in units of the boxes' accuracy; 0 inside."""
    x0, y0, x1, y1 = box_px
    beyond_x = np.maximum(np.maximum(x0 - columns - 0.5, columns + 0.5 - x1), 0.0) / (x1 - x0)
    beyond_y = np.maximum(np.maximum(y0 - rows - 0.5, rows + 0.5 - y1), 0.0) / (y1 - y0)
    return np.asarray(np.hypot(beyond_x, beyond_y) / _BOX_SIGMA_SHARE)


def _of_one_colour(rgb: Array, kind: NDArray[np.int64]) -> tuple[float, float]:
    """Return the cost of pixels (N, 3) against the median colour of their kind (N,), and the number of colours."""
    if not len(kind):
        return 0.0, 0.0
    # Short numbers are sorted in a time that grows with how many there are.
    order = np.argsort(kind.astype(np.int16), kind="stable")
    rgb = np.ascontiguousarray(rgb[order].T)
    ends = np.append(np.flatnonzero(np.diff(kind[order])) + 1, len(order))
    begins = np.concatenate([[0], ends[:-1]])
    of_one = np.stack([_middle(rgb[:, first:last]) for first, last in zip(begins, ends, strict=True)], axis=1)
    off = (rgb - np.repeat(of_one, ends - begins, axis=1)) / _COLOUR_SIGMA
    return float(np.minimum(0.5 * (off * off).sum(axis=0), _MOST_COLOUR_COST).sum()), len(ends)


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
_HUES = (
    (8.0, "red"),
    (40.0, "orange"),
    (68.0, "yellow"),
    (165.0, "green"),
    (255.0, "blue"),
    (320.0, "purple"),
    (345.0, "pink"),
    (361.0, "red"),
)
"""Where the hue of each basic colour term ends [deg]."""
HUES = frozenset(name for _, name in _HUES)

_BLACK, _WHITE, _COLOURLESS, _FAINT, _PALE, _DARK = 0.22, 0.68, 0.15, 0.10, 0.35, 0.38
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


def colour_name(srgb: tuple[int, int, int]) -> str:
    """Return the basic colour term for a colour, sRGB from 0 to 255, by its hue, saturation and value."""
    hue, saturation, value = colorsys.rgb_to_hsv(*(part / 255.0 for part in srgb))
    if value < _BLACK or saturation < _COLOURLESS or saturation * value < _FAINT:
        return "black" if value < _BLACK else "white" if value > _WHITE else "grey"
    name = next(name for most_deg, name in _HUES if 360.0 * hue < most_deg)
    if name in ("orange", "yellow") and saturation < _PALE:
        return "beige" if value > _WHITE else "brown"
    return "brown" if name == "orange" and value < _DARK else name


def with_colour(evidence: PixelEvidence, guess: PoseHypothesis) -> PoseHypothesis:
    """Choose the colour option of a model that is nearest to the observed colours, if it has any.

    A generic shape has one colour: where the median has a hue's name, it is that one, however dark the room was.
    """
    option = next(
        (one for one in guess.entry.parameters if isinstance(one, ChoiceParameter) and one.name == _OPTION), None
    )
    if option is None:
        return guess
    median = median_colour(evidence, guess) if guess.entry.model in GENERIC else None
    if median is not None and (term := colour_name(median)) in HUES:
        return guess.with_parameters(**{_OPTION: term})
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
