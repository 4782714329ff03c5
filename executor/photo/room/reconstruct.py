"""Fit the whole room: furniture one by one, again among all others, then the items on it.

Two objects that are each fitted to pixels of the other are fitted together. Without exact depth, an object that stands
on nothing known is evidence of a support below it.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_fill_holes

from executor.assets.library import LIBRARY
from executor.photo.fitting.evidence import of_one_hue
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.likelihood import CARRIED, Fit
from executor.photo.fitting.starts import stands_on_floor
from executor.photo.geometry.observation import Observation
from executor.photo.geometry.residuals import are_alike, box_of
from executor.photo.geometry.walls import Wall
from executor.photo.inputs.annotations import Detection
from executor.photo.room.estimate import RoomEstimate
from executor.photo.room.fitter import RIGHT, RoomFitter
from llm.vision import overlap

OF_ONE_HUE = "of one hue under what has a box"
"""Source of supports without a given box."""

_TOPS = ("table", "coffee_table", "desk", "desk_with_drawers", "nightstand", "shelf", "bottom_cabinet", "countertop")
"""Categories of supports."""

_FOOT_PX = 3  # Below a box's end, where its foot may be.


def refit_pairs(fitter: RoomFitter, standing: Sequence[int], on_progress: Callable[[str], None]) -> None:
    """Fit two objects again, the first one as if nothing were known of the other; keep both if they cost less so.

    Candidates are pairs that explain too little of their boxes and have pixels in common.

    Args:
        fitter: Of the room.
        standing: Numbers of furniture, the largest boxes first.
        on_progress: Called for each object.
    """
    room = fitter.room
    for index, other in itertools.combinations(standing, 2):
        if not {index, other} <= room.fits.keys() or max(room.fits[one].explained for one in (index, other)) > RIGHT:
            continue
        if overlap(room.detections[index].box_px, room.detections[other].box_px) == 0.0:
            continue
        with _cheaper_only(fitter, (index, other)):
            room.remove_fit(index)
            room.remove_fit(other)
            on_progress(fitter.fit(index, [0.0], hidden_by=(other,)))
            on_progress(fitter.fit(other, [0.0], hidden_by=()))


def find_carriers(fitter: RoomFitter, on_progress: Callable[[str], None]) -> None:
    """Without exact depth, fit supports of objects that stand on nothing known, from regions of one hue around them.

    Then those objects are fitted on the support, and everything else visible on it.
    """
    room, carriers = fitter.room, [entry for entry in LIBRARY.values() if entry.category in _TOPS]
    tried: list[NDArray[np.bool_]] = []
    for index in sorted(fitter.on_nothing, key=lambda one: -room.detections[one].area_px):
        piece = of_one_hue(room.observation.rgb, room.detections[index].box_px) if index not in room.fits else None
        if piece is None or any(are_alike(piece, other) for other in tried):
            continue
        tried.append(piece)
        room.detections.append(Detection("", None, box_of(piece), 0.0, OF_ONE_HUE, provenance="search"))
        carrier = len(room.detections) - 1
        on_progress(fitter.fit_anything(carrier, entries=carriers))
        if carrier not in room.fits:
            continue
        on_progress(fitter.refine_fully(carrier))
        around = binary_fill_holes(piece)
        for other, detection in enumerate(room.detections[: room.boxed]):
            if not stands_on_floor(detection) and _has_foot_in(detection, around):
                on_progress(fitter.fit(other, None, hidden_by=()))


@contextmanager
def _cheaper_only(fitter: RoomFitter, indices: Sequence[int]) -> Iterator[None]:
    """Restore fits after a block that has not made them cheaper, all of them together."""
    before = {index: fitter.room.fits[index] for index in indices}
    cost = sum(map(fitter.cost, indices))
    yield
    if not sum(map(fitter.cost, indices)) < cost:
        for index, fit in before.items():
            fitter.room.add_fit(index, fit)


def _has_foot_in(detection: Detection, piece: NDArray[np.bool_]) -> bool:
    """Return whether a box ends in a segment (H, W) of the picture."""
    x0, _, x1, y1 = detection.box_px
    height, width = piece.shape
    column = min(width - 1, round((x0 + x1) / 2))
    return bool(piece[min(height - 1, max(0, round(y1) - 1)) : round(y1) + _FOOT_PX, column].any())


@dataclass(frozen=True)
class FittedThing:
    """One object of the reconstruction.

    Attributes:
        id: Its id in the scene.
        detection: Its detection.
        fit: Its fit.
        boxed: Whether its box was given.
    """

    id: str
    detection: Detection
    fit: Fit
    boxed: bool = True


@dataclass(frozen=True)
class Unfitted:
    """A detection without a fit, and why."""

    detection: Detection
    reason: str


@dataclass(frozen=True)
class FittedRoom:
    """The fitted room of a picture.

    Attributes:
        things: In the order of their boxes.
        unfitted: Detections that were left out.
        walls: The walls.
    """

    things: tuple[FittedThing, ...]
    unfitted: tuple[Unfitted, ...]
    walls: tuple[Wall, ...]

    @property
    def guesses(self) -> dict[str, PoseHypothesis]:
        """id -> pose hypothesis."""
        return {thing.id: thing.fit.guess for thing in self.things}

    def without(self, thing: FittedThing, reason: str) -> FittedRoom:
        """Remove one object from the room, with a reason."""
        rest = tuple(one for one in self.things if one is not thing)
        return replace(self, things=rest, unfitted=(*self.unfitted, Unfitted(thing.detection, reason)))


def reconstruct(
    observation: Observation,
    detections: Sequence[Detection],
    walls: tuple[Wall, ...],
    on_progress: Callable[[str], None] = lambda words: None,
    scale_share: float = 0.0,
    *,
    find_more: bool = False,
) -> FittedRoom:
    """Fit the objects of a picture by models of the library.

    Args:
        observation: The picture in the level frame.
        detections: Boxes with labels; a box without one is fitted by every model.
        walls: The walls.
        on_progress: Called for each object when it is finally fitted.
        scale_share: Relative uncertainty of the picture's scale, without depth.
        find_more: Whether unboxed objects are searched for: with depth those that stand out of it, and without depth
            the
            supports of boxed objects. Distorted depth shows more residuals than there are objects, so that these are
            searched only if there is no box at all.
    """
    room = RoomEstimate(observation, walls, detections, scale_share)
    fitter = RoomFitter(room)
    boxes = range(len(detections))
    standing = [index for index in boxes if stands_on_floor(detections[index])]
    carried = [index for index in boxes if index not in standing]
    # Near objects hide far ones, and are large in the picture.
    standing.sort(key=lambda index: -detections[index].area_px)
    carried.sort(key=lambda index: (detections[index].category not in CARRIED, -detections[index].area_px))
    _fit_furniture(fitter, standing, carried, on_progress)
    for index in carried:
        on_progress(fitter.fit(index, None, hidden_by=carried))
    if find_more and not observation.is_exact:
        find_carriers(fitter, on_progress)
    _doubt_names(fitter, on_progress)
    if find_more and observation.has_depth and (observation.is_exact or not detections):
        _fit_unboxed(fitter, carried, on_progress)
    _look_again(fitter, standing, on_progress)
    _judge(fitter, on_progress)
    return _result(room)


def _fit_furniture(
    fitter: RoomFitter, standing: Sequence[int], carried: Sequence[int], on_progress: Callable[[str], None]
) -> None:
    """Fit objects on the floor: alone, then among the others, then as a room of which pieces agree."""
    room = fitter.room
    is_exact = room.observation.is_exact
    boxes = range(room.boxed)
    for index in standing:
        fitter.fit(index, [0.0], hidden_by=boxes)
    # They are as large as their support, and hide it.
    for index in (one for one in carried if is_exact and room.detections[one].category in CARRIED):
        fitter.fit(index, None, hidden_by=boxes)
    if is_exact:
        room.look_for_walls()
    for index in standing:
        on_progress(fitter.fit(index, [0.0], hidden_by=carried))
    for index in sorted(standing, key=room.unlikeliness, reverse=True):
        on_progress(fitter.perturb(index))
    for index in standing:
        if fitter.is_unlikely(index, RIGHT):
            on_progress(fitter.fit_again(index, hidden_by=carried))
    if is_exact:
        refit_pairs(fitter, standing, on_progress)
    for index in standing:
        on_progress(fitter.refine_fully(index))


def _doubt_names(fitter: RoomFitter, on_progress: Callable[[str], None]) -> None:
    """Fit detections by other categories that explain them better, or if they are hardly explained."""
    room = fitter.room
    boxes = range(room.boxed)
    for index in boxes:
        # Sides of a fit that hardly explains its box are of no use for other categories.
        if not room.is_doubtful(index):
            on_progress(fitter.rename(index))
    # Where two stand in each other, the one that explains less is the wrong one.
    for index in sorted(boxes, key=room.doubt, reverse=True):
        if room.is_doubtful(index):
            on_progress(fitter.fit_anything(index))


def _fit_unboxed(fitter: RoomFitter, carried: Sequence[int], on_progress: Callable[[str], None]) -> None:
    """Fit residual segments of the depth without a box, then objects that may stand on them."""
    room = fitter.room
    fitter.discover(on_progress)
    for index in range(room.boxed):
        if index not in room.fits and not fitter.adopt(index):
            on_progress(fitter.fit(index, None, hidden_by=carried))
        if room.is_doubtful(index):
            on_progress(fitter.fit_anything(index))


def _look_again(fitter: RoomFitter, standing: Sequence[int], on_progress: Callable[[str], None]) -> None:
    """Search on for each object among everything known in the end, and drop impossible ones."""
    room = fitter.room
    if not room.observation.has_depth:
        _put_down(fitter, on_progress)
    for index in sorted(room.fits, key=room.unlikeliness, reverse=True):
        on_progress(fitter.perturb(index))
    for index in standing:
        if fitter.is_unlikely(index):
            on_progress(fitter.fit_again(index, hidden_by=()))
    for index in standing:
        on_progress(fitter.refine_fully(index))
    room.drop_contained_fits()
    _put_down(fitter, on_progress)


def _judge(fitter: RoomFitter, on_progress: Callable[[str], None]) -> None:
    """Drop unsuccessful fits: outside their box, or explaining hardly any of its pixels."""
    room = fitter.room
    room.drop_fits_outside_their_box()
    for index, in_box in room.in_boxes().items():
        on_progress(fitter.judge(index, in_box))


def _put_down(fitter: RoomFitter, on_progress: Callable[[str], None]) -> None:
    """Fit objects again that stand on nothing any more."""
    room = fitter.room
    for index in list(room.fits):
        if room.is_in_air(index):
            on_progress(fitter.fit(index, None, hidden_by=()))


def _result(room: RoomEstimate) -> FittedRoom:
    """Name the fitted objects."""
    counts: Counter[str] = Counter()
    things, unfitted = [], []
    for index, detection in enumerate(room.detections):
        fit = room.fits.get(index)
        if fit is None:
            unfitted.append(Unfitted(detection, room.reasons[index]))
            continue
        name = detection.name_as(fit.guess.entry)
        things.append(FittedThing(f"{name}_{counts[name]}", detection, fit, index < room.boxed))
        counts[name] += 1
    return FittedRoom(tuple(things), tuple(unfitted), room.walls)
