"""What guesses of one thing are judged by: depths, box, colours, and what is likely before anything is seen.

Beside it, what a search for the best one is given of the room, what it finds, and how exactly that is known.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array
from executor.photo.fitting.body import Body, Guess, body_of
from executor.photo.fitting.patch import Patch
from executor.photo.fitting.prior import Neighbourhood, prior_cost, usual_size_cost
from executor.photo.space.observation import Observation

_STEPS = np.array([0.02, 0.02, 0.05, 0.01, 0.01, 0.01])  # Metres and radians, over which costs are about quadratic.
_LOOSEST = 1e-3  # Of the sharpest direction: what is looser is not known at all.
_MOST_M = 1.0
_HIGHEST = 1e6  # Stands for what cannot be, of which differences are taken.
_FARTHEST_M = 10.0  # In a room.
_PLACED_M = 0.1  # A thing whose place is known within it is where a plan looks for it.


@dataclass(frozen=True)
class RatedGuess:
    """A guess with what it costs, as a negative logarithm of likelihood."""

    guess: Guess
    cost: float


def by_cost(guesses: Iterable[RatedGuess]) -> list[RatedGuess]:
    """Returns guesses, the cheapest first."""
    return sorted(guesses, key=lambda one: one.cost)


def best_of_models(guesses: Iterable[RatedGuess]) -> list[RatedGuess]:
    """Returns the cheapest guess of each model, the cheapest first."""
    best: dict[str, RatedGuess] = {}
    for one in by_cost(guesses):
        best.setdefault(one.guess.entry.model, one)
    return list(best.values())


@dataclass(frozen=True)
class Likelihood:
    """How likely guesses of one thing are: its pixels at one resolution, and what stands around it.

    Attributes:
        patch: The pixels.
        near: The walls and the other furniture.
        scale_share: How exactly the picture's scale is known, as a share, where there is no depth.
    """

    patch: Patch
    near: Neighbourhood
    scale_share: float = 0.0

    def box_cost(self, guess: Guess) -> float:
        """Returns what its box and what is likely before anything is seen say; infinite for what cannot be."""
        cost = self.patch.box_cost(guess) + prior_cost(guess, self.near)
        if not self.patch.seen.by_sight:
            return cost
        # Near the horizon, a little of the picture is many metres.
        return cost + usual_size_cost(guess) if math.hypot(guess.x_m, guess.y_m) < _FARTHEST_M else math.inf

    def cost(self, guess: Guess, body: Body | None = None, *, colours: bool = True) -> float:
        """Returns what a guess costs, infinite for what cannot be built.

        Args:
            guess: The guess.
            body: Triangles to take for it, stretched to its size; by default those of its own size.
            colours: Whether colours are looked at, which takes longer; they are most that is known without depth.
        """
        cost, patch = self.box_cost(guess), self.patch
        body = (body or body_of(guess)) if math.isfinite(cost) else None
        if body is None:
            return math.inf
        if not colours:
            return cost + patch.cost(guess, body)
        depth, group = body.looks(guess, patch.seen.eye_m, patch.rays, patch.other)
        return cost + patch.depth_cost(depth) + patch.colour_cost(depth, group)

    def rated(self, guess: Guess, *, colours: bool = True) -> RatedGuess:
        """Returns a guess with its cost."""
        return RatedGuess(guess, self.cost(guess, colours=colours))

    def better(self, best: RatedGuess, guess: Guess, *, colours: bool = True) -> RatedGuess:
        """Returns the cheaper one of two guesses, the first one where they are alike."""
        cost = self.cost(guess, colours=colours)
        return RatedGuess(guess, cost) if cost < best.cost - 1e-6 else best


@dataclass(frozen=True)
class Fit:
    """What explains a thing best.

    Attributes:
        guess: The best guess.
        cost: What it costs: with depth only differences between guesses of one thing mean something; without, one that
            looks as it should costs about nothing or less.
        alternatives: The best guess of every other model, the best first.
        explained: Share of the thing's pixels that it explains.
        residual_m: Median distance of what it shows from what was seen.
        pixels: How many pixels were compared at the end.
        colour: Middle one of the colours that it shows, as sRGB from 0 to 255; None where nothing of it is seen.
        spread_m: How exactly its place on the floor is known; None with depth, where the residual tells.
        assumed: Where nothing of its sides is seen, what it is taken for, for people.
        beside_box: What its outline costs for not filling its box, as `Patch.box_cost` has it.
        in_box: IoU of its box with the box around what is visible of it in the picture; 1 until that is looked at.
    """

    guess: Guess
    cost: float
    alternatives: tuple[RatedGuess, ...]
    explained: float
    residual_m: float
    pixels: int
    colour: tuple[int, int, int] | None
    spread_m: float | None = None
    assumed: str = ""
    beside_box: float = 0.0
    in_box: float = 1.0

    @property
    def likelier(self) -> float:
        """0 to 1: how much more likely it is than the best guess of any other model."""
        if not self.alternatives:
            return 1.0
        return 1.0 / (1.0 + math.exp(-min(50.0, self.alternatives[0].cost - self.cost)))

    @property
    def placed(self) -> float:
        """0 to 1: the probability that its place on the floor is off by less than 10 cm, by its spread.

        With depth, by how far off its depths are, which is more than its place is.
        """
        off_m = self.residual_m if self.spread_m is None else self.spread_m
        return 1.0 - math.exp(-0.5 * (_PLACED_M / max(off_m, 1e-6)) ** 2)

    @property
    def confidence(self) -> float:
        """0 to 1: likelier than another model, its pixels explained, in its box and well placed, all of it at once."""
        return self.likelier * self.explained * self.in_box * self.placed


def best_of_fits(fits: Iterable[Fit]) -> Fit | None:
    """Returns the cheapest of some fits of one thing, with the others among its alternatives; None of none."""
    ranked = sorted(fits, key=lambda one: one.cost)
    others = [other for one in ranked for other in (RatedGuess(one.guess, one.cost), *one.alternatives)]
    return replace(ranked[0], alternatives=tuple(by_cost(others[1:]))) if ranked else None


@dataclass(frozen=True)
class Around:
    """What a search has to know besides its thing.

    Attributes:
        seen: The picture.
        other_m, other: (H, W) depth of everything else that is known, and of which face, by number.
        smaller: (H, W) pixels in boxes of smaller things.
        own: (H, W) the thing's own pixels, where somebody knows them.
        near: The walls and the other furniture.
        scale_share: How exactly the picture's scale is known, as a share, where there is no depth.
    """

    seen: Observation
    other_m: Array
    other: NDArray[np.int32]
    smaller: NDArray[np.bool_]
    near: Neighbourhood
    scale_share: float = 0.0
    own: NDArray[np.bool_] | None = None


def place_spread_m(likelihood: Likelihood, guess: Guess) -> float:
    """Returns the standard deviation of a thing's place on the floor, in its worst direction.

    By how costs grow around the guess (Laplace's approximation): where a bit farther off and a bit larger is as good,
    the place is not known well. Colours are left out, which make it sharper than it is.

    Args:
        likelihood: What the guess was judged by.
        guess: The guess.
    """
    count = len(_STEPS)
    here = _moved(likelihood, guess, {})
    single = np.array([[_moved(likelihood, guess, {i: sign}) for sign in (-1.0, 1.0)] for i in range(count)])
    curved = np.zeros((count, count))
    for i in range(count):
        curved[i, i] = single[i, 0] + single[i, 1] - 2 * here
        for j in range(i):
            both = _moved(likelihood, guess, {i: 1.0, j: 1.0})
            curved[i, j] = curved[j, i] = both - single[i, 1] - single[j, 1] + here
    values, axes = np.linalg.eigh(curved)
    variances = 1.0 / np.maximum(values, max(_LOOSEST * float(values.max()), 1e-9))
    covariance = (axes * variances) @ axes.T * np.outer(_STEPS, _STEPS)
    worst = math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[:2, :2]).max())))
    return min(_MOST_M, math.hypot(worst, likelihood.scale_share * math.hypot(guess.x_m, guess.y_m)))


def _moved(likelihood: Likelihood, guess: Guess, steps: dict[int, float]) -> float:
    by: Array = np.zeros(len(_STEPS))
    for index, sign in steps.items():
        by[index] = sign * _STEPS[index]
    length, width, height = guess.size_m
    size = length + float(by[3]), width + float(by[4]), height + float(by[5])
    one = replace(guess, x_m=guess.x_m + by[0], y_m=guess.y_m + by[1], yaw_rad=guess.yaw_rad + by[2], size_m=size)
    return min(likelihood.box_cost(one), _HIGHEST)
