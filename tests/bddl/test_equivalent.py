"""Whether two goals are equivalent, against every state of small scenes."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bddl
from bddl import equivalence

SCENE = {"cup_0": "cup", "cup_1": "cup", "box_0": "box", "box_1": "box", "x": "plate", "y": "plate"}
names = st.sampled_from(("cup_0", "box_0", "x", "y"))
leaves = st.one_of(
    st.builds(lambda name: bddl.Atom("open", (name,)), names),
    st.builds(lambda name, other: bddl.Atom("ontop", (name, other)), names, st.sampled_from(("box_0", "y"))),
)


def _larger(inner: st.SearchStrategy[bddl.Formula]) -> st.SearchStrategy[bddl.Formula]:
    parts = st.lists(inner, max_size=3).map(tuple)
    variable, category = st.sampled_from(("x", "y")), st.sampled_from(("cup", "box", "none"))
    single = (variable, category, inner)
    return st.one_of(
        st.builds(bddl.Not, inner),
        st.builds(bddl.And, parts),
        st.builds(bddl.Or, parts),
        st.builds(bddl.Imply, inner, inner),
        st.builds(bddl.ForAll, *single),
        st.builds(bddl.Exists, *single),
        st.builds(bddl.ForN, *single, count=st.integers(0, 2)),
        st.builds(bddl.ForPairs, st.just("x"), category, st.just("y"), category, inner),
    )


goals = st.recursive(leaves, _larger, max_leaves=4)


def rewritten(goal: bddl.Formula) -> bddl.Formula:
    """Return a goal of the same meaning in other words."""
    match goal:
        case bddl.And(parts=parts):
            return bddl.Not(bddl.Or(tuple(bddl.Not(rewritten(part)) for part in reversed(parts))))
        case bddl.Or(parts=parts):
            return bddl.Not(bddl.And(tuple(bddl.Not(rewritten(part)) for part in reversed(parts))))
        case bddl.Imply(left=left, right=right):
            return bddl.Or((rewritten(right), bddl.Not(rewritten(left))))
        case bddl.ForAll(variable=variable, category=category, body=body):
            return bddl.Not(bddl.Exists(variable, category, bddl.Not(rewritten(body))))
        case bddl.Exists(variable=variable, category=category, body=body):
            return bddl.Not(bddl.ForAll(variable, category, bddl.Not(rewritten(body))))
        case bddl.Not(body=body):
            return bddl.Not(rewritten(body))
    return bddl.Not(bddl.Not(goal))


def differing_states(first: bddl.Formula, second: bddl.Formula) -> int | None:
    """Return in how many states the goals differ, by trying every one; None where there are too many."""
    atoms = bddl.ground(bddl.And((first, second)), SCENE).atoms
    if len(atoms) > 9:
        return None
    states = (dict(zip(atoms, values, strict=True)) for values in product((False, True), repeat=len(atoms)))
    return sum(bddl.evaluate(first, state, SCENE) is not bddl.evaluate(second, state, SCENE) for state in states)


def check(first: bddl.Formula, second: bddl.Formula) -> None:
    answer = bddl.equivalent(first, second, SCENE)
    differing = differing_states(first, second)
    if differing is not None:
        assert answer.equal is (differing == 0)
    assert bool(answer) is (answer.state is None)
    if answer.state is not None:
        values = [bddl.evaluate(goal, answer.state, SCENE) for goal in (first, second)]
        assert values == [answer.holds == "a", answer.holds == "b"]


@given(goals, goals)
def test_answers_are_those_of_trying_every_state(first: bddl.Formula, second: bddl.Formula) -> None:
    check(first, second)


@given(goals)
def test_other_words_for_a_goal_are_equivalent(goal: bddl.Formula) -> None:
    assert bddl.equivalent(goal, rewritten(goal), SCENE).equal
    check(goal, rewritten(goal))


@given(goals, goals)
@settings(max_examples=60)
def test_the_solver_alone_answers_alike(first: bddl.Formula, second: bddl.Formula) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(equivalence, "_guesses", lambda atoms: iter(()))
        check(first, second)


def test_a_state_tells_goals_apart() -> None:
    one, any_number = "(forn (1) (?x - cup) (open ?x))", "(exists (?x - cup) (open ?x))"
    answer = bddl.equivalent(one, any_number, SCENE)
    assert answer.equal is False and answer.holds == "b"
    assert str(answer) == "Goal b alone holds where (open cup_0) (open cup_1) is true, and all else is false."
    assert bddl.equivalent(one, any_number, {"cup_0": "cup"})
    answer = bddl.equivalent("(and (open cup_0) (open cup_1))", any_number, SCENE)
    assert answer.state == {bddl.Atom("open", ("cup_0",)): True, bddl.Atom("open", ("cup_1",)): False}
    apple = {"apple.n.01_1": "apple.n.01"}
    assert bddl.equivalent("(cooked ?apple.n.01_1)", "(not (not (cooked apple.n.01_1)))", apple)


@pytest.mark.parametrize("written", [str, bddl.parse_formula])
def test_objects_that_the_scene_lacks_are_reported_once_each(written: Callable[[str], bddl.Formula | str]) -> None:
    wrong = written("(and (open cup_7) (ontop cup_7 tray_0))")
    for pair in ((wrong, "(open cup_0)"), ("(open cup_0)", wrong), (wrong, wrong)):
        with pytest.raises(bddl.BDDLError) as raised:
            bddl.equivalent(*pair, SCENE)
        assert [found.code for found in raised.value.diagnostics] == ["unknown-object"] * 2
        assert raised.value.first_hint == "did you mean cup_0 or cup_1?" and "tray_0" in str(raised.value)
    assert bddl.equivalent("(ontop cup_0 gripper)", "(or (ontop cup_0 gripper))", SCENE)


def test_simple_differences_are_found_without_the_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(equivalence, "Solver", None)
    assert bddl.equivalent("(open cup_0)", "(open cup_1)", SCENE).holds == "a"
    assert bddl.equivalent("(and (open cup_0) (open cup_1))", "(and (open cup_1) (open cup_0))", SCENE)


def test_pairs_are_read_as_asked() -> None:
    scene = {f"{kind}_{number}": kind for kind in ("cup", "box") for number in range(3)}
    pairs = bddl.parse_formula("(forpairs (?x - cup) (?y - box) (inside ?x ?y))")
    counted = bddl.parse_formula(
        "(and (forall (?x - cup) (exists (?y - box) (inside ?x ?y)))"
        "     (forall (?y - box) (exists (?x - cup) (inside ?x ?y))))"
    )
    answer = bddl.equivalent(pairs, counted, scene)
    assert answer.equal is False and answer.holds == "b"
    assert bddl.equivalent(pairs, counted, scene, pairs="reference")


def test_too_large_goals_are_refused() -> None:
    scene = {f"cup_{number}": "cup" for number in range(300)}
    deep = "(forall (?x - cup) (exists (?y - cup) (forall (?z - cup) (or (nextto ?x ?y) (nextto ?y ?z)))))"
    with pytest.raises(bddl.FormulaTooLarge, match="more than 200000 parts"):
        bddl.equivalent(deep, "(open cup_0)", scene)
