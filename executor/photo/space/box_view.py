"""What of a box was there to be explained when a thing was fitted to it, and whether there is more of it now."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array
from executor.photo.space.observation import Observation
from llm.sight.forms import Box

_SIGMAS, _LEAST_M = 3.0, 0.015  # Nearer than all that is known: what stands out.
_CHANGED = 0.02  # Of a box's pixels.


@dataclass(frozen=True)
class BoxView:
    """What stood out, and of that, what was nobody else's.

    Attributes:
        out: (H, W) nearer than all that was known.
        foreign: (H, W) in boxes of smaller things.
    """

    out: NDArray[np.bool_]
    foreign: NDArray[np.bool_]

    @classmethod
    def of(cls, seen: Observation, other_m: Array, foreign: NDArray[np.bool_]) -> BoxView:
        """Returns the view among all that is known, whose depth (H, W) this is."""
        return cls(seen.z_m < other_m - np.maximum(_LEAST_M, _SIGMAS * seen.sigma_m), foreign)

    def is_like(self, before: BoxView, box_px: Box) -> bool:
        """Decides whether hardly a pixel of a box is another one's than before."""
        x0, y0, x1, y1 = (round(value) for value in box_px)
        window = np.s_[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)]
        changed = (self.out[window] != before.out[window]) | (self.foreign[window] != before.foreign[window])
        return bool(changed.mean() < _CHANGED)
