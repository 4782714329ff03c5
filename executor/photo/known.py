"""What is known of a room so far, and how one thing more is fitted among it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from executor.assets.library import LIBRARY
from executor.geometry import Array
from executor.photo.fitting.body import Guess, picture_of
from executor.photo.fitting.fit import (
    MISNAMED,
    called,
    cheaper,
    fit_anything,
    fit_thing,
    renamed,
    retouched,
    shaken,
    sharpened,
)
from executor.photo.fitting.likelihood import Around, Fit
from executor.photo.fitting.options import with_parts
from executor.photo.fitting.prior import (
    CARRIED,
    Neighbourhood,
    is_large,
    is_outgrown,
    prior_cost,
    stands_in,
    usual_size_m,
)
from executor.photo.fitting.rim import assumed_beneath, beneath
from executor.photo.fitting.starts import LEAST_POINTS, feet_of, large_enough, named_models, points_of
from executor.photo.inputs.annotations import Sighting
from executor.photo.space.box_view import BoxView
from executor.photo.space.claim import Claim
from executor.photo.space.layers import Layers
from executor.photo.space.observation import Observation
from executor.photo.space.rescale import straightened
from executor.photo.space.standing_out import are_alike, box_of, standing_out
from executor.photo.space.walls import Wall
from executor.photo.supports import (
    EQUAL_M,
    SAME_M,
    as_exact_as_its_carrier,
    heights_behind,
    heights_under,
    is_on_one,
    tops_of,
)
from llm.sight.forms import overlap
from oag import Kind, kind_of

_UNLIKELY = 10.0
"""Prior cost of what stands in a wall, in others, or with its front against something, and hardly of a right fit."""

_IMPOSSIBLE = 30.0  # Of what stands wholly in something: it is called wrongly.
_NOTHING = "nothing in its box stands out from what is around it"
_UNFIT = "no model fits its box, wherever it may stand"
_ON_NOTHING = "nothing was found that it stands on"
_LEAST_EXPLAINED = 0.25
"""Of the pixels that stand out in a box: a fit that explains fewer is no likeness of the thing."""

_DOUBTFUL, _LEAST_ALONE = 0.75, 0.6  # Right names explain nine tenths and more.
RIGHT = 0.9  # What explains less may be turned otherwise.
_RIVALS = 6  # Models that what nobody has called so may be as well.
_LEAST_SEEN_PX = 40  # Half of the least piece that is looked at: of such a thing neither size nor turn is known.
_MOST_FOUND = 40
_BESIDE_BOX, _UNLIKE = 25.0, 50.0  # Without depth, most that outline and fit of what is called rightly cost.
_MISNAMED_BY_SIGHT = 60.0  # Less, without depth, another name has to cost: what has legs hides and costs little.
_SAME_BOX, _ADOPTED = 0.8, 0.5  # Of two boxes in common.
STOOD_OUT = "stands out of the depths"
"""Who found what nobody has put a box around."""


class KnownRoom:
    """What is known so far: the fits, and the depth and face that each of them has in every pixel."""

    def __init__(
        self, seen: Observation, walls: tuple[Wall, ...], detections: Sequence[Sighting], scale_share: float
    ) -> None:
        self.seen, self.detections, self.scale_share = seen, list(detections), scale_share
        self._boxed = len(self.detections)  # Whatever is detected after these, nobody has put a box around.
        self.fits: dict[int, Fit] = {}
        self.reasons: dict[int, str] = {}
        self._layers = Layers(seen, walls)
        self._sharp: set[Guess] = set()  # Those that were fitted to every pixel.
        self._views: dict[int, BoxView] = {}  # index -> what was seen of it when it was searched for.
        self._tried: dict[int, tuple[Guess, ...]] = {}  # index -> the furniture among which it was fitted again.
        self._shaken: dict[int, frozenset[Guess]] = {}  # index -> it and the furniture among which it was shaken.

    @property
    def walls(self) -> tuple[Wall, ...]:
        """The walls."""
        return self._layers.walls

    def look_for_walls(self) -> None:
        """Looks for walls in boxes, too, now that it is known which of their pixels are of things."""
        self._layers.look_for_walls([one for index, one in enumerate(self.detections) if index not in self.fits])

    def fit(self, index: int, bottoms_m: Sequence[float] | None, hidden_by: Iterable[int]) -> str:
        """Fits one thing, anew when it was fitted before, and says what came of it.

        Args:
            index: Which detection.
            bottoms_m: Heights that it may stand on; None: the floor, and tops of what was fitted.
            hidden_by: Detections whose boxes may be of what is in front of it, where they are smaller.
        """
        detection = self.detections[index]
        before = self._taken(index)
        around = self._around(index, hidden_by)
        as_seen = self._is_as_seen(index, around)
        if before is not None and as_seen and prior_cost(before.guess, around.near) < _UNLIKELY:
            return self._kept(index, retouched(around, detection.box_px, before))
        entries = named_models(detection)
        if not self.seen.has_depth:
            # What is measured decides; without it, what somebody says of a thing is more than its outline tells.
            entries = with_parts(entries, detection.doors, detection.drawers)
        points = self._points(detection, around)
        if bottoms_m is None:
            bottoms_m = self._heights(detection, points)
        under_all = [] if self.seen.has_depth else beneath(detection, self.seen.size_px)
        if under_all:
            others = [one.box_px for number, one in enumerate(self.detections) if number != index]
            feet = feet_of(self.seen, others, usual_size_m(under_all[0])[2])
            found: Fit | None = assumed_beneath(around, under_all, feet)
        else:
            found = fit_thing(around, detection.box_px, entries, bottoms_m, points) if bottoms_m else None
        if found is None:
            nothing = _NOTHING if self.seen.has_depth else _UNFIT
            self.reasons[index] = nothing if bottoms_m else _ON_NOTHING
            found = before
        elif self.seen.has_depth and found.explained < _LEAST_EXPLAINED:
            self.reasons[index] = f"no model explains more than {100 * found.explained:.0f} % of its pixels"
            found = None
        elif self.seen.has_depth and self._claim(found.guess, around).is_refuted(detection.box_px):
            self.reasons[index] = "no such thing fits in its box, through which farther things are seen"
            found = None
        elif not self.seen.has_depth and self._is_on_nothing(found.guess):
            self.reasons[index] = _ON_NOTHING
            found = None
        return self._kept(index, None if found is None else as_exact_as_its_carrier(found, tops_of(self.fits.values())))

    def rename(self, index: int) -> str:
        """Takes a thing for what fits clearly better than what it is called, if anything does."""
        detection, found = self.detections[index], self._taken(index)
        around = self._around(index, ())
        points = self._points(detection, around)
        if found is None or points is None:
            return self._kept(index, found)
        taken, large = (detection.category, *CARRIED), is_large(found.guess.entry)
        likely = large_enough(points, [found.guess.bottom_m])
        others = [entry for entry in likely if entry.category not in taken and is_large(entry) is large]
        other = renamed(around, found, detection.box_px, named_models(detection), others, points)
        is_named = other.guess.entry.category == detection.category
        return self._kept(index, other if is_named or self._is_there(index, other, around) else found)

    def _kept(self, index: int, found: Fit | None) -> str:
        """Keeps a fit, and says what it is."""
        name = self.detections[index].label or "thing"
        if found is None:
            return f"{name}: {self.reasons[index]}"
        self.fits[index], self._layers.looks[index] = found, picture_of(found.guess, self.seen)
        return f"{name}: {found.guess.entry.model}"

    def _taken(self, index: int) -> Fit | None:
        """Takes a thing out of the room, and returns how it was fitted, if it was."""
        self._layers.looks.pop(index, None)
        return self.fits.pop(index, None)

    def is_doubtful(self, index: int) -> bool:
        """Decides whether a box may be called wrongly.

        With depth, what it is called explains too little, is seen through, or is in other things; without, it does not
        fill its box, or looks otherwise.
        """
        if index not in self.fits:
            return True
        if not self.seen.has_depth:
            # What furniture carries is as far off as that is, and fits no better.
            found, carried = self.fits[index], self.detections[index].category in CARRIED
            return not carried and (found.beside_box > _BESIDE_BOX or found.cost > _UNLIKE)
        explained = self.fits[index].explained
        return explained < _DOUBTFUL or self._is_seen_through(index) or self.unlikeliness(index) > _IMPOSSIBLE

    def unlikeliness(self, index: int) -> float:
        """Returns how much speaks against a fit before anything is seen, among all that is known now."""
        found = self.fits.pop(index, None)
        if found is None:
            return 0.0
        cost = prior_cost(found.guess, self._near())
        self.fits[index] = found
        return cost

    def is_unlikely(self, index: int, least_explained: float = 0.0) -> bool:
        """Decides whether what is known now speaks against a fit, or it explains less of its pixels than this share."""
        if index not in self.fits or not self.seen.has_depth:
            return False
        found = self.fits.pop(index)
        near = self._near()
        self.fits[index] = found
        if self._tried.get(index) == near.pieces:
            return False
        cost = prior_cost(found.guess, near)
        return cost > _UNLIKELY or found.explained < least_explained or self._is_seen_through(index)

    def is_in_air(self, index: int) -> bool:
        """Decides whether what a thing was put on has been taken for something else since.

        By sight, a top that is a little higher has what stands on it elsewhere.
        """
        found, within_m = self.fits.get(index), EQUAL_M if self.seen.by_sight else SAME_M
        return found is not None and not is_on_one(found.guess, tops_of(self.fits.values()), within_m)

    def sharpen(self, index: int) -> str:
        """Fits a piece of furniture to every pixel, where it is the picture that tells its place."""
        found = self.fits.get(index)
        if found is None or not self.seen.by_sight or found.guess in self._sharp:
            return self._kept(index, found)
        self._taken(index)
        found = sharpened(self._around(index, ()), self.detections[index].box_px, found)
        self._sharp.add(found.guess)
        return self._kept(index, found)

    def leave_out_what_is_inside(self) -> None:
        """Leaves out what nobody has put a box around and stands in other things, which were fitted better since."""
        alone = [index for index in self.fits if index >= self._boxed]
        for index in sorted(alone, key=lambda index: self.detections[index].area_px):
            found = self.fits.pop(index)
            if not stands_in(found.guess, self._near().pieces):
                self.fits[index] = found
                continue
            del self._layers.looks[index]
            self.reasons[index] = "what is left of other things, in which it would stand"

    def fit_again(self, index: int, hidden_by: Sequence[int]) -> str:
        """Fits one thing anew among all that is known now, and keeps what was there where that is the cheaper one."""
        before = self.fits[index]
        self.fit(index, [0.0], hidden_by)
        found = self._taken(index)
        self._tried[index] = self._near().pieces
        if found is None or found is before:
            return self._kept(index, before)
        return self._kept(index, cheaper(self._around(index, hidden_by), self.detections[index].box_px, found, before))

    def shake(self, index: int) -> str:
        """Looks for what explains a piece of furniture better and is not near it, among all that is known now."""
        found = self.fits.get(index)
        if found is None or not is_large(found.guess.entry):
            return self._kept(index, found)
        self._taken(index)
        around, detection = self._around(index, ()), self.detections[index]
        if self._shaken.get(index) != frozenset((found.guess, *around.near.pieces)):
            likely = named_models(detection)
            if found.guess.entry.category != detection.category:
                rivals = (found.guess.entry, *(one.guess.entry for one in found.alternatives[:_RIVALS]))
                likely = [one for one in rivals if is_large(one)]
            found = shaken(around, detection.box_px, found, likely)
            self._shaken[index] = frozenset((found.guess, *around.near.pieces))
        return self._kept(index, found)

    def fit_anything(self, index: int, foreign: NDArray[np.bool_] | None = None) -> str:
        """Fits one thing by every model, and keeps that where it costs clearly less than what the box is called.

        Args:
            index: Which detection.
            foreign: (H, W) pixels that are of other things, though nobody knows yet of which.
        """
        unlikely = self.unlikeliness(index) > _IMPOSSIBLE
        before, detection = self._taken(index), self.detections[index]
        if unlikely and self.seen.has_depth:
            before = None
            self.reasons[index] = "what it is called would stand in other things"
        around = self._around(index, range(self._boxed))
        if foreign is not None:
            around = replace(around, smaller=around.smaller | foreign)
        self._views[index] = BoxView.of(self.seen, around.other_m, around.smaller)
        points = self._points(detection, around)
        # Where something hides its foot, it may stand on the floor as well.
        places = sorted({0.0, *(self._heights(detection, points))})
        entries = list(LIBRARY.values()) if points is None else large_enough(points, places)
        found = fit_anything(around, detection.box_px, entries, places, points) if entries else None
        if found is not None and found.guess.entry.category != (detection.category or found.guess.entry.category):
            found = called(around, detection.box_px, found, named_models(detection))
        if found is not None and not self._is_there(index, found, around):
            found = None
        if found is not None and (found.explained < _LEAST_ALONE or self._is_far_fetched(found, before)):
            found = None
        if found is None:
            found = before
        elif before is not None and detection.category is None:
            found = cheaper(around, detection.box_px, before, found)
        elif before is not None and (not self.seen.has_depth or not self._claim(before.guess, around).seen_through):
            found = cheaper(
                around, detection.box_px, before, found, MISNAMED if self.seen.has_depth else _MISNAMED_BY_SIGHT
            )
        if found is None:
            self.reasons.setdefault(index, "no model explains it")
        return self._kept(index, found)

    def _is_far_fetched(self, found: Fit, before: Fit | None) -> bool:
        """Whether by sight alone nothing but its outline speaks for what is made of a box that has no thing."""
        return not self.seen.has_depth and before is None and (found.cost > 0.0 or self._is_on_nothing(found.guess))

    @staticmethod
    def _is_on_nothing(guess: Guess) -> bool:
        """Whether a thing would have to be too large to stand on the floor: nobody has found what it stands on."""
        return guess.bottom_m == 0.0 and not is_large(guess.entry) and is_outgrown(guess)

    def adopt(self, index: int) -> bool:
        """Gives a box that has no thing what was found alone and fills it; returns whether there is any."""
        box_px = self.detections[index].box_px
        for alone in [one for one in self.fits if one >= self._boxed]:
            if overlap(self.detections[alone].box_px, box_px) < _ADOPTED:
                continue
            found = self.fits.pop(alone)
            del self._layers.looks[alone]
            self.reasons[alone] = "it is what a box was drawn around"
            self._kept(index, called(self._around(index, ()), box_px, found, named_models(self.detections[index])))
            return True
        return False

    def discover(self, told: Callable[[str], None]) -> None:
        """Fits what stands out of all that is known and nobody has put a box around, the largest first."""
        tried: list[NDArray[np.bool_]] = []
        parted = True
        while len(tried) < _MOST_FOUND:
            pieces = standing_out(self.seen, self._layers.together()[0], self.walls, parted=parted)
            piece = next((one for one in pieces if not any(are_alike(one, other) for other in tried)), None)
            if piece is None and not parted:
                break
            if piece is None:
                # What is no row after all, since nothing fits its parts, is looked at whole.
                parted = False
                continue
            tried.append(piece)
            self.detections.append(Sighting("", None, box_of(piece), 0.0, STOOD_OUT))
            others = [one for one in pieces if one is not piece]
            told(self.fit_anything(len(self.detections) - 1, np.any(others, axis=0) if others else None))
        found = [index for index in self.fits if index >= self._boxed and self.fits[index].guess.bottom_m == 0.0]
        # The first ones were fitted among nothing, and each to the piece of it that stood out.
        for index in found:
            before, own, box_px = self.fits.pop(index), self._layers.looks.pop(index), self.detections[index].box_px
            around = self._around(index, ())
            claimed_px = Claim.of(self.seen, own[0], around.other_m, before.guess.corners_m()).box_px or box_px
            if overlap(claimed_px, box_px) > _SAME_BOX and self._is_as_seen(index, around):
                told(self._kept(index, retouched(around, box_px, before)))
                continue
            self.fits[index], self._layers.looks[index] = before, own
            self.detections[index] = replace(self.detections[index], box_px=claimed_px)
            told(self.fit_anything(index))

    def straighten(self) -> None:
        """Puts depths that are bent right by all that is known, as the floor did."""
        if not self.seen.bend_share:
            return
        beside = self.seen.measured & ~self._in_boxes(range(len(self.detections)))
        known_m = np.where(beside, self._layers.together()[0], np.inf)
        self.seen = replace(self.seen, z_m=straightened(self.seen.z_m, known_m))

    def _around(self, index: int, hidden_by: Iterable[int]) -> Around:
        """All that a search for one thing has to know besides it."""
        smaller, own = self._smaller(index, hidden_by), self.detections[index].mask
        return Around(self.seen, *self._layers.together(), smaller, self._near(), self.scale_share, own)

    def _points(self, detection: Sighting, around: Around) -> Array | None:
        """(N, 3) that are most likely a thing's own; None where there is no depth."""
        if not self.seen.has_depth:
            return None
        if detection.mask is not None:
            return np.asarray(self.seen.points_m[detection.mask & self.seen.measured])
        return points_of(self.seen, detection.box_px, around.other_m, around.smaller)

    def _is_there(self, index: int, found: Fit, around: Around) -> bool:
        """Whether a fit that nobody has named is seen wherever it says, and is what the box was drawn around."""
        if not self.seen.has_depth:
            return True
        claim = self._claim(found.guess, around)
        if index < self._boxed:
            is_it = claim.fills(self.detections[index].box_px)
        else:
            # What is left of a thing that was misjudged is explained by another one in it.
            is_it = not stands_in(found.guess, around.near.pieces)
        return is_it and claim.is_borne_out(_LEAST_SEEN_PX, boxed=index < self._boxed)

    def _is_as_seen(self, index: int, around: Around) -> bool:
        """Whether hardly anything else is seen in a thing's box than when it was searched for; remembers what is."""
        if not self.seen.has_depth:
            return False
        view, before = BoxView.of(self.seen, around.other_m, around.smaller), self._views.get(index)
        if before is not None and view.is_like(before, self.detections[index].box_px):
            return True
        self._views[index] = view
        return False

    def _is_seen_through(self, index: int) -> bool:
        own = self._layers.looks.pop(index)
        claim = Claim.of(self.seen, own[0], self._layers.together()[0], self.fits[index].guess.corners_m())
        self._layers.looks[index] = own
        return claim.seen_through

    def _claim(self, guess: Guess, around: Around) -> Claim:
        return Claim.of(self.seen, picture_of(guess, self.seen)[0], around.other_m, guess.corners_m())

    def _near(self) -> Neighbourhood:
        guesses = [fit.guess for fit in self.fits.values()]
        pieces = (one for one in guesses if kind_of(one.entry.category, one.size_m[1]) is not Kind.ITEM)
        return Neighbourhood(self.walls, tuple(one for one in pieces if one.bottom_m == 0.0), self.seen.heading_rad)

    def _smaller(self, index: int, hidden_by: Iterable[int]) -> NDArray[np.bool_]:
        """(H, W) pixels in boxes of smaller things that are not fitted yet."""
        area_px = self.detections[index].area_px
        return self._in_boxes(one for one in hidden_by if one != index and self.detections[one].area_px < area_px)

    def _in_boxes(self, indices: Iterable[int]) -> NDArray[np.bool_]:
        """(H, W) pixels in boxes of those of some things that are not fitted yet."""
        mask = np.zeros(self.seen.z_m.shape, dtype=bool)
        for index in indices:
            if index not in self.fits:
                mask |= self.detections[index].pixels(self.seen.size_px)
        return mask

    def _heights(self, detection: Sighting, points: Array | None) -> list[float]:
        """Heights that a thing may stand on: those under its points, or without depth those behind its box's end."""
        tops = list(tops_of(self.fits.values()))
        if points is not None:
            of_box = self.seen.points_m[detection.pixels(self.seen.size_px) & self.seen.measured]
            return heights_under(points if len(points) >= LEAST_POINTS else of_box, tops)
        told = None if detection.on is None else self.fits.get(detection.on)
        return heights_behind(self.seen, detection, tops, told)
