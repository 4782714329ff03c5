"""A drinking glass: physics sees a cylinder, cameras see a hollow glass that widens towards the rim."""

from __future__ import annotations

from executor.assets.model import Asset, Link, Shape
from executor.assets.parameters import require_size
from executor.assets.shapes import revolved
from oag import SceneObject

_DENSITY_KG_M3 = 600.0
_COLOR = (0.30, 0.62, 0.88, 0.60)


def water_glass(obj: SceneObject) -> Asset:
    """Returns the glass's geometry at the object's size; its diameter is the smaller horizontal extent.

    Raises:
        AssetError: When the glass is too small to hold.
    """
    length, width, height = require_size(obj, (0.02, 0.02, 0.03))
    radius = min(length, width) / 2
    cylinder = Shape(
        kind="cylinder",
        size_m=(radius, height / 2),
        color=_COLOR,
        friction=0.9,
        density_kg_m3=_DENSITY_KG_M3,
        visible=False,
    )
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("glass", (cylinder, _look(radius, height / 2))),),
        extent_m=(2 * radius, 2 * radius, height),
        symmetric_about_z=True,
        graspable_width_m=2 * radius,
        synset="water_glass.n.02",
    )


def _look(rim: float, half: float) -> Shape:
    foot, wall = 0.82 * rim, max(0.0012, 0.06 * rim)
    floor = -half + 0.09 * half
    outside = [(0.0, -half), (foot * 0.98, -half)]
    up = [(foot * 0.98, -half), (foot, -half + 0.02 * half), (rim, half)]
    edge = [(rim, half), (rim - wall, half)]
    down = [(rim - wall, half), (foot - wall, floor)]
    inner_floor = [(foot - wall, floor), (0.0, floor)]
    return revolved([outside, up, edge, down, inner_floor], _COLOR)
