"""Properties 8 to 11: what primitives write and leave alone, and regression against simulation."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import bddl
import oag
from oag.model.symbols import EEF, HAND, NEAR, Condition, Fact, Primitive, Value, gripping, held_by, holding
from oag.primitives.cargo import carriage_of
from oag.primitives.state import State, step
from oag.primitives.table import Context, Effect, Placement, Rows, effect, requirements
from oag.verify.verify import crossing
from tests.bruteforce import Action, Part, World, act, allowed, consistent, run, split
from tests.properties.plans import (
    FACTS,
    FIXTURES,
    ITEMS,
    KINDS,
    SURFACES,
    Case,
    cases,
    complete_states,
    numbered,
    parts,
    situations,
)

SOLID: tuple[Fact, ...] = (("inside", "*", "apple_0"), ("inside", "*", "table_0"))
FEW = settings(max_examples=130, deadline=None)


def context_of(part: Part) -> Context:
    """The package's context of an oracle's subtask."""
    placement = None if part.place is None else Placement(*part.place)
    carriage = carriage_of((*ITEMS, *FIXTURES, *SURFACES), ITEMS, dict.fromkeys(SOLID, False), ())
    return Context(part.target, part.support, placement, part.target in ITEMS, FIXTURES, ITEMS, carriage)


def value_of(world: World, fact: Fact) -> Value:
    """A fact's value in a complete state, as the package would have it."""
    if fact == NEAR:
        return world.base
    if fact == HAND:
        return "empty" if world.hand is None else (holding if world.hand in ITEMS else gripping)(world.hand)
    if fact == EEF:
        return None if world.arm is None else " ".join(world.arm).strip()
    return fact in world.true


def known(world: World) -> State:
    """Complete knowledge of a state."""
    return State().after(tuple((fact, value_of(world, fact)) for fact in (NEAR, HAND, EEF, *FACTS)))


def world_of(known: State) -> World:
    """The state that complete knowledge describes."""
    hand = str(known.hand)
    arm, _, where = str(known.value(EEF)).partition(" ")
    return World(
        frozenset(fact for fact in FACTS if known.value(fact) is True),
        base=str(known.value(NEAR)),
        arm=(arm, where),
        hand=None if hand == "empty" else hand.partition(" ")[2],
    )


moves = st.sampled_from([p for p in Primitive])
numbers = st.integers(0, 3)


@given(situations(), moves, numbers)
@settings(FEW, max_examples=250)
def test_p8_a_primitive_changes_what_the_oracle_says_and_nothing_else(
    situation: tuple[World, Part], primitive: Primitive, number: int
) -> None:
    check_primitive(situation, int(primitive))
    check_primitive(situation, numbered(int(primitive), number))


def check_primitive(situation: tuple[World, Part], action: Action) -> None:
    """8 and 11: a primitive may run where the oracle lets it, does what the oracle does, and keeps the invariants."""
    state, part = situation
    primitive, parameter = Primitive(split(action)[0]), split(action)[1]
    assume(primitive is not Primitive.NAVIGATE_TO_SUPPORT or part.support is not None)
    before, context = known(state), context_of(part)
    hand = before.hand
    needed = requirements(primitive, context, hand)
    holds = all(any(c.grade(before.value(c.fact)) for c in clause) for clause in needed)
    assert holds is allowed(state, part, action, KINDS)
    if holds:
        after = world_of(step(before, Rows(context), primitive, parameter, 2)[1])
        assert after == act(state, part, action, KINDS)
        assert consistent(after)


@given(situations(), moves)
@settings(FEW, max_examples=250)
def test_p11_invariants_survive_every_primitive(situation: tuple[World, Part], primitive: Primitive) -> None:
    state, part = situation
    assert consistent(state)
    if primitive is Primitive.UNGRASP and not allowed(state, part, int(primitive), KINDS):
        # Nothing is put on what it carries: the row's need keeps the invariant.
        return
    assert consistent(world_of(step(known(state), Rows(context_of(part)), primitive, time=2)[1]))


@given(st.sampled_from(list(Primitive)), parts(), st.sampled_from(("empty", "holding cup_0", "gripping fridge_0")))
@settings(FEW, max_examples=60)
def test_an_effect_is_a_map(primitive: Primitive, part: Part, hand: str) -> None:
    """No fact is written twice by one primitive: deleting and adding it at once has no meaning here."""
    written: Effect = effect(primitive, context_of(part), hand)
    assert len({fact for fact, _ in written}) == len(written)


def check_regression(case: Case, states: list[World]) -> None:
    """9: from any complete state that meets what crosses a boundary, the rest of the plan reaches the goal."""
    report = oag.compose(case.task()).verify()
    if report.verdict is not oag.Verdict.PROVED:
        return
    assert report.trace is not None
    for boundary, conditions in enumerate(crossing(report.trace, len(case.parts))):
        for state in states:
            meeting = made_to_meet(state, conditions)
            if meeting is not None:
                assert run(meeting, case.parts[boundary + 1 :], case.goal, KINDS) is None, (boundary, meeting)


def made_to_meet(state: World, conditions: tuple[Condition, ...]) -> World | None:
    """The state changed just enough to meet all conditions; None when the invariants forbid that."""
    for condition in conditions:
        fact, value = condition.fact, condition.value
        if fact == NEAR:
            state = replace(state, base=str(value))
        elif fact == EEF:
            position, _, where = str(value).partition(" ")
            state = replace(state, arm=(position, where))
        elif fact == HAND and condition.positive:
            state = replace(state, hand=None if value == "empty" else str(value).partition(" ")[2])
        elif fact == HAND:
            if state.hand is not None and state.hand == held_by(value):
                return None
        else:
            state = replace(state, true=state.true | {fact} if condition.positive else state.true - {fact})
    return state if consistent(state) else None


@given(cases(most_unknown=2), st.lists(complete_states(), min_size=1, max_size=4))
@settings(FEW, max_examples=150)
def test_p9_regressed_goals_are_enough_for_the_rest(case: Case, states: list[World]) -> None:
    check_regression(case, states)


def reads(world: World, atom: bddl.Atom) -> bool:
    """Whether an atom holds in a complete state."""
    return world.holds(((atom.predicate, *atom.args), True))


@given(cases(most_unknown=2))
@settings(FEW, max_examples=60)
def test_p9_progress_entails_what_it_regresses_to(case: Case) -> None:
    report = oag.compose(case.task()).verify()
    if report.verdict is not oag.Verdict.PROVED:
        return
    for start in case.starts():
        world = start
        for part, accepted in zip(case.parts, report.regressed_goals, strict=True):
            for action in part.flow:
                world = act(world, part, action, KINDS)
            assert bddl.evaluate(accepted, partial(reads, world))


@given(situations(), st.lists(moves, max_size=6), st.integers(0, 6))
@settings(FEW, max_examples=100)
def test_p10_progress_distributes_over_concatenation(
    situation: tuple[World, Part], flow: list[Primitive], cut: int
) -> None:
    """A transfer between two halves of a flow writes nothing, so cutting a flow in two changes nothing."""
    check_concatenation(situation, flow, cut)


def check_concatenation(situation: tuple[World, Part], flow: list[Primitive], cut: int) -> None:
    """10: following a flow is following its two parts."""
    state, part = situation
    assume(part.support is not None or Primitive.NAVIGATE_TO_SUPPORT not in flow)
    context = context_of(part)
    whole, halves = known(state), known(state)
    for time, primitive in enumerate(flow, start=1):
        whole = step(whole, Rows(context), primitive, time=2 * time)[1]
    middle = known(state)
    for half in (flow[:cut], flow[cut:]):
        for time, primitive in enumerate(half, start=1):
            middle = step(middle, Rows(context), primitive, time=2 * time)[1]
        # The second half starts from the state that the first one ended in, and from nothing else.
        middle = halves = known(world_of(middle))
    assert world_of(whole) == world_of(halves)


@pytest.mark.slow
@given(cases(most_unknown=4), st.lists(complete_states(), min_size=1, max_size=6))
@settings(max_examples=2000, deadline=None)
def test_p9_at_length(case: Case, states: list[World]) -> None:
    check_regression(case, states)


@pytest.mark.slow
@given(situations(), moves, numbers)
@settings(max_examples=4000, deadline=None)
def test_p8_p11_at_length(situation: tuple[World, Part], primitive: Primitive, number: int) -> None:
    check_primitive(situation, numbered(int(primitive), number))


@pytest.mark.slow
@given(situations(), st.lists(moves, max_size=6), st.integers(0, 6))
@settings(max_examples=3000, deadline=None)
def test_p10_at_length(situation: tuple[World, Part], flow: list[Primitive], cut: int) -> None:
    check_concatenation(situation, flow, cut)
