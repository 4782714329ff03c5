"""A parenthesis that is missing or too many is found on its line, since indentation tells it."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bddl
from tests.bddl.activity import ACTIVITY
from tests.bddl.strategies import problems

PARENTHESES = [place for place, letter in enumerate(ACTIVITY) if letter in "()"]


def _line(text: str, place: int) -> int:
    return text.count("\n", 0, place) + 1


def _first(text: str) -> bddl.Diagnostic:
    return bddl.check(text, profile="behavior")[0]


@pytest.mark.parametrize("place", PARENTHESES[::3])
def test_a_deleted_parenthesis_is_found_on_its_line(place: int) -> None:
    text = ACTIVITY[:place] + ACTIVITY[place + 1 :]
    found = _first(text)
    assert (found.code, found.line) == ("missing-parenthesis", _line(text, place))


@settings(max_examples=60)
@given(st.sampled_from(PARENTHESES), st.sampled_from("()"))
def test_a_doubled_parenthesis_is_found_on_its_line(place: int, letter: str) -> None:
    text = ACTIVITY[:place] + letter + ACTIVITY[place:]
    found = _first(text)
    assert found.code in ("extra-parenthesis", "missing-parenthesis")
    assert found.line == _line(text, place)


def test_nothing_else_is_reported_when_the_repair_is_right() -> None:
    for place in PARENTHESES[::2]:
        found = bddl.check(ACTIVITY[:place] + ACTIVITY[place + 1 :], profile="behavior")
        assert [diagnostic.code for diagnostic in found] == ["missing-parenthesis"]


def test_two_slips_in_different_places_are_both_found() -> None:
    first, second = ACTIVITY.index("(future"), ACTIVITY.rindex("(ontop")
    text = ACTIVITY[:first] + ACTIVITY[first + 1 : second] + ACTIVITY[second + 1 :]
    found = bddl.check(text, profile="behavior")
    assert [diagnostic.line for diagnostic in found] == [_line(text, first), _line(text, second)]
    assert [diagnostic.code for diagnostic in found] == ["missing-parenthesis", "missing-parenthesis"]


def test_one_badly_indented_line_misleads_nobody() -> None:
    crooked = ACTIVITY.replace("        (ontop saucer.n.02_1", "  (ontop saucer.n.02_1")
    place = crooked.index("(future")
    found = _first(crooked[:place] + crooked[place + 1 :])
    assert found.line == _line(crooked, place)


@settings(max_examples=40)
@given(problems(), st.data())
@pytest.mark.slow
def test_a_printed_problem_without_one_parenthesis_is_reported_on_its_line(
    problem: bddl.Problem, data: st.DataObject
) -> None:
    text = bddl.format(problem)
    place = data.draw(st.sampled_from([place for place, letter in enumerate(text) if letter in "()"]))
    damaged = text[:place] + text[place + 1 :]
    assert bddl.check(damaged)[0].line == _line(damaged, place)
