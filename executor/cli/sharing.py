"""Options of the commands that spread many units over processes and machines."""

from __future__ import annotations

from executor.bench.run import Shard
from executor.cli.errors import check

LONGEST_LIMIT_S = 604_800.0
"""A week; clocks of threads do not take any number."""


def check_unit_limit(limit_s: float) -> None:
    """Refuses a time that clocks cannot be set to.

    Raises:
        BadOption: It is not above 0, or more than a week.
    """
    good = 0.0 < limit_s <= LONGEST_LIMIT_S
    check(good, "--limit-s", limit_s, f"a number of seconds above 0, at most {LONGEST_LIMIT_S:.0f}")


def read_shard(text: str) -> Shard:
    """Returns the part of a whole that is meant, such as 3/8.

    Raises:
        BadOption: It is none.
    """
    number, slash, of = text.partition("/")
    good = bool(slash) and number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)
    check(good, "--shard", text, "a part of a whole, such as 1/4 to 4/4")
    return Shard(int(number), int(of))
