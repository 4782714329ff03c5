"""Prior and likelihood of pose hypotheses; fits and their uncertainty.

The prior has the sizes of models and how furniture stands in rooms. The likelihood adds depth, box and colours.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from executor.assets.families.generic import LEAN, WITH_BACK
from executor.assets.footprint import region_frame
from executor.assets.library import asset_for
from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.evidence import PixelEvidence
from executor.photo.fitting.hypothesis import MeshRaycaster, PoseHypothesis, Size, is_round, largest_m, raycaster_of
from executor.photo.geometry.observation import Observation
from executor.photo.geometry.walls import Wall
from executor.photo.inputs.usual import is_folding
from executor.scenes.models import ABSURD
from oag.model.symbols import Kind, has_boards, kind_of

_BEYOND_M = 0.015  # A size beyond its model's range costs one half for each square of this.
_BEYOND_RATIO = 0.03
_AGAINST_M, _AGAINST_SIGMA_M, _AGAINST_WEIGHT, _FAR_M = 0.012, 0.015, 1.5, 0.35
"""Furniture near a wall stands against it, a skirting's width away. The gradient never vanishes: it is the only
evidence for hidden sides, above all a piece's depth."""

_FLUSH_SIGMA_M, _FLUSH_WEIGHT, _FLUSH_FAR_M = 0.008, 0.8, 0.15  # Furniture in a row touches.
_OPEN, _OPEN_BEHIND = 4.0, 29.0
"""Penalties for an open door, as doors are mostly shut, and for one seen from behind: usually an undetected wall."""

_INTO_SIGMA_M, _INTO_MOST = 0.01, 30.0  # Nothing stands in a wall.
_ALIGNED_SIGMA_RAD, _ALIGNED_MOST = math.radians(1.5), 2.5  # Furniture mostly stands along walls.
_TURNED_AWAY = 6.0  # Fronts are mostly visible: pictures of rooms are taken of them.
_BLOCKED, _BEFORE_M = 25.0, 0.15  # Doors and drawers do not face a wall or a bed.
_SMALLEST_M = 0.008
OF_RANGE = 0.29
"""Standard deviation of a uniform distribution over a range, as is assumed of models' sizes."""

_ASKEW = math.sin(2 * math.radians(8.0))
_OPENS = ("refrigerator", "bottom_cabinet", "nightstand", "wardrobe", "desk_with_drawers", "microwave", "oven")
_FRONTED = (*_OPENS, "dishwasher", "shelf")
AT_WALLS = (*_FRONTED, "countertop", "bed", "sofa")
"""Furniture that mostly stands with its back to a wall."""

_WITH_BACK = 20.0  # Of two slabs: few things are, and with a leaning one they imitate what is a little uneven.
_RARE, _RARER = (
    5.0,
    ("generic_cylinder", "generic_slab_on_legs"),
)  # What is thin looks like all of them; most are boxes.
_SIDEWAYS, _COVERS = 10.0, 0.1  # Of one that is turned by a right angle; logarithm of the ratio of their lengths.

NO_FEET: Array = np.zeros((0, 3))
"""Of what carries nothing."""

_FOOT_HIGH_M, _FOOT_ASIDE_M, _FOOT_MOST, FOOT_USUAL = 0.004, 0.02, 80.0, 8.0
"""Spreads of a foot about the height of its top, and beyond that one's edge. Most that it costs, since it may be
elsewhere, and most where it is there."""

CARRIED = ("microwave", "wall_cabinet")
"""Furniture that stands on furniture, or hangs."""


Flat: TypeAlias = tuple[float, float]
"""A vector along the floor."""


@dataclass(frozen=True)
class Neighbourhood:
    """Surroundings of an object.

    Attributes:
        walls: The walls.
        pieces: The other known furniture.
        heading_rad: Without walls, one of the main directions of the room's lines, if there is one.
    """

    walls: tuple[Wall, ...]
    pieces: tuple[PoseHypothesis, ...] = ()
    heading_rad: float | None = None

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
    cost = 0.0
    for value, span in ((length, entry.length), (width, entry.width), (height, entry.height)):
        unit = width if span.of_width else 1.0
        sigma = _BEYOND_RATIO * width if span.of_width else _BEYOND_M
        beyond = max(span.low * unit - value, value - span.high * unit, 0.0)
        cost += 0.5 * (beyond / sigma) ** 2
    ahead = math.cos(guess.yaw_rad), math.sin(guess.yaw_rad)
    facing = _dot(ahead, (guess.x_m, guess.y_m)) / max(math.hypot(guess.x_m, guess.y_m), 1e-9)
    away = entry.category in _FRONTED and facing < 0.0
    cost += _TURNED_AWAY if away else 0.0
    cost += _back_cost(guess, facing) if entry.model == WITH_BACK else 0.0
    cost += _RARE if entry.model in _RARER else 0.0
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


def usual_size_m(entry: ModelEntry) -> Size:
    """Return the middle of a model's sizes: length, width, height."""
    width = (entry.width.low + entry.width.high) / 2
    length, height = (
        (span.low + span.high) / 2 * (width if span.of_width else 1.0) for span in (entry.length, entry.height)
    )
    return length, width, height


class TopShares(NamedTuple):
    """A top of a model in shares of its size: height, middle and half sides."""

    high: float = 1.0
    x: float = 0.0
    y: float = 0.0
    half_x: float = 0.5
    half_y: float = 0.5


@cache
def top_shares(entry: ModelEntry, *, hollows: bool = False) -> tuple[TopShares, ...]:
    """Return the tops and boards of a model as it has them at its usual size, the highest first.

    Args:
        entry: The model.
        hollows: Whether the floors of its hollows are among them.
    """
    length, width, height = size_m = usual_size_m(entry)
    thing = PoseHypothesis(entry, 0.0, 0.0, 0.0, 0.0, size_m).as_object()
    found = []
    for region in asset_for(thing).regions:
        if region.kind == "surface" or hollows:
            T, half = region_frame(thing, region)
            x, y, z = (float(value) for value in T[:3, 3])
            found.append(TopShares(z / height, x / length, y / width, float(half[0]) / length, float(half[1]) / width))
    return tuple(sorted(found, reverse=True))


def feet_cost(guess: PoseHypothesis, feet_m: Array) -> float:
    """Return the cost of feet (N, 3) that are not on the top of a hypothesis.

    What has boards has many tops, and feet tell nothing of it. What has no top carries none of them.
    """
    if not len(feet_m) or has_boards(guess.entry.category):
        return 0.0
    shares = top_shares(guess.entry)
    if not shares:
        return _FOOT_MOST * len(feet_m)
    (length, width, height), (high, ahead, aside, half_ahead, half_aside) = guess.size_m, shares[0]
    c, s = math.cos(guess.yaw_rad), math.sin(guess.yaw_rad)
    x, y = feet_m[:, 0] - guess.x_m, feet_m[:, 1] - guess.y_m
    over = np.abs(c * x + s * y - ahead * length) - half_ahead * length
    outside = np.abs(c * y - s * x - aside * width) - half_aside * width
    off = np.square(np.maximum(over, 0.0)) + np.square(np.maximum(outside, 0.0))
    up = (feet_m[:, 2] - guess.bottom_m - high * height) / _FOOT_HIGH_M
    return float(np.minimum(0.5 * (np.square(up) + off / _FOOT_ASIDE_M**2), _FOOT_MOST).sum())


def _back_cost(guess: PoseHypothesis, facing: float) -> float:
    """Return the cost of a slab with a back; what folds, such as a laptop, has two that cover each other.

    Args:
        guess: The hypothesis.
        facing: Cosine between its own x axis and the view: screens are mostly seen from before them.
    """
    cost = _WITH_BACK + _SIDEWAYS * (1.0 - facing)
    if not is_folding(guess.entry.category):
        return cost
    length, _, height = guess.size_m
    lean = float(str(dict(guess.parameters).get(LEAN.name, LEAN.default)))
    off = math.log(length * (1.0 - lean) / math.hypot(length * lean, height))
    return cost + 0.5 * (off / _COVERS) ** 2


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
_STEP_SHARE = 0.2  # Of the least side, which a step is at most.
_LOOSEST = 1e-3  # Of the sharpest direction: looser ones are unknown.
MOST_M = 1.0
"""The largest uncertainty of a place or a side that is told."""

_HIGHEST = 1e6  # Cost of impossible hypotheses in differences.
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
        scale_share: Relative uncertainty of the picture's scale.
        shows_boards: Whether things are seen on its boards, from their open side.
        feet_m: (N, 3) where things that are on it touch its top.
    """

    evidence: PixelEvidence
    near: Neighbourhood
    scale_share: float = 0.0
    shows_boards: bool = False
    feet_m: Array = field(default_factory=lambda: NO_FEET)

    def box_cost(self, guess: PoseHypothesis) -> float:
        """Return the cost by box and prior; infinite for an impossible hypothesis."""
        cost = prior_cost(guess, self.near)
        if not math.isfinite(cost):
            return math.inf
        if self.shows_boards and has_boards(guess.entry.category):
            facing = guess.x_m * math.cos(guess.yaw_rad) + guess.y_m * math.sin(guess.yaw_rad)
            if facing < 0.0:
                return math.inf
        return cost + self.evidence.box_cost(guess) + feet_cost(guess, self.feet_m)

    def cost(self, guess: PoseHypothesis, body: MeshRaycaster | None = None, *, colours: bool = True) -> float:
        """Return the cost of a hypothesis, infinite if it cannot be built.

        Args:
            guess: The hypothesis.
            body: Raycaster to use, scaled to its size; by default that of its own size.
            colours: Whether colours are evaluated, which is slower.
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
        cost: Its cost. Only differences between hypotheses of one object are meaningful.
        alternatives: The best hypothesis of every other model, best first.
        explained: Share of the object's pixels that it explains.
        residual_m: Median distance between its surface and the measured depth.
        pixels: How many pixels were compared at the end.
        colour: Median colour of its visible pixels, sRGB from 0 to 255; None if it is hidden.
        spread_m: Standard deviations of its place on the floor in its worst direction, and of its worst side.
        in_box: IoU of its box with the box around its visible part; 1 until it is computed.
        assumed: If none of its sides are visible, the assumption made, for people.
        rough: Whether it is only the likeliest start of a search.
        hangs: Whether no ray meets a support below it.
    """

    guess: PoseHypothesis
    cost: float
    alternatives: tuple[RatedHypothesis, ...]
    explained: float
    residual_m: float
    pixels: int
    colour: tuple[int, int, int] | None
    spread_m: tuple[float, float]
    in_box: float = 1.0
    assumed: str = ""
    rough: bool = False
    hangs: bool = False

    @property
    def likelier(self) -> float:
        """0 to 1: likelihood against the best hypothesis of any other model."""
        if not self.alternatives:
            return 1.0
        return 1.0 / (1.0 + math.exp(-min(50.0, self.alternatives[0].cost - self.cost)))

    @property
    def placed(self) -> float:
        """0 to 1: the probability that its place on the floor is off by less than 10 cm, by its spread."""
        return 1.0 - math.exp(-0.5 * (_PLACED_M / max(self.spread_m[0], 1e-6)) ** 2)

    @property
    def confidence(self) -> float:
        """0 to 1: the product of likelihood, explained share, agreement with the box and exactness of the place."""
        return self.likelier * self.explained * self.in_box * self.placed


@dataclass(frozen=True)
class SearchContext:
    """Context of a search: everything known besides the object.

    Attributes:
        observation: The picture.
        other_m, other: (H, W) depth of everything else known, and its face number.
        smaller: (H, W) pixels in boxes of smaller objects.
        near: The walls and the other furniture.
        scale_share: Relative uncertainty of the picture's scale.
        own: (H, W) the object's own pixels, if they are known.
        shows_boards: Whether things are seen on its boards, from their open side.
        feet_m: (N, 3) where things that are on it touch its top.
    """

    observation: Observation
    other_m: Array
    other: NDArray[np.int32]
    smaller: NDArray[np.bool_]
    near: Neighbourhood
    scale_share: float = 0.0
    own: NDArray[np.bool_] | None = None
    shows_boards: bool = False
    feet_m: Array = field(default_factory=lambda: NO_FEET)


def spreads_m(likelihood: Likelihood, guess: PoseHypothesis) -> tuple[float, float]:
    """Return the standard deviations of an object's place on the floor, in its worst direction, and of its worst side.

    They follow from the growth of costs around the hypothesis (Laplace's approximation): if an object slightly farther
    and larger costs the same, its place is uncertain. Colours are left out: they underestimate the spread.

    Args:
        likelihood: The likelihood.
        guess: The hypothesis.
    """
    count, body = len(_STEPS), raycaster_of(guess)
    # Of a thin thing a centimetre is no small step.
    steps_m = np.minimum(_STEPS, _STEP_SHARE * min(guess.size_m))
    steps_m[2] = _STEPS[2]

    def cost(steps: dict[int, float]) -> float:
        by: Array = np.zeros(count)
        for index, sign in steps.items():
            by[index] = sign * steps_m[index]
        length, width, height = guess.size_m
        size = length + float(by[3]), width + float(by[4]), height + float(by[5])
        one = replace(guess, x_m=guess.x_m + by[0], y_m=guess.y_m + by[1], yaw_rad=guess.yaw_rad + by[2], size_m=size)
        return min(likelihood.cost(one, body, colours=False), _HIGHEST)

    here = cost({})
    single = np.array([[cost({i: sign}) for sign in (-1.0, 1.0)] for i in range(count)])
    curved = np.zeros((count, count))
    for i in range(count):
        curved[i, i] = single[i, 0] + single[i, 1] - 2 * here
        for j in range(i):
            both = cost({i: 1.0, j: 1.0})
            curved[i, j] = curved[j, i] = both - single[i, 1] - single[j, 1] + here
    values, axes = np.linalg.eigh(curved)
    variances = 1.0 / np.maximum(values, max(_LOOSEST * float(values.max()), 1e-9))
    covariance = (axes * variances) @ axes.T * np.outer(steps_m, steps_m)
    place, side = float(np.linalg.eigvalsh(covariance[:2, :2]).max()), float(np.diag(covariance)[3:].max())
    by_scale_m = likelihood.scale_share * math.hypot(guess.x_m, guess.y_m)
    far_m = math.hypot(math.sqrt(max(0.0, place)), by_scale_m)
    return min(MOST_M, far_m), min(MOST_M, math.sqrt(max(0.0, side)))
