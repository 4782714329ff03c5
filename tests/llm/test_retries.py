"""Back-off: growing, bounded, jittered, and longer where the server asks."""

from __future__ import annotations

import random
from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from llm.errors import RequestError
from llm.retries import RetryPolicy, asked_wait_s, is_passing

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


@given(st.integers(1, 6), st.integers(1, 6), st.none() | st.floats(0, 100), st.integers(0, 99))
def test_waits_are_bounded_and_never_shorter_than_asked(
    attempts: int, attempt: int, asked_s: float | None, seed: int
) -> None:
    policy = RetryPolicy(attempts=attempts, first_wait_s=1.0, longest_wait_s=30.0)
    wait_s = policy.wait_s(attempt, asked_s, random.Random(seed))
    if attempt >= attempts or (asked_s is not None and asked_s > 30.0):
        assert wait_s is None
        return
    assert wait_s is not None
    grown = min(2.0 ** (attempt - 1), 30.0)
    assert max(0.5 * grown, asked_s or 0.0) <= wait_s <= max(grown, asked_s or 0.0)


def test_two_clients_do_not_wait_alike() -> None:
    assert len({RetryPolicy().wait_s(1, None, random.Random(seed)) for seed in range(20)}) == 20


@pytest.mark.parametrize(
    ("headers", "seconds"),
    [
        ({}, None),
        ({"retry-after": "7"}, 7.0),
        ({"retry-after": "0.5"}, 0.5),
        ({"retry-after": "-3"}, 0.0),
        ({"retry-after": "7", "retry-after-ms": "250"}, 0.25),
        ({"retry-after": "Fri, 02 Jan 2026 03:04:35 GMT"}, 30.0),
        ({"retry-after": "Fri, 02 Jan 2026 03:04:35 -0000"}, 30.0),
        ({"retry-after": "Fri, 02 Jan 2026 03:00:00 GMT"}, 0.0),
        ({"retry-after": "soon"}, None),
        ({"retry-after": "nan"}, None),
        ({"retry-after": "inf"}, None),
        ({"retry-after": "Fri, 99 Jan 99999 03:00:00 GMT"}, None),
    ],
)
def test_the_servers_wish_is_read_in_all_its_forms(headers: dict[str, str], seconds: float | None) -> None:
    assert asked_wait_s(headers, NOW) == seconds


def test_only_what_may_pass_is_tried_again() -> None:
    passing = {status for status in range(400, 600) if is_passing(status)}
    assert passing == {408, 409, 429, *range(500, 600)}


@pytest.mark.parametrize(
    "wrong", [{"attempts": 0}, {"first_wait_s": -1.0}, {"first_wait_s": 9.0, "longest_wait_s": 1.0}]
)
def test_a_policy_without_an_end_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(RequestError):
        RetryPolicy(**wrong)
