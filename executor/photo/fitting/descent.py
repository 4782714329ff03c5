"""The way down from a guess: moved, turned and stretched until nothing near it explains the thing better."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from executor.assets.parameters import ModelEntry
from executor.geometry import Array, rotation_z, wrap_angle
from executor.photo.fitting.body import Guess, body_middle_m, body_of, has_ear, is_round
from executor.photo.fitting.likelihood import Likelihood
from oag import Kind, kind_of

_FURNITURE_STEP = np.array([0.05, 0.05, 0.06, 0.05, 0.05, 0.03])
_ITEM_STEP = np.array([0.012, 0.012, 0.3, 0.010, 0.008, 0.010])
_HIGHEST = 1e6  # Stands for what cannot be, since the search compares numbers.


def descended(likelihood: Likelihood, guess: Guess, renderings: int, *, colours: bool, reach: float = 1.0) -> Guess:
    """Returns what a search by Nelder and Mead's method makes of a guess. What is nearest to the camera is moved.

    What is hidden of a thing are its far sides: with the near corner held, a longer side changes nothing that is seen.
    Of what is round but for an ear it is the near point of its body: so the body stays where it is as the ear turns.

    Args:
        likelihood: What guesses are judged by.
        guess: Where to begin.
        renderings: Most guesses that are tried.
        colours: Whether they are looked at on the way.
        reach: Size of the first steps; 1 where the beginning is a rough one.
    """
    body = body_of(guess)
    if body is None:
        return guess
    entry = guess.entry
    is_item = kind_of(entry.category, guess.size_m[1]) is Kind.ITEM
    scale = (_ITEM_STEP if is_item else _FURNITURE_STEP) / 2
    turns = not body.symmetric and not is_round(entry)
    active = np.flatnonzero([True, True, turns, not _fixed(entry, 0), True, not _fixed(entry, 2)])
    held = _near_point_of_body(guess) if has_ear(entry) else near_corner(guess)
    start = np.array([*(held(guess.yaw_rad, *guess.size_m[:2]) + [guess.x_m, guess.y_m]), guess.yaw_rad, *guess.size_m])

    def at(values: Array) -> Guess:
        full = start.copy()
        full[active] = start[active] + values * scale[active]
        width = full[4]
        length = width * entry.length.low if _fixed(entry, 0) else full[3]
        height = width * entry.height.low if _fixed(entry, 2) else full[5]
        x, y = full[:2] - held(full[2], length, width)
        size = float(length), float(width), float(height)
        return replace(guess, x_m=float(x), y_m=float(y), yaw_rad=float(wrap_angle(full[2])), size_m=size)

    def cost(values: Array) -> float:
        return min(likelihood.cost(at(values), body, colours=colours), _HIGHEST)

    simplex = np.vstack([np.zeros(len(active)), 2.0 * reach * np.eye(len(active))])
    options = {"initial_simplex": simplex, "maxfev": renderings, "xatol": 0.01, "fatol": 0.01}
    best = at(minimize(cost, np.zeros(len(active)), method="Nelder-Mead", options=options).x)
    best = replace(best, size_m=(round(best.size_m[0], 4), round(best.size_m[1], 4), round(best.size_m[2], 4)))
    # What is stretched while it is searched for may be too flat to be built.
    return best if body_of(best) is not None else guess


Held = Callable[[float, float, float], Array]
"""Heading, length and width -> (2,) how far what is held is from the middle of the box."""


def near_corner(guess: Guess) -> Held:
    """Returns where the corner of a guess's box is that is nearest to the camera, for other turns and sides, too."""
    sign = np.where(rotation_z(-guess.yaw_rad)[:2, :2] @ [guess.x_m, guess.y_m] < 0.0, 0.5, -0.5)
    return lambda yaw_rad, length, width: rotation_z(yaw_rad)[:2, :2] @ (sign * [length, width])


def _near_point_of_body(guess: Guess) -> Held:
    towards = -np.array([guess.x_m, guess.y_m]) / max(math.hypot(guess.x_m, guess.y_m), 1e-9)
    return lambda yaw_rad, length, width: body_middle_m(yaw_rad, length, width) + towards * width / 2


def _fixed(entry: ModelEntry, axis: int) -> bool:
    span = entry.length if axis == 0 else entry.height
    return span.of_width and span.low == span.high
