"""Validate a scene before anything is planned or moved: by geometry, and by a second of physics.

`issues` compares boxes of parts: it takes milliseconds and needs no simulator. It finds objects that cannot be built,
that overlap, or that float. What boxes cannot decide (a gap of millimetres, a tilted object) is left to physics.

`settle` runs physics: objects must not overlap, doors must be able to swing, nothing may fall, and the detectors must
confirm the facts. Generators place objects by their boxes, but physics decides. A scene that does not hold is refused
with the object and the measured number, never repaired silently.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

import bddl
from executor.assets.asset_geometry import rolls_freely
from executor.assets.footprint import (
    Footprint,
    edge_margin_m,
    open_fraction,
    overlap_depth_m,
    solid_parts,
    top_outlines,
)
from executor.assets.library import asset_for
from executor.assets.model import Joint
from executor.assets.parameters import AssetError
from executor.geometry import pose_vector, transform_from_quaternion
from executor.scenes.models import implausible_object_size
from executor.scenes.placement import robot_footprint
from executor.scenes.support_relations import (
    NEAR_M,
    Solid,
    derive_support_relations,
    fallen_solids,
    is_upright,
    upright_solids,
)
from executor.sim.detectors import read, touching_bodies
from executor.sim.engine import GROUND, ROBOT, TIMESTEP_S
from executor.sim.world import World
from oag import Scene, SceneError, SceneObject
from oag.model.diagnostics import listed
from oag.model.scene import FLOOR
from oag.model.symbols import Kind
from oag.primitives.table import OPEN_FRACTION

MOST_OVERLAP_M = 0.01
"""Boxes of round things overlap by some millimetres where the things do not."""

MOST_FALL_M = 0.05
"""Fall height from which on a floating object is an error."""

MOST_SUNK_M = 0.005
"""Tolerated depth in a top, since files round heights to centimetres; physics pushes out deeper objects."""

SURELY_BEYOND_M = 0.01
"""The middle of a box is off the middle of the weight by millimetres."""

HARDLY_ON_M = 0.005
"""An object whose centre is this near to an edge may go over it when physics settles."""

_LIES_RAD = math.radians(5.0)  # One of its own axes is vertical within this.
_HALF_TURN = (0.0, 0.0, 0.0, 1.0)
_ROBOT_TOP_M = 1.0  # Objects that begin higher are above the robot's base.


@dataclass(frozen=True, slots=True)
class Issue:
    """One issue of a scene: an error, or a warning of what physics will change."""

    object_id: str
    text: str
    error: bool = True

    def __str__(self) -> str:
        return f"{self.object_id} {self.text}"


def require_valid(scene: Scene) -> tuple[Issue, ...]:
    """Refuse an impossible scene: objects that cannot be built, that overlap, float, or contradict facts.

    Returns:
        The warnings among the issues.

    Raises:
        SceneError: All errors among `issues` are listed.
    """
    found = issues(scene)
    raise_errors(scene, found)
    return found


def raise_errors(scene: Scene, issues: tuple[Issue, ...]) -> None:
    """Raise a SceneError that lists all errors among the issues, if there are any."""
    errors = [str(issue) for issue in issues if issue.error]
    if errors:
        raise SceneError(listed(errors), source=scene.name)


def issues(scene: Scene) -> tuple[Issue, ...]:
    """Return all issues of a scene: objects that cannot be built, else impossible placements."""
    unbuildable = (*_unbuildable(scene), *_absurd(scene))
    if unbuildable:
        return unbuildable
    upright, fallen = upright_solids(scene.objects), fallen_solids(scene.objects)
    things = {key: upright.get(key) or fallen.get(key) or Solid.fallen(obj) for key, obj in scene.objects.items()}
    near = [(a, b) for a, b in combinations(things.values(), 2) if a.near(b)]
    around = {key: [b if a.obj.id == key else a for a, b in near if key in (a.obj.id, b.obj.id)] for key in things}
    stated = {(literal.atom.label, literal.value) for fact in scene.facts for literal in bddl.literals(fact) or ()}
    itself = [label for label, value in sorted(stated) if value and len(label) == 3 and label[1] == label[2]]
    if itself:
        return tuple(
            Issue(name, f"cannot be {predicate} itself, as the facts have it") for predicate, name, _ in itself
        )
    placed, found = {**upright, **fallen}, tuple(derive_support_relations(upright, fallen.values()))
    return (
        *_quaternions_swapped(scene.objects.values()),
        *(issue for obj in scene.objects.values() for issue in _askew(obj)),
        *(issue for pair in near for issue in _overlapping(*pair)),
        *(issue for key, thing in things.items() for issue in _floating(thing, around[key])),
        *(issue for key, thing in things.items() for issue in _over_the_edge(thing, around[key])),
        *_on_the_robot(scene, things.values()),
        *(issue for label, value in sorted(stated) for issue in _contradicted(label, value, placed, found)),
        *_unstated(placed, found, scene.closed, stated),
    )


def _unbuildable(scene: Scene) -> Iterator[Issue]:
    for key, obj in scene.objects.items():
        try:
            asset_for(obj)
        except AssetError as problem:
            yield Issue(key, f"({obj.category}): {problem.words}")


def _absurd(scene: Scene) -> Iterator[Issue]:
    for key, obj in scene.objects.items():
        if (text := implausible_object_size(obj)) is not None:
            yield Issue(key, f"({obj.category}) {text}")


def _has_upright(obj: SceneObject) -> bool:
    """Return whether an object's orientation matters: not that of a ball."""
    return not rolls_freely(asset_for(obj))


def _quaternions_swapped(objects: Collection[SceneObject]) -> Iterator[Issue]:
    """Yield an issue if quaternions look like x y z w: all furniture would be upright then, and now it is not."""
    turned = [obj for obj in objects if _has_upright(obj)]
    askew = [obj for obj in turned if not is_upright(obj)]
    if askew:
        furniture = [obj for obj in turned if obj.kind is not Kind.ITEM]
        # Where all furniture stands either way, the items decide.
        decisive = furniture if any(obj in furniture for obj in askew) else turned
        if all(is_upright(obj, w_last=True) for obj in decisive):
            text = "has quaternions that look like x y z w: all furniture would be upright then; expected w x y z"
            yield Issue("scene", text)
    elif len(turned) > 1 and all(obj.orientation == _HALF_TURN for obj in turned):
        text = "has the quaternion 0 0 0 1 for everything: half a turn in w x y z, no turn in x y z w; expected w x y z"
        yield Issue("scene", text, error=False)


def _askew(obj: SceneObject) -> Iterator[Issue]:
    """Yield an issue if an object lies, leans or is upside down; physics moves items only."""
    if is_upright(obj) or not _has_upright(obj):
        return
    up = transform_from_quaternion(obj.position, obj.orientation)[2, :3]
    if math.acos(min(1.0, float(np.abs(up).max()))) > _LIES_RAD:
        how = f"leans by {math.degrees(math.acos(max(-1.0, min(1.0, float(up[2]))))):.0f} degrees"
    else:
        how = "is upside down" if up[2] < -0.5 else "lies on its side"
    if obj.kind is Kind.ITEM:
        yield Issue(obj.id, f"{how}; how it comes to rest is for physics to decide", error=False)
    else:
        yield Issue(obj.id, f"{how}; furniture has to stand upright")


def _overlapping(first: Solid, second: Solid) -> Iterator[Issue]:
    """Yield an issue if two objects' solid parts overlap; the box around a leaning object is too large."""
    # Inside a vessel, the boxes of round walls are no evidence.
    vessels = first.obj.kind is second.obj.kind is Kind.ITEM
    if vessels and (first.hollow_floor_m(second) is not None or second.hollow_floor_m(first) is not None):
        return
    if first.body.depth_m(second.body) > MOST_OVERLAP_M:
        depth_m = overlap_depth_m(first.parts, second.parts)
        if depth_m > MOST_OVERLAP_M:
            text = f"and {second.obj.id} overlap by {_cm(depth_m)}{_instead(first, second)}"
            yield Issue(first.obj.id, text, error=not (_leans(first.obj) or _leans(second.obj)))


def _leans(obj: SceneObject) -> bool:
    """Return whether none of an object's own axes is vertical."""
    up = transform_from_quaternion(obj.position, obj.orientation)[2, :3]
    return _has_upright(obj) and math.acos(min(1.0, float(np.abs(up).max()))) > _LIES_RAD


def _instead(first: Solid, second: Solid) -> str:
    """Return a hint on standing an item on a piece of furniture; empty for other pairs."""
    item, other = (first, second) if first.obj.kind is Kind.ITEM else (second, first)
    if item.obj.kind is not Kind.ITEM or other.obj.kind is Kind.ITEM or not other.tops:
        return ""
    return f'; with "on": "{other.obj.id}" {item.obj.id} stands on top of it'


def _floating(thing: Solid, others: list[Solid]) -> Iterator[Issue]:
    """Yield an issue if nothing is under an object, or if it is in the floor; furniture may hang on a wall."""
    key, body = thing.obj.id, thing.body
    if thing.obj.category in ("wall", FLOOR) or (thing.obj.fixed and body.low_m >= 0.0):
        return
    if body.low_m < -NEAR_M:
        meant = f"on the floor its middle is at z = {(body.high_m - body.low_m) / 2:.3f}; or give x y only"
        yield Issue(key, f"is {_cm(-body.low_m)} deep in the floor; {meant}")
        return
    tops = [(0.0, "the floor")]
    for other in others:
        tops += [(part.high_m, other.obj.id) for part in other.parts if body.gap_m(part) < 0.0]
        floor_m = other.hollow_floor_m(thing)
        tops += [] if floor_m is None else [(floor_m, other.obj.id)]
    height_m, name = max(top for top in tops if top[0] <= body.low_m + NEAR_M)
    fall_m = body.low_m - height_m
    if fall_m <= NEAR_M:
        if thing.obj.kind is Kind.ITEM and not _leans(thing.obj):
            yield from _sunk(thing, others)
        return
    if thing.obj.kind is not Kind.ITEM:
        yield Issue(key, f"hangs {_cm(fall_m)} above {name}", error=False)
        return
    far = fall_m > MOST_FALL_M
    where = f"{_cm(fall_m)} above {name}"
    if far:
        where += f"; with its middle at z = {height_m + (body.high_m - body.low_m) / 2:.3f} it stands there"
    yield Issue(key, f"{'is in mid-air' if far else 'will fall'}: {where}", error=far)


def _sunk(thing: Solid, others: Iterable[Solid]) -> Iterator[Issue]:
    """Yield an issue if an object is slightly in the top under its centre: too little to count as an overlap."""
    for other in others:
        above_m = other.height_above_top_m(thing) if other.tops else None
        if above_m is not None and -NEAR_M < above_m < -MOST_SUNK_M:
            text = f"is {_cm(-above_m)} deep in the top of {other.obj.id}; physics will push it out"
            yield Issue(thing.obj.id, text, error=False)


def _over_the_edge(thing: Solid, others: Iterable[Solid]) -> Iterator[Issue]:
    """Yield an issue if an object's centre is beyond its support's edge, or hardly within it."""
    body, obj = thing.body, thing.obj
    if obj.category in ("wall", FLOOR) or obj.fixed or _leans(obj) or body.low_m < NEAR_M:
        return
    under = []
    for other in others:
        floor_m = other.hollow_floor_m(thing)
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
        yield Issue(obj.id, f"stands with its middle beyond the edge of {names}{by}: it will fall", error=surely)
    elif margin_m < min(HARDLY_ON_M, body.half_x_m / 2, body.half_y_m / 2):
        text = f"stands with its middle {_cm(margin_m)} within the edge of {names}: it may fall"
        yield Issue(obj.id, text, error=False)


def _on_the_robot(scene: Scene, things: Collection[Solid]) -> Iterator[Issue]:
    """Yield an issue if the robot starts in an object; of several, the deepest one is named."""
    x, y, _ = scene.robot.position
    robot = robot_footprint(x, y, scene.robot.yaw_rad)
    low = [thing for thing in things if thing.obj.category != FLOOR and thing.body.low_m < _ROBOT_TOP_M]
    deepest = min(low, key=lambda thing: thing.body.gap_m(robot), default=None)
    if deepest is not None and (depth_m := -deepest.body.gap_m(robot)) > MOST_OVERLAP_M:
        yield Issue("robot", f"starts {_cm(depth_m)} inside {deepest.obj.id}; give it another position, or none")


def _contradicted(
    label: tuple[str, ...], value: bool, things: Mapping[str, Solid], found: Collection[bddl.Atom]
) -> Iterator[Issue]:
    """Yield an issue if positions and joints contradict a fact, with the actual state."""
    predicate, first, *rest = label
    if first not in things or (rest and rest[0] not in things):
        return
    statement = f"({' '.join(label)})" if value else f"(not ({' '.join(label)}))"
    so = [atom for atom in found if atom.args[0] == first]
    instead = f"; by its position: {', '.join(map(bddl.format, so))}" if so else ""
    if predicate == "open":
        fraction = things[first].obj.parameters.get("open_fraction", 0.0)
        is_open = open_fraction(things[first].obj) > OPEN_FRACTION
        if is_open is not value:
            state = "open" if is_open else "shut"
            yield Issue(first, f"is {state} by its parameter open_fraction ({fraction}), and the facts say {statement}")
    elif predicate == "ontop":
        above_m = things[rest[0]].height_above_top_m(things[first])
        if value and (above_m is None or abs(above_m) > MOST_FALL_M):
            side = "above" if above_m is not None and above_m > 0.0 else "below"
            where = "beside its top" if above_m is None else f"{_cm(abs(above_m))} {side} it"
            yield Issue(first, f"is not on {rest[0]}, as the facts say {statement}: its bottom is {where}{instead}")
        elif not value and above_m is not None and abs(above_m) < NEAR_M:
            yield Issue(first, f"is on {rest[0]} by its position, and the facts say {statement}")
    elif predicate == "inside":
        is_in = things[rest[0]].hollow_floor_m(things[first]) is not None
        if is_in is not value:
            where = f"is {'' if is_in else 'not '}in {rest[0]} by its position"
            yield Issue(first, f"{where}, and the facts say {statement}{'' if is_in else instead}")


def _unstated(
    things: Mapping[str, Solid],
    found: Collection[bddl.Atom],
    closed: Collection[str],
    stated: set[tuple[tuple[str, ...], bool]],
) -> Iterator[Issue]:
    """Yield item relations that positions show and the supposedly complete facts lack."""
    for atom in found:
        item, label = things[atom.args[0]], atom.label
        if item.obj.kind is not Kind.ITEM or atom.predicate not in closed:
            continue
        if (label, True) not in stated and (label, False) not in stated:
            where = f"is {'on' if atom.predicate == 'ontop' else 'in'} {atom.args[1]} by its position"
            yield Issue(item.obj.id, f"{where}, and no fact says ({' '.join(label)})", error=False)


def _cm(length_m: float) -> str:
    return f"{100.0 * length_m:.1f} cm"


SETTLE_S = 1.0
MOST_MOVED_M = 0.01
MOST_TURNED_RAD = 0.1
MOST_SETTLED_OVERLAP_M = 0.001
SWING_RAD = np.deg2rad(60.0)
"""Least opening of a door on a vertical hinge before it meets other furniture; a hand fits in then."""

SLIDE_SHARE = 0.6
"""Least share of its range that a drawer or a lid must open before that."""

_SWING_STEPS = 12  # One every eight degrees.
_AJAR = 0.02  # Well below the fraction from which on a thing is open.


class Unsettled(ValueError):
    """A scene does not hold once physics runs.

    Attributes:
        kind: "overlap", "door-blocked", "moved", "ajar" or "fact".
    """

    def __init__(self, scene: str, kind: str, object_id: str, problem: str) -> None:
        super().__init__(f"scene {scene}: {object_id} {problem}")
        self.kind, self.object_id = kind, object_id


def settle(scene: Scene) -> Scene:
    """Return the scene with every free object at its resting pose in physics.

    Raises:
        Unsettled: Objects overlap, other furniture blocks a door or drawer, an object moved or turned further than
            allowed, or a fact and the detectors disagree.
    """
    with World(scene, oracle=True) as still:
        _check_overlaps(scene, still)
        _check_doors(scene, still)
    with World(scene) as world:
        for _ in range(round(SETTLE_S / TIMESTEP_S)):
            world.step()
        settled = _settled(scene, world)
        _check_facts(settled, world)
    return settled


def overlaps(world: World) -> Iterator[tuple[str, str, float]]:
    """Yield two owners and their overlap depth [m] for every overlapping pair.

    Args:
        world: A world built with `oracle=True`, at the poses to check.
    """
    world.step()
    for contact in world.contacts():
        a, b = contact.a, contact.b
        if a.owner != b.owner and contact.separation_m < 0.0 and {a.owner, b.owner} != {ROBOT, GROUND}:
            yield a.owner, b.owner, -contact.separation_m
    # The engine reports no contacts between bodies that cannot move, so furniture is compared part by part.
    fixed = [obj for name, obj in world.scene.objects.items() if name not in world.dynamic_ids]
    for first, second in combinations(fixed, 2):
        if Footprint.of(first).gap_m(Footprint.of(second)) < 0.0:
            depth_m = overlap_depth_m(solid_parts(first), solid_parts(second))
            if depth_m > 0.0:
                yield first.id, second.id, depth_m


def _check_overlaps(scene: Scene, world: World) -> None:
    for first, second, depth_m in overlaps(world):
        if depth_m > MOST_SETTLED_OVERLAP_M:
            problem = f"overlaps {second} by {1000 * depth_m:.1f} mm"
            raise Unsettled(scene.name, "overlap", first, problem)


def _check_doors(scene: Scene, world: World) -> None:
    """Open each door and drawer alone and check for other furniture in its way."""
    for object_id in world.articulated_ids:
        for joint in world.assets[object_id].doors:
            start = world.joint_position(object_id, joint.name)
            for position in np.linspace(*_swing(joint), _SWING_STEPS):
                world.set_joint_position(object_id, joint.name, float(position))
                world.step()
                blocker = _blocker(world, object_id, joint)
                if blocker is not None:
                    angle = f"{np.rad2deg(position):.0f} degrees" if joint.kind == "revolute" else f"{position:.2f} m"
                    problem = f"meets {blocker} when its {joint.child} is open by {angle}"
                    raise Unsettled(scene.name, "door-blocked", object_id, problem)
            world.set_joint_position(object_id, joint.name, start)


def _swing(joint: Joint) -> tuple[float, float]:
    low, high = joint.limits
    upright = joint.kind == "revolute" and abs(joint.axis[2]) > 0.9
    return low, min(high, float(SWING_RAD)) if upright else low + SLIDE_SHARE * (high - low)


def _blocker(world: World, object_id: str, joint: Joint) -> str | None:
    for contact in world.contacts({object_id}):
        owners = {contact.a.owner, contact.b.owner}
        links = {body.link for body in (contact.a, contact.b) if body.owner == object_id}
        other = next(iter(owners - {object_id}), None)
        loose = other is None or other in (ROBOT, GROUND) or other in world.dynamic_ids
        if not loose and joint.child in links and contact.separation_m < -MOST_SETTLED_OVERLAP_M:
            return other
    return None


def _settled(scene: Scene, world: World) -> Scene:
    objects = dict(scene.objects)
    for name in world.dynamic_ids:
        T = world.T_world_link(name)
        x, y, z, *quaternion = (round(float(value), 6) for value in pose_vector(T))
        before = scene.objects[name]
        moved_m = float(np.linalg.norm(np.subtract((x, y, z), before.position)))
        if moved_m > MOST_MOVED_M:
            raise Unsettled(scene.name, "moved", name, f"moved {1000 * moved_m:.0f} mm within the settling time")
        cosine = abs(float(np.dot(before.orientation, quaternion)))
        turned_rad = 2.0 * float(np.arccos(min(cosine, 1.0)))
        if turned_rad > MOST_TURNED_RAD:
            problem = f"turned {np.rad2deg(turned_rad):.0f} degrees within the settling time"
            raise Unsettled(scene.name, "moved", name, problem)
        w, i, j, k = (float(part) for part in np.asarray(quaternion) / np.linalg.norm(quaternion))
        objects[name] = replace(before, position=(x, y, z), orientation=(w, i, j, k))
    for name in world.articulated_ids:
        for joint in world.assets[name].doors:
            opened = joint.fraction(world.joint_position(name, joint.name)) - open_fraction(scene.objects[name])
            if abs(opened) > _AJAR:
                problem = f"does not stay as it is: its {joint.child} moved by {100 * abs(opened):.0f} % of its range"
                raise Unsettled(scene.name, "ajar", name, problem)
    return replace(scene, objects=objects)


def _check_facts(scene: Scene, world: World) -> None:
    """Compare every fact that a detector can read, and every `ontop` and `inside` that no fact states."""
    stated = {literal.atom: literal.value for fact in scene.facts for literal in bddl.literals(fact) or ()}
    # The engine reports no contacts between fixed bodies, such as a microwave on its counter.
    asked = {atom: value for atom, value in stated.items() if len(atom.args) == 1 or atom.args[0] in world.dynamic_ids}
    hollow = [name for name, asset in world.assets.items() if any(r.kind == "interior" for r in asset.regions)]
    for item in world.dynamic_ids:
        # Only what touches a thing can carry it, and only what is hollow can contain it.
        carriers = set(touching_bodies(world, item)) & world.assets.keys() if "ontop" in scene.closed else set()
        containers = set(hollow) - {item} if "inside" in scene.closed else set()
        for other in sorted(carriers):
            asked.setdefault(bddl.Atom("ontop", (item, other)), False)
        for other in sorted(containers):
            asked.setdefault(bddl.Atom("inside", (item, other)), False)
    for atom, value in asked.items():
        found = read(atom, world)
        if found.value is not None and found.value is not value:
            problem = f"is {'' if found.value else 'not '}{atom.predicate} {' '.join(atom.args[1:])} by the detectors"
            numbers = ", ".join(f"{key} {number}" for key, number in found.measurements.to_json().items())
            raise Unsettled(scene.name, "fact", atom.args[0], f"{problem.strip()}, against the facts ({numbers})")
