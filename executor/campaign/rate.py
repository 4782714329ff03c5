"""Success rate with its exact interval."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor

from oag.measurements import clopper_pearson


def number(percent: float) -> str:
    """Return a percentage with one decimal, or none where it is whole, as in the paper."""
    return f"{percent:.1f}".removesuffix(".0")


@dataclass(frozen=True, slots=True)
class Rate:
    """Success rate with the exact 95 % interval (Clopper-Pearson).

    Attributes:
        successes: Number of successes.
        trials: Number of trials.
        clusters: Number of independent trials, where several repeat one layout and so succeed or fail together; None
            when all are independent. The interval is then that of so many trials, each with the share of its
            repetitions that succeeded, rounded to whole successes away from the rate at both ends.
    """

    successes: int
    trials: int
    clusters: int | None = None

    @property
    def percent(self) -> float | None:
        """The plain rate in percent; None without trials."""
        return 100.0 * self.successes / self.trials if self.trials else None

    @property
    def interval_percent(self) -> tuple[float, float] | None:
        """The interval in percent; None without trials."""
        if not self.trials:
            return None
        trials = self.trials if self.clusters is None else self.clusters
        shares = Fraction(self.successes * trials, self.trials)
        low, high = clopper_pearson(floor(shares), trials)[0], clopper_pearson(ceil(shares), trials)[1]
        return 100.0 * low, 100.0 * high

    def __str__(self) -> str:
        interval = self.interval_percent
        if self.percent is None or interval is None:
            return "no trials"
        of = "" if self.clusters is None else f", by {self.clusters} layouts"
        share = f"{self.successes} of {self.trials}, {number(self.percent)} %"
        return f"{share} ({interval[0]:.1f} to {interval[1]:.1f}{of})"

    def counted(self, what: str) -> str:
        """Return the counts with the interval, such as "12 of 12 succeeded (73.5 to 100.0 %)"."""
        low, high = self.interval_percent or (0.0, 100.0)
        return f"{self.successes} of {self.trials} {what} ({low:.1f} to {high:.1f} %)"

    def to_json(self) -> dict[str, object]:
        """Return the rate as plain data."""
        return {
            "successes": self.successes,
            "trials": self.trials,
            "clusters": self.clusters,
            "percent": self.percent,
            "interval_95_percent": self.interval_percent,
        }
