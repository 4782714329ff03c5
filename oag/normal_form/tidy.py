"""The rules that look at one subtask alone: order in its formulas, roles and flow, and a goal that names its kind.

Source: docs/canonical.md, Rules.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import bddl
from oag.model.actions import Action, ActionFlow
from oag.model.facts import EMPTY, GRIPPER, holding
from oag.model.primitives import Primitive
from oag.normal_form.formulas import conjunction, is_place, tidy_goal
from oag.normal_form.moves import merged_moves
from oag.normal_form.rewrite import Rewrite
from oag.normal_form.survey import Place
from oag.normal_form.work import Work, starts_afresh
from oag.table.library import NAVIGATION, placement_of
from oag.task.task import SimpleTask


def tidy_subtask(places: Sequence[Place], index: int) -> Rewrite | None:
    """Puts formulas in order, clears supports that nothing mentions, and says in the goal what the flow is for."""
    place = places[index]
    subtask = place.subtask
    init, goal = conjunction(bddl.conjuncts(subtask.init)), tidy_goal(subtask.goal, subtask.target)
    if place.runs and place.work is not None:
        init = _with_held(place, init)
        goal = _named_goal(place, place.work, init, goal)
    result = replace(
        subtask,
        init=init,
        goal=goal,
        support_init=_mentioned(subtask.support_init, init),
        support_goal=subtask.support_goal if _goes_to_support(subtask) else _mentioned(subtask.support_goal, goal),
        flow=None if subtask.flow is None else merged_moves(_without_detours(subtask.flow)),
    )
    return None if result == subtask else Rewrite("tidy", index, 1, (result,))


def start_navigation(places: Sequence[Place], index: int) -> Rewrite | None:
    """Writes out the reset's own way to the first target, so that the first subtask can stand anywhere."""
    place = places[index]
    flow = place.subtask.flow
    if index > 0 or not flow or starts_afresh(flow) or place.hand != EMPTY:
        return None
    moved = (Action(Primitive.NAVIGATE_TO_TARGET), *flow)
    return Rewrite("start", index, 1, (replace(place.subtask, flow=moved),))


def _with_held(place: Place, init: bddl.Formula) -> bddl.Formula:
    """Returns an initial condition that says what the hand holds, where the flow begins by letting go of it."""
    target, flow = place.subtask.target, place.flow or ()
    lets_go = any(action.primitive is Primitive.UNGRASP for action in flow)
    if place.hand != holding(target) or not place.lifted or not lets_go:
        return init
    return conjunction((*bddl.conjuncts(init), bddl.Atom("inside", (target, GRIPPER))))


def _named_goal(place: Place, work: Work, init: bddl.Formula, goal: bddl.Formula) -> bddl.Formula:
    """Returns a goal in which one literal stands for all that the flow itself brings about."""
    parts = bddl.conjuncts(goal)
    produced = [part for part in parts if work.decides(part)]
    name = _name(place, work, init)
    if name is None or not produced or not work.decides(name):
        return goal
    others = [part for part in parts if part not in produced]
    return tidy_goal(bddl.And((name, *others)), place.subtask.target) if others else name


def _name(place: Place, work: Work, init: bddl.Formula) -> bddl.Formula | None:
    """Returns the literal that a movement is named by, or None when it is none of the four kinds."""
    target = place.subtask.target
    if not place.context.target_is_item:
        opened = work.writes.get(("open", target))
        atom = bddl.Atom("open", (target,))
        return None if opened is None else atom if opened else bddl.Not(atom)
    if place.hand == EMPTY and work.hand == holding(target) and work.lifted:
        return left_behind(init, target)
    if work.hand == EMPTY and place.context.placement is not None:
        return bddl.Atom(place.context.placement.relation, (target, place.context.placement.support))
    return None


def left_behind(init: bddl.Formula, target: str) -> bddl.Formula:
    """Returns the goal of picking a thing up: that it is no longer where it was, or, if that is not said, in the hand.

    Source: the paper's table of initial and goal states.
    """
    for part in bddl.conjuncts(init):
        if is_place(part, target):
            return bddl.Not(part)
    return bddl.Atom("inside", (target, GRIPPER))


def _mentioned(name: str | None, formula: bddl.Formula) -> str | None:
    """Returns a support that a condition mentions, else None."""
    return name if name is not None and any(name in atom.args for atom in bddl.atoms(formula)) else None


def _goes_to_support(subtask: SimpleTask) -> bool:
    if subtask.flow is None:
        return placement_of(subtask.goal, subtask.target) is not None
    return any(action.primitive is Primitive.NAVIGATE_TO_SUPPORT for action in subtask.flow)


def _without_detours(flow: ActionFlow) -> ActionFlow:
    """Returns the flow without navigations that another one follows at once."""
    return tuple(
        action
        for index, action in enumerate(flow)
        if action.primitive not in NAVIGATION or index + 1 == len(flow) or flow[index + 1].primitive not in NAVIGATION
    )
