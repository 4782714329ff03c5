"""Subtasks prepared for progression: their contexts, and their formulas as conditions where they are literals."""

from __future__ import annotations

from dataclasses import dataclass

from oag.actions import ActionFlow
from oag.categories import Kind
from oag.library import Context, Needed, needed, placement_of
from oag.scene import Scene
from oag.task import SimpleTask


@dataclass(frozen=True, slots=True)
class CompiledSubtask:
    """A subtask with everything looked up that progression needs."""

    context: Context
    init: Needed
    goal: Needed
    flow: ActionFlow | None
    scope: frozenset[str]


def compile_subtask(subtask: SimpleTask, scene: Scene, articulated: tuple[str, ...]) -> CompiledSubtask:
    """Returns a subtask ready for progression; its target must be in the scene."""
    names = (subtask.target, subtask.support_init, subtask.support_goal)
    context = Context(
        target=subtask.target,
        support_goal=subtask.support_goal,
        placement=placement_of(subtask.goal, subtask.target),
        target_is_item=scene.objects[subtask.target].kind is Kind.ITEM,
        articulated=articulated,
    )
    return CompiledSubtask(
        context=context,
        init=needed(subtask.init),
        goal=needed(subtask.goal),
        flow=subtask.flow,
        scope=frozenset(name for name in names if name is not None),
    )


def articulated_ids(scene: Scene) -> tuple[str, ...]:
    """Returns the ids of the scene's articulated fixtures, in the scene's order."""
    return tuple(key for key, thing in scene.objects.items() if thing.kind is Kind.ARTICULATED)
