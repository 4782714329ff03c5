"""Counts of an evaluation, with exact intervals, and pairs of policies compared on the same episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

from scipy.stats import binomtest

from executor.bench.summary import Rate
from executor.policies.judging.outcomes import EpisodeOutcome


@dataclass(frozen=True, slots=True)
class PolicyScore:
    """What a policy came to.

    Attributes:
        once, at_end: How often it succeeded at some time, and still 3 s later.
        failures: What went wrong -> how often, the most frequent first.
        mean_s: Simulated time of its successes; None without one.
    """

    once: Rate
    at_end: Rate
    failures: Mapping[str, int]
    mean_s: float | None

    @classmethod
    def of(cls, outcomes: Sequence[EpisodeOutcome]) -> PolicyScore:
        """Returns the score of episodes."""
        times_s = [outcome.simulated_s for outcome in outcomes if outcome.success_once]
        return cls(
            Rate(sum(outcome.success_once for outcome in outcomes), len(outcomes)),
            Rate(sum(outcome.success_at_end for outcome in outcomes), len(outcomes)),
            dict(Counter(outcome.failure for outcome in outcomes if outcome.failure).most_common()),
            round(sum(times_s) / len(times_s), 2) if times_s else None,
        )

    def to_json(self) -> dict[str, Any]:
        """Returns the score as plain data."""
        rates = {"success_once": self.once.to_json(), "success_at_end": self.at_end.to_json()}
        return {**rates, "failures": self.failures, "mean_s": self.mean_s}


@dataclass(frozen=True, slots=True)
class PairedTest:
    """Two policies in the same episodes.

    Attributes:
        first, second: Their names.
        only_first, only_second: Episodes in which only that one succeeded, at some time.
        p: How likely a difference as large as this is where there is none (McNemar's test, exact).
    """

    first: str
    second: str
    only_first: int
    only_second: int
    p: float

    def to_json(self) -> dict[str, Any]:
        """Returns the comparison as plain data."""
        return asdict(self)


def paired_tests(found: Mapping[str, Sequence[EpisodeOutcome]]) -> tuple[PairedTest, ...]:
    """Returns each two policies compared.

    Args:
        found: Policy -> its episodes, of the same seeds in the same order.
    """
    tests = []
    for first, second in combinations(found, 2):
        pairs = [(a.success_once, b.success_once) for a, b in zip(found[first], found[second], strict=True)]
        one, other = pairs.count((True, False)), pairs.count((False, True))
        p = float(binomtest(one, one + other).pvalue) if one + other else 1.0
        tests.append(PairedTest(first, second, one, other, round(p, 4)))
    return tuple(tests)
