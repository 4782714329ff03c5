"""What sizes and distances exclude: a thing that cannot be inside another, and a hand that is too far away.

All are necessary conditions on bounding boxes that are filled: what they exclude is impossible at every rotation, what
they let pass is for the executor's geometry to decide. A thing may lean, and stick out of what is open at the top.

Source: docs/semantics.md, Numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

from oag.model.actions import Action
from oag.model.symbols import Primitive

Extent = tuple[float, ...]
# A wall has some thickness: what is as wide as its place does not go in [m].
_WALL_M = 0.001
_AHEAD = {
    Primitive.MOVE_BASE_FORWARD: 0.0,
    Primitive.MOVE_BASE_LEFT: 90.0,
    Primitive.MOVE_BASE_BACKWARD: 180.0,
    Primitive.MOVE_BASE_RIGHT: 270.0,
}
_TURNS = {Primitive.TURN_BASE_LEFT: 1.0, Primitive.TURN_BASE_RIGHT: -1.0}
_ARRIVALS = (Primitive.NAVIGATE_TO_TARGET, Primitive.NAVIGATE_TO_SUPPORT)


@lru_cache(maxsize=1024)
def can_be_inside(thing_m: Extent, place_m: Extent, *, open_top: bool) -> bool:
    """Decide whether a box can be inside another at some rotation, by conditions that every such rotation meets.

    In a place that is open at the top, only the middle of the box has to be below the rim. Its horizontal section there
    is between the walls, is as wide as its least side at least, and as long as its second side.
    """
    least, second, _ = sorted(thing_m)
    wide, deep = _between_walls(place_m)
    if least > min(wide, deep):
        return False
    if open_top:
        return second <= math.hypot(wide, deep) and _lowest_middle(thing_m, place_m) <= place_m[2]
    room_m = (wide, deep, place_m[2])
    # A disc of the second side's diameter is in the box: with the normal n, it extends by d * sqrt(1 - n_i^2) along i.
    disc = sum(min(1.0, (side / second) ** 2) for side in room_m) >= 2.0
    # Width averaged over all directions, surface and volume of a convex body within another one are not larger.
    return (
        disc
        and least <= room_m[2]
        and math.hypot(*thing_m) <= math.hypot(*room_m)
        and sum(thing_m) <= sum(room_m)
        and _surface(thing_m) <= _surface(room_m)
        and math.prod(thing_m) <= math.prod(room_m)
    )


def can_both_be_inside(first_m: Extent, second_m: Extent, place_m: Extent) -> bool:
    """Decide whether two boxes can be in one vessel: their middles are as far apart as balls within them need."""
    wide, deep = _between_walls(place_m)
    apart_m = 0.5 * (min(first_m) + min(second_m))
    lowest_m = min(_lowest_middle(first_m, place_m), _lowest_middle(second_m, place_m))
    room_m = (wide - apart_m, deep - apart_m, place_m[2] - lowest_m)
    return min(room_m) >= 0.0 and math.hypot(*room_m) >= apart_m


def _between_walls(place_m: Extent) -> tuple[float, float]:
    return place_m[0] - _WALL_M, place_m[1] - _WALL_M


def _surface(extent_m: Extent) -> float:
    a, b, c = extent_m
    return a * b + b * c + c * a


def _lowest_middle(thing_m: Extent, place_m: Extent) -> float:
    """Return a height [m] that the middle of a box in a vessel is not below.

    The largest balls along its longest axis are between the walls from its middle down, and above the bottom: where the
    axis is longer than the vessel is wide, it stands up.
    """
    least = min(thing_m)
    along = 0.5 * (max(thing_m) - least)
    level_m = math.hypot(*(max(side - least, 0.0) for side in _between_walls(place_m)))
    return 0.5 * least + math.sqrt(max(along**2 - level_m**2, 0.0))


class Drift(NamedTuple):
    """How far a base has gone from where it last arrived.

    Attributes:
        step: Index of the step before which this is so.
    """

    step: int
    distance_m: float
    turn_deg: float


def stays_near(flow: Iterable[Action], most_m: float, most_deg: float) -> bool:
    """Decide whether a base stays within a distance and a turn even if all its moves went one way."""
    distance_m = turn_deg = 0.0
    for action in flow:
        number = action.parameter
        if number is not None and isinstance(number, float):
            if action.primitive in _AHEAD:
                distance_m += abs(number)
            elif action.primitive in _TURNS:
                turn_deg += abs(number)
    return distance_m <= most_m and turn_deg <= most_deg


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
