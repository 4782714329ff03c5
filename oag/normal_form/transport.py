"""The rules about carrying: one subtask for picking up, one for putting down, conditions where the first begins.

Source: docs/canonical.md, Rules.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import bddl
from oag.model.actions import Action
from oag.model.facts import EMPTY, GRIPPER, holding
from oag.model.primitives import Primitive
from oag.normal_form.formulas import conjunction
from oag.normal_form.join import movable
from oag.normal_form.rewrite import Rewrite
from oag.normal_form.survey import Place
from oag.normal_form.tidy import left_behind
from oag.normal_form.work import work_of
from oag.table.library import NAVIGATION


def split_transport(places: Sequence[Place], index: int) -> Rewrite | None:
    """Cuts a subtask that picks its target up and puts it down into the two."""
    place = places[index]
    subtask, flow, work = place.subtask, place.flow, place.work
    target = subtask.target
    if flow is None or work is None or not place.context.target_is_item:
        return None
    # With the target in the hand already it cannot run; cut in two, its first half may turn out to be a repetition.
    if work.needs != EMPTY or work.hand != EMPTY or place.hand not in (EMPTY, holding(target)):
        return None
    cut = _rest_in_hand(flow)
    if cut is None:
        return None
    first, second = flow[:cut], flow[cut:]
    planned = subtask.flow is not None
    to_support = any(action.primitive is Primitive.NAVIGATE_TO_SUPPORT for action in first)
    goal = left_behind(subtask.init, target)
    if not work_of(subtask, first, place.context, EMPTY, lifted=False).decides(goal):
        # It is lifted within a compartment, and carried out of it on the way.
        goal = bddl.Atom("inside", (target, GRIPPER))
    pick = replace(
        subtask,
        support_goal=subtask.support_goal if to_support else None,
        goal=goal,
        flow=first if planned else None,
    )
    place_ = replace(
        subtask,
        support_init=None,
        init=bddl.Atom("inside", (target, GRIPPER)),
        flow=second if planned else None,
    )
    return Rewrite("split", index, 1, (pick, place_))


def hoist_conditions(places: Sequence[Place], index: int) -> Rewrite | None:
    """Moves what a transport needs beside the thing in the hand to where the transport begins."""
    if index + 1 == len(places):
        return None
    first, second = places[index], places[index + 1]
    target = first.subtask.target
    if first.work is None or not first.runs or not second.runs or second.subtask.target != target:
        return None
    if first.hand != EMPTY or first.work.hand != holding(target) or not first.work.lifted:
        return None
    held = bddl.Atom("inside", (target, GRIPPER))
    init = list(bddl.conjuncts(first.subtask.init))
    goal: list[bddl.Formula] = []
    needs: list[bddl.Formula] = []
    for part in bddl.conjuncts(first.subtask.goal):
        (init if movable(part, first.work, init) else goal).append(part)
    for part in bddl.conjuncts(second.subtask.init):
        if part != held and (first.work.decides(part) or movable(part, first.work, init)):
            init.extend(() if first.work.decides(part) else (part,))
        else:
            needs.append(part)
    pick = replace(first.subtask, init=conjunction(init), goal=conjunction(goal))
    put = replace(second.subtask, init=conjunction(needs))
    if (pick, put) == (first.subtask, second.subtask):
        return None
    return Rewrite("hoist", index, 2, (pick, put))


def _rest_in_hand(flow: Sequence[Action]) -> int | None:
    """Returns where to cut a transport: where the thing is in the hand at rest, before it is carried on.

    None when the flow does not grasp, lift and let go once each, in that order.
    """
    primitives = [action.primitive for action in flow]
    if primitives.count(Primitive.GRASP) != 1 or primitives.count(Primitive.UNGRASP) != 1:
        return None
    grasp, release = primitives.index(Primitive.GRASP), primitives.index(Primitive.UNGRASP)
    lift = next((i for i in range(grasp, release) if primitives[i] is Primitive.LIFT_EEF_UP), None)
    if lift is None or any(primitive in NAVIGATION for primitive in primitives[grasp:lift]):
        return None
    at_rest = next(i for i in range(lift, release + 1) if primitives[i] is not Primitive.LIFT_EEF_UP)
    return next((i for i in range(lift, release) if primitives[i] in NAVIGATION), at_rest)
