"""How a thing is turned that only an ear tells; where the ear is hidden, the middle of the turns that hide it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from executor.assets.library import asset_for
from executor.photo.fitting.body import Guess
from executor.photo.fitting.descent import descended
from executor.photo.fitting.likelihood import Likelihood, RatedGuess

_TURNS = 24
_SAME = 8.0  # So much more in cost makes a turn e times less likely.
_FOLLOWED, _RENDERINGS = 8, 60


def turned_by_ear(fine: Likelihood, found: RatedGuess) -> RatedGuess:
    """Returns a thing turned as its ear is seen; as far between all turns that hide it as they are alike.

    Its body stays where it is.

    Args:
        fine: What guesses are judged by, with all pixels.
        found: The thing, turned somehow.
    """
    begun = sorted([found, *_all_around(fine, found.guess)], key=lambda one: one.cost)[:_FOLLOWED]
    ended = (fine.rated(descended(fine, one.guess, _RENDERINGS, colours=True, reach=0.5)) for one in begun)
    best = min([found, *ended], key=lambda one: one.cost)
    turns = [best, *_all_around(fine, best.guess)]
    likely = np.array([math.exp(min(0.0, (best.cost - one.cost) / _SAME)) for one in turns])
    yaws = np.array([one.guess.yaw_rad for one in turns])
    # Of what is seen clearly, hardly any other turn counts, and the mean is where it was.
    mean_rad = math.atan2(float(likely @ np.sin(yaws)), float(likely @ np.cos(yaws)))
    middle = fine.rated(_turned(best.guess, mean_rad))
    return middle if middle.cost < best.cost + _SAME else best


def _all_around(fine: Likelihood, guess: Guess) -> list[RatedGuess]:
    steps = np.arange(1, _TURNS) * 2.0 * math.pi / _TURNS
    return [fine.rated(_turned(guess, guess.yaw_rad + float(step))) for step in steps]


def _turned(guess: Guess, yaw_rad: float) -> Guess:
    """Turned about the axis of its body, which an ear keeps from the middle of the box."""
    x, y, _ = asset_for(guess.as_object()).grasp_point_m
    before, after = guess.yaw_rad, math.remainder(yaw_rad, 2.0 * math.pi)
    at_x = guess.x_m + x * (math.cos(before) - math.cos(after)) - y * (math.sin(before) - math.sin(after))
    at_y = guess.y_m + x * (math.sin(before) - math.sin(after)) + y * (math.cos(before) - math.cos(after))
    return replace(guess, x_m=at_x, y_m=at_y, yaw_rad=after)
