"""What is to be seen where a scene ends: a computed panorama, looked up where a picture has nothing else in it.

A panorama is (H, W, 3) linear RGB over all directions: rows from straight up to straight down, columns around, as
`executor.pictures.stage` looks it up.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from executor.assets.model import Vector
from executor.geometry import Array
from executor.pictures.stage import Lights, Surroundings

TINTS: Mapping[Surroundings, Vector] = {
    "plain": (1.0, 1.0, 1.0),
    "sky": (0.94, 1.0, 1.10),
    "dusk": (1.12, 0.99, 0.90),
    "hall": (1.05, 1.0, 0.94),
    "forest": (0.95, 1.05, 0.94),
}
"""What light from all around is multiplied by: about the mean of the panorama, none of them dark."""

_ROWS, _COLUMNS = 128, 256  # 1.4 degrees: a few pixels of a camera, as blurred as what is far from the lens.
_PATTERNS = 4
_GROUND = np.array([0.22, 0.21, 0.19])


def drawn_surroundings(rng: np.random.Generator) -> tuple[Surroundings, int]:
    """Returns a kind of panorama and which of them."""
    kinds: tuple[Surroundings, ...] = ("sky", "dusk", "hall", "forest")
    return kinds[int(rng.integers(len(kinds)))], int(rng.integers(_PATTERNS))


def panorama_of(lights: Lights) -> NDArray[np.float32] | None:
    """Returns (H, W, 3) what is around a scene that is lit so, or None where it has the colour of the light there."""
    return None if lights.surroundings == "plain" else _panorama(lights.surroundings, lights.panorama)


@lru_cache(maxsize=32)
def _panorama(kind: Surroundings, number: int) -> NDArray[np.float32]:
    color = np.empty((_ROWS, _COLUMNS, 3))
    rng = np.random.default_rng((zlib.crc32(kind.encode()), number))
    up = np.cos((np.arange(_ROWS) + 0.5) / _ROWS * np.pi)[:, None]  # The height of each row's direction, 1 to -1.

    def noise(rows: float, columns: float) -> NDArray[np.float64]:
        field = gaussian_filter(rng.standard_normal((_ROWS, _COLUMNS)), (rows, columns), mode=("nearest", "wrap"))
        return np.asarray(field / field.std())

    def between(low: tuple[float, float, float], high: tuple[float, float, float], share: Array) -> Array:
        return np.add(low, np.clip(share, 0.0, 1.0)[..., None] * np.subtract(high, low))

    if kind == "hall":
        # Walls with windows in a row, a ceiling above, a floor below.
        bay = np.arange(_COLUMNS) % (_COLUMNS // 8) / (_COLUMNS / 8)
        window = ((bay > 0.25) & (bay < 0.75))[None, :] & (up > 0.05) & (up < 0.42)
        wall = rng.uniform(0.35, 0.75, 3) * 0.5 + 0.25
        color[:] = wall * (0.95 + 0.03 * noise(3.0, 3.0)[..., None])
        color[np.broadcast_to(up > 0.6, color.shape[:2])] = (0.72, 0.71, 0.69)
        color[np.broadcast_to(up < -0.35, color.shape[:2])] = _GROUND * 1.6
        color[window] = (1.0, 1.0, 0.98)
        return gaussian_filter(color, (0.8, 0.8, 0.0), mode=("nearest", "wrap", "nearest")).astype(np.float32)
    if kind == "dusk":
        color[:] = between((0.95, 0.55, 0.30), (0.25, 0.30, 0.50), np.broadcast_to(up * 1.6, color.shape[:2]))
    else:
        color[:] = between((0.75, 0.82, 0.90), (0.25, 0.45, 0.80), np.broadcast_to(up * 1.2, color.shape[:2]))
    clouds = np.clip(0.5 * noise(3.0, 9.0), 0.0, 1.0) * np.clip(4.0 * up, 0.0, 1.0)
    color += 0.6 * clouds[..., None] * (0.9 - color)
    # What stands along the horizon: hills, houses or trees.
    skyline = 0.04 + 0.03 * noise(0.0, 6.0)[0] + (0.22 + 0.08 * noise(0.0, 1.5)[0] if kind == "forest" else 0.0)
    along = (up < skyline[None, :]) & (up >= -0.02)
    tone = (0.10, 0.17, 0.07) if kind == "forest" else (0.24, 0.25, 0.27)
    color[along] = np.asarray(tone) * (1.0 + 0.25 * noise(1.0, 1.0)[along][:, None])
    ground = np.broadcast_to(up < -0.02, color.shape[:2])
    color[ground] = _GROUND * (1.0 + 0.1 * noise(2.0, 2.0)[ground][:, None])
    return np.clip(color, 0.0, 1.0).astype(np.float32)
