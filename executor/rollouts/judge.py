"""Judges goals on the physical world: each conjunct by the detectors, with what they measured."""

from __future__ import annotations

from dataclasses import replace

from bddl import Atom, Formula, Not, conjuncts, evaluate, format
from executor.records.rollout import Failure, FailureKind, Reading
from executor.world.detectors import GRIPPER, fingers_touching, read
from executor.world.world import World
from oag.revision.grounds import Unmet

PLACES = frozenset({"inside", "ontop", "under", "nextto"})


def judge(goal: Formula, world: World) -> tuple[Reading, ...]:
    """Returns a reading for every conjunct of a goal.

    A literal is read by its detector; any other formula is evaluated over its atoms' readings, quantifiers over the
    scene's objects. What no detector can tell counts as not satisfied, and says so.
    """
    return tuple(_judge_conjunct(part, world) for part in conjuncts(goal))


def judge_at_rest(goal: Formula, world: World) -> tuple[Reading, ...]:
    """Returns a reading for every conjunct of a task's goal when everything is done: what is still held is in no place.

    Atoms that put an item into or onto something hold only once no finger presses on it; the others are read as by
    `judge`.
    """
    return tuple(
        _let_go(reading, part, world) for reading, part in zip(judge(goal, world), conjuncts(goal), strict=True)
    )


def _let_go(reading: Reading, part: Formula, world: World) -> Reading:
    places = isinstance(part, Atom) and part.predicate in PLACES and part.args[1] != GRIPPER
    if not (places and reading.satisfied and isinstance(part, Atom) and part.args[0] in world.assets):
        return reading
    fingers = fingers_touching(world, part.args[0])
    return replace(reading, value=fingers == 0, measurements={**reading.measurements, "fingers_touching": fingers})


def _judge_conjunct(part: Formula, world: World) -> Reading:
    atom, wanted = (part.body, False) if isinstance(part, Not) else (part, True)
    if isinstance(atom, Atom):
        reading = read(atom, world)
        if reading.value is None:
            return Reading(format(atom), wanted, not wanted, {**reading.measurements, "undecided": True})
        return Reading(format(atom), wanted, reading.value, reading.measurements)
    categories = {object_id: thing.category for object_id, thing in world.scene.objects.items()}
    value = evaluate(part, lambda atom: read(atom, world).value, categories)
    return Reading(format(part), True, value is True, {"undecided": value is None})


def as_failure(readings: tuple[Reading, ...], name: str) -> Failure | None:
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
