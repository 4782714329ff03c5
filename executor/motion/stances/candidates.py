"""Candidates for standing somewhere with the hand at a pose, and the order in which they are offered."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from executor.geometry import Array, inverse, rotation_z, wrap_angle
from executor.motion.planning.oracle import BASE, GRIPPER, HELD, Hit
from executor.motion.planning.planner import Planner
from executor.robot.description import ARM_HOME
from executor.robot.kinematics import ArmSolution

REACHES_M = (0.45, 0.40, 0.50, 0.35, 0.55)
CLOSE_REACHES_M = (0.30, 0.25)
"""With the elbow high: from between a chair and the table, where there is no room farther off."""

ENOUGH_MARGIN_RAD = np.deg2rad(40.0)
ENOUGH_CLEARANCE_M = 0.008
ROOMY_M = 0.02
TIGHTNESS_COST = 0.3
DRIVE_COST_RAD_PER_M = 0.15
TURN_COST = 0.05
SHOULDER = frozenset(("panda_link1", "panda_link2"))
LEANING_FORWARD = np.array([*ARM_HOME[:1], 0.5, *ARM_HOME[2:]])
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


class Scored(Protocol):
    """Something with a joint margin in rad, a clearance and a score; larger is better for all."""

    @property
    def margin_rad(self) -> float:
        """Smallest distance to a joint limit."""

    @property
    def clearance_m(self) -> float:
        """How far the robot is from what it does not mean to touch."""

    @property
    def score(self) -> float:
        """Joint margin less costs."""


Choice = TypeVar("Choice", bound=Scored)


@dataclass(frozen=True, slots=True)
class HandGoal:
    """A wanted hand pose.

    Attributes:
        T_world_eef: (4, 4) the pose.
        heading_rad: The heading from which the robot faces it.
        cost: In rad of joint margin.
        region: Name of the region that a held thing would be put into, for placements.
    """

    T_world_eef: Array
    heading_rad: float
    cost: float = 0.0
    region: str = ""


@dataclass(frozen=True, slots=True)
class Placement:
    """A candidate base pose for a hand goal, with its cost."""

    goal: HandGoal
    base: Array
    cost: float


def placements(
    goals: list[HandGoal], here: Array, turns_rad: tuple[float, ...], reaches_m: tuple[float, ...] = REACHES_M
) -> list[Placement]:
    """Returns base poses for all goals, the cheapest (near, straight ahead, comfortable reach) first.

    Args:
        goals: Wanted hand poses.
        here: (3,) where the base stands now.
        turns_rad: How far the base may face away from the goal's heading.
        reaches_m: How far before the hand the base may be, the preferred distance first.
    """
    found = []
    for goal, (rank, reach_m), turn_rad in itertools.product(goals, enumerate(reaches_m), turns_rad):
        yaw = goal.heading_rad + turn_rad
        xy = goal.T_world_eef[:2, 3] - rotation_z(yaw)[:2, 0] * reach_m
        drive = float(np.hypot(*(xy - here[:2]))) + 0.2 * abs(wrap_angle(yaw - float(here[2])))
        cost = DRIVE_COST_RAD_PER_M * drive + TURN_COST * abs(turn_rad) + goal.cost + 0.02 * rank
        found.append(Placement(goal, np.array([xy[0], xy[1], yaw]), cost))
    return sorted(found, key=lambda p: p.cost)


class Blocked:
    """Hand goals that cannot be, wherever the base stands: there the hand, or what it holds, touches something."""

    def __init__(self) -> None:
        self._goals: set[int] = set()

    def __contains__(self, goal: HandGoal) -> bool:
        return id(goal) in self._goals

    def learn(self, goal: HandGoal, hits: list[Hit]) -> None:
        """Takes note of a goal where one of the hits is the gripper's or the held object's."""
        if any(hit.mover in GRIPPER or hit.mover == HELD for hit in hits):
            self._goals.add(id(goal))


def is_base_free(planner: Planner, base: Array, margin_m: float) -> bool:
    """Decides whether base and shoulder have room at a pose (3,), whatever the rest of the arm does.

    Under a low table there is room for the base alone: what the shoulder meets leaning back, and meets leaning forward
    as well, it meets in all postures.
    """
    near = planner.oracle.hits(np.concatenate([base, ARM_HOME]), margin_m=margin_m)
    movers = {hit.mover for hit in near}
    if BASE in movers:
        return False
    if not movers & SHOULDER:
        return True
    forward = planner.oracle.hits(np.concatenate([base, LEANING_FORWARD]), margin_m=margin_m)
    return not {hit.mover for hit in forward} & SHOULDER


class FreeFloor:
    """Whether the base has room, with a memory: many hand goals lead to the same base pose."""

    def __init__(self, planner: Planner, margin_m: float) -> None:
        self._planner, self._margin_m = planner, margin_m
        self._known: dict[tuple[float, ...], bool] = {}

    def at(self, base: Array) -> bool:
        """Decides whether the base has room at a pose (3,)."""
        key = tuple(np.round(base, 5))
        if key not in self._known:
            self._known[key] = is_base_free(self._planner, base, self._margin_m)
        return self._known[key]


class ArmSolver:
    """Inverse kinematics with a memory: postures depend on the hand's pose in the base frame alone."""

    def __init__(self, planner: Planner, restarts: int = 24) -> None:
        self._planner = planner
        self._restarts = restarts
        self._known: dict[tuple[float, ...], list[ArmSolution]] = {}

    def solve(self, T_world_eef: Array, base: Array, *, either_side: bool) -> list[ArmSolution]:
        """Returns arm postures for a hand pose, best margin first; `either_side` admits the half-turned hand too."""
        kinematics = self._planner.kinematics
        T_base_eef = inverse(kinematics.base_transform(base)) @ T_world_eef
        found: list[ArmSolution] = []
        for T in (T_base_eef, T_base_eef @ HALF_TURN) if either_side else (T_base_eef,):
            key = tuple(np.round(T[:3], 4).ravel())
            if key not in self._known:
                self._known[key] = kinematics.solve(T, np.zeros(3), restarts=self._restarts)
            found += self._known[key]
        return sorted(found, key=lambda s: -s.margin_rad)


def is_comfortable(choice: Scored) -> bool:
    """Decides whether a choice is good enough not to look for a better one."""
    return choice.margin_rad >= ENOUGH_MARGIN_RAD and choice.clearance_m >= ENOUGH_CLEARANCE_M


def tightness_cost(clearance_m: float) -> float:
    """Returns what a clearance costs, in rad of joint margin; nothing from `ROOMY_M` on."""
    return TIGHTNESS_COST * max(0.0, 1.0 - clearance_m / ROOMY_M)


def best_first(examined: Iterable[Choice | None], batch: int) -> Iterator[Choice]:
    """Yields choices, good ones first, while candidates are still being examined.

    The best one so far is yielded as soon as its margin and clearance are comfortable, or when a batch of candidates
    has been looked at since the last one. Asking for the next one means that the last one could not be used.

    Args:
        examined: For every candidate what came of it: a choice, or None.
        batch: How many candidates to look at before settling for less.
    """
    waiting: list[tuple[float, int, Choice]] = []
    order = itertools.count()
    looked_at = 0
    for choice in examined:
        looked_at += 1
        if choice is not None:
            heapq.heappush(waiting, (-choice.score, next(order), choice))
        comfortable = bool(waiting) and is_comfortable(waiting[0][2])
        if waiting and (comfortable or looked_at >= batch):
            yield heapq.heappop(waiting)[2]
            looked_at = 0
    while waiting:
        yield heapq.heappop(waiting)[2]
