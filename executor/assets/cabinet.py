"""A base cabinet with a countertop: the front faces -x, the doors under the overhang do not move."""

from __future__ import annotations

from executor.assets.model import Asset, Link, Shape
from executor.assets.parameters import require_size
from executor.assets.shapes import box
from executor.assets.table import top_surface
from oag import SceneObject

_TOP_M = 0.035
_OVERHANG_M = 0.030
_PLINTH_M = 0.080
_KICK_M = 0.050
_PANEL_M = 0.012
_SEAM_M = 0.006
_STONE = (0.72, 0.70, 0.66)
_BODY = (0.60, 0.63, 0.60)
_FRONT = (0.50, 0.56, 0.54)
_METAL = (0.20, 0.20, 0.21)
_DARK = (0.08, 0.08, 0.08)


def cabinet(obj: SceneObject) -> Asset:
    """Returns the cabinet's geometry at the object's size.

    Raises:
        AssetError: When the size does not make a cabinet.
    """
    depth, width, height = require_size(obj, (0.25, 0.25, 0.30))
    x, y, z = depth / 2, width / 2, height / 2
    under = z - _TOP_M
    body_front, body_side = -x + _OVERHANG_M, y - 0.005
    shapes = [
        box((-x, -y, under), (x, y, z), _STONE),
        box((body_front, -body_side, -z + _PLINTH_M), (x - 0.005, body_side, under), _BODY),
        box((body_front + _KICK_M, -y + 0.015, -z), (x - 0.015, y - 0.015, -z + _PLINTH_M), _DARK),
        *_doors(body_front, body_side, -z + _PLINTH_M, under),
    ]
    return Asset(
        category=obj.category,
        motion="static",
        links=(Link("cabinet", tuple(shapes)),),
        extent_m=(depth, width, height),
        regions=(top_surface("cabinet", x, y, z),),
        synset="cabinet.n.01",
    )


def _doors(front: float, half_width: float, low: float, high: float) -> list[Shape]:
    """Door panels with a bar on each; they stay under the overhang, so that only cameras need to see them."""
    count = max(1, round(2 * half_width / 0.45))
    pitch = 2 * half_width / count
    shapes = []
    for index in range(count):
        left = -half_width + index * pitch
        y0, y1 = left + _SEAM_M / 2, left + pitch - _SEAM_M / 2
        panel = (front - _PANEL_M, y0, low + _SEAM_M), (front, y1, high - _SEAM_M)
        shapes.append(box(*panel, _FRONT, collides=False))
        grip_y = y1 - 0.035 if index % 2 == 0 else y0 + 0.035
        grip = (front - _PANEL_M - 0.012, grip_y - 0.005, high - 0.19)
        shapes.append(box(grip, (front - _PANEL_M, grip_y + 0.005, high - 0.05), _METAL, collides=False))
    return shapes
