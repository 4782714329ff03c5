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

import math
from dataclasses import dataclass

import numpy as np

import bddl
from executor.assets.library import asset_for
from executor.assets.model import Asset, Region
from executor.assets.transforms import joint_transform
from executor.geometry import heading_of, pitch_of, rotation_z, transform, transform_from_quaternion, wrap_angle
from executor.motion.grasping.grasps import handle_goals, item_goals
from executor.motion.placing.place import rolls_freely
from executor.motion.stances.candidates import HandGoal
from executor.motion.stances.spots import spots
from executor.robot.kinematics import Kinematics
from executor.scenes.pair import ScenePair
from executor.scenes.standing import Floor, Stander, Standing, rank
from executor.world.world import World
from oag import Primitive, RobotPose, Scene, SceneObject, SimpleTask

CLOSING_FRACTION = 0.75
OPENING_HEADING_RAD = 0.5
"""How far the hand's heading may differ from straight through a compartment's opening."""

_AWAY = np.zeros(3)


@dataclass(frozen=True, slots=True)
class PartReach:
    """What the rule says of one thing that the hand has to get to.

    Attributes:
        subtask: Name of the subtask.
        what: Such as "glass_0", "a handle of refrigerator_0", "a place inside refrigerator_0".
        standing: The best standing, or the nearest miss.
        reason: Why not; empty where it can be reached.
    """

    subtask: str
    what: str
    standing: Standing
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
        margins = [part.standing.margin_rad for part in self.parts]
        known = [margin for margin in margins if margin is not None]
        return min(known) if len(known) == len(margins) and known else None


def reach(pair: ScenePair) -> Reach:
    """Returns what the rule says of a scene-task pair.

    Raises:
        ValueError: A subtask has no flow.
    """
    with World(Scene("empty", RobotPose(), {})) as world:
        stander = Stander(Kinematics(world.robot), Floor(pair.scene))
        rule = _Rule(pair.scene, stander)
        parts = tuple(part for subtask in pair.task.subtasks for part in rule.parts(subtask))
    failed = next((part for part in parts if part.reason), None)
    reason = "" if failed is None else f"{failed.subtask}: {failed.what} {failed.reason}"
    return Reach(failed is None, reason, parts)


class _Rule:
    """Goes through the subtasks in order, and keeps in mind with which pitches things were taken."""

    def __init__(self, scene: Scene, stander: Stander) -> None:
        self._scene, self._stander = scene, stander
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
            return [_part(subtask, what, self._stander.best(_handle_poses(obj, asset, closing=closing)))]
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
        standings = {pitch: self._stander.best(some) for pitch, some in by_pitch.items()}
        good = [pitch for pitch, standing in standings.items() if standing.reachable]
        self._pitches[obj.id] = frozenset(by_pitch) if rolls_freely(asset) and good else frozenset(good)
        return _part(subtask, obj.id, max(standings.values(), key=rank))

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
        return _part(subtask, what, self._stander.best(poses))


def _handle_poses(obj: SceneObject, asset: Asset, *, closing: bool) -> list[HandGoal]:
    poses = []
    for handle in asset.handles:
        joint = asset.joint(handle.joint)
        fraction = CLOSING_FRACTION if closing else _number(obj, "open_fraction")
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
    return PartReach(subtask.name, what, Standing(False, None, float(obj.position[2]), 0.0, 0.0), reason)


def _part(subtask: SimpleTask, what: str, standing: Standing) -> PartReach:
    return PartReach(subtask.name, what, standing, "" if standing.reachable else _why(standing))


def _why(miss: Standing) -> str:
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


def _number(obj: SceneObject, name: str) -> float:
    value = obj.parameters.get(name, 0.0)
    return float(value) if isinstance(value, int | float) else 0.0
