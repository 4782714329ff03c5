"""The symbolic table of the 21 primitives: what each needs and what its intended outcome writes.

Everything that reasons about plans (`verify`, `recheck`, regression, the docs) reads this one table. An effect is a map
from facts to values: a primitive cannot both delete and add a fact. What is not written keeps its value.

Source: the paper's primitive library (Module 5, 3.1 to 3.4). Two departures, both explained in docs/semantics.md, The
primitives: GRASP needs the fixture that holds the item to be open, and carrying an item makes `nextto`,
`touching` and `under` of it unknown.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from functools import cache
from itertools import product
from typing import NamedTuple

import bddl
from oag.facts import (
    ANY,
    EEF,
    EMPTY,
    FREE,
    GRIPPER,
    HAND,
    HOME,
    NEAR,
    Condition,
    Fact,
    Value,
    condition_of,
    gripping,
    held_by,
    holding,
)
from oag.primitives import Primitive

# One alternative must hold; most clauses have exactly one.
Clause = tuple[Condition, ...]
# Clauses that must all hold (of one condition each, for a conjunction of literals), or a formula beyond that.
Needed = tuple[Clause, ...] | bddl.Formula
Effect = tuple[tuple[Fact, Value], ...]
# What a primitive needs, and what it writes.
Row = tuple[tuple[Clause, ...], Effect]

# Where an item rests, and relations that motion of an item makes unknown.
RESTING = ("ontop", "inside")
VAGUE = ("nextto", "touching", "under")
NAVIGATION = (Primitive.NAVIGATE_TO_TARGET, Primitive.NAVIGATE_TO_SUPPORT)
# What takes along whatever the hand holds.
CARRYING = (*NAVIGATION, Primitive.LIFT_EEF_UP, Primitive.RETREAT)

# Named tuples made this way take half the time, and there are several for every step.
_made = tuple.__new__
_EMPTY_HAND: Clause = (Condition(HAND, EMPTY),)
_AT_HOME: tuple[Fact, Value] = (EEF, HOME)
_FREED: Effect = ((EEF, FREE),)
_EMPTIED: Effect = ((HAND, EMPTY),)


class Placement(NamedTuple):
    """Where a goal wants the target: `relation` is ontop or inside."""

    relation: str
    support: str


class Context(NamedTuple):
    """What a primitive's meaning depends on beside the state.

    Attributes:
        target: The subtask's target (o_t).
        support_goal: Its goal support (o_s2), or None.
        placement: Where its goal wants the target, or None.
        target_is_item: True when GRASP takes the target into the hand, False when it grips a fixture's handle.
        articulated: Ids of the scene's articulated fixtures, in order.
        items: Ids of its items, in order: bowls and the like, which are open at the top.
    """

    target: str
    support_goal: str | None
    placement: Placement | None
    target_is_item: bool
    articulated: tuple[str, ...]
    items: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The objects that the subtask is about."""
        return (self.target,) if self.support_goal is None else (self.target, self.support_goal)


class Rows:
    """The rows of the table for one context; once they are shared, each is worked out only once.

    Attributes:
        context: The objects that they are about.
    """

    __slots__ = ("_known", "context")

    def __init__(self, context: Context) -> None:
        self.context = context
        # Most contexts occur once and need each row once, which does not pay for remembering it.
        self._known: dict[tuple[Primitive, Value], Row] | None = None

    def shared(self) -> None:
        """Notes that another subtask has the same objects: from now on rows are remembered."""
        if self._known is None:
            self._known = {}

    def row(self, primitive: Primitive, hand: Value) -> Row:
        """Returns what a primitive needs and what it writes when the hand has a value before it."""
        context = self.context
        if self._known is None:
            return _TABLE[primitive](context, hand)
        key = (primitive, hand)
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = _TABLE[primitive](context, hand)
        return known


def needed(formula: bddl.Formula) -> Needed:
    """Returns a formula's literals as clauses, or the formula when it is no conjunction of literals."""
    literals = bddl.literals(formula)
    return formula if literals is None else clauses_of(literals)


def clauses_of(literals: Iterable[bddl.Literal]) -> tuple[Clause, ...]:
    """Returns literals as clauses of one condition each."""
    return tuple((condition_of(literal.atom, literal.value),) for literal in literals)


def placement_of(goal: bddl.Formula, target: str) -> Placement | None:
    """Returns where a goal wants its target: the first positive `ontop` or `inside` literal among its conjuncts."""
    said = (literal for part in bddl.conjuncts(goal) for literal in bddl.literals(part) or ())
    return placement_among(clauses_of(said), target)


def placement_among(clauses: Iterable[Clause], target: str) -> Placement | None:
    """Returns where a goal of these clauses wants its target; being in the gripper is no place."""
    for (fact, _, positive), *_ in clauses:
        if positive and len(fact) == 3 and fact[0] in RESTING and fact[1] == target and fact[2] != GRIPPER:
            return Placement(fact[0], fact[2])
    return None


def requirements(primitive: Primitive, context: Context, hand: Value) -> tuple[Clause, ...]:
    """Returns the clauses that must all hold before a primitive runs.

    Args:
        primitive: What is to run.
        context: The subtask's objects.
        hand: Value of the hand before it, None when unknown; only UNGRASP depends on it.
    """
    return _TABLE[primitive](context, hand)[0]


def effect(primitive: Primitive, context: Context, hand: Value) -> Effect:
    """Returns what the intended outcome of a primitive writes.

    Args:
        primitive: What runs.
        context: The subtask's objects.
        hand: Value of the hand before it; None when unknown, which makes every resting place unknown where the
            primitive would have moved what is held.

    Returns:
        Pairs (fact or pattern, value), no fact twice; a pattern does not touch a fact that is listed itself.
    """
    return _TABLE[primitive](context, hand)[1]


def _navigate_to_target(context: Context, hand: Value) -> Row:
    return (), ((NEAR, context.target), _AT_HOME) + _carried(hand)


def _navigate_to_support(context: Context, hand: Value) -> Row:
    return (), ((NEAR, context.support_goal), _AT_HOME) + _carried(hand)


def _approach(context: Context, _hand: Value) -> Row:
    target = context.target
    return ((_made(Condition, (NEAR, target, True)),),), ((EEF, f"before {target}"),)


def _converge(context: Context, _hand: Value) -> Row:
    target = context.target
    return ((_made(Condition, (EEF, f"before {target}", True)),),), ((EEF, f"at {target}"),)


def _grasp(context: Context, _hand: Value) -> Row:
    target = context.target
    needs = ((_made(Condition, (EEF, f"at {target}", True)),), _EMPTY_HAND)
    if context.target_is_item:
        return needs + _reachable(context), ((HAND, holding(target)),)
    return needs, ((HAND, gripping(target)),)


def _reachable(context: Context) -> tuple[Clause, ...]:
    """Returns that an item is in no closed fixture."""
    return tuple(
        (Condition(("inside", context.target, fixture), True, False), Condition(("open", fixture), True))
        for fixture in context.articulated
    )


def _articulate_open(context: Context, _hand: Value) -> Row:
    target = context.target
    return ((_made(Condition, (HAND, gripping(target), True)),),), ((("open", target), True),)


def _articulate_close(context: Context, _hand: Value) -> Row:
    target = context.target
    return ((_made(Condition, (HAND, gripping(target), True)),),), ((("open", target), False),)


def _ungrasp(context: Context, hand: Value) -> Row:
    written = _EMPTIED + _released(context, hand)
    if context.placement is None or not (hand is None or held_by(hand) == context.target):
        return (), written
    relation, support = context.placement
    # Of a hand that may hold anything, it is needed only if it holds the target.
    other: Clause = (Condition(HAND, holding(context.target), False),) if hand is None else ()
    near: Clause = (*other, Condition(NEAR, support))
    if relation == "inside" and support in context.articulated:
        return (near, (*other, Condition(("open", support), True))), written
    return (near,), written


def _retreat(_context: Context, hand: Value) -> Row:
    return (), (_AT_HOME,) + _carried(hand)


def _lift(context: Context, hand: Value) -> Row:
    item = held_by(hand)
    if item is None:
        return (), _FREED + _carried(hand)
    # Out of a bowl it takes a thing. Within a compartment of furniture it does not: detectors read `inside` until the
    # hand has backed out.
    risen = tuple((fact, value) for fact, value in _carried(hand) if fact[0] != "inside")
    return (), _FREED + risen + tuple((("inside", item, vessel), False) for vessel in context.items if vessel != item)


def _move(_context: Context, _hand: Value) -> Row:
    return (), _FREED


def _carried(hand: Value) -> Effect:
    """Returns what moving the hand away writes about what it holds."""
    if hand is None:
        return tuple(((predicate, ANY, ANY), None) for predicate in (*RESTING, *VAGUE))
    item = held_by(hand)
    return () if item is None else _carried_item(item)


@cache
def _carried_item(item: str) -> Effect:
    """Returns what carrying an item writes: it rests nowhere, and what it is beside is unknown."""
    nowhere: list[tuple[Fact, Value]] = [((predicate, item, ANY), False) for predicate in RESTING]
    for predicate in VAGUE:
        nowhere.extend((((predicate, item, ANY), None), ((predicate, ANY, item), None)))
    return tuple(nowhere)


def _released(context: Context, hand: Value) -> Effect:
    """Returns what letting go writes about what was held."""
    if hand is None:
        return tuple(((predicate, ANY, ANY), None) for predicate in RESTING)
    if context.placement is None or held_by(hand) != context.target:
        # It falls to the floor, or stays where it was if it was never lifted: no resting place is gained.
        return ()
    relation, support = context.placement
    # The converse cannot hold as well (antisymmetry), whatever was known of it.
    return (((relation, context.target, support), True), ((relation, support, context.target), False))


# By the number of the primitive; what is not said otherwise is plain motion, and 0 is no primitive.
_TABLE: list[Callable[[Context, Value], Row]] = [_move] * (len(Primitive) + 1)
_TABLE[Primitive.APPROACH] = _approach
_TABLE[Primitive.CONVERGE] = _converge
_TABLE[Primitive.GRASP] = _grasp
_TABLE[Primitive.ARTICULATE_OPEN] = _articulate_open
_TABLE[Primitive.ARTICULATE_CLOSE] = _articulate_close
_TABLE[Primitive.UNGRASP] = _ungrasp
_TABLE[Primitive.RETREAT] = _retreat
_TABLE[Primitive.LIFT_EEF_UP] = _lift
_TABLE[Primitive.NAVIGATE_TO_TARGET] = _navigate_to_target
_TABLE[Primitive.NAVIGATE_TO_SUPPORT] = _navigate_to_support


@cache
def library_sha() -> str:
    """Returns the SHA-256 of the table's content, tried on sample objects; certificates carry it."""
    digest = hashlib.sha256()
    placements = (None, Placement("ontop", "s"), Placement("inside", "s"))
    for is_item, placement in product((True, False), placements):
        context = Context("t", "s", placement, is_item, ("s",), ("t", "x", "y"))
        for primitive, hand in product(Primitive, (None, EMPTY, holding("t"), holding("x"), gripping("t"))):
            row = (int(primitive), is_item, placement, hand)
            table = (requirements(primitive, context, hand), effect(primitive, context, hand))
            digest.update(repr((row, table)).encode())
    return digest.hexdigest()
