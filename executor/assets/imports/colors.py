"""Colours as renderers count them: linear in the amount of light, while most files have them as screens show them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def from_screen(color: ArrayLike) -> tuple[float, ...]:
    """Returns the linear RGB of a colour whose parts, 0 to 1, are encoded as in sRGB.

    OBJ, PLY and DAE have them so, and so do the URDF files of who chose them in a viewer. Source: IEC 61966-2-1.
    """
    encoded = np.clip(np.asarray(color, dtype=float)[:3], 0.0, 1.0)
    return rounded(np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4))


def rounded(color: ArrayLike) -> tuple[float, ...]:
    """Returns the RGB of a colour that is linear already, as glTF has them, without digits that mean nothing."""
    return tuple(round(float(value), 4) for value in np.clip(np.asarray(color, dtype=float)[:3], 0.0, 1.0))
