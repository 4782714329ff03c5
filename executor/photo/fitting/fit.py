"""The search for what explains one thing of the picture: every model, many starts, few of them followed to the end."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from executor.assets.parameters import ModelEntry, Option, Quantity
from executor.geometry import Array, wrap_angle
from executor.photo.fitting.body import Body, Guess, body_of
from executor.photo.fitting.patch import Patch
from executor.photo.fitting.prior import Neighbourhood, prior_cost
from executor.photo.fitting.starts import points_of, starts
from executor.photo.space.observation import Observation
from oag import Kind, kind_of

COARSE_PX, SEARCH_PX, FINE_PX = 250, 700, 5000
"""How many pixels of a thing are compared to choose starts, to search, and to choose options."""

_FOLLOWED, _PER_MODEL, _FINISHED = 6, 2, 3
_STEPS = (260, 160)  # Renderings of a first and of a last search.
_SHAPING = ("hinge", "drawers", "drawer_side", "below", "boards")
_DETAILS = ("handle_height_m", "handle_length_m")
_OPEN = "open_fraction"
_OPENED = (0.0, 0.25, 0.5, 0.75, 1.0)
_FURNITURE_STEP = np.array([0.05, 0.05, 0.06, 0.05, 0.05, 0.03])
_ITEM_STEP = np.array([0.012, 0.012, 0.3, 0.010, 0.008, 0.010])
_AWAY_M = 0.12  # From points to a place that a thing may stand on.


@dataclass(frozen=True)
class RatedGuess:
    """A guess with what it costs, as a negative logarithm of likelihood."""

    guess: Guess
    cost: float


@dataclass(frozen=True)
class Fit:
    """What explains a thing best.

    Attributes:
        guess: The best guess.
        cost: What it costs; only differences between guesses of one thing mean something.
        alternatives: The best guess of every other model, the best first.
        explained: Share of the thing's pixels that it explains.
        residual_m: Median distance of what it shows from what was seen.
        pixels: How many pixels were compared at the end.
    """

    guess: Guess
    cost: float
    alternatives: tuple[RatedGuess, ...]
    explained: float
    residual_m: float
    pixels: int

    @property
    def confidence(self) -> float:
        """0 to 1: how much more likely it is than the best guess of any other model."""
        if not self.alternatives:
            return 1.0
        return 1.0 / (1.0 + math.exp(-min(50.0, self.alternatives[0].cost - self.cost)))


@dataclass(frozen=True)
class Around:
    """What a search has to know besides its thing.

    Attributes:
        seen: The picture.
        other_m: (H, W) depth of everything else that is known.
        smaller: (H, W) pixels in boxes of smaller things.
        near: The walls and the other furniture.
    """

    seen: Observation
    other_m: Array
    smaller: NDArray[np.bool_]
    near: Neighbourhood


def fit_thing(
    around: Around,
    box_px: tuple[float, float, float, float],
    entries: Sequence[ModelEntry],
    bottoms_m: Sequence[float],
    points: Array | None = None,
) -> Fit | None:
    """Returns the best fit of a thing among some models, or None where nothing of it stands out.

    Args:
        around: What else is known.
        box_px: The thing's box.
        entries: Models that it may be.
        bottoms_m: Heights that it may stand on.
        points: (N, 3) that are its own; by default those that stand out in its box.
    """
    seen, near = around.seen, around.near
    if points is None:
        points = points_of(seen, box_px, around.other_m, around.smaller)
    if len(points) < 8:
        return None
    foreign = around.smaller
    coarse = Patch.around(seen, box_px, around.other_m, COARSE_PX, foreign)
    search = Patch.around(seen, box_px, around.other_m, SEARCH_PX, foreign)
    fine = Patch.around(seen, box_px, around.other_m, FINE_PX, foreign)
    if not len(coarse.z_m):
        return None
    rated = [
        RatedGuess(guess, _cost(coarse, guess, near))
        for bottom in bottoms_m
        for guess in starts(points, entries, bottom, near.walls)
    ]
    chosen = _chosen(rated)
    found: list[RatedGuess] = []
    for one in chosen:
        guess = _searched(search, one.guess, near, _STEPS[0])
        found.append(_with_options(fine, guess, near))
    found.sort(key=lambda one: one.cost)
    finished = []
    for one in _best_of_models(found)[:_FINISHED]:
        guess = _searched(search, one.guess, near, _STEPS[1])
        finished.append(_with_options(fine, guess, near))
    ranked = _best_of_models(sorted((*finished, *found), key=lambda one: one.cost))
    if not ranked:
        return None
    best, *others = ranked
    return _described(fine, best, others)


def _described(fine: Patch, best: RatedGuess, others: Sequence[RatedGuess]) -> Fit | None:
    """Returns a fit with its quality; None where it cannot be built."""
    body = body_of(best.guess)
    if body is None:
        return None
    return Fit(
        best.guess,
        best.cost,
        tuple(others),
        fine.explained(best.guess, body),
        fine.residual_m(best.guess, body),
        len(fine.z_m),
    )


def _chosen(rated: list[RatedGuess]) -> list[RatedGuess]:
    """The cheapest starts, a few of each model."""
    rated.sort(key=lambda one: one.cost)
    counts: dict[str, int] = {}
    kept = []
    for one in rated:
        model = one.guess.entry.model
        if counts.get(model, 0) < _PER_MODEL and math.isfinite(one.cost):
            counts[model] = counts.get(model, 0) + 1
            kept.append(one)
    return kept[: max(_FOLLOWED, 2 * _PER_MODEL)]


def _best_of_models(found: Sequence[RatedGuess]) -> list[RatedGuess]:
    best: dict[str, RatedGuess] = {}
    for one in found:
        if one.guess.entry.model not in best:
            best[one.guess.entry.model] = one
    return list(best.values())


def _cost(patch: Patch, guess: Guess, near: Neighbourhood, body: Body | None = None) -> float:
    body = body or body_of(guess)
    prior = prior_cost(guess, near)
    if body is None or not math.isfinite(prior):
        return math.inf
    return patch.cost(guess, body) + patch.box_cost(guess) + prior


def _full_cost(patch: Patch, guess: Guess, near: Neighbourhood) -> float:
    body = body_of(guess)
    return math.inf if body is None else _cost(patch, guess, near, body) + patch.colour_cost(guess, body)


def _searched(patch: Patch, guess: Guess, near: Neighbourhood, steps: int) -> Guess:
    """Moves, turns and stretches a guess downhill. Its corner nearest to the camera is what is moved.

    What is hidden of a thing are its far sides: with the near corner held, a longer side changes nothing that is seen.
    """
    body = body_of(guess)
    if body is None:
        return guess
    entry = guess.entry
    is_item = kind_of(entry.category, guess.size_m[1]) is Kind.ITEM
    scale = (_ITEM_STEP if is_item else _FURNITURE_STEP) / 2
    free = [True, True, not body.symmetric and not _is_round(entry), not _fixed(entry, 0), True, not _fixed(entry, 2)]
    active = np.flatnonzero(free)
    c, s = math.cos(guess.yaw_rad), math.sin(guess.yaw_rad)
    towards = -np.array([c * guess.x_m + s * guess.y_m, -s * guess.x_m + c * guess.y_m])
    sign = np.where(towards > 0, 0.5, -0.5)

    def corner(of: Guess) -> Array:
        c, s = math.cos(of.yaw_rad), math.sin(of.yaw_rad)
        off = sign * of.size_m[:2]
        return np.array([of.x_m + c * off[0] - s * off[1], of.y_m + s * off[0] + c * off[1]])

    start = np.array([*corner(guess), guess.yaw_rad, *guess.size_m])

    def at(values: Array) -> Guess:
        full = start.copy()
        full[active] = start[active] + values * scale[active]
        width = full[4]
        length = width * entry.length.low if _fixed(entry, 0) else full[3]
        height = width * entry.height.low if _fixed(entry, 2) else full[5]
        c, s = math.cos(full[2]), math.sin(full[2])
        off = sign * [length, width]
        x, y = full[0] - c * off[0] + s * off[1], full[1] - s * off[0] - c * off[1]
        return replace(guess, x_m=float(x), y_m=float(y), yaw_rad=wrap_angle(full[2]), size_m=(length, width, height))

    def cost(values: Array) -> float:
        return min(_cost(patch, at(values), near, body), 1e6)

    simplex = np.vstack([np.zeros(len(active)), 2.0 * np.eye(len(active))])
    options = {"initial_simplex": simplex, "maxfev": steps, "xatol": 0.01, "fatol": 0.01}
    found = minimize(cost, np.zeros(len(active)), method="Nelder-Mead", options=options)
    best = at(found.x)
    return replace(best, size_m=(round(best.size_m[0], 4), round(best.size_m[1], 4), round(best.size_m[2], 4)))


def _is_round(entry: ModelEntry) -> bool:
    return entry.length.of_width and entry.length.low == entry.length.high == 1.0


def _fixed(entry: ModelEntry, axis: int) -> bool:
    span = entry.length if axis == 0 else entry.height
    return span.of_width and span.low == span.high


def _with_options(patch: Patch, guess: Guess, near: Neighbourhood) -> RatedGuess:
    """Chooses what shapes a model besides its size: hinge side, drawers, how far open, where its handles are."""
    best = min((RatedGuess(one, _full_cost(patch, one, near)) for one in _shapes(guess)), key=lambda one: one.cost)
    if kind_of(guess.entry.category, guess.size_m[1]) is Kind.ARTICULATED:
        for fraction in _OPENED:
            best = _better(patch, best, best.guess.with_parameters(**{_OPEN: fraction}), near)
        now = float(str(dict(best.guess.parameters).get(_OPEN, 0.0)))
        for step in (0.12, 0.06, 0.03) if now > 0.0 else ():
            for sign in (-step, step):
                at = min(max(now + sign, 0.0), 1.0)
                best = _better(patch, best, best.guess.with_parameters(**{_OPEN: round(at, 3)}), near)
            now = float(str(dict(best.guess.parameters).get(_OPEN, 0.0)))
        if now > 0.0:
            # A door that stands open shows on which side it hangs.
            for one in _shapes(best.guess):
                best = _better(patch, best, one, near)
    for parameter in guess.entry.parameters:
        if isinstance(parameter, Quantity) and parameter.name in _DETAILS:
            for share in (0.1, 0.35, 0.65, 0.9):
                value = round(parameter.low + share * (parameter.high - parameter.low), 3)
                best = _better(patch, best, best.guess.with_parameters(**{parameter.name: value}), near)
    return best


def _better(patch: Patch, best: RatedGuess, guess: Guess, near: Neighbourhood) -> RatedGuess:
    cost = _full_cost(patch, guess, near)
    return RatedGuess(guess, cost) if cost < best.cost - 1e-6 else best


def _shapes(guess: Guess) -> Iterator[Guess]:
    """Yields the guess with every combination of what its model can be built as."""
    choices: list[list[tuple[str, object]]] = []
    for parameter in guess.entry.parameters:
        if parameter.name not in _SHAPING:
            continue
        if isinstance(parameter, Option):
            choices.append([(parameter.name, word) for word in parameter.words])
        else:
            choices.append([(parameter.name, n) for n in range(round(parameter.low), round(parameter.high) + 1)])
    for combination in itertools.product(*choices):
        yield guess.with_parameters(**dict(combination))
