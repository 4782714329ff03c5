"""Default task goal, derived from the subtask goals when the query gave none.

A subtask goal counts at the end of the plan, unless a later subtask is meant to change it. That is so if its goal says
otherwise, or if it moves the thing that the earlier goal places.

Source: docs/semantics.md, Verdicts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import bddl
from bddl.ast import Quantified
from oag.model.actions import ActionFlow
from oag.model.symbols import ANY, GRIPPER, Fact, Primitive, overlap
from oag.primitives.table import RESTING, carries, placement_of


class Described(Protocol):
    """The part of a subtask that decides about the default task goal."""

    @property
    def target(self) -> str:
        """Id of the object it acts on."""

    @property
    def goal(self) -> bddl.Formula:
        """What must hold when it ends."""

    @property
    def flow(self) -> ActionFlow | None:
        """Its actions, None when there are none yet."""


def default_goal(subtasks: Sequence[Described]) -> bddl.Formula:
    """Return the conjunction of the subtask goals, without what later subtasks replace.

    A later subtask replaces what its own goal denies. It replaces the place of its target, the gripper included, when
    its flow or its goal takes the target away. A formula beyond literals is dropped as a whole when a later subtask
    replaces any of its atoms.

    Such a goal cannot detect a dropped subtask, so a report says when it was used.

    Example:
        >>> import oag
        >>> opened = {"target": "box_0", "init": "(and)", "goal": "(open box_0)"}
        >>> task = oag.Task.from_json({"sub_tasks": [opened, {**opened, "goal": "(not (open box_0))"}]})
        >>> str(default_goal(task.subtasks))
        '(not (open box_0))'

    Source: docs/semantics.md, Verdicts.
    """
    later: list[_GoalChange] = []
    literals: dict[bddl.Atom, bddl.Formula] = {}
    others: dict[bddl.Formula, None] = {}
    for subtask in reversed(subtasks):
        for part in reversed(bddl.conjuncts(subtask.goal)):
            if any(_replaced(demand, later) for demand in _demands(part, strictly=True)):
                continue
            literal = bddl.literals(part)
            if literal is None:
                others.setdefault(part)
            else:
                for atom, value in literal:
                    literals.setdefault(atom, atom if value else bddl.Not(atom))
        later.append(_goal_change(subtask))
    parts = (*reversed(literals.values()), *reversed(others))
    return parts[0] if len(parts) == 1 else bddl.And(parts)


def is_meant_to_change(subtask: Described, literal: bddl.Formula) -> bool:
    """Decide whether a subtask replaces a literal that held before it, as for the task goal."""
    change = _goal_change(subtask)
    return any(_replaced(demand, [change]) for demand in _demands(literal, strictly=True))


class _Demand(NamedTuple):
    """An atom of a formula; `*` stands for a variable, and `wanted` is False under a negation."""

    fact: Fact
    wanted: bool


class _GoalChange(NamedTuple):
    """Changes that a subtask is meant to make: by its goal, and by what it does with its target.

    Attributes:
        target: Its target.
        demand: The atoms of its goal.
        takes, releases, carries: It takes the target, releases it, carries it away from its place.
    """

    target: str
    demand: frozenset[_Demand]
    takes: bool
    releases: bool
    carries: bool


def _goal_change(subtask: Described) -> _GoalChange:
    """Return what a subtask changes, by its goal or by its flow."""
    demand = frozenset(_demands(subtask.goal, strictly=False))
    placed = placement_of(subtask.goal, subtask.target) is not None
    about = [part for part in demand if _is_place(part.fact) and part.fact[1] == subtask.target]
    picked = any(part.wanted is (part.fact[2:] == (GRIPPER,)) for part in about)
    flow = subtask.flow or ()
    steps = [action.primitive for action in flow]
    if Primitive.ARTICULATE_OPEN in steps or Primitive.ARTICULATE_CLOSE in steps:
        steps = []
    grasps, releases = Primitive.GRASP in steps, Primitive.UNGRASP in steps
    first = steps.index(Primitive.GRASP) if grasps else 0
    # What moves after the hand let go takes nothing along.
    last = max((i for i, step in enumerate(steps) if step is Primitive.UNGRASP and i > first), default=len(steps))
    held = flow[first:last] if grasps or releases else ()
    return _GoalChange(
        subtask.target,
        demand,
        takes=(picked or grasps) and not (placed or releases),
        releases=placed or releases,
        carries=placed or picked or any(carries(action.primitive, action.parameter) for action in held),
    )


def _replaced(demand: _Demand, later: Sequence[_GoalChange]) -> bool:
    """Decide whether an atom of an earlier goal is no longer meant to hold after some subtasks."""
    if _is_place(demand.fact) and _moved(demand, later):
        return True
    return any(
        other.wanted is not demand.wanted and _meets(demand.fact, other.fact, change.target)
        for change in later
        for other in change.demand
    )


def _moved(demand: _Demand, later: Sequence[_GoalChange]) -> bool:
    """Decide whether subtasks move the item of an earlier goal, and do not all put it there again."""
    _, item, place = demand.fact
    about = [change for change in later if item in (change.target, ANY)]
    if place == GRIPPER:
        return any(change.releases if demand.wanted else change.takes for change in about)
    away = [change for change in about if change.carries]
    return demand.wanted and len(away) > sum(demand in change.demand for change in away)


def _is_place(fact: Fact) -> bool:
    # Goals are read before it is checked that they are well formed.
    return fact[0] in RESTING and len(fact) == 3


def _meets(fact: Fact, other: Fact, target: str) -> bool:
    """Decide whether two facts are one, or with variables, can be one fact about a target."""
    if fact == other and ANY not in fact:
        return True
    if not overlap(fact, other):
        return False
    names = {b if a == ANY else a for a, b in zip(fact[1:], other[1:], strict=True)}
    return ANY in (*fact, *other) and (target in names or ANY in names)


def _demands(formula: bddl.Formula, *, strictly: bool) -> Iterator[_Demand]:
    """Yield the atoms of a formula, each with its wanted value.

    Args:
        formula: The formula.
        strictly: Yield atoms of exact counts with both values, since more and fewer of them break the formula.
    """
    pending: list[tuple[bddl.Formula, tuple[bool, ...], frozenset[str]]] = [(formula, (True,), frozenset())]
    while pending:
        node, wanted, bound = pending.pop()
        if isinstance(node, bddl.Atom):
            fact = (node.predicate, *(ANY if name in bound else name for name in node.args))
            yield from (_Demand(fact, value) for value in wanted)
            continue
        opposite = tuple(not value for value in wanted)
        if isinstance(node, bddl.Not):
            wanted = opposite
        elif isinstance(node, Quantified):
            bound |= {binder.variable for binder in node.binders}
            if isinstance(node, bddl.ForN):
                wanted = opposite if node.count == 0 else (True, False) if strictly else wanted
        parts = [(operand, wanted) for operand in node.operands]
        if isinstance(node, bddl.Imply):
            parts[0] = (parts[0][0], opposite)
        pending.extend((operand, value, bound) for operand, value in reversed(parts))
