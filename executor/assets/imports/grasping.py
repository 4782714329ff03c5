"""How wide an item is between two parallel fingers, and along which direction it is narrowest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from executor.assets.model import Vector
from executor.geometry import Array

DIRECTIONS = 36
_ROUND = 1.06
"""Widths of something round differ by no more than this factor."""


@dataclass(frozen=True, slots=True)
class Width:
    """What two fingers meet.

    Attributes:
        narrowest_m: Horizontal width where the item is narrowest.
        axes: Horizontal unit vectors that the fingers can close along; none where all are alike.
        is_round: Whether it is as wide in all directions.
    """

    narrowest_m: float
    axes: tuple[Vector, ...]
    is_round: bool


def width_of(pieces: Sequence[Array]) -> Width:
    """Returns an item's horizontal widths, from the points (N, 3) of its pieces."""
    points = np.concatenate([piece[:, :2] for piece in pieces])
    angles = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
    towards = np.stack([np.cos(angles), np.sin(angles)])
    widths = np.ptp(points @ towards, axis=0)
    narrowest = int(np.argmin(widths))
    if float(widths.max()) <= _ROUND * float(widths[narrowest]):
        return Width(float(widths.max()), (), True)
    # Something square can be taken either way.
    across = (narrowest + DIRECTIONS // 2) % DIRECTIONS
    chosen = [narrowest, across] if widths[across] <= _ROUND * widths[narrowest] else [narrowest]
    axes: tuple[Vector, ...] = tuple(
        (round(float(towards[0, i]), 6), round(float(towards[1, i]), 6), 0.0) for i in chosen
    )
    return Width(float(widths[narrowest]), axes, False)
