"""The tree refuses what could not be printed, and its parts are what they say."""

from __future__ import annotations

import pytest

import bddl


@pytest.mark.parametrize("name", ["", "a b", "(", "a)", ";a", "?x", ":goal", "-", "a\n", "a\u00a0b", 7])
def test_a_name_that_text_cannot_carry_is_refused(name: str) -> None:
    with pytest.raises(bddl.IllegalName, match="cannot be the name of an object"):
        bddl.Atom("open", (name,))
    with pytest.raises(bddl.IllegalName):
        bddl.ForAll("x", name, bddl.Atom("open", ("x",)))


@pytest.mark.parametrize("predicate", ["and", "forall", "define", "Open"])
def test_a_predicate_is_lower_case_and_no_word_of_the_language(predicate: str) -> None:
    with pytest.raises(bddl.IllegalName, match="predicate"):
        bddl.Atom(predicate, ("a",))


def test_lists_and_strings_in_place_of_tuples_are_refused() -> None:
    with pytest.raises(TypeError, match="tuple of names"):
        bddl.Atom("open", "refrigerator_0")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="tuple of formulas"):
        bddl.And([bddl.Atom("open", ("a",))])  # type: ignore[arg-type]


def test_formulas_of_different_shape_differ() -> None:
    a, b = bddl.Atom("open", ("a",)), bddl.Atom("open", ("b",))
    different = [
        a,
        b,
        bddl.Not(a),
        bddl.Not(b),
        bddl.And(()),
        bddl.Or(()),
        bddl.And((a, b)),
        bddl.And((b, a)),
        bddl.Or((a, b)),
        bddl.And((bddl.And((a, b)),)),
        bddl.Imply(a, b),
        bddl.ForAll("x", "glass", a),
        bddl.ForAll("y", "glass", a),
        bddl.ForAll("x", "cup", a),
        bddl.Exists("x", "glass", a),
    ]
    assert len(set(different)) == len(different)
    assert a != "(open a)"


def test_walk_goes_parents_first_from_left_to_right() -> None:
    formula = bddl.parse_formula("(and (not (open a)) (imply (open b) (open c)))")
    assert [type(node).__name__ for node in formula.walk()] == ["And", "Not", "Atom", "Imply", "Atom", "Atom"]


def test_conjuncts_open_nested_conjunctions_only() -> None:
    formula = bddl.parse_formula("(and (open a) (and) (and (or (open b) (open c)) (not (and (open d)))))")
    assert [str(part) for part in bddl.conjuncts(formula)] == [
        "(open a)",
        "(or (open b) (open c))",
        "(not (and (open d)))",
    ]


def test_literals_are_read_off_a_conjunction() -> None:
    found = bddl.literals(bddl.parse_formula("(and (open a) (not (open b)) (not (not (open c))))"))
    assert found is not None
    assert [(str(literal.atom), literal.value) for literal in found] == [
        ("(open a)", True),
        ("(open b)", False),
        ("(open c)", True),
    ]
    assert [str(literal) for literal in found] == ["(open a)", "(not (open b))", "(open c)"]


@pytest.mark.parametrize(
    "text", ["(or (open a) (open b))", "(not (and (open a)))", "(forall (?x - cup) (open ?x))", "(imply (and) (and))"]
)
def test_other_formulas_have_no_literals(text: str) -> None:
    assert bddl.literals(bddl.parse_formula(text)) is None


def test_atoms_are_collected_once() -> None:
    formula = bddl.parse_formula("(and (open a) (not (open a)) (exists (?x - cup) (ontop ?x a)))")
    assert bddl.atoms(formula) == {bddl.Atom("open", ("a",)), bddl.Atom("ontop", ("x", "a"))}
