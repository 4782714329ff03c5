"""Budgets stop a run before the next request, and say what was used."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from llm.client.budget import Budget, Metered, Usage
from llm.client.profiles import Price
from llm.client.transport import ChatReply
from llm.errors import BudgetSpent, ModelConfigError, ModelTimeout, ModelUnavailable, RequestError
from tests.llm.live import ASK, transport_to
from tests.llm.model_server import Act, ModelServer, fails, replies
from tests.llm.scripted import Scripted

PRICE = Price(input=2.0, output=10.0)


@pytest.mark.parametrize(
    ("budget", "sent", "problem"),
    [
        (Budget(requests=3), 3, "the budget of 3 requests is used up"),
        (Budget(requests=0), 0, "the budget of 0 requests is used up"),
        (Budget(tokens=31), 3, "the budget of 31 tokens is used up"),
        (Budget(tokens=30), 2, "the budget of 30 tokens is used up"),
        # A request costs 10 tokens of 2 and 5 of 10 dollars a million.
        (Budget(cost_usd=0.00015), 3, "the budget of $0.00015 is used up"),
        (Budget(time_s=0), 0, "the budget of 0 s is used up"),
        (Budget(requests=9, tokens=15), 1, "the budget of 15 tokens is used up"),
    ],
)
def test_a_budget_stops_before_the_next_request(budget: Budget, sent: int, problem: str) -> None:
    script = Scripted()
    metered = Metered(script, name="lab:small", budget=budget, price=PRICE)
    for _ in range(sent):
        metered.complete(ASK)
    for _ in range(2):
        with pytest.raises(BudgetSpent) as caught:
            metered.complete(ASK)
        assert caught.value.problem == problem
        assert f"Used: {sent} request" in caught.value.advice and sent == len(script.asked)
    assert metered.usage.tokens == 15 * sent
    assert metered.usage.cost_usd == pytest.approx(sent * 70e-6)


def test_the_message_says_what_was_used() -> None:
    metered = Metered(Scripted(), name="lab:small", budget=Budget(requests=1))
    metered.complete(ASK)
    with pytest.raises(BudgetSpent) as caught:
        metered.complete(ASK)
    assert str(caught.value).startswith(
        "lab:small: the budget of 1 requests is used up. Used: 1 request, 10 + 5 tokens, cost unknown, "
    )


def test_time_bounds_the_wait_for_each_reply() -> None:
    script = Scripted()
    metered = Metered(script, budget=Budget(time_s=50))
    metered.complete(ASK)
    metered.complete(replace(ASK, timeout_s=7))
    first, second = (request.timeout_s for request in script.asked)
    assert first is not None and 49 < first <= 50
    assert second == 7
    # The question stays the same, so a recording answers it.
    assert script.asked[0].digest() == ASK.digest()


def test_time_that_runs_out_during_a_request_is_the_budgets_word(monkeypatch: pytest.MonkeyPatch) -> None:
    with ModelServer(Act(wait_s=20)) as server:
        metered = Metered(transport_to(server, monkeypatch), budget=Budget(time_s=0.3))
        with pytest.raises(BudgetSpent, match=r"the budget of 0\.3 s ran out during a request"):
            metered.complete(ASK)
        assert metered.usage.failures == 1


def test_a_timeout_within_the_budget_stays_a_timeout() -> None:
    metered = Metered(Scripted(ModelTimeout("m", "slow")), budget=Budget(time_s=50))
    with pytest.raises(ModelTimeout):
        metered.complete(ASK)


def test_failures_are_requests_too() -> None:
    metered = Metered(Scripted(ModelUnavailable("m", "down")), budget=Budget(requests=2))
    for _ in range(2):
        with pytest.raises(ModelUnavailable):
            metered.complete(ASK)
    with pytest.raises(BudgetSpent):
        metered.complete(ASK)
    assert (metered.usage.requests, metered.usage.failures, metered.usage.tokens) == (2, 2, 0)


def test_what_is_not_counted_is_not_guessed() -> None:
    silent = Scripted(ChatReply("fine", None, None))
    unbounded = Metered(silent)
    unbounded.complete(ASK)
    unbounded.complete(ASK)
    assert unbounded.usage.uncounted == 2
    assert unbounded.usage.summary().endswith("2 replies without token counts")
    bounded = Metered(Scripted(ChatReply("fine", None, None)), budget=Budget(tokens=1000))
    bounded.complete(ASK)
    with pytest.raises(BudgetSpent, match="the server does not count tokens"):
        bounded.complete(ASK)


def test_no_cost_is_claimed_without_a_price() -> None:
    metered = Metered(Scripted())
    metered.complete(ASK)
    assert metered.usage.cost_usd is None
    assert "cost unknown" in metered.usage.summary()
    with pytest.raises(ModelConfigError, match=r"needs a price, and none is known\. Limit tokens"):
        Metered(Scripted(), budget=Budget(cost_usd=1.0))


def test_the_summary_is_one_line() -> None:
    usage = Usage(12, 1, 3456, 789, 0, 0.0234, 20.0, 61.26)
    assert usage.summary() == "12 requests, 1 failed, 3456 + 789 tokens, at least $0.0234, 61.3 s"
    assert usage.record()["elapsed_s"] == 61.26


@pytest.mark.parametrize("limits", [{"requests": -1}, {"tokens": -5}, {"time_s": float("nan")}, {"cost_usd": -0.1}])
def test_a_limit_below_zero_is_refused(limits: dict[str, Any]) -> None:
    with pytest.raises(RequestError, match="is 0 or more, or None"):
        Budget(**limits)


@given(
    st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), max_size=12),
    st.none() | st.integers(0, 6),
    st.none() | st.integers(0, 200),
)
def test_a_budget_admits_exactly_while_there_is_room(
    counts: list[tuple[int, int]], requests: int | None, tokens: int | None
) -> None:
    replies = [ChatReply("x", first, second) for first, second in counts]
    script = Scripted(*replies)
    metered = Metered(script, budget=Budget(requests=requests, tokens=tokens))
    used = 0
    for number, (first, second) in enumerate(counts):
        room = (requests is None or number < requests) and (tokens is None or used < tokens)
        if not room:
            with pytest.raises(BudgetSpent):
                metered.complete(ASK)
            assert len(script.asked) == number
            return
        metered.complete(ASK)
        used += first + second
        assert metered.usage.tokens == used


def test_a_request_that_times_out_is_sent_and_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    with ModelServer(Act(wait_s=20)) as server:
        metered = Metered(transport_to(server, monkeypatch, retries=2, timeout_s=0.2), price=PRICE)
        with pytest.raises(ModelTimeout) as caught:
            metered.complete(ASK)
        assert len(server.seen) == 1 == caught.value.attempts
    used = metered.usage
    assert (used.requests, used.failures) == (1, 1)
    assert "1 request, 1 failed" in used.summary() and "at least $0.0000" in used.summary()


def test_what_was_sent_again_before_it_was_answered_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    with ModelServer(fails(500), fails(503), replies("fine")) as server:
        metered = Metered(transport_to(server, monkeypatch, retries=2), budget=Budget(requests=3))
        assert metered.complete(ASK).attempts == 3
        with pytest.raises(BudgetSpent, match="the budget of 3 requests"):
            metered.complete(ASK)
    assert (metered.usage.requests, metered.usage.failures, len(server.seen)) == (3, 2, 3)


def test_recorded_replies_cost_nothing_and_use_up_no_limit() -> None:
    recorded = ChatReply("then", None, 5, attempts=3, recorded=True)
    script = Scripted(recorded, recorded, ChatReply("now", 10, 5))
    # A request costs 10 tokens of 2 and 5 of 10 dollars a million.
    metered = Metered(script, budget=Budget(requests=2, tokens=30, cost_usd=0.00014), price=PRICE)
    for _ in range(4):
        metered.complete(ASK)
    with pytest.raises(BudgetSpent, match="the budget of 2 requests is used up"):
        metered.complete(ASK)
    used = metered.usage
    assert (used.requests, used.recorded, used.tokens, used.uncounted) == (8, 2, 40, 2)
    assert used.cost_usd == pytest.approx(2 * 70e-6)
