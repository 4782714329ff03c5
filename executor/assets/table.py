"""A table: one top on four legs. Parameter: `top_thickness_m`."""

from __future__ import annotations

from executor.assets.model import Asset, Link, Region
from executor.assets.parameters import number, require_size
from executor.assets.shapes import box
from oag import SceneObject

REGION_HEIGHT_M = 0.40
_LEG_M = 0.045
_INSET_M = 0.010
_WOOD = (0.48, 0.29, 0.15)
_DARK_WOOD = (0.33, 0.19, 0.09)


def table(obj: SceneObject) -> Asset:
    """Returns the table's geometry at the object's size.

    Raises:
        AssetError: When the size or the thickness does not make a table.
    """
    length, width, height = require_size(obj, (0.20, 0.20, 0.15))
    thickness = number(obj, "top_thickness_m", 0.030, 0.010, 0.10)
    x, y, z = length / 2, width / 2, height / 2
    under = z - thickness
    shapes = [box((-x, -y, under), (x, y, z), _WOOD)]
    for side_x in (-1.0, 1.0):
        for side_y in (-1.0, 1.0):
            corner_x, corner_y = side_x * (x - _INSET_M), side_y * (y - _INSET_M)
            inner_x, inner_y = corner_x - side_x * _LEG_M, corner_y - side_y * _LEG_M
            low = (min(corner_x, inner_x), min(corner_y, inner_y), -z)
            shapes.append(box(low, (low[0] + _LEG_M, low[1] + _LEG_M, under), _DARK_WOOD))
    return Asset(
        category=obj.category,
        motion="static",
        links=(Link("table", tuple(shapes)),),
        extent_m=(length, width, height),
        regions=(top_surface("table", x, y, z),),
        synset="table.n.02",
    )


def top_surface(link: str, half_x_m: float, half_y_m: float, top_m: float) -> Region:
    """Returns the region above a flat top, in the link frame."""
    return Region(
        name="top",
        kind="surface",
        link=link,
        center_m=(0.0, 0.0, top_m + REGION_HEIGHT_M / 2),
        half_extents_m=(half_x_m, half_y_m, REGION_HEIGHT_M / 2),
        opening=(0.0, 0.0, 1.0),
    )
