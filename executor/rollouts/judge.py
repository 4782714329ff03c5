"""Judges goals on the physical world: each conjunct by the detectors, and how far items are from their places.

The distances turn "it fell beside the shelf" into a number that a flow can be corrected by.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from bddl import Atom, Formula, Not, conjuncts, evaluate, format
from executor.assets.model import Region
from executor.geometry import Array, inverse, rotation_z
from executor.records.rollout import Failure, FailureKind
from executor.world.detectors import GRIPPER, box_around, fingers_touching, read
from executor.world.world import World
from oag.revision.grounds import GoalReading, Miss, Unmet
from oag.revision.measurements import AtomMeasured

PLACES = frozenset({"inside", "ontop", "under", "nextto"})
_KINDS = {"inside": "interior", "ontop": "surface"}
CLEARANCE_M = 0.01
"""How far the item's box should stay away from the sides of its place."""

FREE_FALL_M = 0.04
"""How far above its place an item may be let go."""


def judge(goal: Formula, world: World) -> tuple[GoalReading, ...]:
    """Returns a reading for every conjunct of a goal.

    A literal is read by its detector; any other formula is evaluated over its atoms' readings, quantifiers over the
    scene's objects. What no detector can tell counts as not satisfied, and says so.
    """
    return tuple(_judge_conjunct(part, world) for part in conjuncts(goal))


def judge_at_rest(goal: Formula, world: World) -> tuple[GoalReading, ...]:
    """Returns a reading for every conjunct of a task's goal when everything is done: what is still held is in no place.

    Atoms that put an item into or onto something hold only once no finger presses on it; the others are read as by
    `judge`.
    """
    return tuple(
        _let_go(reading, part, world) for reading, part in zip(judge(goal, world), conjuncts(goal), strict=True)
    )


def _let_go(reading: GoalReading, part: Formula, world: World) -> GoalReading:
    places = isinstance(part, Atom) and part.predicate in PLACES and part.args[1] != GRIPPER
    if not (places and reading.satisfied and isinstance(part, Atom) and part.args[0] in world.assets):
        return reading
    fingers = fingers_touching(world, part.args[0])
    return replace(reading, value=fingers == 0, measurements=replace(reading.measurements, fingers_touching=fingers))


def _judge_conjunct(part: Formula, world: World) -> GoalReading:
    atom, wanted = (part.body, False) if isinstance(part, Not) else (part, True)
    if isinstance(atom, Atom):
        reading = read(atom, world)
        if reading.value is None:
            undecided = replace(reading.measurements, undecided=True)
            return GoalReading(format(atom), wanted, not wanted, undecided, atom.predicate)
        return GoalReading(format(atom), wanted, reading.value, reading.measurements, atom.predicate)
    categories = {object_id: thing.category for object_id, thing in world.scene.objects.items()}
    value = evaluate(part, lambda atom: read(atom, world).value, categories)
    return GoalReading(format(part), True, value is True, AtomMeasured(undecided=value is None))


def as_failure(readings: tuple[GoalReading, ...], name: str) -> Failure | None:
    """Returns a failure that names what a goal still lacks, or None when it holds."""
    missing = [reading for reading in readings if not reading.satisfied]
    if not missing:
        return None
    wanted = [r.literal if r.wanted else f"(not {r.literal})" for r in missing]
    return Failure(
        FailureKind.GOAL_NOT_REACHED,
        f"{name} ran, but {' and '.join(wanted)} does not hold",
        tuple(Unmet(reading.literal, reading.measurements) for reading in missing),
    )


def misses(goal: Iterable[Atom], world: World, base_yaw_rad: float) -> tuple[Miss, ...]:
    """Returns how far the items of a goal are from their places, one for each `inside` or `ontop` that has a place.

    Args:
        goal: Atoms that shall be true.
        world: Where things are.
        base_yaw_rad: Where the robot faces, which is "forward".
    """
    return tuple(found for atom in goal for found in _nearest(atom, world, base_yaw_rad))


def _nearest(atom: Atom, world: World, base_yaw_rad: float) -> Iterator[Miss]:
    if atom.predicate not in _KINDS or len(atom.args) != 2:
        return
    item, support = atom.args
    if item not in world.dynamic_ids or support not in world.assets:
        return
    regions = [r for r in world.assets[support].regions if r.kind == _KINDS[atom.predicate]]
    found = [_miss(atom, world, region, base_yaw_rad) for region in regions]
    if found:
        yield min(found, key=lambda miss: miss.distance_m)


def _miss(atom: Atom, world: World, region: Region, base_yaw_rad: float) -> Miss:
    item, support = atom.args
    T_world_link = world.T_world_link(support, region.link)
    centre, half = box_around(world, item, inverse(T_world_link))
    middle, room = np.asarray(region.center_m), np.asarray(region.half_extents_m)
    # Where its centre may be: inside by its own size at the sides; standing, or a little above, in height.
    free = np.maximum(room - half - CLEARANCE_M, 0.0)
    low, high = middle - free, middle + free
    standing = middle[2] - room[2] + half[2]
    low[2], high[2] = standing, standing + FREE_FALL_M
    to_robot = rotation_z(base_yaw_rad).T @ T_world_link[:3, :3]
    offset: Array = to_robot @ (np.clip(centre, low, high) - centre)
    to_middle: Array = to_robot @ (middle - centre)
    numbers = (float(v) for v in np.round([*offset, *to_middle[:2]], 4))
    return Miss(format(atom), *numbers)
