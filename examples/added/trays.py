"""Trays with a handle at either end: a family of assets in one file.

Copied to `executor/assets/families/`, it is part of the library (CONTRIBUTING.md). Things are put on a tray. The robot
does not take it: one hand cannot carry what is held at one end.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from executor.assets.families.shapes import box, box_item, surface
from executor.assets.model import Asset
from executor.assets.parameters import ChoiceParameter, ModelEntry, NumericParameter, Range, require_size
from oag import SceneObject

_COLORS = {"wood": (0.45, 0.28, 0.14), "black": (0.05, 0.05, 0.06), "white": (0.85, 0.84, 0.80)}
COLOR = ChoiceParameter("color", tuple(_COLORS))
WALL = NumericParameter("wall_m", 0.008, 0.006, 0.012)
_BAR_M = 0.014  # Thickness of a handle.
_GAP_M = 0.035  # Free height below it, for a finger.


def tray(obj: SceneObject) -> Asset:
    """Return a tray with a bar across either end (x); things lie on its bottom."""
    length, width, height = require_size(obj, (0.16, 0.10, 0.06))
    x, y, z = length / 2, width / 2, height / 2
    wall = WALL.read(obj)
    floor, rim = -z + wall, z - _BAR_M - _GAP_M
    board = partial(box, color=_COLORS[COLOR.read(obj)], friction=0.8, density_kg_m3=500.0)
    shapes = [
        board((-x, -y, -z), (x, y, floor)),
        board((-x, -y, floor), (x, -y + wall, rim)),
        board((-x, y - wall, floor), (x, y, rim)),
    ]
    for side in (-1.0, 1.0):
        inner, outer = sorted((side * x, side * (x - wall)))
        shapes.append(board((inner, -y + wall, floor), (outer, y - wall, rim)))
        inner, outer = sorted((side * x, side * (x - _BAR_M)))
        shapes.append(board((inner, -y, z - _BAR_M), (outer, y, z)))
        shapes.extend(board((inner, post, rim), (outer, post + _BAR_M, z - _BAR_M)) for post in (-y, y - _BAR_M))
    top = surface("tray", x - _BAR_M, y - wall, floor)
    whole = box_item(obj, "tray", shapes, (length, width, height), "tray.n.01", top)
    return replace(whole, graspable_width_m=None, grasp_axes=())


MODELS = (
    ModelEntry(
        "tray_two_handles",
        "tray",
        "tray.n.01",
        tray,
        Range(0.30, 0.45),
        Range(0.20, 0.30),
        Range(0.08, 0.11),
        (COLOR, WALL),
    ),
)
FAMILIES = {"tray": tray}
