"""Ground formulas as SMT-LIB text agree with every valuation, and depth does not matter."""

from __future__ import annotations

import sys
from itertools import permutations, product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bddl
from bddl.grounding import All, AtLeast, Exactly, Ground, GroundNode, Leaf, Matching, Negation, Some
from bddl.smt import Script, Solver, solve

ATOMS = tuple(bddl.Atom("open", (f"box_{index}",)) for index in range(5))


def smt_text(ground: Ground) -> str:
    """Text that is satisfiable exactly when the formula is; its atoms are a0, a1 and so on."""
    names = [f"a{index}" for index in range(len(ground.atoms))]
    script = Script()
    script.declare(*names)
    script.require(script.term(ground.root, names.__getitem__))
    return script.text()


def truth(node: GroundNode, values: tuple[bool, ...]) -> bool:
    """Whether a node is true, straight from the meaning of its class."""
    match node:
        case Leaf(atom=index):
            return values[index]
        case Negation(body=body):
            return not truth(body, values)
        case All(parts=parts):
            return all(truth(part, values) for part in parts)
        case Some(parts=parts):
            return any(truth(part, values) for part in parts)
        case Exactly(count=count, parts=parts):
            return sum(truth(part, values) for part in parts) == count
        case Matching(count=count, cells=cells):
            return paired(count, [[cell is not None and truth(cell, values) for cell in row] for row in cells])
        case AtLeast(count=count, parts=parts):
            return sum(truth(part, values) for part in parts) >= count


def paired(count: int, table: list[list[bool]]) -> bool:
    """Whether so many true cells of different rows and columns exist, by trying all choices of rows."""
    width = max(map(len, table), default=0)
    return any(
        all(table[row][column] for row, column in zip(rows, columns, strict=True))
        for rows in permutations(range(len(table)), count)
        for columns in permutations(range(width), count)
        if list(rows) == sorted(rows)
    )


leaves = st.builds(Leaf, st.integers(0, len(ATOMS) - 1))


@st.composite
def tables(draw: st.DrawFn, cells: st.SearchStrategy[GroundNode | None]) -> tuple[tuple[GroundNode | None, ...], ...]:
    height, width = draw(st.integers(1, 3)), draw(st.integers(1, 3))
    return tuple(tuple(draw(cells) for _ in range(width)) for _ in range(height))


def larger(nodes: st.SearchStrategy[GroundNode]) -> st.SearchStrategy[GroundNode]:
    parts = st.lists(nodes, max_size=4).map(tuple)
    counts = st.integers(0, 4)
    return st.one_of(
        st.builds(Negation, nodes),
        st.builds(All, parts),
        st.builds(Some, parts),
        st.builds(Exactly, counts, parts),
        st.builds(Matching, counts, tables(st.one_of(st.none(), nodes))),
        st.builds(AtLeast, counts, parts),
    )


formulas = st.recursive(leaves, larger, max_leaves=8)


def check_every_valuation(root: GroundNode) -> None:
    """The text has a model with given atoms exactly when they make the formula true, and likewise its negation."""
    script = Script()
    names = [f"a{index}" for index in range(len(ATOMS))]
    script.declare(*names, "wanted")
    script.require(f"(= wanted {script.term(root, names.__getitem__)})")
    session = Solver(script.text())
    for values in product((False, True), repeat=len(ATOMS)):
        assumed = list(zip(names, values, strict=True))
        expected = truth(root, values)
        for wanted in (False, True):
            answer = session.check([*assumed, ("wanted", wanted)])
            assert answer.status == ("sat" if wanted is expected else "unsat")


@pytest.mark.slow
@given(formulas)
@settings(max_examples=60)
def test_text_agrees_with_every_valuation(root: GroundNode) -> None:
    check_every_valuation(root)


@pytest.mark.slow
@given(formulas)
@settings(max_examples=2000)
def test_text_agrees_with_every_valuation_at_length(root: GroundNode) -> None:
    check_every_valuation(root)


@given(formulas)
@settings(max_examples=100)
def test_a_model_makes_the_formula_true(root: GroundNode) -> None:
    answer = solve(smt_text(Ground(ATOMS, root)))
    models = [values for values in product((False, True), repeat=len(ATOMS)) if truth(root, values)]
    assert (answer.status == "sat") is bool(models)
    if models:
        assert tuple(f"a{index}" in answer.true for index in range(len(ATOMS))) in models


@given(st.lists(st.tuples(st.integers(0, 4), st.booleans()), max_size=5), st.data())
@settings(max_examples=60)
def test_known_atoms_are_folded_away(known: list[tuple[int, bool]], data: st.DataObject) -> None:
    root = data.draw(formulas)
    constants = {index: str(value).lower() for index, value in known}
    script = Script()
    names = [constants.get(index, f"a{index}") for index in range(len(ATOMS))]
    script.declare(*(name for name in names if name.startswith("a")))
    script.require(script.term(root, names.__getitem__))
    expected = any(
        truth(root, values)
        for values in product((False, True), repeat=len(ATOMS))
        if all(values[index] is (text == "true") for index, text in constants.items())
    )
    assert (solve(script.text()).status == "sat") is expected


def chain(kind: str, depth: int) -> GroundNode:
    """A formula as deep as asked, true when the first atom is (an even number of negations)."""
    node: GroundNode = Leaf(0)
    for _ in range(depth):
        if kind == "not":
            node = Negation(node)
        elif kind == "junction":
            node = Some((All((node, Leaf(0))), Leaf(1)))
        else:
            node = Exactly(1, (node, Leaf(1)))
    return node


@pytest.mark.parametrize("kind", ["not", "junction", "exactly"])
def test_ten_thousand_levels_are_decided(kind: str) -> None:
    root = chain(kind, 10_000)
    text = smt_text(Ground(ATOMS[:2], root))
    assert solve(f"{text}\n(assert (not a1))\n(assert a0)").status == "sat"
    assert solve(f"{text}\n(assert (not a1))\n(assert (not a0))").status == "unsat"


def test_shared_parts_are_written_once() -> None:
    """A formula that doubles at every level, sharing its halves, stays as short as it has parts."""
    node: GroundNode = Leaf(0)
    for _ in range(40):
        node = Some((All((node, Leaf(1))), Negation(node)))
    text = smt_text(Ground(ATOMS[:2], node))
    assert len(text) < 20_000
    assert solve(text).status == "sat"


def test_an_answer_says_which_assumptions_clash() -> None:
    session = Solver("(declare-const a Bool) (declare-const b Bool) (declare-const c Bool) (assert (or a b))")
    answer = session.check([("a", False), ("b", False), ("c", True)])
    assert answer.status == "unsat"
    assert set(answer.core) == {("a", False), ("b", False)}
    assert session.check([("a", False), ("c", True)]).true == {"b", "c"}


def test_time_is_limited() -> None:
    """Twelve pigeons do not fit into eleven holes, which takes resolution longer than a moment to see."""
    holes = 11
    names = [[f"p{pigeon}h{hole}" for hole in range(holes)] for pigeon in range(holes + 1)]
    lines = [f"(declare-const {name} Bool)" for row in names for name in row]
    lines += [f"(assert (or {' '.join(row)}))" for row in names]
    for hole in range(holes):
        for first in range(holes + 1):
            lines += [f"(assert (or (not {names[first][hole]}) (not {names[k][hole]})))" for k in range(first)]
    answer = solve("\n".join(lines), timeout_ms=50)
    assert answer.status == "unknown"
    assert "timeout" in answer.reason


@pytest.mark.parametrize("text", ["(assert nothing)", "(assert", "(declare-const a Int) (assert (> a b))"])
def test_a_text_that_is_none_is_misuse(text: str) -> None:
    with pytest.raises(ValueError, match="z3 cannot read the text"):
        solve(text)


def test_a_missing_solver_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "z3", None)
    with pytest.raises(bddl.SolverMissing, match="pip install z3-solver"):
        solve("(declare-const a Bool)")


def test_equal_questions_have_equal_answers() -> None:
    text = "(declare-const a Bool) (declare-const b Bool) (declare-const c Bool) (assert (or a b c))"
    assert len({solve(text) for _ in range(3)}) == 1
