"""From unit results to the numbers of a table: rates, exact intervals, the paper's subtask-level score, throughput."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor
from statistics import fmean, median
from typing import Any

from executor.bench.units import Series
from executor.primitives.monitors import DISPLACED_M, TIPPED_DEG
from executor.scenes.household import VARIATIONS
from oag import clopper_pearson

Result = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Rate:
    """How often something succeeded, with the exact 95 % interval (Clopper-Pearson).

    Attributes:
        successes: Of the trials.
        trials: How many.
        clusters: How many of the trials are independent, where several repeat one layout and so succeed or fail
            together; None when all are. The interval is then that of so many trials, each with the share of its
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

    def to_json(self) -> dict[str, object]:
        """Returns the rate as plain data."""
        return {
            "successes": self.successes,
            "trials": self.trials,
            "clusters": self.clusters,
            "percent": self.percent,
            "interval_95_percent": self.interval_percent,
        }


@dataclass(frozen=True, slots=True)
class Cell:
    """One family in one setting: what its units came to.

    Attributes:
        series: What was asked for.
        results: The units that are done, in order.
    """

    series: Series
    results: Sequence[Result]

    @property
    def all(self) -> Rate:
        """Successes among all units that are done."""
        return _rate(self.results)

    @property
    def failed(self) -> list[Result]:
        """The units that did not succeed."""
        return [result for result in self.results if not _succeeded(result)]

    @property
    def reasons(self) -> dict[str, int]:
        """Kind of failure -> how often it ended a unit, the most frequent first."""
        counted = Counter(result["failure"]["kind"] if result.get("failure") else "unknown" for result in self.failed)
        return dict(counted.most_common())

    @property
    def by_mistake(self) -> dict[str, Rate]:
        """Kind of mistake -> success of the units whose plan has one; none where plans are right."""
        kinds = sorted({result["mistake"] for result in self.results if result.get("mistake")})
        return {kind: _rate([r for r in self.results if r.get("mistake") == kind]) for kind in kinds}

    @property
    def simulated_in_vain_s(self) -> float:
        """Simulated seconds of the units that failed."""
        return float(sum(result.get("simulated_s", 0.0) for result in self.failed))

    @property
    def subtasks(self) -> list[Rate]:
        """For each subtask in order, how often it succeeded among the units that reached it."""
        return subtask_rates(self.results)

    @property
    def subtask_score(self) -> float | None:
        """The paper's Subtask-Level Score in percent: the mean over subtasks of their conditional success rate."""
        return subtask_score(self.results)

    @property
    def scales(self) -> tuple[float, float] | None:
        """The least and the greatest factor by which what was taken was scaled; None where nothing was taken yet."""
        least = [
            min((min(change["factors"]) for change in r["scaled"]), default=1.0) for r in self.results if "scaled" in r
        ]
        return (min(least), max(least)) if least else None

    @property
    def taken_twice(self) -> int:
        """Units in which a thing was set down and taken again, a plan that the rollout had found after a first one."""
        return sum(bool(result.get("taken_twice")) for result in self.results)

    @property
    def bystanders_moved_m(self) -> float | None:
        """How far the things that nothing was to be done with moved at most; None where it was not measured."""
        return max(
            (result["bystanders_moved_m"] for result in self.results if "bystanders_moved_m" in result), default=None
        )

    @property
    def busy_s(self) -> float:
        """Wall time in which at least one unit was worked on; pauses between runs do not count."""
        return busy_s(self.results)

    @property
    def demos_per_hour(self) -> float | None:
        """Successful episodes an hour of wall time, all processes together."""
        return 3600.0 * self.all.successes / self.busy_s if self.busy_s > 0.0 else None

    def to_json(self) -> dict[str, object]:
        """Returns the cell as plain data."""
        return {
            **self.series.to_json(),
            "label": self.series.setting.label,
            "finished": len(self.results),
            "all": self.all.to_json(),
            "subtasks": [rate.to_json() for rate in self.subtasks],
            "subtask_score_percent": self.subtask_score,
            "reasons": self.reasons,
            "scales": self.scales,
            "taken_twice": self.taken_twice,
            "bystanders": {
                "moved_at_most_m": self.bystanders_moved_m,
                "a_failure_from_m": DISPLACED_M,
                "or_tipped_by_deg": TIPPED_DEG,
            },
            "demos_per_hour": self.demos_per_hour,
            "busy_s": self.busy_s,
            "times_s": {part: _spread(values) for part, values in self._times().items()},
            "memory": memory_growth(self.results),
            "penetration": self._penetration(),
            "peaks": self._peaks(),
            "simulated_in_vain_s": self.simulated_in_vain_s,
            "mistakes": {kind: rate.to_json() for kind, rate in self.by_mistake.items()},
            **self._evolution(),
        }

    def _times(self) -> dict[str, list[float]]:
        parts: dict[str, list[float]] = {"elapsed": [r["elapsed_s"] for r in self.results if "elapsed_s" in r]}
        for result in self.results:
            for part, seconds in result.get("wall_s", {}).items():
                parts.setdefault(part, []).append(seconds)
        parts["simulated"] = [result["simulated_s"] for result in self.results if "simulated_s" in result]
        return parts

    def _penetration(self) -> dict[str, object] | None:
        """How deep bodies overlapped: the largest of the episodes' 99th percentiles, and the deepest overlap of all."""
        told = [result["penetration"] for result in self.results if "penetration" in result]
        if not told:
            return None
        deepest = max(told, key=lambda figures: figures["deepest_m"])
        return {
            "episodes": len(told),
            "largest_p99_mm": 1000.0 * max(figures["p99_m"] for figures in told),
            "deepest_mm": 1000.0 * deepest["deepest_m"],
            "deepest_pair": deepest["pair"],
        }

    def _peaks(self) -> dict[str, float]:
        """The most that any episode asked of the robot, by the names of `executor.records.rollout.Peaks`."""
        told = [result.get("peaks", {}) for result in self.results]
        return {
            name: max(row.get(name, 0.0) for row in told) for name in sorted({name for row in told for name in row})
        }

    def _evolution(self) -> dict[str, object]:
        told = [result for result in self.results if "revisions" in result]
        if not told:
            return {}
        solved = [result["revisions"] for result in told if _succeeded(result)]
        return {
            "at_once": Rate(sum(bool(result["succeeded_at_once"]) for result in told), len(told)).to_json(),
            "revisions_of_successes_mean": fmean(solved) if solved else None,
        }


def subtask_rates(results: Sequence[Result]) -> list[Rate]:
    """Returns for each subtask how often it succeeded among the units that reached it.

    A unit reaches a subtask when all before it succeeded; the first is always reached, a unit whose process died in
    it included. Units with fewer subtasks count for those that they have.
    """
    longest = max((len(_names(result)) for result in results), default=0)
    rates = []
    for k in range(longest):
        reached = [r for r in results if len(_names(r)) > k and _done(r) >= k]
        rates.append(Rate(sum(_done(r) > k for r in reached), len(reached)))
    return rates


def subtask_score(results: Sequence[Result]) -> float | None:
    """Returns the mean over subtasks of their conditional success rates [%]; one never reached counts 0."""
    rates = subtask_rates(results)
    return fmean(rate.percent or 0.0 for rate in rates) if rates else None


def busy_s(results: Sequence[Result]) -> float:
    """Returns the length of the union of the intervals in which units were worked on."""
    spans = sorted((r["started_s"], r["started_s"] + r["elapsed_s"]) for r in results if "started_s" in r)
    total, until = 0.0, float("-inf")
    for start, end in spans:
        total += max(0.0, end - max(start, until))
        until = max(until, end)
    return total


def memory_growth(results: Sequence[Result]) -> dict[str, object] | None:
    """Returns how the memory of the process that ran the most units grew after its warm-up, or None.

    The first ten units, or a tenth where there are fewer than a hundred, warm up caches of libraries.
    """
    longest = of_one_process(results)
    if not longest:
        return None
    warm = longest[min(10, len(longest) // 10) :]
    first, last = warm[0]["rss_mb"], warm[-1]["rss_mb"]
    return {
        "units_in_one_process": len(longest),
        "after_warm_up_mb": first,
        "at_the_end_mb": last,
        "growth_percent": 100.0 * (last / first - 1.0),
        "peak_mb": max(result["peak_rss_mb"] for result in longest),
    }


def of_one_process(results: Sequence[Result]) -> list[Result]:
    """Returns the results of the process that ran the most units, in the order in which it ran them."""
    by_worker: dict[int, list[Result]] = {}
    for result in sorted((r for r in results if "rss_mb" in r), key=lambda r: r["started_s"]):
        by_worker.setdefault(result["worker"], []).append(result)
    return max(by_worker.values(), key=len, default=[])


def _rate(results: Sequence[Result]) -> Rate:
    """T5 and T6 repeat the same layouts, within a set and from set to set, with other models, sizes and places."""
    rooms = {result["index"] // VARIATIONS for result in results if result.get("index") is not None}
    repeated = 0 < len(rooms) < len(results)
    return Rate(sum(_succeeded(result) for result in results), len(results), len(rooms) if repeated else None)


def _succeeded(result: Result) -> bool:
    return bool(result["ended"] == "succeeded")


def _names(result: Result) -> Sequence[str]:
    """A unit that never came to its task still has one subtask that it did not get done."""
    return result.get("subtask_names") or ["?"]


def _done(result: Result) -> int:
    """How many subtasks succeeded before the first that did not."""
    count = 0
    for subtask in result.get("subtasks", ()):
        if not subtask["succeeded"]:
            break
        count += 1
    return count


def _spread(values: Sequence[float]) -> dict[str, float] | None:
    if not values:
        return None
    return {"mean": fmean(values), "median": median(values), "largest": max(values), "total": sum(values)}
