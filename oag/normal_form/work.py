"""What one subtask does as a whole: its net writes, and how it takes the hand over and leaves it.

Source: docs/canonical.md, Net effects.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import bddl
from oag.flows.search import CLOSE, OPEN, PICK, PLACE, TAKE_OUT
from oag.model.actions import Action, ActionFlow
from oag.model.categories import Kind
from oag.model.facts import (
    ANY,
    EEF,
    EMPTY,
    HAND,
    NEAR,
    Condition,
    Fact,
    Value,
    condition_of,
    generalisations,
    gripping,
    held_by,
    holding,
    overlap,
)
from oag.model.primitives import ARTICULATIONS, Primitive
from oag.model.scene import Scene
from oag.table.library import NAVIGATION, Context, carries, effect, placement_of
from oag.task.task import SimpleTask

_HAND_MOVES = (Primitive.GRASP, Primitive.UNGRASP, *ARTICULATIONS)
_POSE = (NEAR, EEF)


@dataclass(frozen=True, slots=True)
class Work:
    """The effect of a whole flow, from the hand that it needs.

    Attributes:
        writes: Fact or pattern -> value at the end; a fact listed itself is not touched by patterns. The robot's
            pose is left out.
        needs: The hand's value that the flow can start with.
        hand: The hand's value at the end.
        lifted: True when what the hand then holds was carried since it was grasped.
    """

    writes: Mapping[Fact, Value]
    needs: Value
    hand: Value
    lifted: bool

    def decides(self, part: bddl.Formula) -> bool:
        """True when a literal holds at the end whatever the start."""
        condition = literal_condition(part)
        if condition is None:
            return False
        for pattern in generalisations(condition.fact):
            if pattern in self.writes:
                return condition.grade(self.writes[pattern]) is True
        return False

    def touches(self, facts: Iterable[Fact]) -> bool:
        """True when something it writes overlaps with one of the facts or patterns."""
        return any(overlap(fact, written) for fact in facts for written in self.writes)


def literal_condition(part: bddl.Formula) -> Condition | None:
    """Returns the condition of a literal, or None for a formula beyond that."""
    literals = bddl.literals(part)
    if literals is None or len(literals) != 1:
        return None
    return condition_of(literals[0].atom, literals[0].value)


def covers(pattern: Fact, fact: Fact) -> bool:
    """Decides whether every instance of a fact or pattern is one of another pattern."""
    return (
        len(pattern) == len(fact)
        and pattern[0] == fact[0]
        and all(a in (b, ANY) for a, b in zip(pattern[1:], fact[1:], strict=True))
    )


def context_of(subtask: SimpleTask, scene: Scene, articulated: tuple[str, ...], vessels: tuple[str, ...]) -> Context:
    """Returns what the primitives of a subtask are about."""
    return Context(
        subtask.target,
        subtask.support_goal,
        placement_of(subtask.goal, subtask.target),
        scene.objects[subtask.target].kind is Kind.ITEM,
        articulated,
        vessels,
    )


def starts_afresh(flow: ActionFlow) -> bool:
    """True when a flow does not depend on where the robot stands: it navigates first."""
    return bool(flow) and flow[0].primitive in NAVIGATION


def moves_only(flow: ActionFlow) -> bool:
    """True when no step of a flow grasps, lets go or articulates."""
    return not any(action.primitive in _HAND_MOVES for action in flow)


def working_flow(subtask: SimpleTask, context: Context, hand: Value) -> ActionFlow | None:
    """Returns a subtask's flow, or the template for its goal when it has none; None when no template fits."""
    if subtask.flow is not None:
        return subtask.flow
    target = context.target
    conditions = [c for c in map(literal_condition, bddl.conjuncts(subtask.goal)) if c is not None]
    if not context.target_is_item:
        for condition in conditions:
            if condition.fact == ("open", target):
                return _actions(OPEN if condition.positive else CLOSE)
        return None
    if context.placement is not None:
        held = hand == holding(target) or _says_held(subtask.init, target)
        starts = [c.fact for c in map(literal_condition, bddl.conjuncts(subtask.init)) if c is not None and c.positive]
        return _actions(PLACE if held else (*_picking(starts, context), *PLACE))
    leaves = [c.fact for c in conditions if len(c.fact) == 3 and c.fact[1] == target and not c.positive]
    takes = any(c.fact == HAND and c.positive and held_by(c.value) == target for c in conditions)
    return _actions(_picking(leaves, context)) if leaves or takes else None


def _picking(places: Iterable[Fact], context: Context) -> tuple[Primitive, ...]:
    """Returns the template that takes the target from some places: it has to back out of furniture."""
    out = any(f[:2] == ("inside", context.target) and f[2] not in context.vessels for f in places)
    return TAKE_OUT if out else PICK


def _actions(primitives: Iterable[Primitive]) -> ActionFlow:
    return tuple(Action(primitive) for primitive in primitives)


def _says_held(formula: bddl.Formula, target: str) -> bool:
    wanted = Condition(HAND, holding(target))
    return any(literal_condition(part) == wanted for part in bddl.conjuncts(formula))


def work_of(subtask: SimpleTask, flow: ActionFlow, context: Context, hand: Value, lifted: bool) -> Work:
    """Returns what a flow does as a whole.

    Args:
        subtask: The subtask.
        flow: Its flow, or the template that stands for it.
        context: Its objects.
        hand: The hand's value where it stands.
        lifted: Whether what the hand holds there was carried since it was grasped.
    """
    needs = _needed_hand(subtask, flow, context, hand)
    now, carried = needs, lifted if needs == hand else held_by(needs) is not None
    writes: dict[Fact, Value] = {}
    for action in flow:
        primitive = action.primitive
        written = effect(primitive, context, now, action.parameter)
        if carries(primitive, action.parameter) and held_by(now) is not None:
            carried = True
        elif primitive is Primitive.GRASP:
            carried = False
        now = dict(written).get(HAND, now)
        _write(writes, {fact: value for fact, value in written if fact not in _POSE and fact != HAND})
    if now != needs:
        writes[HAND] = now
    return Work(writes, needs, now, carried and held_by(now) is not None)


def _needed_hand(subtask: SimpleTask, flow: ActionFlow, context: Context, hand: Value) -> Value:
    """Returns the hand's value that the first step which uses it asks for."""
    for action in flow:
        if action.primitive is Primitive.GRASP:
            return EMPTY
        if action.primitive in ARTICULATIONS:
            return gripping(context.target)
        if action.primitive is Primitive.UNGRASP:
            return holding(context.target) if _says_held(subtask.init, context.target) else hand
    return hand


def _write(writes: dict[Fact, Value], written: Mapping[Fact, Value]) -> None:
    """Adds what one step writes: a pattern takes the place of what it covers."""
    for pattern in written:
        if ANY in pattern:
            for fact in [known for known in writes if covers(pattern, known)]:
                del writes[fact]
    writes.update(written)


def one_after_other(first: Work, second: Work) -> Work:
    """Returns what two subtasks do together."""
    writes = {fact: value for fact, value in first.writes.items() if fact != HAND}
    _write(writes, {fact: value for fact, value in second.writes.items() if fact != HAND})
    if second.hand != first.needs:
        writes[HAND] = second.hand
    return Work(writes, first.needs, second.hand, second.lifted)
