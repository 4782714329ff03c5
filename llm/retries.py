"""When a failed request is sent again, and after how long."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime

from llm.errors import RequestError

# 408 and 409 are passing by their definition; 429 and 5xx say that the server is busy or failing.
PASSING_STATUSES = frozenset({408, 409, 429})


def is_passing(status: int) -> bool:
    """Returns whether the same request may succeed later, going by the status of its answer."""
    return status in PASSING_STATUSES or status >= 500


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """Exponential back-off with jitter.

    Attributes:
        attempts: How often a request is sent at most.
        first_wait_s: Seconds before the second attempt; each later wait is twice as long.
        longest_wait_s: Most seconds to wait; a server that asks for more is given up at once.
    """

    attempts: int = 4
    first_wait_s: float = 1.0
    longest_wait_s: float = 60.0

    def __post_init__(self) -> None:
        if self.attempts < 1 or not 0 <= self.first_wait_s <= self.longest_wait_s < math.inf:
            raise RequestError("a retry policy has at least 1 attempt, and 0 <= first_wait_s <= longest_wait_s")

    def wait_s(self, attempt: int, asked_s: float | None, chance: random.Random) -> float | None:
        """Returns how long to wait after a failed attempt, or None to give up.

        Args:
            attempt: Which attempt failed, from 1.
            asked_s: How long the server asked to wait, or None.
            chance: Source of the jitter: half of the wait is drawn, so that many clients do not come back together.
        """
        if attempt >= self.attempts or (asked_s is not None and asked_s > self.longest_wait_s):
            return None
        grown = min(self.first_wait_s * 2.0 ** (attempt - 1), self.longest_wait_s)
        drawn = grown * (0.5 + 0.5 * chance.random())
        return drawn if asked_s is None else max(asked_s, min(drawn, self.longest_wait_s))


def asked_wait_s(headers: Mapping[str, str], now: datetime | None = None) -> float | None:
    """Returns the seconds that a server asks to wait, or None where it does not say.

    Args:
        headers: Of the answer; Retry-After holds seconds or a date (RFC 9110, 10.2.3), retry-after-ms milliseconds.
        now: What the date is compared with; default is the present.
    """
    for name, unit in (("retry-after-ms", 1e-3), ("retry-after", 1.0)):
        try:
            seconds = float(headers.get(name, "")) * unit
        except ValueError:
            continue
        if math.isfinite(seconds):
            return max(0.0, seconds)
    try:
        date = parsedate_to_datetime(headers.get("retry-after", ""))
    except ValueError:
        return None
    if date.tzinfo is None:
        date = date.replace(tzinfo=UTC)
    return max(0.0, (date - (now or datetime.now(UTC))).total_seconds())
