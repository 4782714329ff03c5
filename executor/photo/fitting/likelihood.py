"""What guesses of one thing are judged by: depths, box, colours, and what is likely before anything is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

from executor.photo.fitting.body import Body, Guess, body_of
from executor.photo.fitting.patch import Patch
from executor.photo.fitting.prior import Neighbourhood, prior_cost, usual_size_cost


@dataclass(frozen=True)
class RatedGuess:
    """A guess with what it costs, as a negative logarithm of likelihood."""

    guess: Guess
    cost: float


@dataclass(frozen=True)
class Likelihood:
    """How likely guesses of one thing are: its pixels at one resolution, and what stands around it.

    Attributes:
        patch: The pixels.
        near: The walls and the other furniture.
    """

    patch: Patch
    near: Neighbourhood

    def cost(self, guess: Guess, body: Body | None = None, *, colours: bool = True) -> float:
        """Returns what a guess costs, infinite for what cannot be built.

        Args:
            guess: The guess.
            body: Triangles to take for it, stretched to its size; by default those of its own size.
            colours: Whether colours are looked at, which takes longer.
        """
        body = body or body_of(guess)
        prior = prior_cost(guess, self.near)
        if body is None or not math.isfinite(prior):
            return math.inf
        patch = self.patch
        cost = patch.box_cost(guess) + prior
        if not patch.has_depth:
            cost += usual_size_cost(guess)
        if not colours:
            return cost + patch.cost(guess, body)
        depth, group = body.looks(guess, patch.seen.eye_m, patch.rays)
        return cost + patch.depth_cost(depth) + patch.colour_cost(depth, group)

    def rated(self, guess: Guess, *, colours: bool = True) -> RatedGuess:
        """Returns a guess with its cost."""
        return RatedGuess(guess, self.cost(guess, colours=colours))

    def better(self, best: RatedGuess, guess: Guess, *, colours: bool = True) -> RatedGuess:
        """Returns the cheaper one of two guesses, the first one where they are alike."""
        cost = self.cost(guess, colours=colours)
        return RatedGuess(guess, cost) if cost < best.cost - 1e-6 else best
