"""Finds where things can be put on or into an asset: hollows behind doors, in drawers and vessels, and level tops.

A hollow is the largest box of air that is open to one side. The space is cut into cells, a cell counts as solid when a
convex piece comes near to its middle, and for every cell of the open side the depth of the air behind it is known; the
largest box is then a largest rectangle under a bound on the depth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from executor.assets.imports.orient import outward_of, slides_sideways
from executor.assets.imports.raw import RawAsset, rounded
from executor.assets.model import Region
from executor.assets.parts.shapes import ROOM_ABOVE_M
from executor.geometry import Array

SMALLEST_M = 0.10
"""The shortest side of a hollow in furniture."""
SMALLEST_IN_DRAWER_M = 0.05
"""Drawers are shallow."""
SMALLEST_IN_ITEM = 0.35
"""The shortest side of an item's hollow, as a share of the item's smallest side."""
MOST = 6
"""Hollows of one side: a cupboard seldom has more compartments, and each costs a search."""
MOST_CELLS = 48
"""Cells along the longest side."""
_SOLID_WITHIN = 0.45
"""A cell is solid when a piece is nearer to its middle than this many cells."""
_ABOVE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Hollow:
    """A box of air.

    Attributes:
        low_m, high_m: (3,) its corners.
    """

    low_m: Array
    high_m: Array

    @property
    def size_m(self) -> Array:
        """(3,) lengths of its sides."""
        return self.high_m - self.low_m


def find_places(raw: RawAsset, pieces: Mapping[str, Sequence[Array]], *, item: bool) -> tuple[Region, ...]:
    """Returns an asset's places, hollows first.

    Args:
        raw: The asset in the library's frame, shut.
        pieces: Points (N, 3) of each link's convex pieces.
        item: Whether it is something to carry, whose only hollow is open at the top.
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
    """Hollows of the body that open where a door hangs."""
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
    """The largest level top of the body from which nothing stands in the way upwards."""
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
    """The boxes brought down onto what is under them; those with uneven ground are left out."""
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
    """Half-spaces (F, 4) of a piece's hull; None for what is flat."""
    try:
        return np.asarray(ConvexHull(piece).equations)
    except QhullError:
        return None


def _hollows(
    pieces: Sequence[Array], low_m: Array, high_m: Array, axis: int, sign: int, smallest_m: float, most: int
) -> list[Hollow]:
    """Boxes of air that reach one side of a space, the largest first, none overlapping another.

    Args:
        pieces: Points (N, 3) of the convex pieces that are solid.
        low_m, high_m: (3,) corners of the space.
        axis: The axis that the open side lies across (0, 1 or 2).
        sign: Which of its two sides is open, 1 or -1.
        smallest_m: Sides shorter than this make no hollow.
        most: How many to return at most.
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
    """Which cells (X, Y, Z) a piece fills or comes near to the middle of."""
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
