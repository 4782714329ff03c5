"""What is wrong with a scene before anything is planned or moved: things nobody can build, in each other, in mid-air.

Boxes of parts decide, not physics: it takes milliseconds and needs no simulator. What they cannot tell for sure (a gap
of millimetres, something askew) is left to physics.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

import bddl
from executor.assets.footprint import deepest_m, edge_margin_m, open_fraction, top_outlines
from executor.assets.library import asset_for
from executor.assets.parameters import AssetError
from executor.assets.transforms import rolls_freely
from executor.geometry import transform_from_quaternion
from executor.scenes.furnishing.usual import unlike_its_kind
from executor.scenes.rooms.furniture import robot_footprint
from executor.scenes.standing import NEAR_M, Solid, fallen_of, is_upright, relations, things_of
from oag import Kind, Scene, SceneError, SceneObject
from oag.model.errors import listed
from oag.model.scenefile import FLOOR
from oag.table.library import OPEN_FRACTION

MOST_OVERLAP_M = 0.01
"""Boxes of round things overlap by some millimetres where the things do not."""

MOST_FALL_M = 0.05
"""What would fall further than this was not meant to be there."""

MOST_SUNK_M = 0.005
"""Heights in files are rounded to whole centimetres; what is deeper in a top is pushed out by physics."""

SURELY_BEYOND_M = 0.01
"""The middle of a box is off the middle of the weight by millimetres."""

HARDLY_ON_M = 0.005
"""A middle that is no farther within an edge than this may go over it when physics settles."""

_LIES_RAD = math.radians(5.0)  # One of its own axes is vertical within this.
_HALF_TURN = (0.0, 0.0, 0.0, 1.0)
_ROBOT_TOP_M = 1.0  # What begins higher is above the robot's base.


@dataclass(frozen=True, slots=True)
class Flaw:
    """One thing that is wrong: an error, or a warning of what physics will change."""

    object_id: str
    said: str
    error: bool = True

    def __str__(self) -> str:
        return f"{self.object_id} {self.said}"


def require_possible(scene: Scene) -> tuple[Flaw, ...]:
    """Refuses a scene that cannot be: things that nobody can build, that overlap, float, or are not where facts say.

    Returns:
        The warnings among the flaws.

    Raises:
        SceneError: All errors that `flaws` finds are listed.
    """
    found = flaws(scene)
    refuse(scene, found)
    return found


def refuse(scene: Scene, flaws: tuple[Flaw, ...]) -> None:
    """Raises a SceneError that lists all errors among the flaws, if there are any."""
    errors = [str(flaw) for flaw in flaws if flaw.error]
    if errors:
        raise SceneError(listed(errors), source=scene.name)


def flaws(scene: Scene) -> tuple[Flaw, ...]:
    """Returns everything that is wrong with a scene: what cannot be built, else what cannot be where it is."""
    unbuildable = (*_unbuildable(scene), *_absurd(scene))
    if unbuildable:
        return unbuildable
    upright, fallen = things_of(scene.objects), fallen_of(scene.objects)
    things = {key: upright.get(key) or fallen.get(key) or Solid.fallen(obj) for key, obj in scene.objects.items()}
    near = [(a, b) for a, b in combinations(things.values(), 2) if a.near(b)]
    around = {key: [b if a.obj.id == key else a for a, b in near if key in (a.obj.id, b.obj.id)] for key in things}
    stated = {(literal.atom.label, literal.value) for fact in scene.facts for literal in bddl.literals(fact) or ()}
    placed, found = {**upright, **fallen}, tuple(relations(upright, fallen.values()))
    return (
        *_quaternions_swapped(scene.objects.values()),
        *(flaw for obj in scene.objects.values() for flaw in _askew(obj)),
        *(flaw for pair in near for flaw in _overlapping(*pair)),
        *(flaw for key, thing in things.items() for flaw in _floating(thing, around[key])),
        *(flaw for key, thing in things.items() for flaw in _over_the_edge(thing, around[key])),
        *_on_the_robot(scene, things.values()),
        *(flaw for label, value in sorted(stated) for flaw in _contradicted(label, value, placed, found)),
        *_unstated(placed, found, scene.closed, stated),
    )


def _unbuildable(scene: Scene) -> Iterator[Flaw]:
    for key, obj in scene.objects.items():
        try:
            asset_for(obj)
        except AssetError as problem:
            yield Flaw(key, f"({obj.category}): {problem.words}")


def _absurd(scene: Scene) -> Iterator[Flaw]:
    for key, obj in scene.objects.items():
        if (said := unlike_its_kind(obj)) is not None:
            yield Flaw(key, f"({obj.category}) {said}")


def _has_upright(obj: SceneObject) -> bool:
    """Decides whether it makes a difference how a thing is turned: of a ball it does not."""
    return not rolls_freely(asset_for(obj))


def _quaternions_swapped(objects: Collection[SceneObject]) -> Iterator[Flaw]:
    """Yields that quaternions were written x y z w: then all furniture would be upright, and now something is not."""
    turned = [obj for obj in objects if _has_upright(obj)]
    askew = [obj for obj in turned if not is_upright(obj)]
    if askew:
        furniture = [obj for obj in turned if obj.kind is not Kind.ITEM]
        # Where all furniture stands either way, the items decide.
        decisive = furniture if any(obj in furniture for obj in askew) else turned
        if all(is_upright(obj, w_last=True) for obj in decisive):
            said = "has quaternions that look like x y z w: all furniture would be upright then; expected w x y z"
            yield Flaw("scene", said)
    elif len(turned) > 1 and all(obj.orientation == _HALF_TURN for obj in turned):
        said = "has the quaternion 0 0 0 1 for everything: half a turn in w x y z, no turn in x y z w; expected w x y z"
        yield Flaw("scene", said, error=False)


def _askew(obj: SceneObject) -> Iterator[Flaw]:
    """Yields that a thing lies, leans or is upside down; physics moves items alone."""
    if is_upright(obj) or not _has_upright(obj):
        return
    up = transform_from_quaternion(obj.position, obj.orientation)[2, :3]
    if math.acos(min(1.0, float(np.abs(up).max()))) > _LIES_RAD:
        how = f"leans by {math.degrees(math.acos(max(-1.0, min(1.0, float(up[2]))))):.0f} degrees"
    else:
        how = "is upside down" if up[2] < -0.5 else "lies on its side"
    if obj.kind is Kind.ITEM:
        yield Flaw(obj.id, f"{how}; how it comes to rest is for physics to decide", error=False)
    else:
        yield Flaw(obj.id, f"{how}; furniture has to stand upright")


def _overlapping(first: Solid, second: Solid) -> Iterator[Flaw]:
    """Yields that one of two things is in the other's solid parts; the box around what leans tells too much of it."""
    # In a bowl, between its walls, boxes of round walls say nothing.
    vessels = first.obj.kind is second.obj.kind is Kind.ITEM
    if vessels and (first.holds(second) is not None or second.holds(first) is not None):
        return
    if first.body.depth_m(second.body) > MOST_OVERLAP_M:
        depth_m = deepest_m(first.parts, second.parts)
        if depth_m > MOST_OVERLAP_M:
            said = f"and {second.obj.id} overlap by {_cm(depth_m)}{_instead(first, second)}"
            yield Flaw(first.obj.id, said, error=not (_leans(first.obj) or _leans(second.obj)))


def _leans(obj: SceneObject) -> bool:
    """Decides whether none of a thing's own axes is vertical."""
    up = transform_from_quaternion(obj.position, obj.orientation)[2, :3]
    return _has_upright(obj) and math.acos(min(1.0, float(np.abs(up).max()))) > _LIES_RAD


def _instead(first: Solid, second: Solid) -> str:
    """Returns how an item in a piece of furniture would stand on it; nothing for other pairs."""
    item, other = (first, second) if first.obj.kind is Kind.ITEM else (second, first)
    if item.obj.kind is not Kind.ITEM or other.obj.kind is Kind.ITEM or not other.tops:
        return ""
    return f'; with "on": "{other.obj.id}" {item.obj.id} stands on top of it'


def _floating(thing: Solid, others: list[Solid]) -> Iterator[Flaw]:
    """Yields that nothing is under a thing, or that it is in the floor; furniture may hang on a wall."""
    key, body = thing.obj.id, thing.body
    if thing.obj.category in ("wall", FLOOR):
        return
    if body.low_m < -NEAR_M:
        meant = f"on the floor its middle is at z = {(body.high_m - body.low_m) / 2:.3f}; or give x y only"
        yield Flaw(key, f"is {_cm(-body.low_m)} deep in the floor; {meant}")
        return
    tops = [(0.0, "the floor")]
    for other in others:
        tops += [(part.high_m, other.obj.id) for part in other.parts if body.gap_m(part) < 0.0]
        floor_m = other.holds(thing)
        tops += [] if floor_m is None else [(floor_m, other.obj.id)]
    height_m, name = max(top for top in tops if top[0] <= body.low_m + NEAR_M)
    fall_m = body.low_m - height_m
    if fall_m <= NEAR_M:
        if thing.obj.kind is Kind.ITEM and not _leans(thing.obj):
            yield from _sunk(thing, others)
        return
    if thing.obj.kind is not Kind.ITEM:
        yield Flaw(key, f"hangs {_cm(fall_m)} above {name}", error=False)
        return
    far = fall_m > MOST_FALL_M
    where = f"{_cm(fall_m)} above {name}"
    if far:
        where += f"; with its middle at z = {height_m + (body.high_m - body.low_m) / 2:.3f} it stands there"
    yield Flaw(key, f"{'is in mid-air' if far else 'will fall'}: {where}", error=far)


def _sunk(thing: Solid, others: Iterable[Solid]) -> Iterator[Flaw]:
    """Yields that a thing is a little in the top that its middle is over: too little to count as an overlap."""
    for other in others:
        above_m = other.below_m(thing) if other.tops else None
        if above_m is not None and -NEAR_M < above_m < -MOST_SUNK_M:
            said = f"is {_cm(-above_m)} deep in the top of {other.obj.id}; physics will push it out"
            yield Flaw(thing.obj.id, said, error=False)


def _over_the_edge(thing: Solid, others: Iterable[Solid]) -> Iterator[Flaw]:
    """Yields that a thing stands on something with its middle beyond the edge of that, or hardly within it."""
    body, obj = thing.body, thing.obj
    if obj.category in ("wall", FLOOR) or _leans(obj) or body.low_m < NEAR_M:
        return
    under = []
    for other in others:
        floor_m = other.holds(thing)
        if floor_m is not None and abs(body.low_m - floor_m) < NEAR_M:
            return
        if any(abs(part.high_m - body.low_m) < NEAR_M and body.gap_m(part) < 0.0 for part in other.parts):
            under.append(other)
    if not under:
        return
    # What a mug's ear adds to its box weighs little.
    held_m = asset_for(obj).grasp_point_m if obj.kind is Kind.ITEM else (0.0, 0.0, 0.0)
    middle = (transform_from_quaternion(obj.position, obj.orientation) @ (*held_m, 1.0))[:2]
    tops = [ring for one in under for height_m, ring in top_outlines(one.obj) if abs(height_m - body.low_m) < NEAR_M]
    # Of a mesh that is not quite level the surface tells more than the outlines of its parts.
    on_surface_m = max(one.within_m(middle, body.low_m) for one in under)
    margin_m = edge_margin_m(body, tops, middle)
    margin_m = max(margin_m, on_surface_m) if on_surface_m >= 0.0 else margin_m
    names = " and ".join(one.obj.id for one in under)
    if margin_m < 0.0:
        surely = margin_m < -SURELY_BEYOND_M and obj.kind is Kind.ITEM
        by = f" by {_cm(-margin_m)}" if math.isfinite(margin_m) else ""
        yield Flaw(obj.id, f"stands with its middle beyond the edge of {names}{by}: it will fall", error=surely)
    elif margin_m < min(HARDLY_ON_M, body.half_x_m / 2, body.half_y_m / 2):
        said = f"stands with its middle {_cm(margin_m)} within the edge of {names}: it may fall"
        yield Flaw(obj.id, said, error=False)


def _on_the_robot(scene: Scene, things: Collection[Solid]) -> Iterator[Flaw]:
    """Yields that the robot starts where a thing is; of several, the one that it is deepest in is named."""
    x, y, _ = scene.robot.position
    robot = robot_footprint(x, y, scene.robot.yaw_rad)
    low = [thing for thing in things if thing.obj.category != FLOOR and thing.body.low_m < _ROBOT_TOP_M]
    deepest = min(low, key=lambda thing: thing.body.gap_m(robot), default=None)
    if deepest is not None and (depth_m := -deepest.body.gap_m(robot)) > MOST_OVERLAP_M:
        yield Flaw("robot", f"starts {_cm(depth_m)} inside {deepest.obj.id}; give it another position, or none")


def _contradicted(
    label: tuple[str, ...], value: bool, things: Mapping[str, Solid], found: Collection[bddl.Atom]
) -> Iterator[Flaw]:
    """Yields that a fact is not so by positions and joints, with what is so."""
    predicate, first, *rest = label
    if first not in things or (rest and rest[0] not in things):
        return
    said = f"({' '.join(label)})" if value else f"(not ({' '.join(label)}))"
    so = [atom for atom in found if atom.args[0] == first]
    instead = f"; by its position: {', '.join(map(bddl.format, so))}" if so else ""
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
            yield Flaw(first, f"is not on {rest[0]}, as the facts say {said}: its bottom is {where}{instead}")
        elif not value and above_m is not None and abs(above_m) < NEAR_M:
            yield Flaw(first, f"is on {rest[0]} by its position, and the facts say {said}")
    elif predicate == "inside":
        is_in = things[rest[0]].holds(things[first]) is not None
        if is_in is not value:
            where = f"is {'' if is_in else 'not '}in {rest[0]} by its position"
            yield Flaw(first, f"{where}, and the facts say {said}{'' if is_in else instead}")


def _unstated(
    things: Mapping[str, Solid],
    found: Collection[bddl.Atom],
    closed: Collection[str],
    stated: set[tuple[tuple[str, ...], bool]],
) -> Iterator[Flaw]:
    """Yields what positions say of items and the facts, which are said to be complete, do not."""
    for atom in found:
        item, label = things[atom.args[0]], atom.label
        if item.obj.kind is not Kind.ITEM or atom.predicate not in closed:
            continue
        if (label, True) not in stated and (label, False) not in stated:
            where = f"is {'on' if atom.predicate == 'ontop' else 'in'} {atom.args[1]} by its position"
            yield Flaw(item.obj.id, f"{where}, and no fact says ({' '.join(label)})", error=False)


def _cm(length_m: float) -> str:
    return f"{100.0 * length_m:.1f} cm"
