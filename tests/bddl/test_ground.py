"""Grounding: the formula without variables says the same, its atoms are distinct, and nothing is copied in vain."""

from __future__ import annotations

import pytest
from hypothesis import given

import bddl
from bddl import Atom, Exists, ForAll, Formula, ForN, ForNPairs, ForPairs, Imply, Not, Or
from bddl.grounding import All, AtLeast, Exactly, GroundNode, Leaf, Matching, Negation, Some, children
from benchmarks.compiled_goals import compile_goal
from tests.bddl.universe import OBJECTS, Complete, can_pair_off, formulas, holds, pair_semantics, states


def ground_holds(node: GroundNode, values: list[bool]) -> bool:
    """Return the truth of a ground node, by the definition of each kind."""
    match node:
        case Leaf(atom=atom):
            return values[atom]
        case Negation(body=body):
            return not ground_holds(body, values)
        case All(parts=parts):
            return all(ground_holds(part, values) for part in parts)
        case Some(parts=parts):
            return any(ground_holds(part, values) for part in parts)
        case Exactly(count=count, parts=parts):
            return sum(ground_holds(part, values) for part in parts) == count
        case Matching(count=count, cells=cells):
            true = {
                (i, j)
                for i, row in enumerate(cells)
                for j, cell in enumerate(row)
                if cell is not None and ground_holds(cell, values)
            }
            return can_pair_off(true, len(cells), max(map(len, cells), default=0), count)
        case AtLeast(count=count, parts=parts):
            return sum(ground_holds(part, values) for part in parts) >= count


@given(formulas, states, pair_semantics)
def test_the_ground_formula_says_the_same(formula: Formula, state: Complete, pairs: bddl.PairSemantics) -> None:
    spelled_out = bddl.ground(formula, OBJECTS, pairs)
    values = [state(atom) for atom in spelled_out.atoms]
    assert ground_holds(spelled_out.root, values) is holds(formula, state, pairs)


@given(formulas, pair_semantics)
def test_atoms_are_distinct_and_all_occur(formula: Formula, pairs: bddl.PairSemantics) -> None:
    spelled_out = bddl.ground(formula, OBJECTS, pairs)
    found: set[int] = set()
    pending = [spelled_out.root]
    while pending:
        node = pending.pop()
        pending.extend(children(node))
        if isinstance(node, Leaf):
            found.add(node.atom)
    assert found == set(range(len(spelled_out.atoms)))
    assert len(set(spelled_out.atoms)) == len(spelled_out.atoms)


def parts_of(text: str, objects: dict[str, str]) -> tuple[list[str], GroundNode]:
    """Return the atoms, as text, and the root of a formula of the scene profile."""
    spelled_out = bddl.ground(bddl.parse_formula(text), objects)
    return [str(atom) for atom in spelled_out.atoms], spelled_out.root


def test_imply_is_a_disjunction() -> None:
    atoms, root = parts_of("(imply (open a) (open b))", {})
    assert atoms == ["(open a)", "(open b)"]
    assert isinstance(root, Some) and isinstance(root.parts[0], Negation) and isinstance(root.parts[1], Leaf)


def test_pairs_are_rows_and_columns_in_the_order_of_the_scene() -> None:
    open_pair = Atom("nextto", ("x", "y"))
    spelled_out = bddl.ground(ForPairs("x", "cup", "y", "box", open_pair), OBJECTS)
    root = spelled_out.root
    assert isinstance(root, Matching)
    assert root.count == 2
    assert [[spelled_out.atoms[cell.atom].args for cell in row if isinstance(cell, Leaf)] for row in root.cells] == [
        [("cup_0", "box_0"), ("cup_0", "box_1")],
        [("cup_1", "box_0"), ("cup_1", "box_1")],
        [("cup_2", "box_0"), ("cup_2", "box_1")],
    ]


def test_an_object_is_not_paired_with_itself() -> None:
    formula = ForPairs("x", "box", "y", "box", Atom("nextto", ("x", "y")))
    matching = bddl.ground(formula, OBJECTS).root
    assert isinstance(matching, Matching)
    assert matching.count == 2
    assert [[cell is None for cell in row] for row in matching.cells] == [[True, False], [False, True]]
    counted = bddl.ground(formula, OBJECTS, "reference").root
    assert isinstance(counted, All)
    rows, columns = counted.parts
    assert isinstance(rows, AtLeast) and isinstance(columns, AtLeast)
    assert (rows.count, len(rows.parts), columns.count, len(columns.parts)) == (1, 2, 1, 1)


def test_more_pairs_than_there_are_objects_stay_out_of_reach() -> None:
    root = bddl.ground(ForNPairs("x", "cup", "y", "jar", Atom("nextto", ("x", "y")), count=2), OBJECTS).root
    assert isinstance(root, Matching) and root.count == 2


def test_the_inner_of_two_equal_variables_counts() -> None:
    atoms, _ = parts_of("(exists (?x - cup) (and (open ?x) (exists (?x - box) (open ?x)) (nextto ?x ?x)))", OBJECTS)
    assert atoms == [
        *("(open cup_0)", "(open box_0)", "(open box_1)", "(nextto cup_0 cup_0)"),
        *("(open cup_1)", "(nextto cup_1 cup_1)", "(open cup_2)", "(nextto cup_2 cup_2)"),
    ]


def test_a_body_that_does_not_depend_on_the_outer_variable_is_spelled_out_once() -> None:
    inner = ForAll("y", "box", Atom("open", ("y",)))
    root = bddl.ground(Exists("x", "cup", Or((Atom("open", ("x",)), inner))), OBJECTS).root
    assert isinstance(root, Some)
    shared = {id(part.parts[1]) for part in root.parts if isinstance(part, Some)}
    assert len(root.parts) == 3 and len(shared) == 1


def test_deep_formulas_are_ground() -> None:
    formula: Formula = Atom("open", ("x",))
    for level in range(10_000):
        kinds = (Not(formula), ForAll("x", "jar", formula), Imply(formula, Atom("open", ("a",))))
        formula = kinds[level % 3]
    spelled_out = bddl.ground(ForN("x", "cup", formula, count=1), OBJECTS)
    assert isinstance(spelled_out.root, Exactly)


def test_six_nested_quantifiers_over_a_hundred_objects_share_their_bodies() -> None:
    scene = {f"cup_{number}": "cup" for number in range(100)}
    formula: Formula = Atom("open", ("x",))
    for variable in "xyzuvw":
        formula = Exists(variable, "cup", formula)
    assert len(bddl.ground(formula, scene).atoms) == 100


def test_a_wildcard_is_counted_as_one_object_with_a_warning() -> None:
    formula = ForAll("x", "floor.n.01", Atom("covered", ("x", "stain.n.01_1")))
    floors = {"floor.n.01_1": "floor.n.01", "floor.n.01_*": "floor.n.01"}
    with pytest.warns(bddl.CountedWildcard, match=r"`floor\.n\.01_\*` is counted as one object of `floor\.n\.01`"):
        atoms = bddl.ground(formula, floors).atoms
    assert [atom.args[0] for atom in atoms] == ["floor.n.01_1", "floor.n.01_*"]
    for question in (bddl.options, bddl.GoalProgress, compile_goal):
        with pytest.warns(bddl.CountedWildcard):
            question(formula, floors)
    with pytest.warns(bddl.CountedWildcard):
        assert bddl.evaluate(formula, {}, floors) is None


def test_a_wildcard_that_no_quantifier_ranges_over_is_not_warned_of() -> None:
    goal = Exists("x", "cup", Atom("open", ("x",)))
    objects = {"cup_0": "cup", "floor.n.01_*": "floor.n.01"}
    assert len(bddl.ground(goal, objects).atoms) == len(list(bddl.options(goal, objects))) == 1
    assert bddl.evaluate(goal, {}, objects) is None


def test_objects_are_required_where_there_is_a_quantifier() -> None:
    formula = ForAll("x", "cup", Atom("open", ("x",)))
    assert bddl.ground(formula.body, None).atoms == (formula.body,)
    with pytest.raises(bddl.ObjectsRequired, match=r"\(\?x - cup\)"):
        bddl.ground(formula, None)


def test_an_unknown_reading_of_pairs_is_named_with_the_legal_ones() -> None:
    with pytest.raises(bddl.UnknownPairSemantics) as caught:
        bddl.ground(Atom("open", ("a",)), {}, "exact")  # type: ignore[arg-type]
    assert str(caught.value) == "`forpairs` cannot be read as 'exact': pairs is 'matching' or 'reference'."
