"""What carries a cupboard and what covers it: plinths, legs and tops."""

from __future__ import annotations

from executor.assets.casework import Case
from executor.assets.fronts import Color
from executor.assets.model import Region, Shape
from executor.assets.shapes import box
from executor.assets.table import top_surface

_KICK_M = 0.050
_INSET_M = 0.010
_LEG_M = 0.040
_DARK = (0.07, 0.07, 0.08)
_STONE = (0.74, 0.72, 0.68)


def plinth(case: Case) -> Shape:
    """Returns a dark base that stands back from the doors, as a kick space does."""
    (x0, x1), (bottom, _), y, floor = case.x, case.z, case.extent_m[1] / 2, -case.extent_m[2] / 2
    return box((x0 + _KICK_M, -y + _INSET_M, floor), (x1 - _INSET_M, y - _INSET_M, bottom), _DARK)


def legs(case: Case, color: Color) -> list[Shape]:
    """Returns four legs under the corners."""
    (x0, x1), (bottom, _), y, floor = case.x, case.z, case.extent_m[1] / 2, -case.extent_m[2] / 2
    corners = [
        (x, side) for x in (x0 + _INSET_M, x1 - _INSET_M - _LEG_M) for side in (-y + _INSET_M, y - _INSET_M - _LEG_M)
    ]
    return [box((x, side, floor), (x + _LEG_M, side + _LEG_M, bottom), color) for x, side in corners]


def slab(case: Case, overhang_m: float, color: Color = _STONE) -> list[Shape]:
    """Returns what lies on the carcass: a board of `case.top_m` that reaches over the front."""
    (x0, x1), (_, top), y, high = case.x, case.z, case.extent_m[1] / 2, case.extent_m[2] / 2
    return [box((x0 - overhang_m, -y, top), (x1, y, high), color)]


def top_of(case: Case, overhang_m: float = 0.0) -> Region:
    """Returns the place on the cupboard's top."""
    (x0, x1), y, high = case.x, case.extent_m[1] / 2, case.extent_m[2] / 2
    region = top_surface("body", (x1 - x0 + overhang_m) / 2, y, high)
    return Region(
        region.name,
        region.kind,
        region.link,
        ((x0 - overhang_m + x1) / 2, 0.0, region.center_m[2]),
        region.half_extents_m,
        region.opening,
    )
