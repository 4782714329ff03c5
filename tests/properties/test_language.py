"""Properties 22 to 24 at length: printing, damaged texts, three-valued truth; tests/bddl has them in short."""

from __future__ import annotations

import re
from itertools import product

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import bddl
from tests.bddl import strategies, universe

_TOKEN = re.compile(r"[()]|[^\s()]+")
_subjects = st.one_of(strategies.formulas(), strategies.problems())


@pytest.mark.slow
@given(_subjects)
@settings(max_examples=2000, deadline=None)
def test_p22_at_length(subject: bddl.Formula | bddl.Problem) -> None:
    text = bddl.format(subject)
    again = bddl.parse(text) if isinstance(subject, bddl.Problem) else bddl.parse_formula(text)
    assert again == subject and bddl.format(again) == text


@pytest.mark.slow
@given(_subjects, st.data())
@settings(max_examples=2000, deadline=None)
def test_p23_at_length(subject: bddl.Formula | bddl.Problem, data: st.DataObject) -> None:
    text = bddl.format(subject).rstrip()
    end = data.draw(st.integers(0, len(text) - 1))
    assert bddl.check(text[:end])
    token = data.draw(st.sampled_from(list(_TOKEN.finditer(text))))
    damaged = text[: token.start()] + text[token.end() :]
    # A name less may leave a legal text; a parenthesis less never does.
    assert bddl.check(damaged) or token.group() not in "()"


@pytest.mark.slow
@given(universe.formulas, st.data(), st.sampled_from(("matching", "reference")))
@settings(max_examples=2000, deadline=None)
def test_p24_at_length(formula: bddl.Formula, data: st.DataObject, pairs: bddl.PairSemantics) -> None:
    atoms = bddl.ground(formula, universe.OBJECTS, pairs).atoms
    unknown = data.draw(st.lists(st.sampled_from(atoms), unique=True, max_size=7)) if atoms else []
    known = {atom: data.draw(st.booleans()) for atom in atoms if atom not in unknown}
    value = bddl.evaluate(formula, known, universe.OBJECTS, pairs=pairs)
    assume(value is not None)
    for values in product((False, True), repeat=len(unknown)):
        state = known | dict(zip(unknown, values, strict=True))
        assert universe.holds(formula, state.__getitem__, pairs) is value
