"""What is known of a room so far, and what that says of one thing more."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array
from executor.photo.fitting.body import Guess, picture_of
from executor.photo.fitting.likelihood import Around, Fit
from executor.photo.fitting.prior import (
    CARRIED,
    Neighbourhood,
    is_large,
    is_outgrown,
    is_same_place,
    prior_cost,
    stands_in,
)
from executor.photo.fitting.starts import LEAST_POINTS, points_of
from executor.photo.inputs.annotations import Sighting
from executor.photo.room.supports import (
    EQUAL_M,
    SAME_M,
    heights_behind,
    heights_under,
    is_on_one,
    level_heights,
    tops_of,
)
from executor.photo.space.claim import Claim
from executor.photo.space.layers import Layers
from executor.photo.space.observation import Observation
from executor.photo.space.rescale import straightened
from executor.photo.space.standing_out import box_of
from executor.photo.space.walls import Wall
from llm.sight.forms import overlap
from oag import Kind, kind_of

UNLIKELY, IMPOSSIBLE = 10.0, 30.0
"""Prior cost of what stands in a wall, in others, or with its front against something, and hardly of a right fit; and
of what stands wholly in something: it is called wrongly."""

_AROUND = 0.2  # Of a box's sides, looked at around it for what carries its thing.
_DOUBTFUL, _DOUBTFUL_BENT = 0.75, 0.4  # Right names explain nine tenths and more, and less where depths are bent.
_LEAST_SEEN_PX = 40  # Half of the least piece that is looked at: of such a thing neither size nor turn is known.
BESIDE_BOX, _UNLIKE = 15.0, 50.0
"""Without depth, most that outline and fit of what is called rightly cost."""

LEAST_IN_BOX = 0.3
"""IoU of a box with the box around what is visible of its fit: with less the fit is of something else, or elsewhere."""

_BESIDE_SMALL_BOX = 5.0  # Where a box is of few pixels, half of it costs no more than 10.


class KnownRoom:
    """What is known so far: the fits, and the depth and face that each of them has in every pixel.

    Attributes:
        seen: The picture; its depths may be put right on the way.
        detections: The boxes, and after them what was found without one.
        boxed: How many boxes somebody has drawn.
        fits: index of a detection -> how it was fitted.
        reasons: index -> why it was not.
        scale_share: How exactly the picture's scale is known, as a share, where there is no depth.
    """

    def __init__(
        self, seen: Observation, walls: tuple[Wall, ...], detections: Sequence[Sighting], scale_share: float
    ) -> None:
        self.seen, self.detections, self.scale_share = seen, list(detections), scale_share
        self.boxed = len(self.detections)
        self.fits: dict[int, Fit] = {}
        self.reasons: dict[int, str] = {}
        self._layers = Layers(seen, walls)
        self._sighted = replace(seen, sight_first=True)

    @property
    def walls(self) -> tuple[Wall, ...]:
        """The walls."""
        return self._layers.walls

    @property
    def depth_m(self) -> Array:
        """(H, W) depth of all that is known."""
        return self._layers.together()[0]

    def keep(self, index: int, found: Fit | None) -> str:
        """Keeps a fit, and says what it is, or why there is none."""
        name = self.detections[index].label or "thing"
        if found is None:
            return f"{name}: {self.reasons[index]}"
        self.fits[index], self._layers.looks[index] = found, picture_of(found.guess, self.seen)
        return f"{name}: {found.guess.entry.model}"

    def take(self, index: int) -> Fit | None:
        """Takes a thing out of the room, and returns how it was fitted, if it was."""
        self._layers.looks.pop(index, None)
        return self.fits.pop(index, None)

    def look_for_walls(self) -> None:
        """Looks for walls in boxes, too, now that it is known which of their pixels are of things."""
        self._layers.look_for_walls([one for index, one in enumerate(self.detections) if index not in self.fits])

    def straighten(self) -> None:
        """Puts depths that are bent right by all that is known, as the floor did."""
        if not self.seen.bend_share:
            return
        beside = self.seen.measured & ~self._in_boxes(range(len(self.detections)))
        self.seen = replace(self.seen, z_m=straightened(self.seen.z_m, np.where(beside, self.depth_m, np.inf)))
        self._sighted = replace(self.seen, sight_first=True)

    def leave_out_what_is_inside(self) -> None:
        """Leaves out what nobody has put a box around and stands in other things, which were fitted better since.

        Of two items in one place one is what was left of the other, before that was fitted better.
        """
        alone = [index for index in self.fits if index >= self.boxed]
        for index in sorted(alone, key=lambda index: self.detections[index].area_px):
            guess = self.fits[index].guess
            others = (fit.guess for other, fit in self.fits.items() if other != index)
            is_odd = is_large(guess.entry) and self.unlikeliness(index) > IMPOSSIBLE
            is_left = stands_in(guess, self.pieces_beside(index)) or (is_odd and not self._carries_what_is_boxed(index))
            if is_left or any(is_same_place(guess, other) for other in others):
                self.take(index)
                self.reasons[index] = "what is left of other things, in which it would stand"

    def in_boxes(self) -> dict[int, float]:
        """Return the IoU of each thing's box with the box around what is visible of its fit, 0 to 1.

        Visible is what is in the picture and hidden by no other fit, nor by anything nearer that was measured.
        """
        shown = {}
        for index, visible in self._layers.visible().items():
            box_px = self.detections[index].box_px
            shown[index] = overlap(box_of(visible), box_px) if visible.any() else 0.0
        return shown

    def leave_out_what_is_outside_its_box(self) -> None:
        """Leave out fits of which too little is visible in the boxes that somebody has drawn, the worst one first.

        What it hid is visible then.
        """
        while shown := {index: share for index, share in self.in_boxes().items() if index < self.boxed}:
            worst = min(shown, key=lambda index: shown[index])
            share = shown[worst]
            if share >= LEAST_IN_BOX:
                return
            model = self.fits[worst].guess.entry.model
            self.take(worst)
            problem = (
                f"the best fit ({model}) is not in its box: what is visible of it has an IoU of {share:.2f} with it"
            )
            self.reasons[worst] = f"{problem}, and {LEAST_IN_BOX:g} is the least"

    def _carries_what_is_boxed(self, index: int) -> bool:
        """Whether something that has a box stands on it: then it is there, however odd."""
        raised = (fit.guess for other, fit in self.fits.items() if other < self.boxed and fit.guess.bottom_m > 0.0)
        tops = list(tops_of([self.fits[index]]))
        return any(is_on_one(guess, tops) for guess in raised)

    def is_doubtful(self, index: int) -> bool:
        """Decides whether a box may be called wrongly.

        With depth, what it is called explains too little, is seen through, or is in other things; where depths are
        bent it may explain less if it looks right. Without, it does not fill its box, or looks otherwise.
        """
        if index not in self.fits:
            return True
        found = self.fits[index]
        if not self.seen.has_depth:
            # What furniture carries is as far off as that is, and fits no better; of what is assumed nothing is seen.
            is_carried = self.detections[index].category in CARRIED and found.guess.bottom_m > 0.0
            told = is_carried or bool(found.assumed)
            return not told and _is_unlike(found)
        # What is small may be farther off in bent depths than it is thick: what looks right there may be right.
        least = _DOUBTFUL if self.seen.is_exact or _is_unlike(found) else _DOUBTFUL_BENT
        return found.explained < least or self.is_seen_through(index) or self.is_impossible(index)

    def is_impossible(self, index: int) -> bool:
        """Decides whether a thing would stand in what it cannot; of two in each other, the one that explains less."""
        found = self.fits.get(index)
        if found is None:
            return False
        others = [other for other, fit in self.fits.items() if other != index and fit.explained >= found.explained]
        return prior_cost(found.guess, self._near(others)) > IMPOSSIBLE

    def doubt(self, index: int) -> float:
        """Returns what says which of two fits is rather the wrong one: what they leave unexplained, or unlikeliness."""
        found = self.fits.get(index)
        return self.unlikeliness(index) if found is None or not self.seen.has_depth else 1.0 - found.explained

    def unlikeliness(self, index: int) -> float:
        """Returns how much speaks against a fit before anything is seen, among all that is known now."""
        found = self.fits.get(index)
        return 0.0 if found is None else prior_cost(found.guess, self._near(self._besides(index)))

    def is_in_air(self, index: int) -> bool:
        """Decides whether what a thing was put on has been taken for something else since.

        By sight, a top that is a little higher has what stands on it elsewhere.
        """
        found = self.fits.get(index)
        return found is not None and not self._is_on_one(found.guess)

    def on_nothing_but(self, index: int) -> list[int]:
        """Returns what is raised and on no top but a thing's, or on none at all."""
        tops = list(tops_of(self.fits[other] for other in self._besides(index)))
        raised = (other for other in self._besides(index) if self.fits[other].guess.bottom_m > 0.0)
        return [other for other in raised if not is_on_one(self.fits[other].guess, tops, EQUAL_M)]

    def hangs_in_air(self, guess: Guess) -> bool:
        """Decides whether furniture would have nothing under it: by sight, what is smaller and nearer looks alike."""
        is_raised = guess.bottom_m > 0.0 and is_large(guess.entry)
        return is_raised and not self._is_on_one(guess)

    def is_doubtful_in_air(self, found: Fit) -> bool:
        """Decides whether a fit stands on nothing that is known, and explains too little to wait for that."""
        return found.explained < _DOUBTFUL and not self._is_on_one(found.guess)

    def _is_on_one(self, guess: Guess) -> bool:
        within_m = SAME_M if self.seen.is_exact else EQUAL_M
        return is_on_one(guess, tops_of(self.fits.values()), within_m)

    def is_on_nothing(self, found: Fit) -> bool:
        """Decides whether by sight an item stands on the floor only since nothing else was found that it stands on.

        It would have to be too large there, or looks otherwise.
        """
        guess = found.guess
        if self.seen.has_depth or guess.bottom_m > 0.0 or is_large(guess.entry):
            return False
        return is_outgrown(guess) or _is_unlike(found) or found.beside_box > _BESIDE_SMALL_BOX

    def is_seen_through(self, index: int) -> bool:
        """Decides whether farther things are seen where a fit says that it is."""
        return self._claim_of(index).seen_through

    def claimed_px(self, index: int) -> tuple[float, float, float, float] | None:
        """Returns the box of what is seen of a fit, None where nothing is."""
        return self._claim_of(index).box_px

    def is_there(self, index: int, found: Fit, around: Around) -> bool:
        """Decides whether a fit that nobody has named is seen wherever it says, and is what a box was drawn around.

        Without depth, it is enough that it stands in nothing else.
        """
        if not self.seen.has_depth:
            return not stands_in(found.guess, around.near.pieces)
        claim = self.claim(found.guess, around)
        if index < self.boxed:
            is_it = claim.fills(self.detections[index].box_px)
        else:
            # What is left of a thing that was misjudged is explained by another one in it.
            is_it = not stands_in(found.guess, around.near.pieces)
        return is_it and claim.is_borne_out(_LEAST_SEEN_PX, boxed=index < self.boxed)

    def claim(self, guess: Guess, around: Around) -> Claim:
        """Returns what a guess says of the picture's pixels."""
        return Claim.of(self.seen, picture_of(guess, self.seen)[0], around.other_m, guess.corners_m())

    def around(self, index: int, hidden_by: Iterable[int] = (), *, by_depth: bool = False) -> Around:
        """Returns all that a search for a thing that was taken out has to know besides it.

        Args:
            index: Which one.
            hidden_by: Detections whose boxes may be of what is in front of it, where they are smaller.
            by_depth: Whether depths tell its place though they are not exact, and the picture would tell it better.
        """
        own = self.detections[index]
        # What nobody has put a box around is no part of what somebody has.
        most_px = own.area_px if index < self.boxed else math.inf
        smaller = (one for one in hidden_by if one != index and self.detections[one].area_px < most_px)
        foreign = self._in_boxes(smaller)
        seen = self.seen if by_depth or self.seen.is_exact else self._sighted
        return Around(seen, *self._layers.together(), foreign, self._near(self.fits), self.scale_share, own.mask)

    def points(self, detection: Sighting, around: Around) -> Array | None:
        """Returns (N, 3) that are most likely a thing's own; None where there is no depth."""
        if not self.seen.has_depth:
            return None
        if detection.mask is not None:
            return np.asarray(self.seen.points_m[detection.mask & self.seen.measured])
        return points_of(self.seen, detection.box_px, around.other_m, around.smaller)

    def heights_m(self, detection: Sighting, points: Array | None) -> list[float]:
        """Returns heights that a thing may stand on: those under its points, or without depth behind its box's end."""
        tops = list(tops_of(self.fits.values()))
        if points is not None:
            of_box = self.seen.points_m[detection.pixels(self.seen.size_px) & self.seen.measured]
            under = heights_under(points if len(points) >= LEAST_POINTS else of_box, tops)
            if detection.category not in CARRIED or any(under) or not self.seen.is_exact:
                return under
            # Where nobody has drawn a box around what carries it, that is found when this is known.
            around = replace(detection, box_px=_widened(detection.box_px), mask=None).pixels(self.seen.size_px)
            return level_heights(self.seen.points_m[around & self.seen.measured])
        told = None if detection.on is None else self.fits.get(detection.on)
        return heights_behind(self.seen, detection, tops, told)

    def pieces_beside(self, index: int) -> tuple[Guess, ...]:
        """Returns the furniture besides a thing."""
        return self._near(self._besides(index)).pieces

    def _besides(self, index: int) -> list[int]:
        return [other for other in self.fits if other != index]

    def _near(self, indices: Iterable[int]) -> Neighbourhood:
        guesses = [self.fits[index].guess for index in indices]
        pieces = (one for one in guesses if kind_of(one.entry.category, one.size_m[1]) is not Kind.ITEM)
        standing = tuple(one for one in pieces if one.bottom_m == 0.0)
        return Neighbourhood(self.walls, standing, self.seen.heading_rad, without_depth=not self.seen.has_depth)

    def _claim_of(self, index: int) -> Claim:
        """What a fit says of the picture's pixels, among all else that is known."""
        (own_m, _), (others_m, _) = self._layers.looks[index], self._layers.together(besides=index)
        return Claim.of(self.seen, own_m, others_m, self.fits[index].guess.corners_m())

    def _in_boxes(self, indices: Iterable[int]) -> NDArray[np.bool_]:
        """(H, W) pixels in boxes of those of some things that are not fitted yet."""
        mask = np.zeros(self.seen.z_m.shape, dtype=bool)
        for index in indices:
            if index not in self.fits:
                mask |= self.detections[index].pixels(self.seen.size_px)
        return mask


def _is_unlike(found: Fit) -> bool:
    """Whether by sight a fit does not fill its box, or looks otherwise."""
    return found.beside_box > BESIDE_BOX or found.cost > _UNLIKE


def _widened(box_px: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """A box with a part of what is around it, such as the top that its thing stands on."""
    x0, y0, x1, y1 = box_px
    over_x, over_y = _AROUND * (x1 - x0), _AROUND * (y1 - y0)
    return max(0.0, x0 - over_x), max(0.0, y0 - over_y), x1 + over_x, y1 + over_y
