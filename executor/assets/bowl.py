"""An open bowl: physics sees a floor and a ring of tilted wall pieces, so that things lie inside it."""

from __future__ import annotations

import math

from executor.assets.model import Asset, Link, Region, Rim, Shape
from executor.assets.parameters import require_size
from executor.assets.placing import yaw_then_pitch
from executor.assets.shapes import revolved
from oag import SceneObject

WALL_PIECES = 16
_WALL_M = 0.004
_FLOOR_RATIO = 0.54
_DENSITY_KG_M3 = 1500.0
_FRICTION = 0.8
_PORCELAIN = (0.86, 0.85, 0.80)
_GLAZE = (0.20, 0.36, 0.50)


def bowl(obj: SceneObject) -> Asset:
    """Returns the bowl's geometry; its diameter is the smaller horizontal extent.

    Raises:
        AssetError: When the bowl is too small for its walls.
    """
    length, width, height = require_size(obj, (0.06, 0.06, 0.025))
    rim = min(length, width) / 2
    floor_radius = _FLOOR_RATIO * rim
    tilt = math.atan2(rim - floor_radius, height)
    # Wall pieces end inside the bowl's height and rim although they are tilted and have a thickness.
    slant = (height - _WALL_M * math.sin(tilt)) / math.cos(tilt)
    middle = rim - _WALL_M / 2 * math.cos(tilt) - slant / 2 * math.sin(tilt)
    foot = middle - slant / 2 * math.sin(tilt)
    floor = Shape(
        kind="cylinder",
        size_m=(foot, _WALL_M / 2),
        position_m=(0.0, 0.0, -height / 2 + _WALL_M / 2),
        friction=_FRICTION,
        density_kg_m3=_DENSITY_KG_M3,
        visible=False,
    )
    walls = tuple(_wall(index, middle, tilt, slant, rim) for index in range(WALL_PIECES))
    inner = foot + (rim - foot) / 2 - _WALL_M
    low = -height / 2 + _WALL_M
    region = Region(
        name="hollow",
        kind="interior",
        link="bowl",
        center_m=(0.0, 0.0, (low + height / 2) / 2),
        half_extents_m=(inner, inner, (height / 2 - low) / 2),
        opening=(0.0, 0.0, 1.0),
    )
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("bowl", (floor, *walls, *_look(foot, rim, height))),),
        extent_m=(2 * rim, 2 * rim, height),
        regions=(region,),
        symmetric_about_z=True,
        synset="bowl.n.01",
        rim=Rim(
            center_m=(0.0, 0.0, slant / 2 * math.cos(tilt)),
            radius_m=middle + slant / 2 * math.sin(tilt),
            thickness_m=_WALL_M,
            slope_rad=tilt,
            depth_m=slant,
            sides=WALL_PIECES,
        ),
    )


def _wall(index: int, middle_m: float, tilt_rad: float, slant_m: float, rim_m: float) -> Shape:
    angle = 2 * math.pi * index / WALL_PIECES
    half_width = rim_m * math.tan(math.pi / WALL_PIECES)
    return Shape(
        kind="box",
        size_m=(_WALL_M / 2, half_width, slant_m / 2),
        position_m=(middle_m * math.cos(angle), middle_m * math.sin(angle), 0.0),
        orientation=yaw_then_pitch(angle, tilt_rad),
        friction=_FRICTION,
        density_kg_m3=_DENSITY_KG_M3,
        visible=False,
    )


def _look(foot: float, rim: float, height: float) -> list[Shape]:
    """A rounded wall between foot and rim: porcelain outside, glazed inside."""
    low, high = -height / 2, height / 2
    steps = [index / 12 for index in range(13)]

    def wall(inset: float, bottom: float) -> list[tuple[float, float]]:
        # A quarter of an ellipse bulges outwards; a third of it keeps the wall near the physical one.
        return [
            (
                foot + (rim - foot) * (0.65 * t + 0.35 * math.sin(t * math.pi / 2)) - inset,
                bottom + (high - bottom) * (0.65 * t + 0.35 * (1 - math.cos(t * math.pi / 2))),
            )
            for t in steps
        ]

    outer, inner = wall(0.0, low), wall(_WALL_M, low + _WALL_M)
    outside = [[(0.0, low), outer[0]], outer, [outer[-1], (rim - _WALL_M, high)]]
    inside = [inner[::-1], [inner[0], (0.0, low + _WALL_M)]]
    return [revolved(outside, _PORCELAIN), revolved(inside, _GLAZE)]
