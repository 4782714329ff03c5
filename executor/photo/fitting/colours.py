"""The colours of a thing as they were seen, and which of a model's own colours that is."""

from __future__ import annotations

import numpy as np

from executor.assets.parameters import Option
from executor.geometry import Array
from executor.photo.fitting.body import Guess, body_of
from executor.photo.fitting.patch import Patch

_OPTION = "color"
_LEAST_PX = 12
_SHARE_OF_LIGHT = 0.15
"""What a doubling of the light counts for, beside the share of each colour in it: who has seen a picture knows what
colours are in it, and little of how bright the room was."""


def seen_colour(patch: Patch, guess: Guess) -> tuple[int, int, int] | None:
    """Returns the middle one of the colours that a thing shows, as sRGB from 0 to 255; None where it is hidden."""
    shown, _ = _shown(patch, guess)
    if len(shown) < _LEAST_PX:
        return None
    red, green, blue = (round(255.0 * float(value)) for value in np.median(shown, axis=0))
    return red, green, blue


def unlike_seen(patch: Patch, guess: Guess) -> float:
    """Returns how far a model's own colours are from what was seen, 0 to about 2; 0 where nothing of it is seen."""
    shown, own = _shown(patch, coloured(patch, guess))
    return _unlike(_linear(shown), own) if len(shown) >= _LEAST_PX else 0.0


def coloured(patch: Patch, guess: Guess) -> Guess:
    """Returns a guess with that of its model's colours which is most like what was seen; as it is where it has none."""
    option = next((one for one in guess.entry.parameters if isinstance(one, Option) and one.name == _OPTION), None)
    if option is None:
        return guess
    rated = []
    for word in option.words:
        one = guess.with_parameters(**{_OPTION: word})
        shown, own = _shown(patch, one)
        if len(shown) < _LEAST_PX:
            return guess
        rated.append((_unlike(_linear(shown), own), word))
    return guess.with_parameters(**{_OPTION: min(rated)[1]})


def _shown(patch: Patch, guess: Guess) -> tuple[Array, Array]:
    """(N, 3) sRGB in 0 to 1 of the pixels that show a thing, and (N, 3) linear colours that its model has there."""
    body = body_of(guess)
    if body is None:
        return np.zeros((0, 3)), np.zeros((0, 3))
    depth, colors = body.colours(guess, patch.seen.eye_m, patch.rays)
    own = patch.inside & (depth < patch.other_m)
    if patch.has_depth:
        own &= np.abs(patch.z_m - depth) < 3.0 * patch.sigma_m + 0.01
    return patch.rgb[own], colors[own]


def _linear(srgb: Array) -> Array:
    """What a screen's numbers say of light (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _unlike(seen: Array, own: Array) -> float:
    """How far colours are apart: by the shares of red, green and blue, and a little by how light they are."""
    seen, own = np.maximum(seen, 1e-3), np.maximum(own, 1e-3)
    shares = np.abs(seen / seen.sum(axis=1, keepdims=True) - own / own.sum(axis=1, keepdims=True)).sum(axis=1)
    light = np.abs(np.log2(seen.sum(axis=1) / own.sum(axis=1)))
    return float(np.mean(shares + _SHARE_OF_LIGHT * light))
