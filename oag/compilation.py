"""Subtasks prepared for progression: what their conditions need, and the table of primitives for their objects.

Source: docs/semantics.md, Knowledge and Primitives.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import bddl
from oag.model.actions import ActionFlow
from oag.model.domain import bound, own_of
from oag.model.infeasible import Infeasible
from oag.model.scene import Scene
from oag.model.symbols import ROBOT_FACTS, Fact, Kind, Primitive
from oag.primitives.state import Start, carriage_in, facts_of, scene_facts
from oag.primitives.table import (
    Context,
    Needed,
    Placement,
    Rows,
    clauses_of,
    does,
    guarded,
    needed,
    open_at_top,
    own_deeds,
    own_places,
    placement_of,
)
from oag.task_definition import SimpleTask


class CompiledSubtask(NamedTuple):
    """A subtask prepared for progression: the primitives' table for its objects, its needs, and its actions.

    Attributes:
        own: Primitives of an own domain that its flow has, or that a search may give it.
    """

    rows: Rows
    init: Needed
    goal: Needed
    flow: ActionFlow | None
    own: tuple[Primitive, ...] = ()

    @property
    def context(self) -> Context:
        """The objects that the meaning of its primitives depends on."""
        return self.rows.context


def compile_plan(
    subtasks: Sequence[SimpleTask], scene: Scene, stated: Start | None = None
) -> tuple[CompiledSubtask, ...]:
    """Return subtasks ready for progression; their targets must be in the scene.

    `stated` has the statements of the scene, where they are known already.
    """
    items = {key: thing.category for key, thing in scene.objects.items() if thing.kind is Kind.ITEM}
    articulated, vessels = articulated_ids(scene), tuple(key for key in items if open_at_top(items[key]))
    tables: dict[tuple[str, str | None, Placement | None], Rows] = {}
    goals = [needed(subtask.goal) for subtask in subtasks]
    placements = [placement_of(subtask.goal, subtask.target) for subtask in subtasks]
    placed = {(p.relation, s.target, p.support) for s, p in zip(subtasks, placements, strict=True) if p is not None}
    own: list[tuple[Primitive, ...]] = [()] * len(subtasks)
    if scene.domain.rows:
        own = [usable(each, scene) for each in subtasks]
        for subtask in subtasks:
            placed.update(own_places(own_primitives(subtask, scene), subtask.target, subtask.support_goal))
    carriage = carriage_in(scene, items, scene_facts(scene) if stated is None else stated, placed)
    compiled = []
    for subtask, goal, placement, extra in zip(subtasks, goals, placements, own, strict=True):
        # Subtasks with the same objects share their table.
        key = (subtask.target, subtask.support_goal, placement)
        rows = tables.get(key)
        if rows is None:
            rows = tables[key] = Rows(Context(*key, subtask.target in items, articulated, vessels, carriage))
        init = needed(subtask.init)
        if scene.known:
            found = known_impossible(subtask, scene)
            init = guarded(init, (clauses_of(literals_in(each.given)) for each in found if each.given))
        compiled.append(CompiledSubtask(rows, init, goal, subtask.flow, extra))
    return tuple(compiled)


def known_impossible(subtask: SimpleTask, scene: Scene) -> tuple[Infeasible, ...]:
    """Return what a subtask does of what was found impossible in a scene, in whatever circumstances."""
    placement = placement_of(subtask.goal, subtask.target)
    primitives = {action.primitive for action in subtask.flow or ()}
    own = own_deeds(primitives, subtask.target, subtask.support_goal)
    return tuple(
        each
        for each in scene.known
        if does((each.kind, each.thing, each.place), subtask.target, placement, primitives, own)
    )


def literals_in(formulas: Iterable[bddl.Formula]) -> Iterator[bddl.Literal]:
    """Yield the literals of conjunctions."""
    return (literal for formula in formulas for literal in bddl.literals(formula) or ())


def own_primitives(subtask: SimpleTask, scene: Scene) -> tuple[Primitive, ...]:
    """Return the primitives of the scene's domain that a subtask's flow has, or may have where it lacks one."""
    if subtask.flow is not None:
        return tuple(dict.fromkeys(each.primitive for each in subtask.flow if own_of(each.primitive) is not None))
    return choices(subtask, scene)


def usable(subtask: SimpleTask, scene: Scene) -> tuple[Primitive, ...]:
    """Return the primitives of the scene's domain that a search may use in a subtask.

    Where rows have further objects, of which there are many choices, a given flow is changed only in those it has.
    """
    own = own_primitives(subtask, scene)
    return tuple(dict.fromkeys((*own, *choices(subtask, scene)))) if scene.domain.binary else own


def choices(subtask: SimpleTask, scene: Scene) -> tuple[Primitive, ...]:
    """Return the primitives of the scene's domain that some flow of a subtask may have."""
    if not scene.domain.rows:
        return ()
    things = {key: (thing.category, thing.kind) for key, thing in scene.objects.items()}
    return tuple(scene.domain.choices(subtask.target, subtask.support_goal, things))


def articulated_ids(scene: Scene) -> tuple[str, ...]:
    """Return the ids of the scene's articulated fixtures, in the scene's order."""
    return tuple(key for key, thing in scene.objects.items() if thing.kind is Kind.ARTICULATED)


def facts_read(subtasks: Iterable[CompiledSubtask], goal: Needed, objects: Mapping[str, str]) -> tuple[Fact, ...]:
    """Return every world fact that the conditions and primitives of some subtasks, or a task goal, can read."""
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
        for primitive in subtask.own:
            if (own := own_of(primitive)) is not None:
                facts.update(dict.fromkeys(bound(own, context.target, context.support_goal).facts))
                read = (each.fact for clause in subtask.rows.row(primitive, None)[0] for each in clause)
                facts.update(dict.fromkeys(fact for fact in read if fact not in ROBOT_FACTS))
        for thing, places in context.carriage.places:
            facts.update(dict.fromkeys((relation, thing, place) for relation, place in places))
    facts.update(dict.fromkeys(facts_of(goal, objects)))
    return tuple(facts)
