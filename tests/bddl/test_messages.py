"""Every message, byte for byte; run with UPDATE_GOLDEN=1 to write the golden file anew, and read the difference."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

import bddl

GOLDEN = Path(__file__).parents[1] / "golden" / "bddl_messages.txt"
OBJECTS = {"glass_0": "glass", "table_0": "table", "refrigerator_0": "refrigerator", "apple_0": "apple"}

# Formulas that are wrong, grouped by what is wrong with them.
FORMULAS = (
    # The paper's own slip (table of initial and goal states), and other parentheses.
    "(not (open refrigerator_0)",
    "(and (open refrigerator_0 (ontop glass_0 table_0))",
    "(and (not (open refrigerator_0) (ontop glass_0 table_0))",
    "(and\n  (open refrigerator_0)\n  (not (ontop glass_0 table_0)\n)",
    "(forall (?x - glass (ontop ?x table_0))",
    "(open refrigerator_0))",
    "(and (open refrigerator_0)) (ontop glass_0 table_0))",
    "(not (open refrigerator_0)) (ontop glass_0 table_0))",
    "Sure :) here it is: (not(open refrigerator_0)",
    ")(",
    "((open refrigerator_0))",
    "()",
    # Text that is no formula, or more than one.
    "",
    "; only a remark",
    "open refrigerator_0",
    "Please open the refrigerator and then put the glass into it.",
    "(open refrigerator_0) (ontop glass_0 table_0)",
    "The goal is (open refrigerator_0) as asked.",
    "```bddl\n(open refrigerator_0)\n```",
    "(define (problem p) (:domain d) (:goal (open refrigerator_0)))",
    # Words.
    "(on glass_0 table_0)",
    "(in glass_0 refrigerator_0)",
    "(closed refrigerator_0)",
    "(held glass_0)",
    "(insde glass_0 refrigerator_0)",
    "(levitating glass_0)",
    "(annd (open refrigerator_0) (on glass_0 table_0))",
    "(implies (open refrigerator_0) (inside glass_0 gripper))",
    "(forn (?x - glass) (ontop ?x table_0))",
    "(forpairs (?x - glass) (ontop ?x table_0))",
    "not(ontop(glass_0, table_0))",
    "(and open(refrigerator_0) (ontop glass_0 table_0))",
    "(not open refrigerator_0)",
    "(and refrigerator_0)",
    "(inside glass_0, refrigerator_0)",
    # Numbers of things.
    "(ontop glass_0)",
    "(open refrigerator_0 table_0)",
    "(open)",
    "(not)",
    "(not (open refrigerator_0) (ontop glass_0 table_0))",
    "(imply (open refrigerator_0))",
    "(open (ontop glass_0 table_0))",
    # Quantifiers and variables.
    "(forall (?x) (ontop ?x table_0))",
    "(exists (?x ?y - glass) (ontop ?x ?y))",
    "(forall (open refrigerator_0))",
    "(exists (?x - glass) (ontop ?y table_0))",
    "(open ?refrigerator_0)",
    "(exists (?x - glas) (ontop ?x table_0))",
    # Objects.
    "(inside glass_0 fridge_0)",
    "(ontop cup_0 tabel_0)",
    "(ontop glass_1 Table_0)",
    "(open zebra)",
    # Several at once.
    "(and (on glass_0 table_0) (open refrigerator_0 table_0) (inside cup_0 gripper) (not (closed refrigerator_0))",
)

PROBLEMS = (
    "(open refrigerator_0)",
    "(define (problem p) (:domain d))",
    "(define (:goal (open refrigerator_0)))",
    "(define (problem p) (:domian d) (:goal (open refrigerator_0)))",
    "(define (problem p) (:domain d) (:goal (open refrigerator_0)) (:goal (open refrigerator_0)))",
    "(define (problem p) (:domain d) (:goal (open refrigerator_0) (not (open refrigerator_0))))",
    "(define (problem p) (:domain d) (:goal))",
    "(define (problem p q) (:domain) junk (:goal (open refrigerator_0)))",
    "(define (problem p) (:domain d) (:objects glass_0 - glass - (x) -) (:goal (open refrigerator_0)))",
    "(define (problem p) (:domain d) (:objects glass_0 glass_0 - glass cup_7 - cup) (:goal (open glass_0)))",
    "(define (problem p) (:domain d) (:init (and (open refrigerator_0)) open) (:goal (open refrigerator_0)))",
    "(define (problem p (:domain d)\n  (:init (ontop glass_0 table_0)\n  (:goal (open refrigerator_0)))",
)


def _shown(text: str, read: Callable[..., object]) -> str:
    with pytest.raises(bddl.BDDLError) as raised:
        read(text, objects=OBJECTS)
    return f"===== {text}\n{raised.value}\n"


def test_messages_are_those_of_the_golden_file() -> None:
    shown = "\n".join(
        [_shown(text, bddl.parse_formula) for text in FORMULAS] + [_shown(text, bddl.parse) for text in PROBLEMS]
    )
    if os.environ.get("UPDATE_GOLDEN"):
        GOLDEN.parent.mkdir(exist_ok=True)
        GOLDEN.write_text(shown, encoding="utf-8")
    assert shown == GOLDEN.read_text(encoding="utf-8")


@pytest.mark.parametrize("text", [text for text in FORMULAS if "define" not in text])
def test_check_and_parse_formula_say_the_same(text: str) -> None:
    with pytest.raises(bddl.BDDLError) as raised:
        bddl.parse_formula(text, objects=OBJECTS)
    assert raised.value.diagnostics == bddl.check(text, objects=OBJECTS)


def test_the_paper_s_missing_parenthesis() -> None:
    with pytest.raises(bddl.BDDLError) as raised:
        bddl.parse_formula("(not (open refrigerator_0)")
    (found,) = raised.value.diagnostics
    assert (found.code, found.line, found.column) == ("missing-parenthesis", 1, 27)
    assert "line 1, column 1 is never closed" in found.message
    assert found.expected == (")",)
    assert found.hint == "write (not (open refrigerator_0))"
    text, marks = found.excerpt.split("\n")
    assert marks.index("^") == text.index("_0)") + 3
    assert marks.index("-") == text.index("(not")


def test_independent_mistakes_are_all_reported_in_order() -> None:
    found = bddl.check("(or (on a b) (not (open a b)) (imply (nearby a)))")
    assert [(item.code, item.column) for item in found] == [
        ("unknown-predicate", 6),
        ("wrong-arity", 27),
        ("wrong-arity", 32),
        ("unknown-predicate", 39),
    ]


def test_the_diagnostics_of_a_tree_refer_to_its_print() -> None:
    formula = bddl.Not(bddl.Atom("on", ("glass_0", "table_0")))
    (found,) = bddl.check(formula)
    assert (found.code, found.column, found.length) == ("unknown-predicate", 7, 2)
    assert bddl.format(formula) in found.excerpt


def test_objects_are_checked_only_when_they_are_given() -> None:
    assert bddl.check("(open zebra)") == ()
    assert [found.code for found in bddl.check("(open zebra)", objects={})] == ["unknown-object"]
    assert bddl.check("(and (inside glass_0 gripper) (inroom robot kitchen))", objects=OBJECTS) == ()


def test_an_object_of_the_scene_may_have_any_printable_name() -> None:
    odd = {"glass#1": "glass", "Küche/2": "table"}
    formula = bddl.parse_formula("(ontop glass#1 Küche/2)", objects=odd)
    assert formula == bddl.Atom("ontop", ("glass#1", "Küche/2"))


def test_an_object_named_like_punctuation_cannot_be_written() -> None:
    objects = {"-": "glass", ":goal": "glass", "": "glass", "?x": "glass", "and": "glass"}
    for name in ("-", ":goal", "?", "??x"):
        assert [found.code for found in bddl.check(f"(open {name})", objects=objects)] == ["bad-name"]
    assert bddl.check("(open and)", objects=objects) == ()


def test_a_long_line_is_cut_around_the_place() -> None:
    text = "(and " + "(open refrigerator_0) " * 40 + "(opne refrigerator_0)" + " (open refrigerator_0)" * 40 + ")"
    (found,) = bddl.check(text)
    line, marks = found.excerpt.split("\n")
    assert len(line) < 120
    assert line[marks.index("^") :].startswith("opne")
