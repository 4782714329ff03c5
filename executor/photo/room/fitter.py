"""Fit one more object into the estimate of a room, and search for objects without a box."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from executor.assets.library import LIBRARY
from executor.assets.parameters import ModelEntry
from executor.photo.fitting.fit import (
    MISNAMED,
    assess_fit,
    cheaper,
    cost_among,
    fit_anything,
    fit_thing,
    perturb_and_refine,
    reclassify,
    refine_full_resolution,
    update_fit,
    with_label,
)
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.likelihood import CARRIED, Fit, SearchContext, is_large, prior_cost, usual_size_m
from executor.photo.fitting.refinement import with_parts
from executor.photo.fitting.rim import assumed_beneath, beneath
from executor.photo.fitting.starts import feet_of, high_enough, large_enough, named_models
from executor.photo.geometry.residuals import BoxView, are_alike, box_of, residual_segments
from executor.photo.inputs.annotations import FLOOR, Detection
from executor.photo.room.estimate import MAX_OUTLINE_MISFIT, UNLIKELY, RoomEstimate, as_exact_as_its_carrier, tops_of
from llm.vision import overlap

_NOTHING = "nothing in its box stands out from what is around it"
_UNFIT = "no model fits its box, wherever it may stand"
_ON_NOTHING = "nothing was found that it stands on"
_TOO_LITTLE = "no model explains more than {:.0f} % of its pixels"
_LEAST_EXPLAINED = 0.25
"""Of the residual pixels of a box: a fit that explains fewer is wrong."""

_LEAST_ALONE, _LEAST_BENT = 0.6, 0.4  # Correct labels explain nine tenths and more, and less with distorted depth.
RIGHT = 0.9  # A fit that explains less may have another orientation.
_RIVALS = 6  # Rival models of an object of another category.
_MOST_FOUND = 40
_MISNAMED_MONOCULAR = 60.0  # Margin of another label without depth: models with legs hide little and cost little.
_SAME_BOX, _ADOPTED = 0.8, 0.5  # Of two boxes in common.
STOOD_OUT = "stands out of the depths"
"""Source of detections without a given box."""


class RoomFitter:
    """Fits the objects of a room one after the other, each among everything known at that time.

    Attributes:
        room: The estimate, which grows.
        on_nothing: Detections for which no support was found.
    """

    def __init__(self, room: RoomEstimate) -> None:
        self.room = room
        self.on_nothing: set[int] = set()
        self._views: dict[int, BoxView] = {}  # index -> its view at the last search.
        self._tried: dict[int, tuple[PoseHypothesis, ...]] = {}  # index -> the furniture at its last fit.
        self._perturbed: dict[int, frozenset[PoseHypothesis]] = {}  # index -> it and its furniture when perturbed.
        self._sharp: set[PoseHypothesis] = set()  # Those refined at full resolution.
        self._replaced: dict[int, list[Fit]] = {}  # index -> without exact depth, its earlier fits.

    def fit(self, index: int, bottoms_m: Sequence[float] | None, hidden_by: Iterable[int]) -> str:
        """Fit one object, again if it was fitted before; return a sentence about the result.

        Args:
            index: Which detection.
            bottoms_m: Heights that it may stand on; None: the floor, and tops of fits.
            hidden_by: Detections that may be in front of it, if their boxes are smaller.
        """
        room = self.room
        detection = room.detections[index]
        before = room.remove_fit(index)
        around = room.around(index, hidden_by)
        is_unchanged = self._is_view_unchanged(index, around)
        if before is not None and is_unchanged and prior_cost(before.guess, around.near) < UNLIKELY:
            return room.add_fit(index, update_fit(around, detection.box_px, before))
        entries = named_models(detection)
        if not room.observation.has_depth:
            # Depth decides; without it, given parts are better evidence than the outline.
            entries = with_parts(entries, detection.doors, detection.drawers)
        points = room.points(detection, around)
        if bottoms_m is None:
            bottoms_m = room.heights_m(detection, points)
        under_all = [] if room.observation.has_depth else beneath(detection, room.observation.size_px)
        if under_all:
            others = [one.box_px for number, one in enumerate(room.detections) if number != index]
            feet = feet_of(room.observation, others, usual_size_m(under_all[0])[2])
            found: Fit | None = assumed_beneath(around, under_all, feet)
        else:
            found = fit_thing(around, detection.box_px, entries, bottoms_m, points) if bottoms_m else None
        if found is None:
            nothing = _NOTHING if room.observation.has_depth else _UNFIT
            room.reasons[index] = nothing if bottoms_m else _ON_NOTHING
            found = before
            if not bottoms_m:
                self.on_nothing.add(index)
        elif room.observation.has_depth and found.explained < _LEAST_EXPLAINED:
            room.reasons[index] = _TOO_LITTLE.format(100 * found.explained)
            found = None
        elif room.observation.has_depth and room.is_doubtful_in_air(found):
            room.reasons[index] = _ON_NOTHING
            found = None
        elif room.observation.has_depth and room.claim(found.guess, around).is_refuted(detection.box_px):
            room.reasons[index] = "no such thing fits in its box, through which farther things are seen"
            found = None
        elif detection.on != FLOOR and room.is_on_nothing(found):
            room.reasons[index] = _ON_NOTHING
            self.on_nothing.add(index)
            found = None
        if found is not None:
            found = as_exact_as_its_carrier(found, tops_of(room.fits.values()))
        if before is not None and found is not before and not room.observation.is_exact:
            self._replaced.setdefault(index, []).append(before)
        return room.add_fit(index, found)

    def rename(self, index: int) -> str:
        """Change the category if another one fits clearly better than a detector's label; a person's label is kept."""
        room = self.room
        detection, found = room.detections[index], room.remove_fit(index)
        around = room.around(index)
        points = room.points(detection, around)
        if found is None or points is None:
            return room.add_fit(index, found)
        taken, large = (detection.category, *CARRIED), is_large(found.guess.entry)
        likely = large_enough(points, [found.guess.bottom_m])
        others = [
            entry
            for entry in likely
            if detection.may_be(entry) and entry.category not in taken and is_large(entry) is large
        ]
        other = reclassify(around, found, detection.box_px, named_models(detection), others, points)
        is_named = other.guess.entry.category == detection.category
        return room.add_fit(index, other if is_named or room.is_there(index, other, around) else found)

    def is_unlikely(self, index: int, least_explained: float = 0.0) -> bool:
        """Return whether prior or explained share (below the given one) speaks against a fit.

        Without depth, whether it does not fill its box, or looks different.
        """
        room = self.room
        if index not in room.fits or self._tried.get(index) == room.neighbouring_pieces(index):
            return False
        if not room.observation.has_depth:
            return room.is_doubtful(index)
        explained = room.fits[index].explained
        return room.unlikeliness(index) > UNLIKELY or explained < least_explained or room.fit_violates_free_space(index)

    def refine_fully(self, index: int) -> str:
        """Refine furniture with every pixel, if the picture determines its place."""
        room = self.room
        found = room.fits.get(index)
        if found is None or found.assumed or room.observation.is_exact or found.guess in self._sharp:
            return room.add_fit(index, found)
        room.remove_fit(index)
        found = refine_full_resolution(room.around(index), room.detections[index].box_px, found)
        self._sharp.add(found.guess)
        return room.add_fit(index, found)

    def fit_again(self, index: int, hidden_by: Sequence[int]) -> str:
        """Fit one object again among everything known now, and keep the cheaper fit."""
        room = self.room
        before = room.fits[index]
        self.fit(index, [0.0], hidden_by)
        found = room.remove_fit(index)
        self._tried[index] = room.neighbouring_pieces(index)
        if found is None or found is before:
            return room.add_fit(index, before)
        around, box_px = room.around(index, hidden_by), room.detections[index].box_px
        return room.add_fit(index, cheaper(around, box_px, found, before))

    def cost(self, index: int) -> float:
        """Return the cost of an object among all others, infinite if there is none."""
        found = self.room.remove_fit(index)
        if found is None:
            return math.inf
        cost = cost_among(self.room.around(index), self.room.detections[index].box_px, found)
        self.room.add_fit(index, found)
        return cost

    def perturb(self, index: int) -> str:
        """Search for a better explanation of furniture that local search does not reach."""
        room = self.room
        found = room.fits.get(index)
        if found is None or not is_large(found.guess.entry):
            return room.add_fit(index, found)
        room.remove_fit(index)
        around, detection = room.around(index), room.detections[index]
        # The object that moved it may have been wrong, and be gone.
        for before in self._replaced.get(index, ()):
            found = cheaper(around, detection.box_px, found, before)
        if self._perturbed.get(index) != frozenset((found.guess, *around.near.pieces)):
            likely = named_models(detection)
            if found.guess.entry.category != detection.category:
                rivals = (found.guess.entry, *(one.guess.entry for one in found.alternatives[:_RIVALS]))
                likely = [one for one in rivals if is_large(one)]
            found = perturb_and_refine(around, detection.box_px, found, likely)
            self._perturbed[index] = frozenset((found.guess, *around.near.pieces))
        return room.add_fit(index, found)

    def judge(self, index: int, in_box: float) -> str:
        """Update the explained share of a fit among everything known in the end; drop a fit with too little.

        Args:
            index: Which detection.
            in_box: IoU of its box with the visible part of the fit.
        """
        room = self.room
        found = room.remove_fit(index)
        if found is not None:
            found = assess_fit(room.around(index), room.detections[index].box_px, found, in_box)
            if room.observation.is_exact and index < room.boxed and found.explained < _LEAST_EXPLAINED:
                room.reasons[index] = _TOO_LITTLE.format(100 * found.explained)
                found = None
        return room.add_fit(index, found)

    def fit_anything(
        self, index: int, foreign: NDArray[np.bool_] | None = None, entries: Sequence[ModelEntry] = ()
    ) -> str:
        """Fit one object by every model, and keep that if it costs clearly less than the labelled category.

        An object with a person's label is fitted by the models of that category alone, whatever else would cost less.

        Args:
            index: Which detection.
            foreign: (H, W) pixels of other objects, which are not fitted yet.
            entries: Candidate models; by default all that can have the size.
        """
        room = self.room
        impossible = room.is_impossible(index)
        # Without depth, objects on an unknown support are placed far off, and hide others there.
        raised = [] if room.observation.has_depth else room.on_nothing_but(index)
        before, detection = room.remove_fit(index), room.detections[index]
        above = {other: room.remove_fit(other) for other in raised}
        if impossible and room.observation.has_depth:
            before = None
            room.reasons[index] = "what it is called would stand in other things"
        # For its category, even distorted depth is better evidence than the picture.
        around = room.around(index, range(room.boxed), by_depth=True)
        if foreign is not None:
            around = replace(around, smaller=around.smaller | foreign)
        self._views[index] = BoxView.of(room.observation, around.other_m, around.smaller)
        points = room.points(detection, around)
        # Where something hides its foot, it may stand on the floor as well.
        places = sorted({0.0, *(room.heights_m(detection, points))})
        if not entries:
            box_px = detection.box_px
            entries = high_enough(room.observation, box_px, places) if points is None else large_enough(points, places)
        entries = [entry for entry in entries if detection.may_be(entry)]
        found = fit_anything(around, detection.box_px, entries, places, points) if entries else None
        if found is not None and not room.observation.has_depth and not room.hangs_in_air(found.guess):
            # A hanging object in front looks like it once the object that hides it changes its category.
            held = tuple(one for one in found.alternatives if not room.hangs_in_air(one.guess))
            found = replace(found, alternatives=held)
        if found is not None and found.guess.entry.category != (detection.category or found.guess.entry.category):
            found = with_label(around, detection.box_px, found, named_models(detection))
        if found is not None and not room.is_there(index, found, around):
            found = None
        if found is not None and (self._explains_too_little(found, before) or self._is_far_fetched(found, before)):
            found = None
        if found is None:
            found = before
        elif before is not None and (detection.category is None or detection.provenance == "person"):
            found = cheaper(around, detection.box_px, before, found)
        elif before is not None and not (
            room.observation.has_depth and room.claim(before.guess, around).violates_free_space
        ):
            by = (
                MISNAMED
                if room.observation.has_depth
                else max(MISNAMED, _MISNAMED_MONOCULAR - 2.0 * before.outline_misfit)
            )
            found = cheaper(around, detection.box_px, before, found, by)
        if found is not None and found is not before and room.observation.depth_distortion:
            found = self._place_by_picture(index, found, before)
        if found is None:
            room.reasons.setdefault(index, "no model explains it")
        for other, fit in above.items():
            room.add_fit(other, fit)
        return room.add_fit(index, found)

    def _place_by_picture(self, index: int, found: Fit, before: Fit | None) -> Fit:
        """Place an object by the picture, with the category that distorted depth gives."""
        around, box_px = self.room.around(index), self.room.detections[index].box_px
        category = found.guess.entry.category
        own = [entry for entry in LIBRARY.values() if entry.category == category]
        placed = fit_thing(around, box_px, own, [found.guess.bottom_m])
        if before is not None and before.guess.entry.category == category:
            found = cheaper(around, box_px, before, found)
        return found if placed is None else cheaper(around, box_px, found, placed)

    def _explains_too_little(self, found: Fit, before: Fit | None) -> bool:
        """Return whether a fit explains too little of its box.

        In a monocular picture an object with legs covers half of its box: then another category need not fill it.
        """
        observation = self.room.observation
        if not observation.has_depth and (before is None or before.outline_misfit > MAX_OUTLINE_MISFIT):
            return False
        return found.explained < (_LEAST_BENT if observation.depth_distortion else _LEAST_ALONE)

    def _is_far_fetched(self, found: Fit, before: Fit | None) -> bool:
        """Return whether a monocular fit is supported by its outline alone."""
        room = self.room
        far_fetched = found.cost > 0.0 or room.is_on_nothing(found)
        return not room.observation.has_depth and before is None and far_fetched

    def adopt(self, index: int) -> bool:
        """Assign an unboxed fit to a box without a fit that it fills; return whether there is any.

        A person's label only accepts models of its category.
        """
        room = self.room
        box_px = room.detections[index].box_px
        for alone in [one for one in room.fits if one >= room.boxed]:
            if overlap(room.detections[alone].box_px, box_px) < _ADOPTED:
                continue
            before = room.remove_fit(alone)
            if before is None:
                continue
            found = with_label(room.around(index), box_px, before, named_models(room.detections[index]))
            if not room.detections[index].may_be(found.guess.entry):
                room.add_fit(alone, before)
                continue
            room.reasons[alone] = "it is what a box was drawn around"
            room.add_fit(index, found)
            return True
        return False

    def discover(self, on_progress: Callable[[str], None]) -> None:
        """Fit the residual segments without a box, the largest first."""
        room = self.room
        tried: list[NDArray[np.bool_]] = []
        split_rows = True
        while len(tried) < _MOST_FOUND:
            pieces = residual_segments(room.observation, room.depth_m, room.walls, split_rows=split_rows)
            piece = next((one for one in pieces if not any(are_alike(one, other) for other in tried)), None)
            if piece is None and not split_rows:
                break
            if piece is None:
                # A segment whose parts nothing fits is no row: it is tried whole.
                split_rows = False
                continue
            tried.append(piece)
            room.detections.append(Detection("", None, box_of(piece), 0.0, STOOD_OUT, provenance="search"))
            others = [one for one in pieces if one is not piece]
            on_progress(self.fit_anything(len(room.detections) - 1, np.any(others, axis=0) if others else None))
        alone = [index for index in room.fits if index >= room.boxed]
        found = [index for index in alone if room.fits[index].guess.bottom_m == 0.0]
        # The first ones were fitted among nothing, and each to the piece of it that stood out.
        for index in found:
            box_px = room.detections[index].box_px
            claimed_px = room.claimed_px(index) or box_px
            before = room.fits[index]
            room.remove_fit(index)
            around = room.around(index)
            if overlap(claimed_px, box_px) > _SAME_BOX and self._is_view_unchanged(index, around):
                on_progress(room.add_fit(index, update_fit(around, box_px, before)))
                continue
            room.add_fit(index, before)
            room.detections[index] = replace(room.detections[index], box_px=claimed_px)
            on_progress(self.fit_anything(index))

    def _is_view_unchanged(self, index: int, around: SearchContext) -> bool:
        """Return whether an object's box shows hardly anything else than at its last search; else remember the view."""
        room = self.room
        if not room.observation.has_depth:
            return False
        view, before = BoxView.of(room.observation, around.other_m, around.smaller), self._views.get(index)
        if before is not None and view.is_like(before, room.detections[index].box_px):
            return True
        self._views[index] = view
        return False
