"""Ways of saying things: each leads to the intended goal, or to the intended refusal."""

from __future__ import annotations

import pytest

import bddl
import llm
from tests.llm.kitchens import PHRASINGS, SCENES, Phrasing


def outcome(phrasing: Phrasing) -> str:
    """Returns the goal that a query leads to, or the code of its refusal."""
    try:
        proposal = llm.propose(phrasing.query, SCENES[phrasing.scene])
    except llm.QueryError as error:
        return error.code
    return bddl.format(proposal.task.goal)


@pytest.mark.parametrize("phrasing", PHRASINGS, ids=lambda phrasing: f"{phrasing.scene}: {phrasing.query}")
def test_a_phrasing_is_taken_as_intended(phrasing: Phrasing) -> None:
    assert outcome(phrasing) == (phrasing.goal or phrasing.refuse)


def test_there_are_enough_phrasings_and_a_third_is_held_out() -> None:
    assert len(PHRASINGS) >= 120
    assert sum(phrasing.held_out for phrasing in PHRASINGS) == len(PHRASINGS) // 3


@pytest.mark.parametrize(
    "dress",
    [str.upper, str.title, "  {}  ".format, "{}!!".format, "“{}”".format, "Please, {}.".format, "{}, please?".format],
    ids=["upper", "title", "blanks", "exclaimed", "quoted", "asked", "asked after"],
)
def test_case_punctuation_and_courtesy_do_not_matter(dress: object) -> None:
    assert callable(dress)
    for query in ("put the cup into the fridge", "open the refrigerator's door", "pick the glass up"):
        plain = llm.propose(query, SCENES["kitchen_t1"])
        assert llm.propose(dress(query), SCENES["kitchen_t1"]).task == plain.task
