"""Counts of an evaluation, with exact intervals, and pairs of policies compared on the same episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from statistics import stdev
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
        monitors: What the executor's monitors saw in failed episodes -> in how many.
        mean_s: Simulated time of its successes; None without one.
        helped: In how many episodes the planner went on for it, and with_help how often that, or it alone, came to a
            success; None where no help was to be had.
    """

    once: Rate
    at_end: Rate
    failures: Mapping[str, int]
    monitors: Mapping[str, int]
    mean_s: float | None
    helped: int
    with_help: Rate | None

    @classmethod
    def of(cls, outcomes: Sequence[EpisodeOutcome]) -> PolicyScore:
        """Returns the score of episodes."""
        times_s = [outcome.simulated_s for outcome in outcomes if outcome.success_once]
        failed = [outcome for outcome in outcomes if not outcome.success_once]
        helped = [outcome.success_with_help for outcome in outcomes if outcome.success_with_help is not None]
        return cls(
            once=Rate(sum(outcome.success_once for outcome in outcomes), len(outcomes)),
            at_end=Rate(sum(outcome.success_at_end for outcome in outcomes), len(outcomes)),
            failures=dict(Counter(outcome.failure for outcome in failed).most_common()),
            monitors=dict(Counter(kind for outcome in failed for kind in outcome.monitors).most_common()),
            mean_s=round(sum(times_s) / len(times_s), 2) if times_s else None,
            helped=sum(bool(outcome.helped) for outcome in outcomes),
            with_help=Rate(sum(helped), len(helped)) if helped else None,
        )

    def to_json(self) -> dict[str, Any]:
        """Returns the score as plain data."""
        rates: dict[str, Any] = {"success_once": self.once.to_json(), "success_at_end": self.at_end.to_json()}
        if self.with_help is not None:
            rates |= {"success_with_help": self.with_help.to_json(), "helped": self.helped}
        return {**rates, "failures": self.failures, "monitors": self.monitors, "mean_s": self.mean_s}


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


@dataclass(frozen=True, slots=True)
class TrainingScore:
    """Policies that differ in nothing but the seed of their training, as one row.

    Attributes:
        names: Theirs.
        seeds: Of their training, in the order of the names.
        shares: Share of successes, at some time, of each.
        once: All their episodes together; they are of the same rooms, so that no more of them count as independent than
            there are rooms.
        spread: Standard deviation of the shares; None of a single one.
    """

    names: tuple[str, ...]
    seeds: tuple[int, ...]
    shares: tuple[float, ...]
    once: Rate
    spread: float | None

    def to_json(self) -> dict[str, Any]:
        """Returns the row as plain data."""
        told = {"policies": self.names, "seeds": self.seeds, "shares": self.shares, "spread": self.spread}
        return {**told, "success_once": self.once.to_json()}


def by_training(
    trained: Mapping[str, tuple[str, int]], found: Mapping[str, Sequence[EpisodeOutcome]]
) -> tuple[TrainingScore, ...]:
    """Returns the policies in rows of those that differ in their seed only, in the order of their first ones.

    Args:
        trained: Policy -> what it is but for its seed, as a key, and the seed.
        found: Policy -> its episodes.
    """
    rows: dict[str, list[str]] = {}
    for name in found:
        rows.setdefault(trained[name][0], []).append(name)
    scores = []
    for names in rows.values():
        good = [sum(outcome.success_once for outcome in found[name]) for name in names]
        counts = [len(found[name]) for name in names]
        shares = tuple(round(one / max(of, 1), 4) for one, of in zip(good, counts, strict=True))
        seeds = tuple(trained[name][1] for name in names)
        clusters = counts[0] if len(names) > 1 else None
        spread = round(stdev(shares), 4) if len(shares) > 1 else None
        scores.append(TrainingScore(tuple(names), seeds, shares, Rate(sum(good), sum(counts), clusters), spread))
    return tuple(scores)
