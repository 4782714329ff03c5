"""What has no sides and an ear, such as a mug: turned as its ear is seen, and where that is hidden, between all turns
that hide it.

Of a mug's pixels few are of the ear, and where the body is a little too large or too near, its outline costs as much as
the ear does. So a search for turns is one for the body as well, begun again from other sizes as long as that gains.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from executor.photo.fitting.body import Guess, Size, body_middle_m, body_of
from executor.photo.fitting.descent import descended
from executor.photo.fitting.likelihood import Likelihood, RatedGuess

_TURNS = 24  # Of the circle, in which an ear is looked for.
_ALIKE = 6.0  # So much more in cost makes a turn e times less likely.
_FIRST, _SECOND = 8, 4  # Turns that are followed, and once more with the body that was found so.
_RENDERINGS, _FINELY = 120, 0.5
_ROUNDS, _GAINED = 3, 1.0
_SCALES = (0.94, 1.06)


def turned_by_ear(fine: Likelihood, found: RatedGuess) -> RatedGuess:
    """Returns a thing turned as its ear is seen; as far between all turns that hide it as they are alike.

    Args:
        fine: What guesses are judged by, with all pixels.
        found: The thing, turned somehow.
    """
    best = _cheapest(fine, found, _likeliest(fine, found, _FIRST), reach=1.0)
    for _ in range(_ROUNDS):
        before = best
        # Another body may make another turn the likeliest.
        best = _cheapest(fine, best, _likeliest(fine, best, _SECOND), reach=_FINELY)
        best = _cheapest(fine, best, _resized(best.guess), reach=_FINELY)
        if before.cost - best.cost < _GAINED:
            break
    turns = _all_around(fine, best)
    likely = np.array([math.exp(min(0.0, (best.cost - one.cost) / _ALIKE)) for one in turns])
    yaws = np.array([one.guess.yaw_rad for one in turns])
    # Of what is seen clearly, hardly any other turn counts, and the mean is where it was.
    mean_rad = math.atan2(float(likely @ np.sin(yaws)), float(likely @ np.cos(yaws)))
    middle = fine.rated(_with_body_kept(best.guess, mean_rad, best.guess.size_m))
    return middle if middle.cost < best.cost + _ALIKE else best


def _cheapest(fine: Likelihood, found: RatedGuess, begun: Iterable[Guess], reach: float) -> RatedGuess:
    """The cheapest of what was found and where searches end that begin at some guesses."""
    ended = (fine.rated(descended(fine, guess, _RENDERINGS, colours=True, reach=reach)) for guess in begun)
    return min([found, *ended], key=lambda one: one.cost)


def _likeliest(fine: Likelihood, found: RatedGuess, count: int) -> list[Guess]:
    turns = sorted(_all_around(fine, found), key=lambda one: one.cost)
    return [one.guess for one in turns[:count]]


def _all_around(fine: Likelihood, found: RatedGuess) -> list[RatedGuess]:
    """The thing and its other turns."""
    guess = found.guess
    turns = (guess.yaw_rad + turn * 2.0 * math.pi / _TURNS for turn in range(1, _TURNS))
    return [found, *(fine.rated(_with_body_kept(guess, yaw_rad, guess.size_m)) for yaw_rad in turns)]


def _resized(guess: Guess) -> Iterator[Guess]:
    """Yields it larger and smaller, and with the shortest and the longest ear."""
    length, width, height = guess.size_m
    sizes = [(scale * length, scale * width, scale * height) for scale in _SCALES]
    sizes += [(share * width, width, height) for share in (guess.entry.length.low, guess.entry.length.high)]
    for length, width, height in sizes:
        again = _with_body_kept(guess, guess.yaw_rad, (round(length, 4), round(width, 4), round(height, 4)))
        if body_of(again) is not None:
            yield again


def _with_body_kept(guess: Guess, yaw_rad: float, size_m: Size) -> Guess:
    """Turned, and of another size, with the middle of its body where it is."""
    before = body_middle_m(guess.yaw_rad, *guess.size_m[:2])
    x, y = before - body_middle_m(yaw_rad, *size_m[:2]) + [guess.x_m, guess.y_m]
    return replace(guess, x_m=float(x), y_m=float(y), yaw_rad=math.remainder(yaw_rad, 2.0 * math.pi), size_m=size_m)
