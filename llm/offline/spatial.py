"""Telling like things apart by where they are: beside what, on which side, how far from the robot.

Sides are those that the robot sees from its start. What is too close to call is left undecided, so that the query is
refused as ambiguous rather than guessed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from llm.offline.reader import Direction, Side
from oag import Scene, SceneObject

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
        if direction == "UNDER":
            return is_under(key, other, scene)
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
    halves = (_half_footprint_m(one), _half_footprint_m(other))
    gaps = (
        max(0.0, abs(one.position[axis] - other.position[axis]) - halves[0][axis] - halves[1][axis]) for axis in (0, 1)
    )
    return math.hypot(*gaps)


def is_under(lower: str, upper: str, scene: Scene) -> bool:
    """Decides whether an object stands below another one: within its footprint the other's middle, its top no higher
    than the other's bottom.
    """
    below, above = scene.objects[lower], scene.objects[upper]
    half = _half_footprint_m(below)
    within = all(abs(above.position[axis] - below.position[axis]) <= half[axis] for axis in (0, 1))
    bottom, top = above.position[2] - above.height_m / 2, below.position[2] + below.height_m / 2
    return within and top <= bottom + MARGIN_M


def _half_footprint_m(thing: SceneObject) -> tuple[float, float]:
    """Half the size, along x and y of the world, of the box around an object that may be turned about z."""
    w, x, y, z = thing.orientation
    cos, sin = abs(1.0 - 2.0 * (y * y + z * z)), abs(2.0 * (x * y + w * z))
    along, across, _ = thing.extent_m
    return (cos * along + sin * across) / 2, (sin * along + cos * across) / 2


def _from_robot(object_id: str, scene: Scene) -> tuple[float, float]:
    place, robot = scene.objects[object_id].position, scene.robot.position
    return place[0] - robot[0], place[1] - robot[1]


def _least(ids: Sequence[str], measure: Callable[[str], float]) -> tuple[str, ...]:
    """Returns the object of the least measure together with all that are too close to it."""
    least = min(map(measure, ids), default=0.0)
    return tuple(key for key in ids if measure(key) <= least + MARGIN_M)
