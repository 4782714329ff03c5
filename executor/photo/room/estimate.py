"""The current estimate of a room: its fits, their rendered depth, and the supports that things may stand on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from executor.assets.footprint import region_frame
from executor.assets.library import LIBRARY, asset_for
from executor.geometry import Array
from executor.photo.errors import LostCause
from executor.photo.fitting.evidence import colour_name
from executor.photo.fitting.hypothesis import PoseHypothesis, picture_of
from executor.photo.fitting.likelihood import NO_FEET, Fit, Neighbourhood, SearchContext, usual_size_m
from executor.photo.fitting.starts import LEAST_POINTS, named_models, points_of, stands_on_floor
from executor.photo.geometry.observation import Observation, is_hidden
from executor.photo.geometry.residuals import box_of
from executor.photo.geometry.walls import Wall, depth_of_empty, find_walls_again
from executor.photo.inputs.annotations import FLOOR, Detection, plain_name
from executor.photo.inputs.usual import carries, hung_depth_m, is_inset
from llm.vision import overlap
from oag.model.symbols import Kind, has_boards, is_known, kind_of

SAME_M = 0.02
"""Between the height of a top and of an object on it, after the top has moved since."""

NEAR_TOP_M = 0.13
"""Between an object's visible bottom and its possible support."""

_REACH_M = 0.06  # Over the edge of a top, as far as things may seem to stand.
_MOST = 3
_ON_FLOOR_M = 0.15
_LEAST_OF_USUAL = 0.25  # Least share of the usual longest side of furniture that is partly hidden.
_AS_FITTED_M = 0.05  # Tolerance of the pixels of a rough fit.
_LOOKED_AT_PX = 2000  # Of what is visible of a thing, to tell its colours.
_FLAT, _INTO = 0.25, 0.06  # Height of a flat item by its shorter side; share of its box, below its far edge.
_MARGIN_SHARE, _MARGIN_PX = (
    0.15,
    2.0,
)  # Of an item's sides, and beyond that: so near to it ends the box of what is on it.
_LEAST_SHOWN = 0.2  # Of its box: a fit that shows less there is of something else.


@dataclass(frozen=True)
class Top:
    """A top, board or hollow: what has it, its frame (4, 4), and half its sides (2,)."""

    of: PoseHypothesis
    T: Array
    half_m: Array

    @property
    def height_m(self) -> float:
        """Above the floor."""
        return float(self.T[2, 3])

    def is_near(self, at: Array) -> bool:
        """Return whether a place (2,) is over it, or hardly outside if it is furniture's."""
        return bool((self._over_m(at) < (0.0 if is_item(self.of) else _REACH_M)).all())

    def distance_m(self, at: Array) -> float:
        """Return the distance of a place (2,) from it [m], 0 over it."""
        return float(np.linalg.norm(np.maximum(self._over_m(at), 0.0)))

    def _over_m(self, at: Array) -> Array:
        local = np.linalg.inv(self.T) @ [*at, self.height_m, 1.0]
        return np.asarray(np.abs(local[:2]) - self.half_m)


def is_item(guess: PoseHypothesis) -> bool:
    """Return whether a hypothesis is of an item, and not of furniture."""
    return not guess.fixed and kind_of(guess.entry.category, min(guess.size_m[:2])) is Kind.ITEM


def is_furniture(detection: Detection) -> bool:
    """Return whether a detection is furniture by its name, whatever its size is."""
    names = (detection.category or "", plain_name(detection.label) or "")
    return any(is_known(name) and kind_of(name, 0.0) is not Kind.ITEM for name in names)


def is_piece(thing: Detection) -> bool:
    """Return whether a thing is furniture by the noun of its name: a desk divider is none, nor a sink in a counter."""
    if is_inset(thing.label):
        return False
    noun = (plain_name(thing.label) or "").split("_")[-1]
    return is_furniture(thing) and (is_known(noun) or thing.category in {entry.category for entry in LIBRARY.values()})


def tops_of(guesses: Iterable[PoseHypothesis]) -> Iterator[Top]:
    """Yield the tops, boards and hollows of some hypotheses; what is over an item is on it, whatever its edge is."""
    for guess in guesses:
        carrier = guess.as_object()
        for region in asset_for(carrier).regions:
            T, half_m = region_frame(carrier, region)
            yield Top(guess, T, np.divide(guess.size_m[:2], 2) if is_item(guess) else half_m)


def is_on_one(guess: PoseHypothesis, tops: Iterable[Top], within_m: float = SAME_M) -> bool:
    """Return whether a hypothesis stands on the floor, or within a tolerance on one of some tops."""
    at = np.array([guess.x_m, guess.y_m])
    near = (top for top in tops if abs(top.height_m - guess.bottom_m) < within_m)
    return guess.bottom_m == 0.0 or any(top.is_near(at) for top in near)


def heights_under(points: Array, tops: Iterable[Top], foot_m: Array | None = None) -> list[float]:
    """Return heights of floor, tops and boards that points (N, 3) may stand on, the nearest first.

    Where nothing known is below them it is their own lower end: what stands there has no box.

    Args:
        points: Of the thing.
        tops: What it may stand on.
        foot_m: (3,) where its box ends, as far as that is measured.
    """
    low = float(np.percentile(points[:, 2], 5.0))
    at = np.median(points[:, :2], axis=0)
    ends = [at] if foot_m is None else [at, foot_m[:2]]
    level = [top for top in tops if abs(top.height_m - low) < NEAR_TOP_M]
    under = [top for top in level if any(top.is_near(end) for end in ends)]
    heights = [0.0, *(top.height_m for top in under)] if low < _ON_FLOOR_M else [top.height_m for top in under]
    # What is over an item, or a board on a top, is in it or on it, and not below.
    loose = [top for top in under if is_item(top.of) or top.of.bottom_m > 0.0]
    least_m = max((top.height_m for top in loose if top.distance_m(at) == 0.0), default=0.0)
    heights = [height for height in heights if height >= least_m]
    near = sorted({round(height, 4) for height in heights}, key=lambda height: abs(height - low))
    return near[:_MOST] or [round(low, 4)]


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
        off_m = np.abs(self.observation.z_m - depth_m)
        fitted = (face > len(self.walls)) & (off_m < _AS_FITTED_M + 3 * self.observation.depth_distortion_m)
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


class RoomEstimate:
    """The current estimate of a room: the fits, with depth and face of each in every pixel.

    Attributes:
        observation: The picture.
        detections: The boxes.
        fits: index of a detection -> its fit.
        lost: index -> why it has no fit.
        on: index -> what carries it, where boxes and names decide that.
        scale_share: Relative uncertainty of the picture's scale, without depth.
        feet_m: index of furniture -> (N, 3) where things on it touch its top, where they hide that.
        apparent_on: With depth, the apparent support of each box in the picture: another one, FLOOR or WALL.
        boards_m: index of a piece with boards -> index of each thing on it -> the height of its board, where it ends.
    """

    def __init__(
        self,
        observation: Observation,
        walls: tuple[Wall, ...],
        detections: Sequence[Detection],
        scale_share: float,
        feet_m: Mapping[int, Array] = MappingProxyType({}),
        apparent_on: Sequence[int] = (),
        boards_m: Mapping[int, Mapping[int, float]] = MappingProxyType({}),
    ) -> None:
        self.observation, self.detections, self.scale_share = observation, tuple(detections), scale_share
        self.feet_m, self.apparent_on, self.boards_m = feet_m, apparent_on, boards_m
        self.fits: dict[int, Fit] = {}
        self.lost: dict[int, LostCause] = {}
        self.on: dict[int, int] = {}
        self._layers = Layers(observation, walls)

    @property
    def walls(self) -> tuple[Wall, ...]:
        """The walls that bound the room, in the level frame."""
        return self._layers.walls

    def add_fit(self, index: int, found: Fit | None) -> str:
        """Add a fit; return a sentence about it, or why there is none."""
        name = self.detections[index].label or "thing"
        if found is None:
            return f"{name}: {self.lost[index].value}"
        self.fits[index], self._layers.rendered[index] = found, picture_of(found.guess, self.observation)
        return f"{name}: {found.guess.entry.model}"

    def remove_fit(self, index: int) -> Fit | None:
        """Remove an object from the room, and return its fit, if any."""
        self._layers.rendered.pop(index, None)
        return self.fits.pop(index, None)

    def look_for_walls(self) -> None:
        """Search for walls inside boxes too, now that the pixels of objects are known."""
        self._layers.look_for_walls([one for index, one in enumerate(self.detections) if index not in self.fits])

    def in_box(self, index: int) -> float:
        """Return the IoU of a box with the box around the visible part of its fit, 0 to 1.

        Visible means in the picture and hidden by no other fit, nor by anything nearer that was measured.
        """
        visible = self._layers.visible()[index]
        return overlap(box_of(visible), self.detections[index].box_px) if visible.any() else 0.0

    def colours(self, index: int) -> dict[str, float]:
        """Return the share of each colour's name in the visible part of an object within its box, else in its box."""
        boxed = self.detections[index].pixels(self.observation.size_px)
        shown = self._layers.visible()[index] & boxed
        pixels = self.observation.rgb[shown if shown.sum() > _LEAST_SHOWN * boxed.sum() else boxed]
        some = pixels[:: len(pixels) // _LOOKED_AT_PX + 1].tolist()
        names = Counter(colour_name((red, green, blue)) for red, green, blue in some)
        return {name: count / max(len(some), 1) for name, count in names.items()}

    def is_on_floor(self, index: int) -> bool:
        """Return whether an object is furniture that stands on the floor, by its name, a given support and its depth.

        What is measured to be far smaller than any such furniture is something else, whatever it is called.
        """
        detection = self.detections[index]
        if detection.on not in (None, FLOOR) or not (is_piece(detection) and stands_on_floor(detection)):
            return False
        own = self.observation.z_m[detection.pixels(self.observation.size_px) & self.observation.measured]
        x0, y0, x1, y1 = detection.box_px
        width, height = self.observation.size_px
        is_cut = x0 < 1.0 or y0 < 1.0 or x1 > width - 1.0 or y1 > height - 1.0
        usual_m = [max(usual_size_m(entry)) for entry in named_models(detection) if entry.model in LIBRARY]
        if detection.on == FLOOR or is_cut or len(own) < LEAST_POINTS or not usual_m:
            return True
        side_m = max(x1 - x0, y1 - y0) / self.observation.K.fx * float(np.median(own))
        return side_m > _LEAST_OF_USUAL * min(usual_m)

    def around(self, index: int, hidden_by: Iterable[int] = ()) -> SearchContext:
        """Return the context of a search for an object that was removed.

        Args:
            index: Which one.
            hidden_by: Detections that may be in front of it, if their boxes are smaller.
        """
        own = self.detections[index]
        smaller = (one for one in hidden_by if one != index and self.detections[one].area_px < own.area_px)
        foreign = self._in_boxes(smaller)
        return SearchContext(
            self.observation,
            *self._layers.together(),
            foreign,
            self._near(),
            self.scale_share,
            own.mask,
            self._shows_boards(index),
            self.feet_m.get(index, NO_FEET),
        )

    def _shows_boards(self, index: int) -> bool:
        """Return whether things end in the box of a piece with boards, which then shows its open side.

        They are neither furniture nor usually on walls.
        """
        own = self.detections[index]
        category = own.category or plain_name(own.label) or ""
        if not has_boards(category) or not (self.is_on_floor(index) or carries(own.label)):
            return False
        left, top, right, bottom = own.box_px
        for other, thing in enumerate(self.detections):
            (x0, _, x1, y1), is_given = thing.box_px, thing.on is not None and thing.on != index
            ends_in_it = left < (x0 + x1) / 2 < right and top < y1 < bottom
            small = thing.area_px < own.area_px and not self.is_on_floor(other)
            if ends_in_it and small and not is_given and hung_depth_m(thing.label) is None:
                return True
        return False

    def points(self, detection: Detection, around: SearchContext) -> Array:
        """Return (N, 3) that are most likely an object's own."""
        if detection.mask is not None:
            return np.asarray(self.observation.points_m[detection.mask & self.observation.measured])
        return points_of(self.observation, detection.box_px, around.other_m, around.smaller)

    def heights_m(self, detection: Detection, points: Array) -> list[float]:
        """Return heights that an object may stand on: below its points, or below those of its box; none without these.

        Args:
            detection: The detection.
            points: (N, 3) its own.
        """
        if detection.on == FLOOR:
            return [0.0]
        on = self.on.get(self._index_of(detection)) if detection.on is None else detection.on
        support = None if on is None else self.fits.get(on)
        tops = list(tops_of(fit.guess for index, fit in self.fits.items() if self._ends_on(detection, index)))
        if len(points) < LEAST_POINTS:
            points = self.observation.points_m[detection.pixels(self.observation.size_px) & self.observation.measured]
        if len(points) >= LEAST_POINTS:
            # Where a person, a model or boards that are measured say what it stands on, only its tops count.
            low_m = float(np.percentile(points[:, 2], 5.0))
            given = [top.height_m for top in tops if support is not None and top.of is support.guess]
            if given:
                return [min(given, key=lambda one: abs(one - low_m))]
            found = heights_under(points, tops, self.observation.foot_m(detection.box_px))
            is_known = found[0] == 0.0 or any(round(top.height_m, 4) == found[0] for top in tops)
            if not is_known and (visible_m := self.top_below_m(detection, low_m)) is not None:
                return [visible_m]
            # Noise and what is behind it reach below a thing whose middle is over a piece of furniture.
            middle = np.median(points, axis=0)
            over = (top for top in tops if not is_item(top.of) and top.distance_m(middle[:2]) == 0.0)
            below = [round(top.height_m, 4) for top in over if low_m < top.height_m < middle[2]]
            return found if is_known or not below else [max(below)]
        return []

    def top_below_m(self, detection: Detection, low_m: float) -> float | None:
        """Return the height of the furniture's top on which a box seems to end, if the thing ends at that height too.

        What hangs over the edge of a bench is beside its top, and its depth is that of its front.

        Args:
            detection: The thing.
            low_m: The height of its lower end.
        """
        index = self._index_of(detection)
        below = self.apparent_on[index] if 0 <= index < len(self.apparent_on) else FLOOR
        if below not in self.fits or not is_piece(self.detections[below]):
            return None
        tops = [round(top.height_m, 4) for top in tops_of([self.fits[below].guess])]
        near = [height for height in tops if abs(height - low_m) < NEAR_TOP_M]
        return min(near, key=lambda height: abs(height - low_m), default=None)

    def _index_of(self, detection: Detection) -> int:
        return next((one for one, other in enumerate(self.detections) if other is detection), -1)

    def _ends_on(self, detection: Detection, index: int) -> bool:
        """Return whether a box ends where another thing is in the picture; furniture may be hidden below it."""
        other, size_m = self.detections[index], self.fits[index].guess.size_m
        (x0, _, x1, y1), (left, top, right, bottom) = detection.box_px, other.box_px
        aside, down = (_MARGIN_SHARE * side + _MARGIN_PX for side in (right - left, bottom - top))
        # What ends at the far edge of a mat is behind it.
        first = top + _INTO * (bottom - top) if size_m[2] < _FLAT * min(size_m[:2]) else top - down
        ends_in_it = left - aside < (x0 + x1) / 2 < right + aside and first < y1 < bottom + down
        return is_piece(other) or ends_in_it or detection.on == index

    def _near(self) -> Neighbourhood:
        guesses = (fit.guess for fit in self.fits.values())
        standing = tuple(one for one in guesses if not is_item(one) and one.bottom_m == 0.0)
        return Neighbourhood(self.walls, standing, self.observation.heading_rad)

    def _in_boxes(self, indices: Iterable[int]) -> NDArray[np.bool_]:
        """Return (H, W) pixels in boxes of those detections that have no fit yet."""
        mask = np.zeros(self.observation.z_m.shape, dtype=bool)
        for index in indices:
            if index not in self.fits:
                mask |= self.detections[index].pixels(self.observation.size_px)
        return mask
