"""An apple: physics sees a sphere, cameras see a body with dimples and a stem."""

from __future__ import annotations

import numpy as np

from executor.assets.model import Asset, Link, Shape
from executor.assets.parameters import require_size
from executor.assets.shapes import revolved
from oag import SceneObject

_DENSITY_KG_M3 = 800.0
_RED = (0.62, 0.045, 0.035)
_STEM = (0.16, 0.09, 0.03)


def apple(obj: SceneObject) -> Asset:
    """Returns the apple's geometry: a sphere as high as the object, so that it rests where it rested.

    Raises:
        AssetError: When the apple is too small to hold.
    """
    _, _, height = require_size(obj, (0.02, 0.02, 0.02))
    radius = height / 2
    ball = Shape(kind="sphere", size_m=(radius,), friction=0.9, density_kg_m3=_DENSITY_KG_M3, color=_RED, visible=False)
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("apple", (ball, *_look(radius))),),
        extent_m=(height, height, height),
        symmetric_about_z=True,
        graspable_width_m=height,
        synset="apple.n.01",
    )


def _look(radius: float) -> list[Shape]:
    """A sphere pressed in at both poles, narrower below, with a stem that ends under the sphere's top."""
    polar = np.linspace(-np.pi / 2, np.pi / 2, 25)
    dimple = 0.22 * np.exp(-(((np.pi / 2 - polar) / 0.42) ** 2))
    dimple += 0.06 * np.exp(-(((np.pi / 2 + polar) / 0.5) ** 2))
    across = radius * np.cos(polar) * (1 - 0.07 * (1 - np.sin(polar)) / 2)
    height = radius * (np.sin(polar) - np.where(polar > 0, dimple, -dimple))
    body = [(float(max(r, 0.0)), float(z)) for r, z in zip(across, height, strict=True)]
    body[0], body[-1] = (0.0, body[0][1]), (0.0, body[-1][1])
    thick, low, high = 0.05 * radius, body[-1][1] - 0.05 * radius, 0.98 * radius
    stem = [[(thick, low), (0.8 * thick, high)], [(0.8 * thick, high), (0.0, high)]]
    return [revolved([body], _RED), revolved(stem, _STEM, segments=10)]
