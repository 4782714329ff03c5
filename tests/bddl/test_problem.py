"""Problem files."""

from __future__ import annotations

import pytest

import bddl

TEXT = """
; A problem as a language model would write it.
(define (problem put_glass_into_refrigerator)
    (:domain omnigibson)
    (:requirements :strips :typing)
    (:objects
        glass_0 glass_1 - glass
        refrigerator_0 - refrigerator
        thing
    )
    (:init (ontop glass_0 thing) (not (open refrigerator_0)) (inroom refrigerator_0 kitchen))
    (:goal (and (inside glass_0 refrigerator_0) (forall (?x - glass) (not (inside ?x gripper)))))
)
"""


def test_a_problem_has_its_sections() -> None:
    problem = bddl.parse(TEXT)
    assert (problem.name, problem.domain) == ("put_glass_into_refrigerator", "omnigibson")
    assert [(item.name, item.category) for item in problem.objects] == [
        ("glass_0", "glass"),
        ("glass_1", "glass"),
        ("refrigerator_0", "refrigerator"),
        ("thing", "object"),
    ]
    assert [str(literal) for literal in problem.init] == [
        "(ontop glass_0 thing)",
        "(not (open refrigerator_0))",
        "(inroom refrigerator_0 kitchen)",
    ]
    assert str(problem.goal) == "(and (inside glass_0 refrigerator_0) (forall (?x - glass) (not (inside ?x gripper))))"
    assert problem.span is not None and problem.span.line == 3


def test_sections_may_come_in_any_order_and_objects_still_count() -> None:
    text = "(define (:goal (open a)) (:objects a - cup) (:domain d) (problem p))"
    assert bddl.parse(text).goal == bddl.Atom("open", ("a",))


def test_many_objects_are_read_in_one_pass() -> None:
    count = 20_000
    text = " ".join(f"cup_{index} - cup" for index in range(count))
    problem = bddl.parse(f"(define (problem p) (:domain d) (:objects {text}) (:goal (open cup_7)))")
    assert len(problem.objects) == count


def test_objects_of_the_scene_need_no_declaration() -> None:
    text = "(define (problem p) (:domain d) (:goal (open refrigerator_0)))"
    assert [found.code for found in bddl.check(text)] == ["unknown-object"]
    assert bddl.parse(text, objects={"refrigerator_0": "refrigerator"}).objects == ()


@pytest.mark.parametrize("profile", ["sceen", "behaviour", ""])
def test_an_unknown_profile_is_misuse_that_names_the_legal_ones(profile: str) -> None:
    for function in (bddl.parse, bddl.parse_formula, bddl.check):
        with pytest.raises(bddl.UnknownProfile, match=f"no BDDL profile '{profile}'.*The profiles are: scene"):
            function("(open a)", profile=profile)


def test_text_that_is_no_string_is_misuse() -> None:
    with pytest.raises(TypeError, match="BDDL text is a str, not bytes"):
        bddl.parse_formula(b"(open a)")  # type: ignore[arg-type]
