"""LIBERO's dialect: what its files hold, what its own parser breaks on, and what is wrong with a file."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import bddl
from bddl.lexer import hide_free_text
from bddl.problem import read_number

KITCHEN = """(define (problem LIBERO_Kitchen_Tabletop_Manipulation)
  (:domain robosuite)
  (:language Put the Red Mug (the left one); then close the drawer :-) please)
  (:regions
    (mug_region
      (:target main_table)
      (:ranges ((-0.10 0.05 -0.08 0.07) (0.1 0.2 0.3 0.4)))
      (:yaw_rotation ((-pi/2 3.141592653589793)))
      (:rgba (0 0 1 0.5)))
    (top_region (:target wooden_cabinet_1))
  )
  (:fixtures main_table - table
             wooden_cabinet_1 - wooden_cabinet)
  (:objects Red_Mug_1 red_mug_2 - red_coffee_mug)
  (:obj_of_interest red_mug_1 wooden_cabinet_1_top_region)
  (:init (On red_mug_1 main_table_mug_region) (Open wooden_cabinet_1_top_region))
  (:goal (And (In Red_Mug_1 wooden_cabinet_1_top_region) (Close wooden_cabinet_1_top_region)))
)
"""


def kitchen(old: str = "", new: str = "") -> str:
    """The file with one piece replaced, which must be in it."""
    assert old in KITCHEN
    return KITCHEN.replace(old, new, 1)


def read(text: str) -> bddl.LiberoProblem:
    problem = bddl.parse(text, profile="libero")
    assert isinstance(problem, bddl.LiberoProblem)
    return problem


def findings(text: str) -> list[tuple[str, int, str]]:
    """Code, line and hint of everything found in a text."""
    return [(found.code, found.line, found.hint) for found in bddl.check(text, profile="libero")]


def test_every_section_is_read() -> None:
    problem = read(KITCHEN)
    assert problem.name == "LIBERO_Kitchen_Tabletop_Manipulation"
    assert problem.language == "Put the Red Mug (the left one); then close the drawer :-) please"
    mug, top = problem.regions
    assert mug.key == "main_table_mug_region" and len(mug.ranges) == 2
    assert mug.ranges[0] == bddl.Rectangle(-0.10, 0.05, -0.08, 0.07)
    assert mug.yaw_rad == (-math.pi / 2, math.pi) and mug.rgba == (0.0, 0.0, 1.0, 0.5)
    assert top.ranges == () and top.yaw_rad is None
    assert [(thing.name, thing.category) for thing in problem.fixtures] == [
        ("main_table", "table"),
        ("wooden_cabinet_1", "wooden_cabinet"),
    ]
    assert [thing.name for thing in problem.objects] == ["red_mug_1", "red_mug_2"]
    assert problem.objects_of_interest == ("red_mug_1", "wooden_cabinet_1_top_region")
    assert str(problem.goal) == "(and (in red_mug_1 wooden_cabinet_1_top_region) (close wooden_cabinet_1_top_region))"
    assert problem.warnings == ()


def test_places_are_those_of_the_text_in_spite_of_the_instruction() -> None:
    problem = read(KITCHEN)
    assert problem.regions[0].span is not None and problem.regions[0].span.line == 5
    atom = problem.init[0]
    assert atom.span is not None and (atom.span.line, atom.span.column) == (16, 10)


def test_what_is_printed_is_read_back() -> None:
    problem = read(kitchen("(:init", "(:scene_properties (kitchen (:floor Wood) (:wall white)) (hall))\n  (:init"))
    assert problem.styles == (bddl.SceneStyle("kitchen", "Wood", "white"), bddl.SceneStyle("hall"))
    assert read(bddl.format(problem)) == problem


@given(st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=40))
def test_any_instruction_is_kept_letter_for_letter(language: str) -> None:
    # A section may begin behind the instruction, and a comment may follow it: what looks like either is none of it.
    assume("(:" not in "".join(language.split()) and ");" not in "".join(language.split()))
    text = kitchen("Put the Red Mug (the left one); then close the drawer :-) please", language)
    assert read(text).language == language.strip()


def test_an_instruction_may_be_the_last_section_and_be_followed_by_a_comment() -> None:
    text = "(define (problem p) (:domain robosuite) (:goal (and))\n (:language lift (it)) ; (said twice)\n)\n"
    assert read(text).language == "lift (it)"
    assert read(text.replace(" ; (said twice)\n)\n", ")")).language == "lift (it)"


def test_an_instruction_that_does_not_end_is_a_missing_parenthesis() -> None:
    text = "(define (problem p) (:domain robosuite) (:goal (and)) (:language lift"
    assert {found.code for found in bddl.check(text, profile="libero")} == {"missing-parenthesis"}


def test_only_named_sections_are_hidden() -> None:
    text = "(define (:Language a (b) c)\n (:goal (and)))"
    assert hide_free_text(text, [":language"]) == "(define (:Language _ ___ _)\n (:goal (and)))"
    assert hide_free_text(text, []) == text
    assert hide_free_text("; (:language a)\n(:goal b)", [":language"]) == "; (:language a)\n(:goal b)"


@pytest.mark.parametrize(
    ("word", "number"),
    [("0", 0.0), ("-1.5e-1", -0.15), (".5", 0.5), ("2.", 2.0), ("pi", math.pi), ("-np.pi/4", -math.pi / 4),
     ("2*pi/3", 2 * math.pi / 3), ("+PI", math.pi)],
)  # fmt: skip
def test_numbers(word: str, number: float) -> None:
    assert read_number(word) == pytest.approx(number)


@pytest.mark.parametrize(
    "word", ["9**9**9", "__import__('os')", "1e999", "pi/0", "nan", "inf", "", "-", "1,5", "pi.real", "0x10", "1_000"]
)
def test_what_is_no_number_is_never_evaluated(word: str) -> None:
    assert read_number(word) is None
    if word and not set(word) & set("() "):
        text = kitchen("(-pi/2 3.141592653589793)", f"(0 {word})")
        assert [(code, line) for code, line, _ in findings(text)] == [("bad-section", 8)]


@pytest.mark.parametrize(
    ("old", "new", "code", "line", "hint"),
    [
        ("(:target main_table)", "", "bad-section", 5, "write (:target NAME)"),
        ("(:target main_table)", "(:target a b)", "bad-section", 6, "write (:target NAME)"),
        ("(:target main_table)", "(:targt main_table)", "bad-section", 6, "did you mean :target?"),
        ("-0.08 0.07", "-0.08", "bad-section", 7, "write (:ranges ((X_MIN Y_MIN X_MAX Y_MAX) ...))"),
        ("(0 0 1 0.5)", "0 0 1", "bad-section", 9, "write (:rgba (RED GREEN BLUE ALPHA))"),
        ("(top_region", "(mug_region (:target main_table)) (top_region", "repeated-object", 10,
         "keep one of them, or give the second another name"),
        ("(top_region (:target wooden_cabinet_1))", "(region (:target main_table_mug))",
         "repeated-object", 10, "`main_table` + `mug_region` and `main_table_mug` + `region` read alike: rename one"),
        ("red_mug_1 wooden_cabinet_1_top_region)", "red_mug_3)", "unknown-object", 15,
         "did you mean red_mug_1 or red_mug_2 or main_table_mug_region?"),
        ("(On red_mug_1 main_table_mug_region)", "(On red_mug_1 main_table_cup_region)", "unknown-object", 16,
         "did you mean main_table_mug_region or main_table or wooden_cabinet_1_top_region?"),
        ("(Close wooden", "(Closed wooden", "unknown-predicate", 17,
         "write (close wooden_cabinet_1_top_region)"),
        ("(:domain robosuite)", "(:domain robo_suite)", "unknown-domain", 2, "did you mean robosuite?"),
        ("main_table - table", "main_table - table -", "bad-objects", 13, "write (:fixtures glass_0 - glass)"),
    ],
)  # fmt: skip
def test_a_mistake_is_placed_and_explained(old: str, new: str, code: str, line: int, hint: str) -> None:
    found = [(c, at, h) for c, at, h in findings(kitchen(old, new)) if c == code]
    assert (code, line, hint) in found


def test_a_region_of_nothing_is_a_warning() -> None:
    problem = read(kitchen("(top_region", "(left_region (:target bowl_drainer_1)) (top_region"))
    assert [(found.code, found.severity, found.line) for found in problem.warnings] == [
        ("unknown-object", "warning", 10)
    ]


@pytest.mark.parametrize("form", ["(Or (Open red_mug_1) (Close red_mug_1))", "(Not (Open red_mug_1))"])
def test_a_goal_that_the_simulator_would_misjudge_is_refused(form: str) -> None:
    text = kitchen("(Close wooden_cabinet_1_top_region)", form)
    assert ("unsupported-form", 17) in [(code, line) for code, line, _ in findings(text)]


def test_a_second_goal_is_refused() -> None:
    text = kitchen("(:goal (And", "(:goal (Open red_mug_1) (And")
    assert "several-formulas" in [code for code, _, _ in findings(text)]


def test_a_problem_built_by_hand_cannot_hide_a_section_in_its_instruction() -> None:
    with pytest.raises(ValueError, match="beginning of a section"):
        bddl.LiberoProblem("p", "robosuite", (), (), bddl.And(()), language="go (:goal (open x))")
