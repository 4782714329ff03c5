"""Exact confidence bounds for a probability of which successes were counted.

Source: Clopper and Pearson, Biometrika 26 (1934); the bounds are quantiles of beta distributions.
"""

from __future__ import annotations

from numbers import Integral

from oag.errors import EvidenceError


def clopper_pearson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Returns the exact two-sided confidence interval of a success probability.

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
    """Returns the exact one-sided lower confidence bound: the true probability is below it in at most `alpha` of cases.

    Args:
        successes: How many trials succeeded; with none the bound is 0.
        trials: How many there were, at least one.
        alpha: The error that is allowed, in (0, 1).

    Raises:
        EvidenceError: When the numbers are not such; it is a ValueError.
    """
    if not (is_whole(successes) and is_whole(trials)):
        raise EvidenceError(f"expected whole numbers of successes and trials, got {successes!r} and {trials!r}")
    if trials < 1 or not 0 <= successes <= trials or not 0.0 < alpha < 1.0:
        raise EvidenceError(f"no interval for {successes} successes in {trials} trials with an error of {alpha:g}")
    if successes == 0:
        return 0.0
    # scipy takes as long to import as all of this package, and only measurements need it.
    from scipy.special import betaincinv

    return float(betaincinv(successes, trials - successes + 1, alpha))


def is_whole(number: object) -> bool:
    """True for a whole number, one of numpy's included; truth values are none."""
    return isinstance(number, Integral) and not isinstance(number, bool)
