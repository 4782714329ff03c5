"""Subtasks prepared for progression: rows of the table, and formulas as conditions where they are literals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from oag.model.actions import ActionFlow
from oag.model.categories import Kind
from oag.model.facts import Fact
from oag.model.scene import Scene
from oag.table.library import Context, Needed, Rows, needed, open_at_top, placement_among, placement_of
from oag.table.state import facts_of
from oag.task.task import SimpleTask


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


def compile_plan(subtasks: Sequence[SimpleTask], scene: Scene) -> tuple[CompiledSubtask, ...]:
    """Returns subtasks ready for progression; their targets must be in the scene."""
    items = [(key, thing.category) for key, thing in scene.objects.items() if thing.kind is Kind.ITEM]
    articulated, vessels = articulated_ids(scene), tuple(key for key, category in items if open_at_top(category))
    tables: dict[Context, Rows] = {}
    compiled = []
    for subtask in subtasks:
        target, goal = subtask.target, needed(subtask.goal)
        placement = placement_among(goal, target) if isinstance(goal, tuple) else placement_of(goal, target)
        is_item = scene.objects[target].kind is Kind.ITEM
        context = Context(target, subtask.support_goal, placement, is_item, articulated, vessels)
        # Subtasks with the same objects share their table.
        rows = tables.setdefault(context, Rows(context))
        compiled.append(CompiledSubtask(rows, needed(subtask.init), goal, subtask.flow))
    return tuple(compiled)


def compile_subtask(subtask: SimpleTask, scene: Scene) -> CompiledSubtask:
    """Returns one subtask ready for progression; its target must be in the scene."""
    return compile_plan((subtask,), scene)[0]


def articulated_ids(scene: Scene) -> tuple[str, ...]:
    """Returns the ids of the scene's articulated fixtures, in the scene's order."""
    return tuple(key for key, thing in scene.objects.items() if thing.kind is Kind.ARTICULATED)


def facts_read(subtasks: Iterable[CompiledSubtask], goal: Needed, objects: Mapping[str, str]) -> tuple[Fact, ...]:
    """Returns every world fact that the conditions and primitives of some subtasks, or a task goal, can read."""
    facts: dict[Fact, None] = {}
    for subtask in subtasks:
        context = subtask.context
        facts.update(dict.fromkeys((*facts_of(subtask.init, objects), *facts_of(subtask.goal, objects))))
        for fixture in context.articulated:
            facts.setdefault(("open", fixture))
            if context.target_is_item:
                facts.setdefault(("inside", context.target, fixture))
        if not context.target_is_item:
            facts.setdefault(("open", context.target))
    facts.update(dict.fromkeys(facts_of(goal, objects)))
    return tuple(facts)
