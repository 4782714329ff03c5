"""What a hint says to write is there as data, too, and can be taken as it is."""

from __future__ import annotations

import pytest

import bddl

SCENE = {"glass_0": "glass", "table_0": "table"}


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("(and (on glass_0 table_0) (open table_0))", "(and (ontop glass_0 table_0) (open table_0))"),
        ("(or (open glass_0)\n    (closed table_0))", "(or (open glass_0)\n    (not (open table_0)))"),
        ("(not (open table_0)", "(not (open table_0))"),
        ("(not (open table_0)))", "(not (open table_0))"),
        ("open(table_0)", "(open table_0)"),
        ("open table_0", "(open table_0)"),
        ("(not open table_0)", "(not (open table_0))"),
        ("(and ((open table_0)))", "(and (open table_0))"),
        ("(open table_0) (open glass_0)", "(and (open table_0) (open glass_0))"),
        ("(not (open table_0) (open glass_0))", "(not (and (open table_0) (open glass_0)))"),
        ("Sure: (open table_0)", "(open table_0)"),
    ],
)
def test_a_replacement_applied_is_what_was_meant(text: str, meant: str) -> None:
    found = bddl.check(text, objects=SCENE)[0]
    assert found.replacement is not None
    assert found.replacement.text in found.hint
    assert found.replacement.applied(text) == meant
    assert bddl.check(meant, objects=SCENE) == ()


@pytest.mark.parametrize("text", ["(open cup_0)", "(ontop glass_0)", "(forall (open ?x))", "(xor (open table_0))", ""])
def test_where_only_a_shape_or_a_list_of_names_is_offered_there_is_none(text: str) -> None:
    found = bddl.check(text, objects=SCENE)[0]
    assert found.hint and found.replacement is None
