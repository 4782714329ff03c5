"""How people tell like things apart: sides, distances, heights, sizes and colours, as the scene states them.

Left, right, near and behind are seen from the robot's start. What is too close to call stays several objects, so that
a query is refused as ambiguous rather than guessed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

from llm.offline.reader import Side
from llm.offline.words import Direction
from oag import Scene, SceneObject

# Largest gap between the boxes of neighbouring objects.
NEIGHBOR_GAP_M = 0.20
# Directions that differ by less are the same for "behind" and "in front of".
_SAME_DIRECTION_RAD = math.radians(30.0)
# Smaller differences count as neither left nor right, nor nearer.
MARGIN_M = 0.05
_PLAIN_COLORS = (
    "red", "green", "blue", "yellow", "white", "black", "brown", "grey", "silver", "gold", "pink", "purple", "beige",
)  # fmt: skip
# Word for a colour -> the colour.
COLORS = {**dict(zip(_PLAIN_COLORS, _PLAIN_COLORS, strict=True)), "gray": "grey", "golden": "gold"}
# Word for a size -> whether the largest or the smallest is meant, and whether by its height alone.
SIZES = {
    **dict.fromkeys(("big", "large", "huge", "bigger", "larger"), (True, False)),
    **dict.fromkeys(("small", "little", "tiny", "smaller"), (False, False)),
    "tall": (True, True),
    "short": (False, True),
}
# Colour -> what a photograph in warm, cold or dim light may show of it instead.
_NEAR = {
    "red": ("orange", "pink"),
    "orange": ("red", "yellow", "brown"),
    "yellow": ("orange",),
    "gold": ("yellow", "orange"),
    "pink": ("red", "purple"),
    "purple": ("blue", "pink"),
    "blue": ("purple",),
    "brown": ("orange", "beige"),
    "beige": ("white", "brown"),
    "white": ("grey", "beige"),
    "silver": ("grey", "white"),
    "grey": ("white", "black"),
    "black": ("grey",),
}
_LEAST_SHARE, _MUCH, _CLEARLY_MORE = 0.1, 0.3, 2.0
# A smaller ratio of sizes is no difference that people would name.
_CLEARLY = 1.15


def by_size(ids: tuple[str, ...], word: str, scene: Scene) -> tuple[str, ...]:
    """Return the object that is clearly the largest or the smallest; all of them if none is."""
    largest, by_height = SIZES[word]
    things = [scene.objects[key] for key in ids]
    if len(ids) < 2 or not all(thing.has_box for thing in things):
        return ids
    sizes = {thing.id: thing.height_m if by_height else math.prod(thing.extent_m) ** (1 / 3) for thing in things}
    first, second, *_ = sorted(ids, key=sizes.__getitem__, reverse=largest)
    ratio = sizes[first] / sizes[second]
    return (first,) if (ratio if largest else 1 / ratio) >= _CLEARLY else ids


LEVELS = {
    **dict.fromkeys(("top", "upper", "uppermost", "topmost", "highest"), "top"),
    **dict.fromkeys(("bottom", "lower", "lowest", "lowermost"), "bottom"),
    **dict.fromkeys(("middle", "central"), "middle"),
}
_PLACES = {
    "first": 0, "1st": 0, "second": 1, "2nd": 1, "third": 2, "3rd": 2, "fourth": 3, "4th": 3, "fifth": 4, "5th": 4,
    "sixth": 5, "last": -1,
}  # fmt: skip


def placed(ids: Sequence[str], word: str, scene: Scene) -> tuple[str, str] | None:
    """Return the one of several that "top", "middle" or "third" names, and how it is counted.

    What is above each other is counted from the top. What is beside each other is counted from the left, as seen from
    the robot's start.

    Returns:
        The id with "from the top" or "from the left"; None where the word names none of them.
    """
    if len(ids) < 2:
        return None
    heights = sorted(ids, key=lambda key: -scene.objects[key].position[2])
    steps = [scene.objects[one].position[2] - scene.objects[two].position[2] for one, two in pairwise(heights)]
    level = LEVELS.get(word)
    if level in ("top", "bottom"):
        apart = steps[0] if level == "top" else steps[-1]
        return (heights[0 if level == "top" else -1], "from the top") if apart > MARGIN_M else None
    above = min(steps) > MARGIN_M and all(gap_m(one, two, scene) == 0.0 for one, two in pairwise(heights))
    across = sorted(ids, key=lambda key: -left_m(key, scene))
    abreast = max(steps) <= MARGIN_M and all(
        left_m(one, scene) - left_m(two, scene) > MARGIN_M for one, two in pairwise(across)
    )
    order = heights if above else across if abreast else []
    place = len(order) // 2 if level == "middle" and len(order) % 2 else _PLACES.get(word)
    if place is None or not -len(order) <= place < len(order):
        return None
    return order[place], "from the top" if above else "from the left"


def stated_colors(thing: SceneObject) -> frozenset[str]:
    """Return the colours that a scene states of an object: in its parameters, or in its names.

    Where a photograph gave shares of colours, what it shows much of counts in place of its model's own one.
    """
    measured = measured_colors(thing)
    own = "" if measured else str(thing.parameters.get("color", ""))
    words = " ".join((thing.id, thing.category, thing.model, own)).lower()
    named = (COLORS[word] for word in re.split("[^a-z]+", words) if word in COLORS)
    return frozenset((*named, *(color for color, share in measured.items() if share >= _MUCH)))


def measured_colors(thing: SceneObject) -> dict[str, float]:
    """Return colour -> its share of what a photograph shows of an object; empty where none was measured."""
    shares = thing.parameters.get("color_shares")
    if not isinstance(shares, Mapping):
        return {}
    return {str(name): float(share) for name, share in shares.items() if isinstance(share, int | float)}


def by_measured_color(ids: tuple[str, ...], color: str, scene: Scene) -> tuple[str, ...]:
    """Return the objects that have about as much of a colour as any in a photograph; empty where none has any.

    Light shifts colours, so that they are compared, and neighbours count half. The only candidate is meant whatever
    its colour: a person's word is worth more than a camera's.
    """
    measured = {key: measured_colors(scene.objects[key]) for key in ids}
    if not all(measured.values()):
        return ()
    if len(ids) == 1:
        return ids
    near = _NEAR.get(color, ())
    amounts = {key: have.get(color, 0.0) + sum(have.get(c, 0.0) for c in near) / 2 for key, have in measured.items()}
    most = max(amounts.values())
    return tuple(key for key in ids if amounts[key] >= most / _CLEARLY_MORE) if most > _LEAST_SHARE else ()


# Words that say it before a name, as "the front bowl" does; of furniture they may name a part.
ASIDE: dict[str, Side] = {
    **dict.fromkeys(("front", "frontmost"), "nearest"),
    **dict.fromkeys(("rear", "rearmost"), "farthest"),
}


def on_side(ids: Sequence[str], side: Side, scene: Scene) -> tuple[str, ...]:
    """Return the object furthest to a side, nearest or farthest; all candidates if they are too close to call.

    Sides are from the robot's viewpoint at its start.
    """
    measure: Callable[[str], float] = {
        "left": lambda key: -left_m(key, scene),
        "right": lambda key: left_m(key, scene),
        "nearest": lambda key: math.hypot(*_from_robot(key, scene)),
        "farthest": lambda key: -math.hypot(*_from_robot(key, scene)),
    }[side]
    return _least(ids, measure)


def referenced(ids: Sequence[str], direction: Direction, others: Sequence[str], scene: Scene) -> tuple[str, ...]:
    """Return the objects that stand in a direction of some others, or next to them."""
    pairs = [(key, other) for key in ids for other in others if key != other]
    if direction == "CLOSEST":
        gaps = {key: min(gap_m(first, other, scene) for first, other in pairs if first == key) for key, _ in pairs}
        return _least(tuple(gaps), gaps.__getitem__)

    def fits(key: str, other: str) -> bool:
        if direction in ("NEXT", "AGAINST"):
            return gap_m(key, other, scene) <= NEIGHBOR_GAP_M
        if direction == "UNDER":
            return is_under(key, other, scene)
        if direction == "ABOVE":
            return is_under(other, key, scene)
        if direction in ("BEHIND", "INFRONT"):
            return is_behind(*((key, other) if direction == "BEHIND" else (other, key)), scene)
        to_the_left_m = left_m(key, scene) - left_m(other, scene)
        return to_the_left_m > MARGIN_M if direction == "LEFTOF" else -to_the_left_m > MARGIN_M

    return tuple(dict.fromkeys(key for key, other in pairs if fits(key, other)))


def left_m(object_id: str, scene: Scene) -> float:
    """Return the distance of an object to the robot's left at the start [m]."""
    dx, dy, yaw_rad = *_from_robot(object_id, scene), scene.robot.yaw_rad
    return dy * math.cos(yaw_rad) - dx * math.sin(yaw_rad)


def start_gap_m(object_id: str, scene: Scene) -> float:
    """Return the distance from the robot's start to the footprint of an object [m]."""
    half = _half_footprint_m(scene.objects[object_id])
    return math.hypot(
        *(max(0.0, abs(offset) - side) for offset, side in zip(_from_robot(object_id, scene), half, strict=True))
    )


def gap_m(first: str, second: str, scene: Scene) -> float:
    """Return the gap between the axis-aligned footprints of two objects [m]."""
    one, other = scene.objects[first], scene.objects[second]
    halves = (_half_footprint_m(one), _half_footprint_m(other))
    gaps = (
        max(0.0, abs(one.position[axis] - other.position[axis]) - halves[0][axis] - halves[1][axis]) for axis in (0, 1)
    )
    return math.hypot(*gaps)


def is_under(lower: str, upper: str, scene: Scene) -> bool:
    """Decide whether an object is below another one.

    The other's centre has to be within its footprint, and its top no higher than the other's bottom.
    """
    below, above = scene.objects[lower], scene.objects[upper]
    half = _half_footprint_m(below)
    within = all(abs(above.position[axis] - below.position[axis]) <= half[axis] for axis in (0, 1))
    bottom, top = above.position[2] - above.height_m / 2, below.position[2] + below.height_m / 2
    return within and top <= bottom + MARGIN_M


def is_behind(far: str, near: str, scene: Scene) -> bool:
    """Decide whether an object is behind another one, as seen from the robot's start: in its direction, farther."""
    (x, y), (other_x, other_y) = _from_robot(far, scene), _from_robot(near, scene)
    apart = abs(math.remainder(math.atan2(y, x) - math.atan2(other_y, other_x), math.tau))
    return apart < _SAME_DIRECTION_RAD and math.hypot(x, y) - math.hypot(other_x, other_y) > MARGIN_M


def _half_footprint_m(thing: SceneObject) -> tuple[float, float]:
    """Return the half extents, along x and y of the world, of the box around an object turned about z [m]."""
    w, x, y, z = thing.orientation
    cos, sin = abs(1.0 - 2.0 * (y * y + z * z)), abs(2.0 * (x * y + w * z))
    along, across, _ = thing.extent_m
    return (cos * along + sin * across) / 2, (sin * along + cos * across) / 2


def _from_robot(object_id: str, scene: Scene) -> tuple[float, float]:
    place, robot = scene.objects[object_id].position, scene.robot.position
    return place[0] - robot[0], place[1] - robot[1]


def _least(ids: Sequence[str], measure: Callable[[str], float]) -> tuple[str, ...]:
    """Return the object of the least measure together with all that are too close to it.

    Close candidates stay undecided, so that the query is refused as ambiguous rather than guessed.
    """
    least = min(map(measure, ids), default=0.0)
    return tuple(key for key in ids if measure(key) <= least + MARGIN_M)
