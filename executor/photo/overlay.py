"""Pictures of a reconstruction over the photograph: outlines of what was fitted, and a cut of each thing."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from executor.photo.fitting.body import Guess, body_of
from executor.photo.space.observation import Observation, is_hidden

_GOLDEN = 0.61803  # Hues that follow each other by this share of the circle are never alike.
_DIMMED = 0.75
_AROUND = 0.15  # Of a box's sides, shown around it.
_LEAST_SIDE_PX = 24


def colour(number: int) -> NDArray[np.uint8]:
    """Returns the (3,) colour of a thing by its number."""
    return np.array([255 * part for part in colorsys.hsv_to_rgb(number * _GOLDEN % 1.0, 0.85, 1.0)], dtype=np.uint8)


def shown_things(seen: Observation, guesses: Mapping[str, Guess]) -> NDArray[np.int32]:
    """Returns (H, W) which thing each pixel would show, by its place in the mapping; -1 for none of them."""
    depth = np.full(seen.z_m.shape, np.inf)
    owner = np.full(seen.z_m.shape, -1, dtype=np.int32)
    rays = seen.rays.reshape(-1, 3)
    for number, guess in enumerate(guesses.values()):
        body = body_of(guess)
        if body is None:
            continue
        own = body.depth(guess, seen.eye_m, rays).reshape(depth.shape)
        nearer = own < depth
        depth, owner = np.where(nearer, own, depth), np.where(nearer, number, owner)
    # What something unknown hides is not outlined over it.
    return np.where(is_hidden(seen, depth), -1, owner).astype(np.int32)


def outlined(seen: Observation, owner: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Returns the photograph (H, W, 3) with the outline of every fitted thing."""
    picture = (seen.rgb * _DIMMED).astype(np.uint8)
    border = np.zeros(owner.shape, dtype=bool)
    for axis in (0, 1):
        for step in (-1, 1):
            border |= np.roll(owner, step, axis=axis) != owner
    for number in np.unique(owner[owner >= 0]):
        picture[border & (owner == number)] = colour(int(number))
    return picture


def cut(picture: NDArray[np.uint8], box_px: tuple[float, float, float, float]) -> NDArray[np.uint8]:
    """Returns the part of a picture around a box."""
    height, width = picture.shape[:2]
    x0, y0, x1, y1 = box_px
    over_x = max(_AROUND * (x1 - x0), (_LEAST_SIDE_PX - (x1 - x0)) / 2, 0.0)
    over_y = max(_AROUND * (y1 - y0), (_LEAST_SIDE_PX - (y1 - y0)) / 2, 0.0)
    left, right = max(0, int(x0 - over_x)), min(width, int(x1 + over_x) + 1)
    top, bottom = max(0, int(y0 - over_y)), min(height, int(y1 + over_y) + 1)
    return picture[top:bottom, left:right]
