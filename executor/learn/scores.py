"""Scores of an evaluation: exact intervals, paired tests, and the HTML page, which needs no network."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from statistics import stdev
from typing import Any

from scipy.stats import binomtest

from executor.campaign.rate import Rate
from executor.learn.evaluation import EpisodeOutcome
from executor.reports.html import render


@dataclass(frozen=True, slots=True)
class PolicyScore:
    """Score of a policy.

    Attributes:
        once, at_end: Rates of success at some time, and still 3 s later.
        failures: Kind of failure -> its number, the most frequent first.
        monitors: Failure kind of the executor's monitors -> number of failed episodes with it.
        mean_s: Mean simulated time of its successes [s]; None without one.
    """

    once: Rate
    at_end: Rate
    failures: Mapping[str, int]
    monitors: Mapping[str, int]
    mean_s: float | None

    @classmethod
    def of(cls, outcomes: Sequence[EpisodeOutcome]) -> PolicyScore:
        """Return the score of episodes."""
        times_s = [outcome.simulated_s for outcome in outcomes if outcome.success_once]
        failed = [outcome for outcome in outcomes if not outcome.success_once]
        return cls(
            once=Rate(sum(outcome.success_once for outcome in outcomes), len(outcomes)),
            at_end=Rate(sum(outcome.success_at_end for outcome in outcomes), len(outcomes)),
            failures=dict(Counter(outcome.failure for outcome in failed).most_common()),
            monitors=dict(Counter(kind for outcome in failed for kind in outcome.monitors).most_common()),
            mean_s=round(sum(times_s) / len(times_s), 2) if times_s else None,
        )

    def to_json(self) -> dict[str, Any]:
        """Return the score as plain data."""
        rates = {"success_once": self.once.to_json(), "success_at_end": self.at_end.to_json()}
        return {**rates, "failures": self.failures, "monitors": self.monitors, "mean_s": self.mean_s}


@dataclass(frozen=True, slots=True)
class PairedTest:
    """Comparison of two policies in the same episodes.

    Attributes:
        first, second: Their names.
        only_first, only_second: Number of episodes in which only that one succeeded, at some time.
        p: Probability of a difference as large as this without an effect (McNemar's test, exact).
    """

    first: str
    second: str
    only_first: int
    only_second: int
    p: float

    def to_json(self) -> dict[str, Any]:
        """Return the comparison as plain data."""
        return asdict(self)


def paired_tests(found: Mapping[str, Sequence[EpisodeOutcome]]) -> tuple[PairedTest, ...]:
    """Compare each two policies.

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
    """Policies that differ only in the seed of their training, as one row.

    Attributes:
        seeds: Seeds of their training, in the order of the names.
        shares: Success rate, at some time, of each.
        once: All their episodes together; they share rooms, so that no more of them count as independent than there are
            rooms.
        spread: Standard deviation of the rates; None for a single one.
    """

    names: tuple[str, ...]
    seeds: tuple[int, ...]
    shares: tuple[float, ...]
    once: Rate
    spread: float | None

    def to_json(self) -> dict[str, Any]:
        """Return the row as plain data."""
        data = {"policies": self.names, "seeds": self.seeds, "shares": self.shares, "spread": self.spread}
        return {**data, "success_once": self.once.to_json()}


def by_training(
    trained: Mapping[str, tuple[str, int]], found: Mapping[str, Sequence[EpisodeOutcome]]
) -> tuple[TrainingScore, ...]:
    """Group policies that differ only in the seed of training, in the order of their first ones.

    Args:
        trained: Policy -> its key without the seed, and the seed.
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


@dataclass(frozen=True, slots=True)
class Curve:
    """A line of a diagram.

    Attributes:
        points: Step of training and value, by rising steps.
        bands: Minimum and maximum of an interval at each of the steps; empty for none.
    """

    name: str
    points: tuple[tuple[float, float], ...]
    bands: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class FailedEpisode:
    """An episode in which a policy did not succeed.

    Attributes:
        policy, seed: Which.
        kind: Kind of its failure.
        video: Address of its video, as seen from the page; empty without one.
    """

    policy: str
    seed: int
    kind: str
    video: str = ""


@dataclass(frozen=True, slots=True)
class EvaluationReport:
    """Content of an evaluation's page.

    Attributes:
        trainings: Policies that differ only in their seed, as rows.
        losses, successes: Curves over the steps of training.
        failed: The failures, policy by policy.
        view: Command that shows all episodes; empty where no results are kept.
    """

    what: str
    scores: Mapping[str, PolicyScore]
    trainings: Sequence[TrainingScore]
    tests: Sequence[PairedTest]
    losses: Sequence[Curve]
    successes: Sequence[Curve]
    failed: Sequence[FailedEpisode]
    view: str = ""


def evaluation_page(report: EvaluationReport) -> str:
    return render(
        "evaluation.html",
        report=report,
        rate_words=rate_words,
        diagrams=[
            (heading, _drawing(curves, top))
            for heading, curves, top in (("Loss", report.losses, None), ("Success", report.successes, 1.0))
            if curves
        ],
    )


def _drawing(curves: Sequence[Curve], top: float | None) -> dict[str, object]:
    last = max((step for curve in curves for step, _ in curve.points), default=1.0)
    most = max((value for curve in curves for _, value in curve.points), default=1.0)
    return {"curves": curves, "last": last or 1.0, "most": top or most or 1.0}


def loss_curve(name: str, lines: Iterable[str]) -> Curve | None:
    """Return the curve of a training's log; None where it has no numbers."""
    points = []
    for line in lines:
        try:
            entry: Any = json.loads(line)
            points.append((float(entry["step"]), float(entry["loss"])))
        except (ValueError, KeyError, TypeError, RecursionError):
            continue
    return Curve(name, tuple(sorted(points))) if points else None


def success_curve(name: str, scores: Mapping[int, Rate]) -> Curve:
    """Return the curve of success over the steps of training."""
    steps = sorted(scores)
    bands = tuple(scores[step].interval_percent or (0.0, 100.0) for step in steps)
    points = tuple((float(step), scores[step].successes / max(scores[step].trials, 1)) for step in steps)
    return Curve(name, points, tuple((low / 100.0, high / 100.0) for low, high in bands))


def rate_words(rate: Rate) -> str:
    low, high = rate.interval_percent or (0.0, 100.0)
    return f"{rate.successes} of {rate.trials} ({low:.1f} to {high:.1f} %)"
