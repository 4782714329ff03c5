"""Progress is 1 exactly when the goal is true, and counts the literals that a cheapest way still lacks."""

from __future__ import annotations

from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from bddl import GoalProgress
from benchmarks.compiled_goals import compile_goal
from tests.bddl.small_goals import OBJECTS, Partial, goals, missing, partial_states, readings, smallest_ways


def atom(predicate: str, *names: str) -> bddl.Atom:
    return bddl.Atom(predicate, names)


def opened(*names: str) -> dict[bddl.Atom, bool]:
    """Return a state in which some of the objects a1 to b2 are open and all others are not."""
    return {atom("open", name): name in names for name in OBJECTS}


@given(goals(), readings)
def test_progress_is_one_exactly_when_the_goal_is_true(goal: bddl.Formula, pairs: bddl.PairSemantics) -> None:
    compiled = GoalProgress(goal, OBJECTS, pairs=pairs)
    for state in partial_states(compiled.atoms):
        value = compiled(dict(state))
        assert 0.0 <= value <= 1.0
        assert (value == 1.0) == (bddl.evaluate(goal, dict(state), OBJECTS, pairs=pairs) is True)


@given(goals(), readings)
def test_what_is_missing_is_at_most_the_least_number_of_literals(goal: bddl.Formula, pairs: bddl.PairSemantics) -> None:
    compiled = GoalProgress(goal, OBJECTS, pairs=pairs)
    found = smallest_ways(goal, pairs)
    for state in partial_states(compiled.atoms):
        least = min((missing(way, state) for way in found), default=inf)
        value = compiled.missing(dict(state))
        assert value <= least and (value == 0) == (least == 0)


@pytest.mark.parametrize(
    "text",
    [
        "(and (open a1) (not (open a2)) (or (and (open a3) (open b1)) (inside a1 b1)))",
        "(or (and (open a1) (open b1)) (forn (2) (?x - a) (open ?x)))",
        "(and (or (open b1) (open b2)) (not (forn (2) (?x - a) (open ?x))))",
        "(and (open b1) (fornpairs (2) (?x - a) (?y - b) (inside ?x ?y)))",
        "(imply (open b1) (forall (?x - a) (inside ?x b1)))",
    ],
)
def test_where_conjuncts_share_no_atom_the_count_is_exact(text: str) -> None:
    goal = bddl.parse_formula(text, objects=OBJECTS, profile="behavior-compat")
    compiled = GoalProgress(goal, OBJECTS)
    found = smallest_ways(goal)
    for state in partial_states(compiled.atoms):
        assert compiled.missing(dict(state)) == min(missing(way, state) for way in found)


@given(goals(most_atoms=5), st.data())
def test_knowing_more_of_a_way_never_lowers_progress(goal: bddl.Formula, data: st.DataObject) -> None:
    compiled = GoalProgress(goal, OBJECTS)
    found = smallest_ways(goal)
    if not found:
        return
    way = data.draw(st.sampled_from(found))
    state: Partial = frozenset()
    before = compiled(dict(state))
    for literal in data.draw(st.permutations(sorted(way, key=str))):
        state |= {literal}
        after = compiled(dict(state))
        assert after >= before
        before = after
    assert before == 1.0


@given(goals(most_atoms=5))
def test_the_packed_state_of_a_compiled_goal_is_understood(goal: bddl.Formula) -> None:
    compiled = compile_goal(goal, OBJECTS)
    own = GoalProgress(goal, OBJECTS)
    assert own.atoms == compiled.atoms
    for packed in range(1 << len(own.atoms)):
        state = {one: bool(packed >> index & 1) for index, one in enumerate(own.atoms)}
        assert own.packed(packed) == own(state)
        assert own(state.get) == own(state)


def test_a_conjunction_of_literals_counts_those_that_hold() -> None:
    goal = bddl.parse_formula("(and (open a1) (not (open a2)) (open b1) (open b2))")
    assert GoalProgress(goal)(opened("b1")) == 0.5
    assert GoalProgress(goal)({}) == 0.0


def test_exactly_n_counts_in_both_directions() -> None:
    goal = bddl.ForN("x", "a", atom("open", "x"), count=1)
    compiled = GoalProgress(goal, OBJECTS)
    assert compiled.missing(opened()) == 1
    assert compiled.missing(opened("a2")) == 0
    assert compiled.missing(opened("a1", "a2", "a3")) == 2
    assert compiled.missing({}) == 3


def test_pairs_are_assigned_where_it_costs_least() -> None:
    goal = bddl.ForPairs("x", "a", "y", "b", atom("inside", "x", "y"))
    every = {one: False for one in bddl.ground(goal, OBJECTS).atoms}
    # Both things are in b1 and one of them in b2 as well: a matching. Without the last, one must move.
    state = every | {atom("inside", "a1", "b1"): True, atom("inside", "a2", "b1"): True}
    assert GoalProgress(goal, OBJECTS)(state) == 0.5
    assert GoalProgress(goal, OBJECTS)(state | {atom("inside", "a1", "b2"): True}) == 1.0


def test_the_reference_reading_of_pairs_counts_rows_and_columns() -> None:
    objects = {"a1": "a", "a2": "a", "a3": "a", "b1": "b", "b2": "b", "b3": "b"}
    goal = bddl.ForPairs("x", "a", "y", "b", atom("inside", "x", "y"))
    cross = {("a1", "b1"), ("a1", "b2"), ("a1", "b3"), ("a2", "b1"), ("a3", "b1")}
    state = {atom("inside", a, b): (a, b) in cross for a in objects for b in objects}
    assert GoalProgress(goal, objects, pairs="reference")(state) == 1.0
    assert GoalProgress(goal, objects, pairs="matching")(state) == pytest.approx(2 / 3)


def test_shared_atoms_are_counted_once() -> None:
    goal = bddl.parse_formula("(and (or (open a1) (open a2)) (or (open a1) (open a3)))")
    compiled = GoalProgress(goal)
    assert compiled.missing(opened()) == 1
    assert compiled.missing(opened("a2")) == 1


def test_a_goal_that_contradicts_itself_is_never_reached() -> None:
    texts = ("(and (open a1) (not (open a1)))", "(and (or (open a1) (open a2)) (not (open a1)) (not (open a2)))")
    for goal in map(bddl.parse_formula, texts):
        compiled = GoalProgress(goal)
        assert all(compiled(dict(state)) < 1.0 for state in partial_states(compiled.atoms))


def test_goals_without_atoms() -> None:
    assert GoalProgress(bddl.And(()))({}) == 1.0
    assert GoalProgress(bddl.Or(()))({}) == 0.0
    assert GoalProgress(bddl.Or(())).missing({}) == inf


def test_a_deep_goal_is_no_trouble() -> None:
    goal: bddl.Formula = atom("open", "a1")
    for level in range(10_000):
        name = atom("open", f"c{level % 50}")
        goal = bddl.Not(bddl.Or((bddl.Not(name), goal))) if level % 2 else bddl.Imply(name, goal)
    assert GoalProgress(goal)(lambda _: False) < 1.0
    assert GoalProgress(bddl.Not(goal))(lambda _: False) == 1.0


def test_objects_are_needed_for_quantifiers() -> None:
    with pytest.raises(bddl.ObjectsRequired):
        GoalProgress(bddl.ForAll("x", "a", atom("open", "x")))
