"""Whether a goal holds in a recorded state, by the second geometry and nothing of the goal check.

What was put somewhere stands upright or as it stood, unless it is a ball, and the robot presses on it no more. What was
picked up is higher than it was, or no longer under what it was under. A goal that denies a place denies it of what fell
over, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bddl
from bddl import Atom, Formula
from executor.audit.geometry import GROUND, IN_M, ROBOT, Snapshot
from oag import Scene
from oag.model.scene import FLOOR

LIFTED_M = 0.10
OPEN_FRACTION = 0.05
TILT_DEG = 12.0
LEAN_DEG = 45.0
GRIPPER = "gripper"
_PLACES = ("inside", "ontop")
Reader = Callable[[Atom], bool | None]


@dataclass(frozen=True, slots=True)
class SuccessDecision:
    """Whether a goal holds.

    Attributes:
        value: True, False, or None where this geometry knows no predicate of it.
        missing: Parts of the goal that do not hold, or are not decided, as BDDL.
    """

    value: bool | None
    missing: tuple[str, ...] = ()


def decide(goal: Formula, scene: Scene, before: Snapshot, after: Snapshot) -> SuccessDecision:
    """Return whether a goal holds in a state.

    Args:
        goal: The goal.
        scene: The concrete scene.
        before: The state at the episode's start.
        after: The state.
    """
    categories = {name: thing.category for name, thing in scene.objects.items()}

    def there(atom: Atom) -> bool | None:
        return _is_there(atom, scene, before, after)

    def as_meant(atom: Atom) -> bool | None:
        return _is_as_meant(atom, there(atom), before, after)

    # A thing that fell over is still there where the goal denies that it is: both readings have to agree.
    values = {
        bddl.format(part): [bddl.evaluate(part, reads, categories) for reads in (there, as_meant)]
        for part in bddl.conjuncts(goal)
    }
    missing = tuple(part for part, found in values.items() if found != [True, True])
    if not missing:
        return SuccessDecision(True)
    return SuccessDecision(False if any(False in found for found in values.values()) else None, missing)


def holds(goal: Formula, scene: Scene, before: Snapshot, after: Snapshot) -> bool:
    """Decide whether a goal holds in a state; what this geometry does not know does not hold."""
    return decide(goal, scene, before, after).value is True


def _is_there(atom: Atom, scene: Scene, before: Snapshot, after: Snapshot) -> bool | None:
    """Decide an atom by places alone; None where its predicate or its objects are of no geometry."""
    name, arguments = atom.predicate, tuple(_owner_of(each, scene) for each in atom.args)
    if name == "open" and len(arguments) == 1:
        return after.open_fraction.get(arguments[0], 0.0) > OPEN_FRACTION
    if len(arguments) != 2:
        return None
    item, other = arguments
    if item == other:
        return False
    if other == GRIPPER:
        return after.is_held(item) if name in ("inside", "touching") and item in after.middles else None
    if name == "touching" and {item, other} <= {*after.hulls, GROUND, ROBOT}:
        return after.is_touched(item, other)
    if item not in after.middles or other not in (*after.hulls, GROUND):
        # Furniture stays where the scene has it.
        return False if name in _PLACES and item in after.hulls else None
    decided: dict[str, Callable[[str, str], bool]] = {
        "inside": after.is_in,
        "ontop": after.is_on,
        "under": after.is_under,
        "nextto": after.is_next_to,
    }
    if name not in decided or (other == GROUND and name != "ontop"):
        return None
    return decided[name](item, other)


def _is_as_meant(atom: Atom, is_there: bool | None, before: Snapshot, after: Snapshot) -> bool | None:
    """Decide an atom as a wish means it: set down upright and let go, or picked up for good."""
    if not is_there or atom.predicate not in _PLACES:
        return is_there
    item, other = atom.args
    if other == GRIPPER:
        is_up = after.lowest_m(item) - before.lowest_m(item) >= LIFTED_M - IN_M
        return is_up or (before.is_roofed(item) and not after.is_roofed(item))
    most_deg = LEAN_DEG if atom.predicate == "inside" and other in after.middles else TILT_DEG
    stands = after.is_ball(item) or after.tilt_deg(item, before) <= most_deg
    return stands and not after.is_pressed(item)


def _owner_of(name: str, scene: Scene) -> str:
    """Return the geometry's name of an object; floors are the ground."""
    thing = scene.objects.get(name)
    return GROUND if name == "floor" or (thing is not None and thing.category == FLOOR) else name
