"""Finds where things can be put on or into an asset: hollows behind doors, in drawers and vessels, and level tops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from executor.assets.imports.cavities import Hollow, highest_under, hollows
from executor.assets.imports.handles import outward_of
from executor.assets.imports.raw import RawAsset
from executor.geometry import Array

SMALLEST_M = 0.10
"""The shortest side of a hollow in furniture."""
SMALLEST_IN_DRAWER_M = 0.05
"""Drawers are shallow."""
SMALLEST_IN_ITEM = 0.35
"""The shortest side of an item's hollow, as a share of the item's smallest side."""
MOST = 6
TOP_ROOM_M = 0.40
_ABOVE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A box that things can be put into, in the asset's frame; its bottom is what they stand on.

    Attributes:
        name: Unique in the asset.
        interior: Whether it counts for `inside`; a surface otherwise.
        link: The link that carries it.
        box: Where it is.
        opening: (3,) unit vector out of it.
        joint: The joint that shuts it, or None.
    """

    name: str
    interior: bool
    link: str
    box: Hollow
    opening: Array
    joint: str | None = None


def find_places(raw: RawAsset, pieces: Mapping[str, Sequence[Array]], *, item: bool) -> tuple[Place, ...]:
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
        found = _standing(pieces[body], hollows(pieces[body], low, high, 2, 1, smallest, MOST))
        return tuple(Place("hollow", True, body, box, _ABOVE) for box in found[:1])
    places: list[Place] = []
    for joint in raw.joints:
        if joint.kind == "prismatic":
            points = np.concatenate(list(pieces[joint.child]))
            low, high = points.min(axis=0), points.max(axis=0)
            walls = pieces[joint.child]
            boxes = _standing(walls, hollows(walls, low, high, 2, 1, SMALLEST_IN_DRAWER_M, 1))
            places += [Place(f"{joint.child}_drawer", True, joint.child, box, _ABOVE, joint.name) for box in boxes]
    places += _behind_doors(raw, pieces[body])
    return (*places, *_tops(raw, pieces[body]))


def _behind_doors(raw: RawAsset, solid: Sequence[Array]) -> list[Place]:
    """Hollows of the body that open where a door hangs."""
    body = raw.links[0]
    low, high = body.points_m.min(axis=0), body.points_m.max(axis=0)
    doors = [joint for joint in raw.joints if joint.kind == "revolute"]
    places: list[Place] = []
    for outward in {tuple(outward_of(raw, joint)): None for joint in doors}:
        axis = int(np.argmax(np.abs(outward)))
        for box in _standing(solid, hollows(solid, low, high, axis, int(np.sign(outward[axis])), SMALLEST_M, MOST)):
            for joint in doors:
                # Of a hollow behind two doors each has the half that it shuts.
                panel = next(link for link in raw.links if link.name == joint.child).points_m
                behind = _within(box, panel, axis)
                if tuple(outward_of(raw, joint)) == outward and float(behind.size_m.min()) >= SMALLEST_M:
                    name = f"{joint.child}_{sum(place.joint == joint.name for place in places)}"
                    places.append(Place(name, True, body.name, behind, np.array(outward), joint.name))
    return places


def _within(box: Hollow, panel: Array, axis: int) -> Hollow:
    """The part of a box that lies behind a panel's points (N, 3), seen along an axis."""
    low, high = np.maximum(box.low_m, panel.min(axis=0)), np.minimum(box.high_m, panel.max(axis=0))
    low[axis], high[axis] = box.low_m[axis], box.high_m[axis]
    return Hollow(low, high)


def _tops(raw: RawAsset, solid: Sequence[Array]) -> list[Place]:
    """The largest level top of the body from which nothing stands in the way upwards."""
    _, high = raw.box()
    body = np.concatenate(list(solid))
    low, top = body.min(axis=0), body.max(axis=0)
    room = np.array([top[0], top[1], max(top[2], high[2]) + 0.5 * SMALLEST_M])
    found = hollows(solid, low, room, 2, 1, SMALLEST_M / 4, 3)
    standing = [box for box in _standing(solid, found) if float(box.size_m[:2].min()) >= SMALLEST_M]
    if not standing:
        return []
    widest = max(standing, key=lambda box: float(np.prod(box.size_m[:2])))
    widest.high_m[2] = widest.low_m[2] + TOP_ROOM_M
    return [Place("top", False, raw.links[0].name, widest, _ABOVE)]


def _standing(solid: Sequence[Array], boxes: Sequence[Hollow]) -> list[Hollow]:
    """The boxes brought down onto what is under them; those with uneven ground are left out."""
    kept = []
    for box in boxes:
        reach_m = max(0.15 * float(box.size_m[2]), 0.03)
        floor_m = highest_under(solid, box.low_m, box.high_m, reach_m)
        if floor_m is not None and floor_m < box.high_m[2]:
            kept.append(Hollow(np.array([*box.low_m[:2], floor_m]), box.high_m.copy()))
    return kept
