"""Simple tasks of own primitives: one subtask that does what a row says, with the flow that usually contains it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import bddl
from oag.model.actions import Action, ActionFlow, action_from_json
from oag.model.diagnostics import FlowError
from oag.model.domain import Domain, DomainError, Own, bound
from oag.model.scene import Scene
from oag.model.symbols import ANY, EEF, NEAR, Condition, Kind, Primitive, known_as, overlap
from oag.task_definition import SimpleTask


def own_subtask(domain: Domain, own: Own, target: str, support: str | None) -> SimpleTask:
    """Return the subtask of one own primitive: it starts with what the row needs of the world, and ends as it writes.

    Raises DomainError when the flow that the row gives cannot be read.
    """
    row = bound(own, target, support)
    needs = [choice for clause in row.needs if (choice := _choice(clause)) is not None]
    words = " ".join((own.row.name.lower(), target, *(() if support is None else (support,)), *own.args))
    ends = effect_literals(own, target, support)
    init, end = (bddl.And(tuple(parts)) if len(parts) != 1 else parts[0] for parts in (needs, ends))
    flow = _flow(domain, own, target, support)
    return SimpleTask(words.replace(" ", "_"), f"{words.capitalize()}.", target, None, support, init, end, flow)


def effect_literals(own: Own, target: str, support: str | None) -> list[bddl.Formula]:
    """Return the literals that hold after an own primitive, as far as BDDL has them."""
    writes = bound(own, target, support).writes
    known = (known_as(fact, value) for fact, value in writes if value is not None and ANY not in fact)
    return [formula for condition in known if (formula := condition.literal()) is not None]


def _choice(clause: tuple[Condition, ...]) -> bddl.Formula | None:
    literals = [condition.literal() for condition in clause]
    known = tuple(each for each in literals if each is not None)
    if len(known) != len(literals):
        return None
    return known[0] if len(known) == 1 else bddl.Or(known)


def _flow(domain: Domain, own: Own, target: str, support: str | None) -> ActionFlow:
    primitive = own.primitive()
    if own.row.flow:
        flow = []
        for index, item in enumerate(own.row.flow):
            try:
                action = action_from_json(_with_args(item, own), index, domain)
            except FlowError as problem:
                raise DomainError(
                    problem.problem, source=domain.name, place=f"primitives.{own.row.name}.flow"
                ) from problem
            flow.append(action)
        return tuple(flow)
    conditions = [each for clause in bound(own, target, support).needs for each in clause]
    reach = [Primitive.APPROACH, Primitive.CONVERGE] if any(each.fact == EEF for each in conditions) else []
    towards = Primitive.NAVIGATE_TO_TARGET
    if not reach and support is not None and Condition(NEAR, support) in conditions:
        towards = Primitive.NAVIGATE_TO_SUPPORT
    if not reach and not any(each.fact == NEAR for each in conditions):
        return (Action(primitive),)
    return tuple(map(Action, (towards, *reach, primitive, Primitive.RETREAT)))


def _with_args(item: Any, own: Own) -> Any:
    """Return a step of a row's flow, in which the row itself has the further objects."""
    if isinstance(item, dict):
        return {_with_args(key, own): value for key, value in item.items()}
    return own.primitive().name if item == own.row.name else item


def read_own_subtask(text: str, scene: Scene) -> SimpleTask | None:
    """Return the subtask of a text such as `PUSH puck_0 cup_0`; None when it begins with no own primitive.

    Raises DomainError when the objects do not fit the row.
    """
    name, *objects = text.split() or [""]
    row = scene.domain.rows.get(name)
    if row is None:
        return None
    if len(objects) != len(row.objects):
        wanted = " ".join(f"?{variable}" for variable, _ in row.objects)
        problem = f"expected {name} {wanted}, got {text}"
        raise DomainError(problem, source=scene.domain.name, place=f"primitives.{name}")
    own, (target, *rest) = Own(row, tuple(objects[2:])), objects
    support = rest[0] if rest else None
    problem_found = scene.domain.problem(own, target, support, things_in(scene))
    if problem_found is not None:
        raise DomainError(f"{name} {problem_found}", source=scene.domain.name, place=f"primitives.{name}")
    return own_subtask(scene.domain, own, target, support)


def things_in(scene: Scene) -> Mapping[str, tuple[str, Kind]]:
    """Return the category and the kind of each object of a scene."""
    return {key: (thing.category, thing.kind) for key, thing in scene.objects.items()}


def own_subtasks(scene: Scene) -> Iterator[tuple[SimpleTask, Own]]:
    """Yield the subtasks of own primitives with every choice of objects; raises DomainError beyond `MOST_BOUND`."""
    domain, things = scene.domain, things_in(scene)
    for row in domain.rows.values():
        for target, support, args in domain.arguments(row, things):
            own = Own(row, args)
            if domain.problem(own, target, support, things) is None:
                yield own_subtask(domain, own, target, support), own


def relevant(scene: Scene, wanted: Iterable[Condition]) -> tuple[list[SimpleTask], list[Condition]]:
    """Return the subtasks of own primitives that help to meet conditions, and what these need of the world."""
    left = [(subtask, own, bound(own, subtask.target, subtask.support_goal)) for subtask, own in own_subtasks(scene)]
    chosen: list[SimpleTask] = []
    asked = dict.fromkeys(wanted)
    grown = True
    while grown:
        grown = False
        for entry in list(left):
            subtask, _, row = entry
            if any(each.grade(value) for each in asked for fact, value in row.writes if overlap(fact, each.fact)):
                chosen.append(subtask)
                left.remove(entry)
                asked |= dict.fromkeys(each for clause in row.needs for each in clause)
                grown = True
    return chosen, list(asked)
