"""Printing and parsing are inverse to each other."""

from __future__ import annotations

from hypothesis import given

import bddl
from tests.bddl.strategies import formulas, problems


@given(formulas())
def test_a_printed_formula_parses_to_itself(formula: bddl.Formula) -> None:
    assert bddl.parse_formula(bddl.format(formula)) == formula


@given(problems())
def test_a_printed_problem_parses_to_itself(problem: bddl.Problem) -> None:
    assert bddl.parse(bddl.format(problem)) == problem


@given(formulas())
def test_printing_is_a_fixed_point(formula: bddl.Formula) -> None:
    text = bddl.format(formula)
    assert bddl.format(bddl.parse_formula(text)) == text


@given(formulas())
def test_equal_formulas_hash_alike_and_spans_do_not_count(formula: bddl.Formula) -> None:
    parsed = bddl.parse_formula(bddl.format(formula))
    assert hash(parsed) == hash(formula)
    assert parsed.span is not None
    assert formula.span is None


@given(formulas())
def test_layout_comments_and_letter_case_of_words_do_not_matter(formula: bddl.Formula) -> None:
    spread = bddl.format(formula).replace(")", " ) ; a remark\r\n").replace("(", " (\n\t")
    for word in ("and", "or", "not", "imply", "forall", "exists", "ontop", "inside"):
        spread = spread.replace(f"\t{word} ", f"\t{word.upper()} ")
    assert bddl.parse_formula("\ufeff" + spread) == formula


@given(formulas())
def test_every_span_covers_its_own_text(formula: bddl.Formula) -> None:
    text = bddl.format(formula).replace(") (", ")\n  (")
    for node in bddl.parse_formula(text).walk():
        span = node.span
        assert span is not None
        covered = text[span.offset : span.offset + span.length]
        assert covered[0] == "(" and covered[-1] == ")"
        assert "".join(covered.split()).replace("?", "") == "".join(str(node).split()).replace("?", "")
        line = text.split("\n")[span.line - 1]
        assert line[span.column - 1 :].startswith(covered.split("\n")[0])
        if isinstance(node, bddl.Atom):
            words = [text[s.offset : s.offset + s.length].removeprefix("?") for s in node.word_spans]
            assert words == [node.predicate, *node.args]


def test_a_problem_is_printed_as_people_write_it() -> None:
    problem = bddl.Problem(
        "put_glass",
        "scene",
        (
            bddl.TypedObject("glass_0", "glass"),
            bddl.TypedObject("glass_1", "glass"),
            bddl.TypedObject("table_0", "table"),
        ),
        (bddl.parse_formula("(ontop glass_0 table_0)"),),
        bddl.parse_formula("(and (inside glass_0 gripper) (not (ontop glass_0 table_0)))"),
    )
    assert bddl.format(problem) == (
        "(define (problem put_glass)\n"
        "    (:domain scene)\n"
        "    (:objects\n"
        "        glass_0 glass_1 - glass\n"
        "        table_0 - table\n"
        "    )\n"
        "    (:init\n"
        "        (ontop glass_0 table_0)\n"
        "    )\n"
        "    (:goal\n"
        "        (and\n"
        "            (inside glass_0 gripper)\n"
        "            (not (ontop glass_0 table_0))\n"
        "        )\n"
        "    )\n"
        ")\n"
    )


def test_a_goal_of_behavior_keeps_the_question_marks_of_its_objects() -> None:
    marks = ("(ontop ?apple.n.01_1 ?table.n.02_1)", "(ontop apple.n.01_1 ?table.n.02_1)", "(frozen apple.n.01_1)")
    goal = f"(and {' '.join(marks)} (forall (?apple.n.01 - apple.n.01) (ontop ?apple.n.01 ?table.n.02_1)))"
    text = (
        "(define (problem p-0) (:domain omnigibson) "
        "(:objects apple.n.01_1 - apple.n.01 table.n.02_1 - table.n.02) "
        f"(:init (inroom table.n.02_1 kitchen) (ontop apple.n.01_1 table.n.02_1)) (:goal {goal}))"
    )
    for profile in ("behavior", "behavior-compat"):
        problem = bddl.parse(text, profile=profile)
        printed = bddl.format(problem)
        assert " ".join(printed.split()).replace("( ", "(").replace(" )", ")") == text
        assert bddl.parse(printed, profile=profile) == problem
        assert bddl.format(problem.goal) == bddl.format(bddl.parse_formula(goal, profile=profile)) == goal


def test_a_goal_of_behavior_that_was_built_by_hand_gets_question_marks() -> None:
    on = bddl.Atom("ontop", ("apple.n.01_1", "table.n.02_1"))
    objects = (bddl.TypedObject("apple.n.01_1", "apple.n.01"), bddl.TypedObject("table.n.02_1", "table.n.02"))
    problem = bddl.Problem("p-0", "omnigibson", objects, (on,), bddl.Not(on))
    printed = bddl.format(problem)
    assert "        (ontop apple.n.01_1 table.n.02_1)\n" in printed
    assert "        (not (ontop ?apple.n.01_1 ?table.n.02_1))\n" in printed
    assert bddl.parse(printed, profile="behavior") == problem
    assert "?" not in bddl.format(bddl.Problem("p", "kitchen", objects, (on,), bddl.Not(on)))


def test_marks_of_a_goal_do_not_get_into_a_start() -> None:
    on = bddl.parse_formula("(ontop ?apple.n.01_1 ?table.n.02_1)", profile="behavior")
    objects = (bddl.TypedObject("apple.n.01_1", "apple.n.01"), bddl.TypedObject("table.n.02_1", "table.n.02"))
    problem = bddl.Problem("p-0", "omnigibson", objects, (on,), bddl.Not(on))
    assert bddl.parse(bddl.format(problem), profile="behavior") == problem


def test_question_marks_are_written_for_bound_names_alone() -> None:
    formula = bddl.And((bddl.Exists("x", "glass", bddl.Atom("ontop", ("x", "y"))), bddl.Atom("open", ("x",))))
    assert bddl.format(formula) == "(and (exists (?x - glass) (ontop ?x y)) (open x))"
