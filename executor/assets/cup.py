"""A cup without a handle, and a mug with one; both are hollow."""

from __future__ import annotations

import math
from itertools import pairwise

from executor.assets.entry import SAME_AS_WIDTH, Entry, Option, Span
from executor.assets.model import Asset, Link, Shape
from executor.assets.parameters import AssetError, require_size
from executor.assets.placing import shifted
from executor.assets.vessels import hollow, upright_rim, vessel_look, vessel_shapes
from oag import SceneObject

COLOR = Option("color", ("white", "blue", "green", "red"))
_COLORS = {
    "white": (0.84, 0.83, 0.79),
    "blue": (0.10, 0.22, 0.45),
    "green": (0.16, 0.36, 0.22),
    "red": (0.52, 0.08, 0.07),
}
_INSIDE = (0.88, 0.87, 0.84)
_WALL_M = 0.0035
_DENSITY_KG_M3 = 2000.0
_FRICTION = 0.9
_EAR_PIECES = 5
_EAR_M = 0.009


def cup(obj: SceneObject) -> Asset:
    """Returns a cup; its diameter is the smaller horizontal extent.

    Raises:
        AssetError: When it is too small for its walls.
    """
    length, width, height = require_size(obj, (0.03, 0.03, 0.03))
    return _vessel(obj, min(length, width) / 2, height, "cup", "cup.n.01")


def mug(obj: SceneObject) -> Asset:
    """Returns a mug; its width (y) is the body's diameter, and the ear fills the rest of its length towards +x.

    Raises:
        AssetError: When it is too small, or leaves the ear no room.
    """
    length, width, height = require_size(obj, (0.03, 0.03, 0.04))
    reach = length - width
    if reach < 1.5 * _EAR_M:
        least = width + 1.5 * _EAR_M
        raise AssetError(obj, f"its x extent is {length:.3f} m", f"the mug's ear needs at least {least:.3f} m")
    asset = _vessel(obj, width / 2, height, "mug", "mug.n.04")
    color = _COLORS[COLOR.read(obj)]
    body = Link("mug", (*asset.links[0].shapes, *_ear(width / 2, reach, height, color)))
    centred = shifted(_with(asset, body), (-reach / 2, 0.0, 0.0))
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=centred.links,
        extent_m=(length, width, height),
        regions=centred.regions,
        graspable_width_m=width,
        synset="mug.n.04",
        grasp_axes=((0.0, 1.0, 0.0),),
        grasp_point_m=(-reach / 2, 0.0, 0.0),
        rim=centred.rim,
    )


def _with(asset: Asset, body: Link) -> Asset:
    return Asset(asset.category, asset.motion, (body,), asset.extent_m, regions=asset.regions, rim=asset.rim)


def _vessel(obj: SceneObject, radius: float, height: float, link: str, synset: str) -> Asset:
    low, high = -height / 2, height / 2
    color = _COLORS[COLOR.read(obj)]
    physics = vessel_shapes(radius, low, high, _WALL_M, _DENSITY_KG_M3, _FRICTION)
    look = vessel_look(radius, low, high, _WALL_M, color, _INSIDE)
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link(link, (*physics, *look)),),
        extent_m=(2 * radius, 2 * radius, height),
        regions=(hollow(link, radius, low, high, _WALL_M),),
        symmetric_about_z=True,
        graspable_width_m=2 * radius,
        synset=synset,
        rim=upright_rim(radius, low, high, _WALL_M),
    )


def _ear(radius: float, reach: float, height: float, color: tuple[float, ...]) -> list[Shape]:
    """Pieces along half an ellipse whose ends are at the wall at +x; the outermost one touches the object's box."""
    half, thick = 0.30 * height, _EAR_M / 2
    angles = [math.pi * (index / _EAR_PIECES - 0.5) for index in range(_EAR_PIECES + 1)]
    widest = max(math.cos(angle) for angle in angles)
    outline = [(radius + (reach - thick) * math.cos(angle) / widest, half * math.sin(angle)) for angle in angles]
    pieces = []
    for (xa, za), (xb, zb) in pairwise(outline):
        turn = math.atan2(xb - xa, zb - za)
        pieces.append(
            Shape(
                kind="box",
                size_m=(thick, thick, math.hypot(xb - xa, zb - za) / 2 + thick / 3),
                position_m=((xa + xb) / 2, 0.0, (za + zb) / 2),
                orientation=(math.cos(turn / 2), 0.0, math.sin(turn / 2), 0.0),
                color=color,
                friction=_FRICTION,
                density_kg_m3=_DENSITY_KG_M3,
            )
        )
    return pieces


ENTRIES = (
    Entry("cup", "cup", "cup.n.01", cup, SAME_AS_WIDTH, Span(0.060, 0.080), Span(0.070, 0.100), (COLOR,)),
    Entry(
        "mug", "mug", "mug.n.04", mug, Span(1.35, 1.50, of_width=True), Span(0.070, 0.085), Span(0.080, 0.100), (COLOR,)
    ),
)
