"""The task goal that is read off a decomposition when the query gave none.

A subtask goal counts at the end of the plan, unless a later subtask is there to change it: its goal says otherwise, or
it moves the very thing that the earlier goal places.

Source: docs/semantics.md, Verdicts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import bddl
from bddl.syntax.tree import Quantified
from oag.model.actions import ActionFlow
from oag.model.facts import ANY, GRIPPER, Fact, overlap
from oag.model.primitives import Primitive
from oag.table.library import RESTING, carries, placement_of


class Described(Protocol):
    """What of a subtask its part in the task goal depends on."""

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
    """Returns the conjunction of the subtask goals, without what later subtasks replace.

    A later subtask replaces what its own goal denies, and where its target is, the gripper included, when its flow or
    its goal takes the target away from there. A formula beyond literals goes as a whole when a later subtask replaces
    anything that it speaks of.

    Such a goal cannot catch a dropped subtask, which is why a report says when it was used.

    Example:
        >>> import oag
        >>> opened = {"target": "box_0", "init": "(and)", "goal": "(open box_0)"}
        >>> task = oag.Task.from_json({"sub_tasks": [opened, {**opened, "goal": "(not (open box_0))"}]})
        >>> str(default_goal(task.subtasks))
        '(not (open box_0))'

    Source: docs/semantics.md, Verdicts.
    """
    later: list[_Change] = []
    literals: dict[bddl.Atom, bddl.Formula] = {}
    others: dict[bddl.Formula, None] = {}
    for subtask in reversed(subtasks):
        for part in reversed(bddl.conjuncts(subtask.goal)):
            if any(_replaced(said, later) for said in _said(part, strictly=True)):
                continue
            literal = bddl.literals(part)
            if literal is None:
                others.setdefault(part)
            else:
                for atom, value in literal:
                    literals.setdefault(atom, atom if value else bddl.Not(atom))
        later.append(_change(subtask))
    parts = (*reversed(literals.values()), *reversed(others))
    return parts[0] if len(parts) == 1 else bddl.And(parts)


def there_to_change(subtask: Described, literal: bddl.Formula) -> bool:
    """Decides whether a subtask replaces a literal that held before it, as for the task goal."""
    change = _change(subtask)
    return any(_replaced(said, [change]) for said in _said(literal, strictly=True))


class _Said(NamedTuple):
    """An atom as a formula says it; `*` stands for a variable, and `wanted` is False under a negation."""

    fact: Fact
    wanted: bool


class _Change(NamedTuple):
    """What a subtask is there to change: what its goal says, and what it does with its target.

    Attributes:
        target: Its target.
        said: What its goal says.
        takes, releases, carries: It takes the target, lets go of it, carries it away from where it rests.
    """

    target: str
    said: frozenset[_Said]
    takes: bool
    releases: bool
    carries: bool


def _change(subtask: Described) -> _Change:
    """Returns what a subtask changes, by its goal or by its flow."""
    said = frozenset(_said(subtask.goal, strictly=False))
    placed = placement_of(subtask.goal, subtask.target) is not None
    about = [part for part in said if _is_place(part.fact) and part.fact[1] == subtask.target]
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
    return _Change(
        subtask.target,
        said,
        takes=(picked or grasps) and not (placed or releases),
        releases=placed or releases,
        carries=placed or picked or any(carries(action.primitive, action.parameter) for action in held),
    )


def _replaced(said: _Said, later: Sequence[_Change]) -> bool:
    """Decides whether something that an earlier goal says is no longer meant to hold after some subtasks."""
    if _is_place(said.fact) and _moved(said, later):
        return True
    return any(
        other.wanted is not said.wanted and _meets(said.fact, other.fact, change.target)
        for change in later
        for other in change.said
    )


def _moved(said: _Said, later: Sequence[_Change]) -> bool:
    """Decides whether subtasks move what an earlier goal places, and do not all put it there again."""
    _, item, place = said.fact
    about = [change for change in later if item in (change.target, ANY)]
    if place == GRIPPER:
        return any(change.releases if said.wanted else change.takes for change in about)
    away = [change for change in about if change.carries]
    return said.wanted and len(away) > sum(said in change.said for change in away)


def _is_place(fact: Fact) -> bool:
    # Goals are read before it is checked that they are well formed.
    return fact[0] in RESTING and len(fact) == 3


def _meets(fact: Fact, other: Fact, target: str) -> bool:
    """Decides whether two facts are one, or with variables, can be one fact about a target."""
    if fact == other and ANY not in fact:
        return True
    if not overlap(fact, other):
        return False
    names = {b if a == ANY else a for a, b in zip(fact[1:], other[1:], strict=True)}
    return ANY in (*fact, *other) and (target in names or ANY in names)


def _said(formula: bddl.Formula, *, strictly: bool) -> Iterator[_Said]:
    """Yields the atoms of a formula, each as it is wanted.

    Args:
        formula: The formula.
        strictly: Yield what is counted exactly both ways, since more of it breaks the formula as well as less.
    """
    pending: list[tuple[bddl.Formula, tuple[bool, ...], frozenset[str]]] = [(formula, (True,), frozenset())]
    while pending:
        node, wanted, bound = pending.pop()
        if isinstance(node, bddl.Atom):
            fact = (node.predicate, *(ANY if name in bound else name for name in node.args))
            yield from (_Said(fact, value) for value in wanted)
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
