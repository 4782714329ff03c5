"""Infer affordances of an imported asset: handles, the narrowest width of an item, and places for things.

Handles are the parts named so, else the parts that protrude.

Places are hollows behind doors, in drawers and in vessels, and level tops. A hollow is the largest box of air that is
open to one side. Space is divided into cells, and a cell is solid if a convex piece comes near its centre. For each
cell of the open side the depth of air behind it is computed. The largest box is then a largest rectangle under a bound
on the depth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from executor.assets.families.shapes import ROOM_ABOVE_M
from executor.assets.importers.raw import (
    AssetMesh,
    RawAsset,
    RawJoint,
    RawLink,
    outward_of,
    rounded,
    slides_sideways,
    unit,
)
from executor.assets.model import Handle, Region, Vector
from executor.geometry import Array
from executor.system.extras import require
from oag.sizes import PAPER_GRIPPER

SHORTEST_M = 0.02
"""About as long as a fingertip is wide."""
FINGER_ROOM_M = 0.018
"""A fingertip must fit between the bar and the panel."""
TOUCHING_M = 0.01
"""Parts of a handle within this distance are one handle."""
DIRECTIONS = 36
"""Every five degrees of the half turn after which widths repeat."""
_ROUND = 1.06
"""Widths of something round differ by no more than this factor."""


def find_handle(raw: RawAsset, joint: RawJoint) -> tuple[Handle | None, str]:
    """Return a joint's handle, or None, with a note on the handle or on why nothing can be held."""
    link, outward = raw.link_of(joint), outward_of(raw, joint)
    axis = int(np.argmax(np.abs(outward)))
    panel = np.concatenate([part.vertices_m for part in _panel(link)])
    face = float((panel @ outward).max())
    named = [part for part in (*link.collision_meshes, *link.visual_meshes) if part.is_handle]
    parts = named or [p for p in link.collision_meshes if float((p.vertices_m @ outward).max()) > face + FINGER_ROOM_M]
    if not parts:
        return None, f"{joint.child}: no handle was found; name one in a side file"
    candidates = _apart(parts)
    points = max(candidates, key=lambda some: float(np.ptp(some, axis=0).max()))
    low, high = points.min(axis=0), points.max(axis=0)
    along, across = sorted((i for i in range(3) if i != axis), key=lambda i: low[i] - high[i])
    # Fingers close on the outermost part of a bent handle.
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


def _panel(link: RawLink) -> tuple[AssetMesh, ...]:
    """A door without its handle; all of it if nothing else is left."""
    plain = link.without_handles
    if len(plain) < 2:
        return plain
    # The largest part is the panel; what stands out from it may be a handle.
    return (max(plain, key=lambda part: float(np.prod(np.ptp(part.vertices_m, axis=0) + 1e-3))),)


def _apart(parts: Sequence[AssetMesh]) -> list[Array]:
    """Points (N, 3) of each handle: touching parts are one handle, since the gap between two knobs cannot be held."""
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
    """Return an item's narrowest width between two parallel fingers, and the directions of that width.

    Args:
        pieces: Points (N, 3) of its convex pieces.

    Returns:
        The width [m], and the horizontal unit vectors along which the fingers can close: none for a round item.
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


SMALLEST_M = 0.10
"""The shortest side of a hollow in furniture."""
SMALLEST_IN_DRAWER_M = 0.05
"""Drawers are shallow."""
SMALLEST_IN_ITEM = 0.35
"""The shortest side of an item's hollow, as a share of the item's smallest side."""
MOST = 6
"""Most hollows of one side: a cupboard seldom has more compartments, and each costs a search."""
MOST_CELLS = 48
"""Cells along the longest side."""
_SOLID_WITHIN = 0.45
"""A cell is solid when a piece is nearer to its middle than this many cells."""
_ABOVE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Hollow:
    """A box of air."""

    low_m: Array
    high_m: Array

    @property
    def size_m(self) -> Array:
        """(3,) lengths of its sides."""
        return self.high_m - self.low_m


def find_places(raw: RawAsset, pieces: Mapping[str, Sequence[Array]], *, item: bool) -> tuple[Region, ...]:
    """Return an asset's regions, hollows first.

    Args:
        raw: The asset in the library's frame, shut.
        pieces: Points (N, 3) of each link's convex pieces.
        item: Whether it is an item, whose only hollow is open at the top.
    """
    body = raw.links[0].name
    if item:
        low, high = raw.box()
        smallest = SMALLEST_IN_ITEM * float((high - low).min())
        # The air beside a handle is a box without a floor; the hollow comes after it.
        found = _standing(pieces[body], _hollows(pieces[body], low, high, 2, 1, smallest, MOST))
        return tuple(_place(raw, "hollow", "interior", body, box, _ABOVE) for box in found[:1])
    places: list[Region] = []
    for joint in raw.joints:
        if joint.kind == "prismatic" and not slides_sideways(raw, joint):
            walls = pieces[joint.child]
            points = np.concatenate(list(walls))
            air = _hollows(walls, points.min(axis=0), points.max(axis=0), 2, 1, SMALLEST_IN_DRAWER_M, 1)
            places += [
                _place(raw, f"{joint.child}_drawer", "interior", joint.child, box, _ABOVE, joint.name)
                for box in _standing(walls, air)
            ]
    return (*places, *_behind_doors(raw, pieces[body]), *_tops(raw, pieces[body]))


def _place(
    raw: RawAsset,
    name: str,
    kind: Literal["interior", "surface"],
    link: str,
    box: Hollow,
    opening: Array,
    joint: str | None = None,
) -> Region:
    middle = (box.low_m + box.high_m) / 2 - raw.origin_of(link)
    return Region(name, kind, link, rounded(middle), rounded(box.size_m / 2), rounded(opening), joint)


def _behind_doors(raw: RawAsset, solid: Sequence[Array]) -> list[Region]:
    """Hollows of the body behind its doors."""
    body = raw.links[0]
    low, high = body.points_m.min(axis=0), body.points_m.max(axis=0)
    doors = [joint for joint in raw.joints if joint.kind == "revolute" or slides_sideways(raw, joint)]
    facing = {joint: tuple(outward_of(raw, joint)) for joint in doors}
    places: list[Region] = []
    for outward in dict.fromkeys(facing.values()):
        axis = int(np.argmax(np.abs(outward)))
        for box in _standing(solid, _hollows(solid, low, high, axis, int(np.sign(outward[axis])), SMALLEST_M, MOST)):
            for joint in facing:
                # Of a hollow behind two doors each has the half that it shuts.
                behind = _within(box, raw.link_of(joint).points_m, axis)
                if facing[joint] == outward and float(behind.size_m.min()) >= SMALLEST_M:
                    name = f"{joint.child}_{sum(place.joint == joint.name for place in places)}"
                    places.append(_place(raw, name, "interior", body.name, behind, np.array(outward), joint.name))
    return places


def _within(box: Hollow, panel: Array, axis: int) -> Hollow:
    """The part of a box that lies behind a panel's points (N, 3), seen along an axis."""
    low, high = np.maximum(box.low_m, panel.min(axis=0)), np.minimum(box.high_m, panel.max(axis=0))
    low[axis], high[axis] = box.low_m[axis], box.high_m[axis]
    return Hollow(low, high)


def _tops(raw: RawAsset, solid: Sequence[Array]) -> list[Region]:
    """The largest level top of the body without an obstacle above it."""
    _, high = raw.box()
    body = np.concatenate(list(solid))
    low, top = body.min(axis=0), body.max(axis=0)
    room = np.array([top[0], top[1], max(top[2], high[2]) + 0.5 * SMALLEST_M])
    found = _hollows(solid, low, room, 2, 1, SMALLEST_M / 4, 3)
    standing = [box for box in _standing(solid, found) if float(box.size_m[:2].min()) >= SMALLEST_M]
    if not standing:
        return []
    widest = max(standing, key=lambda box: float(np.prod(box.size_m[:2])))
    widest.high_m[2] = widest.low_m[2] + ROOM_ABOVE_M
    return [_place(raw, "top", "surface", raw.links[0].name, widest, _ABOVE)]


def _standing(solid: Sequence[Array], boxes: Sequence[Hollow]) -> list[Hollow]:
    """The boxes lowered onto the surface under them; those over uneven ground are left out."""
    kept = []
    for box in boxes:
        floor_m = _floor_under(solid, box, max(0.15 * float(box.size_m[2]), 0.03))
        if floor_m is not None and floor_m < box.high_m[2]:
            kept.append(Hollow(np.array([*box.low_m[:2], floor_m]), box.high_m.copy()))
    return kept


def _floor_under(pieces: Sequence[Array], box: Hollow, reach_m: float) -> float | None:
    """The highest top of the pieces no farther below (or above) the box's bottom than a reach; None where uneven."""
    bottom, tops = box.low_m[2], []
    for x in np.linspace(box.low_m[0], box.high_m[0], 7)[1:-1]:
        for y in np.linspace(box.low_m[1], box.high_m[1], 7)[1:-1]:
            here = [top for piece in pieces if (top := _top_at(piece, x, y, bottom + reach_m)) is not None]
            tops.append(max((top for top in here if top >= bottom - reach_m), default=-np.inf))
    level = float(np.median(tops))
    even = np.isfinite(level) and float(np.mean(np.abs(np.array(tops) - level) < 0.006)) > 0.8
    return level if even else None


def _top_at(piece: Array, x: float, y: float, below_m: float) -> float | None:
    """The height at which a vertical line leaves a piece, or None when it misses it or that is too high."""
    faces = _faces(piece)
    if faces is None:
        return None
    slope, rest = faces[:, 2], faces[:, :2] @ np.array([x, y]) + faces[:, 3]
    if (rest[np.abs(slope) < 1e-9] > 0.0).any():
        return None
    up, down = slope > 1e-9, slope < -1e-9
    top, bottom = float((-rest[up] / slope[up]).min()), float((-rest[down] / slope[down]).max())
    return top if bottom <= top <= below_m else None


def _faces(piece: Array) -> Array | None:
    """Half-spaces (F, 4) of a piece's hull; None for a flat piece."""
    try:
        return np.asarray(ConvexHull(piece).equations)
    except QhullError:
        return None


def _hollows(
    pieces: Sequence[Array], low_m: Array, high_m: Array, axis: int, sign: int, smallest_m: float, most: int
) -> list[Hollow]:
    """Boxes of air that reach one side of a space, the largest first, without overlaps.

    Args:
        pieces: Points (N, 3) of the solid convex pieces.
        low_m, high_m: (3,) corners of the space.
        axis: The axis perpendicular to the open side (0, 1 or 2).
        sign: Which of its two sides is open, 1 or -1.
        smallest_m: Least side of a hollow.
    """
    cell_m = float((high_m - low_m).max()) / MOST_CELLS
    counts = np.maximum(np.round((high_m - low_m) / cell_m).astype(int), 1)
    sides_m = (high_m - low_m) / counts
    air = ~_solid(pieces, low_m, sides_m, counts)
    # The open side first, then inwards.
    inwards = np.moveaxis(air, axis, 0)[::-sign].copy()
    across = [i for i in range(3) if i != axis]
    found: list[Hollow] = []
    while len(found) < most:
        depth = np.where(inwards.all(axis=0), inwards.shape[0], np.argmin(inwards, axis=0))
        best = _largest(depth, sides_m[axis], sides_m[across], smallest_m)
        if best is None:
            break
        (a0, a1), (b0, b1), deep = best
        low, high = low_m.copy(), high_m.copy()
        for i, (first, last) in zip(across, ((a0, a1), (b0, b1)), strict=True):
            low[i], high[i] = low_m[i] + first * sides_m[i], low_m[i] + last * sides_m[i]
        if sign > 0:
            low[axis] = high_m[axis] - deep * sides_m[axis]
        else:
            high[axis] = low_m[axis] + deep * sides_m[axis]
        found.append(Hollow(low, high))
        inwards[:, a0:a1, b0:b1] = False
    return found


def _solid(pieces: Sequence[Array], low_m: Array, sides_m: Array, counts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Cells (X, Y, Z) that a piece fills, or whose centre is near a piece."""
    solid = np.zeros(counts, dtype=bool)
    near_m = _SOLID_WITHIN * float(sides_m.max())
    for piece in pieces:
        faces = _faces(piece)
        if faces is None:
            continue
        first = np.clip(np.floor((piece.min(axis=0) - near_m - low_m) / sides_m).astype(int), 0, counts)
        last = np.clip(np.ceil((piece.max(axis=0) + near_m - low_m) / sides_m).astype(int), 0, counts)
        if (last <= first).any():
            continue
        middles = [low_m[i] + (np.arange(first[i], last[i]) + 0.5) * sides_m[i] for i in range(3)]
        points = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1)
        inside = (points @ faces[:, :3].T + faces[:, 3] <= near_m).all(axis=-1)
        solid[first[0] : last[0], first[1] : last[1], first[2] : last[2]] |= inside
    return solid


_Rectangle = tuple[tuple[int, int], tuple[int, int]]


def _largest(
    depth: NDArray[np.int64], deep_m: float, across_m: Array, smallest_m: float
) -> tuple[tuple[int, int], tuple[int, int], int] | None:
    """The rectangle of columns and the depth that enclose most air, or None when all are too small."""
    best, most = None, 0.0
    for deep in range(int(np.ceil(smallest_m / deep_m)), int(depth.max(initial=0)) + 1):
        rectangle = _largest_rectangle(depth >= deep, across_m, smallest_m)
        if rectangle is None:
            continue
        (a0, a1), (b0, b1) = rectangle
        volume = (a1 - a0) * (b1 - b0) * deep
        if volume > most:
            best, most = (*rectangle, deep), volume
    return best


def _largest_rectangle(free: NDArray[np.bool_], sides_m: Array, smallest_m: float) -> _Rectangle | None:
    """The largest rectangle of free cells whose sides are long enough, by runs of free rows over every row."""
    least = [int(np.ceil(smallest_m / side)) for side in sides_m]
    runs = np.zeros(free.shape[1], dtype=int)
    best, most = None, 0
    for row in range(free.shape[0]):
        runs = np.where(free[row], runs + 1, 0)
        stack: list[tuple[int, int]] = []
        for column in range(len(runs) + 1):
            height = int(runs[column]) if column < len(runs) else 0
            start = column
            while stack and stack[-1][1] >= height:
                start, tall = stack.pop()
                if tall >= least[0] and column - start >= least[1] and tall * (column - start) > most:
                    most = tall * (column - start)
                    best = ((row + 1 - tall, row + 1), (start, column))
            stack.append((start, height))
    return best
