"""Ways of saying things: each leads to the intended goal, or to the intended refusal."""

from __future__ import annotations

from collections import Counter

import pytest

import llm
from tests.llm.kitchens import (
    FAMILIES,
    FIRST_WORDS,
    LATER,
    ORDINARY,
    PHRASINGS,
    SCENES,
    STRANGERS,
    Phrasing,
    mostly_slow,
    outcome,
)


def _name(phrasing: Phrasing) -> str:
    return f"{phrasing.scene}: {phrasing.query[:80]}"


@pytest.mark.parametrize("phrasing", mostly_slow((*PHRASINGS, *STRANGERS, *ORDINARY), 3), ids=_name)
def test_a_phrasing_is_taken_as_intended(phrasing: Phrasing) -> None:
    assert outcome(phrasing) == phrasing.wanted


@pytest.mark.parametrize("phrasing", LATER, ids=_name)
def test_a_phrasing_of_a_later_day_is_taken_as_intended_or_refused(phrasing: Phrasing) -> None:
    got = outcome(phrasing)
    assert isinstance(got, str) or got == phrasing.wanted


def test_there_are_enough_phrasings_and_a_third_of_each_family_is_held_out() -> None:
    assert len(FIRST_WORDS) >= 120
    assert len(FAMILIES) >= 300
    families = Counter(phrasing.family for phrasing in PHRASINGS)
    held_out = Counter(phrasing.family for phrasing in PHRASINGS if phrasing.held_out)
    assert held_out == {family: count // 3 for family, count in families.items()}


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
