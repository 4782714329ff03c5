"""Whether the measured probabilities of a certificate follow from the counts beside them.

Part of the independent check. The bound is sought in the tail of the binomial distribution, which it is defined by;
what writes certificates takes it from quantiles of the beta distribution.

Source: docs/semantics.md, Measured evidence.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from oag.checker.cases import Rejected, require

KIND = "success-probability"
METHOD = "Clopper-Pearson, one-sided"
CHAIN = "chain"
# What a probability speaks of, by what the trials were conditioned on.
MEANINGS = {
    CHAIN: "runs of the whole plan from its start; each subtask was tried where the one before succeeded",
    "saved_state": "each subtask tried apart from one saved state, not from every state that meets its init",
    "pool": "each subtask tried apart from a pool of states, as they happened to be drawn",
}
_KEYS = frozenset(
    ("kind", "conditioning", "speaks_of", "counts", "estimate", "lower_bound", "confidence", "choices", "method")
)
_TOLERANCE = 1e-9
# Terms that are summed up for a bound grow with the root of the trials: this is some seconds.
MOST_TERMS = 30_000
# Halvings of the interval in which a bound is sought, down to what a float tells apart.
_HALVINGS = 60


def check_evidence(slots: Any) -> None:
    """Checks the list of measured probabilities.

    Raises:
        Rejected: One has another form, was not measured as it says, or claims more than its counts show.
    """
    require(type(slots) is list, "its evidence is no list")
    left = MOST_TERMS
    for slot in slots:
        require(type(slot) is dict and slot.keys() == _KEYS, f"no evidence has this form: {slot!r:.80}")
        require(slot["kind"] == KIND and slot["method"] == METHOD, "evidence of another kind cannot be checked")
        meaning = MEANINGS.get(slot["conditioning"]) if type(slot["conditioning"]) is str else None
        require(meaning is not None, f"no trials are conditioned on {slot['conditioning']!r}")
        require(slot["speaks_of"] == meaning, f"the evidence speaks of {meaning}")
        _check_counts(slot["counts"], chain=slot["conditioning"] == CHAIN)
        left -= sum(1 + math.isqrt(trials) for _, trials in slot["counts"])
        require(left >= 0, "the counts are too many, or too large, for their bound to be computed")
        _check_numbers(slot)


def _check_numbers(slot: dict[str, Any]) -> None:
    counts, choices, confidence = slot["counts"], slot["choices"], slot["confidence"]
    require(type(choices) is int and choices >= 1, "a flow is chosen among one or more")
    require(type(confidence) is float and 0.0 < confidence < 1.0, "a confidence is between 0 and 1")
    if slot["conditioning"] == CHAIN:
        counts = [(counts[-1][0], counts[0][1])]
    error = (1.0 - confidence) / (len(counts) * choices)
    estimate = math.prod(successes / trials for successes, trials in counts)
    for key in ("estimate", "lower_bound"):
        require(type(slot[key]) in (float, int) and 0.0 <= slot[key] <= 1.0, f"the {key} is no probability")
    if not math.isclose(slot["estimate"], estimate, abs_tol=_TOLERANCE):
        raise Rejected(f"the counts give the estimate {estimate:g}, not {slot['estimate']:g}")
    lower = math.prod(_lower_bound(successes, trials, error) for successes, trials in counts)
    if slot["lower_bound"] > lower + _TOLERANCE:
        raise Rejected(f"the counts show no more than {lower:g}, not {slot['lower_bound']:g}")


def _check_counts(counts: Any, *, chain: bool) -> None:
    """Checks that counts are possible, and that those of a chain go on where the ones before succeeded."""
    require(type(counts) is list and bool(counts), "there are no counts")
    for count in counts:
        require(type(count) is list and [type(number) for number in count] == [int, int], f"{count!r} is no count")
        successes, trials = count
        require(trials >= 1 and 0 <= successes <= trials, f"{successes} successes in {trials} trials cannot be")
    if chain:
        require(all(after[1] == before[0] for before, after in pairwise(counts)), "the counts are no chain")


def _lower_bound(successes: int, trials: int, error: float) -> float:
    """Returns the largest probability with which at least so many successes are as unlikely as the error allows."""
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS if successes else 0):
        middle = (low + high) / 2.0
        if _tail(successes, trials, middle) <= error:
            low = middle
        else:
            high = middle
    return low


def _tail(successes: int, trials: int, probability: float) -> float:
    """Returns how probable at least so many successes are: the sum of the shorter side, its largest term first."""
    upward = probability * trials <= successes
    count = successes if upward else successes - 1
    odds = probability / (1.0 - probability)
    term, total = _exactly(count, trials, probability), 0.0
    while term > total * 1e-17 and 0 <= count <= trials:
        total += term
        term *= (trials - count) / (count + 1) * odds if upward else count / ((trials - count + 1) * odds)
        count += 1 if upward else -1
    return total if upward else 1.0 - total


def _exactly(count: int, trials: int, probability: float) -> float:
    ways = math.lgamma(trials + 1) - math.lgamma(count + 1) - math.lgamma(trials - count + 1)
    return math.exp(ways + count * math.log(probability) + (trials - count) * math.log1p(-probability))
