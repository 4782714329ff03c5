"""The feasibility relation against complete states: an edge exists exactly when some state lets both steps run."""

from __future__ import annotations

from itertools import product

import pytest

import oag
from oag.graph import feasible
from oag.model.symbols import Kind
from tests.bruteforce import Kinds, Part, World, act, allowed

_FIRST = {Kind.ITEM: "cup_0", Kind.ARTICULATED: "fridge_0", Kind.SUPPORT: "table_0", Kind.FIXED: "clock_0"}
_SECOND = {Kind.ITEM: "apple_0", Kind.ARTICULATED: "cabinet_0", Kind.SUPPORT: "shelf_0", Kind.FIXED: "picture_0"}
_KINDS = Kinds(frozenset({"cup_0", "apple_0", "can_0"}), frozenset({"fridge_0", "cabinet_0", "oven_0"}))


def _part(target: str) -> Part:
    return Part(target, target, (), (), ())


def _fits(primitive: int, kind: Kind) -> bool:
    """What no state can change: only fixtures have joints, and furniture cannot be grasped."""
    return (
        kind is Kind.ARTICULATED if primitive in (4, 19) else primitive != 3 or kind not in (Kind.SUPPORT, Kind.FIXED)
    )


def _some_state_lets_both_run(first: int, second: int, one: str, other: str) -> bool:
    """The question asked of every state of the hand, the base and the arm."""
    hands = (None, *(name for name in (one, other, "can_0", "oven_0") if name not in ("table_0", "shelf_0")))
    for hand, base, arm in product(hands, (one, other), product(("before", "at", "free"), (one, other))):
        world = World(frozenset(), base=base, arm=arm, hand=hand)
        if not allowed(world, _part(one), first, _KINDS):
            continue
        if allowed(act(world, _part(one), first, _KINDS), _part(other), second, _KINDS):
            return True
    return False


@pytest.mark.parametrize("kinds", list(product(Kind, Kind)), ids=lambda pair: "-".join(kind.name for kind in pair))
def test_an_edge_exists_exactly_when_some_state_lets_both_steps_run(kinds: tuple[Kind, Kind]) -> None:
    one = _FIRST[kinds[0]]
    pairings = [(False, _SECOND[kinds[1]])] + ([(True, one)] if kinds[0] is kinds[1] else [])
    for (same, other), first, second in product(pairings, oag.Primitive, oag.Primitive):
        expected = (
            _fits(first, kinds[0]) and _fits(second, kinds[1]) and _some_state_lets_both_run(first, second, one, other)
        )
        answer = feasible(first, second, kinds=kinds, same_object=same)
        assert answer is expected, (first.name, second.name, same)
