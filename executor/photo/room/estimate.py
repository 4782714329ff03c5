"""The current estimate of a room: its fits, their rendered depth, and the supports that things may stand on."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from executor.assets.footprint import region_frame
from executor.assets.library import asset_for
from executor.geometry import Array
from executor.photo.fitting.hypothesis import PoseHypothesis, picture_of
from executor.photo.fitting.likelihood import (
    CARRIED,
    UNITS,
    Fit,
    Neighbourhood,
    SearchContext,
    is_large,
    is_oversized,
    is_same_place,
    prior_cost,
    stands_in,
)
from executor.photo.fitting.starts import LEAST_POINTS, foot_of, points_of
from executor.photo.geometry.level import correct_depth
from executor.photo.geometry.observation import Observation, is_hidden
from executor.photo.geometry.residuals import VisibilityCheck, box_of
from executor.photo.geometry.walls import Wall, depth_of_empty, find_walls_again
from executor.photo.inputs.annotations import FLOOR, Detection
from llm.vision import overlap
from oag import Kind, kind_of

SAME_M, EQUAL_M = 0.02, 0.001
"""Between the height of a top and of an object on it: after the top has moved since, and if both are unchanged."""

_REACH_M = 0.06  # Over the edge of a top, as far as things may seem to stand.
_HEIGHT_M = 0.13  # Between an object's visible bottom and its possible support.
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
        """Return whether a place (2,) is over it, or hardly outside."""
        return bool((self._over_m(at) < _REACH_M).all())

    def distance_m(self, at: Array) -> float:
        """Return the distance of a place (2,) from it [m], 0 over it."""
        return float(np.linalg.norm(np.maximum(self._over_m(at), 0.0)))

    def _over_m(self, at: Array) -> Array:
        local = np.linalg.inv(self.T) @ [*at, self.height_m, 1.0]
        return np.asarray(np.abs(local[:2]) - self.half_m)


def tops_of(fits: Iterable[Fit]) -> Iterator[Top]:
    """Yield the tops and boards of the furniture among some fits."""
    for fit in fits:
        if kind_of(fit.guess.entry.category, fit.guess.size_m[1]) is not Kind.ITEM:
            carrier = fit.guess.as_object()
            for region in asset_for(carrier).regions:
                yield Top(fit, *region_frame(carrier, region))


def is_on_one(guess: PoseHypothesis, tops: Iterable[Top], within_m: float = SAME_M) -> bool:
    """Return whether a hypothesis stands on the floor, or within a tolerance on one of some tops."""
    at = np.array([guess.x_m, guess.y_m])
    near = (top for top in tops if abs(top.height_m - guess.bottom_m) < within_m)
    return guess.bottom_m == 0.0 or any(top.is_near(at) for top in near)


def as_exact_as_its_carrier(fit: Fit, tops: Iterable[Top]) -> Fit:
    """Without depth, add the spread of the support's height to that of a fit's place."""
    if fit.spread_m is None or fit.guess.bottom_m == 0.0:
        return fit
    beneath = [top.fit.spread_m or 0.0 for top in tops if abs(top.height_m - fit.guess.bottom_m) < EQUAL_M]
    return replace(fit, spread_m=math.hypot(fit.spread_m, min(beneath, default=0.0)))


def heights_under(points: Array, tops: Iterable[Top]) -> list[float]:
    """Return heights of floor, tops and boards that points (N, 3) may stand on, the nearest first."""
    if not len(points):
        return []
    low = float(np.percentile(points[:, 2], 5.0))
    at = np.median(points[:, :2], axis=0)
    heights = [0.0] if low < _ON_FLOOR_M else []
    heights += [top.height_m for top in tops if abs(top.height_m - low) < _HEIGHT_M and top.is_near(at)]
    return sorted({round(height, 4) for height in heights}, key=lambda height: abs(height - low))[:_MOST]


def level_heights(points: Array) -> list[float]:
    """Return heights of level surfaces, at which many of some points (N, 3) lie, the most frequent first."""
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


def heights_behind(
    observation: Observation, detection: Detection, tops: Sequence[Top], given_support: Fit | None
) -> list[float]:
    """Return heights of tops, boards and floor that are visible where a box ends, the nearest to the camera first.

    Args:
        observation: The picture, without depth.
        detection: The detection.
        tops: All tops.
        given_support: The support that the detection names, if any.
    """
    if detection.on == FLOOR:
        return [0.0]
    found = []
    for top in tops:
        foot = foot_of(observation, detection.box_px, top.height_m)
        if foot is not None and (given_support is None or top.fit is given_support):
            distance_m = max(top.distance_m(foot), _REACH_M)
            found.append((distance_m, float(np.hypot(*foot)), round(top.height_m, 4)))
    # A top hides the floor behind it. A misjudged one may end before the objects on it.
    on = [height for distance_m, _, height in sorted(found) if distance_m <= _REACH_M]
    near = [
        height for distance_m, _, height in sorted(found)[:1] if distance_m < _MISJUDGED_M or given_support is not None
    ]
    if detection.category in CARRIED and not near:
        # A microwave is not on the floor, and units of a kitchen are of one height.
        near = [round(top.height_m, 4) for top in tops if top.fit.guess.entry.category in UNITS and top.is_uppermost]
    return on[:_MOST] or near[:_MOST] or [0.0]


_AS_FITTED_M = 0.05  # Tolerance of the pixels of a rough fit.

RenderedDepth = tuple[Array, NDArray[np.int32]]
"""(H, W) depth of an object, infinite outside it, and the number of its visible face, from 0."""


@dataclass
class Layers:
    """Rendered depth of everything known.

    Attributes:
        observation: The picture.
        walls: The walls.
        rendered: Depth and faces by object.
    """

    observation: Observation
    walls: tuple[Wall, ...]
    rendered: dict[int, RenderedDepth] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._empty = depth_of_empty(self.observation, self.walls)

    def look_for_walls(self, left: Sequence[Detection]) -> None:
        """Search for walls inside boxes too, now that the pixels of objects are known.

        Args:
            left: Detections that are not fitted yet.
        """
        depth_m, face = self.together()
        fitted = (face > len(self.walls)) & (
            np.abs(self.observation.z_m - depth_m) < _AS_FITTED_M + 3 * self.observation.depth_distortion_m
        )
        self.walls = find_walls_again(self.walls, self.observation, left, fitted)
        self._empty = depth_of_empty(self.observation, self.walls)

    def visible(self) -> dict[int, NDArray[np.bool_]]:
        """Return by object (H, W) where it is visible: nearest of all, and nothing nearer was measured there."""
        nearest, owner = self._empty[0].copy(), np.full(self.observation.z_m.shape, -1)
        for index, (own_m, _) in self.rendered.items():
            nearer = own_m < nearest
            nearest[nearer], owner[nearer] = own_m[nearer], index
        owner[is_hidden(self.observation, nearest)] = -1
        return {index: owner == index for index in self.rendered}

    def together(self, besides: int | None = None) -> RenderedDepth:
        """Return depth and face index of the scene without one object: 0 the floor, then walls, then objects."""
        depth, face = self._empty[0].copy(), self._empty[1].copy()
        first = 1 + len(self.walls)
        for index, (own_m, own_face) in self.rendered.items():
            if index == besides:
                continue
            nearer = own_m < depth
            shown = own_face[nearer]
            depth[nearer], face[nearer] = own_m[nearer], first + shown
            first += int(shown.max(initial=-1)) + 1
        return depth, face


UNLIKELY, IMPOSSIBLE = 10.0, 30.0
"""Prior cost of a fit in a wall, in others, or with a blocked front, and hardly of a correct one; and of a fit
wholly in something: its label is wrong."""

_AROUND = 0.2  # Margin around a box, as a share of its sides, in which its support is searched.
_DOUBTFUL, _DOUBTFUL_BENT = 0.75, 0.4  # Correct labels explain nine tenths and more, and less with distorted depth.
_LEAST_VISIBLE_PX = 40  # Half of the smallest segment: size and heading of such an object are unknown.
MAX_OUTLINE_MISFIT, _UNLIKE = 15.0, 50.0
"""Without depth, largest costs of outline and fit with a correct label."""

LEAST_IN_BOX = 0.3
"""IoU of a box with the box around its fit's visible part: with less, the fit is of something else, or elsewhere."""

_MAX_SMALL_OUTLINE_MISFIT = 5.0  # Where a box is of few pixels, half of it costs no more than 10.


class RoomEstimate:
    """The current estimate of a room: the fits, with depth and face of each in every pixel.

    Attributes:
        observation: The picture; its depth may be corrected on the way.
        detections: The boxes, followed by the objects found without one.
        boxed: Number of given boxes.
        fits: index of a detection -> its fit.
        reasons: index -> why it has no fit.
        scale_share: Relative uncertainty of the picture's scale, without depth.
    """

    def __init__(
        self, observation: Observation, walls: tuple[Wall, ...], detections: Sequence[Detection], scale_share: float
    ) -> None:
        self.observation, self.detections, self.scale_share = observation, list(detections), scale_share
        self.boxed = len(self.detections)
        self.fits: dict[int, Fit] = {}
        self.reasons: dict[int, str] = {}
        self._layers = Layers(observation, walls)
        self._rgb_first = replace(observation, prefer_rgb=True)

    @property
    def walls(self) -> tuple[Wall, ...]:
        """The walls that bound the room, in the level frame."""
        return self._layers.walls

    @property
    def depth_m(self) -> Array:
        """(H, W) depth of everything known."""
        return self._layers.together()[0]

    def add_fit(self, index: int, found: Fit | None) -> str:
        """Add a fit; return a sentence about it, or why there is none."""
        name = self.detections[index].label or "thing"
        if found is None:
            return f"{name}: {self.reasons[index]}"
        self.fits[index], self._layers.rendered[index] = found, picture_of(found.guess, self.observation)
        return f"{name}: {found.guess.entry.model}"

    def remove_fit(self, index: int) -> Fit | None:
        """Remove an object from the room, and return its fit, if any."""
        self._layers.rendered.pop(index, None)
        return self.fits.pop(index, None)

    def look_for_walls(self) -> None:
        """Search for walls inside boxes too, now that the pixels of objects are known."""
        self._layers.look_for_walls([one for index, one in enumerate(self.detections) if index not in self.fits])

    def correct_distortion(self) -> None:
        """Correct distorted depth by everything known, as by the floor before."""
        if not self.observation.depth_distortion:
            return
        unboxed = self.observation.measured & ~self._in_boxes(range(len(self.detections)))
        self.observation = replace(
            self.observation, z_m=correct_depth(self.observation.z_m, np.where(unboxed, self.depth_m, np.inf))
        )
        self._rgb_first = replace(self.observation, prefer_rgb=True)

    def drop_contained_fits(self) -> None:
        """Drop unboxed fits contained in another fit, which were fitted better since.

        Of two items in one place one is the remainder of the other from before its better fit.
        """
        alone = [index for index in self.fits if index >= self.boxed]
        for index in sorted(alone, key=lambda index: self.detections[index].area_px):
            guess = self.fits[index].guess
            others = (fit.guess for other, fit in self.fits.items() if other != index)
            is_odd = is_large(guess.entry) and self.unlikeliness(index) > IMPOSSIBLE
            is_left = stands_in(guess, self.neighbouring_pieces(index)) or (
                is_odd and not self._carries_what_is_boxed(index)
            )
            if is_left or any(is_same_place(guess, other) for other in others):
                self.remove_fit(index)
                self.reasons[index] = "what is left of other things, in which it would stand"

    def in_boxes(self) -> dict[int, float]:
        """Return the IoU of each box with the box around the visible part of its fit, 0 to 1.

        Visible means in the picture and hidden by no other fit, nor by anything nearer that was measured.
        """
        shown = {}
        for index, visible in self._layers.visible().items():
            box_px = self.detections[index].box_px
            shown[index] = overlap(box_of(visible), box_px) if visible.any() else 0.0
        return shown

    def drop_fits_outside_their_box(self) -> None:
        """Drop fits of which too little is visible in their given boxes, the worst one first.

        Parts that it hid become visible then.
        """
        while shown := {index: share for index, share in self.in_boxes().items() if index < self.boxed}:
            worst = min(shown, key=lambda index: shown[index])
            share = shown[worst]
            if share >= LEAST_IN_BOX:
                return
            model = self.fits[worst].guess.entry.model
            self.remove_fit(worst)
            problem = (
                f"the best fit ({model}) is not in its box: what is visible of it has an IoU of {share:.2f} with it"
            )
            self.reasons[worst] = f"{problem}, and {LEAST_IN_BOX:g} is the least"

    def _carries_what_is_boxed(self, index: int) -> bool:
        """Return whether a boxed object stands on it: then it exists, however odd."""
        raised = (fit.guess for other, fit in self.fits.items() if other < self.boxed and fit.guess.bottom_m > 0.0)
        tops = list(tops_of([self.fits[index]]))
        return any(is_on_one(guess, tops) for guess in raised)

    def is_doubtful(self, index: int) -> bool:
        """Return whether a label may be wrong.

        With depth: its category explains too little, violates free space, or is in other objects; with distorted depth
        it may explain less if it looks right. Without depth: it does not fill its box, or looks different.
        """
        if index not in self.fits:
            return True
        found = self.fits[index]
        if not self.observation.has_depth:
            # Carried objects are as inexact as their support; assumed ones are invisible.
            is_carried = self.detections[index].category in CARRIED and found.guess.bottom_m > 0.0
            is_unverifiable = is_carried or bool(found.assumed)
            return not is_unverifiable and _is_unlike(found)
        # Distorted depth may err by more than a small object's size: it may be right if it looks right.
        least = _DOUBTFUL if self.observation.is_exact or _is_unlike(found) else _DOUBTFUL_BENT
        return found.explained < least or self.fit_violates_free_space(index) or self.is_impossible(index)

    def is_impossible(self, index: int) -> bool:
        """Return whether an object would intersect others; of two, the one that explains less."""
        found = self.fits.get(index)
        if found is None:
            return False
        others = [other for other, fit in self.fits.items() if other != index and fit.explained >= found.explained]
        return prior_cost(found.guess, self._near(others)) > IMPOSSIBLE

    def doubt(self, index: int) -> float:
        """Return how doubtful a fit is, to compare two: its unexplained share, or its prior cost."""
        found = self.fits.get(index)
        return self.unlikeliness(index) if found is None or not self.observation.has_depth else 1.0 - found.explained

    def unlikeliness(self, index: int) -> float:
        """Return the prior cost of a fit among everything known now."""
        found = self.fits.get(index)
        return 0.0 if found is None else prior_cost(found.guess, self._near(self._besides(index)))

    def is_in_air(self, index: int) -> bool:
        """Return whether the support of an object has been fitted differently since.

        In a monocular picture, a slightly higher top moves everything on it.
        """
        found = self.fits.get(index)
        return found is not None and not self._is_on_one(found.guess)

    def on_nothing_but(self, index: int) -> list[int]:
        """Return raised objects that stand on this one alone, or on nothing."""
        tops = list(tops_of(self.fits[other] for other in self._besides(index)))
        raised = (other for other in self._besides(index) if self.fits[other].guess.bottom_m > 0.0)
        return [other for other in raised if not is_on_one(self.fits[other].guess, tops, EQUAL_M)]

    def hangs_in_air(self, guess: PoseHypothesis) -> bool:
        """Return whether furniture would stand on nothing: in one picture, smaller and nearer looks alike."""
        is_raised = guess.bottom_m > 0.0 and is_large(guess.entry)
        return is_raised and not self._is_on_one(guess)

    def is_doubtful_in_air(self, found: Fit) -> bool:
        """Return whether a fit stands on nothing known, and explains too little to wait for a support."""
        return found.explained < _DOUBTFUL and not self._is_on_one(found.guess)

    def _is_on_one(self, guess: PoseHypothesis) -> bool:
        within_m = SAME_M if self.observation.is_exact else EQUAL_M
        return is_on_one(guess, tops_of(self.fits.values()), within_m)

    def is_on_nothing(self, found: Fit) -> bool:
        """Return whether, without depth, an item is on the floor only because no support was found.

        It would be too large there, or looks different.
        """
        guess = found.guess
        if self.observation.has_depth or guess.bottom_m > 0.0 or is_large(guess.entry):
            return False
        return is_oversized(guess) or _is_unlike(found) or found.outline_misfit > _MAX_SMALL_OUTLINE_MISFIT

    def fit_violates_free_space(self, index: int) -> bool:
        """Return whether something farther is measured through a fit."""
        return self._claim_of(index).violates_free_space

    def claimed_px(self, index: int) -> tuple[float, float, float, float] | None:
        """Return the box of the visible part of a fit, None if there is none."""
        return self._claim_of(index).box_px

    def is_there(self, index: int, found: Fit, around: SearchContext) -> bool:
        """Return whether an unlabelled fit is visible wherever it should be, and fills its box.

        Without depth, it is enough that it stands in nothing else.
        """
        if not self.observation.has_depth:
            return not stands_in(found.guess, around.near.pieces)
        claim = self.claim(found.guess, around)
        if index < self.boxed:
            is_it = claim.fills(self.detections[index].box_px)
        else:
            # The remainder of a misjudged object is explained by another one in it.
            is_it = not stands_in(found.guess, around.near.pieces)
        return is_it and claim.is_borne_out(_LEAST_VISIBLE_PX, boxed=index < self.boxed)

    def claim(self, guess: PoseHypothesis, around: SearchContext) -> VisibilityCheck:
        """Check a hypothesis against the pixels of the picture."""
        return VisibilityCheck.of(
            self.observation, picture_of(guess, self.observation)[0], around.other_m, guess.corners_m()
        )

    def around(self, index: int, hidden_by: Iterable[int] = (), *, by_depth: bool = False) -> SearchContext:
        """Return the context of a search for an object that was removed.

        Args:
            index: Which one.
            hidden_by: Detections that may be in front of it, if their boxes are smaller.
            by_depth: Whether depth determines its place though it is inexact, and the picture would be better evidence.
        """
        own = self.detections[index]
        # Unboxed objects are no part of boxed ones.
        most_px = own.area_px if index < self.boxed else math.inf
        smaller = (one for one in hidden_by if one != index and self.detections[one].area_px < most_px)
        foreign = self._in_boxes(smaller)
        observation = self.observation if by_depth or self.observation.is_exact else self._rgb_first
        return SearchContext(
            observation, *self._layers.together(), foreign, self._near(self.fits), self.scale_share, own.mask
        )

    def points(self, detection: Detection, around: SearchContext) -> Array | None:
        """Return (N, 3) that are most likely an object's own; None without depth."""
        if not self.observation.has_depth:
            return None
        if detection.mask is not None:
            return np.asarray(self.observation.points_m[detection.mask & self.observation.measured])
        return points_of(self.observation, detection.box_px, around.other_m, around.smaller)

    def heights_m(self, detection: Detection, points: Array | None) -> list[float]:
        """Return heights that an object may stand on: below its points, or without depth behind its box's end."""
        tops = list(tops_of(self.fits.values()))
        if points is not None:
            of_box = self.observation.points_m[detection.pixels(self.observation.size_px) & self.observation.measured]
            under = heights_under(points if len(points) >= LEAST_POINTS else of_box, tops)
            if detection.category not in CARRIED or any(under) or not self.observation.is_exact:
                return under
            # An unboxed support is found once this object is known.
            around = replace(detection, box_px=_widened(detection.box_px), mask=None).pixels(self.observation.size_px)
            return level_heights(self.observation.points_m[around & self.observation.measured])
        given_support = None if detection.on is None else self.fits.get(detection.on)
        return heights_behind(self.observation, detection, tops, given_support)

    def neighbouring_pieces(self, index: int) -> tuple[PoseHypothesis, ...]:
        """Return the other furniture."""
        return self._near(self._besides(index)).pieces

    def _besides(self, index: int) -> list[int]:
        return [other for other in self.fits if other != index]

    def _near(self, indices: Iterable[int]) -> Neighbourhood:
        guesses = [self.fits[index].guess for index in indices]
        pieces = (one for one in guesses if kind_of(one.entry.category, one.size_m[1]) is not Kind.ITEM)
        standing = tuple(one for one in pieces if one.bottom_m == 0.0)
        return Neighbourhood(
            self.walls, standing, self.observation.heading_rad, without_depth=not self.observation.has_depth
        )

    def _claim_of(self, index: int) -> VisibilityCheck:
        """Check a fit against the picture, among everything else known."""
        (own_m, _), (others_m, _) = self._layers.rendered[index], self._layers.together(besides=index)
        return VisibilityCheck.of(self.observation, own_m, others_m, self.fits[index].guess.corners_m())

    def _in_boxes(self, indices: Iterable[int]) -> NDArray[np.bool_]:
        """Return (H, W) pixels in boxes of those detections that have no fit yet."""
        mask = np.zeros(self.observation.z_m.shape, dtype=bool)
        for index in indices:
            if index not in self.fits:
                mask |= self.detections[index].pixels(self.observation.size_px)
        return mask


def _is_unlike(found: Fit) -> bool:
    """Return whether, without depth, a fit does not fill its box, or looks different."""
    return found.outline_misfit > MAX_OUTLINE_MISFIT or found.cost > _UNLIKE


def _widened(box_px: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Enlarge a box by a part of its surroundings, such as the top that its object stands on."""
    x0, y0, x1, y1 = box_px
    over_x, over_y = _AROUND * (x1 - x0), _AROUND * (y1 - y0)
    return max(0.0, x0 - over_x), max(0.0, y0 - over_y), x1 + over_x, y1 + over_y
