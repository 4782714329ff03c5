"""Compiled goals and batches say what `evaluate` says, and `evaluate` says what the definitions say."""

from __future__ import annotations

import subprocess
import sys
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from bddl import And, Atom, Formula, ForN, ForNPairs, ForPairs, Not, Or
from bddl.grounding import PAIR_SEMANTICS
from benchmarks.compiled_goals import TotalState, WrongState, compile_goal
from tests.bddl.universe import OBJECTS, Complete, can_pair_off, formulas, holds, pair_semantics, states

unknown_tenths = st.integers(0, 10)


@given(formulas, states, pair_semantics)
def test_in_a_complete_state_truth_is_classical(formula: Formula, state: Complete, pairs: bddl.PairSemantics) -> None:
    expected = holds(formula, state, pairs)
    goal = compile_goal(formula, OBJECTS, pairs=pairs)
    values = [state(atom) for atom in goal.atoms]
    assert bddl.evaluate(formula, state, OBJECTS, pairs=pairs) is expected
    true = {atom for atom in goal.atoms if state(atom)}
    for form in (values, true, {atom.label for atom in true}):
        assert goal.evaluate(form) is expected
    conditions = tuple(holds(part, state, pairs) for part in goal.conditions)
    assert goal.evaluate_conditions(values) == goal.evaluate_conditions(true) == conditions


@given(formulas, states, st.integers(0, 10_000), unknown_tenths, pair_semantics)
def test_what_is_known_in_part_is_not_contradicted_by_the_rest(
    formula: Formula, state: Complete, seed: int, tenths: int, pairs: bddl.PairSemantics
) -> None:
    hidden = Complete(seed, tenths)

    def known(atom: Atom) -> bool | None:
        return None if hidden(atom) else state(atom)

    value = bddl.evaluate(formula, known, OBJECTS, pairs=pairs)
    if value is not None:
        assert holds(formula, state, pairs) is value


@given(formulas, st.lists(states, max_size=70), pair_semantics)
def test_a_batch_says_what_each_state_says(formula: Formula, batch: list[Complete], pairs: bddl.PairSemantics) -> None:
    goal = compile_goal(formula, OBJECTS, pairs=pairs)
    rows = [[state(atom) for atom in goal.atoms] for state in batch]
    found = goal.evaluate_batch(np.array(rows, dtype=bool).reshape(len(batch), len(goal.atoms)))
    assert found.shape == (len(batch), len(goal.conditions))
    assert [tuple(row) for row in found.tolist()] == [goal.evaluate_conditions(row) for row in rows]


def counting_forms(rows: int, columns: int) -> tuple[dict[str, str], list[Formula]]:
    """Return a scene of two categories, and every counting form over distinct atoms of it."""
    scene = {f"a_{i}": "a" for i in range(rows)} | {f"b_{j}": "b" for j in range(columns)}
    near = Atom("nextto", ("x", "y"))
    pairs: list[Formula] = [ForNPairs("x", "a", "y", "b", near, count=n) for n in range(max(rows, columns) + 2)]
    counts = [ForN("x", "a", Atom("open", ("x",)), count=n) for n in range(rows + 2)]
    return scene, [*pairs, ForPairs("x", "a", "y", "b", near), *counts]


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 3), (2, 2), (3, 2), (2, 3)])
@pytest.mark.parametrize("pairs", PAIR_SEMANTICS)
def test_counting_forms_are_unknown_exactly_when_completions_disagree(
    rows: int, columns: int, pairs: bddl.PairSemantics
) -> None:
    """All partial states: the forms over distinct atoms lose nothing to Kleene's tables."""
    scene, forms = counting_forms(rows, columns)
    for form in forms:
        goal = compile_goal(form, scene, pairs=pairs)
        width = len(goal.atoms)
        truth = {values: goal.evaluate(values) for values in product((False, True), repeat=width)}
        # The values of a partial state's completions, from those of the two partial states that know one atom more.
        seen: dict[tuple[bool | None, ...], set[bool]] = {values: {value} for values, value in truth.items()}
        for partial in sorted(product((False, True, None), repeat=width), key=lambda known: known.count(None)):
            if None in partial:
                gap = partial.index(None)
                seen[partial] = {
                    value for known in (False, True) for value in seen[(*partial[:gap], known, *partial[gap + 1 :])]
                }
            expected = seen[partial].copy().pop() if len(seen[partial]) == 1 else None
            known = dict(zip(goal.atoms, partial, strict=True))
            assert bddl.evaluate(form, known.get, scene, pairs=pairs) is expected


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        pytest.param(rows, columns, marks=pytest.mark.slow if rows * columns > 12 else ())
        for rows in range(5)
        for columns in range(5)
    ],
)
def test_pairs_up_to_four_by_four_are_matchings(rows: int, columns: int) -> None:
    """States of all densities against a trial of all choices; small tables in all their states."""
    scene, forms = counting_forms(rows, columns)
    cells = rows * columns
    generator = np.random.default_rng(rows * 10 + columns)
    every = np.array(list(product((False, True), repeat=cells)), dtype=bool).reshape(2**cells, cells)
    table = every if cells <= 9 else generator.random((600, cells)) < generator.random((600, 1))
    for form in forms:
        if isinstance(form, ForN):
            continue
        for pairs in PAIR_SEMANTICS:
            goal = compile_goal(form, scene, pairs=pairs)
            found = goal.evaluate_batch(table)[:, 0].tolist()
            for row, value in zip(table.tolist(), found, strict=True):
                state = dict(zip(goal.atoms, row, strict=True))
                assert goal.evaluate(row) is value
                assert _paired(form, state, rows, columns, pairs) is value


def _paired(form: Formula, state: dict[Atom, bool], rows: int, columns: int, pairs: str) -> bool:
    assert isinstance(form, ForPairs)
    true = {(i, j) for i in range(rows) for j in range(columns) if state[Atom("nextto", (f"a_{i}", f"b_{j}"))]}
    count = min(rows, columns) if form.number is None else form.number
    if pairs == "matching":
        return can_pair_off(true, rows, columns, count)
    return len({i for i, _ in true}) >= count and len({j for _, j in true}) >= count


def test_deep_formulas_are_compiled_and_evaluated() -> None:
    atoms = tuple(Atom("open", (f"cup_{number}",)) for number in range(3))
    formula: Formula = atoms[0]
    for level in range(10_000):
        formula = (Not, lambda inner: And((atoms[1], inner)), lambda inner: Or((inner, atoms[2])))[level % 3](formula)
    goal = compile_goal(formula)
    every = list(product((False, True), repeat=3))
    expected = [bddl.evaluate(formula, dict(zip(goal.atoms, values, strict=True))) for values in every]
    assert [goal.evaluate(values) for values in every] == expected
    assert goal.evaluate_batch(every).all(axis=1).tolist() == expected


def test_large_matchings_are_decided() -> None:
    """Forty cups in forty boxes: a cycle of places has a matching, and none once a cup loses both of its places."""
    size = 40
    scene = {f"cup_{i}": "cup" for i in range(size)} | {f"box_{i}": "box" for i in range(size)}
    goal = compile_goal(ForPairs("x", "cup", "y", "box", Atom("inside", ("x", "y"))), scene)
    near = {(i, (i + step) % size) for i in range(size) for step in (0, 1)}
    crowded = {(i, j) for i in range(size) for j in range(size - 1)} | {(0, size - 1), (1, size - 1)}
    three_for_two = crowded - {(i, j) for i in (5, 6, 7) for j in range(2, size)}
    table = [
        [(i, j) in cells for i in range(size) for j in range(size)]
        for cells in (near, crowded, three_for_two, near - {(9, 9), (9, 10)})
    ]
    expected = [True, True, False, False]
    assert [goal.evaluate(row) for row in table] == expected
    assert goal.evaluate_batch(table)[:, 0].tolist() == expected


def test_a_state_can_be_given_in_any_form() -> None:
    formula = bddl.parse_formula("(and (open a) (not (open b)) (or (open c) (ontop a b)))")
    goal = compile_goal(formula)
    assert [str(atom) for atom in goal.atoms] == ["(open a)", "(open b)", "(open c)", "(ontop a b)"]
    true = {Atom("open", ("a",)), Atom("ontop", ("a", "b")), Atom("open", ("elsewhere",))}
    forms: list[TotalState] = [
        0b1001,
        true,
        {("open", "a"), ("ontop", "a", "b"), ("ontop", "b", "a")},
        frozenset(true),
        dict.fromkeys(true).keys(),
        dict.fromkeys(true, True) | {Atom("open", ("b",)): False},
        [True, False, False, True],
        np.array([True, False, False, True]),
    ]
    assert [goal.pack(state) for state in forms] == [0b1001] * 8
    assert all(goal.evaluate(state) for state in forms)
    assert goal.evaluate_conditions(goal.pack([True, True, False, False])) == (True, False, False)


@pytest.mark.parametrize(
    ("state", "got"),
    [
        (-1, "a number that is negative"),
        (0b1001, "a number that is of 4 bits, where a packed state has 3,"),
        (True, "a bool"),
        (np.int64(3), "a int64"),
        ([0.5, True, False], "a list with values other than true and false"),
        ([2, 1, 0], "a list with values other than true and false"),
        ({Atom("open", ("a",)): None}, "a list with values other than true and false"),
        ({"(open a)"}, "a collection of str, such as '(open a)',"),
        ({"open": True}, "a collection of str, such as 'open',"),
        (np.array([0.5, 0, 1]), "a ndarray with values other than true and false"),
    ],
)
def test_what_is_no_state_is_refused_by_every_method(state: object, got: str) -> None:
    goal = compile_goal(bddl.parse_formula("(or (open a) (and (open b) (not (open c))))"))
    for method in (goal.pack, goal.evaluate, goal.evaluate_conditions):
        with pytest.raises(WrongState) as caught:
            method(state)  # type: ignore[arg-type]
        assert caught.value.got == got


def test_booleans_of_numpy_and_whole_numbers_are_values() -> None:
    goal = compile_goal(bddl.parse_formula("(or (open a) (and (open b) (not (open c))))"))
    a, b, c = goal.atoms
    forms: list[Any] = [
        [np.False_, np.True_, np.False_],
        [0, 1, 0],
        np.array([0, 1, 0]),
        np.array([0.0, 1.0, 0.0]),
        {a: np.False_, b: 1},
        {("open", "b"): True, ("open", "c"): False},
    ]
    assert [goal.pack(form) for form in forms] == [0b010] * len(forms)
    known = {a: np.False_, b: np.True_, c: np.False_}
    assert bddl.evaluate(goal.conditions[0], known) is True


def test_a_batch_of_probabilities_is_no_batch_of_states() -> None:
    goal = compile_goal(bddl.parse_formula("(open a)"))
    assert goal.evaluate_batch([[1], [0]]).tolist() == [[True], [False]]
    for wrong in ([[0.5]], [[2]], [["yes"]], [[None]]):
        with pytest.raises(WrongState, match="an array with values other than true and false"):
            goal.evaluate_batch(wrong)  # type: ignore[arg-type]


def test_a_conjunction_inside_is_one_condition() -> None:
    goal = compile_goal(bddl.parse_formula("(and (open a) (and (open b) (not (open c))))"))
    assert [str(part) for part in goal.conditions] == ["(open a)", "(and (open b) (not (open c)))"]
    assert goal.evaluate_conditions([False, True, False]) == (False, True)


def test_a_condition_that_stands_there_twice_has_two_values() -> None:
    goal = compile_goal(And((Atom("open", ("a",)), Atom("open", ("a",)), Not(Atom("open", ("a",))))))
    assert goal.evaluate_conditions([True]) == (True, True, False)
    assert goal.evaluate_batch([[True], [False]]).tolist() == [[True, True, False], [False, False, True]]
    assert not goal.evaluate([True])


def test_the_empty_conjunction_holds() -> None:
    goal = compile_goal(And(()))
    assert goal.evaluate([]) and goal.evaluate_conditions([]) == ()
    assert goal.evaluate_batch(np.zeros((3, 0), dtype=bool)).shape == (3, 0)


@pytest.mark.parametrize(
    ("state", "got"),
    [([True], "1 values"), ("open", "a str"), (7.5, "a float"), ([True, False, True], "3 values")],
)
def test_a_state_that_does_not_fit_is_named(state: object, got: str) -> None:
    goal = compile_goal(bddl.parse_formula("(and (open a) (open b))"))
    with pytest.raises(WrongState) as caught:
        goal.evaluate(state)  # type: ignore[arg-type]
    assert str(caught.value) == (
        f"{got} is no state of this goal: give a value for each of its 2 atoms in the order of `goal.atoms`, a set of "
        "the atoms that are true, or a mapping from atoms to values."
    )


def test_a_batch_of_another_shape_is_named() -> None:
    goal = compile_goal(bddl.parse_formula("(and (open a) (open b))"))
    with pytest.raises(WrongState, match=r"an array of shape \(2, 3\) is no state of this goal"):
        goal.evaluate_batch(np.zeros((2, 3), dtype=bool))


def test_compiling_and_evaluating_one_state_loads_no_numpy() -> None:
    code = (
        "import bddl, sys\n"
        "from benchmarks.compiled_goals import compile_goal\n"
        "goal = compile_goal(bddl.Atom('open', ('a',)))\n"
        "assert goal.evaluate([True]) and 'numpy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=600)
