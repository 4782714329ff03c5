"""Setting a thing down to take it again: where no grasp that can be had where it stands serves where it goes.

The hand keeps its pitch from taking to putting. What stands among others may allow steep hands only, and a low
compartment level ones only; on a free top it can be taken either way. Two subtasks more say so in the plan, and the
graph verifies it again before it runs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import bddl
from executor.assets.library import asset_for
from executor.records.rollout import SubtaskRecord
from oag import Action, ActionFlow, Primitive, Scene, SceneObject, SimpleTask, Task
from oag.flows.search import PLACE, taking
from oag.model.facts import GRIPPER
from oag.revision.measurements import SupportDrive, first_of

MORE = 2
"""How many subtasks are inserted: the thing is set down, and taken again."""

MOST_SUPPORTS = 2
"""On how many supports a thing is set down, one after the other, before the plan is left as it was."""


def found_no_place(record: SubtaskRecord, subtask: SimpleTask, held: str | None) -> bool:
    """Decides whether a thing in hand could not be put anywhere in its place, whatever the numbers that were open.

    Args:
        record: What was done.
        subtask: What was to be done.
        held: Id of what was in the gripper at the start.
    """
    chosen_here = any(action.unfilled for action in subtask.flow or ())
    if record.succeeded or held != subtask.target or subtask.support_goal is None or not chosen_here:
        return False
    drives = (first_of(step.measurements, SupportDrive) for step in record.steps)
    return any(drive is not None and drive.nominal for drive in drives)


def regrasps(task: Task, index: int, scene: Scene) -> Iterator[tuple[str, Task]]:
    """Yields tasks in which a thing is set down and taken again before it is put where a subtask wants it.

    Args:
        task: The task as it is.
        index: Of the subtask that found no place.
        scene: The concrete scene.

    Returns:
        Ids of supports, where it stood first, then the nearest ones to that, each with its task.
    """
    place = task.subtasks[index]
    taken = [s for s in task.subtasks[:index] if s.target == place.target and s.support_init in scene.objects]
    if not taken:
        return
    first = str(taken[-1].support_init)
    here = np.array(scene[first].position)
    far_m = {
        name: float(np.linalg.norm(np.array(thing.position) - here))
        for name, thing in scene.objects.items()
        if name != place.support_goal and thing.role == "A" and _has_a_top(scene, name)
    }
    for support in sorted(far_m, key=lambda name: (far_m[name], name))[:MOST_SUPPORTS]:
        more = (_set_down(place.target, support), _taken_again(place.target, scene[support]))
        yield support, replace(task, subtasks=(*task.subtasks[:index], *more, *task.subtasks[index:]))


def _has_a_top(scene: Scene, name: str) -> bool:
    return any(region.kind == "surface" for region in asset_for(scene[name]).regions)


def _set_down(item: str, support: str) -> SimpleTask:
    held, on = bddl.Atom("inside", (item, GRIPPER)), bddl.Atom("ontop", (item, support))
    detail = f"Set {item} down on {support}, where it can be taken otherwise."
    return SimpleTask(f"set_{item}_down", detail, item, None, support, held, on, _flow(PLACE))


def _taken_again(item: str, support: SceneObject) -> SimpleTask:
    on = bddl.Atom("ontop", (item, support.id))
    detail = f"Take {item} again, as it can be put where it goes."
    flow = _flow(taking("ontop", support.category))
    return SimpleTask(f"take_{item}_again", detail, item, support.id, None, on, bddl.Not(on), flow)


def _flow(primitives: tuple[Primitive, ...]) -> ActionFlow:
    return tuple(Action(primitive) for primitive in primitives)
