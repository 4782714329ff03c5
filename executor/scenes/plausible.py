"""What is wrong with a scene before anything is planned or moved: things nobody can build, in each other, in mid-air.

Boxes of parts decide, not physics: it takes milliseconds and needs no simulator. What they cannot tell for sure (a gap
of millimetres, something askew) is left to physics.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

import bddl
from executor.assets.catalogue import asset_for
from executor.assets.parameters import AssetError
from executor.scenes.rooms.footprint import Footprint, solid_parts
from executor.scenes.rooms.tops import region_frame, regions_of
from oag import Kind, Scene, SceneError, SceneObject

MOST_OVERLAP_M = 0.01
"""Boxes of round things overlap by some millimetres where the things do not."""

MOST_FALL_M = 0.05
"""What would fall further than this was not meant to be there."""

_NEAR_M = 0.02
_OPEN_FRACTION = 0.05
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
    upright = {key: obj for key, obj in scene.objects.items() if _is_upright(obj)}
    parts = {key: solid_parts(obj) for key, obj in upright.items()}
    stated = {(literal.atom.label, literal.value) for fact in scene.facts for literal in bddl.literals(fact) or ()}
    return (
        *_overlapping(upright, parts),
        *(
            flaw
            for key, obj in upright.items()
            if obj.kind is Kind.ITEM
            for flaw in _floating(key, obj, upright, parts)
        ),
        *(flaw for label, value in sorted(stated) for flaw in _contradicted(label, value, upright)),
        *_unstated(scene, upright, stated),
    )


def _unbuildable(scene: Scene) -> Iterator[Flaw]:
    for key, obj in scene.objects.items():
        try:
            asset_for(obj)
        except AssetError as problem:
            yield Flaw(key, f"({obj.category}): {problem.words}")


def _is_upright(obj: SceneObject) -> bool:
    _, x, y, _ = obj.orientation
    return 1.0 - 2.0 * (x * x + y * y) > _UPRIGHT


def _overlapping(objects: Mapping[str, SceneObject], parts: Mapping[str, list[Footprint]]) -> Iterator[Flaw]:
    """Yields the pairs of things of which one is in the other's solid parts."""
    for first, second in combinations(objects, 2):
        around = (Footprint.of(objects[first]), Footprint.of(objects[second]))
        if around[0].depth_m(around[1]) <= MOST_OVERLAP_M:
            continue
        # In a bowl, between its walls, boxes of round walls say nothing.
        if any(_in_vessel(objects[a], objects[b]) for a, b in ((first, second), (second, first))):
            continue
        depth_m = max((a.depth_m(b) for a in parts[first] for b in parts[second]), default=0.0)
        if depth_m > MOST_OVERLAP_M:
            yield Flaw(first, f"and {second} overlap by {_cm(depth_m)}")


def _floating(
    key: str, obj: SceneObject, objects: Mapping[str, SceneObject], parts: Mapping[str, list[Footprint]]
) -> Iterator[Flaw]:
    """Yields that nothing is under an item, or that it is in the floor."""
    body = Footprint.of(obj)
    if body.low_m < -_NEAR_M:
        yield Flaw(key, f"is {_cm(-body.low_m)} deep in the floor")
        return
    tops = [(0.0, "the floor")]
    for other, thing in objects.items():
        if other != key:
            tops += [(part.high_m, other) for part in parts[other] if body.gap_m(part) < 0.0]
            hollow = _in_hollow(obj, thing)
            tops += [] if hollow is None else [(hollow, other)]
    under = [(height, name) for height, name in tops if height <= body.low_m + _NEAR_M]
    height, name = max(under)
    fall_m = body.low_m - height
    if fall_m > _NEAR_M:
        far = fall_m > MOST_FALL_M
        yield Flaw(key, f"{'is in mid-air' if far else 'will fall'}: {_cm(fall_m)} above {name}", error=far)


def _in_vessel(obj: SceneObject, other: SceneObject) -> bool:
    return Kind.ITEM is obj.kind is other.kind and _in_hollow(obj, other) is not None


def _in_hollow(obj: SceneObject, other: SceneObject) -> float | None:
    """Returns the height of the floor of the hollow that an object's middle is in, None when it is in none."""
    for region in regions_of(other):
        if region.kind == "interior":
            T, half = region_frame(other, region)
            x, y, z = (float(value) for value in T[:3, :3].T @ (np.asarray(obj.position) - T[:3, 3]))
            if abs(x) <= half[0] and abs(y) <= half[1] and -_NEAR_M <= z <= 2.0 * region.half_extents_m[2] + _NEAR_M:
                return float(T[2, 3])
    return None


def _contradicted(label: tuple[str, ...], value: bool, objects: Mapping[str, SceneObject]) -> Iterator[Flaw]:
    """Yields that a fact is not so by positions and joints."""
    predicate, first, *rest = label
    if first not in objects or (rest and rest[0] not in objects):
        return
    said = f"({' '.join(label)})" if value else f"(not ({' '.join(label)}))"
    obj = objects[first]
    if predicate == "open":
        fraction = obj.parameters.get("open_fraction", 0.0)
        is_open = isinstance(fraction, int | float) and fraction > _OPEN_FRACTION
        if is_open is not value:
            state = "open" if is_open else "shut"
            yield Flaw(first, f"is {state} by its parameter open_fraction ({fraction:g}), and the facts say {said}")
    elif predicate == "ontop":
        above_m = _above(obj, objects[rest[0]])
        if value and (above_m is None or abs(above_m) > MOST_FALL_M):
            where = (
                "beside its top" if above_m is None else f"{_cm(abs(above_m))} {'above' if above_m > 0 else 'below'} it"
            )
            yield Flaw(first, f"is not on {rest[0]}, as the facts say {said}: its bottom is {where}")
        elif not value and above_m is not None and abs(above_m) < _NEAR_M:
            yield Flaw(first, f"is on {rest[0]} by its position, and the facts say {said}")
    elif predicate == "inside":
        is_in = _in_hollow(obj, objects[rest[0]]) is not None
        if is_in is not value:
            yield Flaw(first, f"is {'' if is_in else 'not '}in {rest[0]} by its position, and the facts say {said}")


def _above(obj: SceneObject, support: SceneObject) -> float | None:
    """Returns how high an object's bottom is above the nearest top of another one; None beside all of them."""
    low_m = obj.position[2] - obj.height_m / 2
    surfaces = [region_frame(support, region) for region in regions_of(support) if region.kind == "surface"]
    if not surfaces:
        T = np.eye(4)
        around = Footprint.of(support)
        T[:3, 3] = (around.x_m, around.y_m, around.high_m)
        surfaces = [(T, np.array([around.half_x_m, around.half_y_m]))]
    heights = []
    for T, half in surfaces:
        local = T[:2, :2].T @ (np.asarray(obj.position[:2]) - T[:2, 3])
        if (np.abs(local) <= half + _NEAR_M).all():
            heights.append(low_m - float(T[2, 3]))
    return min(heights, key=abs, default=None)


def _unstated(
    scene: Scene, objects: Mapping[str, SceneObject], stated: set[tuple[tuple[str, ...], bool]]
) -> Iterator[Flaw]:
    """Yields what positions say and the facts, of predicates that the scene says it knows completely, do not."""
    for key, obj in objects.items():
        if obj.kind is not Kind.ITEM:
            continue
        for other, thing in objects.items():
            above_m = _above(obj, thing) if other != key and "ontop" in scene.closed else None
            found = {
                "ontop": above_m is not None and abs(above_m) < _NEAR_M,
                "inside": other != key and "inside" in scene.closed and _in_hollow(obj, thing) is not None,
            }
            for predicate, so in found.items():
                label = (predicate, key, other)
                if so and (label, True) not in stated and (label, False) not in stated:
                    where = "on" if predicate == "ontop" else "in"
                    said = f"({' '.join(label)})"
                    yield Flaw(key, f"is {where} {other} by its position, and no fact says {said}", error=False)


def _cm(length_m: float) -> str:
    return f"{100.0 * length_m:.1f} cm"
