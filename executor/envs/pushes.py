"""Pushes in the middle of an episode: a force on the robot's base, or on the item, for as long as it takes.

Something soft pushes, at a low speed, as a person or a cat would: the force follows from how much slower than itself
that is what it pushes, up to a limit. It lets go when the way is done or its time is up, whatever has come of it: an
item in a firm grip does not give way. What the drives or friction make of it afterwards is theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from executor.datasets.units import Pushed
from executor.geometry import Array
from executor.robot.description import BASE_FORCE_N
from executor.world.engine import ROBOT
from executor.world.world import World

DISTANCE_M: dict[Pushed, float] = {"base": 0.05, "item": 0.03}
"""How far each is pushed: as somebody who brushes past would do it."""

SPEED_M_S = {"base": 0.3, "item": 0.1}  # Slow enough that what is pushed stops when it is let go of.
LONGEST_S = {"base": 1.0, "item": 1.5}
BASE_MOST_N = 2.0 * BASE_FORCE_N
"""Twice what the wheels hold along an axis: so the base gives way along a diagonal, too."""

BASE_GIVES_N_S_M = 4000.0  # Within 10 cm/s of the speed it pushes with what the wheels hold.
ITEM_GIVES_PER_S = 200.0
"""Of the item's mass: against friction of its whole weight it still goes at half the speed."""

ITEM_MOST_N = 20.0
LOW = 0.25
"""Where along an item's height it is pushed, from the bottom: higher up, what is slim falls over instead of sliding."""


@dataclass(frozen=True, slots=True)
class DrawnPush:
    """A push that is to come.

    Attributes:
        what: The robot's base, or the item that the task is about.
        at_s: When it begins, in simulated time since the episode began.
        heading_rad: Where it goes, in the room.
    """

    what: Pushed
    at_s: float
    heading_rad: float


@dataclass(frozen=True, slots=True)
class AppliedPush:
    """A push as it was.

    Attributes:
        what, at_s, heading_rad: As for `DrawnPush`.
        lasted_s: For how long it pushed.
        most_n: The largest force.
        moved_m: How far along its way what was pushed had come when it let go.
    """

    what: Pushed
    at_s: float
    heading_rad: float
    lasted_s: float
    most_n: float
    moved_m: float

    def to_json(self) -> dict[str, Any]:
        """Returns it as plain data."""
        return asdict(self)


def drawn_pushes(kinds: Sequence[Pushed], seed: int, between_s: tuple[float, float]) -> tuple[DrawnPush, ...]:
    """Returns one push of each kind, drawn by an episode's seed: the same for whoever acts in it.

    Args:
        kinds: What is pushed.
        seed: The episode's.
        between_s: When a push may begin, at the earliest and at the latest.
    """
    found = []
    for kind in kinds:
        rng = np.random.default_rng((seed, *f"push {kind}".encode()))
        at_s, heading_rad = rng.uniform(*between_s), rng.uniform(-np.pi, np.pi)
        found.append(DrawnPush(kind, round(float(at_s), 3), round(float(heading_rad), 4)))
    return tuple(sorted(found, key=lambda push: push.at_s))


class Pusher:
    """Gives an episode its pushes.

    Args:
        pushes: What is to come.
        item: Id of the item, for pushes of one; None where the task is about no item, which then is not pushed.

    Attributes:
        applied: What was done so far.
    """

    def __init__(self, pushes: Sequence[DrawnPush], item: str | None) -> None:
        self._waiting = [push for push in pushes if push.what == "base" or item is not None]
        self._item = item
        self._began_s: float | None = None
        self._from_m = np.zeros(2)
        self._most_n = 0.0
        self._first_s: float | None = None
        self.applied: list[AppliedPush] = []

    def __call__(self, world: World) -> None:
        """Pushes where it is time; called before every step of the physics."""
        if self._first_s is None:
            self._first_s = world.time_s
        if not self._waiting or world.time_s - self._first_s < self._waiting[0].at_s:
            return
        push = self._waiting[0]
        name = ROBOT if push.what == "base" else str(self._item)
        place_m, speed_m_s = _motion(world, name)
        if self._began_s is None:
            self._began_s, self._from_m, self._most_n = world.time_s, place_m[:2], 0.0
        way = np.array([np.cos(push.heading_rad), np.sin(push.heading_rad)])
        moved_m, lasted_s = float((place_m[:2] - self._from_m) @ way), world.time_s - self._began_s
        if moved_m >= DISTANCE_M[push.what] or lasted_s >= LONGEST_S[push.what]:
            at_s = self._began_s - self._first_s
            numbers = (round(value, 4) for value in (at_s, push.heading_rad, lasted_s, self._most_n, moved_m))
            self.applied.append(AppliedPush(push.what, *numbers))
            self._waiting.pop(0)
            self._began_s = None
            return
        slower_m_s = SPEED_M_S[push.what] - float(speed_m_s[:2] @ way)
        gives, most_n = (
            (BASE_GIVES_N_S_M, BASE_MOST_N)
            if push.what == "base"
            else (ITEM_GIVES_PER_S * world.mass_kg(name), ITEM_MOST_N)
        )
        force_n = float(np.clip(gives * slower_m_s, 0.0, most_n))
        self._most_n = max(self._most_n, force_n)
        if name != ROBOT:
            height_m = world.assets[name].extent_m[2]
            place_m = place_m + [0.0, 0.0, (LOW - 0.5) * height_m]
        world.push(name, np.array([*(force_n * way), 0.0]), place_m)


def _motion(world: World, name: str) -> tuple[Array, Array]:
    """Returns where a thing or the robot's base is (3,), in m, and its velocity (3,), in m/s."""
    if name == ROBOT:
        velocity = np.asarray(world.robot.get_qvel(), dtype=float)
        return world.T_world_link(ROBOT)[:3, 3], np.array([velocity[0], velocity[1], 0.0])
    return world.T_world_link(name)[:3, 3], world.velocity_m_s(name)
