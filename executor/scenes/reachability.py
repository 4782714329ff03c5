"""Whether a task can be done at all by this robot in this scene: a rule of kinematics and free floor.

The rule, declared before anything is executed. A pair is reachable when for every subtask

- what is taken hold of (an item, or the handle of a door or drawer) and
- where a held thing is put (some free spot of the support's interiors or surfaces)

has an admissible hand pose with a base pose on free floor and an arm posture that keeps every joint 5 degrees off its
limits. Admissible hand poses are the planner's own: pitches and headings of `motion.grasping.grasps`. What is put
somewhere keeps the pitch that it was taken with, unless it is a ball; into a compartment the hand comes through its
opening. The base may stand where its box touches nothing that is lower than the arm's mount; doors count as shut for
the floor, and as open by 75 % of their range for the handle of one that is to be closed.

No collisions of the arm, no ways, no physics: a pair that passes can still fail, and the failure is measured then.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

import bddl
from executor.assets.library import asset_for
from executor.assets.model import Asset, Region
from executor.assets.transforms import joint_transform
from executor.geometry import (
    Array,
    heading_of,
    inverse,
    pitch_of,
    rotation_z,
    transform,
    transform_from_quaternion,
    wrap_angle,
)
from executor.motion.grasping.grasps import handle_goals, item_goals
from executor.motion.grasping.reach import TURNS_RAD, WIDE_TURNS_RAD
from executor.motion.placing.place import rolls_freely
from executor.motion.placing.spots import spots
from executor.motion.planning.candidates import HandGoal
from executor.robot.description import JOINT_NAMES
from executor.robot.kinematics import ARM, Kinematics
from executor.scenes.pair import ScenePair
from executor.scenes.rooms.footprint import Footprint, open_fraction, solid_parts
from executor.world.world import World
from oag import Primitive, RobotPose, Scene, SceneObject, SimpleTask

CLOSING_FRACTION = 0.75  # How far what is to be closed stands open.
OPENING_HEADING_RAD = 0.5
"""How far the hand's heading may differ from straight through a compartment's opening."""

_AWAY = np.zeros(3)  # Where the robot stands now has no say in the rule.
REACHES_M = (0.45, 0.40, 0.50, 0.35, 0.55, 0.30, 0.60)  # Comfortable ones first.
MARGIN_RAD = math.radians(5.0)
"""The least distance of every joint to its limits."""

_PLENTY_RAD = math.radians(40.0)  # A posture with more margin is no better.
_RESTARTS = 16
_BASE_HALF_M = 0.17  # Half of the base's side.
_BASE_ROOM_M = 0.01
_BASE_HIGH_M = 0.30  # Height of the arm's mount.
_FLOOR_M = 0.03  # The base ends so high above the floor.
_HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True, slots=True)
class HandReach:
    """The best way to have the hand at one of several poses, or the nearest miss.

    Attributes:
        reachable: Whether a base pose on free floor has a posture with the margin.
        margin_rad: Of the posture: distance of the nearest joint to its limit; negative beyond it; None where no
            posture was found at all.
        height_m: Of the hand.
        reach_m: From the base's axis to the hand.
        pitch_rad: Downward tilt of the hand.
        joint: The joint that is nearest to its limit, or beyond it.
        blocker: What stands on the floor where the robot would have to stand, when that is the reason.
    """

    reachable: bool
    margin_rad: float | None
    height_m: float
    reach_m: float
    pitch_rad: float
    joint: str | None = None
    blocker: str | None = None


@dataclass(frozen=True, slots=True)
class PartReach:
    """What the rule says of one thing that the hand has to get to.

    Attributes:
        subtask: Name of the subtask.
        what: Such as "glass_0", "a handle of refrigerator_0", "a place inside refrigerator_0".
        best: The best reach, or the nearest miss.
        reason: Why not; empty where it can be reached.
    """

    subtask: str
    what: str
    best: HandReach
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Reach:
    """What the rule says of a pair.

    Attributes:
        reachable: Whether everything can be reached.
        reason: The first thing that cannot, and why; empty where all can.
        parts: Every thing, in the order of the subtasks.
    """

    reachable: bool
    reason: str
    parts: tuple[PartReach, ...]

    @property
    def margin_rad(self) -> float | None:
        """The least joint margin of all parts; None where a part has no posture at all."""
        margins = [part.best.margin_rad for part in self.parts]
        known = [margin for margin in margins if margin is not None]
        return min(known) if len(known) == len(margins) and known else None


def reach(pair: ScenePair) -> Reach:
    """Returns what the rule says of a scene-task pair.

    Raises:
        ValueError: A subtask has no flow.
    """
    with World(Scene("empty", RobotPose(), {})) as world:
        search = ReachSearch(Kinematics(world.robot), Floor(pair.scene))
        rule = _Rule(pair.scene, search)
        parts = tuple(part for subtask in pair.task.subtasks for part in rule.parts(subtask))
    failed = next((part for part in parts if part.reason), None)
    reason = "" if failed is None else f"{failed.subtask}: {failed.what} {failed.reason}"
    return Reach(failed is None, reason, parts)


class _Rule:
    """Goes through the subtasks in order, and keeps in mind with which pitches things were taken."""

    def __init__(self, scene: Scene, search: ReachSearch) -> None:
        self._scene, self._search = scene, search
        self._assets = {name: asset_for(obj) for name, obj in scene.objects.items()}
        self._pitches: dict[str, frozenset[float]] = {}

    def parts(self, subtask: SimpleTask) -> list[PartReach]:
        """Returns what the hand has to get to in a subtask."""
        if not subtask.flow:
            raise ValueError(f"the subtask {subtask.name} has no flow, so that nobody knows what it takes hold of")
        used = {action.primitive for action in subtask.flow}
        obj, asset = self._scene.objects[subtask.target], self._assets[subtask.target]
        if used & {Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE}:
            closing = Primitive.ARTICULATE_CLOSE in used
            what = f"a handle of {obj.id}"
            if not asset.handles:
                return [_nowhere(subtask, what, obj, "does not exist")]
            return [_part(subtask, what, self._search.best(_handle_poses(obj, asset, closing=closing)))]
        found = []
        if Primitive.GRASP in used:
            found.append(self._take(subtask, obj, asset))
        if subtask.support_goal is not None and subtask.support_goal in self._scene.objects:
            found.append(self._put(subtask, asset))
        return found

    def _take(self, subtask: SimpleTask, obj: SceneObject, asset: Asset) -> PartReach:
        goals = item_goals(asset, transform_from_quaternion(obj.position, obj.orientation))
        by_pitch = {pitch: [goal for goal in goals if _pitch(goal) == pitch] for pitch in map(_pitch, goals)}
        if not goals:
            return _nowhere(subtask, obj.id, obj, "cannot be held by any pose of the hand")
        reaches = {pitch: self._search.best(some) for pitch, some in by_pitch.items()}
        good = [pitch for pitch, found in reaches.items() if found.reachable]
        self._pitches[obj.id] = frozenset(by_pitch) if rolls_freely(asset) and good else frozenset(good)
        return _part(subtask, obj.id, max(reaches.values(), key=rank))

    def _put(self, subtask: SimpleTask, asset: Asset) -> PartReach:
        support = subtask.support_goal or ""
        obj, pitches = self._scene.objects[support], self._pitches.get(subtask.target)
        inside = any(a.predicate == "inside" and support in a.args[1:] for a in bddl.atoms(subtask.goal))
        kind = "interior" if inside else "surface"
        what = f"a place {'inside' if inside else 'on'} {support}"
        poses = [
            goal
            for region in self._assets[support].regions
            if region.kind == kind
            for goal in _put_poses(obj, self._assets[support], region, asset)
            if not pitches or _pitch(goal) in pitches
        ]
        if not poses:
            return _nowhere(subtask, what, obj, f"does not exist: {support} has no {kind} that it fits in")
        return _part(subtask, what, self._search.best(poses))


def _handle_poses(obj: SceneObject, asset: Asset, *, closing: bool) -> list[HandGoal]:
    poses = []
    for handle in asset.handles:
        joint = asset.joint(handle.joint)
        fraction = CLOSING_FRACTION if closing else open_fraction(obj)
        T = transform_from_quaternion(obj.position, obj.orientation) @ joint_transform(joint, joint.position(fraction))
        poses += handle_goals(handle, T)
    return poses


def _put_poses(obj: SceneObject, support: Asset, region: Region, item: Asset) -> list[HandGoal]:
    """Hand poses that hold an item upright over the spots of a region; through the opening where it has one."""
    joint = next((joint for joint in support.joints if joint.child == region.link), None)
    T = transform_from_quaternion(obj.position, obj.orientation)
    if joint is not None:
        T = T @ joint_transform(joint, joint.position(CLOSING_FRACTION))
    opening = T[:3, :3] @ np.array(region.opening)
    level = abs(opening[2]) < 0.5
    if level and 2 * region.half_extents_m[2] < item.extent_m[2]:
        return []
    found = []
    for spot in spots(region, T, max(item.extent_m[:2]), _AWAY):
        centre = spot.point_m + np.array([0.0, 0.0, item.extent_m[2] / 2])
        facings = spot.headings_rad if level else tuple(2 * math.pi * k / 12 for k in range(12))
        yaws = facings if item.grasp_axes else facings[:1]
        for yaw in yaws:
            for goal in item_goals(item, transform(rotation_z(yaw), centre)):
                off = abs(wrap_angle(goal.heading_rad - heading_of(-opening)))
                if not level or off <= OPENING_HEADING_RAD:
                    found.append(goal)
    return found


def _nowhere(subtask: SimpleTask, what: str, obj: SceneObject, reason: str) -> PartReach:
    """What the rule says where there is no admissible hand pose at all."""
    return PartReach(subtask.name, what, HandReach(False, None, float(obj.position[2]), 0.0, 0.0), reason)


def _part(subtask: SimpleTask, what: str, found: HandReach) -> PartReach:
    return PartReach(subtask.name, what, found, "" if found.reachable else _why(found))


def _why(miss: HandReach) -> str:
    """The nearest miss in words."""
    where = f"with the hand {miss.height_m:.2f} m high at a pitch of {math.degrees(miss.pitch_rad):.0f} degrees"
    if miss.margin_rad is None:
        return f"is out of the arm's reach {where}"
    if miss.blocker is not None:
        return f"can be reached only from where {miss.blocker} stands ({where}, {miss.reach_m:.2f} m from the base)"
    degrees = math.degrees(miss.margin_rad)
    side = f"{-degrees:.0f} degrees beyond its limit" if degrees < 0.0 else f"{degrees:.0f} degrees off its limit"
    return f"cannot be reached within joint limits: {where}, {miss.joint} would be {side}"


def _pitch(goal: HandGoal) -> float:
    return round(pitch_of(goal.T_world_eef), 3)


class Floor:
    """What of a scene stands in the base's way, doors shut."""

    def __init__(self, scene: Scene) -> None:
        self._parts: list[tuple[str, Footprint, list[Footprint]]] = []
        for obj in scene.objects.values():
            if obj.role == "A" and Footprint.of(obj).low_m < _BASE_HIGH_M:
                low = [part for part in solid_parts(obj) if part.low_m < _BASE_HIGH_M and part.high_m > _FLOOR_M]
                self._parts.append((obj.id, Footprint.of(obj), low))

    def blocker(self, base: Array) -> str | None:
        """Returns what the base would touch at (x, y, yaw), or None where the floor is free."""
        half = _BASE_HALF_M + _BASE_ROOM_M
        body = Footprint(float(base[0]), float(base[1]), float(base[2]), half, half)
        for name, around, parts in self._parts:
            if body.gap_m(around) < 0.0 and any(body.gap_m(part) < 0.0 for part in parts):
                return name
        return None


class ReachSearch:
    """Looks for base poses and postures; the latter follow from the hand in the base frame, and are remembered."""

    def __init__(self, kinematics: Kinematics, floor: Floor) -> None:
        self._kinematics, self._floor = kinematics, floor
        self._known: dict[tuple[float, ...], Array | None] = {}

    def best(self, goals: Iterable[HandGoal]) -> HandReach:
        """Returns a comfortable reach of the first goals that have one, else the best of all.

        Args:
            goals: Admissible hand poses, at least one.
        """
        wanted, tried = list(goals), list[HandReach]()
        for turns_rad in (TURNS_RAD, WIDE_TURNS_RAD):
            for found in self._reaches(wanted, turns_rad):
                tried.append(found)
                if found.reachable and (found.margin_rad or 0.0) >= _PLENTY_RAD:
                    break
            best = max(tried, key=rank)
            if best.reachable:
                return best
        return best

    def _reaches(self, goals: list[HandGoal], turns_rad: tuple[float, ...]) -> Iterator[HandReach]:
        for goal, reach_m, turn in itertools.product(goals, REACHES_M, turns_rad):
            yield self._at(goal, goal.base_before(reach_m, turn), reach_m)

    def _at(self, goal: HandGoal, base: Array, reach_m: float) -> HandReach:
        T, pitch = goal.T_world_eef, pitch_of(goal.T_world_eef)
        height_m = float(T[2, 3])
        arm = self._posture(T, base)
        if arm is None:
            return HandReach(False, None, height_m, reach_m, pitch)
        low, high = arm - self._kinematics.arm_lower, self._kinematics.arm_upper - arm
        nearest = int(np.argmin(np.minimum(low, high)))
        margin, joint = float(np.minimum(low, high)[nearest]), JOINT_NAMES[ARM][nearest]
        if margin < MARGIN_RAD:
            return HandReach(False, margin, height_m, reach_m, pitch, joint)
        blocker = self._floor.blocker(base)
        return HandReach(blocker is None, margin, height_m, reach_m, pitch, joint, blocker)

    def _posture(self, T_world_eef: Array, base: Array) -> Array | None:
        """The posture (7,) that is farthest from joint limits, or least beyond them; None where there is none."""
        T = inverse(self._kinematics.base_transform(base)) @ T_world_eef
        key = tuple(round(float(value), 3) for value in T[:3].ravel())
        if key not in self._known:
            found = [
                solution
                for hand in (T, T @ _HALF_TURN)
                for solution in self._kinematics.solve(
                    hand, np.zeros(3), restarts=_RESTARTS, minimum_margin_rad=-math.inf
                )[:1]
            ]
            self._known[key] = max(found, key=lambda s: s.margin_rad).arm if found else None
        return self._known[key]


def rank(found: HandReach) -> tuple[bool, bool, float]:
    """Returns a key by which the best reach is the largest.

    What can be done comes first, then what could be done but for the floor, then the least violation of a limit.
    """
    margin = -math.inf if found.margin_rad is None else found.margin_rad
    return found.reachable, found.blocker is not None, margin
