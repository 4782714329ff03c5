"""Effort: a search ends by its limit, and early where what could be moved aside is met often."""

from __future__ import annotations

import pytest

from executor.system.effort import Effort, Obstructed, SearchExhausted


def search(effort: Effort, pair: str, *, every: int, configurations: int = 400) -> int:
    """Look at configurations of 10 ms each, of which every so many meets a pair; return how many were looked at."""
    for count in range(configurations):
        effort.queries += 1
        if count % every == every - 1:
            effort.met[pair] += 1
        effort.add(0.01)
    return configurations


def is_loose(pair: str) -> bool:
    return "cup_0" in pair


def test_a_search_is_given_up_where_something_loose_was_met_often() -> None:
    effort = Effort()
    with effort.limited(10.0), pytest.raises(Obstructed) as given_up, effort.impatient(1.0, is_loose):
        search(effort, "panda_hand and cup_0/cup", every=10)
    assert 1.0 <= effort.spent_s < 1.05
    assert list(given_up.value.met) == ["panda_hand and cup_0/cup"]


@pytest.mark.parametrize(("pair", "every"), [("panda_hand and shelf_0/body", 1), ("panda_hand and cup_0/cup", 60)])
def test_a_search_goes_on_where_furniture_is_met_or_something_loose_seldom(pair: str, every: int) -> None:
    effort = Effort()
    with effort.limited(10.0), effort.impatient(1.0, is_loose):
        assert search(effort, pair, every=every) == 400
        assert effort.met[pair]


def test_the_limit_ends_an_impatient_search_too_and_patience_ends_with_its_block() -> None:
    effort = Effort()
    with pytest.raises(SearchExhausted) as ended, effort.limited(0.5), effort.impatient(1.0, is_loose):
        search(effort, "panda_hand and cup_0/cup", every=1)
    assert not isinstance(ended.value, Obstructed)
    with effort.impatient(1.0, is_loose):
        pass
    assert search(effort, "panda_hand and cup_0/cup", every=1) == 400
