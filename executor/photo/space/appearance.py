"""What a picture's colours say of where a thing ends: colours that are seen beside it, and edges.

A guess that is right ends where the picture has edges, and what it leaves to others is of colours that others have.
Both are found once for the pixels of a thing, so that a guess costs next to nothing more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from executor.geometry import Array

_AROUND, _LEAST_PX = 0.5, 24.0  # Of a box's sides, and in pixels, how far around it colours of others are looked for.
_SHADES, _LEAST_SHARE = 16, 0.004  # Steps of each colour; of the pixels, how many a colour has that is there.
_EDGE = 0.035  # Of full brightness: what differs by more across two pixels is an edge.
_BESIDE_PX = 1  # How far an edge may be from where a guess has it.
_SEEN = 0.8  # Of what a model shows as an edge, the picture has as one; faces may look alike.
_MOST_CLUTTER = 0.5
_ALONG = 0.3  # Of pairs along an edge, how many are measurements of their own.


def unlike_beside(rgb: NDArray[np.uint8], box_px: tuple[float, float, float, float], colours: Array) -> Array:
    """Returns (N,) how far some colours are from the nearest one that is seen around a box.

    Args:
        rgb: (H, W, 3) the picture.
        box_px: The box.
        colours: (N, 3) in 0 to 1.
    """
    x0, y0, x1, y1 = box_px
    over_x, over_y = max(_LEAST_PX, _AROUND * (x1 - x0)), max(_LEAST_PX, _AROUND * (y1 - y0))
    height, width = rgb.shape[:2]
    left, right = max(0, int(x0 - over_x)), min(width, math.ceil(x1 + over_x))
    top, bottom = max(0, int(y0 - over_y)), min(height, math.ceil(y1 + over_y))
    beside = np.ones((bottom - top, right - left), dtype=bool)
    rows = slice(max(0, int(y0) - top), max(0, math.ceil(y1) - top))
    columns = slice(max(0, int(x0) - left), max(0, math.ceil(x1) - left))
    beside[rows, columns] = False
    seen = rgb[top:bottom, left:right][beside].astype(np.int64)
    if not len(seen):
        return np.full(len(colours), np.inf)
    shade = (seen // _SHADES) @ [1, _SHADES, _SHADES**2]
    _, which, counts = np.unique(shade, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(which.ravel(), seen[:, k]) for k in range(3)], axis=1) / counts[:, None] / 255.0
    means = means[counts > _LEAST_SHARE * len(seen)]
    if not len(means):
        return np.full(len(colours), np.inf)
    return np.sqrt(((colours[:, None, :] - means[None, :, :]) ** 2).sum(axis=2).min(axis=1))


@dataclass(frozen=True)
class Edges:
    """Pairs of neighbouring pixels, and what it is worth to say that there is an edge between them.

    Attributes:
        first, second: (M,) numbers of pixels.
        worth: (M,) how much likelier the picture is with an edge there than without, as a logarithm.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    worth: Array

    @classmethod
    def between(
        cls, strength: tuple[Array, Array], rows: NDArray[np.int64], columns: NDArray[np.int64], step: int
    ) -> Edges:
        """Returns the pairs among some pixels of a grid.

        Args:
            strength: (H, W) twice: how much the picture differs to the right, and below.
            rows, columns: (N,) the pixels.
            step: How many pixels they are apart.
        """
        top, left = int(rows.min()), int(columns.min())
        i, j = (rows - top) // step, (columns - left) // step
        number = np.full((int(i.max()) + 2, int(j.max()) + 2), -1, dtype=np.int64)
        number[i, j] = np.arange(len(rows))
        firsts, seconds, found = [], [], []
        for axis, (down, right) in enumerate(((0, 1), (1, 0))):
            other = number[i + down, j + right]
            here = np.flatnonzero(other >= 0)
            # The edge may be anywhere between the two, or a pixel beside that.
            size = step + 2 * _BESIDE_PX
            widest = maximum_filter1d(strength[axis], size, axis=1 - axis, origin=-(step // 2))
            firsts.append(here)
            seconds.append(other[here])
            found.append(widest[rows[here], columns[here]])
        is_edge = np.concatenate(found) > _EDGE
        clutter = min(max(float(is_edge.mean()), 0.01), _MOST_CLUTTER)
        worth = np.where(is_edge, math.log(_SEEN / clutter), math.log((1.0 - _SEEN) / (1.0 - clutter)))
        return cls(np.concatenate(firsts), np.concatenate(seconds), _ALONG * worth)

    def cost(self, label: NDArray[np.int64]) -> float:
        """Returns how badly borders between pixels (N,) of other labels fit the picture's edges."""
        return -float(self.worth[label[self.first] != label[self.second]].sum())
