"""Support relations `ontop` and `inside`, derived from geometry: boxes of parts, tops, and hollows."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

import bddl
from executor.assets.asset_geometry import bounds, stands_by_nature
from executor.assets.footprint import Footprint, open_fraction, region_frame, solid_parts
from executor.assets.library import asset_for
from executor.geometry import Array, rotation_z, transform_from_quaternion
from oag import SceneObject
from oag.model.scene import FLOOR, UPRIGHT_DEG
from oag.model.symbols import Kind
from oag.primitives.table import OPEN_FRACTION

NEAR_M = 0.02
"""Things that are nearer than this to a top stand on it: files round, and physics settles millimetres."""

_REACH_M = 0.6  # Reach of open drawers.
_UPRIGHT = math.cos(math.radians(5.0))
_AS_NEAR_M = 0.003  # Tops within this height difference both carry an object.
_STANDS_ON_NOTHING = ("wall", FLOOR)


@dataclass(frozen=True)
class Solid:
    """An object with its geometry, which takes longer to make than to compare.

    Attributes:
        tops: Pose and half sides of every supporting surface; the top of its box without any, unless it is fixed.
        hollows: Pose and half sides of the floors of its hollows, with the height of each hollow.
    """

    obj: SceneObject
    body: Footprint
    parts: tuple[Footprint, ...]
    tops: tuple[tuple[Array, Array], ...]
    hollows: tuple[tuple[Array, Array, float], ...]

    @classmethod
    def of(cls, obj: SceneObject) -> Self:
        """Return an upright object with its geometry."""
        body, regions = Footprint.of(obj), asset_for(obj).regions
        top = np.eye(4)
        top[:3, 3] = (body.x_m, body.y_m, body.high_m)
        tops = tuple(region_frame(obj, region) for region in regions if region.kind == "surface")
        hollows = (region for region in regions if region.kind == "interior")
        return cls(
            obj,
            body,
            tuple(solid_parts(obj)),
            tops or (() if obj.fixed else ((top, np.array([body.half_x_m, body.half_y_m])),)),
            tuple((*region_frame(obj, region), region.height_m) for region in hollows),
        )

    @classmethod
    def fallen(cls, obj: SceneObject) -> Self:
        """Return an object that lies or leans: the box around it, without tops and hollows."""
        T = transform_from_quaternion(obj.position, obj.orientation)
        along = T[:2, int(np.argmin(np.abs(T[2, :3])))]
        R = rotation_z(math.atan2(along[1], along[0]))
        low, high = bounds(asset_for(obj), R.T @ T[:3, :3])
        x, y, _ = (float(value) for value in T[:3, 3] + R @ (low + high) / 2)
        half_x, half_y, _ = (float(value) for value in (high - low) / 2)
        z = float(obj.position[2])
        body = Footprint(x, y, math.atan2(R[1, 0], R[0, 0]), half_x, half_y, z + float(low[2]), z + float(high[2]))
        return cls(obj, body, (body,), (), ())

    def near(self, other: Solid) -> bool:
        """Return whether the two may overlap on the floor plan: open drawers reach a little further."""
        reach = sum(math.hypot(thing.body.half_x_m, thing.body.half_y_m) for thing in (self, other))
        return math.hypot(self.body.x_m - other.body.x_m, self.body.y_m - other.body.y_m) < reach + _REACH_M

    def hollow_floor_m(self, other: Solid) -> float | None:
        """Return the floor height of the hollow that contains another object's centre or foot, None without one.

        What is wider than the hollow is not in it: a saucer is in no cup that stands on it. What stands in the hollow
        is in it, however far it stands out, as for the detector of `inside`.
        """
        stands = is_upright(other.obj)
        for T, half, height_m in self.hollows:
            if stands and min(other.obj.extent_m[:2]) > 2 * max(half):
                continue
            x, y, z = (float(value) for value in T[:3, :3].T @ (np.asarray(other.obj.position) - T[:3, 3]))
            foot_m = other.body.low_m - float(T[2, 3])
            is_in = -NEAR_M <= z <= height_m + NEAR_M or (stands and -NEAR_M <= foot_m <= height_m / 2)
            if abs(x) <= half[0] and abs(y) <= half[1] and is_in:
                return float(T[2, 3])
        return None

    def height_above_top_m(self, other: Solid) -> float | None:
        """Return the height of another object's bottom above the nearest top of this one; None beside all tops."""
        heights = []
        for T, half in self.tops:
            local = T[:2, :2].T @ (np.asarray(other.obj.position[:2]) - T[:2, 3])
            if (np.abs(local) <= half + NEAR_M).all():
                heights.append(other.body.low_m - float(T[2, 3]))
        return min(heights, key=abs, default=None)

    def is_above(self, other: Solid, floor_m: float) -> bool:
        """Return whether the floor of a hollow, that this object is in, is above another one's top beneath it."""
        above_m = other.height_above_top_m(self)
        return above_m is not None and self.body.low_m - above_m < floor_m - _AS_NEAR_M

    def within_m(self, point_m: Array, height_m: float) -> float:
        """Return a point's (2,) distance from the edges of a top at a height; minus infinity without such a top."""
        tops = [(T, half) for T, half in self.tops if abs(float(T[2, 3]) - height_m) < NEAR_M]
        within = (float((half - np.abs(T[:2, :2].T @ (point_m - T[:2, 3]))).min()) for T, half in tops)
        return max(within, default=-math.inf)

    def stands_on(self, others: Iterable[Solid]) -> list[str]:
        """Return the ids of its supports: those of the nearest tops under its centre."""
        found = [(other.obj.id, above_m) for other in others if (above_m := other.height_above_top_m(self)) is not None]
        near = [(key, abs(above_m)) for key, above_m in found if abs(above_m) < NEAR_M]
        best_m = min((gap_m for _, gap_m in near), default=0.0)
        return [key for key, gap_m in near if gap_m < best_m + _AS_NEAR_M]


def upright_solids(objects: Mapping[str, SceneObject]) -> dict[str, Solid]:
    """Return the upright objects with their geometry; `fallen_solids` has the others."""
    return {key: Solid.of(obj) for key, obj in objects.items() if is_upright(obj)}


def fallen_solids(objects: Mapping[str, SceneObject]) -> dict[str, Solid]:
    """Return the items that lie or lean, with the box around each."""
    return {key: Solid.fallen(obj) for key, obj in objects.items() if obj.kind is Kind.ITEM and not is_upright(obj)}


def is_upright(obj: SceneObject, *, w_last: bool = False) -> bool:
    """Return whether an object's own z axis is vertical, within five degrees.

    Args:
        w_last: Whether its quaternion is read as x y z w.
    """
    _, x, y, _ = (obj.orientation[3], *obj.orientation[:3]) if w_last else obj.orientation
    return 1.0 - 2.0 * (x * x + y * y) > _UPRIGHT


def derive_support_relations(things: Mapping[str, Solid], fallen: Iterable[Solid] = ()) -> Iterator[bddl.Atom]:
    """Yield support relations: `inside` every hollow that contains an object, `ontop` of the nearest top beneath it.

    A thing in another item, such as an apple in a bowl, is on nothing. What is in a sink is not on the counter below.
    Furniture is on other furniture only, and what is fixed is on nothing.

    Args:
        things: The upright objects, which may carry and contain others.
        fallen: Items that lie or lean, on and in which nothing stands.
    """
    for thing in (*things.values(), *fallen):
        if thing.obj.category in _STANDS_ON_NOTHING or thing.obj.fixed:
            continue
        others = [other for other in things.values() if other is not thing and thing.near(other)]
        if thing.obj.kind is not Kind.ITEM:
            others = [other for other in others if other.obj.kind is not Kind.ITEM and other.obj.category != FLOOR]
        floors_m = {other.obj.id: floor for other in others if (floor := other.hollow_floor_m(thing)) is not None}
        held_by = [other for other in others if other.obj.id in floors_m]
        yield from (bddl.Atom("inside", (thing.obj.id, other.obj.id)) for other in held_by)
        if not any(other.obj.kind is Kind.ITEM for other in held_by):
            floor_m = max(floors_m.values(), default=-math.inf)
            clear = [one for one in others if one.obj.id in floors_m or not thing.is_above(one, floor_m)]
            yield from (bddl.Atom("ontop", (thing.obj.id, support)) for support in thing.stands_on(clear))


def door_states(objects: Iterable[SceneObject]) -> Iterator[bddl.Formula]:
    """Yield the `open` fact of every object with doors or drawers."""
    for obj in objects:
        if obj.kind is Kind.ARTICULATED:
            state = bddl.Atom("open", (obj.id,))
            yield state if open_fraction(obj) > OPEN_FRACTION else bddl.Not(state)


SWITCHED = frozenset({"has_button", "has_knob", "toggled_on"})
"""Predicates of appliances that geometry decides."""


STANDING = frozenset({"can_stand", "upright"})
"""Predicates of fallen things that geometry decides."""


def standing_states(objects: Iterable[SceneObject]) -> Iterator[bddl.Formula]:
    """Yield, of every item that has one way in which it stands, that it has one, and whether it stands so.

    There are none where nothing has fallen: then there is nothing to say of it.
    """
    items = [obj for obj in objects if obj.kind is Kind.ITEM]
    if any(obj.lean_deg > UPRIGHT_DEG and stands_by_nature(asset_for(obj)) for obj in items):
        for obj in (item for item in items if stands_by_nature(asset_for(item))):
            yield bddl.Atom("can_stand", (obj.id,))
            state = bddl.Atom("upright", (obj.id,))
            yield state if obj.lean_deg <= UPRIGHT_DEG else bddl.Not(state)


def control_states(objects: Iterable[SceneObject]) -> Iterator[bddl.Formula]:
    """Yield, of every object with a button or a knob, which of them it has, and whether it is switched on."""
    for obj in objects:
        for control in asset_for(obj).controls if obj.kind is not Kind.ITEM else ():
            yield bddl.Atom("has_button" if control.is_button else "has_knob", (obj.id,))
            state = bddl.Atom("toggled_on", (obj.id,))
            yield state if control.switched_on else bddl.Not(state)
