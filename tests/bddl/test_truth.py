"""Three-valued truth against a two-valued oracle that was written apart."""

from __future__ import annotations

import itertools
from collections import UserDict
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from bddl import And, Atom, Exists, ForAll, Formula, Imply, Literal, Not, Or
from tests.bddl.strategies import CATEGORIES, VARIABLES

OBJECTS = {"glass_0": "glass", "table_0": "table"}
GROUND = tuple(Atom("open", (name,)) for name in ("glass_0", "table_0", "x"))


def _holds(formula: Formula, state: dict[Atom, bool], bound: dict[str, str] | None = None) -> bool:
    """Classical truth in a total state, by the definition: `bound` says what each variable in scope stands for."""
    bound = bound or {}
    match formula:
        case Atom(predicate=predicate, args=args):
            return state[Atom(predicate, tuple(bound.get(name, name) for name in args))]
        case Not(body=body):
            return not _holds(body, state, bound)
        case And(parts=parts):
            return all([_holds(part, state, bound) for part in parts])
        case Or(parts=parts):
            return any([_holds(part, state, bound) for part in parts])
        case Imply(left=left, right=right):
            return not _holds(left, state, bound) or _holds(right, state, bound)
        case ForAll() | Exists():
            names = [n for n, c in OBJECTS.items() if formula.category in (c, "object")]
            values = [_holds(formula.body, state, bound | {formula.variable: name}) for name in names]
            return all(values) if isinstance(formula, ForAll) else any(values)


def _larger(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    parts = st.lists(inner, max_size=3).map(tuple)
    binder = st.sampled_from(VARIABLES), st.sampled_from(CATEGORIES)
    return st.one_of(
        st.builds(Not, inner),
        st.builds(And, parts),
        st.builds(Or, parts),
        st.builds(Imply, inner, inner),
        st.builds(ForAll, *binder, inner),
        st.builds(Exists, *binder, inner),
    )


formulas = st.recursive(st.sampled_from(GROUND), _larger, max_leaves=8)
totals = st.tuples(*[st.booleans() for _ in GROUND]).map(lambda values: dict(zip(GROUND, values, strict=True)))
partials = st.dictionaries(st.sampled_from(GROUND), st.booleans())


@given(formulas, totals)
def test_in_a_total_state_truth_is_classical(formula: Formula, state: dict[Atom, bool]) -> None:
    assert bddl.evaluate(formula, state, OBJECTS) is _holds(formula, state)


@given(formulas, partials)
def test_a_decided_value_holds_in_every_completion(formula: Formula, state: dict[Atom, bool]) -> None:
    value = bddl.evaluate(formula, state, OBJECTS)
    if value is not None:
        for values in itertools.product((False, True), repeat=len(GROUND)):
            completion = dict(zip(GROUND, values, strict=True)) | state
            assert _holds(formula, completion) is value


@given(formulas, partials)
def test_a_function_and_a_mapping_say_the_same(formula: Formula, state: dict[Atom, bool]) -> None:
    assert bddl.evaluate(formula, state.get, objects=OBJECTS) is bddl.evaluate(formula, state, objects=OBJECTS)


@pytest.mark.parametrize("left", [True, False, None])
@pytest.mark.parametrize("right", [True, False, None])
def test_kleene_tables(left: bool | None, right: bool | None) -> None:
    first, second = Atom("open", ("a",)), Atom("open", ("b",))
    state = {atom: value for atom, value in ((first, left), (second, right)) if value is not None}
    rank = {False: 0, None: 1, True: 2}
    lower, upper = sorted((left, right), key=rank.__getitem__)
    negated = None if left is None else not left
    assert bddl.evaluate(And((first, second)), state) is lower
    assert bddl.evaluate(Or((first, second)), state) is upper
    assert bddl.evaluate(Not(first), state) is negated
    assert bddl.evaluate(Imply(first, second), state) is max(negated, right, key=rank.__getitem__)


def test_evaluation_stops_where_the_value_is_decided() -> None:
    asked: list[Atom] = []

    def lookup(atom: Atom) -> bool:
        asked.append(atom)
        return False

    assert bddl.evaluate(bddl.parse_formula("(and (open a) (open b))"), lookup) is False
    assert asked == [Atom("open", ("a",))]


def test_a_quantifier_without_objects_is_misuse_that_is_named() -> None:
    with pytest.raises(bddl.ObjectsRequired, match=r"\(\?x - glass\).*objects="):
        bddl.evaluate(bddl.parse_formula("(exists (?x - glass) (open ?x))"), {})


def test_quantifiers_over_no_objects_are_vacuous() -> None:
    assert bddl.evaluate(bddl.parse_formula("(forall (?x - cup) (open ?x))"), {}, OBJECTS) is True
    assert bddl.evaluate(bddl.parse_formula("(exists (?x - cup) (open ?x))"), {}, OBJECTS) is False


def test_the_inner_of_two_equal_variables_counts() -> None:
    formula = bddl.parse_formula("(exists (?x - glass) (exists (?x - table) (open ?x)))")
    assert bddl.evaluate(formula, {Atom("open", ("table_0",)): True}, OBJECTS) is True
    assert bddl.evaluate(formula, {Atom("open", ("table_0",)): False}, OBJECTS) is False


OPEN, HOT = Atom("open", ("box_0",)), Atom("hot", ("cup_0",))


@pytest.mark.parametrize("state", [{OPEN: True, ("hot", "cup_0"): True}, {("hot", "cup_0"): True, OPEN: True}])
@pytest.mark.parametrize("mapping", [dict, UserDict])
def test_a_state_may_name_some_atoms_by_tuples(state: Any, mapping: Any) -> None:
    goal = And((OPEN, HOT))
    assert bddl.evaluate(goal, mapping(state)) is True
    assert [*bddl.options(goal, state=mapping(state))] == [(Literal(OPEN, True), Literal(HOT, True))]
    assert bddl.evaluate(And((OPEN, HOT, Atom("open", ("lid_0",)))), mapping(state)) is None


def test_two_values_of_one_atom_are_refused() -> None:
    state: Any = {OPEN: True, ("open", "box_0"): False}
    with pytest.raises(TypeError, match="once as an atom and once as a tuple"):
        bddl.evaluate(And((HOT, OPEN)), state)
    state = {OPEN: True, 3: False}
    with pytest.raises(TypeError, match="not 3"):
        bddl.evaluate(And((HOT, OPEN)), state)
