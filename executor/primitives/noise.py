"""Noise in what the drives are told: the robot strays from its path and comes back, and what is recorded is the path.

A policy that has only seen paths without it does not know the way back from where its own mistakes take it.

Source: Laskey et al., "DART: Noise injection for robust imitation learning" (2017); noise with a memory, since the arm
would not follow a white one, is Uhlenbeck and Ornstein's, here smoothed once more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from executor.geometry import Array
from executor.primitives.timing import SPEED_LIMITS

RAD_PER_M = 2.0
"""Noise in a joint or the base's heading for that in the base's place: each moves the hand about as far."""

MEMORY_S = 0.4
"""Time in which it forgets: the base and the arm follow it, and a motion of a second sees it change."""

MOST = 2.0  # Standard deviations; what goes beyond is cut off, so that limits can be widened by it.
_FULL_FROM = 0.8  # Of the speed limit of any joint; slower, as near things, it is less, and at rest it is gone.
_FADES_S = 0.5  # Before a motion's end: the base needs that long to be back where a grasp was planned from.
_OVERSHOOT = 1.5  # What follows lags, and swings beyond.
_GRIPPING = 0.25  # What is held tears a grip open, or a door off its circle.


@dataclass(frozen=True, slots=True)
class CommandNoise:
    """How much noise an episode has.

    Attributes:
        deviation_m: Standard deviation for the base along x and y; `RAD_PER_M` of it for every angle.
        seed: Equal seeds give equal noise.
    """

    deviation_m: float = 0.0
    seed: int = 0

    def of_subtask(self, subtask: int, dt_s: float) -> NoiseStream | None:
        """Returns the noise of a subtask, the same however often it is run; None where there is none.

        Args:
            subtask: Its index.
            dt_s: Length of a physics step.
        """
        return (
            NoiseStream(self.deviation_m, np.random.default_rng((self.seed, subtask)), dt_s)
            if self.deviation_m
            else None
        )


QUIET = CommandNoise()


class NoiseStream:
    """Noise, physics step by physics step.

    Args:
        deviation_m: As in `CommandNoise`.
        rng: Draws it.
        dt_s: Length of a physics step.

    Attributes:
        strays_m: Farther than this off its way, along x or y, the base does not get by it.
    """

    def __init__(self, deviation_m: float, rng: np.random.Generator, dt_s: float) -> None:
        self.strays_m = _OVERSHOOT * MOST * deviation_m
        self._scale = deviation_m * np.array([1.0, 1.0] + [RAD_PER_M] * 8)
        self._rng = rng
        self._keeps = float(np.exp(-dt_s / MEMORY_S))
        # So that the smoothed process has a variance of 1.
        self._gain = (1.0 + self._keeps) / float(np.sqrt(1.0 + self._keeps**2))
        self._rough = rng.standard_normal(10)
        self._smooth = np.zeros(10)

    def offset(self, velocity: Array, left_s: float, *, gripping: bool) -> Array:
        """Returns (10,) what the next targets of base and arm are off by, in m and rad.

        Args:
            velocity: (10,) how fast they are told to move.
            left_s: How long until they are told to be at rest.
            gripping: Whether the fingers are told to close.
        """
        a = self._keeps
        self._rough = a * self._rough + float(np.sqrt(1.0 - a * a)) * self._rng.standard_normal(10)
        self._smooth = a * self._smooth + (1.0 - a) * self._rough
        share = min(float((np.abs(velocity) / SPEED_LIMITS).max()) / _FULL_FROM, left_s / _FADES_S, 1.0) ** 2
        share *= _GRIPPING if gripping else 1.0
        return np.asarray(share * self._scale * np.clip(self._gain * self._smooth, -MOST, MOST))
