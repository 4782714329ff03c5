"""A drawn scene put into physics: nothing overlaps, doors can swing, nothing falls, and the facts are what is read.

A generator decides where things stand from boxes; what counts is what the engine says. A scene that does not hold is
refused with the thing and the number, never quietly repaired.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

import bddl
from executor.assets.footprint import Footprint, deepest_m, open_fraction, solid_parts
from executor.assets.model import Joint
from executor.geometry import pose_vector
from executor.world.detectors import read, touching_bodies
from executor.world.engine import GROUND, ROBOT, TIMESTEP_S
from executor.world.world import World
from oag import Scene

SETTLE_S = 1.0
MOST_MOVED_M = 0.01
MOST_TURNED_RAD = 0.1
MOST_OVERLAP_M = 0.001
SWING_RAD = np.deg2rad(60.0)
"""How far a door on a vertical hinge must open before it meets other furniture; a hand gets in beside it."""

SLIDE_SHARE = 0.6
"""How much of its way a drawer or a lid must go before it does."""

_SWING_STEPS = 12  # One every eight degrees.
_AJAR = 0.02  # Well below the fraction from which on a thing is open.


class Unsettled(ValueError):
    """A scene is not what it says once physics runs.

    Attributes:
        kind: "overlap", "door-blocked", "moved", "ajar" or "fact".
        object_id: The thing.
    """

    def __init__(self, scene: str, kind: str, object_id: str, problem: str) -> None:
        super().__init__(f"scene {scene}: {object_id} {problem}")
        self.kind, self.object_id = kind, object_id


def settle(scene: Scene, *, seconds: float = SETTLE_S, most_moved_m: float = MOST_MOVED_M) -> Scene:
    """Returns the scene with every free thing where physics leaves it.

    Args:
        scene: A concrete scene, sizes adjusted.
        seconds: How long physics runs before poses are read.
        most_moved_m: How far anything may move meanwhile.

    Raises:
        Unsettled: Things overlap, a door or drawer is blocked by other furniture, a thing moved or turned further
            than allowed, or a fact and the detectors disagree.
        AssetError: An object cannot be built.
    """
    with World(scene, oracle=True) as still:
        _check_overlaps(scene, still)
        _check_doors(scene, still)
    with World(scene) as world:
        for _ in range(round(seconds / TIMESTEP_S)):
            world.step()
        settled = _settled(scene, world, most_moved_m)
        _check_facts(settled, world)
    return settled


def overlaps(world: World) -> Iterator[tuple[str, str, float]]:
    """Yields two owners and how deep they overlap, in metres, for every pair that does.

    Args:
        world: A world built with `oracle=True`, its poses those to look at.
    """
    world.step()
    for contact in world.contacts():
        a, b = contact.a, contact.b
        if a.owner != b.owner and contact.separation_m < 0.0 and {a.owner, b.owner} != {ROBOT, GROUND}:
            yield a.owner, b.owner, -contact.separation_m
    # The engine reports no contacts between bodies that cannot move, so furniture is compared part by part.
    fixed = [obj for name, obj in world.scene.objects.items() if name not in world.dynamic_ids]
    for first, second in combinations(fixed, 2):
        if Footprint.of(first).gap_m(Footprint.of(second)) < 0.0:
            depth_m = deepest_m(solid_parts(first), solid_parts(second))
            if depth_m > 0.0:
                yield first.id, second.id, depth_m


def _check_overlaps(scene: Scene, world: World) -> None:
    for first, second, depth_m in overlaps(world):
        if depth_m > MOST_OVERLAP_M:
            problem = f"overlaps {second} by {1000 * depth_m:.1f} mm"
            raise Unsettled(scene.name, "overlap", first, problem)


def _check_doors(scene: Scene, world: World) -> None:
    """Opens each door and drawer alone and looks for other furniture in its way."""
    for object_id in world.articulated_ids:
        for joint in world.assets[object_id].joints:
            start = world.joint_position(object_id, joint.name)
            for position in np.linspace(*_swing(joint), _SWING_STEPS):
                world.set_joint_position(object_id, joint.name, float(position))
                world.step()
                blocker = _blocker(world, object_id, joint)
                if blocker is not None:
                    angle = f"{np.rad2deg(position):.0f} degrees" if joint.kind == "revolute" else f"{position:.2f} m"
                    problem = f"meets {blocker} when its {joint.child} is open by {angle}"
                    raise Unsettled(scene.name, "door-blocked", object_id, problem)
            world.set_joint_position(object_id, joint.name, start)


def _swing(joint: Joint) -> tuple[float, float]:
    low, high = joint.limits
    upright = joint.kind == "revolute" and abs(joint.axis[2]) > 0.9
    return low, min(high, float(SWING_RAD)) if upright else low + SLIDE_SHARE * (high - low)


def _blocker(world: World, object_id: str, joint: Joint) -> str | None:
    """The fixed furniture that a moving link overlaps, if any."""
    for contact in world.contacts({object_id}):
        owners = {contact.a.owner, contact.b.owner}
        links = {body.link for body in (contact.a, contact.b) if body.owner == object_id}
        other = next(iter(owners - {object_id}), None)
        loose = other is None or other in (ROBOT, GROUND) or other in world.dynamic_ids
        if not loose and joint.child in links and contact.separation_m < -MOST_OVERLAP_M:
            return other
    return None


def _settled(scene: Scene, world: World, most_moved_m: float) -> Scene:
    objects = dict(scene.objects)
    for name in world.dynamic_ids:
        T = world.T_world_link(name)
        x, y, z, *quaternion = (round(float(value), 6) for value in pose_vector(T))
        before = scene.objects[name]
        moved_m = float(np.linalg.norm(np.subtract((x, y, z), before.position)))
        if moved_m > most_moved_m:
            raise Unsettled(scene.name, "moved", name, f"moved {1000 * moved_m:.0f} mm within the settling time")
        cosine = abs(float(np.dot(before.orientation, quaternion)))
        turned_rad = 2.0 * float(np.arccos(min(cosine, 1.0)))
        if turned_rad > MOST_TURNED_RAD:
            problem = f"turned {np.rad2deg(turned_rad):.0f} degrees within the settling time"
            raise Unsettled(scene.name, "moved", name, problem)
        w, i, j, k = (float(part) for part in np.asarray(quaternion) / np.linalg.norm(quaternion))
        objects[name] = replace(before, position=(x, y, z), orientation=(w, i, j, k))
    for name in world.articulated_ids:
        for joint in world.assets[name].joints:
            opened = joint.fraction(world.joint_position(name, joint.name)) - open_fraction(scene.objects[name])
            if abs(opened) > _AJAR:
                problem = f"does not stay as it is: its {joint.child} moved by {100 * abs(opened):.0f} % of its range"
                raise Unsettled(scene.name, "ajar", name, problem)
    return replace(scene, objects=objects)


def _check_facts(scene: Scene, world: World) -> None:
    """Compares every fact that a detector can read, and every `ontop` and `inside` that no fact states."""
    stated = {literal.atom: literal.value for fact in scene.facts for literal in bddl.literals(fact) or ()}
    # What cannot move touches nothing that cannot move, as far as the engine tells: a microwave on its counter.
    asked = {atom: value for atom, value in stated.items() if len(atom.args) == 1 or atom.args[0] in world.dynamic_ids}
    hollow = [name for name, asset in world.assets.items() if any(r.kind == "interior" for r in asset.regions)]
    for item in world.dynamic_ids:
        # Only what touches a thing can carry it, and only what is hollow can contain it.
        carriers = set(touching_bodies(world, item)) & world.assets.keys() if "ontop" in scene.closed else set()
        containers = set(hollow) - {item} if "inside" in scene.closed else set()
        for other in sorted(carriers):
            asked.setdefault(bddl.Atom("ontop", (item, other)), False)
        for other in sorted(containers):
            asked.setdefault(bddl.Atom("inside", (item, other)), False)
    for atom, value in asked.items():
        found = read(atom, world)
        if found.value is not None and found.value is not value:
            problem = f"is {'' if found.value else 'not '}{atom.predicate} {' '.join(atom.args[1:])} by the detectors"
            numbers = ", ".join(f"{key} {number}" for key, number in found.measurements.to_json().items())
            raise Unsettled(scene.name, "fact", atom.args[0], f"{problem.strip()}, against the facts ({numbers})")
