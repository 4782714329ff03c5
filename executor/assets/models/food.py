"""Fruit: an apple, an orange, and half an apple that lies on its cut."""

from __future__ import annotations

import itertools

import numpy as np

from executor.assets.model import Asset, Shape
from executor.assets.parameters import require_size
from executor.assets.parts.shapes import Color, edged, revolved, round_item
from oag import SceneObject

_RED, _STEM, _FLESH = (0.62, 0.045, 0.035), (0.16, 0.09, 0.03), (0.85, 0.78, 0.55)
_ORANGE, _NAVEL = (0.80, 0.30, 0.02), (0.20, 0.26, 0.05)
_FRICTION = 0.9
_SLICES = 5
_LOWEST_SHARE = 0.65
_FULLNESS = 3.5
"""Exponent of half an apple's profile: 2 would be a dome like half a ball's; apples are fuller."""


def apple(obj: SceneObject) -> Asset:
    """Returns an apple: for physics a sphere as high as the object; cameras see dimples and a stem."""
    _, _, height = require_size(obj, (0.02, 0.02, 0.02))
    radius, polar = height / 2, np.linspace(-np.pi / 2, np.pi / 2, 25)
    # Pressed in at both poles, narrower below, with a stem that ends under the sphere's top.
    dimple = 0.22 * np.exp(-(((np.pi / 2 - polar) / 0.42) ** 2))
    dimple += 0.06 * np.exp(-(((np.pi / 2 + polar) / 0.5) ** 2))
    across = radius * np.cos(polar) * (1 - 0.07 * (1 - np.sin(polar)) / 2)
    heights = radius * (np.sin(polar) - np.where(polar > 0, dimple, -dimple))
    body = [(float(max(r, 0.0)), float(z)) for r, z in zip(across, heights, strict=True)]
    body[0], body[-1] = (0.0, body[0][1]), (0.0, body[-1][1])
    thick, low, high = 0.05 * radius, body[-1][1] - 0.05 * radius, 0.98 * radius
    stem = edged((thick, low), (0.8 * thick, high), (0.0, high))
    look = (revolved([body], _RED), revolved(stem, _STEM, segments=10))
    return round_item(obj, "apple", (_ball(radius, _RED, 800.0), *look), radius, height, "apple.n.01")


def orange(obj: SceneObject) -> Asset:
    """Returns an orange: a sphere as high as the object."""
    _, _, height = require_size(obj, (0.02, 0.02, 0.02))
    radius, polar = height / 2, np.linspace(-np.pi / 2, np.pi / 2, 25)
    dent = 1.0 - 0.05 * np.exp(-(((np.pi / 2 - polar) / 0.3) ** 2))
    outline = [(float(r), float(z)) for r, z in zip(radius * np.cos(polar), radius * dent * np.sin(polar), strict=True)]
    outline[0], outline[-1] = (0.0, outline[0][1]), (0.0, outline[-1][1])
    top = outline[-1][1]
    higher = top + 0.03 * radius
    navel = edged((0.07 * radius, top - 0.02 * radius), (0.05 * radius, higher), (0.0, higher))
    look = (revolved([outline], _ORANGE), revolved(navel, _NAVEL, segments=10))
    return round_item(obj, "orange", (_ball(radius, _ORANGE, 850.0), *look), radius, height, "orange.n.01")


def _ball(radius: float, color: Color, density: float) -> Shape:
    return Shape("sphere", (radius,), color=color, friction=_FRICTION, density_kg_m3=density, visible=False)


def half_apple(obj: SceneObject) -> Asset:
    """Returns half an apple, cut face down: physics sees a stack of discs that fills it."""
    length, width, height = require_size(obj, (0.03, 0.03, 0.012))
    radius = min(length, width) / 2
    discs = []
    for low, high in itertools.pairwise([0.0, *np.linspace(_LOWEST_SHARE, 1.0, _SLICES)]):
        # A disc is as wide as the apple at the disc's middle; the lowest one is as wide as the cut, and so high that
        # the middle of tilted fingers gets hold of its side: with their tips alone they slip over its edge.
        level = 0.0 if low == 0.0 else (low + high) / 2
        discs.append(
            Shape(
                kind="cylinder",
                size_m=(radius * _fullness(level), (high - low) / 2 * height),
                position_m=(0.0, 0.0, ((low + high) / 2 - 0.5) * height),
                friction=_FRICTION,
                density_kg_m3=850.0,
                visible=False,
            )
        )
    angles = np.linspace(0.0, np.pi / 2, 13)
    dome = [(float(radius * _fullness(np.sin(a))), float(-height / 2 + height * np.sin(a))) for a in angles]
    dome[-1] = (0.0, dome[-1][1])
    cut = edged((0.0, -height / 2), (radius, -height / 2))
    shapes = (*discs, revolved([dome], _RED), revolved(cut, _FLESH))
    return round_item(obj, "apple", shapes, radius, height, "half__apple.n.01")


def _fullness(level: float) -> float:
    """Radius of half an apple at a fraction of its height, as a fraction of that of its cut."""
    return float(max(1.0 - level**_FULLNESS, 0.0) ** (1.0 / _FULLNESS))
