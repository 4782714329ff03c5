"""Measured success probabilities: counts of rollouts, their conditioning, and a confidence bound.

A certificate proves that a plan reaches its goal under intended outcomes. It does not say how often these occur.
Evidence is measured and stands next to the verdict in a certificate, never in it:

    evidence = oag.chain_evidence([(20, 20), (20, 20), (9, 20), (8, 9)])
    certificate = certificate.with_evidence(evidence.to_json())

Source: docs/semantics.md, Measured evidence.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from math import prod
from numbers import Integral
from typing import NamedTuple

from oag.certificate.check import KIND, MEANINGS, METHOD
from oag.model.diagnostics import EvidenceError


def clopper_pearson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the exact two-sided confidence interval of a success probability.

    Args:
        successes: How many trials succeeded.
        trials: How many there were, at least one.
        confidence: Coverage that is guaranteed, in (0, 1).

    Raises:
        EvidenceError: When the numbers are not such; it is a ValueError.
    """
    if not 0.0 < confidence < 1.0:
        raise EvidenceError(f"expected a confidence between 0 and 1, such as 0.95, got {confidence:g}")
    tail = (1.0 - confidence) / 2.0
    return lower_bound(successes, trials, tail), 1.0 - lower_bound(trials - successes, trials, tail)


def lower_bound(successes: int, trials: int, alpha: float = 0.05) -> float:
    """Return the exact one-sided lower confidence bound: the true probability is below it in at most `alpha` of cases.

    Args:
        successes: How many trials succeeded; with none the bound is 0.
        trials: How many there were, at least one.
        alpha: The error that is allowed, in (0, 1).

    Raises:
        EvidenceError: When the numbers are not such; it is a ValueError.
    """
    _check_whole(successes, trials)
    if trials < 1 or not 0 <= successes <= trials or not 0.0 < alpha < 1.0:
        raise EvidenceError(f"no interval for {successes} successes in {trials} trials with an error of {alpha:g}")
    if successes == 0:
        return 0.0
    # scipy takes as long to import as all of this package, and only measurements need it.
    from scipy.special import betaincinv

    return float(betaincinv(successes, trials - successes + 1, alpha))


def is_whole(number: object) -> bool:
    """Decide whether a value is a whole number, numpy's included; truth values are not."""
    return isinstance(number, Integral) and not isinstance(number, bool)


def _check_whole(successes: object, trials: object) -> None:
    if not (is_whole(successes) and is_whole(trials)):
        raise EvidenceError(f"expected whole numbers of successes and trials, got {successes!r} and {trials!r}")


class Conditioning(Enum):
    """Start states of a subtask's trials; they decide what the counts are evidence of."""

    CHAIN = "chain"
    SAVED_STATE = "saved_state"
    POOL = "pool"

    @property
    def meaning(self) -> str:
        """Meaning of a probability measured under this conditioning, in words."""
        return MEANINGS[self.value]


class Count(NamedTuple):
    """How often one subtask, or a whole plan, succeeded in how many trials."""

    successes: int
    trials: int


@dataclass(frozen=True, slots=True)
class Evidence:
    """A measured success probability of a plan.

    Attributes:
        conditioning: What the trials started from.
        counts: For each subtask in order; one count of whole runs will do for a chain.
        alpha: The error that the bound allows, for all choices together.
        choices: Number of flows among which these trials chose the measured one; 1 for a fixed plan.
        estimate: The plain rate: the product of the subtasks' rates.
        lower: The lower confidence bound; 0 when any subtask never succeeded.
    """

    conditioning: Conditioning
    counts: tuple[Count, ...]
    alpha: float
    choices: int
    estimate: float
    lower: float

    def to_json(self) -> dict[str, object]:
        """Return the evidence slot of a certificate, as JSON values."""
        return {
            "kind": KIND,
            "conditioning": self.conditioning.value,
            "speaks_of": self.conditioning.meaning,
            "counts": [list(count) for count in self.counts],
            "estimate": self.estimate,
            "lower_bound": self.lower,
            "confidence": 1.0 - self.alpha,
            "choices": self.choices,
            "method": METHOD,
        }

    def __str__(self) -> str:
        counts = ", ".join(f"{count.successes}/{count.trials}" for count in self.counts)
        return (
            f"{self.estimate:.3f}, at least {self.lower:.3f} with confidence {1.0 - self.alpha:g} "
            f"({counts}; {self.conditioning.value})"
        )


def chain_evidence(counts: Iterable[tuple[int, int]], *, alpha: float = 0.05, choices: int = 1) -> Evidence:
    """Return the evidence of runs of a whole plan: each subtask was tried as often as the one before succeeded.

    The product of the subtasks' rates telescopes to the last successes over the first trials. So one bound on these two
    numbers covers the whole plan.

    Args:
        counts: (successes, trials) for each subtask in order.
        alpha: The error that is allowed.
        choices: Number of flows among which these trials chose this one; the error is divided by it.

    Raises:
        EvidenceError: The counts are none, are impossible, or do not chain.

    Example:
        >>> round(chain_evidence([(20, 20), (20, 20), (9, 20), (8, 9)]).lower, 3)
        0.217
    """
    listed = _checked(counts, alpha, choices, chain=True)
    for number, (before, after) in enumerate(pairwise(listed), start=2):
        if after.trials != before.successes:
            tried = f"subtask {number} was tried {after.trials} times, but the one before succeeded {before.successes}"
            why = "that is no chain of whole runs; pooled_evidence is for subtasks tried apart"
            raise EvidenceError(f"{tried} times: {why}")
    succeeded, runs = listed[-1].successes, listed[0].trials
    lower = lower_bound(succeeded, runs, alpha / choices)
    return Evidence(Conditioning.CHAIN, listed, alpha, choices, succeeded / runs, lower)


def pooled_evidence(
    counts: Iterable[tuple[int, int]],
    conditioning: Conditioning = Conditioning.SAVED_STATE,
    *,
    alpha: float = 0.05,
    choices: int = 1,
) -> Evidence:
    """Return the evidence of trials of single subtasks for the whole plan: a product of bounds that share the error.

    It is far weaker than a chain of the same counts, and holds only for the start states of the trials.

    Args:
        counts: (successes, trials) for each subtask in order.
        conditioning: Where the trials started: one saved state, or a pool of states.
        alpha: The error that is allowed, for all subtasks together.
        choices: Number of flows among which these trials chose each one; the error is divided by it.

    Raises:
        EvidenceError: The counts are none or impossible, or the conditioning is that of a chain.
    """
    if conditioning is Conditioning.CHAIN:
        raise EvidenceError("trials of single subtasks are no chain: use chain_evidence for runs of the whole plan")
    listed = _checked(counts, alpha, choices, chain=False)
    share = alpha / (len(listed) * choices)
    estimate = prod(count.successes / count.trials for count in listed)
    lower = prod(lower_bound(count.successes, count.trials, share) for count in listed)
    return Evidence(conditioning, listed, alpha, choices, estimate, lower)


def _checked(counts: Iterable[tuple[int, int]], alpha: float, choices: int, *, chain: bool) -> tuple[Count, ...]:
    """Return the counts; of a chain, those up to the first subtask that never succeeded.

    Raises:
        EvidenceError: The counts are none or impossible, or the error or the number of choices is.
    """
    listed: list[Count] = []
    for successes, trials in counts:
        _check_whole(successes, trials)
        if chain and listed and listed[-1].successes == 0 and successes == trials == 0:
            continue
        if trials < 1 or not 0 <= successes <= trials:
            raise EvidenceError(f"{successes} successes in {trials} trials cannot be")
        listed.append(Count(int(successes), int(trials)))
    if not listed:
        raise EvidenceError("there are no counts, so there is nothing to conclude from")
    if not is_whole(choices) or choices < 1 or not 0.0 < alpha < 1.0:
        raise EvidenceError(f"expected at least 1 choice and an error between 0 and 1, got {choices!r} and {alpha:g}")
    return tuple(listed)
