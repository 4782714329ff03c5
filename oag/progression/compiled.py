"""Subtasks prepared for progression: their contexts, and their formulas as conditions where they are literals."""

from __future__ import annotations

from dataclasses import dataclass

import bddl
from oag.model.actions import ActionFlow
from oag.model.categories import Kind
from oag.model.scene import Scene
from oag.table.library import Context, Needed, Rows, clauses_of, needed, open_at_top, placement_among, placement_of
from oag.task.task import SimpleTask, Task


@dataclass(frozen=True, slots=True)
class CompiledSubtask:
    """A subtask with everything looked up that progression needs.

    Attributes:
        rows: The primitives' table for its objects.
        init: What it needs where it starts.
        goal: What it needs where it ends.
        flow: Its actions, None when there are none yet.
    """

    rows: Rows
    init: Needed
    goal: Needed
    flow: ActionFlow | None

    @property
    def context(self) -> Context:
        """The objects that the meaning of its primitives depends on."""
        return self.rows.context


def compile_subtask(
    subtask: SimpleTask,
    scene: Scene,
    articulated: tuple[str, ...],
    tables: dict[Context, Rows] | None = None,
    vessels: tuple[str, ...] | None = None,
) -> CompiledSubtask:
    """Returns a subtask ready for progression; its target must be in the scene.

    Args:
        subtask: The subtask.
        scene: Its scene.
        articulated: From `articulated_ids`.
        tables: Tables of other subtasks of the plan, which are shared where the objects are the same.
        vessels: From `vessel_ids`, where they are known already.
    """
    literals = bddl.literals(subtask.goal)
    goal = subtask.goal if literals is None else clauses_of(literals)
    context = Context(
        target=subtask.target,
        support_goal=subtask.support_goal,
        placement=(
            placement_among(goal, subtask.target) if isinstance(goal, tuple) else placement_of(goal, subtask.target)
        ),
        target_is_item=scene.objects[subtask.target].kind is Kind.ITEM,
        articulated=articulated,
        vessels=vessel_ids(scene) if vessels is None else vessels,
    )
    rows = None if tables is None else tables.get(context)
    if rows is not None:
        rows.shared()
    else:
        rows = Rows(context)
        if tables is not None:
            tables[context] = rows
    return CompiledSubtask(
        rows=rows,
        init=needed(subtask.init),
        goal=goal,
        flow=subtask.flow,
    )


def compile_plan(task: Task, scene: Scene) -> tuple[CompiledSubtask, ...]:
    """Returns all subtasks of a task ready for progression; their targets must be in the scene."""
    articulated, vessels = articulated_ids(scene), vessel_ids(scene)
    tables: dict[Context, Rows] = {}
    return tuple(compile_subtask(subtask, scene, articulated, tables, vessels) for subtask in task.subtasks)


def articulated_ids(scene: Scene) -> tuple[str, ...]:
    """Returns the ids of the scene's articulated fixtures, in the scene's order."""
    return tuple(key for key, thing in scene.objects.items() if thing.kind is Kind.ARTICULATED)


def vessel_ids(scene: Scene) -> tuple[str, ...]:
    """Returns the ids of the scene's items that are open at the top, in the scene's order."""
    things = scene.objects.items()
    return tuple(key for key, thing in things if thing.kind is Kind.ITEM and open_at_top(thing.category))
