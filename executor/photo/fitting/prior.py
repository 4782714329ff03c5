"""What is known of things before they are seen: sizes that models come in, and how furniture stands in rooms."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TypeAlias

from executor.assets.parameters import ModelEntry
from executor.photo.fitting.body import Guess, Size, is_round, largest_m
from executor.photo.space.walls import Wall
from executor.scenes.cousins.likeness import ABSURD
from oag import Kind, kind_of

_BEYOND_M = 0.015  # A size beyond its model's range costs one half for each square of this.
_BEYOND_RATIO = 0.03
_AGAINST_M, _AGAINST_SIGMA_M, _AGAINST_WEIGHT, _FAR_M = 0.012, 0.015, 1.5, 0.35
"""Furniture that is near a wall stands against it, a skirting's width away. The slope never ends: what is hidden of a
piece, its depth before all, only this can tell."""

_FLUSH_SIGMA_M, _FLUSH_WEIGHT, _FLUSH_FAR_M = 0.008, 0.8, 0.15  # Furniture in a row touches.
_OPEN, _OPEN_BEHIND = 4.0, 29.0
"""Doors are mostly shut; and from behind, an open one is most likely a wall beside the thing that nobody has found."""

_ALIKE_M, _ALIKE_MOST = 0.01, 40.0  # Units of a kitchen come in one height and one depth.
_INTO_SIGMA_M, _INTO_MOST = 0.01, 30.0  # Nothing stands in a wall.
_ALIGNED_SIGMA_RAD, _ALIGNED_MOST = math.radians(1.5), 2.5  # Furniture mostly stands along walls.
_TURNED_AWAY, _FROM_BEHIND = 6.0, 24.0
"""Fronts are mostly seen: who takes a picture of a room looks at them. Where nothing is measured, what is seen from
behind is most likely something else: backs are as plain as what has no front."""

_BLOCKED, _BEFORE_M = 25.0, 0.15  # Nobody stands doors or drawers against a wall or a bed.
_SMALLEST_M = 0.008
_OUTGROWN = 1.1  # Of the largest that a model comes as.
_SAME_PLACE, _SAME_SIZE = 0.4, 1.6  # Of the least side; of two things' sides.
OF_RANGE = 0.29
"""Standard deviation of what is spread evenly over a range, as models' sizes are taken to be."""

_ASKEW, _FACING = math.sin(2 * math.radians(8.0)), math.cos(math.radians(8.0))
_OPENS = ("refrigerator", "bottom_cabinet", "nightstand", "wardrobe", "desk_with_drawers", "microwave", "oven")
_FRONTED = (*_OPENS, "dishwasher", "shelf")
UNITS = ("bottom_cabinet", "countertop", "dishwasher", "oven")
"""What stands in one row in a kitchen."""

AT_WALLS = (*_FRONTED, "countertop", "bed", "sofa")
"""What mostly stands with its back to a wall."""

CARRIED = ("microwave",)
"""Furniture that stands on furniture."""


Flat: TypeAlias = tuple[float, float]
"""A vector along the floor."""


@dataclass(frozen=True)
class Neighbourhood:
    """What stands around a thing.

    Attributes:
        walls: The walls.
        pieces: The other furniture, as far as it is known.
        heading_rad: Without walls, one of the directions in which most lines of the room go, if there is one.
        without_depth: Whether nothing is measured, and no wall is known: pieces then tell of each other.
    """

    walls: tuple[Wall, ...]
    pieces: tuple[Guess, ...] = ()
    heading_rad: float | None = None
    without_depth: bool = False

    @property
    def headings_rad(self) -> tuple[float, ...]:
        """Directions that furniture often has, each up to quarter turns."""
        lines = () if self.heading_rad is None else (self.heading_rad,)
        return (*(wall.yaw_rad for wall in self.walls), *lines)


def prior_cost(guess: Guess, around: Neighbourhood) -> float:
    """Returns how unlikely a guess is before anything is seen, as a negative logarithm; infinite for what cannot be."""
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
        # What stands open has room to.
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
    """From which to which length, width and height a thing may be of a model at all: a scene takes nothing else."""
    spans = (entry.length, entry.width, entry.height)
    low = (span.low * (entry.width.low if span.of_width else 1.0) for span in spans)
    ends = zip(low, largest_m(entry), strict=True)
    return tuple((max(least / ABSURD, _SMALLEST_M), most * ABSURD) for least, most in ends)


def is_large(entry: ModelEntry) -> bool:
    """Decides whether a model is of furniture."""
    return kind_of(entry.category, entry.width.low) is not Kind.ITEM


def is_outgrown(guess: Guess) -> bool:
    """Decides whether a guess is larger than its model ever is, as is what seems farther off than it is."""
    return any(value > _OUTGROWN * most for value, most in zip(guess.size_m, largest_m(guess.entry), strict=True))


def usual_size_m(entry: ModelEntry) -> Size:
    """Returns the middle one of a model's sizes: length, width, height."""
    width = (entry.width.low + entry.width.high) / 2
    length, height = (
        (span.low + span.high) / 2 * (width if span.of_width else 1.0) for span in (entry.length, entry.height)
    )
    return length, width, height


def usual_size_cost(guess: Guess) -> float:
    """Returns how far a guess is from the middle of its model's sizes, which tells sizes where no depth does."""
    entry, (length, width, height) = guess.entry, guess.size_m
    cost = 0.0
    for value, span in ((length, entry.length), (width, entry.width), (height, entry.height)):
        unit = width if span.of_width else 1.0
        sigma = max((span.high - span.low) * unit * OF_RANGE, _BEYOND_M)
        cost += 0.5 * ((value - (span.low + span.high) / 2 * unit) / sigma) ** 2
    return cost


def stands_in(guess: Guess, pieces: Sequence[Guess]) -> bool:
    """Decides whether the middle of what stands on the floor is in one of some pieces."""
    return guess.bottom_m == 0.0 and any(_is_over(piece, guess.x_m, guess.y_m) for piece in pieces)


def is_same_place(guess: Guess, other: Guess) -> bool:
    """Decides whether two things of about one size have their middles in one place, as nothing in a bowl has."""
    off_m = math.dist(
        (guess.x_m, guess.y_m, guess.bottom_m + guess.size_m[2] / 2),
        (other.x_m, other.y_m, other.bottom_m + other.size_m[2] / 2),
    )
    ratios = (one / two for one, two in zip(guess.size_m, other.size_m, strict=True))
    alike = all(1.0 / _SAME_SIZE < ratio < _SAME_SIZE for ratio in ratios)
    return alike and off_m < _SAME_PLACE * min(guess.size_m)


def _is_over(piece: Guess, x_m: float, y_m: float) -> bool:
    c, s = math.cos(piece.yaw_rad), math.sin(piece.yaw_rad)
    x, y = x_m - piece.x_m, y_m - piece.y_m
    return abs(c * x + s * y) < piece.size_m[0] / 2 and abs(c * y - s * x) < piece.size_m[1] / 2


def _dot(first: Flat, second: Flat) -> float:
    """Of two short vectors, in a tenth of the time that numpy takes for them: a search asks for this all the time."""
    return first[0] * second[0] + first[1] * second[1]


def _is_blocked(guess: Guess, around: Neighbourhood, ahead: Flat) -> bool:
    """Whether what is in front of a piece keeps its doors or drawers from being used: a wall, or other furniture."""
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
    """Its directions across and along, how far off it is, and from where to where it goes, as plain numbers."""
    x, y = wall.normal.tolist()
    return (x, y), (-y, x), wall.offset_m, wall.span_m


def _row_cost(guess: Guess, pieces: Sequence[Guess], ahead: Flat) -> float:
    """What the gaps to neighbours in a row cost, and overlaps with them."""
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


def in_rows(guess: Guess, pieces: Sequence[Guess]) -> Iterator[Guess]:
    """Yields a kitchen's unit moved and stretched to be as deep and high as another, in one row with it.

    Those of which it is as high already are left out.
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


def _facing_alike(guess: Guess, pieces: Sequence[Guess]) -> Iterator[Guess]:
    """Those of some pieces that stand at walls and have their backs on the same side."""
    for piece in (one for one in pieces if one.entry.category in AT_WALLS):
        facing = math.cos(piece.yaw_rad - guess.yaw_rad)
        # Nobody sees where a counter has its front.
        have_fronts = guess.entry.category in _FRONTED and piece.entry.category in _FRONTED
        if (facing if have_fronts else abs(facing)) > _FACING:
            yield piece


def _at_one_wall_cost(guess: Guess, pieces: Sequence[Guess], ahead: Flat) -> float:
    """Where no wall is known, what it costs not to stand against that of what faces the same way, and be unlike it."""
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


def _wall_cost(guess: Guess, walls: Sequence[Wall], ahead: Flat) -> float:
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
