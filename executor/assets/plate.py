"""A dinner plate: a disc with a raised rim of tilted pieces."""

from __future__ import annotations

import math

from executor.assets.entry import SAME_AS_WIDTH, Entry, Span
from executor.assets.model import Asset, Link, Region, Rim, Shape
from executor.assets.parameters import require_size
from executor.assets.placing import yaw_then_pitch
from executor.assets.shapes import revolved
from oag import SceneObject

_RIM_PIECES = 16
_THICK_M = 0.004
_FLOOR_RATIO = 0.66
_DENSITY_KG_M3 = 2000.0
_FRICTION = 0.8
_PORCELAIN, _CENTRE = (0.86, 0.85, 0.81), (0.80, 0.80, 0.78)
_REGION_M = 0.10


def plate(obj: SceneObject) -> Asset:
    """Returns a plate; its diameter is the smaller horizontal extent. Things lie *on* it.

    Raises:
        AssetError: When it is too small for its rim.
    """
    length, width, height = require_size(obj, (0.08, 0.08, 0.010))
    rim, low = min(length, width) / 2, -height / 2
    foot = _FLOOR_RATIO * rim
    floor = Shape(
        kind="cylinder",
        size_m=(foot, _THICK_M / 2),
        position_m=(0.0, 0.0, low + _THICK_M / 2),
        friction=_FRICTION,
        density_kg_m3=_DENSITY_KG_M3,
        visible=False,
    )
    pitch = math.atan2(height - _THICK_M, rim - foot)
    slant = (rim - foot - _THICK_M * math.sin(pitch)) / math.cos(pitch)
    middle = rim - (slant * math.cos(pitch) + _THICK_M * math.sin(pitch)) / 2
    top = height / 2 - (slant * math.sin(pitch) + _THICK_M * math.cos(pitch)) / 2
    pieces = []
    for index in range(_RIM_PIECES):
        angle = 2 * math.pi * index / _RIM_PIECES
        pieces.append(
            Shape(
                kind="box",
                size_m=(slant / 2, rim * math.tan(math.pi / _RIM_PIECES), _THICK_M / 2),
                position_m=(middle * math.cos(angle), middle * math.sin(angle), top),
                orientation=yaw_then_pitch(angle, -pitch),
                friction=_FRICTION,
                density_kg_m3=_DENSITY_KG_M3,
                visible=False,
            )
        )
    below = [[(0.0, low), (foot, low)], [(foot, low), (rim, height / 2)]]
    above = [
        [(rim, height / 2), (rim - 0.002, height / 2)],
        [(rim - 0.002, height / 2), (foot - 0.004, low + _THICK_M)],
    ]
    centre = [[(foot - 0.004, low + _THICK_M), (0.0, low + _THICK_M)]]
    place = foot / math.sqrt(2.0)
    region = Region(
        name="top",
        kind="surface",
        link="plate",
        center_m=(0.0, 0.0, low + _THICK_M + _REGION_M / 2),
        half_extents_m=(place, place, _REGION_M / 2),
        opening=(0.0, 0.0, 1.0),
    )
    look = (revolved([*below, *above], _PORCELAIN), revolved(centre, _CENTRE))
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("plate", (floor, *pieces, *look)),),
        extent_m=(2 * rim, 2 * rim, height),
        regions=(region,),
        symmetric_about_z=True,
        synset="plate.n.04",
        rim=Rim(
            center_m=(0.0, 0.0, top + slant / 2 * math.sin(pitch)),
            radius_m=middle + slant / 2 * math.cos(pitch),
            thickness_m=_THICK_M,
            slope_rad=math.pi / 2 - pitch,
            depth_m=slant,
            sides=_RIM_PIECES,
        ),
    )


ENTRIES = (Entry("plate", "plate", "plate.n.04", plate, SAME_AS_WIDTH, Span(0.17, 0.25), Span(0.016, 0.024)),)
