"""How exactly a thing's place is known where nothing but its box in the picture tells it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from executor.geometry import Array
from executor.photo.fitting.body import Guess
from executor.photo.fitting.likelihood import Likelihood

_STEPS = np.array([0.02, 0.02, 0.05, 0.01, 0.01, 0.01])  # Metres and radians, over which costs are about quadratic.
_LOOSEST = 1e-3  # Of the sharpest direction: what is looser is not known at all.
_MOST_M = 1.0


def place_spread_m(likelihood: Likelihood, guess: Guess, scale_share: float) -> float:
    """Returns the standard deviation of a thing's place on the floor, in its worst direction.

    By how costs grow around the guess (Laplace's approximation): where a bit farther off and a bit larger is as good,
    the place is not known well. Colours are left out, which make it sharper than it is.

    Args:
        likelihood: What the guess was judged by.
        guess: The guess.
        scale_share: How exactly the scale of the picture is known, as a share.
    """
    count = len(_STEPS)
    here = likelihood.box_cost(guess)
    single = np.array([[_moved(likelihood, guess, {i: sign}) for sign in (-1.0, 1.0)] for i in range(count)])
    curved = np.zeros((count, count))
    for i in range(count):
        curved[i, i] = single[i, 0] + single[i, 1] - 2 * here
        for j in range(i):
            both = _moved(likelihood, guess, {i: 1.0, j: 1.0})
            curved[i, j] = curved[j, i] = both - single[i, 1] - single[j, 1] + here
    values, axes = np.linalg.eigh(np.nan_to_num(curved, posinf=1e6, neginf=0.0))
    variances = 1.0 / np.maximum(values, max(_LOOSEST * float(values.max()), 1e-9))
    covariance = (axes * variances) @ axes.T * np.outer(_STEPS, _STEPS)
    worst = math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[:2, :2]).max())))
    return min(_MOST_M, math.hypot(worst, scale_share * math.hypot(guess.x_m, guess.y_m)))


def _moved(likelihood: Likelihood, guess: Guess, steps: dict[int, float]) -> float:
    by: Array = np.zeros(len(_STEPS))
    for index, sign in steps.items():
        by[index] = sign * _STEPS[index]
    length, width, height = guess.size_m
    size = length + float(by[3]), width + float(by[4]), height + float(by[5])
    one = replace(guess, x_m=guess.x_m + by[0], y_m=guess.y_m + by[1], yaw_rad=guess.yaw_rad + by[2], size_m=size)
    return likelihood.box_cost(one)
