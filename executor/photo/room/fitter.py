"""Fit one more object into the estimate of a room: as what it is called, else as a generic shape."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from executor.assets.families.generic import BOARDS, GENERIC, SHELF, THING
from executor.assets.library import LIBRARY, asset_for
from executor.assets.parameters import ModelEntry
from executor.photo.errors import LostCause
from executor.photo.fitting.fit import (
    assess_fit,
    fit_thing,
    update_fit,
)
from executor.photo.fitting.hypothesis import PoseHypothesis, raycaster_of
from executor.photo.fitting.likelihood import FOOT_USUAL, Fit, RatedHypothesis, SearchContext, feet_cost
from executor.photo.fitting.refinement import with_parts
from executor.photo.fitting.starts import LEAST_POINTS, generic_models, named_models, stands_on_floor
from executor.photo.geometry.residuals import BoxView
from executor.photo.inputs.annotations import WALL, Detection, plain_name
from executor.photo.inputs.usual import is_hollow, is_mostly_open, is_unlidded
from executor.photo.room.beneath import COMPARTMENTS
from executor.photo.room.estimate import RoomEstimate, tops_of
from executor.photo.room.hanging import hung
from executor.photo.room.outlined import fit_by_box
from oag.model.symbols import has_boards, is_known

LEAST_IN_BOX = 0.5
"""IoU of a box with the visible part of its fit: with less, something else is fitted, or elsewhere."""

_FLAT, _LEAST_HOLLOW_M = 0.25, 0.03
"""Least height of an open box by its narrower side, and that side: else it is a magazine, a plate or a pen."""

_BOARD_OFF_M = 0.05  # Between where a thing ends and the board that it is on.
_AS_GOOD = 1.1  # Times the cost of a closed box: so little tells nothing of its top.
_LEAST_EXPLAINED = 0.25  # Of the residual pixels of a box: a fit that explains fewer is wrong.


class RoomFitter:
    """Fits the objects of a room one after the other, each among everything known at that time.

    Attributes:
        room: The estimate, which grows.
    """

    def __init__(self, room: RoomEstimate) -> None:
        self.room = room
        self._views: dict[int, BoxView] = {}  # index -> its view at the last search.

    def fit(self, index: int, bottoms_m: Sequence[float] | None, hidden_by: Iterable[int]) -> str:
        """Fit one object, again if it was fitted before; return a sentence about the result.

        Args:
            index: Which detection.
            bottoms_m: Heights that it may stand on; None: the floor, and tops of fits.
            hidden_by: Detections that may be in front of it, if their boxes are smaller.
        """
        room = self.room
        detection, hidden_by = room.detections[index], tuple(hidden_by)
        before = room.remove_fit(index)
        around = room.around(index, hidden_by)
        if (on_wall := hung(room, index, around)) is not None:
            return room.add_fit(index, as_named(on_wall, detection))
        is_unchanged = self._is_view_unchanged(index, around)
        if before is not None and is_unchanged:
            updated = as_named(update_fit(around, detection.box_px, before), detection)
            return room.add_fit(index, self._on_boards(index, updated))
        best: tuple[bool, Fit] | None = None
        for one in self._fits(index, bottoms_m, hidden_by):
            found = as_named(one, detection)
            room.add_fit(index, found)
            found = replace(found, in_box=room.in_box(index))
            room.remove_fit(index)
            # What things hide the top of shows little else than what is below it.
            carries = feet_cost(found.guess, around.feet_m) < FOOT_USUAL * len(around.feet_m)
            if best is None or (carries, found.in_box) > (best[0], best[1].in_box):
                best = carries, found
            if found.in_box >= LEAST_IN_BOX and (carries or found.explained >= _LEAST_EXPLAINED):
                best = carries, found
                break
        if best is None and (last := self._hung(index, around)) is not None:
            best = False, as_named(last, detection)
        if best is not None and self._lacks_boards(index, best[1]):
            best = best[0], self._with_boards(index, best[1], around, bottoms_m)
        return room.add_fit(index, None if best is None else best[1])

    def fit_roughly(self, index: int, bottoms_m: Sequence[float] | None) -> None:
        """Fit one object by the likeliest start of a search, which takes a fraction of a second.

        Args:
            index: Which detection.
            bottoms_m: As for `fit`.
        """
        room = self.room
        found = hung(room, index, room.around(index)) or next(self._fits(index, bottoms_m, (), rough=True), None)
        found = found or self._hung(index, room.around(index))
        if found is None:
            return
        room.add_fit(index, as_named(found, room.detections[index]))
        room.fits[index] = replace(room.fits[index], in_box=room.in_box(index))

    def judge(self, index: int) -> str:
        """Compare a fit with its box among everything known in the end; fit it again if it is of something else."""
        room = self.room
        if index in room.fits and room.in_box(index) < LEAST_IN_BOX:
            before = room.fits[index]
            in_box = room.in_box(index)
            self._views.pop(index, None)
            self.fit(index, [0.0] if room.is_on_floor(index) else None, ())
            if index not in room.fits or room.in_box(index) <= in_box:
                room.remove_fit(index)
                room.add_fit(index, before)
        if index not in room.fits:
            return room.add_fit(index, None)
        in_box = room.in_box(index)
        found = room.fits[index]
        room.remove_fit(index)
        return room.add_fit(index, assess_fit(room.around(index), room.detections[index].box_px, found, in_box))

    def _fits(
        self, index: int, bottoms_m: Sequence[float] | None, hidden_by: tuple[int, ...], *, rough: bool = False
    ) -> Iterator[Fit]:
        """Yield fits of a detection by decreasing evidence: its models, generic shapes, whatever fills its box."""
        room, detection = self.room, self.room.detections[index]
        around = room.around(index, hidden_by)
        points = room.points(detection, around)
        if len(points) >= LEAST_POINTS:
            heights_m = bottoms_m or room.heights_m(detection, points)
            for entries in filter(None, (_models(detection), generic_models(detection))):
                found = fit_thing(around, detection.box_px, entries, heights_m, points, rough=rough)
                if found is not None:
                    yield found
        by_box = fit_by_box(room, index, bottoms_m, rough=rough)
        if by_box is not None:
            yield by_box

    def _lacks_boards(self, index: int, found: Fit) -> bool:
        """Return whether a thing on a fit ends where that has no board."""
        tops_m = np.array([top.height_m for top in tops_of([found.guess])])
        levels_m = np.array([*self.room.boards_m.get(index, {}).values()])
        return bool((np.abs(levels_m[:, None] - tops_m).min(axis=1, initial=math.inf) > _BOARD_OFF_M).any())

    def _with_boards(self, index: int, found: Fit, around: SearchContext, bottoms_m: Sequence[float] | None) -> Fit:
        """Return a fit of a shelf with boards where what is on them ends; what is wide and low stays as it is."""
        room, detection = self.room, self.room.detections[index]
        # By the name of the library's it is furniture, however thin it is.
        entry = replace(GENERIC[SHELF], category=named_models(detection)[0].category)
        points = room.points(detection, around)
        bottoms_m = bottoms_m or [found.guess.bottom_m]
        shelf = fit_thing(around, detection.box_px, [entry], bottoms_m, points) if len(points) >= LEAST_POINTS else None
        if shelf is None or shelf.guess.size_m[2] < COMPARTMENTS * shelf.guess.size_m[1]:
            return found
        shelf = self._on_boards(index, shelf)
        return self._on_boards(index, as_named(update_fit(around, detection.box_px, shelf), detection))

    def _on_boards(self, index: int, found: Fit) -> Fit:
        """Return a fit of a shelf with its boards at their heights, whatever its own height is, and things on it."""
        guess, on_it = found.guess, self.room.boards_m.get(index, {})
        if guess.entry.model != SHELF:
            return found
        self.room.on.update(dict.fromkeys(on_it, index))
        levels_m = zip(BOARDS, sorted({*on_it.values()}), strict=False)
        shares = {
            board.name: min(max((level_m - guess.bottom_m) / guess.size_m[2], 0.0), 1.0) for board, level_m in levels_m
        }
        return replace(found, guess=guess.with_parameters(**shares))

    def _hung(self, index: int, around: SearchContext) -> Fit | None:
        """Return a fit of what no ray meets a support below; what only stands on the floor is lost."""
        found = hung(self.room, index, around, WALL) if hung_models(self.room.detections[index]) else None
        if found is None:
            self.room.lost[index] = LostCause.STANDS
        return found

    def _is_view_unchanged(self, index: int, around: SearchContext) -> bool:
        """Return whether an object's box shows hardly anything else than at its last search; else remember the view."""
        view, before = BoxView.of(self.room.observation, around.other_m, around.smaller), self._views.get(index)
        if before is not None and view.is_like(before, self.room.detections[index].box_px):
            return True
        self._views[index] = view
        return False


def as_named(found: Fit, detection: Detection) -> Fit:
    """Return a fit with the size that a person gave, as a box where its model has no such size or it has no hollow.

    Of what mostly has no lid by its name it is the best open one, unless depth clearly shows a top.
    """
    if is_unlidded(detection.label):
        most = _AS_GOOD * found.cost if math.isfinite(found.residual_m) else math.inf
        opened = next((one for one in found.alternatives if _is_open(one.guess) and one.cost <= most), None)
        if opened is not None and not _is_open(found.guess):
            others = (
                RatedHypothesis(found.guess, found.cost),
                *(one for one in found.alternatives if one is not opened),
            )
            found = replace(found, guess=opened.guess, cost=opened.cost, alternatives=others)
    if detection.size_m is None:
        *sides, height = found.guess.size_m
        is_solid = height < _FLAT * min(sides) or min(sides) < _LEAST_HOLLOW_M
        if (
            found.guess.entry.model == "generic_open_box"
            and is_solid
            and not (is_hollow(detection.label) or is_mostly_open(detection.label))
        ):
            return replace(found, guess=replace(found.guess, entry=generic_models(detection)[0], parameters=()))
        return found
    guess = replace(found.guess, size_m=detection.size_m)
    if raycaster_of(guess) is None:
        guess = replace(guess, entry=generic_models(detection)[0], parameters=())
    return replace(found, guess=guess)


def _is_open(guess: PoseHypothesis) -> bool:
    """Return whether a hypothesis has a hollow, and no door before it."""
    asset = asset_for(guess.as_object())
    return not asset.joints and any(region.kind == "interior" for region in asset.regions)


def _models(detection: Detection) -> list[ModelEntry]:
    """Return the library's models of what a detection is called, with as many doors and drawers as are given."""
    named = [entry for entry in named_models(detection) if entry.model in LIBRARY]
    return with_parts(named, detection.doors, detection.drawers)


def hung_models(detection: Detection) -> list[ModelEntry]:
    """Return the models of what hangs: a cabinet is a box there; other furniture that stands on the floor has none."""
    category = detection.category or plain_name(detection.label) or THING
    if has_boards(category) or not stands_on_floor(detection):
        return [*_models(detection), *generic_models(detection)]
    return [] if is_known(category) and category != "bottom_cabinet" else generic_models(detection)
