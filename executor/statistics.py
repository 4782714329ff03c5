"""Confidence intervals for success rates."""

from __future__ import annotations

from scipy.special import betaincinv


def clopper_pearson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Returns the exact two-sided confidence interval of a success probability.

    Args:
        successes: How many trials succeeded.
        trials: How many there were, at least one.
        confidence: Coverage that is guaranteed, in (0, 1).

    Raises:
        ValueError: When the numbers are not such.

    Source: Clopper and Pearson, Biometrika 26 (1934); the bounds are quantiles of beta distributions.
    """
    if trials < 1 or not 0 <= successes <= trials or not 0.0 < confidence < 1.0:
        raise ValueError(f"no interval for {successes} successes in {trials} trials at confidence {confidence}")
    tail = (1.0 - confidence) / 2.0
    low = 0.0 if successes == 0 else float(betaincinv(successes, trials - successes + 1, tail))
    high = 1.0 if successes == trials else float(betaincinv(successes + 1, trials - successes, 1.0 - tail))
    return low, high
