"""Whether a goal holds in a recorded state, by the second geometry and nothing of the goal check.

What was put somewhere stands upright or as it stood, unless it is a ball, and the robot presses on it no more. What was
picked up is higher than it was, or no longer under what it was under. A goal that denies a place denies it of what fell
over, too. A spot that a task names besides its goal, such as "left of cup_0", has to be taken as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

import bddl
from bddl import Atom, Formula
from executor.audit.geometry import GROUND, IN_M, ROBOT, Snapshot
from oag import Scene, Task
from oag.model.scene import FLOOR
from oag.model.where import Where

LIFTED_M = 0.10
OPEN_FRACTION = 0.05
TILT_DEG = 12.0
LEAN_DEG = 45.0
GRIPPER = "gripper"
SIDE_GAP_M = 0.06  # At most between a thing and the one at whose side it is, where both are small.
SIDE_DEG = 55.0  # From the named direction: sides meet at 45.
_PLACES = ("inside", "ontop")
_HEADINGS_DEG = {"in front of": 180.0, "behind": 0.0, "left of": 90.0, "right of": -90.0}
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


def named_spots(task: Task) -> dict[str, Where]:
    """Return the spots and parts that a task names besides its goal, by the thing that ends there."""
    last = {subtask.target: subtask.where for subtask in task.subtasks}
    return {target: where for target, where in last.items() if where is not None}


def decide(
    goal: Formula,
    scene: Scene,
    before: Snapshot,
    after: Snapshot,
    spots: Mapping[str, Where] = MappingProxyType({}),
) -> SuccessDecision:
    """Return whether a goal holds in a state.

    Args:
        goal: The goal.
        scene: The concrete scene.
        before: The state at the episode's start.
        after: The state.
        spots: Where things have to be besides (`named_spots`); a part, such as a drawer, is not decided.
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
    values |= {f"{target} {where}": [_is_at_spot(target, where, scene, after)] * 2 for target, where in spots.items()}
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
    if name == "toggled_on" and len(arguments) == 1:
        # What can be switched by nothing is off; of what is no object nothing is known.
        return after.switched_on.get(arguments[0], False) if atom.args[0] in scene.objects else None
    if name == "upright" and len(arguments) == 1:
        return after.is_upright(arguments[0]) if arguments[0] in after.middles else None
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
        # Out of a compartment, or off the edge of what it stood on, it is picked up at any height.
        return is_up or (before.is_roofed(item) and not after.is_roofed(item)) or after.has_left(item, before)
    most_deg = LEAN_DEG if atom.predicate == "inside" and other in after.middles else TILT_DEG
    stands = after.is_ball(item) or after.tilt_deg(item, before) <= most_deg
    return stands and not after.is_pressed(item)


def _is_at_spot(item: str, where: Where, scene: Scene, after: Snapshot) -> bool | None:
    """Decide whether an item is near another thing on a side of it, as seen from the robot's start; None for a part."""
    if where.part or not {item, where.other} <= {*after.hulls}:
        return None
    (low, high), (other_low, other_high) = after.corners(item), after.corners(where.other)
    gap_m = float(np.linalg.norm(np.maximum(np.maximum(low - other_high, other_low - high), 0.0)[:2]))
    if gap_m > max(float(np.mean(high - low + other_high - other_low)) / 6.0, SIDE_GAP_M):
        return False
    if where.relation == "next to":
        return True
    apart = ((low + high) - (other_low + other_high))[:2]
    heading_deg = float(np.rad2deg(np.arctan2(apart[1], apart[0]) - scene.robot.yaw_rad))
    off_deg = abs((heading_deg - _HEADINGS_DEG[where.relation] + 180.0) % 360.0 - 180.0)
    return off_deg <= SIDE_DEG


def _owner_of(name: str, scene: Scene) -> str:
    """Return the geometry's name of an object; floors are the ground."""
    thing = scene.objects.get(name)
    return GROUND if name == "floor" or (thing is not None and thing.category == FLOOR) else name
