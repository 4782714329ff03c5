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
    pieces = (_rim_piece(index, middle, top, pitch, slant, rim) for index in range(_RIM_PIECES))
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("plate", (floor, *pieces, *_look(foot, rim, height))),),
        extent_m=(2 * rim, 2 * rim, height),
        regions=(_top(foot, low + _THICK_M),),
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


def _rim_piece(index: int, middle_m: float, top_m: float, pitch_rad: float, slant_m: float, rim_m: float) -> Shape:
    angle = 2 * math.pi * index / _RIM_PIECES
    return Shape(
        kind="box",
        size_m=(slant_m / 2, rim_m * math.tan(math.pi / _RIM_PIECES), _THICK_M / 2),
        position_m=(middle_m * math.cos(angle), middle_m * math.sin(angle), top_m),
        orientation=yaw_then_pitch(angle, -pitch_rad),
        friction=_FRICTION,
        density_kg_m3=_DENSITY_KG_M3,
        visible=False,
    )


def _top(foot_m: float, floor_m: float) -> Region:
    """Returns where things lie: the square within the foot."""
    place = foot_m / math.sqrt(2.0)
    return Region(
        name="top",
        kind="surface",
        link="plate",
        center_m=(0.0, 0.0, floor_m + _REGION_M / 2),
        half_extents_m=(place, place, _REGION_M / 2),
        opening=(0.0, 0.0, 1.0),
    )


def _look(foot: float, rim: float, height: float) -> tuple[Shape, Shape]:
    """Returns a white plate with a greyer middle."""
    low, high = -height / 2, height / 2
    below = [[(0.0, low), (foot, low)], [(foot, low), (rim, high)]]
    above = [
        [(rim, high), (rim - 0.002, high)],
        [(rim - 0.002, high), (foot - 0.004, low + _THICK_M)],
    ]
    centre = [[(foot - 0.004, low + _THICK_M), (0.0, low + _THICK_M)]]
    return revolved([*below, *above], _PORCELAIN), revolved(centre, _CENTRE)


ENTRIES = (Entry("plate", "plate", "plate.n.04", plate, SAME_AS_WIDTH, Span(0.17, 0.25), Span(0.016, 0.024)),)
