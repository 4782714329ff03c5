"""Changes of a concrete scene: a thing put elsewhere, a door opened or shut, things removed; facts follow.

None of them is checked here: `executor.scenes.validation.settle` says whether a changed scene holds in physics. What
geometry found impossible before a change may be possible after it, so a changed scene has no `known`.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

import bddl
from executor.assets.library import asset_for
from executor.scenes.placement import AtEdge, Clearance, PlaceSpec, place
from executor.scenes.room import NoRoom, Room
from executor.scenes.vary import resting_on
from oag import Scene
from oag.model.scene import FLOOR
from oag.model.symbols import Kind

_EDGES = ("-x", "+x", "-y", "+y")
_OPENED = 0.9
_HANDY_M = 0.8  # Height of a place that the hand gets to from most stances.
_INSET_M = (0.08, 0.16)
_CLEAR = Clearance(other_m=0.05)
_STANDS = ("ontop", "inside", "nextto", "under", "touching")


def without(scene: Scene, names: Iterable[str]) -> Scene:
    """Return the scene without some objects, and without what they carry."""
    gone = set(names)
    gone |= {carried for name in tuple(gone) for carried in resting_on(scene, name)}
    objects = {name: thing for name, thing in scene.objects.items() if name not in gone}
    facts = tuple(fact for fact in scene.facts if gone.isdisjoint(_named(fact)))
    return replace(scene, objects=objects, facts=facts, known=())


def with_door(scene: Scene, name: str, *, is_open: bool) -> Scene:
    """Return the scene in which all doors of an object are wide open, or shut.

    Raises:
        AssetError: The object's model does not stand open at the start.
    """
    thing = scene[name]
    changed = replace(thing, parameters={**thing.parameters, "open_fraction": _OPENED if is_open else 0.0})
    asset_for(changed)
    state = bddl.Atom("open", (name,))
    fact = state if is_open else bddl.Not(state)
    others = (other for other in scene.facts if state not in bddl.atoms(other))
    return replace(scene, objects={**scene.objects, name: changed}, facts=(*others, fact), known=())


def has_one_way(scene: Scene, name: str) -> bool:
    """Decide whether all that opens of an object can stand open at once: one drawer, or doors side by side."""
    doors = asset_for(scene[name]).doors
    return len(doors) == 1 or (bool(doors) and all(door.kind == "revolute" for door in doors))


def elsewhere(scene: Scene, item: str, support: str, relation: str, number: int = 0) -> Scene:
    """Return the scene in which an item stands upright at another free place of a support, near one of its edges.

    Args:
        relation: "ontop" or "inside".
        number: Which of several places; equal arguments give equal places.

    Raises:
        NoRoom: No place is free, the item carries something, or the support is the floor.
    """
    kind = "interior" if relation == "inside" else "surface"
    regions = [region for region in asset_for(scene[support]).regions if region.kind == kind]
    if not regions:
        raise NoRoom(item, f"{support} has no such place")
    base_m = scene[support].position[2]
    region = sorted(regions, key=lambda one: abs(base_m + one.floor_m[2] - _HANDY_M))[number // 2 % len(regions)]
    seed = zlib.crc32(f"{item} {support} {number}".encode())
    edge = AtEdge(_EDGES[number % len(_EDGES)], _INSET_M)
    return placed(scene, item, relation, PlaceSpec(support, region.name, edge, clear=_CLEAR), seed)


def placed(scene: Scene, item: str, relation: str, asked: PlaceSpec, seed: int = 0) -> Scene:
    """Return the scene in which an item stands upright at a free place that is asked for.

    Args:
        relation: "ontop" or "inside", as the region that is asked for has it.
        seed: Seeds what the place leaves open.

    Raises:
        NoRoom: No place is free, the item carries something, or the support is the floor.
    """
    if resting_on(scene, item):
        raise NoRoom(item, "carries something")
    if scene[asked.support].category == FLOOR:
        raise NoRoom(item, "things are moved between furniture, not over the floor")
    room = Room(scene.name, "", np.random.default_rng(seed), 0.0, 0.0)
    room.objects.update({key: thing for key, thing in scene.objects.items() if key != item and thing.category != FLOOR})
    facts = tuple(fact for fact in scene.facts if not _is_about_place(fact, item))
    for fact in facts:
        if isinstance(fact, bddl.Atom) and fact.predicate in ("ontop", "inside") and fact.args[1] in room.objects:
            room.relate(fact.predicate, *fact.args)
    place(room, scene[item], asked)
    objects = {key: room.objects.get(key, thing) for key, thing in scene.objects.items()}
    return replace(scene, objects=objects, facts=(*facts, bddl.Atom(relation, (item, asked.support))), known=())


def supports_near(scene: Scene, item: str) -> Iterator[tuple[str, str]]:
    """Yield furniture with the relation that it can carry an item in, the nearest one first, tops before interiors."""
    here = np.array(scene[item].position)
    fixtures = [key for key, thing in scene.objects.items() if thing.kind is not Kind.ITEM and thing.category != FLOOR]
    fixtures.sort(key=lambda key: (float(np.linalg.norm(np.array(scene[key].position) - here)), key))
    for relation, kind in (("ontop", "surface"), ("inside", "interior")):
        for key in fixtures:
            if any(region.kind == kind for region in asset_for(scene[key]).regions):
                yield key, relation


def place_of(scene: Scene, item: str) -> tuple[str, str] | None:
    """Return the furniture that an item stands on or in, with the relation, by the facts; None where they say none."""
    atoms = (fact for fact in scene.facts if isinstance(fact, bddl.Atom) and fact.args[0] == item)
    found = (atom for atom in atoms if atom.predicate in ("ontop", "inside") and atom.args[1] in scene.objects)
    return next(((atom.args[1], atom.predicate) for atom in found), None)


def _is_about_place(fact: bddl.Formula, item: str) -> bool:
    return item in _named(fact) and any(atom.predicate in _STANDS for atom in bddl.atoms(fact))


def _named(fact: bddl.Formula) -> set[str]:
    return {name for atom in bddl.atoms(fact) for name in atom.args}
