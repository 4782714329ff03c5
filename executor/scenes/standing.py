"""Can the hand be at a pose at all: free floor to stand on, and an arm posture within joint limits.

Kinematics and the floor alone: no arm is checked for collisions, no way there is looked for, nothing is moved.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from executor.geometry import Array, inverse, pitch_of, rotation_z
from executor.motion.grasping.reach import TURNS_RAD, WIDE_TURNS_RAD
from executor.motion.stances.candidates import HandGoal
from executor.robot.description import JOINT_NAMES
from executor.robot.kinematics import ARM, Kinematics
from executor.scenes.rooms.footprint import Footprint, solid_parts
from oag import Scene

REACHES_M = (0.45, 0.40, 0.50, 0.35, 0.55, 0.30, 0.60)
MARGIN_RAD = math.radians(5.0)
"""The least distance of every joint to its limits."""

_PLENTY_RAD = math.radians(40.0)
_RESTARTS = 16
_BASE_HALF_M = 0.17
_BASE_ROOM_M = 0.01
_BASE_HIGH_M = 0.30
_FLOOR_M = 0.03
_HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True, slots=True)
class Standing:
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


class Stander:
    """Looks for standings; postures are remembered, since they depend on the hand's pose in the base frame alone."""

    def __init__(self, kinematics: Kinematics, floor: Floor) -> None:
        self._kinematics, self._floor = kinematics, floor
        self._known: dict[tuple[float, ...], Array | None] = {}

    def best(self, goals: Iterable[HandGoal]) -> Standing:
        """Returns a standing for the first goals that have a comfortable one, else the best of all.

        Args:
            goals: Admissible hand poses, at least one.
        """
        wanted = list(goals)
        misses: list[Standing] = []
        for turns_rad in (TURNS_RAD, WIDE_TURNS_RAD):
            found: Standing | None = None
            for standing in self._standings(wanted, turns_rad):
                if not standing.reachable:
                    misses.append(standing)
                elif found is None or (standing.margin_rad or 0.0) > (found.margin_rad or 0.0):
                    found = standing
                if found is not None and (found.margin_rad or 0.0) >= _PLENTY_RAD:
                    break
            if found is not None:
                return found
        return max(misses, key=rank)

    def _standings(self, goals: list[HandGoal], turns_rad: tuple[float, ...]) -> Iterator[Standing]:
        for goal, reach_m, turn in itertools.product(goals, REACHES_M, turns_rad):
            yaw = goal.heading_rad + turn
            x, y = goal.T_world_eef[:2, 3] - rotation_z(yaw)[:2, 0] * reach_m
            yield self._at(goal, np.array([x, y, yaw]), reach_m)

    def _at(self, goal: HandGoal, base: Array, reach_m: float) -> Standing:
        T, pitch = goal.T_world_eef, pitch_of(goal.T_world_eef)
        height_m = float(T[2, 3])
        arm = self._posture(T, base)
        if arm is None:
            return Standing(False, None, height_m, reach_m, pitch)
        low, high = arm - self._kinematics.arm_lower, self._kinematics.arm_upper - arm
        nearest = int(np.argmin(np.minimum(low, high)))
        margin, joint = float(np.minimum(low, high)[nearest]), JOINT_NAMES[ARM][nearest]
        if margin < MARGIN_RAD:
            return Standing(False, margin, height_m, reach_m, pitch, joint)
        blocker = self._floor.blocker(base)
        return Standing(blocker is None, margin, height_m, reach_m, pitch, joint, blocker)

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


def rank(standing: Standing) -> tuple[bool, bool, float]:
    """Returns a key by which the best standing is the largest.

    What can be done comes first, then what could be done but for the floor, then the least violation of a limit.
    """
    margin = -math.inf if standing.margin_rad is None else standing.margin_rad
    return standing.reachable, standing.blocker is not None, margin
