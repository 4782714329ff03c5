"""The universal graph's feasibility relation E: which step can directly follow which, computed from the library.

A step a on o can be followed by a' on o' when some state lets a run and leaves a state that lets a' run. The relation
depends on the two primitives, on the kinds of the two objects and on whether they are one object, and on nothing else;
so it is a finite table, although the graph over O x A x N+ is not.

Source: the paper's universal object-action graph, whose edges are "physically or semantically feasible transitions".
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

from oag.model.categories import Kind
from oag.model.facts import EMPTY, HAND, Condition, Fact, Value, gripping, holding
from oag.model.primitives import Primitive, applicable
from oag.table.library import Clause, Context, effect, requirements

_FIRST, _SECOND, _THIRD = "x", "y", "z"


@cache
def feasible(first: Primitive, second: Primitive, *, kinds: tuple[Kind, Kind], same_object: bool) -> bool:
    """Decides whether one primitive can directly follow another.

    Args:
        first: What ran.
        second: What is to run.
        kinds: Kind of the object that each of them acts on or goes to.
        same_object: Whether that is one object; its two kinds are then equal.

    Returns:
        True when some state satisfies what the first needs and, after what the first does, what the second needs.
        False for a step that its object's kind rules out, and for a sequence such as RETREAT, GRASP.
    """
    if not all(map(applicable, (first, second), kinds)):
        return False
    names = (_FIRST, _FIRST if same_object else _SECOND)
    before, after = (Context(name, name, None, kind is Kind.ITEM, ()) for name, kind in zip(names, kinds, strict=True))
    return any(_follows(first, second, before, after, hand) for hand in _hands(before, after))


def _follows(first: Primitive, second: Primitive, before: Context, after: Context, hand: Value) -> bool:
    """Decides the question for one value of the hand at the start; everything else is free to fit."""
    state: dict[Fact, Value] = {HAND: hand}
    for clause in requirements(first, before, hand):
        if not _admit(clause, state):
            return False
    state.update(effect(first, before, hand))
    return all(_admit(clause, state) for clause in requirements(second, after, state[HAND]))


def _admit(clause: Clause, state: dict[Fact, Value]) -> bool:
    """Decides whether a clause can hold in a partial state, and if a single literal was free, fixes it."""
    graded = [condition.grade(state.get(condition.fact)) for condition in clause]
    if len(clause) == 1 and graded[0] is None:
        only: Condition = clause[0]
        state[only.fact] = only.value
    return any(grade is not False for grade in graded)


def _hands(before: Context, after: Context) -> Iterator[Value]:
    """Yields what the hand can be doing: nothing, or holding or gripping either object or a third one."""
    yield EMPTY
    yield holding(_THIRD)
    yield gripping(_THIRD)
    for context in (before, after):
        yield holding(context.target) if context.target_is_item else gripping(context.target)
