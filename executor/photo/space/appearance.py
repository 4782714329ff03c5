"""What a picture's colours say of where a thing ends: colours that are seen beside it, edges, and how far one hue goes.

A guess that is right ends where the picture has edges, and what it leaves to others is of colours that others have.
Both are found once for the pixels of a thing, so that a guess costs next to nothing more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, maximum_filter1d

from executor.geometry import Array

_AROUND, _LEAST_PX = 0.5, 24.0  # Of a box's sides, and in pixels, how far around it colours of others are looked for.
_SHADES, _LEAST_SHARE = 16, 0.004  # Steps of each colour; of the pixels, how many a colour has that is there.
_EDGE = 0.035  # Of full brightness: what differs by more across two pixels is an edge.
_BESIDE_PX = 1  # How far an edge may be from where a guess has it.
_SEEN = 0.8  # Of what a model shows as an edge, the picture has as one; faces may look alike.
_MOST_CLUTTER = 0.5
_BESIDE_FOOT = 0.15  # Of a box's height, how far beside it is looked for what it stands on.
_LEAST_CHROMA, _SAME_HUE_RAD, _SAME_CHROMA, _SAME_LIGHT = 12.0, 0.15, (0.5, 1.6), 40.0
"""In CIELAB: what has less is grey, as floor and walls are too; what faces of one thing differ by, lit or not."""
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


def of_one_hue(rgb: NDArray[np.uint8], box_px: tuple[float, float, float, float]) -> NDArray[np.bool_] | None:
    """Returns (H, W) the piece of the picture around a box that is of the hue which is seen beside its foot, and it.

    None where that is grey.

    Args:
        rgb: (H, W, 3) the picture.
        box_px: The box.
    """
    x0, y0, x1, y1 = (round(value) for value in box_px)
    height, width = rgb.shape[:2]
    beside = max(3, round(_BESIDE_FOOT * (y1 - y0)))
    low, high = round((y0 + 2 * y1) / 3), y1 + beside
    around = [(x0 - beside, y0), (x1 + beside, y0), (x0 - beside, low), (x1 + beside, low), ((x0 + x1) // 2, high)]
    lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255.0), cv2.COLOR_RGB2LAB)
    seen = [lab[y, x] for x, y in around if 0 <= x < width and 0 <= y < height]
    if not seen:
        return None
    light, a, b = np.median(seen, axis=0)
    own = math.hypot(a, b)
    if own < _LEAST_CHROMA:
        return None
    chroma = np.hypot(lab[..., 1], lab[..., 2])
    # The cosine of the angle between two colours' hues, times both chromas.
    alike = lab[..., 1] * a + lab[..., 2] * b > math.cos(_SAME_HUE_RAD) * own * chroma
    alike &= (chroma > _SAME_CHROMA[0] * own) & (chroma < _SAME_CHROMA[1] * own)
    alike &= np.abs(lab[..., 0] - light) < _SAME_LIGHT
    alike[max(0, y0 - 1) : y1 + 2, max(0, x0 - 1) : x1 + 2] = True
    pieces, _ = label(alike)
    return np.asarray(pieces == pieces[min(height - 1, (y0 + y1) // 2), min(width - 1, (x0 + x1) // 2)])


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
