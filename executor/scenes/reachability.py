"""Reachability of a task: whether this robot can do it in this scene, by kinematics and free floor alone.

A task passes if, for every subtask,

- what is grasped (an item, or the handle of a door or drawer), and
- where a held item is put (some free spot of the support's interiors or surfaces)

has an admissible hand pose with a base pose on free floor and an arm posture that keeps every joint 5 degrees away from
its limits. Admissible hand poses are the planner's own: pitches and headings of `motion.grasping.grasps`. A held item
keeps the pitch of its grasp when it is put down, unless it is a ball. Into a compartment the hand comes through its
opening. The base may stand where its box touches nothing that is lower than the arm's mount. Doors count as shut for
the floor. The handle of a door to be closed is where the door stands open by 75 % of its range.

Arm collisions, paths and physics are not checked: a task that passes can still fail.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import bddl
from executor.assets.asset_geometry import rolls_freely
from executor.assets.footprint import Footprint, link_frame, solid_parts
from executor.assets.library import asset_for
from executor.assets.model import Asset, Region
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
from executor.planning.grasps import handle_goals, item_goals
from executor.planning.picks import TURNS_RAD, WIDE_TURNS_RAD
from executor.planning.placements import spots
from executor.planning.stances import HandGoal
from executor.records import require_flows
from executor.sim.robot.description import JOINT_NAMES
from executor.sim.robot.kinematics import ARM, Kinematics
from executor.sim.world import World
from executor.system.progress import OnProgress, ignore_progress
from oag import Primitive, Scene, SceneObject, Task
from oag.model.scene import RobotPose

CLOSING_FRACTION = 0.75  # Open fraction of a door to be closed.
OPENING_HEADING_RAD = 0.5
"""Largest deviation of the hand's heading from straight through a compartment's opening."""

_AWAY = np.zeros(3)  # The robot's current position does not matter here.
REACHES_M = (0.45, 0.40, 0.50, 0.35, 0.55, 0.30, 0.60)  # Comfortable ones first.
MARGIN_RAD = math.radians(5.0)
"""The least distance of every joint to its limits."""

_PLENTY_RAD = math.radians(40.0)  # A posture with more margin is no better.
_RESTARTS = 16
_BASE_HALF_M = 0.17  # Half of the base's side.
_BASE_ROOM_M = 0.01
_BASE_HIGH_M = 0.30  # Height of the arm's mount.
_FLOOR_M = 0.03  # Ground clearance of the base.
_HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
_OF_DOORS = {Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE}


@dataclass(frozen=True, slots=True)
class HandReach:
    """The best reach of one of several hand poses, or the nearest miss.

    Attributes:
        margin_rad: Distance of the posture's nearest joint to its limit; negative beyond it; None if no posture was
            found at all.
        height_m: Of the hand.
        reach_m: From the base's axis to the hand.
        pitch_rad: Downward tilt of the hand.
        joint: The joint that is nearest to its limit, or beyond it.
        blocker: Object on the floor where the robot would have to stand, if that is the reason.
    """

    margin_rad: float | None
    height_m: float
    reach_m: float
    pitch_rad: float
    joint: str | None = None
    blocker: str | None = None

    @property
    def reachable(self) -> bool:
        """Whether a base pose on free floor has a posture with the margin."""
        return self.margin_rad is not None and self.margin_rad >= MARGIN_RAD and self.blocker is None

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """A sort key; the best reach has the largest.

        Feasible reaches come first, then those blocked by the floor only, then the least violation of a limit.
        """
        return self.reachable, self.blocker is not None, -math.inf if self.margin_rad is None else self.margin_rad

    def __str__(self) -> str:
        """Return the reach, or the nearest miss, as a predicate of the object that is reached for."""
        where = f"with the hand {self.height_m:.2f} m high at a pitch of {round(math.degrees(self.pitch_rad))} degrees"
        if self.margin_rad is None:
            return f"is out of the arm's reach {where}"
        if self.blocker is not None:
            return f"can be reached only from where {self.blocker} stands ({where}, {self.reach_m:.2f} m from the base)"
        degrees = math.degrees(self.margin_rad)
        side = f"{-degrees:.0f} degrees beyond its limit" if degrees < 0.0 else f"{degrees:.0f} degrees off its limit"
        if self.reachable:
            return f"is reached {where}, {self.reach_m:.2f} m from the base, {self.joint} {side}"
        return f"cannot be reached within joint limits: {where}, {self.joint} would be {side}"


@dataclass(frozen=True, slots=True)
class PartReach:
    """Reachability of one object or place for the hand.

    Attributes:
        subtask: Name of the subtask.
        what: Such as "glass_0", "a handle of refrigerator_0", "a place inside refrigerator_0".
        best: The best reach, or the nearest miss; None without an admissible pose of the hand.
        why_none: Why there is none; else empty.
    """

    subtask: str
    what: str
    best: HandReach | None
    why_none: str = ""

    @property
    def reachable(self) -> bool:
        """Whether the hand reaches it."""
        return self.best is not None and self.best.reachable

    def __str__(self) -> str:
        return f"{self.subtask}: {self.what} {self.best or self.why_none}"


@dataclass(frozen=True, slots=True)
class Reach:
    """Reachability of a task: every object and place for the hand, in the order of the subtasks."""

    parts: tuple[PartReach, ...]

    @property
    def reachable(self) -> bool:
        """Whether everything can be reached."""
        return all(part.reachable for part in self.parts)

    @property
    def reason(self) -> str:
        """The first unreachable part, and why; empty if all are reachable."""
        return next((str(part) for part in self.parts if not part.reachable), "")

    @property
    def margin_rad(self) -> float | None:
        """The least joint margin of all parts; None if a part has no posture at all."""
        known = [part.best.margin_rad for part in self.parts if part.best and part.best.margin_rad is not None]
        return min(known) if known and len(known) == len(self.parts) else None

    def to_json(self) -> dict[str, Any]:
        """Return the verdict with its numbers as plain data."""
        parts = [{"reachable": part.reachable, "words": str(part), **asdict(part)} for part in self.parts]
        return {"reachable": self.reachable, "margin_rad": self.margin_rad, "parts": parts}


def reach(scene: Scene, task: Task, on_progress: OnProgress = ignore_progress) -> Reach:
    """Return the reachability of a task.

    Args:
        scene: Concrete: objects at the sizes at which they are handled.
        task: With a flow for every subtask.
        on_progress: Called with the number of decided subtasks, and their total.

    Raises:
        MissingFlow: A subtask has no flow, so that its grasps are unknown.
        AssetError: The library cannot build something.
    """
    require_flows(task)
    with World(Scene("empty", RobotPose(scale=scene.robot.scale), {})) as world:
        return Reach(tuple(_parts(scene, task, ReachSearch(Kinematics(world.robot), Floor(scene)), on_progress)))


def _parts(scene: Scene, task: Task, search: ReachSearch, on_progress: OnProgress) -> Iterator[PartReach]:
    """Yield the hand's objects and places, subtask by subtask."""
    assets = {name: asset_for(obj) for name, obj in scene.objects.items()}
    pitches: dict[str, frozenset[float]] = {}  # Object id -> pitches at which it can be grasped.
    for index, subtask in enumerate(task.subtasks):
        on_progress(index, len(task.subtasks))
        used = {action.primitive for action in subtask.flow or ()}
        obj, asset = scene.objects[subtask.target], assets[subtask.target]
        if used & _OF_DOORS:
            handles = _handle_poses(obj, asset, closing=Primitive.ARTICULATE_CLOSE in used)
            best = search.best(handles) if handles else None
            why_none = "moves too little to open anything" if asset.handles else "does not exist"
            yield PartReach(subtask.name, f"a handle of {obj.id}", best, why_none if best is None else "")
            continue
        if Primitive.GRASP in used:
            by_pitch: dict[float, list[HandGoal]] = {}
            for goal in item_goals(asset, transform_from_quaternion(obj.position, obj.orientation)):
                by_pitch.setdefault(_pitch(goal), []).append(goal)
            reaches = {pitch: search.best(goals) for pitch, goals in by_pitch.items()}
            if reaches:
                good = frozenset(pitch for pitch, found in reaches.items() if found.reachable)
                pitches[obj.id] = frozenset(by_pitch) if rolls_freely(asset) and good else good
                yield PartReach(subtask.name, obj.id, max(reaches.values(), key=lambda found: found.rank))
            else:
                yield PartReach(subtask.name, obj.id, None, "cannot be held by any pose of the hand")
        if subtask.support_goal is not None and subtask.support_goal in scene.objects:
            support = scene.objects[subtask.support_goal]
            inside = any(a.predicate == "inside" and support.id in a.args[1:] for a in bddl.atoms(subtask.goal))
            kind, what = ("interior", "inside") if inside else ("surface", "on")
            taken = pitches.get(subtask.target)
            poses = [
                goal
                for region in assets[support.id].regions
                if region.kind == kind
                for goal in _put_poses(support, region, asset)
                if not taken or _pitch(goal) in taken
            ]
            best = search.best(poses) if poses else None
            why_none = "" if poses else f"does not exist: {support.id} has no {kind} that it fits in"
            yield PartReach(subtask.name, f"a place {what} {support.id}", best, why_none)


def _handle_poses(obj: SceneObject, asset: Asset, *, closing: bool) -> list[HandGoal]:
    fraction = CLOSING_FRACTION if closing else None
    bars = [bar for bar in asset.handles if asset.joint(bar.joint).opens]
    return [goal for bar in bars for goal in handle_goals(bar, link_frame(obj, bar.link, fraction))]


def _put_poses(obj: SceneObject, region: Region, item: Asset) -> list[HandGoal]:
    """Hand poses that hold an item upright over the spots of a region; through the opening if it has one."""
    T = link_frame(obj, region.link, CLOSING_FRACTION)
    opening = T[:3, :3] @ np.array(region.opening)
    level = abs(opening[2]) < 0.5
    if level and region.height_m < item.extent_m[2]:
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


def _pitch(goal: HandGoal) -> float:
    return round(pitch_of(goal.T_world_eef), 3)


class Floor:
    """A scene's obstacles for the base, doors shut."""

    def __init__(self, scene: Scene) -> None:
        self._parts: list[tuple[str, Footprint, list[Footprint]]] = []
        for obj in scene.objects.values():
            if obj.role == "A" and Footprint.of(obj).low_m < _BASE_HIGH_M:
                low = [part for part in solid_parts(obj) if part.low_m < _BASE_HIGH_M and part.high_m > _FLOOR_M]
                self._parts.append((obj.id, Footprint.of(obj), low))

    def blocker(self, base: Array) -> str | None:
        """Return the object that the base would touch at (x, y, yaw), or None on free floor."""
        half = _BASE_HALF_M + _BASE_ROOM_M
        body = Footprint(float(base[0]), float(base[1]), float(base[2]), half, half)
        for name, around, parts in self._parts:
            if body.gap_m(around) < 0.0 and any(body.gap_m(part) < 0.0 for part in parts):
                return name
        return None


class ReachSearch:
    """Search for base poses and postures; postures follow from the hand in the base frame, and are cached."""

    def __init__(self, kinematics: Kinematics, floor: Floor) -> None:
        self._kinematics, self._floor = kinematics, floor
        self._known: dict[tuple[float, ...], Array | None] = {}

    def best(self, goals: Iterable[HandGoal]) -> HandReach:
        """Return a comfortable reach of the first goals that have one, else the best of all.

        Args:
            goals: Admissible hand poses, at least one.
        """
        wanted, tried = list(goals), list[HandReach]()
        for turns_rad in (TURNS_RAD, WIDE_TURNS_RAD):
            for goal, reach_m, turn in itertools.product(wanted, REACHES_M, turns_rad):
                tried.append(self._at(goal, goal.base_before(reach_m, turn), reach_m))
                if tried[-1].reachable and (tried[-1].margin_rad or 0.0) >= _PLENTY_RAD:
                    break
            best = max(tried, key=lambda found: found.rank)
            if best.reachable:
                break
        return best

    def _at(self, goal: HandGoal, base: Array, reach_m: float) -> HandReach:
        height_m, pitch = float(goal.T_world_eef[2, 3]), pitch_of(goal.T_world_eef)
        arm = self._posture(goal.T_world_eef, base)
        if arm is None:
            return HandReach(None, height_m, reach_m, pitch)
        margins = np.minimum(arm - self._kinematics.arm_lower, self._kinematics.arm_upper - arm)
        nearest = int(np.argmin(margins))
        margin = float(margins[nearest])
        blocker = None if margin < MARGIN_RAD else self._floor.blocker(base)
        return HandReach(margin, height_m, reach_m, pitch, JOINT_NAMES[ARM][nearest], blocker)

    def _posture(self, T_world_eef: Array, base: Array) -> Array | None:
        """Return the posture (7,) that is farthest from joint limits, or least beyond them; None without one."""
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
