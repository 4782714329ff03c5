"""The check of a claim that no flow exists: a set of states that no primitive leads out of, without the goal.

Part of the independent check: it knows the language and the table of primitives, and nothing of the search.

Source: docs/semantics.md, Certificates; inductive sets as certificates of unsolvability follow Eriksson, Roeger and
Helmert (ICAPS 2017).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from oag.checker.cases import Reader, require, truth_of
from oag.model.facts import HAND, ROBOT_FACTS, Fact, Value, generalisations
from oag.model.primitives import Primitive
from oag.table.library import Context, Effect, Needed, effect, requirements

_State = tuple[Value, ...]


def check_search(
    search: Mapping[str, Any], context: Context, goal: Needed, read: Reader, objects: Mapping[str, str]
) -> None:
    """Checks that no flow of a subtask reaches its goal.

    A state gives a value, or null for unknown, to every fact listed; it stands for all complete states that agree.

    Args:
        search: `facts`, the robot's three among them; `states`, each a list of values in the order of the facts; and
            `start`, the one of them that describes where the subtask starts.
        context: The subtask's objects.
        goal: Its goal.
        read: What is known where it starts.
        objects: Category of each object.

    Raises:
        Rejected: The start is not among the states, a primitive leads out of them, or the goal may hold in one.
    """
    facts = [tuple(fact) for fact in search["facts"]]
    states = {tuple(state) for state in search["states"]}
    require(set(ROBOT_FACTS) <= set(facts), "a search leaves out a variable of the robot")
    require(all(len(state) == len(facts) for state in states), "a state of a search has too few or too many values")
    start = tuple(map(read, facts))
    require(start == tuple(search["start"]) and start in states, "the start is not among the states of the search")
    legal = tuple(_legal(context, objects))
    for state in states:
        known = dict(zip(facts, state, strict=True))
        require(truth_of(goal, known.get, objects) is False, f"a state of the search may meet the goal: {known}")
        for primitive in legal:
            if truth_of(requirements(primitive, context, known[HAND]), known.get, objects) is not False:
                after = _after(known, effect(primitive, context, known[HAND]))
                require(after in states, f"{primitive.name} leads out of the states of the search")


def _legal(context: Context, objects: Mapping[str, str]) -> Iterator[Primitive]:
    """Yields the primitives that a well-formed flow may use in a context."""
    fixture = context.target in context.articulated
    for primitive in Primitive:
        if primitive in (Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE) and not fixture:
            continue
        if primitive is Primitive.GRASP and not (fixture or context.target_is_item):
            continue
        if primitive is Primitive.NAVIGATE_TO_SUPPORT and context.support_goal not in objects:
            continue
        yield primitive


def _after(known: dict[Fact, Value], written: Effect) -> _State:
    """Returns the state after an effect, whose most specific write to a fact counts."""
    writes = dict(written)
    return tuple(
        next((writes[pattern] for pattern in generalisations(fact) if pattern in writes), value)
        for fact, value in known.items()
    )
