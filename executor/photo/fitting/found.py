"""What a search for one thing is given of the room, and what it finds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array
from executor.photo.fitting.body import Guess
from executor.photo.fitting.likelihood import RatedGuess
from executor.photo.fitting.prior import Neighbourhood
from executor.photo.space.observation import Observation


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
        colour: Middle one of the colours that it shows, as sRGB from 0 to 255; None where nothing of it is seen.
        spread_m: How exactly its place on the floor is known; None with depth, where the residual tells.
        assumed: Where nothing of its sides is seen, what it is taken for, for people.
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
        other_m, other: (H, W) depth of everything else that is known, and which of it, by number.
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
