"""How one thing more is fitted among what is known of a room, and what nobody has put a box around is found."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from executor.assets.library import LIBRARY
from executor.assets.parameters import ModelEntry
from executor.photo.fitting.body import Guess
from executor.photo.fitting.fit import (
    MISNAMED,
    called,
    cheaper,
    cost_among,
    fit_anything,
    fit_thing,
    judged,
    renamed,
    retouched,
    shaken,
    sharpened,
)
from executor.photo.fitting.likelihood import Around, Fit
from executor.photo.fitting.options import with_parts
from executor.photo.fitting.prior import CARRIED, is_large, prior_cost, usual_size_m
from executor.photo.fitting.rim import assumed_beneath, beneath
from executor.photo.fitting.starts import feet_of, high_enough, large_enough, named_models
from executor.photo.inputs.annotations import FLOOR, Sighting
from executor.photo.room.known import BESIDE_BOX, UNLIKELY, KnownRoom
from executor.photo.room.supports import as_exact_as_its_carrier, tops_of
from executor.photo.space.box_view import BoxView
from executor.photo.space.standing_out import are_alike, box_of, standing_out
from llm.sight.forms import overlap

_NOTHING = "nothing in its box stands out from what is around it"
_UNFIT = "no model fits its box, wherever it may stand"
_ON_NOTHING = "nothing was found that it stands on"
_TOO_LITTLE = "no model explains more than {:.0f} % of its pixels"
_LEAST_EXPLAINED = 0.25
"""Of the pixels that stand out in a box: a fit that explains fewer is no likeness of the thing."""

_LEAST_ALONE, _LEAST_BENT = 0.6, 0.4  # Right names explain nine tenths and more, and less where depths are bent.
RIGHT = 0.9  # What explains less may be turned otherwise.
_RIVALS = 6  # Models that what nobody has called so may be as well.
_MOST_FOUND = 40
_MISNAMED_BY_SIGHT = 60.0  # Less, without depth, another name has to cost: what has legs hides and costs little.
_SAME_BOX, _ADOPTED = 0.8, 0.5  # Of two boxes in common.
STOOD_OUT = "stands out of the depths"
"""Who found what nobody has put a box around."""


class RoomFitter:
    """Fits the things of a room, one after the other, each among all that is known when its turn comes.

    Attributes:
        room: What is known, which grows.
        on_nothing: Boxes for which nothing was found that they stand on.
    """

    def __init__(self, room: KnownRoom) -> None:
        self.room = room
        self.on_nothing: set[int] = set()
        self._views: dict[int, BoxView] = {}  # index -> what was seen of it when it was searched for.
        self._tried: dict[int, tuple[Guess, ...]] = {}  # index -> the furniture among which it was fitted again.
        self._shaken: dict[int, frozenset[Guess]] = {}  # index -> it and the furniture among which it was shaken.
        self._sharp: set[Guess] = set()  # Those that were fitted to every pixel.
        self._replaced: dict[int, list[Fit]] = {}  # index -> by sight, what it was before it was fitted anew.

    def fit(self, index: int, bottoms_m: Sequence[float] | None, hidden_by: Iterable[int]) -> str:
        """Fits one thing, anew when it was fitted before, and says what came of it.

        Args:
            index: Which detection.
            bottoms_m: Heights that it may stand on; None: the floor, and tops of what was fitted.
            hidden_by: Detections whose boxes may be of what is in front of it, where they are smaller.
        """
        room = self.room
        detection = room.detections[index]
        before = room.take(index)
        around = room.around(index, hidden_by)
        as_seen = self._is_as_seen(index, around)
        if before is not None and as_seen and prior_cost(before.guess, around.near) < UNLIKELY:
            return room.keep(index, retouched(around, detection.box_px, before))
        entries = named_models(detection)
        if not room.seen.has_depth:
            # What is measured decides; without it, what somebody says of a thing is more than its outline tells.
            entries = with_parts(entries, detection.doors, detection.drawers)
        points = room.points(detection, around)
        if bottoms_m is None:
            bottoms_m = room.heights_m(detection, points)
        under_all = [] if room.seen.has_depth else beneath(detection, room.seen.size_px)
        if under_all:
            others = [one.box_px for number, one in enumerate(room.detections) if number != index]
            feet = feet_of(room.seen, others, usual_size_m(under_all[0])[2])
            found: Fit | None = assumed_beneath(around, under_all, feet)
        else:
            found = fit_thing(around, detection.box_px, entries, bottoms_m, points) if bottoms_m else None
        if found is None:
            nothing = _NOTHING if room.seen.has_depth else _UNFIT
            room.reasons[index] = nothing if bottoms_m else _ON_NOTHING
            found = before
            if not bottoms_m:
                self.on_nothing.add(index)
        elif room.seen.has_depth and found.explained < _LEAST_EXPLAINED:
            room.reasons[index] = _TOO_LITTLE.format(100 * found.explained)
            found = None
        elif room.seen.has_depth and room.is_doubtful_in_air(found):
            room.reasons[index] = _ON_NOTHING
            found = None
        elif room.seen.has_depth and room.claim(found.guess, around).is_refuted(detection.box_px):
            room.reasons[index] = "no such thing fits in its box, through which farther things are seen"
            found = None
        elif detection.on != FLOOR and room.is_on_nothing(found):
            room.reasons[index] = _ON_NOTHING
            self.on_nothing.add(index)
            found = None
        if found is not None:
            found = as_exact_as_its_carrier(found, tops_of(room.fits.values()))
        if before is not None and found is not before and not room.seen.is_exact:
            self._replaced.setdefault(index, []).append(before)
        return room.keep(index, found)

    def rename(self, index: int) -> str:
        """Takes a thing for what fits clearly better than a detector's label, if anything does; a person's is kept."""
        room = self.room
        detection, found = room.detections[index], room.take(index)
        around = room.around(index)
        points = room.points(detection, around)
        if found is None or points is None:
            return room.keep(index, found)
        taken, large = (detection.category, *CARRIED), is_large(found.guess.entry)
        likely = large_enough(points, [found.guess.bottom_m])
        others = [
            entry
            for entry in likely
            if detection.may_be(entry) and entry.category not in taken and is_large(entry) is large
        ]
        other = renamed(around, found, detection.box_px, named_models(detection), others, points)
        is_named = other.guess.entry.category == detection.category
        return room.keep(index, other if is_named or room.is_there(index, other, around) else found)

    def is_unlikely(self, index: int, least_explained: float = 0.0) -> bool:
        """Decides whether what is known now speaks against a fit, or it explains less of its pixels than this share.

        Without depth, whether it does not fill its box, or looks otherwise.
        """
        room = self.room
        if index not in room.fits or self._tried.get(index) == room.pieces_beside(index):
            return False
        if not room.seen.has_depth:
            return room.is_doubtful(index)
        explained = room.fits[index].explained
        return room.unlikeliness(index) > UNLIKELY or explained < least_explained or room.is_seen_through(index)

    def sharpen(self, index: int) -> str:
        """Fits a piece of furniture to every pixel, where it is the picture that tells its place."""
        room = self.room
        found = room.fits.get(index)
        if found is None or found.assumed or room.seen.is_exact or found.guess in self._sharp:
            return room.keep(index, found)
        room.take(index)
        found = sharpened(room.around(index), room.detections[index].box_px, found)
        self._sharp.add(found.guess)
        return room.keep(index, found)

    def fit_again(self, index: int, hidden_by: Sequence[int]) -> str:
        """Fits one thing anew among all that is known now, and keeps what was there where that is the cheaper one."""
        room = self.room
        before = room.fits[index]
        self.fit(index, [0.0], hidden_by)
        found = room.take(index)
        self._tried[index] = room.pieces_beside(index)
        if found is None or found is before:
            return room.keep(index, before)
        around, box_px = room.around(index, hidden_by), room.detections[index].box_px
        return room.keep(index, cheaper(around, box_px, found, before))

    def cost(self, index: int) -> float:
        """Returns what a thing costs among all others, infinite where there is none."""
        found = self.room.take(index)
        if found is None:
            return math.inf
        cost = cost_among(self.room.around(index), self.room.detections[index].box_px, found)
        self.room.keep(index, found)
        return cost

    def shake(self, index: int) -> str:
        """Looks for what explains a piece of furniture better and is not near it, among all that is known now."""
        room = self.room
        found = room.fits.get(index)
        if found is None or not is_large(found.guess.entry):
            return room.keep(index, found)
        room.take(index)
        around, detection = room.around(index), room.detections[index]
        # What moved it may have been called wrongly, and be gone.
        for before in self._replaced.get(index, ()):
            found = cheaper(around, detection.box_px, found, before)
        if self._shaken.get(index) != frozenset((found.guess, *around.near.pieces)):
            likely = named_models(detection)
            if found.guess.entry.category != detection.category:
                rivals = (found.guess.entry, *(one.guess.entry for one in found.alternatives[:_RIVALS]))
                likely = [one for one in rivals if is_large(one)]
            found = shaken(around, detection.box_px, found, likely)
            self._shaken[index] = frozenset((found.guess, *around.near.pieces))
        return room.keep(index, found)

    def judge(self, index: int, in_box: float) -> str:
        """Look once more at how much a fit explains, among all that is known in the end; too little is no success.

        Args:
            index: Which detection.
            in_box: IoU of its box with what is visible of the fit.
        """
        room = self.room
        found = room.take(index)
        if found is not None:
            found = judged(room.around(index), room.detections[index].box_px, found, in_box)
            if room.seen.is_exact and index < room.boxed and found.explained < _LEAST_EXPLAINED:
                room.reasons[index] = _TOO_LITTLE.format(100 * found.explained)
                found = None
        return room.keep(index, found)

    def fit_anything(
        self, index: int, foreign: NDArray[np.bool_] | None = None, entries: Sequence[ModelEntry] = ()
    ) -> str:
        """Fits one thing by every model, and keeps that where it costs clearly less than what the box is called.

        What a person has named is fitted by the models of that name alone, whatever else would cost less.

        Args:
            index: Which detection.
            foreign: (H, W) pixels that are of other things, though nobody knows yet of which.
            entries: Models that it may be; by default all that may be so large.
        """
        room = self.room
        impossible = room.is_impossible(index)
        # By sight, what stands on it is put far off as long as it is not known, and hides other things there.
        raised = [] if room.seen.has_depth else room.on_nothing_but(index)
        before, detection = room.take(index), room.detections[index]
        above = {other: room.take(other) for other in raised}
        if impossible and room.seen.has_depth:
            before = None
            room.reasons[index] = "what it is called would stand in other things"
        # What it may be at all, depths tell better than the picture even where they are bent.
        around = room.around(index, range(room.boxed), by_depth=True)
        if foreign is not None:
            around = replace(around, smaller=around.smaller | foreign)
        self._views[index] = BoxView.of(room.seen, around.other_m, around.smaller)
        points = room.points(detection, around)
        # Where something hides its foot, it may stand on the floor as well.
        places = sorted({0.0, *(room.heights_m(detection, points))})
        if not entries:
            box_px = detection.box_px
            entries = high_enough(room.seen, box_px, places) if points is None else large_enough(points, places)
        entries = [entry for entry in entries if detection.may_be(entry)]
        found = fit_anything(around, detection.box_px, entries, places, points) if entries else None
        if found is not None and not room.seen.has_depth and not room.hangs_in_air(found.guess):
            # What hangs before it looks like it once what hides it is taken for something else.
            held = tuple(one for one in found.alternatives if not room.hangs_in_air(one.guess))
            found = replace(found, alternatives=held)
        if found is not None and found.guess.entry.category != (detection.category or found.guess.entry.category):
            found = called(around, detection.box_px, found, named_models(detection))
        if found is not None and not room.is_there(index, found, around):
            found = None
        if found is not None and (self._explains_too_little(found, before) or self._is_far_fetched(found, before)):
            found = None
        if found is None:
            found = before
        elif before is not None and (detection.category is None or detection.provenance == "person"):
            found = cheaper(around, detection.box_px, before, found)
        elif before is not None and not (room.seen.has_depth and room.claim(before.guess, around).seen_through):
            by = MISNAMED if room.seen.has_depth else max(MISNAMED, _MISNAMED_BY_SIGHT - 2.0 * before.beside_box)
            found = cheaper(around, detection.box_px, before, found, by)
        if found is not None and found is not before and room.seen.bend_share:
            found = self._placed_by_sight(index, found, before)
        if found is None:
            room.reasons.setdefault(index, "no model explains it")
        for other, fit in above.items():
            room.keep(other, fit)
        return room.keep(index, found)

    def _placed_by_sight(self, index: int, found: Fit, before: Fit | None) -> Fit:
        """Returns what bent depths say that a thing is where the picture says that this is."""
        around, box_px = self.room.around(index), self.room.detections[index].box_px
        category = found.guess.entry.category
        own = [entry for entry in LIBRARY.values() if entry.category == category]
        placed = fit_thing(around, box_px, own, [found.guess.bottom_m])
        if before is not None and before.guess.entry.category == category:
            found = cheaper(around, box_px, before, found)
        return found if placed is None else cheaper(around, box_px, found, placed)

    def _explains_too_little(self, found: Fit, before: Fit | None) -> bool:
        """Whether what is made of a box is no likeness.

        By sight alone what has legs covers half of its box: what is called otherwise must not fill that then.
        """
        seen = self.room.seen
        if not seen.has_depth and (before is None or before.beside_box > BESIDE_BOX):
            return False
        return found.explained < (_LEAST_BENT if seen.bend_share else _LEAST_ALONE)

    def _is_far_fetched(self, found: Fit, before: Fit | None) -> bool:
        """Whether by sight alone nothing but its outline speaks for what is made of a box that has no thing."""
        room = self.room
        far_fetched = found.cost > 0.0 or room.is_on_nothing(found)
        return not room.seen.has_depth and before is None and far_fetched

    def adopt(self, index: int) -> bool:
        """Gives a box that has no thing what was found alone and fills it; returns whether there is any.

        What a person has named takes only what may be of that name.
        """
        room = self.room
        box_px = room.detections[index].box_px
        for alone in [one for one in room.fits if one >= room.boxed]:
            if overlap(room.detections[alone].box_px, box_px) < _ADOPTED:
                continue
            before = room.take(alone)
            if before is None:
                continue
            found = called(room.around(index), box_px, before, named_models(room.detections[index]))
            if not room.detections[index].may_be(found.guess.entry):
                room.keep(alone, before)
                continue
            room.reasons[alone] = "it is what a box was drawn around"
            room.keep(index, found)
            return True
        return False

    def discover(self, told: Callable[[str], None]) -> None:
        """Fits what stands out of all that is known and nobody has put a box around, the largest first."""
        room = self.room
        tried: list[NDArray[np.bool_]] = []
        parted = True
        while len(tried) < _MOST_FOUND:
            pieces = standing_out(room.seen, room.depth_m, room.walls, parted=parted)
            piece = next((one for one in pieces if not any(are_alike(one, other) for other in tried)), None)
            if piece is None and not parted:
                break
            if piece is None:
                # What is no row after all, since nothing fits its parts, is looked at whole.
                parted = False
                continue
            tried.append(piece)
            room.detections.append(Sighting("", None, box_of(piece), 0.0, STOOD_OUT, provenance="search"))
            others = [one for one in pieces if one is not piece]
            told(self.fit_anything(len(room.detections) - 1, np.any(others, axis=0) if others else None))
        alone = [index for index in room.fits if index >= room.boxed]
        found = [index for index in alone if room.fits[index].guess.bottom_m == 0.0]
        # The first ones were fitted among nothing, and each to the piece of it that stood out.
        for index in found:
            box_px = room.detections[index].box_px
            claimed_px = room.claimed_px(index) or box_px
            before = room.fits[index]
            room.take(index)
            around = room.around(index)
            if overlap(claimed_px, box_px) > _SAME_BOX and self._is_as_seen(index, around):
                told(room.keep(index, retouched(around, box_px, before)))
                continue
            room.keep(index, before)
            room.detections[index] = replace(room.detections[index], box_px=claimed_px)
            told(self.fit_anything(index))

    def _is_as_seen(self, index: int, around: Around) -> bool:
        """Whether hardly anything else is seen in a thing's box than when it was searched for; remembers what is."""
        room = self.room
        if not room.seen.has_depth:
            return False
        view, before = BoxView.of(room.seen, around.other_m, around.smaller), self._views.get(index)
        if before is not None and view.is_like(before, room.detections[index].box_px):
            return True
        self._views[index] = view
        return False
