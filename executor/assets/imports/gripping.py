"""Finds what a gripper can hold: handles of doors and drawers, and the direction in which an item is narrowest.

Handles are the parts that are called so, else the parts that stand out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from executor.assets.imports.orient import outward_of, unit
from executor.assets.imports.raw import MeshPart, RawAsset, RawJoint, RawLink, rounded
from executor.assets.model import Handle, Vector
from executor.geometry import Array
from executor.machine.extras import require
from oag.task.sizes import PAPER_GRIPPER

SHORTEST_M = 0.02
"""About as long as a fingertip is wide."""
FINGER_ROOM_M = 0.018
"""A fingertip must fit between the bar and the panel."""
TOUCHING_M = 0.01
"""Bits of a handle that are no farther apart than this are one handle."""
DIRECTIONS = 36
"""Every five degrees of the half turn after which widths repeat."""
_ROUND = 1.06
"""Widths of something round differ by no more than this factor."""


def find_handle(raw: RawAsset, joint: RawJoint) -> tuple[Handle | None, str]:
    """Returns a joint's handle, or None, with a note on what was found or why nothing can be held."""
    link, outward = raw.link_of(joint), outward_of(raw, joint)
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
    others = "" if len(candidates) == 1 else f"; the longest of {len(candidates)}"
    fault = None
    if thickness_m > PAPER_GRIPPER.opening_m - 0.004:
        fault = f"is {thickness_m * 1000:.0f} mm thick, the gripper opens {PAPER_GRIPPER.opening_m * 1000:.0f} mm"
    elif length_m < SHORTEST_M:
        fault = f"is {length_m * 1000:.0f} mm long, too short to hold"
    elif reach - face < FINGER_ROOM_M:
        fault = f"stands {(reach - face) * 1000:.0f} mm off the panel; no finger fits behind"
    if fault is not None:
        return None, f"{joint.child}: its handle {fault}{others}"
    handle = Handle(
        joint.child,
        joint.name,
        rounded(where - joint.origin_m),
        rounded(unit(along, 1.0)),
        rounded(outward),
        round(length_m, 5),
        round(thickness_m, 5),
    )
    how = "a part of that name" if named else "a part that stands out"
    return handle, f"{joint.child}: handle from {how}, {length_m * 100:.0f} cm long{others}"


def _panel(link: RawLink) -> tuple[MeshPart, ...]:
    """A door without its handle; all of it where nothing else is left."""
    plain = link.without_handles
    if len(plain) < 2:
        return plain
    # The largest part is the panel; what stands out from it may be a handle.
    return (max(plain, key=lambda part: float(np.prod(np.ptp(part.vertices_m, axis=0) + 1e-3))),)


def _apart(parts: Sequence[MeshPart]) -> list[Array]:
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


def width_of(pieces: Sequence[Array]) -> tuple[float, tuple[Vector, ...]]:
    """Returns how wide an item is between two parallel fingers where it is narrowest, and along which directions.

    Args:
        pieces: Points (N, 3) of its convex pieces.

    Returns:
        The width, and the horizontal unit vectors that the fingers can close along: none for something round.
    """
    points = np.concatenate([piece[:, :2] for piece in pieces])
    angles = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
    towards = np.stack([np.cos(angles), np.sin(angles)])
    widths = np.ptp(points @ towards, axis=0)
    narrowest = int(np.argmin(widths))
    if float(widths.max()) <= _ROUND * float(widths[narrowest]):
        return float(widths.max()), ()
    # Something square can be taken either way.
    across = (narrowest + DIRECTIONS // 2) % DIRECTIONS
    chosen = [narrowest, across] if widths[across] <= _ROUND * widths[narrowest] else [narrowest]
    return float(widths[narrowest]), tuple(rounded(np.array([*towards[:, i], 0.0])) for i in chosen)
