"""Damaged files in LIBERO's own layout: there is always a diagnostic, and it stands where the damage is."""

from __future__ import annotations

import pytest

import bddl
from benchmarks.conformance.fuzz import LIBERO_TEXT
from benchmarks.conformance.libero_mutants import libero_mutants

PARENTHESES = [place for place, letter in enumerate(LIBERO_TEXT) if letter in "()"]
INSTRUCTION = range(LIBERO_TEXT.index("(:language"), LIBERO_TEXT.index("(:regions"))


def _errors(text: str) -> list[bddl.Diagnostic]:
    return [found for found in bddl.check(text, profile="libero") if found.severity == "error"]


def _line(place: int) -> int:
    return LIBERO_TEXT.count("\n", 0, place) + 1


def test_the_file_itself_is_legal() -> None:
    assert _errors(LIBERO_TEXT) == []


@pytest.mark.parametrize("place", PARENTHESES)
def test_a_deleted_parenthesis_is_reported(place: int) -> None:
    found = _errors(LIBERO_TEXT[:place] + LIBERO_TEXT[place + 1 :])
    # The instruction ends where its line ends, so a parenthesis inside it may be missing without harm.
    assert found or place in INSTRUCTION
    if found and place < PARENTHESES[-1]:
        assert found[0].line == _line(place)
        assert found[0].code in ("missing-parenthesis", "extra-parenthesis")


@pytest.mark.parametrize("place", [place for place in PARENTHESES if LIBERO_TEXT[place] == ")"])
def test_a_deleted_closing_parenthesis_is_called_missing(place: int) -> None:
    found = _errors(LIBERO_TEXT[:place] + LIBERO_TEXT[place + 1 :])
    assert [item.code for item in found] == ["missing-parenthesis"] * len(found)


@pytest.mark.parametrize("letter", "()")
def test_a_doubled_parenthesis_is_found_on_its_line(letter: str) -> None:
    for place in PARENTHESES:
        if place not in INSTRUCTION:
            found = _errors(LIBERO_TEXT[:place] + letter + LIBERO_TEXT[place:])
            assert found and found[0].line == _line(place), LIBERO_TEXT[place - 20 : place + 20]


def test_a_mutant_tells_its_line_and_is_no_legal_file() -> None:
    for mutant in libero_mutants("own", LIBERO_TEXT, seed=5, edits=10):
        assert abs(len(mutant.text) - len(LIBERO_TEXT)) == 1
        assert _errors(mutant.text), mutant.kind


def test_an_instruction_that_a_section_interrupts_is_a_missing_parenthesis() -> None:
    text = (
        "(define (problem P) (:domain robosuite) (:language pick up the cup (:regions (a (:target t)))\n"
        " (:fixtures t - table) (:objects c - cup) (:obj_of_interest c) (:init (On c t)) (:goal (And (On c t)))))"
    )
    found = _errors(text)
    assert "missing-parenthesis" in [item.code for item in found]


@pytest.mark.parametrize(
    "text",
    [
        # A region that swallows the sections behind it, and an initial state that swallows the goal.
        "(define (problem P)\n  (:domain robosuite)\n  (:language pick up the cup)\n    (:regions\n      (a\n"
        "          (:target t)\n      )\n    )\n  (:fixtures t - table)\n  (:objects c - cup)\n"
        "  (:obj_of_interest c)\n  (:init\n    (On c t\n  )\n  (:goal (And (On c t)))\n)\n",
        "(define (problem P) (:domain robosuite) (:language pick up the cup)\n (:regions (a (:target t) "
        "(:ranges ((0 0 1 1))) )\n (:fixtures t - table) (:init (On c t_a)) (:goal (And (On c t_a))))",
    ],
)
def test_a_file_whose_sections_run_into_each_other_is_reported(text: str) -> None:
    assert _errors(text)[0].code == "missing-parenthesis"


def test_sections_that_fit_into_no_problem_are_a_diagnostic(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(problem: bddl.LiberoProblem) -> None:
        raise ValueError("An instruction cannot hold the beginning of a section.")

    monkeypatch.setattr(bddl.LiberoProblem, "__post_init__", refuse)
    assert [found.code for found in _errors(LIBERO_TEXT)] == ["bad-section"]
