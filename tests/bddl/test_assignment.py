"""Cheapest choices of cells and cheapest sums, against trying everything."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, islice, permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from bddl.goals.assignment import INFINITE, cheapest_pairs
from bddl.goals.combinations import combined
from bddl.goals.search import Way

costs = st.one_of(st.integers(0, 9), st.just(INFINITE))
sizes = st.integers(1, 4)


@given(sizes.flatmap(lambda width: st.lists(st.lists(costs, min_size=width, max_size=width), min_size=1, max_size=4)))
def test_a_choice_of_any_size_is_a_cheapest_one(table: list[list[int]]) -> None:
    rows, columns = range(len(table)), range(len(table[0]))
    for count in range(len(table) + 2):
        sums = [
            sum(table[row][column] for row, column in zip(chosen, places, strict=True))
            for chosen in combinations(rows, count)
            for places in permutations(columns, count)
        ]
        found = cheapest_pairs(table, count)
        if min(sums, default=INFINITE) >= INFINITE:
            assert found is None
            continue
        assert found is not None
        assert len({row for row, _ in found}) == len({column for _, column in found}) == len(found) == count
        assert sum(table[row][column] for row, column in found) == min(sums)


@pytest.mark.parametrize("seed", range(5))
def test_large_tables_agree_with_scipy(seed: int) -> None:
    table = np.random.default_rng(seed).integers(0, 50, size=(20, 25))
    rows, columns = linear_sum_assignment(table)
    found = cheapest_pairs(table.tolist(), 20)
    assert found is not None
    assert sum(int(table[row, column]) for row, column in found) == int(table[rows, columns].sum())


@given(st.lists(st.lists(st.integers(0, 6), max_size=4).map(sorted), max_size=4))
def test_combinations_come_cheapest_first_and_each_once(lists: list[list[int]]) -> None:
    groups: list[list[Way]] = []
    bit = 1
    for prices in lists:
        groups.append([Way(price, bit << place, 0) for place, price in enumerate(prices)])
        bit <<= len(prices)
    found = list(combined(Way(1, 0, bit), groups))
    expected = [1 + sum(way.cost for way in chosen) for chosen in product(*groups)]
    assert [way.cost for way in found] == sorted(expected)
    assert len({way.true for way in found}) == len(expected)
    assert all(way.false == bit for way in found)


def test_combinations_are_read_no_further_than_needed() -> None:
    """Of endless lists, only the ways that the first combinations use, and one more each, are ever made."""
    made = [0, 0]

    def endless(group: int, price: int) -> Iterator[Way]:
        for number in range(1_000_000):
            made[group] += 1
            yield Way(number * price, 1 << (2 * number + group), 0)

    found = list(islice(combined(Way(0, 0, 0), [endless(0, 1), endless(1, 100)]), 10))
    assert [way.cost for way in found] == list(range(10))
    assert made[0] <= 12 and made[1] == 2
