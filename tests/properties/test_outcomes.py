"""Failure outcomes against simulation: 8 (footprints), 11 (invariants), and what explains what was seen."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import bddl
from oag.model.facts import HAND, Fact, generalisations
from oag.model.primitives import Primitive
from oag.revision.outcomes import INTENDED, Outcome, agreeing_outcomes, footprint, step_outcomes
from tests.bruteforce import Part, World, act, allowed, consistent
from tests.failures import failures
from tests.properties.plans import FACTS, ITEMS, KINDS, situations
from tests.properties.test_frame import context_of, known, value_of, world_of

FEW = settings(max_examples=300, deadline=None)
MANY = settings(max_examples=2000, deadline=None)
moves = st.sampled_from(list(Primitive))
HELD = tuple(("inside", item, "gripper") for item in ITEMS)


def possible(situation: tuple[World, Part], primitive: Primitive) -> tuple[Outcome, ...]:
    """What the package says can come of a step that may run."""
    state, part = situation
    assume(primitive is not Primitive.NAVIGATE_TO_SUPPORT or part.support is not None)
    assume(allowed(state, part, int(primitive), KINDS))
    return step_outcomes(primitive, context_of(part), known(state).read(HAND).value)


def ends(state: World, outcome: Outcome) -> set[World]:
    """The complete states that an outcome leads to: what it leaves open may be either."""
    knowledge = known(state)
    knowledge.apply(outcome.effect, 2)
    loose = [fact for fact in FACTS if knowledge.read(fact).value is None]
    found = set()
    for values in product((False, True), repeat=len(loose)):
        for fact, value in zip(loose, values, strict=True):
            knowledge.write(fact, value, 2)
        after = world_of(knowledge)
        found.add(World(after.true, None if after.base == "None" else after.base, after.arm, after.hand))
    return found


def check_outcomes(situation: tuple[World, Part], primitive: Primitive) -> None:
    """Names and states are the oracle's, and every state keeps the invariants (11)."""
    state, part = situation
    first, *others = possible(situation, primitive)
    assert first.name == INTENDED and ends(state, first) == {act(state, part, int(primitive), KINDS)}
    said = {(other.name, other.about, after) for other in others for after in ends(state, other)}
    assert said == set(failures(state, part, int(primitive), KINDS))
    assert all(consistent(after) for _, _, after in said)
    assert len(others) == len({(other.name, other.about) for other in others})


def check_footprint(situation: tuple[World, Part], primitive: Primitive) -> None:
    """8: the intended outcome changes nothing outside its footprint, in the oracle's simulation."""
    state, part = situation
    assume(primitive is not Primitive.NAVIGATE_TO_SUPPORT or part.support is not None)
    written = set(footprint(primitive, context_of(part), known(state).read(HAND).value))
    after = act(state, part, int(primitive), KINDS)
    for fact in (("near",), ("eef",), HAND, *FACTS):
        if written.isdisjoint(generalisations(fact)):
            assert value_of(after, fact) == value_of(state, fact), fact


def seen(world: World, facts: tuple[Fact, ...]) -> dict[bddl.Atom, bool]:
    """What detectors read of some facts."""
    return {bddl.Atom(fact[0], fact[1:]): world.holds((fact, True)) for fact in facts}


def check_explained(situation: tuple[World, Part], primitive: Primitive, facts: tuple[Fact, ...]) -> None:
    """Of the outcomes, those are named that the oracle can end in with the same readings, and no others."""
    state, part = situation
    offered = possible(situation, primitive)
    happened = [(INTENDED, None, act(state, part, int(primitive), KINDS))]
    happened.extend(failures(state, part, int(primitive), KINDS))
    before = seen(state, (*FACTS, *HELD))
    for _, _, after in happened:
        readings = seen(after, facts)
        alike = {(name, about) for name, about, end in happened if seen(end, facts) == readings}
        assert {(o.name, o.about) for o in agreeing_outcomes(offered, before, readings)} == alike


some_facts = st.lists(st.sampled_from((*FACTS, *HELD)), max_size=8, unique=True).map(tuple)


@given(situations(), moves)
@settings(FEW)
def test_p11_failures_are_the_oracles_and_keep_the_invariants(s: tuple[World, Part], move: Primitive) -> None:
    check_outcomes(s, move)


@given(situations(), moves)
@settings(FEW)
def test_p8_nothing_changes_outside_the_footprint(s: tuple[World, Part], move: Primitive) -> None:
    check_footprint(s, move)


@given(situations(), moves, some_facts)
@settings(FEW)
def test_what_was_seen_is_explained(s: tuple[World, Part], move: Primitive, facts: tuple[Fact, ...]) -> None:
    check_explained(s, move, facts)


@pytest.mark.slow
@given(situations(), moves)
@settings(MANY)
def test_p11_failures_at_length(s: tuple[World, Part], move: Primitive) -> None:
    check_outcomes(s, move)


@pytest.mark.slow
@given(situations(), moves)
@settings(MANY)
def test_p8_footprints_at_length(s: tuple[World, Part], move: Primitive) -> None:
    check_footprint(s, move)


@pytest.mark.slow
@given(situations(), moves, some_facts)
@settings(MANY)
def test_explanations_at_length(s: tuple[World, Part], move: Primitive, facts: tuple[Fact, ...]) -> None:
    check_explained(s, move, facts)
