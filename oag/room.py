"""What sizes and distances exclude: a thing that cannot be inside another, and a hand that is too far away.

All are necessary conditions on bounding boxes, generous where a box says little: what they exclude is impossible, what
they let pass is for the executor's geometry to decide. Nothing is said of what touches a rim or leans.

Source: docs/semantics.md, Numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import permutations
from typing import NamedTuple

from oag.model.actions import Action
from oag.model.symbols import Primitive

Extent = tuple[float, ...]
# A wall has some thickness: what is as wide as its place does not go in [m].
_WALL_M = 0.001
# A robot that has turned by more faces away from what it stood at [degrees].
MOST_TURN_DEG = 90.0
_AHEAD = {
    Primitive.MOVE_BASE_FORWARD: 0.0,
    Primitive.MOVE_BASE_LEFT: 90.0,
    Primitive.MOVE_BASE_BACKWARD: 180.0,
    Primitive.MOVE_BASE_RIGHT: 270.0,
}
_TURNS = {Primitive.TURN_BASE_LEFT: 1.0, Primitive.TURN_BASE_RIGHT: -1.0}
_ARRIVALS = (Primitive.NAVIGATE_TO_TARGET, Primitive.NAVIGATE_TO_SUPPORT)


@lru_cache(maxsize=1024)
def heights_inside(thing_m: Extent, place_m: Extent, *, open_top: bool) -> tuple[float, ...]:
    """Return the heights [m] at which a box can stand in another, turned any way; none when it does not go in.

    In a place that is open at the top, its middle has to be below the rim.
    """
    wide, deep = sorted(place_m[:2])
    fitting = {
        up
        for a, b, up in permutations(thing_m)
        if a < wide - _WALL_M and b < deep - _WALL_M and up * (0.5 if open_top else 1.0) < place_m[2]
    }
    return tuple(sorted(fitting))


def both_inside(first_m: Extent, second_m: Extent, place_m: Extent) -> bool:
    """Decide whether two boxes can be in one vessel: side by side, at most along its diagonal, or one on the other."""
    heights = [heights_inside(each, place_m, open_top=True) for each in (first_m, second_m)]
    if not all(heights):
        return False
    low, high = (min(each) for each in heights)
    stacked = min(low + 0.5 * high, high + 0.5 * low) <= place_m[2]
    return stacked or _least_side(first_m) + _least_side(second_m) < math.hypot(place_m[0], place_m[1])


def _least_side(extent_m: Extent) -> float:
    return min(extent_m)


class Drift(NamedTuple):
    """How far a base has gone from where it last arrived.

    Attributes:
        step: Index of the step before which this is so.
    """

    step: int
    distance_m: float
    turn_deg: float


def stays_near(flow: Iterable[Action], most_m: float) -> bool:
    """Decide whether a base stays within a distance and a quarter turn even if all its moves went one way."""
    distance_m = turn_deg = 0.0
    for action in flow:
        if isinstance(action.parameter, float):
            if action.primitive in _AHEAD:
                distance_m += abs(action.parameter)
            elif action.primitive in _TURNS:
                turn_deg += abs(action.parameter)
    return distance_m <= most_m and turn_deg <= MOST_TURN_DEG


def drifts(flow: Iterable[Action], at: Iterable[Primitive]) -> Iterator[Drift]:
    """Yield the drift of the base before each step of some primitives, by the numbers that a flow gives."""
    asked = frozenset(at)
    x = y = heading = 0.0
    for index, action in enumerate(flow):
        primitive, number = action.primitive, action.parameter
        if primitive in _ARRIVALS:
            x = y = heading = 0.0
        elif primitive in asked:
            yield Drift(index, math.hypot(x, y), abs(math.remainder(heading, 360.0)))
        elif isinstance(number, float) and primitive in _AHEAD:
            direction = math.radians(heading + _AHEAD[primitive])
            x, y = x + number * math.cos(direction), y + number * math.sin(direction)
        elif isinstance(number, float) and primitive in _TURNS:
            heading += number * _TURNS[primitive]
