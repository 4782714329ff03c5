"""Telling like things apart by where they are: beside what, on which side, how far from the robot.

Sides are those that the robot sees from its start. What is too close to call is left undecided, so that the query is
refused as ambiguous rather than guessed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from llm.offline.commands import Direction, Side
from oag import Scene

# Two things are beside each other when the gap between their boxes is at most this wide.
BESIDE_M = 0.20
# What differs by less than this is neither left nor right, nor nearer.
MARGIN_M = 0.05


def on_side(ids: Sequence[str], side: Side, scene: Scene) -> tuple[str, ...]:
    """Returns the one of the objects that is furthest to the side, or nearest or farthest; all where it is too close.

    Args:
        ids: Objects of one name.
        side: Which of them is meant.
        scene: The scene that has them.
    """
    measure: Callable[[str], float] = {
        "left": lambda key: -left_m(key, scene),
        "right": lambda key: left_m(key, scene),
        "nearest": lambda key: distance_m(key, scene),
        "farthest": lambda key: -distance_m(key, scene),
    }[side]
    return _least(ids, measure)


def beside(ids: Sequence[str], direction: Direction, others: Sequence[str], scene: Scene) -> tuple[str, ...]:
    """Returns those of the objects that stand to one of the others as a preposition says; none where none does.

    Args:
        ids: Objects of one name.
        direction: Of the prepositions, one that tells things apart.
        others: What the preposition is about.
        scene: The scene that has them.
    """
    pairs = [(key, other) for key in ids for other in others if key != other]
    if direction == "CLOSEST":
        gaps = {key: min(gap_m(first, other, scene) for first, other in pairs if first == key) for key, _ in pairs}
        return _least(tuple(gaps), gaps.__getitem__)

    def fits(key: str, other: str) -> bool:
        if direction == "NEXT":
            return gap_m(key, other, scene) <= BESIDE_M
        to_the_left_m = left_m(key, scene) - left_m(other, scene)
        return to_the_left_m > MARGIN_M if direction == "LEFTOF" else -to_the_left_m > MARGIN_M

    return tuple(dict.fromkeys(key for key, other in pairs if fits(key, other)))


def left_m(object_id: str, scene: Scene) -> float:
    """Returns how far to the robot's left an object is at the start."""
    dx, dy, yaw_rad = *_from_robot(object_id, scene), scene.robot.yaw_rad
    return dy * math.cos(yaw_rad) - dx * math.sin(yaw_rad)


def distance_m(object_id: str, scene: Scene) -> float:
    """Returns how far from the robot an object is at the start."""
    return math.hypot(*_from_robot(object_id, scene))


def gap_m(first: str, second: str, scene: Scene) -> float:
    """Returns the gap between the footprints of two objects, their boxes taken along the axes of the world."""
    one, other = scene.objects[first], scene.objects[second]
    gaps = (
        max(0.0, abs(one.position[axis] - other.position[axis]) - (one.extent_m[axis] + other.extent_m[axis]) / 2)
        for axis in (0, 1)
    )
    return math.hypot(*gaps)


def _from_robot(object_id: str, scene: Scene) -> tuple[float, float]:
    place, robot = scene.objects[object_id].position, scene.robot.position
    return place[0] - robot[0], place[1] - robot[1]


def _least(ids: Sequence[str], measure: Callable[[str], float]) -> tuple[str, ...]:
    """Returns the object of the least measure together with all that are too close to it."""
    least = min(map(measure, ids), default=0.0)
    return tuple(key for key in ids if measure(key) <= least + MARGIN_M)
