"""Push buttons and knobs on appliances: parameters, shapes, and the joint that switches.

Models that can have one read the parameter `control`; the library draws none by itself, so that a drawn microwave is
what it was. A button travels 10 mm against at most 4 N and latches; a knob turns by 60 degrees against 0.1 Nm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.model import Asset, Control, Handle, Link, Quaternion, Shape, Vector
from executor.assets.parameters import ChoiceParameter
from oag import SceneObject

CONTROL = ChoiceParameter("control", ("none", "button", "knob"), drawn=False)
SWITCHED = ChoiceParameter("switched", ("off", "on"), drawn=False)
SWITCHING = (CONTROL, SWITCHED)

BUTTON_TRAVEL_M, BUTTON_SET_M, BUTTON_CLICK_M, BUTTON_ON_M = 0.010, 0.006, 0.009, 0.005
BUTTON_SPRING_N_M = 400.0
BUTTON_RADIUS_M, BUTTON_HEIGHT_M, _CAP_M = 0.018, 0.016, 0.005
KNOB_RANGE_RAD = math.radians(60.0)
KNOB_ON, KNOB_SET = 0.5, 0.9
"""Shares of a knob's range: from where on it is switched on, and to where it is turned."""

KNOB_FRICTION_NM = 0.1
KNOB_RADIUS_M, KNOB_HEIGHT_M, KNOB_BAR_M = 0.022, 0.036, 0.014
_SKIRT_M, _SKIRT_GAP_M = 0.008, 0.001
_RED, _DARK, _LIGHT, _MARK = (0.55, 0.07, 0.05), (0.10, 0.10, 0.11), (0.62, 0.63, 0.65), (0.85, 0.85, 0.82)


def with_control(obj: SceneObject, asset: Asset, at_m: Vector, outward: Vector, across: Vector) -> Asset:
    """Return an asset with the button or knob that its object's parameters ask for; the same asset without one.

    Args:
        at_m: The middle of it on a flat face, in the root frame.
        outward: Unit vector out of that face.
        across: Unit vector in that face: fingers close along it around a knob in the middle of its range.
    """
    kind = CONTROL.read(obj)
    if kind == "none":
        return asset
    root = asset.links[0].name
    parts = _button if kind == "button" else _knob
    control, link = parts(root, at_m, np.array(outward), np.array(across))
    control = replace(control, switched_on=SWITCHED.read(obj) == "on")
    return replace(asset, motion="articulated", links=(*asset.links, link), joints=(*asset.joints, control))


def _button(root: str, at_m: Vector, outward: np.ndarray, across: np.ndarray) -> tuple[Control, Link]:
    turn, name = _turned(across, outward), "button"
    cap = _round(BUTTON_RADIUS_M, BUTTON_HEIGHT_M - _CAP_M, BUTTON_HEIGHT_M, outward, turn, _RED)
    stem = _round(0.6 * BUTTON_RADIUS_M, -BUTTON_HEIGHT_M / 2, BUTTON_HEIGHT_M - _CAP_M, outward, turn, _DARK)
    face = _vector(BUTTON_HEIGHT_M * outward)
    joint = f"{name}_slide"
    control = Control(
        joint,
        "prismatic",
        root,
        name,
        at_m,
        _vector(-outward),
        (0.0, BUTTON_TRAVEL_M),
        friction=0.0,
        balanced=True,
        grip=Handle(name, joint, face, _vector(across), _vector(outward), 2 * BUTTON_RADIUS_M, 2 * BUTTON_RADIUS_M),
        on_from=BUTTON_ON_M,
        set_to=BUTTON_SET_M,
        click=BUTTON_CLICK_M,
        spring_n_m=BUTTON_SPRING_N_M,
    )
    return control, Link(name, (cap, replace(stem, collides=False)))


def _knob(root: str, at_m: Vector, outward: np.ndarray, across: np.ndarray) -> tuple[Control, Link]:
    # Seen from the front it turns clockwise, from half of its range before the middle to half behind it.
    across = Rotation.from_rotvec(KNOB_RANGE_RAD / 2 * outward).apply(across)
    turn, name = _turned(across, outward), "knob"
    along = np.cross(outward, across)
    bar_m, middle_m = KNOB_HEIGHT_M - _SKIRT_M, (KNOB_HEIGHT_M + _SKIRT_M) / 2
    skirt = _round(KNOB_RADIUS_M, _SKIRT_GAP_M, _SKIRT_M, outward, turn, _LIGHT)
    bar = Shape("box", (KNOB_BAR_M / 2, KNOB_RADIUS_M, bar_m / 2), _vector(middle_m * outward), turn, _DARK, 1.0)
    tip = _vector((KNOB_HEIGHT_M + 0.0005) * outward + 0.6 * KNOB_RADIUS_M * along)
    mark = Shape("box", (0.0015, 0.35 * KNOB_RADIUS_M, 0.0005), tip, turn, _MARK, collides=False)
    joint = f"{name}_hinge"
    grip_m = _vector((middle_m + 0.002) * outward)
    control = Control(
        joint,
        "revolute",
        root,
        name,
        at_m,
        _vector(-outward),
        (0.0, KNOB_RANGE_RAD),
        friction=KNOB_FRICTION_NM,
        balanced=True,
        grip=Handle(name, joint, grip_m, _vector(along), _vector(outward), 2 * KNOB_RADIUS_M, KNOB_BAR_M),
        on_from=KNOB_ON * KNOB_RANGE_RAD,
        set_to=KNOB_SET * KNOB_RANGE_RAD,
    )
    return control, Link(name, (skirt, bar, mark))


def _round(radius_m: float, low_m: float, high_m: float, outward: np.ndarray, turn: Quaternion, color: Vector) -> Shape:
    """Return a cylinder about the axis out of the face, between two heights over it."""
    middle = _vector((low_m + high_m) / 2 * outward)
    return Shape("cylinder", (radius_m, (high_m - low_m) / 2), middle, turn, color, 1.0)


def _turned(across: np.ndarray, outward: np.ndarray) -> Quaternion:
    """Return the quaternion w x y z of a frame whose x is across the fingers, and whose z points out of the face."""
    axes = np.stack([across, np.cross(outward, across), outward], axis=1)
    w, x, y, z = (float(part) for part in Rotation.from_matrix(axes).as_quat(scalar_first=True))
    return w, x, y, z


def _vector(values: Sequence[float] | np.ndarray) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
