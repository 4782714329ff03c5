"""Budgets of a run: limits on requests, tokens, dollars and seconds of its models, and what was used."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from threading import Lock
from types import MappingProxyType
from typing import TYPE_CHECKING

from llm.client.transport import ChatReply, ChatRequest, Transport
from llm.errors import BudgetSpent, ModelConfigError, ModelError, ModelTimeout, RequestError

if TYPE_CHECKING:
    from llm.client.profiles import BoxForm, Price


@dataclass(frozen=True, slots=True)
class Budget:
    """Limits of a run; None is no limit.

    Attributes:
        requests: Requests, counted at each sending.
        tokens: Tokens of requests and replies together, as counted by the server.
        cost_usd: Cost by the profile's list price [US dollars].
        time_s: Time since the first request [s].
    """

    requests: int | None = None
    tokens: int | None = None
    cost_usd: float | None = None
    time_s: float | None = None

    def __post_init__(self) -> None:
        for name, limit in asdict(self).items():
            if limit is not None and not 0 <= limit < math.inf:
                raise RequestError(f"a budget's {name} is 0 or more, or None, not {limit}")


@dataclass(frozen=True, slots=True)
class Usage:
    """Usage of a run.

    Attributes:
        requests: Requests, counted at each sending, failed ones included.
        failures: Requests without a reply; a server may charge for them, so the cost is a lower bound.
        input_tokens: As counted by the server.
        output_tokens: As counted by the server.
        uncounted: Replies without counts; tokens and cost are then lower bounds.
        cost_usd: By list price, without recorded replies; None if the price is unknown.
        waited_s: Time spent waiting for replies, retries included [s].
        elapsed_s: Time since the first request [s].
        recorded: Replies from a recording, which cost nothing now; the counts of requests and tokens include them.
    """

    requests: int = 0
    failures: int = 0
    input_tokens: int = 0
    output_tokens: int = 0
    uncounted: int = 0
    cost_usd: float | None = None
    waited_s: float = 0.0
    elapsed_s: float = 0.0
    recorded: int = 0

    @property
    def tokens(self) -> int:
        """Tokens of requests and replies together."""
        return self.input_tokens + self.output_tokens

    @property
    def is_bound(self) -> bool:
        """True if tokens and cost may be more than what was counted."""
        return self.failures > 0 or self.uncounted > 0

    def record(self) -> dict[str, object]:
        """Return the usage as JSON."""
        return {**asdict(self), "waited_s": round(self.waited_s, 3), "elapsed_s": round(self.elapsed_s, 3)}

    def summary(self) -> str:
        """Return one line for people."""
        parts = [
            f"{self.requests} {'request' if self.requests == 1 else 'requests'}",
            f"{self.input_tokens} + {self.output_tokens} tokens",
            "cost unknown" if self.cost_usd is None else f"{'at least ' if self.is_bound else ''}${self.cost_usd:.4f}",
            f"{self.elapsed_s:.1f} s",
        ]
        if self.failures:
            parts.insert(1, f"{self.failures} failed")
        if self.uncounted:
            parts.append(f"{self.uncounted} replies without token counts")
        if self.recorded:
            parts.append(f"{self.recorded} of them recorded earlier and not paid again")
        return ", ".join(parts)


def spent_limit(used: Usage, budget: Budget) -> str | None:
    """Return why a budget allows no further request; None where it does. Its limit in time is one on `waited_s`."""
    limits = (
        (used.requests, budget.requests, f"{budget.requests} requests"),
        (used.tokens, budget.tokens, f"{budget.tokens} tokens"),
        (used.cost_usd or 0.0, budget.cost_usd, f"${budget.cost_usd or 0.0:g}"),
        (used.waited_s, budget.time_s, f"{budget.time_s or 0.0:g} s"),
    )
    spent = next((words for use, limit, words in limits if limit is not None and use >= limit), None)
    if spent is not None:
        return f"the budget of {spent} is used up"
    if used.uncounted and (budget.tokens, budget.cost_usd) != (None, None):
        return "the server does not count tokens, so a budget in tokens or dollars cannot be kept"
    return None


def late_reply(budget: Budget) -> str:
    """Return why a request ended without a reply when a budget's time ran out."""
    return f"the budget of {budget.time_s:g} s ran out during a request"


def check_price(name: str, budget: Budget, *prices: Price | None) -> None:
    """Refuse a limit in dollars where a price is unknown.

    Raises:
        ModelConfigError: It is so.
    """
    if budget.cost_usd is not None and None in prices:
        advice = "Limit tokens instead, or write the price into a file of profiles"
        raise ModelConfigError(name, "a budget in dollars needs a price, and none is known", advice)


def send_within(
    transport: Transport,
    request: ChatRequest,
    left_s: float | None,
    *,
    count: Callable[[ChatReply | None, int, float], None],
    ran_out: Callable[[], BudgetSpent],
) -> ChatReply:
    """Return a transport's reply to a request that waits no longer than the remaining time.

    Args:
        transport: Transport that answers.
        request: The request.
        left_s: Remaining time of a budget [s]; None is no limit.
        count: Called once, also after a failure: with the reply or None, its attempts, and the waiting time [s].
        ran_out: Returns the error for a time that ran out during the request.

    Raises:
        BudgetSpent: The remaining time ran out during the request.
        ModelError: As the transport does.
    """
    if left_s is not None and (request.timeout_s is None or request.timeout_s > left_s):
        request = replace(request, timeout_s=left_s)
    began = time.monotonic()
    reply: ChatReply | None = None
    attempts = 1
    try:
        reply = transport.complete(request)
        attempts = reply.attempts
    except ModelError as error:
        attempts = error.attempts
        if isinstance(error, ModelTimeout) and left_s is not None and time.monotonic() - began >= left_s:
            raise ran_out() from error
        raise
    finally:
        count(reply, attempts, time.monotonic() - began)
    return reply


class Metered:
    """Forward requests within a budget, and count them.

    The budget is checked before a request. The reply that exceeds it is returned, since it is paid for; the next
    request is not sent. No request waits longer than the remaining time. Recorded replies cost nothing; where a model
    goes on after them, they use up no limit but that in time.

    Attributes:
        name: The configuration string.
        budget: The limits.
        warnings: What was skipped in a recording that answers.
        boxes: Requested form of boxes in a picture; None for a recording, which does not state it.
        price: Price of tokens; None if unknown, or paid when it was recorded.
        prices: Module -> price of its own model, where it has one.
        answered_by: Model of the latest reply, as its server named it; empty before the first one.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        name: str = "model",
        budget: Budget | None = None,
        price: Price | None = None,
        prices: Mapping[int, Price | None] = MappingProxyType({}),
        warnings: tuple[str, ...] = (),
        boxes: BoxForm | None = None,
        replays: bool = False,
    ) -> None:
        """Set up the meter; nothing is sent.

        Args:
            replays: A recording alone answers, so that its run ends at the same limits again.

        Raises:
            ModelConfigError: The cost is limited, but the price is unknown.
        """
        self.name = name
        self.budget = budget or Budget()
        self.warnings = warnings
        self.boxes = boxes
        self.price = price
        self.prices = prices
        self.answered_by = ""
        known = None not in (price, *prices.values())
        check_price(name, self.budget, price, *prices.values())
        self._transport = transport
        self._replays = replays
        self._usage = Usage(cost_usd=0.0 if known else None)
        # What recorded replies count for in the usage, and not in the limits.
        self._unpaid = Usage()
        self._started: float | None = None
        self._lock = Lock()

    @property
    def usage(self) -> Usage:
        """Usage until now."""
        with self._lock:
            return replace(self._usage, elapsed_s=self._elapsed_s())

    def price_of(self, module: int) -> Price | None:
        """Return the price of a module's model; None if it is unknown."""
        return self.prices.get(module, self.price)

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the transport's reply."""
        left_s = self._admit()
        count = partial(self._count, self.price_of(request.module))
        reply = send_within(self._transport, request, left_s, count=count, ran_out=self._ran_out)
        self.answered_by = reply.model
        return reply

    def _admit(self) -> float | None:
        """Count a request and return the remaining time [s]; raise BudgetSpent if a limit is reached."""
        with self._lock:
            if self._started is None:
                self._started = time.monotonic()
            used, unpaid, budget, elapsed_s = self._usage, self._unpaid, self.budget, self._elapsed_s()
            paid = replace(
                used,
                requests=used.requests - unpaid.requests,
                input_tokens=used.tokens - unpaid.tokens,
                output_tokens=0,
                uncounted=used.uncounted - unpaid.uncounted,
                waited_s=elapsed_s,
            )
            problem = spent_limit(paid, budget)
            if problem is None:
                self._usage = replace(used, requests=used.requests + 1)
                return None if budget.time_s is None else budget.time_s - elapsed_s
        raise self._spent(problem)

    def _ran_out(self) -> BudgetSpent:
        return self._spent(late_reply(self.budget))

    def _spent(self, problem: str) -> BudgetSpent:
        return BudgetSpent(self.name, problem, f"Used: {self.usage.summary()}")

    def _count(self, price: Price | None, reply: ChatReply | None, attempts: int, waited_s: float) -> None:
        """Add the result of a request; `_admit` has counted one of its attempts."""
        with self._lock:
            used = replace(
                self._usage,
                requests=self._usage.requests + attempts - 1,
                failures=self._usage.failures + attempts - (reply is not None),
                waited_s=self._usage.waited_s + waited_s,
            )
            if reply is None:
                self._usage = used
                return
            self._usage = _with_reply(used, reply)
            if reply.recorded and not self._replays:
                unpaid = replace(self._unpaid, requests=self._unpaid.requests + attempts)
                self._unpaid = _with_reply(unpaid, reply)
            elif not reply.recorded and used.cost_usd is not None and price is not None:
                paid_usd = price.cost_usd(reply.input_tokens or 0, reply.output_tokens or 0)
                self._usage = replace(self._usage, cost_usd=used.cost_usd + paid_usd)

    def _elapsed_s(self) -> float:
        return 0.0 if self._started is None else time.monotonic() - self._started


def _with_reply(used: Usage, reply: ChatReply) -> Usage:
    return replace(
        used,
        input_tokens=used.input_tokens + (reply.input_tokens or 0),
        output_tokens=used.output_tokens + (reply.output_tokens or 0),
        uncounted=used.uncounted + (reply.input_tokens is None or reply.output_tokens is None),
        recorded=used.recorded + reply.recorded,
    )
