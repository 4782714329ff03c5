"""Detectors: truth values of ground atoms with their measurements, and how deep bodies overlap.

A detector reads geometry and contacts of the last physics step, and nothing else: no plan, no memory. A thing that is
still in the air is on nothing and, above an open container, in nothing. Let the world settle before a goal is judged,
and step once after unpacking, since contacts are found by stepping.

Overlaps are measured while physics runs: a contact solver allows some, and too much of it would be cheating.

Source: the predicates' readings follow OmniGibson's kinematic states where BEHAVIOR names them (nextto: a gap of at
most a sixth of the mean extents; open: a joint beyond five percent of its range). `ontop` and `inside` depart from the
usual bounding-box tests, which hold for an object that floats above its goal: they want contact or containment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import permutations
from types import MappingProxyType

import numpy as np

from bddl import Atom, literals, near_names
from bddl.errors import Scene2DemoError
from executor.assets.asset_geometry import bounds, hang_m, rolls_freely, stands_by_nature
from executor.assets.footprint import parts_gap_m, solid_parts
from executor.assets.model import Region
from executor.geometry import Array, inverse
from executor.records import Penetration
from executor.sim.engine import GROUND, ROBOT
from executor.sim.world import World
from oag.measurements import NOTHING_MEASURED, AtomMeasured
from oag.model.scene import UPRIGHT_DEG
from oag.primitives.table import OPEN_FRACTION

TOUCH_M = 0.002
GRIPPER = "gripper"
FLOOR = "floor"
ROOM_REACH_M = 2.0
"""How far beyond its furniture a room goes on, where no other room is nearer."""

_SINK_M = 0.005
_RISE_M = 0.02
"""A thing whose lowest point is higher above a top is not on it, whatever else of the support it touches, such as the
side of a shelf or the board above."""

_EDGE_M = 0.005
_UPRIGHT = 0.95  # Cosine of a lean up to which an object stands.
_LEANING = 0.7  # Up to which it stands or leans, and does not lie.
_REST_IMPULSE_NS = 1e-5


class UnknownObject(Scene2DemoError):
    """An atom names something that the world does not have."""

    def __init__(self, atom: Atom, name: str, known: tuple[str, ...]) -> None:
        near = near_names(name, known)
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        text = f"({atom.predicate} {' '.join(atom.args)})"
        super().__init__(f"{text}: no object {name!r}; {hint}known: {', '.join(known)}")


@dataclass(frozen=True, slots=True)
class AtomReading:
    """The reading of a detector.

    Attributes:
        value: True, False, or None where undecided.
        measurements: The numbers behind it.
    """

    value: bool | None
    measurements: AtomMeasured = NOTHING_MEASURED


def read(atom: Atom, world: World) -> AtomReading:
    """Return whether an atom holds in the world, as of the last physics step.

    Args:
        atom: A ground atom over the scene's object ids, `gripper`, `robot` and, below things, `floor`.

    Raises:
        UnknownObject: When the atom names an object that the world does not have.
    """
    known = (*world.assets, GRIPPER, ROBOT, FLOOR)
    for name in atom.args[:1] if atom.predicate == "inroom" else atom.args:
        if name not in known and atom.predicate in DETECTORS:
            raise UnknownObject(atom, name, known)
    detector = DETECTORS.get(atom.predicate)
    if detector is None:
        return AtomReading(None, AtomMeasured(reason=f"no detector reads {atom.predicate}"))
    if len(atom.args) == 2 and atom.args[0] == atom.args[1]:
        # Quantifiers ask such things; by the geometry of a hollow a bowl would be inside itself.
        return AtomReading(False, AtomMeasured(reason="no relation holds between a thing and itself"))
    return detector(world, *atom.args)


def fingers_touching(world: World, object_id: str) -> int:
    """Return how many of the two fingers press on an object (0, 1 or 2)."""
    pressing = {
        contact.a.link
        for contact in world.contacts({object_id})
        if contact.a.owner == ROBOT
        and contact.a.link in world.model.finger_links
        and contact.impulse_ns > _REST_IMPULSE_NS
    }
    return len(pressing)


def touching_bodies(world: World, object_id: str) -> tuple[str, ...]:
    """Return the owners of everything that touches an object, sorted."""
    owners = set()
    for contact in world.contacts({object_id}):
        if contact.separation_m <= TOUCH_M:
            owners |= {contact.a.owner, contact.b.owner}
    return tuple(sorted(owners - {object_id}))


def links_touching(world: World, object_id: str, other: str) -> frozenset[str]:
    """Return the links of another object that touch an object."""
    touching = (c for c in world.contacts({object_id}) if c.separation_m <= TOUCH_M)
    return frozenset(body.link for contact in touching for body in (contact.a, contact.b) if body.owner == other)


def _open(world: World, object_id: str) -> AtomReading:
    asset = world.assets.get(object_id)
    if asset is None or not asset.doors:
        # An object without a door is not open; of what is no object nothing is known.
        return AtomReading(None if asset is None else False, AtomMeasured(reason=f"{object_id} has no joint"))
    fractions = {joint.name: joint.fraction(world.joint_position(object_id, joint.name)) for joint in asset.doors}
    widest = max(fractions, key=lambda name: fractions[name])
    position, turns = world.joint_position(object_id, widest), asset.joint(widest).kind == "revolute"
    measured = AtomMeasured(
        open_fraction=fractions[widest],
        widest_joint=widest,
        angle_deg=float(np.degrees(position)) if turns else None,
        opening_m=None if turns else position,
    )
    return AtomReading(fractions[widest] > OPEN_FRACTION, measured)


def _toggled_on(world: World, object_id: str) -> AtomReading:
    asset = world.assets.get(object_id)
    if asset is None or not asset.controls:
        reason = f"{object_id} has neither a button nor a knob"
        return AtomReading(None if asset is None else False, AtomMeasured(reason=reason))
    control = asset.controls[0]
    position = world.joint_position(object_id, control.name)
    measured = AtomMeasured(
        control=control.name,
        turned_deg=None if control.is_button else float(np.degrees(position)),
        pressed_m=position if control.is_button else None,
    )
    return AtomReading(control.is_on(position), measured)


def _has_control(world: World, object_id: str, *, button: bool) -> AtomReading:
    asset = world.assets.get(object_id)
    return AtomReading(None if asset is None else any(one.is_button is button for one in asset.controls))


def _can_stand(world: World, object_id: str) -> AtomReading:
    asset = world.assets.get(object_id)
    return AtomReading(None if asset is None else asset.motion == "dynamic" and stands_by_nature(asset))


def _upright(world: World, object_id: str) -> AtomReading:
    """Return whether a thing stands as it does by nature: hardly leaning, on something that is not the hand."""
    asset = world.assets.get(object_id)
    if asset is None or not _can_stand(world, object_id).value:
        return AtomReading(None if asset is None else False, AtomMeasured(reason=f"{object_id} has no upright side"))
    supporters = tuple(owner for owner in touching_bodies(world, object_id) if owner != ROBOT)
    tilted_deg = float(np.degrees(np.arccos(np.clip(world.T_world_link(object_id)[2, 2], -1.0, 1.0))))
    measured = AtomMeasured(tilted_deg=tilted_deg, supported_by=supporters)
    return AtomReading(tilted_deg <= UPRIGHT_DEG and bool(supporters), measured)


def _inside(world: World, object_id: str, container: str) -> AtomReading:
    if container in (GRIPPER, ROBOT):
        fingers = fingers_touching(world, object_id)
        return AtomReading(fingers == 2, AtomMeasured(fingers_touching=fingers))
    if ROBOT in (object_id, container) or object_id == GRIPPER:
        return AtomReading(None, AtomMeasured(reason="only objects are looked for in containers"))
    regions = [region for region in world.assets[container].regions if region.kind == "interior"]
    if not regions:
        return AtomReading(False, AtomMeasured(reason=f"{container} has no interior"))
    supporters = [owner for owner in touching_bodies(world, object_id) if owner != ROBOT]
    fits = [_fit(world, object_id, container, region) for region in regions]
    links = links_touching(world, object_id, container)
    fits = [
        max(fit, _stands_in(world, object_id, container, region)) if region.link in links else fit
        for fit, region in zip(fits, regions, strict=True)
    ]
    best = max(range(len(regions)), key=lambda index: fits[index][0])
    depth, excess = fits[best]
    contained = excess <= _EDGE_M
    value = depth >= 0.0 and (bool(supporters) or contained)
    return AtomReading(
        value,
        AtomMeasured(
            region=regions[best].name,
            centre_depth_m=depth,
            largest_excess_m=excess,
            supported_by=tuple(supporters),
        ),
    )


def _ontop(world: World, object_id: str, support: str) -> AtomReading:
    if not {object_id, support}.isdisjoint((ROBOT, GRIPPER)):
        return AtomReading(None, AtomMeasured(reason="only objects are looked for on supports"))
    touching = (GROUND if support == FLOOR else support) in touching_bodies(world, object_id)
    measured = [_above(world, object_id, support, *surface) for surface in _surfaces(world, support)]
    hanging = 0.0 if support == FLOOR else hang_m(world.assets[object_id], world.assets[support])
    measured = [(height + hanging, outside) for height, outside in measured]
    height, outside = max(measured, key=lambda pair: (pair[1] <= 0.0, -abs(pair[0])))
    value = touching and -_SINK_M <= height <= _RISE_M and outside <= 0.0
    beyond_m = None if support == FLOOR else outside  # The floor has no edge.
    return AtomReading(
        value,
        AtomMeasured(height_above_surface_m=height, centre_beyond_edge_m=beyond_m, touching=touching),
    )


def _under(world: World, object_id: str, above: str) -> AtomReading:
    if not {object_id, above}.isdisjoint((ROBOT, GRIPPER)):
        return AtomReading(None, AtomMeasured(reason="only objects are looked for under objects"))
    center, half = box_around(world, object_id)
    top_center, top_half = box_around(world, above)
    beyond = float(np.max(np.abs(center - top_center)[:2] - top_half[:2]))
    clearance = float((top_center[2] + top_half[2]) - (center[2] + half[2]))
    inside = _inside(world, object_id, above).value is True
    return AtomReading(
        beyond <= 0.0 and clearance > 0.0 and not inside,
        AtomMeasured(centre_beyond_edge_m=beyond, top_below_top_m=clearance),
    )


def _nextto(world: World, first: str, second: str) -> AtomReading:
    if not {first, second}.isdisjoint((ROBOT, GRIPPER)):
        return AtomReading(None, AtomMeasured(reason="only objects are looked for next to objects"))
    (center_a, half_a), (center_b, half_b) = box_around(world, first), box_around(world, second)
    gap = np.maximum(np.abs(center_a - center_b) - half_a - half_b, 0.0)
    allowed = float(np.mean(half_a + half_b)) / 3.0  # A sixth of the mean of the summed extents.
    distance = float(np.linalg.norm(gap[:2]))
    overlap = np.abs(center_a - center_b) < half_a + half_b - _EDGE_M
    side_by_side = bool(overlap[2]) and not bool(np.all(overlap[:2]))
    return AtomReading(side_by_side and distance <= allowed, AtomMeasured(gap_m=distance, allowed_gap_m=allowed))


def _touching(world: World, first: str, second: str) -> AtomReading:
    if GRIPPER in (first, second):
        other = second if first == GRIPPER else first
        if other in (GRIPPER, ROBOT):
            return AtomReading(None, AtomMeasured(reason="the gripper is part of the robot"))
        fingers = fingers_touching(world, other)
        return AtomReading(fingers > 0, AtomMeasured(fingers_touching=fingers))
    of, other = (second, first) if first == ROBOT else (first, second)
    distances = [c.separation_m for c in world.contacts({of}) if {c.a.owner, c.b.owner} == {of, other}]
    if not distances and {of, other} <= world.assets.keys() - set(world.dynamic_ids):
        # The engine reports no contacts between bodies that cannot move.
        distances = [parts_gap_m(*(solid_parts(world.scene.objects[name]) for name in (of, other)))]
    if not distances:
        return AtomReading(False)
    return AtomReading(min(distances) <= TOUCH_M, AtomMeasured(separation_m=min(distances)))


def _inroom(world: World, object_id: str, room: str) -> AtomReading:
    rooms = rooms_of(world)
    if not rooms:
        return AtomReading(None, AtomMeasured(reason="the scene declares no rooms"))
    if room not in rooms:
        return AtomReading(None, AtomMeasured(reason=f"the scene has no room {room!r}; it has {', '.join(rooms)}"))
    if object_id == FLOOR:
        return AtomReading(None, AtomMeasured(reason="the floor is in every room"))
    place = world.T_world_link(ROBOT if object_id == GRIPPER else object_id)[:2, 3]
    away = {
        name: float(np.hypot(*np.maximum(np.maximum(low - place, place - high), 0.0)))
        for name, (low, high) in rooms.items()
    }
    nearest = min(away, key=lambda name: away[name])
    measured = AtomMeasured(beyond_its_furniture_m=away[room], nearest_room=nearest)
    return AtomReading(away[room] <= min(away[nearest], ROOM_REACH_M), measured)


def rooms_of(world: World) -> dict[str, tuple[Array, Array]]:
    """Return the rooms that a scene declares, each with the corners (2,) of the floor that its furniture spans.

    A scene declares `(inroom refrigerator_0 kitchen)` for the furniture of a room. Things that can be carried off do
    not count, unless there is nothing else.
    """
    members: dict[str, list[str]] = {}
    for fact in world.scene.facts:
        for literal in literals(fact) or ():
            atom = literal.atom
            if literal.value and atom.predicate == "inroom" and atom.args[0] in world.assets:
                members.setdefault(atom.args[1], []).append(atom.args[0])
    rooms = {}
    for room, names in members.items():
        boxes = [box_around(world, name) for name in names if name not in world.dynamic_ids]
        boxes = boxes or [box_around(world, name) for name in names]
        lows, highs = [c - h for c, h in boxes], [c + h for c, h in boxes]
        rooms[room] = (np.min(lows, axis=0)[:2], np.max(highs, axis=0)[:2])
    return rooms


def true_atoms(world: World, predicates: Iterable[str]) -> tuple[Atom, ...]:
    """Return every atom over two of the scene's objects that holds for some predicates, as of the last physics step."""
    atoms = (Atom(predicate, pair) for predicate in predicates for pair in permutations(world.scene.objects, 2))
    return tuple(atom for atom in atoms if read(atom, world).value)


DETECTORS: Mapping[str, Callable[..., AtomReading]] = MappingProxyType(
    {
        "can_stand": _can_stand,
        "has_button": partial(_has_control, button=True),
        "has_knob": partial(_has_control, button=False),
        "inroom": _inroom,
        "inside": _inside,
        "nextto": _nextto,
        "ontop": _ontop,
        "open": _open,
        "toggled_on": _toggled_on,
        "touching": _touching,
        "under": _under,
        "upright": _upright,
    }
)


def box_around(world: World, object_id: str, T_frame_world: Array | None = None) -> tuple[Array, Array]:
    """Return centre and half extents (3,) of the box around an object, joints shut, along a frame's axes."""
    T = world.T_world_link(object_id)
    if T_frame_world is not None:
        T = T_frame_world @ T
    low, high = bounds(world.assets[object_id], T[:3, :3])
    return T[:3, 3] + (low + high) / 2, (high - low) / 2


def _fit(world: World, object_id: str, container: str, region: Region) -> tuple[float, float]:
    """Return the depth of an object's centre in a region (negative: outside), and how far its box sticks out of it."""
    T_container_world = inverse(world.T_world_link(container, region.link))
    center, half = box_around(world, object_id, T_container_world)
    offset, room = np.abs(center - np.asarray(region.center_m)), np.asarray(region.half_extents_m)
    depth, excess = float(np.min(room - offset)), float(np.max(offset + half - room))
    up = float((T_container_world[:3, :3] @ world.T_world_link(object_id)[:3, 2])[2])
    # A saucer is in no cup that stands on it, though its middle is. A ball has no such way up: an apple that fills a
    # cup is in it however it is turned, and the box of a round hollow is narrower than the hollow.
    asset = world.assets[object_id]
    spare_m = float(room[:2].max()) - min(asset.extent_m[:2]) / 2
    lies = abs(up) > _UPRIGHT and not rolls_freely(asset)
    return (min(depth, spare_m) if spare_m < 0.0 and lies else depth), excess


def _stands_in(world: World, object_id: str, container: str, region: Region) -> tuple[float, float]:
    """Return the same as `_fit` of a thing that stands or leans in what is open at the top, and out of it.

    A bottle in a bowl is in it as much as a low thing is, though its middle is above the rim. What counts is its foot:
    between the walls, in the lower half of the hollow, and not below its floor, where a thing stands that the hollow
    was put over. The depth is that of the foot, below the half.
    """
    T = inverse(world.T_world_link(container, region.link)) @ world.T_world_link(object_id)
    extent, room = np.asarray(world.assets[object_id].extent_m), np.asarray(region.half_extents_m)
    if region.opening[2] <= _UPRIGHT or world.T_world_link(container, region.link)[2, 2] <= _UPRIGHT:
        return -np.inf, np.inf
    upwards = float(T[2, 2])
    foot = T[:3, 3] - T[:3, 2] * extent[2] / 2 - np.asarray(region.center_m)
    outside_m = float((np.abs(foot[:2]) + extent[:2].min() / 2 - room[:2]).max())
    is_below = foot[2] < -room[2] - _EDGE_M
    if upwards < _LEANING or outside_m > _EDGE_M or is_below:
        return -np.inf, np.inf
    return min(-float(foot[2]), *(room - np.abs(foot))[:2].tolist()), float(T[2, 3] + extent[2] / 2 - room[2])


def _surfaces(world: World, support: str) -> list[tuple[str | None, Array, Array]]:
    """Return the surfaces of a support: (link, centre, half extents in the plane); a box's top without regions."""
    if support == FLOOR:
        return [(None, np.zeros(3), np.full(2, np.inf))]
    asset = world.assets[support]
    tops: list[tuple[str | None, Array, Array]] = []
    for region in asset.regions:
        if region.kind == "surface":
            tops.append((region.link, np.asarray(region.floor_m), np.asarray(region.half_extents_m[:2])))
    half = np.asarray(asset.extent_m) / 2
    return tops or [(None, np.array([0.0, 0.0, half[2]]), half[:2])]


def _above(
    world: World, object_id: str, support: str, link: str | None, surface: Array, half: Array
) -> tuple[float, float]:
    """Return the height of an object's lowest point above a surface, and its centre's distance beyond the edge
    (negative: in).
    """
    T_world_support = np.eye(4) if support == FLOOR else world.T_world_link(support, link)
    center, extent = box_around(world, object_id, inverse(T_world_support))
    outside = float(np.max(np.abs(center[:2] - surface[:2]) - half))
    return float(center[2] - extent[2] - surface[2]), outside


LEAST_M = 1e-5
PERCENTILE = 99.0


@dataclass(frozen=True, slots=True)
class Overlap:
    """The deepest overlap in one state.

    Attributes:
        depth_m: How deep; 0 where nothing overlaps.
        pair: The two bodies as "owner/link", or nothing.
    """

    depth_m: float
    pair: tuple[str, ...] = ()


def deepest_overlap(world: World) -> Overlap:
    """Return the deepest overlap of any two bodies after the last physics step."""
    owners = {"robot", *world.assets}
    found = Overlap(0.0)
    for a, b, gap_m in world.near(owners, -LEAST_M):
        if -gap_m > found.depth_m:
            found = Overlap(-gap_m, (f"{a.owner}/{a.link}", f"{b.owner}/{b.link}"))
    return found


def summarize_overlaps(overlaps: Sequence[Overlap]) -> Penetration:
    """Return the figures of an episode."""
    if not overlaps:
        return Penetration()
    worst = max(overlaps, key=lambda overlap: overlap.depth_m)
    p99_m = float(np.percentile([overlap.depth_m for overlap in overlaps], PERCENTILE))
    return Penetration(round(p99_m, 6), round(worst.depth_m, 6), worst.pair, len(overlaps))
