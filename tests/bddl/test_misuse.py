"""What cannot be meant raises a typed exception that says what was expected; what is nearly right simply works."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

import bddl
from benchmarks.compiled_goals import compile_goal

OPEN = bddl.Atom("open", ("a",))
ALL_OPEN = bddl.ForAll("x", "box", bddl.Atom("open", ("x",)))
PROBLEM = bddl.parse(
    "(define (problem p) (:domain d) (:objects a b - box) (:init (open a)) (:goal (forall (?x - box) (open ?x))))"
)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: bddl.check(None), "A formula, a problem or a domain was expected, not None"),
        (lambda: bddl.analyse(None), "A formula, a problem or a domain was expected, not None"),
        (lambda: bddl.format(None), "A formula, a problem or a domain was expected, not None"),
        (lambda: bddl.format("(open a)"), "A formula, a problem or a domain was expected, not '"),
        (lambda: bddl.correct(None), "BDDL text is a str, not NoneType"),
        (lambda: bddl.parse(None), "BDDL text is a str, not NoneType"),
        (lambda: bddl.parse_formula("(open a)", profile=None), "A profile is given as its name, such as 'scene'"),
        (lambda: bddl.And((1,)), r"`and` takes formulas, such as Atom\('open', \('box_0',\)\), not 1"),
        (lambda: bddl.Or((OPEN, "x")), "`or` takes formulas, .* not 'x'"),
        (lambda: bddl.Not("x"), "`not` takes formulas, .* not 'x'"),
        (lambda: bddl.Imply(OPEN, None), "`imply` takes formulas, .* not None"),
        (lambda: bddl.ForAll("x", "box", "(open ?x)"), "`forall` takes formulas, .* not "),
        (lambda: bddl.ForN("x", "box", 1), "`forn` takes formulas, .* not 1"),
        (lambda: bddl.ForPairs("x", "box", "y", "box", ()), r"`forpairs` takes formulas, .* not \(\)"),
        (lambda: bddl.ForNPairs("x", "box", "y", "box", 2), "`fornpairs` takes formulas, .* not 2"),
        (lambda: bddl.evaluate(7, {}), "A formula was expected, not 7"),
        (lambda: bddl.evaluate(OPEN, [OPEN]), "A state is a mapping .* or a set of true facts, not"),
        (lambda: bddl.evaluate(OPEN, {7}), "A true fact is an atom, a tuple such as .* or a text, not 7"),
        (lambda: bddl.evaluate(OPEN, None), "A state is a mapping from atoms to values, a function"),
        (lambda: bddl.evaluate(OPEN, {"open": True}), "A state has atoms, or tuples such as .*, for its keys, not 'op"),
        (lambda: bddl.evaluate(OPEN, {OPEN: 0.5}), "The value of an atom is True, False or, .*; not 0.5"),
        (lambda: bddl.evaluate(bddl.Not(OPEN), {OPEN: "yes"}), "The value of an atom is True, False or, .*; not 'yes'"),
        (lambda: bddl.evaluate(OPEN, lambda atom: np.zeros(2)), "The value of an atom is True, False or"),
        (lambda: bddl.GoalProgress(OPEN)([OPEN]), "A state is a mapping"),
        (lambda: bddl.GoalProgress(OPEN)({OPEN: 0.5}), "The value of an atom is True, False or"),
        (lambda: compile_goal(ALL_OPEN, ["a"]), "Objects are given as a mapping .*; 'a' is neither"),
        (lambda: bddl.ground(ALL_OPEN, 7), "Objects are given as a mapping .*; 7 is neither"),
        (lambda: bddl.check("(open a)", objects=["a"]), "Objects are given as a mapping .*; 'a' is neither"),
        (lambda: bddl.analyse("(open a)", objects="abc"), "Objects are given as a mapping .*; 'a' is neither"),
        (lambda: bddl.correct("(open a)", objects=PROBLEM), "Objects are given as a mapping .*"),
    ],
)  # fmt: skip
def test_misuse_is_told_at_once(call: Callable[[], object], said: str) -> None:
    with pytest.raises(TypeError, match=said):
        call()


def test_the_objects_of_a_problem_are_objects() -> None:
    assert PROBLEM.categories == {"a": "box", "b": "box"}
    for objects in (PROBLEM.objects, list(PROBLEM.objects), iter(PROBLEM.objects), PROBLEM.categories):
        assert [str(atom) for atom in bddl.ground(PROBLEM.goal, objects).atoms] == ["(open a)", "(open b)"]
    given: Any = PROBLEM.objects
    assert compile_goal(PROBLEM.goal, given).evaluate({("open", "a"), ("open", "b")})
    assert bddl.evaluate(PROBLEM.goal, lambda atom: True, given) is True
    assert bddl.GoalProgress(PROBLEM.goal, given)({OPEN: True}) == 0.5
    assert len(list(bddl.options(PROBLEM.goal, given))) == 1
    assert bddl.parse_formula("(open a)", objects=given) == OPEN
    assert [found.code for found in bddl.check("(open c)", objects=given)] == ["unknown-object"]
    assert [found.code for found in bddl.analyse("(open c)", objects=given)] == ["unknown-object"]
    assert bddl.correct("open(a)", objects=given) is not None


@pytest.mark.parametrize("value", [True, False])
@pytest.mark.parametrize("kind", [bool, int, float, np.bool_, np.int64])
def test_the_truth_of_a_formula_is_a_plain_bool(value: bool, kind: type) -> None:
    state = {OPEN: kind(value)}
    assert bddl.evaluate(OPEN, state) is value
    assert bddl.evaluate(bddl.Not(OPEN), state) is (not value)
    assert bddl.evaluate(ALL_OPEN, state, {"a": "box"}) is value
    assert bddl.evaluate(bddl.ForN("x", "box", bddl.Atom("open", ("x",))), state, {"a": "box"}) is value
    assert compile_goal(OPEN).evaluate(state) is value
    assert bddl.GoalProgress(OPEN)(state) == value


def test_a_state_may_name_atoms_by_tuples() -> None:
    closed = bddl.And((OPEN, bddl.Not(bddl.Atom("ontop", ("a", "b")))))
    state: Mapping[Any, bool] = {("open", "a"): True, ("ontop", "a", "b"): False}
    assert bddl.evaluate(closed, state) is True
    assert compile_goal(closed).evaluate(state)
    assert bddl.GoalProgress(closed)(state) == 1.0
    assert [option for option in bddl.options(closed, state=state)]
    assert bddl.evaluate(closed, {("open", "a"): False}) is False
    assert bddl.evaluate(closed, {("open", "a"): True}) is None
