"""Where exactly: the part of a thing, or the spot next to another one, that a subtask names; whether it came so.

Symbols tell places apart, but no parts and no spots: `SimpleTask.where` names them. Here they become handles and
regions for the searches, and readings at the subtask's end. What is above each other is counted from the top, what is
beside each other from the left, as seen before a front. Sides of things are seen from the robot's start.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

import bddl
from executor.assets.asset_geometry import bounds
from executor.assets.model import UPWARD, Asset, Handle, Region
from executor.geometry import Array, inverse
from executor.planning.placements import SMALL_M
from executor.sim.detectors import box_around
from executor.sim.world import World
from oag import SimpleTask
from oag.measurements import AtomMeasured, GoalReading
from oag.model.where import Where
from oag.primitives.table import OPEN_FRACTION

SIDE_BY_SIDE_M = 0.03
"""Centres that differ by less in height are beside each other, else above each other."""

GAPS_M = (0.03, 0.04)
"""Between a thing and its neighbour, the preferred one first: fingers fit in between."""

_NEAR_M = 0.05  # A centimetre more than what is aimed at: a glass that was aimed at 5 cm ended at 5.01.

SIDE_COSINE = 0.6
"""Directions at less than 53 degrees from the named side count as on it."""

DIRECTIONS = 8
MARGIN_M, DEPTH_M = 0.012, 0.16
"""Of the region around a spot: how much wider it is than the thing, and its half depth behind a front. So its middle is
the only spot of it, or the first one."""

_SIDES = {"left of": (0.0, 1.0), "right of": (0.0, -1.0), "behind": (1.0, 0.0), "in front of": (-1.0, 0.0)}
_PLACES = {"top": 0, "first": 0, "second": 1, "third": 2, "fourth": 3, "fifth": 4, "sixth": 5, "bottom": -1, "last": -1}


def handles_of(world: World, object_id: str, where: Where) -> tuple[Handle, ...]:
    """Return the handles of the door or drawer that a subtask names; none where there is no one such part."""
    asset = world.assets[object_id]
    chosen = _chosen(_middles(asset, asset.regions, where.part), where.which)
    return tuple(bar for bar in asset.handles if bar.joint == chosen)


def regions_of(world: World, object_id: str, regions: Sequence[Region], where: Where) -> list[Region]:
    """Return those of a thing's regions that are in the part that a subtask names; none where there is no one such."""
    if where.part == "shelf":
        boards = _middles(world.assets[object_id], regions, "shelf")
        fitting = set(_fitting(boards, where.which, by_rows=True))
        # Boards of one height are one shelf, behind several doors.
        one = any(fitting.issubset(row) for row in _lines(boards, 2))
        return [region for region in regions if one and region.name in fitting]
    joints = {bar.joint for bar in handles_of(world, object_id, where)}
    if not joints:
        return []
    # Two doors may close one room.
    return [r for r in regions if r.joint in joints] or [r for r in regions if r.joint is None]


def parts_named(asset: Asset, where: Where) -> tuple[str, ...]:
    """Return the joints, or the regions over boards, that a word fits: none, one, or several in a grid."""
    return _fitting(_middles(asset, asset.regions, where.part), where.which, by_rows=where.part == "shelf")


def _middles(asset: Asset, regions: Sequence[Region], part: str) -> dict[str, Array]:
    """Return the middle (3,) of each part of a kind, in the frame of its thing."""
    if part == "shelf":
        return {region.name: np.array(region.floor_m) for region in regions if not region.opens_upward}
    kind = {"door": "revolute", "drawer": "prismatic"}.get(part)
    bars: dict[str, list[Array]] = {}
    for bar in asset.handles:
        joint = asset.joint(bar.joint)
        if joint.kind == kind and joint.opens:
            bars.setdefault(bar.joint, []).append(np.array(joint.position_m) + np.array(bar.position_m))
    return {joint: np.asarray(np.mean(owned, axis=0)) for joint, owned in bars.items()}


def _chosen(middles: dict[str, Array], which: str) -> str | None:
    """Return the part that a word names; None where it fits none, or several."""
    fitting = _fitting(middles, which)
    return fitting[0] if len(fitting) == 1 else None


def _fitting(middles: dict[str, Array], which: str, *, by_rows: bool = False) -> tuple[str, ...]:
    """Return the parts that a word fits, by their middles (3,) in the frame of their thing; full rows may be one."""
    rows, columns = _lines(middles, 2), _lines(middles, 1)
    if which in ("left", "right"):
        return columns[0 if which == "left" else -1] if len(columns) > 1 else ()
    if which in ("top", "bottom") and len(rows) == 1 < len(middles):
        return ()
    lines = rows if len(rows) > 1 else columns
    if which == "middle":
        return lines[len(lines) // 2] if len(lines) % 2 else ()
    place = _PLACES[which]
    full = by_rows and len({len(line) for line in lines}) == 1
    if which not in ("top", "bottom", "last") and not full and any(len(line) > 1 for line in lines):
        return tuple(middles) if place < len(middles) else ()  # Counted by rows, or one by one.
    return lines[place] if -len(lines) <= place < len(lines) else ()


def _lines(middles: dict[str, Array], axis: int) -> list[tuple[str, ...]]:
    """Return the parts by their place along an axis, from the top or the left; those next to each other together."""
    lines: list[list[str]] = []
    for name in sorted(middles, key=lambda name: -middles[name][axis]):
        if lines and middles[lines[-1][0]][axis] - middles[name][axis] <= SIDE_BY_SIDE_M:
            lines[-1].append(name)
        else:
            lines.append([name])
    return [tuple(line) for line in lines]


def regions_next_to(world: World, item: str, support: str, regions: Iterable[Region], where: Where) -> list[Region]:
    """Return small regions around the spots of a support where an item is next to another thing, or on a side of it."""
    start = world.scene.robot
    centre, half = box_around(world, where.other)
    size_m = world.assets[item].extent_m
    width_m = max(size_m[:2])
    found = []
    for gap_m, turn in itertools.product(GAPS_M, range(DIRECTIONS)):
        angle = start.yaw_rad + 2 * np.pi * turn / DIRECTIONS
        direction = np.array([np.cos(angle), np.sin(angle)])
        # Boxes are along the world's axes; the thing is a disc, as for all placements.
        reach_m = _extent_towards(half, direction) + width_m / 2 + gap_m
        at = np.array([*(centre[:2] + reach_m * direction), centre[2]])
        if not is_at_side(at, np.array([width_m, width_m, size_m[2]]) / 2, centre, half, where, start.yaw_rad):
            continue
        found += [small for region in regions if (small := _around(world, support, region, at, centre, width_m))]
    return [replace(region, name=f"{region.name} {number}") for number, region in enumerate(found)]


def _extent_towards(half: Array, direction: Array) -> float:
    """Return the distance from a box's middle to its side in a direction, over the floor."""
    return float(min(h / abs(w) if abs(w) > 1e-9 else np.inf for h, w in zip(half[:2], direction, strict=True)))


def _around(world: World, support: str, region: Region, at: Array, neighbour: Array, width_m: float) -> Region | None:
    """Return the part of a region around a spot; None where that is not in it, or the neighbour is not."""
    T_link_world = inverse(world.T_world_link(support, region.link))
    middle, room = np.array(region.center_m), np.array(region.half_extents_m)
    local, other = ((T_link_world @ np.array([*point, 1.0]))[:3] for point in (at, neighbour))
    if (np.abs(local - middle)[:2] > room[:2] - width_m / 2).any() or (np.abs(other - middle) > room + 0.05).any():
        return None
    half = np.array([*(2 * (min(width_m / 2 + MARGIN_M, 0.9 * SMALL_M),)), room[2]])
    if not region.opens_upward:
        half[:2] = np.where(np.abs(region.opening[:2]) > UPWARD, DEPTH_M, width_m / 2 + MARGIN_M)
    x, y = map(float, local[:2])
    along, across, up = map(float, half)
    return replace(region, center_m=(x, y, region.center_m[2]), half_extents_m=(along, across, up))


def is_at_side(at: Array, item_half: Array, centre: Array, half: Array, where: Where, yaw_rad: float) -> bool:
    """Decide whether a box is on the named side of another one, and near: by `nextto`'s gap, or a few centimetres."""
    gap_m = np.maximum(np.abs(at - centre) - item_half - half, 0.0)[:2]
    if np.linalg.norm(gap_m) > max(float(np.mean(item_half + half)) / 3.0, _NEAR_M):
        return False
    if where.relation == "next to":
        return True
    ahead, left = _SIDES[where.relation]
    direction = np.array(
        [np.cos(yaw_rad) * ahead - np.sin(yaw_rad) * left, np.sin(yaw_rad) * ahead + np.cos(yaw_rad) * left]
    )
    apart = (at - centre)[:2]
    return bool(apart @ direction > SIDE_COSINE * np.linalg.norm(apart))


def ends_at_side(world: World, item: str, where: Where) -> Callable[[Array], bool]:
    """Return a test of poses (4, 4) of an item: whether its box is on the named side of the other thing, and near."""
    (centre, half), yaw_rad = box_around(world, where.other), world.scene.robot.yaw_rad

    def ends(T_world_item: Array) -> bool:
        low, high = bounds(world.assets[item], T_world_item[:3, :3])
        at = T_world_item[:3, 3] + (low + high) / 2
        return is_at_side(at, (high - low) / 2, centre, half, where, yaw_rad)

    return ends


def read_where(subtask: SimpleTask, world: World) -> tuple[GoalReading, ...]:
    """Return whether a subtask ended in the part, or at the side, that it names; nothing where it names none."""
    where = subtask.where
    if where is None:
        return ()
    target, support = subtask.target, subtask.support_goal
    words = str(where) if where.part else f"{target} {where}"
    if where.other:
        (at, item_half), (centre, half) = box_around(world, target), box_around(world, where.other)
        gap_m = float(np.linalg.norm(np.maximum(np.abs(at - centre) - item_half - half, 0.0)[:2]))
        holds = is_at_side(at, item_half, centre, half, where, world.scene.robot.yaw_rad)
        return (GoalReading(words, True, holds, AtomMeasured(gap_m=round(gap_m, 4))),)
    if support is None:
        fractions = {
            bar.joint: world.assets[target].joint(bar.joint).fraction(world.joint_position(target, bar.joint))
            for bar in handles_of(world, target, where)
        }
        widest = max(fractions.values(), default=0.0)
        opens = bddl.Not(bddl.Atom("open", (target,))) not in bddl.conjuncts(subtask.goal)
        return (GoalReading(words, opens, widest > OPEN_FRACTION, AtomMeasured(open_fraction=widest)),)
    regions = regions_of(world, support, world.assets[support].regions, where)
    in_it = [region.name for region in regions if _is_in(world, target, support, region)]
    return (GoalReading(words, True, bool(in_it), AtomMeasured(region=next(iter(in_it), None))),)


def _is_in(world: World, item: str, support: str, region: Region) -> bool:
    """Decide whether a thing's middle is in a region."""
    point = inverse(world.T_world_link(support, region.link)) @ np.array([*box_around(world, item)[0], 1.0])
    return bool((np.abs(point[:3] - np.array(region.center_m)) <= np.array(region.half_extents_m)).all())
