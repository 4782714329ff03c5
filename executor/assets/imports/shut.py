"""Brings an asset into the library's convention: shut at position 0, positive opens, fronts face -x, z is up."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.imports.handles import outward_of
from executor.assets.imports.raw import Part, RawAsset, RawJoint
from executor.geometry import Array, rotation_z, transform

FRONTS = {"-x": np.pi * 0.0, "+x": np.pi, "-y": -np.pi / 2, "+y": np.pi / 2}
"""By how much an asset is turned about z so that its front, which faces there, faces -x."""


def shut(raw: RawAsset) -> RawAsset:
    """Returns the asset with every joint shut at 0 and opening in the positive direction.

    A joint is shut at zero where its limits admit it, else at the limit nearest to zero; it opens towards the farther
    limit.
    """
    notes = list(raw.notes)
    links = {link.name: link for link in raw.links}
    joints = []
    for joint in raw.joints:
        at = min(max(0.0, joint.low), joint.high)
        if joint.low < at < joint.high:
            notes.append(f"joint {joint.name} goes both ways from zero; shut is zero, and it opens the longer way")
        links[joint.child] = links[joint.child].through(partial(Part.moved, T=_motion(joint, at)))
        forwards = joint.high - at >= at - joint.low
        travel = joint.high - at if forwards else at - joint.low
        joints.append(replace(joint, axis=joint.axis if forwards else -joint.axis, low=0.0, high=travel))
    return replace(raw, links=tuple(links.values()), joints=tuple(joints), notes=tuple(notes))


def facing_minus_x(raw: RawAsset, front: str | None) -> RawAsset:
    """Returns the asset turned about z so that its front faces -x.

    Args:
        raw: A shut asset.
        front: One of `FRONTS`; None takes the side that most of its doors and drawers face, -x where it has none.
    """
    side = front or _front_of(raw)
    turned = raw if side == "-x" else raw.moved(transform(rotation_z(FRONTS[side]), [0.0, 0.0, 0.0]))
    if front is None and side != "-x":
        note = f"its front faces {side}; it was turned to -x"
        turned = replace(turned, notes=(*turned.notes, note))
    return turned


def upright(raw: RawAsset, up: str) -> RawAsset:
    """Returns the asset with z up.

    Args:
        raw: As read.
        up: "z", or "y" as in glTF.
    """
    if up == "z":
        return raw
    return raw.moved(transform(Rotation.from_euler("x", 90, degrees=True).as_matrix(), [0.0, 0.0, 0.0]))


def _front_of(raw: RawAsset) -> str:
    towards = np.zeros(3)
    for joint in raw.joints:
        towards += outward_of(raw, joint)
    if not towards[:2].any():
        # Lids alone: the front is where they come up, away from their hinges.
        towards = sum((_from_hinge(raw, joint) for joint in raw.joints if joint.kind == "revolute"), np.zeros(3))
    axis = int(np.argmax(np.abs(towards[:2])))
    if abs(float(towards[axis])) < 1e-6:
        return "-x"
    return f"{'+' if towards[axis] > 0 else '-'}{'xy'[axis]}"


def _from_hinge(raw: RawAsset, joint: RawJoint) -> Array:
    points = next(link for link in raw.links if link.name == joint.child).points_m
    across = (points.min(axis=0) + points.max(axis=0)) / 2 - joint.origin_m
    return across - float(across @ joint.axis) * joint.axis


def _motion(joint: RawJoint, position: float) -> Array:
    if joint.kind == "prismatic":
        return transform(np.eye(3), position * joint.axis)
    turn = Rotation.from_rotvec(position * joint.axis).as_matrix()
    return transform(turn, joint.origin_m - turn @ joint.origin_m)
