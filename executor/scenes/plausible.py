"""What is wrong with a scene before anything is planned or moved: things nobody can build, in each other, in mid-air.

Boxes of parts decide, not physics: it takes milliseconds and needs no simulator. What they cannot tell for sure (a gap
of millimetres, something askew) is left to physics.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Self

import numpy as np

import bddl
from executor.assets.library import asset_for
from executor.assets.parameters import AssetError
from executor.geometry import Array
from executor.scenes.rooms.footprint import Footprint, deepest_m, open_fraction, region_frame, solid_parts
from oag import Kind, Scene, SceneError, SceneObject
from oag.table.library import OPEN_FRACTION

MOST_OVERLAP_M = 0.01
"""Boxes of round things overlap by some millimetres where the things do not."""

MOST_FALL_M = 0.05
"""What would fall further than this was not meant to be there."""

_NEAR_M = 0.02
_REACH_M = 0.6  # As far as drawers stand open.
_UPRIGHT = math.cos(math.radians(5.0))


@dataclass(frozen=True, slots=True)
class Flaw:
    """One thing that is wrong: an error, or a warning of what physics will change."""

    object_id: str
    said: str
    error: bool = True

    def __str__(self) -> str:
        return f"{self.object_id} {self.said}"


def require_buildable(scene: Scene) -> None:
    """Refuses a scene with things that nobody can build.

    Raises:
        SceneError: A category, a model, a size or a parameter is not one that the library has; all are listed.
    """
    refuse(scene, tuple(_unbuildable(scene)))


def refuse(scene: Scene, flaws: tuple[Flaw, ...]) -> None:
    """Raises a SceneError that lists all errors among the flaws, if there are any."""
    errors = [flaw for flaw in flaws if flaw.error]
    if errors:
        count = "1 thing is wrong" if len(errors) == 1 else f"{len(errors)} things are wrong"
        raise SceneError("".join((f"{count}:", *(f"\n  - {flaw}" for flaw in errors))), source=scene.name)


def flaws(scene: Scene) -> tuple[Flaw, ...]:
    """Returns everything that is wrong with a scene: what cannot be built, else what cannot be where it is."""
    unbuildable = tuple(_unbuildable(scene))
    if unbuildable:
        return unbuildable
    things = {key: _Thing.of(obj) for key, obj in scene.objects.items() if _is_upright(obj)}
    near = [(a, b) for a, b in combinations(things.values(), 2) if a.near(b)]
    around = {key: [b if a.obj.id == key else a for a, b in near if key in (a.obj.id, b.obj.id)] for key in things}
    stated = {(literal.atom.label, literal.value) for fact in scene.facts for literal in bddl.literals(fact) or ()}
    items = [thing for thing in things.values() if thing.obj.kind is Kind.ITEM]
    return (
        *(flaw for pair in near for flaw in _overlapping(*pair)),
        *(flaw for item in items for flaw in _floating(item, around[item.obj.id])),
        *(flaw for label, value in sorted(stated) for flaw in _contradicted(label, value, things)),
        *(flaw for item in items for flaw in _unstated(item, around[item.obj.id], scene.closed, stated)),
    )


@dataclass(frozen=True)
class _Thing:
    """A thing with its geometry, which takes longer to make than to compare.

    Attributes:
        body: Its box.
        parts: The boxes of its solid parts.
        tops: Pose and half sides of every surface that things stand on; its box's top where it has none.
        hollows: The same of the floors that things stand on inside it, with the height of the hollow.
    """

    obj: SceneObject
    body: Footprint
    parts: tuple[Footprint, ...]
    tops: tuple[tuple[Array, Array], ...]
    hollows: tuple[tuple[Array, Array, float], ...]

    @classmethod
    def of(cls, obj: SceneObject) -> Self:
        """Returns an upright object with its geometry."""
        body, regions = Footprint.of(obj), asset_for(obj).regions
        top = np.eye(4)
        top[:3, 3] = (body.x_m, body.y_m, body.high_m)
        tops = tuple(region_frame(obj, region) for region in regions if region.kind == "surface")
        hollows = (region for region in regions if region.kind == "interior")
        return cls(
            obj,
            body,
            tuple(solid_parts(obj)),
            tops or ((top, np.array([body.half_x_m, body.half_y_m])),),
            tuple((*region_frame(obj, region), 2.0 * float(region.half_extents_m[2])) for region in hollows),
        )

    def near(self, other: _Thing) -> bool:
        """True when the two may share a place on the floor plan: drawers that stand open reach a little further."""
        reach = sum(math.hypot(thing.body.half_x_m, thing.body.half_y_m) for thing in (self, other))
        return math.hypot(self.body.x_m - other.body.x_m, self.body.y_m - other.body.y_m) < reach + _REACH_M

    def holds(self, other: _Thing) -> float | None:
        """Returns the height of the floor of the hollow that another thing's middle is in, None when it is in none."""
        for T, half, height_m in self.hollows:
            x, y, z = (float(value) for value in T[:3, :3].T @ (np.asarray(other.obj.position) - T[:3, 3]))
            if abs(x) <= half[0] and abs(y) <= half[1] and -_NEAR_M <= z <= height_m + _NEAR_M:
                return float(T[2, 3])
        return None

    def below_m(self, other: _Thing) -> float | None:
        """Returns how high another thing's bottom is above the nearest top of this one; None beside all of them."""
        heights = []
        for T, half in self.tops:
            local = T[:2, :2].T @ (np.asarray(other.obj.position[:2]) - T[:2, 3])
            if (np.abs(local) <= half + _NEAR_M).all():
                heights.append(other.body.low_m - float(T[2, 3]))
        return min(heights, key=abs, default=None)


def _unbuildable(scene: Scene) -> Iterator[Flaw]:
    for key, obj in scene.objects.items():
        try:
            asset_for(obj)
        except AssetError as problem:
            yield Flaw(key, f"({obj.category}): {problem.words}")


def _is_upright(obj: SceneObject) -> bool:
    _, x, y, _ = obj.orientation
    return 1.0 - 2.0 * (x * x + y * y) > _UPRIGHT


def _overlapping(first: _Thing, second: _Thing) -> Iterator[Flaw]:
    """Yields that one of two things is in the other's solid parts."""
    # In a bowl, between its walls, boxes of round walls say nothing.
    vessels = first.obj.kind is second.obj.kind is Kind.ITEM
    if vessels and (first.holds(second) is not None or second.holds(first) is not None):
        return
    if first.body.depth_m(second.body) > MOST_OVERLAP_M:
        depth_m = deepest_m(first.parts, second.parts)
        if depth_m > MOST_OVERLAP_M:
            yield Flaw(first.obj.id, f"and {second.obj.id} overlap by {_cm(depth_m)}")


def _floating(item: _Thing, others: list[_Thing]) -> Iterator[Flaw]:
    """Yields that nothing is under an item, or that it is in the floor."""
    if item.body.low_m < -_NEAR_M:
        yield Flaw(item.obj.id, f"is {_cm(-item.body.low_m)} deep in the floor")
        return
    tops = [(0.0, "the floor")]
    for other in others:
        tops += [(part.high_m, other.obj.id) for part in other.parts if item.body.gap_m(part) < 0.0]
        floor_m = other.holds(item)
        tops += [] if floor_m is None else [(floor_m, other.obj.id)]
    height_m, name = max(top for top in tops if top[0] <= item.body.low_m + _NEAR_M)
    fall_m = item.body.low_m - height_m
    if fall_m > _NEAR_M:
        far = fall_m > MOST_FALL_M
        yield Flaw(item.obj.id, f"{'is in mid-air' if far else 'will fall'}: {_cm(fall_m)} above {name}", error=far)


def _contradicted(label: tuple[str, ...], value: bool, things: Mapping[str, _Thing]) -> Iterator[Flaw]:
    """Yields that a fact is not so by positions and joints."""
    predicate, first, *rest = label
    if first not in things or (rest and rest[0] not in things):
        return
    said = f"({' '.join(label)})" if value else f"(not ({' '.join(label)}))"
    if predicate == "open":
        fraction = things[first].obj.parameters.get("open_fraction", 0.0)
        is_open = open_fraction(things[first].obj) > OPEN_FRACTION
        if is_open is not value:
            state = "open" if is_open else "shut"
            yield Flaw(first, f"is {state} by its parameter open_fraction ({fraction}), and the facts say {said}")
    elif predicate == "ontop":
        above_m = things[rest[0]].below_m(things[first])
        if value and (above_m is None or abs(above_m) > MOST_FALL_M):
            side = "above" if above_m is not None and above_m > 0.0 else "below"
            where = "beside its top" if above_m is None else f"{_cm(abs(above_m))} {side} it"
            yield Flaw(first, f"is not on {rest[0]}, as the facts say {said}: its bottom is {where}")
        elif not value and above_m is not None and abs(above_m) < _NEAR_M:
            yield Flaw(first, f"is on {rest[0]} by its position, and the facts say {said}")
    elif predicate == "inside":
        is_in = things[rest[0]].holds(things[first]) is not None
        if is_in is not value:
            yield Flaw(first, f"is {'' if is_in else 'not '}in {rest[0]} by its position, and the facts say {said}")


def _unstated(
    item: _Thing, others: list[_Thing], closed: Collection[str], stated: set[tuple[tuple[str, ...], bool]]
) -> Iterator[Flaw]:
    """Yields what positions say of an item and the facts, which are said to be complete, do not."""
    for other in others:
        above_m = other.below_m(item) if "ontop" in closed else None
        found = {
            "ontop": above_m is not None and abs(above_m) < _NEAR_M,
            "inside": "inside" in closed and other.holds(item) is not None,
        }
        for predicate, so in found.items():
            label = (predicate, item.obj.id, other.obj.id)
            if so and (label, True) not in stated and (label, False) not in stated:
                where = f"is {'on' if predicate == 'ontop' else 'in'} {other.obj.id} by its position"
                yield Flaw(item.obj.id, f"{where}, and no fact says ({' '.join(label)})", error=False)


def _cm(length_m: float) -> str:
    return f"{100.0 * length_m:.1f} cm"
