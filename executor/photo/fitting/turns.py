"""A box that was found, as the box of other models and turned otherwise.

What a search learns of a thing's sides holds for whatever it is and whichever side is its front, but for what stands
out in front: handles belong to the box, so that the panels of a front are behind the box's face.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from executor.assets.parameters import ModelEntry
from executor.photo.fitting.body import Guess, body_of, has_ear, is_round
from oag import Kind, kind_of

_LOOKED = np.linspace(-0.4, 0.4, 7)  # Shares of width and height at which a front is looked at.

_SIDES_M = (-0.2, -0.1, -0.05, 0.05, 0.1, 0.2)  # By which sides are moved that may have been misjudged.
_LEAST_M = 0.2  # Of a side that is.

_SAME_M, _ASKEW_RAD = 0.02, math.radians(2.0)  # About what the noise of depths does to sides and turns.


def all_turns(found: Guess, entries: Sequence[ModelEntry]) -> Iterator[Guess]:
    """Yields a guess's box as that of every model, turned four ways where turns can be told apart.

    Args:
        found: Whose sides are about right.
        entries: The models.
    """
    panels = _pushed(found, _inset_m(found))
    for entry in entries:
        for quarter in range(1 if is_round(entry) else 4):
            length, width, height = panels.size_m
            size = (width, length, height) if quarter % 2 else (length, width, height)
            if has_ear(entry):
                # The box was one's without an ear, or its ear lay otherwise.
                round_m = min(length, width)
                size = entry.length.clipped(length, round_m), round_m, height
            bare = replace(
                panels, entry=entry, parameters=(), size_m=size, yaw_rad=panels.yaw_rad + quarter * math.pi / 2
            )
            yield _pushed(bare, -_inset_m(bare))


def reshaped(found: Guess) -> Iterator[Guess]:
    """Yields a guess with one of its upright sides farther out or farther in, the side behind it where it is."""
    c, s = math.cos(found.yaw_rad), math.sin(found.yaw_rad)
    for axis, side, by_m in itertools.product(range(2), (-0.5, 0.5), _SIDES_M):
        length, width, height = (own + by_m * (index == axis) for index, own in enumerate(found.size_m))
        x, y = (side * by_m * (index == axis) for index in range(2))
        if min(length, width) > _LEAST_M:
            at = found.x_m + c * x - s * y, found.y_m + s * x + c * y
            yield replace(found, x_m=at[0], y_m=at[1], size_m=(length, width, height))


def quarter_of(guess: Guess) -> int:
    """Returns which quarter of the circle its heading is in, for telling turns apart."""
    return round(guess.yaw_rad / (math.pi / 2)) % 4


def is_same_box(first: Guess, second: Guess) -> bool:
    """Decides whether two guesses are of one box but for a centimetre or two, whichever of its sides is the front."""
    turned = first.yaw_rad - second.yaw_rad
    length, width = second.size_m[:2] if abs(math.cos(turned)) > math.sqrt(0.5) else second.size_m[1::-1]
    sizes_m = np.subtract(first.size_m, (length, width, second.size_m[2]))
    apart_m = np.subtract((first.x_m, first.y_m, first.bottom_m), (second.x_m, second.y_m, second.bottom_m))
    askew = abs(math.remainder(turned, math.pi / 2)) > _ASKEW_RAD
    return not askew and bool(np.abs(sizes_m).max() < _SAME_M and np.abs(apart_m).max() < _SAME_M)


def _pushed(guess: Guess, by_m: float) -> Guess:
    """With its front moved backwards, its back where it is."""
    length, width, height = guess.size_m
    c, s = math.cos(guess.yaw_rad), math.sin(guess.yaw_rad)
    size = max(length - by_m, length / 2), width, height
    return replace(guess, x_m=guess.x_m + c * by_m / 2, y_m=guess.y_m + s * by_m / 2, size_m=size)


def _inset_m(guess: Guess) -> float:
    """How far the panels of a front are behind the face of its box."""
    body = body_of(guess) if kind_of(guess.entry.category, guess.size_m[1]) is Kind.ARTICULATED else None
    if body is None:
        return 0.0
    length, width, height = guess.size_m
    still = replace(guess, x_m=0.0, y_m=0.0, yaw_rad=0.0, bottom_m=-height / 2)
    across, up = np.meshgrid(_LOOKED * width, _LOOKED * height)
    before = 2.0 * length
    targets = np.stack([np.zeros(across.size), across.ravel(), up.ravel()], axis=1)
    # Rays from far away are as good as parallel ones.
    eye = np.array([-before * 100.0, 0.0, 0.0])
    rays = targets + [-length / 2, 0.0, 0.0] - eye
    share = body.depth(still, eye, rays)
    hit_x = eye[0] + rays[:, 0] * share
    hits = hit_x[np.isfinite(hit_x)]
    return float(np.clip(np.median(hits) + length / 2, 0.0, length / 4)) if len(hits) else 0.0
