"""A piece of a room's wall: a flat slab that furniture stands against and that the robot keeps off."""

from __future__ import annotations

from executor.assets.model import Asset, Link
from executor.assets.parameters import require_size
from executor.assets.shapes import box
from oag import SceneObject

_PLASTER = (0.72, 0.70, 0.66)
_SKIRTING = (0.50, 0.48, 0.45)
_SKIRTING_M = (0.006, 0.07)


def wall(obj: SceneObject) -> Asset:
    """Returns the wall's geometry at the object's size; its inner side faces -x.

    Raises:
        AssetError: When the size does not make a wall.
    """
    thickness, length, height = require_size(obj, (0.02, 0.20, 0.20))
    x, y, z = thickness / 2, length / 2, height / 2
    depth, high = _SKIRTING_M
    slab = box((-x, -y, -z), (x, y, z), _PLASTER)
    skirting = box((-x - depth, -y, -z), (-x, y, -z + high), _SKIRTING, collides=False)
    return Asset(
        category=obj.category,
        motion="static",
        links=(Link("wall", (slab, skirting)),),
        extent_m=(thickness, length, height),
        synset="wall.n.01",
    )
