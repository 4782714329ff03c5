"""A drink can: a cylinder, drawn with its tapered ends."""

from __future__ import annotations

from executor.assets.entry import SAME_AS_WIDTH, Entry, Option, Span
from executor.assets.model import Asset, Link, Shape
from executor.assets.parameters import require_size
from executor.assets.shapes import revolved
from oag import SceneObject

COLOR = Option("color", ("red", "blue", "green"))
_COLORS = {"red": (0.60, 0.05, 0.05), "blue": (0.05, 0.15, 0.50), "green": (0.10, 0.35, 0.12)}
_METAL = (0.62, 0.63, 0.65)
_DENSITY_KG_M3 = 900.0


def can(obj: SceneObject) -> Asset:
    """Returns a full can; its diameter is the smaller horizontal extent.

    Raises:
        AssetError: When it is too small.
    """
    length, width, height = require_size(obj, (0.03, 0.03, 0.04))
    radius, half, rim = min(length, width) / 2, height / 2, 0.05 * height
    body = Shape(
        kind="cylinder", size_m=(radius, half), friction=0.9, density_kg_m3=_DENSITY_KG_M3, color=_METAL, visible=False
    )
    label = [[(radius, -half + rim), (radius, half - rim)]]
    below = [[(0.0, -half), (0.88 * radius, -half)], [(0.88 * radius, -half), (radius, -half + rim)]]
    above = [
        [(radius, half - rim), (0.90 * radius, half)],
        [(0.90 * radius, half), (0.85 * radius, half - 0.02 * height)],
    ]
    lid = [[(0.85 * radius, half - 0.02 * height), (0.0, half - 0.02 * height)]]
    look = (revolved(label, _COLORS[COLOR.read(obj)]), revolved([*below, *above, *lid], _METAL))
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link("can", (body, *look)),),
        extent_m=(2 * radius, 2 * radius, height),
        symmetric_about_z=True,
        graspable_width_m=2 * radius,
        synset="can.n.01",
    )


ENTRIES = (Entry("can", "can", "can.n.01", can, SAME_AS_WIDTH, Span(0.052, 0.066), Span(0.090, 0.125), (COLOR,)),)
