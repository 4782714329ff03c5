"""The task goal that is read off a decomposition when the query gave none.

A subtask goal counts at the end of the plan, unless a later subtask is there to change it: its goal says otherwise, or
it moves the very thing that the earlier goal places.

Source: docs/semantics.md, Verdicts.
"""

from __future__ import annotations

from collections import Counter
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

    Args:
        subtasks: In order.

    Example:
        >>> import oag
        >>> opened = {"target": "box_0", "init": "(and)", "goal": "(open box_0)"}
        >>> task = oag.Task.from_json({"sub_tasks": [opened, {**opened, "goal": "(not (open box_0))"}]})
        >>> str(default_goal(task.subtasks))
        '(not (open box_0))'

    Source: docs/semantics.md, Verdicts.
    """
    later = _Later()
    literals: dict[bddl.Atom, bddl.Formula] = {}
    others: dict[bddl.Formula, None] = {}
    for subtask in reversed(subtasks):
        for part in reversed(bddl.conjuncts(subtask.goal)):
            if any(later.replace(said) for said in _said(part, strictly=True)):
                continue
            literal = bddl.literals(part)
            if literal is None:
                others.setdefault(part)
            else:
                for atom, value in literal:
                    literals.setdefault(atom, atom if value else bddl.Not(atom))
        later.add(subtask)
    parts = (*reversed(literals.values()), *reversed(others))
    return parts[0] if len(parts) == 1 else bddl.And(parts)


def there_to_change(subtask: Described, literal: bddl.Formula) -> bool:
    """Decides whether a subtask replaces a literal that held before it, as for the task goal.

    Args:
        subtask: The subtask.
        literal: What held.
    """
    later = _Later()
    later.add(subtask)
    return any(later.replace(said) for said in _said(literal, strictly=True))


class _Said(NamedTuple):
    """An atom as a formula says it; `*` stands for a variable, and `wanted` is False under a negation."""

    fact: Fact
    wanted: bool


class _Later:
    """What the subtasks after some place of a plan are there to change."""

    def __init__(self) -> None:
        self._said: set[_Said] = set()
        # (predicate, wanted) -> what goals say of it, with their targets; those with variables also by themselves.
        self._all: dict[tuple[str, bool], dict[tuple[Fact, str], None]] = {}
        self._patterns: dict[tuple[str, bool], dict[tuple[Fact, str], None]] = {}
        self._taken: set[str] = set()
        self._released: set[str] = set()
        # Target -> subtasks that carry it away; place -> how many of these put it there again.
        self._carried: Counter[str] = Counter()
        self._stated: Counter[Fact] = Counter()

    def add(self, subtask: Described) -> None:
        """Adds the subtask before those that are known."""
        target = subtask.target
        said = dict.fromkeys(_said(subtask.goal, strictly=False))
        self._said.update(said)
        for fact, wanted in said:
            self._all.setdefault((fact[0], wanted), {}).setdefault((fact, target))
            if ANY in fact:
                self._patterns.setdefault((fact[0], wanted), {}).setdefault((fact, target))
        hand = _hand(subtask, tuple(said))
        if hand.takes:
            self._taken.add(target)
        if hand.releases:
            self._released.add(target)
        if hand.carries:
            self._carried[target] += 1
            self._stated.update(f for f, wanted in said if wanted and _is_place(f) and f[1] in (target, ANY))

    def replace(self, said: _Said) -> bool:
        """Decides whether something that an earlier goal says is no longer meant to hold."""
        if _is_place(said.fact) and self._moves(said):
            return True
        key = (said.fact[0], not said.wanted)
        if ANY not in said.fact:
            if _Said(said.fact, not said.wanted) in self._said:
                return True
            return any(_meets(said.fact, *other) for other in self._patterns.get(key, ()))
        return any(_meets(said.fact, *other) for other in self._all.get(key, ()))

    def _moves(self, said: _Said) -> bool:
        """Decides whether one of the subtasks moves what an earlier goal places."""
        _, item, place = said.fact
        if place == GRIPPER:
            moved = self._released if said.wanted else self._taken
            return bool(moved) if item == ANY else item in moved
        carried = self._carried.total() if item == ANY else self._carried[item]
        return said.wanted and carried > self._stated[said.fact]


class _Hand(NamedTuple):
    """What a subtask does with its target: take it, let go of it, and carry it away from where it rests."""

    takes: bool
    releases: bool
    carries: bool


def _hand(subtask: Described, said: Sequence[_Said]) -> _Hand:
    """Returns what a subtask does with its target, by its goal or by its flow."""
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
    return _Hand(
        takes=(picked or grasps) and not (placed or releases),
        releases=placed or releases,
        carries=placed or picked or any(carries(action.primitive, action.parameter) for action in held),
    )


def _is_place(fact: Fact) -> bool:
    """True for a fact that says where a thing is; goals are read before it is checked that they are well formed."""
    return fact[0] in RESTING and len(fact) == 3


def _meets(fact: Fact, other: Fact, target: str) -> bool:
    """Decides whether two facts, of which one has variables, can be one fact about a target."""
    if not overlap(fact, other):
        return False
    names = {b if a == ANY else a for a, b in zip(fact[1:], other[1:], strict=True)}
    return target in names or ANY in names


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
