"""The rule that joins what was cut in the middle of one movement.

Source: docs/canonical.md, Rules.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import bddl
from oag.model.facts import HAND, gripping, holding
from oag.model.primitives import Primitive
from oag.normal_form.formulas import conjunction, facts_in
from oag.normal_form.rewrite import Rewrite
from oag.normal_form.survey import Place
from oag.normal_form.work import Work, literal_condition
from oag.task.task import SimpleTask


def join_movement(places: Sequence[Place], index: int) -> Rewrite | None:
    """Joins two subtasks of one target that were cut in the middle: while moving, gripping, or before the lift."""
    if index + 1 == len(places):
        return None
    first, second = places[index], places[index + 1]
    if not _joinable(first, second):
        return None
    last = index + 2 == len(places) or places[index + 2].afresh
    joined: SimpleTask | None = None
    if first.idle and first.only_moves:
        joined = None if second.afresh else _absorbed_by_next(first, second)
    elif second.idle and second.only_moves:
        joined = _absorbed_by_previous(first, second) if last and not second.afresh else None
    elif _is_interrupted(first) and first.runs and second.runs:
        joined = _one_movement(first, second)
    return None if joined is None else Rewrite("join", index, 2, (joined,))


def _joinable(first: Place, second: Place) -> bool:
    """True when two subtasks can be one: the same target, flows of their own, one support to go to."""
    one, other = first.subtask, second.subtask
    if one.target != other.target or one.flow is None or other.flow is None:
        return False
    return len({one.support_goal, other.support_goal} - {None}) < 2


def _support(one: SimpleTask, other: SimpleTask) -> str | None:
    """Returns the support that two subtasks which can be one go to."""
    return one.support_goal if one.support_goal is not None else other.support_goal


def _is_interrupted(place: Place) -> bool:
    """True when the hand has hold of the target after a subtask, and has not yet moved it."""
    target, work = place.subtask.target, place.work
    if work is None or any(action.primitive is Primitive.UNGRASP for action in place.flow or ()):
        return False
    return work.hand == gripping(target) or (work.hand == holding(target) and not work.lifted)


def _absorbed_by_next(first: Place, second: Place) -> SimpleTask:
    """Returns the second subtask with the first one's moves before its own."""
    between = (*bddl.conjuncts(first.subtask.init), *bddl.conjuncts(first.subtask.goal))
    init = conjunction((*bddl.conjuncts(second.subtask.init), *between))
    support = _support(first.subtask, second.subtask)
    return replace(
        second.subtask,
        support_goal=support,
        init=init,
        flow=(*(first.subtask.flow or ()), *(second.subtask.flow or ())),
    )


def _absorbed_by_previous(first: Place, second: Place) -> SimpleTask | None:
    """Returns the first subtask with the second one's moves after its own."""
    if first.work is None:
        return None
    init = list(bddl.conjuncts(first.subtask.init))
    for part in (*second.open_init, *second.open_goal):
        if first.work.decides(part) or first.work.touches(facts_in(part)) or _speaks_of_another_hand(part, first.work):
            return None
        init.append(part)
    flow = (*(first.subtask.flow or ()), *(second.subtask.flow or ()))
    support = _support(first.subtask, second.subtask)
    return replace(first.subtask, support_goal=support, init=conjunction(init), flow=flow)


def _speaks_of_another_hand(part: bddl.Formula, work: Work) -> bool:
    """True for a condition that the hand does not meet after some work; at the beginning it would alter that work."""
    condition = literal_condition(part)
    return condition is not None and condition.fact == HAND and condition.grade(work.hand) is not True


def _one_movement(first: Place, second: Place) -> SimpleTask | None:
    """Returns two halves of a movement as one, or None when a condition between them speaks of what it changes."""
    if first.work is None:
        return None
    one, other = first.subtask, second.subtask
    init = list(bddl.conjuncts(one.init))
    for part in (*bddl.conjuncts(one.goal), *bddl.conjuncts(other.init)):
        if first.work.decides(part):
            continue
        # What contradicts the beginning is asked for there as well: it can hold in neither place.
        if first.work.touches(facts_in(part)):
            return None
        init.append(part)
    return replace(
        other,
        support_init=one.support_init if one.support_init is not None else other.support_init,
        support_goal=_support(one, other),
        init=conjunction(init),
        flow=(*(one.flow or ()), *(other.flow or ())),
    )


def movable(part: bddl.Formula, work: Work, init: Sequence[bddl.Formula]) -> bool:
    """True when a condition after some work can be asked for before it: nothing there writes it or contradicts it."""
    if work.decides(part) or work.touches(facts_in(part)):
        return False
    condition = literal_condition(part)
    return condition is None or condition._replace(positive=not condition.positive) not in map(literal_condition, init)
