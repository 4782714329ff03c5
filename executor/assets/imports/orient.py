"""Brings an asset into the library's convention: shut at position 0, positive opens, fronts face -x, z is up."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.imports.raw import MeshPart, RawAsset, RawJoint, RawLink
from executor.assets.model import LEAST_TRAVEL
from executor.geometry import Array, rotation_z, transform

_FRONTS = {"-x": np.pi * 0.0, "+x": np.pi, "-y": -np.pi / 2, "+y": np.pi / 2}
"""By how much an asset is turned about z so that its front, which faces there, faces -x."""

_PANEL, _SLIDING = 0.5, 0.15  # Thickness of a door, as a share of its next longer side.
_AT_FACE = 0.7  # Of the way from the middle of the body to its face.


def upright(raw: RawAsset, up: str) -> RawAsset:
    """Returns the asset with z up.

    Args:
        raw: As read.
        up: "z", or "y" as in glTF.
    """
    if up == "z":
        return raw
    return raw.moved(transform(Rotation.from_euler("x", 90, degrees=True).as_matrix(), [0.0, 0.0, 0.0]))


def shut(raw: RawAsset) -> RawAsset:
    """Returns the asset with every joint shut at 0 and opening in the positive direction.

    A joint is shut at zero where its limits admit it, else at the limit nearest to zero; it opens towards the farther
    limit. A door that goes both ways opens out of the body, where there is a way to go.
    """
    notes = list(raw.notes)
    links = {link.name: link for link in raw.links}
    joints = []
    for joint in raw.joints:
        at = min(max(0.0, joint.low), joint.high)
        forwards = joint.high - at >= at - joint.low
        if joint.low < at < joint.high:
            way = "the longer way"
            shorter = min(joint.high - at, at - joint.low)
            if shorter >= LEAST_TRAVEL[joint.kind] and _opens_inwards(raw, joint, forwards):
                forwards, way = not forwards, "out of the body"
            notes.append(f"joint {joint.name} goes both ways from zero; shut is zero, and it opens {way}")
        links[joint.child] = links[joint.child].through(partial(MeshPart.moved, T=_motion(joint, at)))
        travel = joint.high - at if forwards else at - joint.low
        joints.append(replace(joint, axis=joint.axis if forwards else -joint.axis, low=0.0, high=travel))
    return replace(raw, links=tuple(links.values()), joints=tuple(joints), notes=tuple(notes))


def _opens_inwards(raw: RawAsset, joint: RawJoint, forwards: bool) -> bool:
    if joint.kind == "prismatic" or not is_panel(raw.link_of(joint)):
        return False
    return float(opening_of(raw, joint) @ outward_of(raw, joint)) * (1.0 if forwards else -1.0) < 0.0


def _motion(joint: RawJoint, position: float) -> Array:
    if joint.kind == "prismatic":
        return transform(np.eye(3), position * joint.axis)
    turn = Rotation.from_rotvec(position * joint.axis).as_matrix()
    return transform(turn, joint.origin_m - turn @ joint.origin_m)


def facing_minus_x(raw: RawAsset, front: str | None) -> RawAsset:
    """Returns the asset turned about z so that its front faces -x.

    Args:
        raw: A shut asset.
        front: "-x", "+x", "-y" or "+y"; None takes the side that most of its doors and drawers face, -x where it has
            none.
    """
    side = front or _front_of(raw)
    if side == "-x":
        return raw
    turned = raw.moved(transform(rotation_z(_FRONTS[side]), [0.0, 0.0, 0.0]))
    if front is None:
        turned = replace(turned, notes=(*turned.notes, f"its front faces {side}; it was turned to -x"))
    return turned


def _front_of(raw: RawAsset) -> str:
    towards = np.zeros(3)
    for joint in raw.joints:
        towards += outward_of(raw, joint)
    if not towards[:2].any():
        # Lids alone: the front is where they come up, away from their hinges.
        towards = np.zeros(3)
        for joint in raw.joints:
            if joint.kind == "revolute":
                points = raw.link_of(joint).points_m
                across = (points.min(axis=0) + points.max(axis=0)) / 2 - joint.origin_m
                towards += across - float(across @ joint.axis) * joint.axis
    axis = int(np.argmax(np.abs(towards[:2])))
    if abs(float(towards[axis])) < 1e-6:
        return "-x"
    return f"{'+' if towards[axis] > 0 else '-'}{'xy'[axis]}"


def outward_of(raw: RawAsset, joint: RawJoint) -> Array:
    """Returns the unit vector (3,) in which a door's or drawer's front faces, along one of the asset's axes.

    A drawer faces where it slides to. A door, also one that slides sideways, faces across its thinnest side, away from
    the middle of the body.
    """
    if joint.kind == "prismatic" and not slides_sideways(raw, joint):
        axis = int(np.argmax(np.abs(joint.axis)))
        return unit(axis, float(joint.axis[axis]))
    low, high = _box_of(raw.link_of(joint))
    axis = int(np.argmin(high - low))
    return unit(axis, float(((low + high) / 2 - _middle_of(raw))[axis]))


def opening_of(raw: RawAsset, joint: RawJoint) -> Array:
    """Returns the unit vector (3,) in which the middle of a hinged door goes first when it opens."""
    low, high = _box_of(raw.link_of(joint))
    way = np.cross(joint.axis, (low + high) / 2 - joint.origin_m)
    return np.asarray(way / max(float(np.linalg.norm(way)), 1e-9))


def is_panel(link: RawLink) -> bool:
    """Decides whether a part is much thinner one way than the others, as a door is."""
    low, high = _box_of(link)
    thin, middle, _ = sorted(high - low)
    return bool(thin < _PANEL * middle)


def slides_sideways(raw: RawAsset, joint: RawJoint) -> bool:
    """Decides whether a joint slides an upright panel along itself, at the face of the body: a sliding door.

    What stands upright in the body, such as a pull-out beside an oven, is thicker; a keyboard's tray lies.
    """
    if joint.kind != "prismatic":
        return False
    low, high = _box_of(raw.link_of(joint))
    across = int(np.argmin(high - low))
    thin, middle, _ = sorted(high - low)
    body = raw.links[0].points_m
    half_m = float(np.ptp(body[:, across])) / 2
    at_face = abs(float(((low + high) / 2 - _middle_of(raw))[across])) > _AT_FACE * half_m
    along = int(np.argmax(np.abs(joint.axis)))
    return bool(thin < _SLIDING * middle and across != 2 and along != across and at_face)


def _box_of(link: RawLink) -> tuple[Array, Array]:
    """The corners (3,) of the box around all of a door but its handles.

    The largest part of a framed door may be a bar that is thin both ways.
    """
    points = np.concatenate([part.vertices_m for part in link.without_handles])
    return points.min(axis=0), points.max(axis=0)


def _middle_of(raw: RawAsset) -> Array:
    body = raw.links[0].points_m
    return np.asarray((body.min(axis=0) + body.max(axis=0)) / 2)


def unit(axis: int, sign: float) -> Array:
    """Returns the unit vector (3,) along an axis (0, 1 or 2), or against it where the sign is negative."""
    vector = np.zeros(3)
    vector[axis] = 1.0 if sign >= 0 else -1.0
    return vector
