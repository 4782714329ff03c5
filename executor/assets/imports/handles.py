"""Finds what a gripper can hold of a door or a drawer: parts that are called handles, else parts that stand out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from executor.assets.imports.raw import Part, RawAsset, RawJoint, RawLink
from executor.geometry import Array
from executor.machine.extras import require
from executor.robot.description import GRIPPER_OPENING_M

SHORTEST_M = 0.02
FINGER_ROOM_M = 0.018
"""A fingertip must fit between the bar and the panel."""
TOUCHING_M = 0.01
"""Bits of a handle that are no farther apart than this are one handle."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundHandle:
    """A bar, in the asset's frame.

    Attributes:
        position_m: (3,) its middle.
        axis, outward: (3,) unit vectors along the bar and away from the panel.
        length_m, thickness_m: Along the bar, and across the fingers.
    """

    position_m: Array
    axis: Array
    outward: Array
    length_m: float
    thickness_m: float


def outward_of(raw: RawAsset, joint: RawJoint) -> Array:
    """Returns the unit vector (3,) in which a door's or drawer's front faces, along one of the asset's axes.

    A drawer faces where it slides to. A door faces across its thinnest side, away from the middle of the body.
    """
    link = _link(raw, joint)
    if joint.kind == "prismatic":
        axis = int(np.argmax(np.abs(joint.axis)))
        return _unit(axis, float(joint.axis[axis]))
    # All of the door, since the largest part of a framed one may be a bar that is thin both ways.
    door = np.concatenate([part.vertices_m for part in _plain(link)])
    low, high = door.min(axis=0), door.max(axis=0)
    axis = int(np.argmin(high - low))
    body = raw.links[0].points_m
    middle = (body.min(axis=0) + body.max(axis=0)) / 2
    return _unit(axis, float(((low + high) / 2 - middle)[axis]))


def find_handle(raw: RawAsset, joint: RawJoint) -> tuple[FoundHandle | None, str]:
    """Returns a joint's handle, or None, with a note on what was found or why nothing can be held."""
    link, outward = _link(raw, joint), outward_of(raw, joint)
    axis = int(np.argmax(np.abs(outward)))
    panel = np.concatenate([part.vertices_m for part in _panel(link)])
    face = float((panel @ outward).max())
    named = [part for part in (*link.bodies, *link.looks) if part.is_handle]
    parts = named or [p for p in link.bodies if float((p.vertices_m @ outward).max()) > face + FINGER_ROOM_M]
    if not parts:
        return None, f"{joint.child}: no handle was found; name one in a side file"
    candidates = _apart(parts)
    points = max(candidates, key=lambda some: float(np.ptp(some, axis=0).max()))
    low, high = points.min(axis=0), points.max(axis=0)
    along, across = sorted((i for i in range(3) if i != axis), key=lambda i: low[i] - high[i])
    # Of a bent handle the outermost bit is what the fingers close on.
    reach = float((points @ outward).max())
    bar = points[points @ outward > reach - 0.35 * max(reach - face, 1e-3)]
    low, high = bar.min(axis=0), bar.max(axis=0)
    thickness_m, length_m = float(high[across] - low[across]), float(high[along] - low[along])
    depth_m = min(float((bar @ outward).max() - (bar @ outward).min()), max(thickness_m, 0.01))
    where = (low + high) / 2
    where[axis] = outward[axis] * (reach - depth_m / 2)
    found = FoundHandle(where, _unit(along, 1.0), outward, length_m, thickness_m)
    handle, note = _fit(found, reach - face, joint, bool(named))
    return handle, note if len(candidates) == 1 else f"{note}; the longest of {len(candidates)}"


def _fit(found: FoundHandle, stands_out_m: float, joint: RawJoint, named: bool) -> tuple[FoundHandle | None, str]:
    if found.thickness_m > GRIPPER_OPENING_M - 0.004:
        wide = f"{found.thickness_m * 1000:.0f} mm"
        return None, f"{joint.child}: its handle is {wide} thick, the gripper opens {GRIPPER_OPENING_M * 1000:.0f} mm"
    if found.length_m < SHORTEST_M:
        return None, f"{joint.child}: its handle is {found.length_m * 1000:.0f} mm long, too short to hold"
    if stands_out_m < FINGER_ROOM_M:
        return (
            None,
            f"{joint.child}: its handle stands {stands_out_m * 1000:.0f} mm off the panel; no finger fits behind",
        )
    how = "a part of that name" if named else "a part that stands out"
    return found, f"{joint.child}: handle from {how}, {found.length_m * 100:.0f} cm long"


def _panel(link: RawLink) -> tuple[Part, ...]:
    """A door without its handle; all of it where nothing else is left."""
    plain = _plain(link)
    if len(plain) < 2:
        return plain
    # The largest part is the panel; what stands out from it may be a handle.
    return (max(plain, key=lambda part: float(np.prod(np.ptp(part.vertices_m, axis=0) + 1e-3))),)


def _plain(link: RawLink) -> tuple[Part, ...]:
    return tuple(part for part in link.bodies if not part.is_handle) or link.bodies


def _apart(parts: Sequence[Part]) -> list[Array]:
    """Points (N, 3) of each handle: what touches is one, and between two knobs there is nothing to hold."""
    trimesh: Any = require("trimesh", "sim")
    pieces = []
    for part in parts:
        mesh = trimesh.Trimesh(part.vertices_m, part.faces, process=True)
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        groups = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)))
        pieces += [mesh.vertices[np.unique(mesh.faces[group])] for group in groups]
    low = np.array([piece.min(axis=0) for piece in pieces]) - TOUCHING_M / 2
    high = np.array([piece.max(axis=0) for piece in pieces]) + TOUCHING_M / 2
    touching = (low[:, None] <= high[None]).all(axis=2) & (low[None] <= high[:, None]).all(axis=2)
    count, group_of = connected_components(coo_array(touching), directed=False)
    return [np.concatenate([pieces[i] for i in np.flatnonzero(group_of == group)]) for group in range(count)]


def _link(raw: RawAsset, joint: RawJoint) -> RawLink:
    return next(link for link in raw.links if link.name == joint.child)


def _unit(axis: int, sign: float) -> Array:
    vector = np.zeros(3)
    vector[axis] = 1.0 if sign >= 0 else -1.0
    return vector
