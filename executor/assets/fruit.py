"""An orange, and half an apple that lies on its cut."""

from __future__ import annotations

import itertools

import numpy as np

from executor.assets.entry import SAME_AS_WIDTH, Entry, Span
from executor.assets.model import Asset, Link, Shape
from executor.assets.parameters import require_size
from executor.assets.shapes import revolved
from oag import SceneObject

_ORANGE, _NAVEL = (0.80, 0.30, 0.02), (0.20, 0.26, 0.05)
_RED, _FLESH = (0.62, 0.045, 0.035), (0.85, 0.78, 0.55)
_FRICTION = 0.9
_DENSITY_KG_M3 = 850.0
_SLICES = 5
_LOWEST_SHARE = 0.65
_FULLNESS = 3.5
"""Exponent of half an apple's profile: 2 would be a dome like half a ball's; apples are fuller."""


def orange(obj: SceneObject) -> Asset:
    """Returns an orange: a sphere as high as the object.

    Raises:
        AssetError: When it is too small to hold.
    """
    _, _, height = require_size(obj, (0.02, 0.02, 0.02))
    radius = height / 2
    ball = Shape(
        kind="sphere", size_m=(radius,), friction=_FRICTION, density_kg_m3=_DENSITY_KG_M3, color=_ORANGE, visible=False
    )
    polar = np.linspace(-np.pi / 2, np.pi / 2, 25)
    dent = 1.0 - 0.05 * np.exp(-(((np.pi / 2 - polar) / 0.3) ** 2))
    outline = [(float(r), float(z)) for r, z in zip(radius * np.cos(polar), radius * dent * np.sin(polar), strict=True)]
    outline[0], outline[-1] = (0.0, outline[0][1]), (0.0, outline[-1][1])
    top = outline[-1][1]
    navel = [
        [(0.07 * radius, top - 0.02 * radius), (0.05 * radius, top + 0.03 * radius)],
        [(0.05 * radius, top + 0.03 * radius), (0.0, top + 0.03 * radius)],
    ]
    look = (revolved([outline], _ORANGE), revolved(navel, _NAVEL, segments=10))
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("orange", (ball, *look)),),
        extent_m=(height, height, height),
        symmetric_about_z=True,
        graspable_width_m=height,
        synset="orange.n.01",
    )


def half_apple(obj: SceneObject) -> Asset:
    """Returns half an apple, cut face down: physics sees a stack of discs that fills it.

    Raises:
        AssetError: When it is too small to hold.
    """
    length, width, height = require_size(obj, (0.03, 0.03, 0.012))
    radius = min(length, width) / 2
    edges = [0.0, *np.linspace(_LOWEST_SHARE, 1.0, _SLICES)]
    discs = []
    for low, high in itertools.pairwise(edges):
        # A disc is as wide as the apple at the disc's middle; the lowest one is as wide as the cut, and so high that
        # the middle of tilted fingers gets hold of its side: with their tips alone they slip over its edge.
        level = 0.0 if low == 0.0 else (low + high) / 2
        discs.append(
            Shape(
                kind="cylinder",
                size_m=(radius * _fullness(level), (high - low) / 2 * height),
                position_m=(0.0, 0.0, ((low + high) / 2 - 0.5) * height),
                friction=_FRICTION,
                density_kg_m3=_DENSITY_KG_M3,
                visible=False,
            )
        )
    angles = np.linspace(0.0, np.pi / 2, 13)
    dome = [(float(radius * _fullness(np.sin(a))), float(-height / 2 + height * np.sin(a))) for a in angles]
    dome[-1] = (0.0, dome[-1][1])
    cut = [[(0.0, -height / 2), (radius, -height / 2)]]
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("apple", (*discs, revolved([dome], _RED), revolved(cut, _FLESH))),),
        extent_m=(2 * radius, 2 * radius, height),
        symmetric_about_z=True,
        graspable_width_m=2 * radius,
        synset="half__apple.n.01",
    )


def _fullness(level: float) -> float:
    """Radius of half an apple at a fraction of its height, as a fraction of that of its cut."""
    return float(max(1.0 - level**_FULLNESS, 0.0) ** (1.0 / _FULLNESS))


ENTRIES = (
    Entry("orange", "orange", "orange.n.01", orange, SAME_AS_WIDTH, Span(0.060, 0.085), SAME_AS_WIDTH),
    Entry(
        "half_apple",
        "half_apple",
        "half__apple.n.01",
        half_apple,
        SAME_AS_WIDTH,
        Span(0.055, 0.085),
        Span(0.45, 0.52, of_width=True),
    ),
)
