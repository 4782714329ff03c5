"""Two objects in each other are separated: one moves or becomes shorter, so far as it has to, and stays in its box."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from executor.assets.footprint import Footprint, overlap_depth_m, solid_parts
from executor.geometry import Array
from executor.photo.fitting.hypothesis import PoseHypothesis, is_round, raycaster_of

CLEARANCE_M = 0.001
"""Between things that were separated."""

Fill = Callable[[PoseHypothesis], float]
"""IoU of the box of an object with the outline that a hypothesis of it has in the picture, 0 to 1."""

_LOSS_M = 0.3  # A way that costs as much as all of an outline.
_CUT = 1.5  # Metre of a size, in metres of way.
_MOST_CUT = 0.4  # Of a side as it was fitted, by all cuts together.
_LARGER = 2.0  # Times its way costs, where the larger one gives.


@dataclass(frozen=True)
class Boxed:
    """What the picture tells of an object.

    Attributes:
        fill: How well a hypothesis fills its box.
        least_m: (2,) its shortest length and width, however often it is cut.
    """

    fill: Fill
    least_m: tuple[float, float]

    @classmethod
    def of(cls, fill: Fill, guess: PoseHypothesis, *, is_sized: bool = False) -> Boxed:
        """Return it for a fit; a size that a person gave is not cut."""
        length, width, _ = guess.size_m
        share = 1.0 if is_sized else 1.0 - _MOST_CUT
        return cls(fill, (share * length, share * width))


def separated(
    first: PoseHypothesis, second: PoseHypothesis, boxed: tuple[Boxed, Boxed] | None = None
) -> tuple[PoseHypothesis, PoseHypothesis]:
    """Separate two objects the cheapest way: the smaller one moves, or one of both gives, by what their outlines lose.

    What is fixed moves only along its wall, and others give way to it.

    Args:
        first, second: The two.
        boxed: Their boxes, if these are known; otherwise only ways count.
    """
    pair, objects = (first, second), (first.as_object(), second.as_object())
    if Footprint.of(objects[0]).depth_m(Footprint.of(objects[1])) <= 0.0:
        return pair
    parts = solid_parts(objects[0]), solid_parts(objects[1])
    if overlap_depth_m(*parts) <= 0.0:
        return pair
    smaller = int(second.size_m[0] * second.size_m[1] <= first.size_m[0] * first.size_m[1])
    if first.fixed is not second.fixed:
        smaller = int(first.fixed)
    givers = (smaller,) if boxed is None or first.fixed or second.fixed else (0, 1)
    # What hangs keeps its back on its wall.
    axes = [_axes(one.yaw_rad) for one in pair]
    tried = [axes[smaller][1]] if first.fixed and second.fixed else [*axes[0], *axes[1]]
    best = (math.inf, smaller, pair[smaller])
    for giver in givers:
        guess, own = pair[giver], None if boxed is None else boxed[giver]
        before = 0.0 if own is None else own.fill(guess)
        weight = 1.0 if giver == smaller else _LARGER
        for way_m, given in _ways(guess, parts[giver], parts[1 - giver], tried, own):
            loss = 0.0 if own is None else max(0.0, before - own.fill(given))
            best = min(best, (weight * way_m + _LOSS_M * loss, giver, given), key=lambda one: one[0])
    _, giver, given = best
    return (given, second) if giver == 0 else (first, given)


def _ways(
    guess: PoseHypothesis,
    mine: Sequence[Footprint],
    theirs: Sequence[Footprint],
    tried: Sequence[Array],
    boxed: Boxed | None,
) -> Iterator[tuple[float, PoseHypothesis]]:
    """Yield how an object gets out of another one, each with its way [m]: moved, or cut on the side that is in it."""
    own = _axes(guess.yaw_rad)
    for axis in tried:
        for direction in (axis, -axis):
            by_m = _way_out_m(mine, theirs, direction) + CLEARANCE_M
            if math.isinf(by_m):
                continue
            yield by_m, guess.shifted(by_m * direction)
            side = next((number for number in (0, 1) if abs(float(own[number] @ direction)) > 1.0 - 1e-9), None)
            if boxed is None or guess.fixed or side is None or is_round(guess.entry):
                continue
            if guess.size_m[side] - by_m > boxed.least_m[side]:
                sides = [length - by_m * (number == side) for number, length in enumerate(guess.size_m)]
                shorter = replace(guess, size_m=(sides[0], sides[1], sides[2]))
                if raycaster_of(shorter) is not None:
                    yield _CUT * by_m, shorter.shifted(by_m / 2 * direction)


def _way_out_m(mine: Sequence[Footprint], theirs: Sequence[Footprint], direction: Array) -> float:
    """Return how far an object moves along a direction until none of its parts is in one of another's.

    Each round takes at least one pair of parts out of each other, and for good. Infinite if rounding keeps one in.
    """
    way_m = 0.0
    for _ in range(len(mine) * len(theirs) + 1):
        further_m = 0.0
        for one in mine:
            moved = replace(one, x_m=one.x_m + way_m * direction[0], y_m=one.y_m + way_m * direction[1])
            deep = [other for other in theirs if moved.depth_m(other) > 0.0]
            further_m = max([further_m, *(_exit_m(moved, other, direction) for other in deep)])
        if further_m == 0.0:
            return way_m
        way_m += further_m + 1e-9
    return math.inf


def _exit_m(one: Footprint, other: Footprint, direction: Array) -> float:
    """Return how far one rectangle moves along a direction until it is beside another one."""
    least = math.inf
    for axis in (*_axes(one.yaw_rad), *_axes(other.yaw_rad)):
        along = float(axis @ direction)
        if abs(along) < 1e-6:
            continue
        mine, theirs = one.corners_m @ axis, other.corners_m @ axis
        over_m = theirs.max() - mine.min() if along > 0.0 else mine.max() - theirs.min()
        least = min(least, float(over_m) / abs(along))
    return least


def _axes(yaw_rad: float) -> tuple[Array, Array]:
    """Return the own x and y axis (2,) of a heading."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([c, s]), np.array([-s, c])
