"""What a picture shows that is not explained yet, in a box and around a mask."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array
from executor.photo.geometry.observation import Observation
from llm.vision import Box


def box_of(mask: NDArray[np.bool_]) -> Box:
    """Return the box around a mask."""
    rows, columns = np.nonzero(mask)
    return float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1)


_VIEW_SIGMAS, _VIEW_LEAST_M = 3.0, 0.015  # Nearer than everything known: residual pixels.
_CHANGED = 0.02  # Of a box's pixels.


@dataclass(frozen=True)
class BoxView:
    """Residual pixels at the time of a fit, to detect changes since.

    Attributes:
        out: (H, W) nearer than everything known.
        foreign: (H, W) in boxes of smaller objects.
    """

    out: NDArray[np.bool_]
    foreign: NDArray[np.bool_]

    @classmethod
    def of(cls, observation: Observation, other_m: Array, foreign: NDArray[np.bool_]) -> BoxView:
        """Return the view against the depth (H, W) of everything known."""
        return cls(observation.z_m < other_m - np.maximum(_VIEW_LEAST_M, _VIEW_SIGMAS * observation.sigma_m), foreign)

    def is_like(self, before: BoxView, box_px: Box) -> bool:
        """Return whether hardly a pixel of a box has changed."""
        x0, y0, x1, y1 = (round(value) for value in box_px)
        window = np.s_[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)]
        changed = (self.out[window] != before.out[window]) | (self.foreign[window] != before.foreign[window])
        return bool(changed.mean() < _CHANGED)
