"""The analyser against definitions written out: all states tried, all variables renamed, all quantifiers spelt out."""

from __future__ import annotations

from itertools import product

from hypothesis import assume, given, settings
from hypothesis import strategies as st

import bddl
from bddl.ast import Quantified
from bddl.diagnostics import Reporter
from bddl.grounding import count_ground_parts
from bddl.lint import MOST_ATOMS
from bddl.lint_quantifiers import Bound, find_idle_variables, find_reflexive_atoms
from tests.bddl.universe import CATEGORIES, OBJECTS, formulas, holds

# The names x and y, where nothing binds them, and the robot's own parts are objects of no category that is used.
EVERYTHING = {**OBJECTS, "x": "letter", "y": "letter"}


def _problem(formula: bddl.Formula) -> str:
    declared = " ".join(f"{name} - {category}" for name, category in {**EVERYTHING, "absent_0": "absent"}.items())
    return f"(define (problem p) (:domain d) (:objects {declared}) (:goal {bddl.format(formula)}))"


@settings(max_examples=150)
@given(formulas)
def test_a_goal_is_called_impossible_when_no_state_satisfies_it(formula: bddl.Formula) -> None:
    """Try every state of the atoms that matter, by the definition of truth that the tests have of their own."""
    objects = {**EVERYTHING, "gripper": "gripper", "robot": "robot", "absent_0": "absent"}
    atoms = bddl.ground(formula, objects).atoms
    assume(len(atoms) <= 8 and count_ground_parts(formula, objects, MOST_ATOMS) <= MOST_ATOMS)
    found = [item.code for item in bddl.analyse(_problem(formula))]
    satisfied = any(
        bddl.evaluate(formula, dict(zip(atoms, values, strict=True)), objects)
        for values in product((False, True), repeat=len(atoms))
    )
    assert ("impossible-goal" in found) is (not satisfied)


@settings(max_examples=60)
@given(formulas)
def test_truth_in_that_search_is_truth_by_definition(formula: bddl.Formula) -> None:
    atoms = bddl.ground(formula, OBJECTS).atoms
    assume(len(atoms) <= 6)
    for values in product((False, True), repeat=len(atoms)):
        state = dict(zip(atoms, values, strict=True))
        assert bddl.evaluate(formula, state, OBJECTS) == holds(formula, state.__getitem__, "matching")


@given(formulas)
def test_a_variable_is_unused_or_hidden_when_renaming_it_leaves_the_body_alone(formula: bddl.Formula) -> None:
    """A binder is idle when a name that stands nowhere else can take its place and nothing else changes."""
    text = bddl.format(formula)
    parsed = bddl.parse_formula(text)
    reporter = Reporter(text)
    find_idle_variables(parsed, {}, reporter)
    reported = {(item.line, item.column) for item in reporter.diagnostics if item.code == "unused-variable"}
    hidden = {(item.line, item.column) for item in reporter.diagnostics if item.code == "shadowed-variable"}
    for node in parsed.walk():
        if not isinstance(node, Quantified):
            continue
        for position, binder in enumerate(node.binders):
            span = Bound(node, position).span
            assert span is not None and text[span.offset : span.offset + span.length] == f"?{binder.variable}"
            others = [other.variable for other in node.binders[position + 1 :]]
            used = binder.variable not in others and _free_in(node.operands[0], binder.variable)
            place = (span.line, span.column)
            if place in reported:
                assert not used
            elif not used:
                # Then it is hidden by a variable further in, which is reported instead.
                assert hidden


def _free_in(formula: bddl.Formula, name: str) -> bool:
    """Whether a name occurs outside every quantifier that binds it; by recursion, for these small formulas."""
    if isinstance(formula, bddl.Atom):
        return name in formula.args
    if isinstance(formula, Quantified) and name in [binder.variable for binder in formula.binders]:
        return False
    return any(_free_in(operand, name) for operand in formula.operands)


@given(formulas)
def test_an_atom_is_called_reflexive_when_spelling_out_makes_it_so(formula: bddl.Formula) -> None:
    objects = {**EVERYTHING, **{f"{category}_9": category for category in CATEGORIES if category != "object"}}
    assume(count_ground_parts(formula, objects, 5_000) < 5_000)
    text = bddl.format(formula)
    reporter = Reporter(text)
    find_reflexive_atoms(bddl.parse_formula(text), objects, reporter)
    spelt = bddl.ground(formula, objects).atoms
    assert bool(reporter.diagnostics) is any(len(set(atom.args)) < len(atom.args) for atom in spelt)


@given(st.text(max_size=60), st.sampled_from(tuple(bddl.PROFILES)))
def test_no_text_upsets_the_analyser(text: str, profile: str) -> None:
    for found in bddl.analyse(text, profile):
        assert found.code in bddl.CODES and found.line >= 1 and found.column >= 1
