"""Things that a task has nothing to do with, added where there is room on furniture that the task does not use."""

from __future__ import annotations

from typing import Any

import numpy as np

import bddl
from executor.assets import library
from executor.assets.library import asset_for
from executor.scenes.kitchens import PANTRY
from executor.scenes.rooms import Clearance, NoRoom, Room, place
from oag import Scene, SceneObject, Task
from oag.model.categories import Kind
from oag.model.scenefile import FLOOR

PREFIX = "distractor_"
"""Begin of their ids."""

_CLEAR = Clearance(other_m=0.06)  # As far apart as what lies about in the households' rooms.


def with_distractors(scene: Scene, task: Task, most: int, rng: np.random.Generator) -> Scene:
    """Returns the scene with one to `most` things more, fewer where there is no room; none is like what is there.

    Args:
        scene: Before sizes are adjusted and physics has settled it.
        task: Whose furniture is left alone.
        most: How many at most.
        rng: Draws them.
    """
    room = Room(scene.name, "", rng, 0.0, 0.0)
    room.objects.update({name: thing for name, thing in scene.objects.items() if thing.category != FLOOR})
    for fact in scene.facts:
        if isinstance(fact, bddl.Atom) and fact.predicate in ("ontop", "inside") and fact.args[1] in scene.objects:
            room.relate(fact.predicate, *fact.args)
    used = {name for part in task.subtasks for name in (part.target, part.support_init, part.support_goal)}
    tops = [name for name, thing in room.objects.items() if name not in used and _has_top(thing)]
    there = {_called(thing.category) for thing in scene.objects.values()}
    models = [model for model in PANTRY if _called(library.entry(model).category) not in there]
    count = int(rng.integers(1, most + 1))
    added: dict[str, str] = {}
    for model in rng.permutation(models)[:count]:
        thing = room.draw(str(model), f"{PREFIX}{len(added)}")
        for support in rng.permutation(tops):
            try:
                added[place(room, thing, str(support), clear=_CLEAR)] = str(support)
                break
            except NoRoom:
                continue
    rooms = {fact.args[1] for fact in scene.facts if isinstance(fact, bddl.Atom) and fact.predicate == "inroom"}
    facts = [bddl.Atom("ontop", pair) for pair in added.items()]
    facts += [bddl.Atom("inroom", (name, kind)) for name in added for kind in sorted(rooms)[:1]]
    objects = {**scene.objects, **{name: room.objects[name] for name in added}}
    return Scene(scene.name, scene.robot, objects, (*scene.facts, *facts), scene.closed, scene.variation)


def distractors_in(scene: Scene) -> dict[str, Any]:
    """Returns the model of each thing that was added."""
    return {name: thing.model for name, thing in scene.objects.items() if name.startswith(PREFIX)}


def _has_top(thing: SceneObject) -> bool:
    if thing.kind is Kind.ITEM:
        return False
    regions = asset_for(thing).regions
    return bool(regions) and any(region.kind == "surface" and region.name == "top" for region in regions)


def _called(category: str) -> str:
    """What a thing is called at its shortest: a half apple is an apple."""
    return category.rsplit("_", 1)[-1]
