"""Prior and likelihood of pose hypotheses; fits and their uncertainty.

The prior has the sizes of models and how furniture stands in rooms. The likelihood adds depth, box and colours.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.evidence import PixelEvidence
from executor.photo.fitting.hypothesis import MeshRaycaster, PoseHypothesis, Size, is_round, largest_m, raycaster_of
from executor.photo.geometry.observation import Observation
from executor.photo.geometry.walls import Wall
from executor.scenes.models import ABSURD
from oag.model.symbols import Kind, kind_of

_BEYOND_M = 0.015  # A size beyond its model's range costs one half for each square of this.
_BEYOND_RATIO = 0.03
_AGAINST_M, _AGAINST_SIGMA_M, _AGAINST_WEIGHT, _FAR_M = 0.012, 0.015, 1.5, 0.35
"""Furniture near a wall stands against it, a skirting's width away. The gradient never vanishes: it is the only
evidence for hidden sides, above all a piece's depth."""

_FLUSH_SIGMA_M, _FLUSH_WEIGHT, _FLUSH_FAR_M = 0.008, 0.8, 0.15  # Furniture in a row touches.
_OPEN, _OPEN_BEHIND = 4.0, 29.0
"""Penalties for an open door, as doors are mostly shut, and for one seen from behind: usually an undetected wall."""

_ALIKE_M, _ALIKE_MOST = 0.01, 40.0  # Units of a kitchen come in one height and one depth.
_INTO_SIGMA_M, _INTO_MOST = 0.01, 30.0  # Nothing stands in a wall.
_ALIGNED_SIGMA_RAD, _ALIGNED_MOST = math.radians(1.5), 2.5  # Furniture mostly stands along walls.
_TURNED_AWAY, _FROM_BEHIND = 6.0, 24.0
"""Fronts are mostly visible: pictures of rooms are taken of them. Without depth, a piece seen from behind is most
likely another one: backs are as plain as pieces without a front."""

_BLOCKED, _BEFORE_M = 25.0, 0.15  # Doors and drawers do not face a wall or a bed.
_SMALLEST_M = 0.008
_OUTGROWN = 1.1  # Of the largest that a model comes as.
_SAME_PLACE, _SAME_SIZE = 0.4, 1.6  # Of the least side; of two things' sides.
OF_RANGE = 0.29
"""Standard deviation of a uniform distribution over a range, as is assumed of models' sizes."""

_ASKEW, _FACING = math.sin(2 * math.radians(8.0)), math.cos(math.radians(8.0))
_OPENS = ("refrigerator", "bottom_cabinet", "nightstand", "wardrobe", "desk_with_drawers", "microwave", "oven")
_FRONTED = (*_OPENS, "dishwasher", "shelf")
UNITS = ("bottom_cabinet", "countertop", "dishwasher", "oven")
"""Furniture of one row in a kitchen."""

AT_WALLS = (*_FRONTED, "countertop", "bed", "sofa")
"""Furniture that mostly stands with its back to a wall."""

CARRIED = ("microwave",)
"""Furniture that stands on furniture."""


Flat: TypeAlias = tuple[float, float]
"""A vector along the floor."""


@dataclass(frozen=True)
class Neighbourhood:
    """Surroundings of an object.

    Attributes:
        walls: The walls.
        pieces: The other known furniture.
        heading_rad: Without walls, one of the main directions of the room's lines, if there is one.
        without_depth: Whether nothing is measured and no wall is known: pieces then constrain each other.
    """

    walls: tuple[Wall, ...]
    pieces: tuple[PoseHypothesis, ...] = ()
    heading_rad: float | None = None
    without_depth: bool = False

    @property
    def headings_rad(self) -> tuple[float, ...]:
        """Usual headings of furniture, each up to quarter turns."""
        lines = () if self.heading_rad is None else (self.heading_rad,)
        return (*(wall.yaw_rad for wall in self.walls), *lines)


def prior_cost(guess: PoseHypothesis, around: Neighbourhood) -> float:
    """Return the prior cost of a hypothesis, a negative logarithm; infinite if it is impossible."""
    entry, (length, width, height) = guess.entry, guess.size_m
    if any(not low <= value <= high for value, (low, high) in zip(guess.size_m, _possible_m(entry), strict=True)):
        return math.inf
    if guess.bottom_m > 0.0 and is_large(entry) and entry.category not in CARRIED:
        return math.inf
    cost = 0.0
    for value, span in ((length, entry.length), (width, entry.width), (height, entry.height)):
        unit = width if span.of_width else 1.0
        sigma = _BEYOND_RATIO * width if span.of_width else _BEYOND_M
        beyond = max(span.low * unit - value, value - span.high * unit, 0.0)
        cost += 0.5 * (beyond / sigma) ** 2
    ahead = math.cos(guess.yaw_rad), math.sin(guess.yaw_rad)
    facing = _dot(ahead, (guess.x_m, guess.y_m)) / max(math.hypot(guess.x_m, guess.y_m), 1e-9)
    away = entry.category in _FRONTED and facing < 0.0
    cost += _TURNED_AWAY - _FROM_BEHIND * facing * around.without_depth if away else 0.0
    opened = bool(dict(guess.parameters).get("open_fraction"))
    if entry.category in _FRONTED and _is_blocked(guess, around, ahead):
        # An open door has room to open.
        cost += math.inf if opened else _BLOCKED
    if opened:
        cost += _OPEN_BEHIND if away else _OPEN
    if kind_of(entry.category, width) is Kind.ITEM:
        return cost
    if around.headings_rad and not is_round(entry):
        turned = min(abs(math.remainder(guess.yaw_rad - heading, math.pi / 2)) for heading in around.headings_rad)
        cost += min(0.5 * (turned / _ALIGNED_SIGMA_RAD) ** 2, _ALIGNED_MOST)
    if around.without_depth:
        cost += _at_one_wall_cost(guess, around.pieces, ahead)
    return cost + _wall_cost(guess, around.walls, ahead) + _row_cost(guess, around.pieces, ahead)


@cache
def _possible_m(entry: ModelEntry) -> tuple[Flat, ...]:
    """Return the limits of length, width and height of a model: a scene accepts no others."""
    spans = (entry.length, entry.width, entry.height)
    low = (span.low * (entry.width.low if span.of_width else 1.0) for span in spans)
    ends = zip(low, largest_m(entry), strict=True)
    return tuple((max(least / ABSURD, _SMALLEST_M), most * ABSURD) for least, most in ends)


def is_large(entry: ModelEntry) -> bool:
    """Return whether a model is furniture."""
    return kind_of(entry.category, entry.width.low) is not Kind.ITEM


def is_oversized(guess: PoseHypothesis) -> bool:
    """Return whether a hypothesis is larger than its model ever is, as one that is placed too far off."""
    return any(value > _OUTGROWN * most for value, most in zip(guess.size_m, largest_m(guess.entry), strict=True))


def usual_size_m(entry: ModelEntry) -> Size:
    """Return the middle of a model's sizes: length, width, height."""
    width = (entry.width.low + entry.width.high) / 2
    length, height = (
        (span.low + span.high) / 2 * (width if span.of_width else 1.0) for span in (entry.length, entry.height)
    )
    return length, width, height


def usual_size_cost(guess: PoseHypothesis) -> float:
    """Return the cost of a hypothesis against the usual size of its model, which gives sizes without depth."""
    entry, (length, width, height) = guess.entry, guess.size_m
    cost = 0.0
    for value, span in ((length, entry.length), (width, entry.width), (height, entry.height)):
        unit = width if span.of_width else 1.0
        sigma = max((span.high - span.low) * unit * OF_RANGE, _BEYOND_M)
        cost += 0.5 * ((value - (span.low + span.high) / 2 * unit) / sigma) ** 2
    return cost


def stands_in(guess: PoseHypothesis, pieces: Sequence[PoseHypothesis]) -> bool:
    """Return whether the middle of an object on the floor is inside one of some pieces."""
    return guess.bottom_m == 0.0 and any(_is_over(piece, guess.x_m, guess.y_m) for piece in pieces)


def is_same_place(guess: PoseHypothesis, other: PoseHypothesis) -> bool:
    """Return whether two objects of about one size have their middles in one place, unlike an item in a bowl."""
    off_m = math.dist(
        (guess.x_m, guess.y_m, guess.bottom_m + guess.size_m[2] / 2),
        (other.x_m, other.y_m, other.bottom_m + other.size_m[2] / 2),
    )
    ratios = (one / two for one, two in zip(guess.size_m, other.size_m, strict=True))
    alike = all(1.0 / _SAME_SIZE < ratio < _SAME_SIZE for ratio in ratios)
    return alike and off_m < _SAME_PLACE * min(guess.size_m)


def _is_over(piece: PoseHypothesis, x_m: float, y_m: float) -> bool:
    c, s = math.cos(piece.yaw_rad), math.sin(piece.yaw_rad)
    x, y = x_m - piece.x_m, y_m - piece.y_m
    return abs(c * x + s * y) < piece.size_m[0] / 2 and abs(c * y - s * x) < piece.size_m[1] / 2


def _dot(first: Flat, second: Flat) -> float:
    """Dot product of two short vectors, in a tenth of numpy's time: searches call it very often."""
    return first[0] * second[0] + first[1] * second[1]


def _is_blocked(guess: PoseHypothesis, around: Neighbourhood, ahead: Flat) -> bool:
    """Return whether a wall or other furniture in front of a piece blocks its doors or drawers."""
    middle, before_m = (guess.x_m, guess.y_m), guess.size_m[0] / 2 + _BEFORE_M
    before = guess.x_m - before_m * ahead[0], guess.y_m - before_m * ahead[1]
    for wall in around.walls:
        across, along, offset_m, (low_m, high_m) = _plane(wall)
        # It may also stand in the room beyond, into which the camera looks over the wall.
        parted = (_dot(before, across) < offset_m) is not (_dot(middle, across) < offset_m)
        if parted and low_m < _dot(before, along) < high_m:
            return True
    return guess.bottom_m == 0.0 and any(_is_over(piece, *before) for piece in around.pieces)


def _plane(wall: Wall) -> tuple[Flat, Flat, float, Flat]:
    """Return a wall's directions across and along, its offset and its span, as plain numbers."""
    x, y = wall.normal.tolist()
    return (x, y), (-y, x), wall.offset_m, wall.span_m


def _row_cost(guess: PoseHypothesis, pieces: Sequence[PoseHypothesis], ahead: Flat) -> float:
    """Return the cost of gaps to neighbours in a row, and of overlaps with them."""
    aside, cost = (-ahead[1], ahead[0]), 0.0
    for piece in pieces if guess.bottom_m == 0.0 else ():
        turned = piece.yaw_rad - guess.yaw_rad
        if abs(math.sin(2 * turned)) > _ASKEW:
            continue
        away = piece.x_m - guess.x_m, piece.y_m - guess.y_m
        across = abs(math.cos(turned)) < 0.5
        length, width = piece.size_m[1::-1] if across else piece.size_m[:2]
        gap_x = abs(_dot(away, ahead)) - (length + guess.size_m[0]) / 2
        gap_y = abs(_dot(away, aside)) - (width + guess.size_m[1]) / 2
        if (gap_x < -_FLUSH_FAR_M and gap_y < 0.0) or (gap_x < 0.0 and gap_y < -_FLUSH_FAR_M):
            cost += min(0.5 * (max(gap_x, gap_y) / _INTO_SIGMA_M) ** 2, _INTO_MOST)
        if gap_x < -_FLUSH_FAR_M and abs(gap_y) < _FLUSH_FAR_M:
            cost += _FLUSH_WEIGHT * math.log1p(0.5 * (gap_y / _FLUSH_SIGMA_M) ** 2)
        elif gap_x < -_FLUSH_FAR_M and gap_y > 0.0:
            cost += _FLUSH_WEIGHT * math.log1p(0.5 * (_FLUSH_FAR_M / _FLUSH_SIGMA_M) ** 2)
    return cost


def in_rows(guess: PoseHypothesis, pieces: Sequence[PoseHypothesis]) -> Iterator[PoseHypothesis]:
    """Yield a kitchen unit moved and stretched to the depth and height of another one in its row.

    Those of its own height are left out.
    """
    ahead = math.cos(guess.yaw_rad), math.sin(guess.yaw_rad)
    units = [piece for piece in pieces if {guess.entry.category, piece.entry.category} <= {*UNITS}]
    heights = {guess.size_m[2]}
    for piece in _facing_alike(guess, units):
        length, _, height = piece.size_m
        if min(abs(height - other) for other in heights) < _ALIKE_M:
            continue
        heights.add(height)
        by_m = _dot((piece.x_m - guess.x_m, piece.y_m - guess.y_m), ahead)
        x, y = guess.x_m + by_m * ahead[0], guess.y_m + by_m * ahead[1]
        yield replace(guess, x_m=x, y_m=y, size_m=(length, guess.size_m[1], height))


def _facing_alike(guess: PoseHypothesis, pieces: Sequence[PoseHypothesis]) -> Iterator[PoseHypothesis]:
    """Yield the pieces at walls whose backs are on the same side."""
    for piece in (one for one in pieces if one.entry.category in AT_WALLS):
        facing = math.cos(piece.yaw_rad - guess.yaw_rad)
        # The front of a counter is invisible.
        have_fronts = guess.entry.category in _FRONTED and piece.entry.category in _FRONTED
        if (facing if have_fronts else abs(facing)) > _FACING:
            yield piece


def _at_one_wall_cost(guess: PoseHypothesis, pieces: Sequence[PoseHypothesis], ahead: Flat) -> float:
    """Without known walls, cost of not standing against the wall of equally facing pieces, and of other sizes."""
    if guess.entry.category not in AT_WALLS or guess.bottom_m > 0.0:
        return 0.0
    apart_m, unlike = _FAR_M, 0.0
    for piece in _facing_alike(guess, pieces):
        away = piece.x_m - guess.x_m, piece.y_m - guess.y_m
        behind_m = abs(_dot(away, ahead) - (piece.size_m[0] - guess.size_m[0]) / 2)
        apart_m = min(apart_m, behind_m)
        if behind_m < _FAR_M and {guess.entry.category, piece.entry.category} <= {*UNITS}:
            off = [(one - other) / _ALIKE_M for one, other in zip(guess.size_m, piece.size_m, strict=True)]
            unlike = max(unlike, min(0.5 * (off[0] ** 2 + off[2] ** 2), _ALIKE_MOST))
    return unlike + _against(apart_m + _AGAINST_M)


def _wall_cost(guess: PoseHypothesis, walls: Sequence[Wall], ahead: Flat) -> float:
    if not walls:
        return 0.0
    aside, at, (length, width, _) = (-ahead[1], ahead[0]), (guess.x_m, guess.y_m), guess.size_m
    cost = 0.0
    against = _against(_FAR_M)
    for wall in walls:
        across, along, offset_m, (low_m, high_m) = _plane(wall)
        reach = length / 2 * abs(_dot(ahead, across)) + width / 2 * abs(_dot(aside, across))
        if is_round(guess.entry):
            reach = width / 2
        gap = _dot(at, across) - offset_m - reach
        if not low_m - 0.3 < _dot(at, along) < high_m + 0.3:
            continue
        if gap < 0.0 < gap + 2 * reach:
            cost += min(0.5 * (gap / _INTO_SIGMA_M) ** 2, _INTO_MOST)
        if _dot(ahead, across) < -0.97:
            against = min(against, _against(gap))
    return cost + (against if guess.entry.category in AT_WALLS else 0.0)


def _against(gap_m: float) -> float:
    return _AGAINST_WEIGHT * math.log1p(0.5 * ((min(gap_m, _FAR_M) - _AGAINST_M) / _AGAINST_SIGMA_M) ** 2)


_STEPS = np.array([0.02, 0.02, 0.05, 0.01, 0.01, 0.01])  # Metres and radians, over which costs are about quadratic.
_LOOSEST = 1e-3  # Of the sharpest direction: looser ones are unknown.
_MOST_M = 1.0
_HIGHEST = 1e6  # Cost of impossible hypotheses in differences.
_FARTHEST_M = 10.0  # In a room.
_PLACED_M = 0.1  # Uncertainty of a place that suffices for a plan.


@dataclass(frozen=True)
class RatedHypothesis:
    """A hypothesis with its cost, a negative logarithm of likelihood."""

    guess: PoseHypothesis
    cost: float


def by_cost(guesses: Iterable[RatedHypothesis]) -> list[RatedHypothesis]:
    """Sort hypotheses, cheapest first."""
    return sorted(guesses, key=lambda one: one.cost)


def best_of_models(guesses: Iterable[RatedHypothesis]) -> list[RatedHypothesis]:
    """Return the cheapest hypothesis of each model, cheapest first."""
    best: dict[str, RatedHypothesis] = {}
    for one in by_cost(guesses):
        best.setdefault(one.guess.entry.model, one)
    return list(best.values())


@dataclass(frozen=True)
class Likelihood:
    """Likelihood of the hypotheses of one object.

    Attributes:
        evidence: Its pixels at one resolution.
        near: The walls and the other furniture.
        scale_share: Relative uncertainty of the picture's scale, without depth.
    """

    evidence: PixelEvidence
    near: Neighbourhood
    scale_share: float = 0.0

    def box_cost(self, guess: PoseHypothesis) -> float:
        """Return the cost by box and prior; infinite for an impossible hypothesis."""
        cost = self.evidence.box_cost(guess) + prior_cost(guess, self.near)
        if not self.evidence.observation.monocular:
            return cost
        # Near the horizon, a little of the picture is many metres.
        return cost + usual_size_cost(guess) if math.hypot(guess.x_m, guess.y_m) < _FARTHEST_M else math.inf

    def cost(self, guess: PoseHypothesis, body: MeshRaycaster | None = None, *, colours: bool = True) -> float:
        """Return the cost of a hypothesis, infinite if it cannot be built.

        Args:
            guess: The hypothesis.
            body: Raycaster to use, scaled to its size; by default that of its own size.
            colours: Whether colours are evaluated, which is slower; without depth they are the main evidence.
        """
        cost, evidence = self.box_cost(guess), self.evidence
        body = (body or raycaster_of(guess)) if math.isfinite(cost) else None
        if body is None:
            return math.inf
        if not colours:
            return cost + evidence.cost(guess, body)
        depth, group = body.render_depth(guess, evidence.observation.eye_m, evidence.rays, evidence.other)
        return cost + evidence.depth_cost(depth) + evidence.colour_cost(depth, group)

    def rated(self, guess: PoseHypothesis, *, colours: bool = True) -> RatedHypothesis:
        """Return a hypothesis with its cost."""
        return RatedHypothesis(guess, self.cost(guess, colours=colours))

    def better(self, best: RatedHypothesis, guess: PoseHypothesis, *, colours: bool = True) -> RatedHypothesis:
        """Return the cheaper of two hypotheses, the first one if they are equal."""
        cost = self.cost(guess, colours=colours)
        return RatedHypothesis(guess, cost) if cost < best.cost - 1e-6 else best


@dataclass(frozen=True)
class Fit:
    """The best explanation of one object.

    Attributes:
        guess: The best hypothesis.
        cost: Its cost. With depth only differences between hypotheses of one object are meaningful; without, a good fit
            costs about nothing or less.
        alternatives: The best hypothesis of every other model, best first.
        explained: Share of the object's pixels that it explains.
        residual_m: Median distance between its surface and the measured depth.
        pixels: How many pixels were compared at the end.
        colour: Median colour of its visible pixels, sRGB from 0 to 255; None if it is hidden.
        spread_m: Standard deviation of its place on the floor; None with depth, where the residual serves.
        assumed: If none of its sides are visible, the assumption made, for people.
        outline_misfit: Cost of its outline against its box, see `PixelEvidence.box_cost`.
        in_box: IoU of its box with the box around its visible part; 1 until it is computed.
    """

    guess: PoseHypothesis
    cost: float
    alternatives: tuple[RatedHypothesis, ...]
    explained: float
    residual_m: float
    pixels: int
    colour: tuple[int, int, int] | None
    spread_m: float | None = None
    assumed: str = ""
    outline_misfit: float = 0.0
    in_box: float = 1.0

    @property
    def likelier(self) -> float:
        """0 to 1: likelihood against the best hypothesis of any other model."""
        if not self.alternatives:
            return 1.0
        return 1.0 / (1.0 + math.exp(-min(50.0, self.alternatives[0].cost - self.cost)))

    @property
    def placed(self) -> float:
        """0 to 1: the probability that its place on the floor is off by less than 10 cm, by its spread.

        With depth, by its depth residual, which is larger than the error of its place.
        """
        off_m = self.residual_m if self.spread_m is None else self.spread_m
        return 1.0 - math.exp(-0.5 * (_PLACED_M / max(off_m, 1e-6)) ** 2)

    @property
    def confidence(self) -> float:
        """0 to 1: the product of likelihood, explained share, agreement with the box and exactness of the place."""
        return self.likelier * self.explained * self.in_box * self.placed


def best_of_fits(fits: Iterable[Fit]) -> Fit | None:
    """Return the cheapest of some fits of one object, with the others among its alternatives; None of none."""
    ranked = sorted(fits, key=lambda one: one.cost)
    others = [other for one in ranked for other in (RatedHypothesis(one.guess, one.cost), *one.alternatives)]
    return replace(ranked[0], alternatives=tuple(by_cost(others[1:]))) if ranked else None


@dataclass(frozen=True)
class SearchContext:
    """Context of a search: everything known besides the object.

    Attributes:
        observation: The picture.
        other_m, other: (H, W) depth of everything else known, and its face number.
        smaller: (H, W) pixels in boxes of smaller objects.
        near: The walls and the other furniture.
        scale_share: Relative uncertainty of the picture's scale, without depth.
        own: (H, W) the object's own pixels, if they are known.
    """

    observation: Observation
    other_m: Array
    other: NDArray[np.int32]
    smaller: NDArray[np.bool_]
    near: Neighbourhood
    scale_share: float = 0.0
    own: NDArray[np.bool_] | None = None


def place_spread_m(likelihood: Likelihood, guess: PoseHypothesis) -> float:
    """Return the standard deviation of an object's place on the floor, in its worst direction.

    It follows from the growth of costs around the hypothesis (Laplace's approximation): if an object slightly farther
    and larger costs the same, its place is uncertain. Colours are left out: they underestimate the spread.

    Args:
        likelihood: The likelihood.
        guess: The hypothesis.
    """
    count = len(_STEPS)
    here = _moved(likelihood, guess, {})
    single = np.array([[_moved(likelihood, guess, {i: sign}) for sign in (-1.0, 1.0)] for i in range(count)])
    curved = np.zeros((count, count))
    for i in range(count):
        curved[i, i] = single[i, 0] + single[i, 1] - 2 * here
        for j in range(i):
            both = _moved(likelihood, guess, {i: 1.0, j: 1.0})
            curved[i, j] = curved[j, i] = both - single[i, 1] - single[j, 1] + here
    values, axes = np.linalg.eigh(curved)
    variances = 1.0 / np.maximum(values, max(_LOOSEST * float(values.max()), 1e-9))
    covariance = (axes * variances) @ axes.T * np.outer(_STEPS, _STEPS)
    worst = math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[:2, :2]).max())))
    return min(_MOST_M, math.hypot(worst, likelihood.scale_share * math.hypot(guess.x_m, guess.y_m)))


def _moved(likelihood: Likelihood, guess: PoseHypothesis, steps: dict[int, float]) -> float:
    by: Array = np.zeros(len(_STEPS))
    for index, sign in steps.items():
        by[index] = sign * _STEPS[index]
    length, width, height = guess.size_m
    size = length + float(by[3]), width + float(by[4]), height + float(by[5])
    one = replace(guess, x_m=guess.x_m + by[0], y_m=guess.y_m + by[1], yaw_rad=guess.yaw_rad + by[2], size_m=size)
    return min(likelihood.box_cost(one), _HIGHEST)
