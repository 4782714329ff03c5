"""What it takes, beyond the atom itself, for a thing to count as put down or as picked up.

Put down: it stands upright, or as it stood in the scene. `(ontop glass_0 table_0)` is true of a glass that fell over,
and `(not (ontop glass_0 table_0))` must stay false of it, so this is no matter of the detector but of what was asked
for: no wish says that a thing shall lie, so that none is granted by one that does. Picked up: held clear of where it
was.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import bddl
from bddl import Atom
from executor.assets.transforms import bounds, rolls_freely
from executor.geometry import transform_from_quaternion
from executor.world.detectors import GRIPPER, box_around, read
from executor.world.world import World
from oag.model.categories import has_boards
from oag.revision.measurements import NOTHING_MEASURED, AtomMeasured

STANDS_DEG = 10.0
"""How far a thing on something level may be tilted from how it stood: no more than sags on crumbs."""

LEANS_DEG = 45.0
"""The same inside an item: the walls of a bowl are sloped, and what is smaller than its bottom comes to lean on them;
from here on it lies on another side than it stood on."""

PICKED_UP_M = 0.10
"""How far above its place a thing is held that counts as picked up."""

PLACING = frozenset({"inside", "ontop"})


@dataclass(frozen=True, slots=True)
class Handled:
    """Whether a thing is as whoever asked for it means it.

    Attributes:
        as_meant: False for one that fell over, or that is hardly lifted.
        measured: The numbers behind it, and the reason where something is wrong.
    """

    as_meant: bool = True
    measured: AtomMeasured = NOTHING_MEASURED


def put_down(atom: Atom, world: World) -> Handled:
    """Returns whether a thing stands upright or as in the scene, where an atom says that it is on or in something.

    What has no upright, such as a ball, always does; so does what is in the gripper.

    Args:
        atom: A ground atom that holds; one that says nothing of a place is as meant.
        world: Where things are; its scene is how they stood.
    """
    if atom.predicate not in PLACING or atom.args[0] not in world.dynamic_ids or atom.args[1] == GRIPPER:
        return Handled()
    item, support = atom.args
    if rolls_freely(world.assets[item]):
        return Handled()
    tilted_deg = tilt_deg(world, item)
    most_deg = LEANS_DEG if atom.predicate == "inside" and support in world.dynamic_ids else STANDS_DEG
    measured = AtomMeasured(tilted_deg=round(tilted_deg, 1))
    if tilted_deg <= most_deg:
        return Handled(measured=measured)
    words = f"{item} stands neither upright nor as it stood: {tilted_deg:.0f} degrees off; {most_deg:.0f} are the most"
    return Handled(False, replace(measured, reason=words))


def tilt_deg(world: World, item: str) -> float:
    """Returns by how much [deg] a thing is off how it stood at first, or off upright where that is less.

    How far a thing that is round about its own z axis is turned about that makes no difference.
    """
    thing = world.scene.objects[item]
    before = transform_from_quaternion(thing.position, thing.orientation)[2, :3]
    now = world.T_world_link(item)[2, :3]
    off_upright = _angle_deg(now[2])
    if world.assets[item].symmetric_about_z:
        return min(abs(off_upright - _angle_deg(before[2])), off_upright)
    return min(_angle_deg(float(before @ now)), off_upright)


def _angle_deg(cosine: float) -> float:
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def picked_up(atom: Atom, world: World) -> Handled:
    """Returns whether a thing that the gripper holds is clear of where it was in the scene.

    What was inside something is clear once it is out of that, what was on a shelf once it is out from between its
    boards; all else once it is `PICKED_UP_M` above its place.

    Args:
        atom: A ground atom that holds; one that is not about the gripper is as meant.
        world: Where things are; its scene is where they were.
    """
    if atom.predicate != "inside" or atom.args[1] != GRIPPER or atom.args[0] not in world.dynamic_ids:
        return Handled()
    item = atom.args[0]
    held_in = [fact for fact in _stated(world) if fact.predicate == "inside" and fact.args[0] == item]
    if any(read(fact, world).value for fact in held_in):
        return Handled(False, AtomMeasured(reason=f"{item} is still inside {held_in[0].args[1]}"))
    lifted_m = _lifted_m(world, item)
    measured = AtomMeasured(lifted_m=round(lifted_m, 4))
    if held_in or lifted_m >= PICKED_UP_M or _is_off_the_boards(world, item):
        return Handled(measured=measured)
    words = f"{item} is {100 * lifted_m:.1f} cm above its place; from {100 * PICKED_UP_M:.0f} cm on it is picked up"
    return Handled(False, replace(measured, reason=words))


def _is_off_the_boards(world: World, item: str) -> bool:
    """Decides whether a thing that stood on a shelf in the scene is over none of its boards."""
    for fact in _stated(world):
        if fact.predicate == "ontop" and fact.args[0] == item and fact.args[1] in world.assets:
            beyond_m = read(fact, world).measurements.centre_beyond_edge_m
            if has_boards(world.scene.objects[fact.args[1]].category) and beyond_m is not None and beyond_m > 0.0:
                return True
    return False


def _lifted_m(world: World, item: str) -> float:
    """How much higher the lowest point of a thing is than it was in the scene."""
    thing = world.scene.objects[item]
    T = transform_from_quaternion(thing.position, thing.orientation)
    before_m = T[2, 3] + bounds(world.assets[item], T[:3, :3])[0][2]
    centre, half = box_around(world, item)
    return float(centre[2] - half[2] - before_m)


def _stated(world: World) -> list[Atom]:
    """The atoms that the scene states to be true."""
    return [one.atom for fact in world.scene.facts for one in bddl.literals(fact) or () if one.value]
