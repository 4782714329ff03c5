"""Pushes in the middle of an episode: a force on the robot's base, or on the item, up to a distance or a duration.

The push is soft and slow, as by a person or a cat. The force follows from the difference between the pushing speed and
the speed of what is pushed, up to a limit. It ends when the distance or the time is used up: an item in a firm grip
does not give way. Drives and friction determine what follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from executor.data.units import Pushed
from executor.geometry import Array
from executor.sim.engine import ROBOT
from executor.sim.robot.description import BASE_FORCE_N
from executor.sim.world import World

DISTANCE_M: dict[Pushed, float] = {"base": 0.05, "item": 0.03}
"""Distance of a push, as by a person who brushes past."""

SPEED_M_S = {"base": 0.3, "item": 0.1}  # Slow enough to stop at the end of the push.
LONGEST_S = {"base": 1.0, "item": 1.5}
BASE_MOST_N = 2.0 * BASE_FORCE_N
"""Twice the wheels' holding force along an axis: so the base gives way along a diagonal, too."""

BASE_GIVES_N_S_M = 4000.0  # 10 cm/s below the pushing speed it reaches the wheels' holding force.
ITEM_GIVES_PER_S = 200.0
"""Per item mass: against friction of its whole weight it still moves at half the speed."""

ITEM_MOST_N = 20.0
LOW = 0.25
"""Height of a push as a share of an item's height: higher up, slim items fall over instead of sliding."""


@dataclass(frozen=True, slots=True)
class DrawnPush:
    """A future push.

    Attributes:
        what: The robot's base, or the task's item.
        at_s: Its begin, in simulated time since the episode's start [s].
        heading_rad: Its direction in the room [rad].
    """

    what: Pushed
    at_s: float
    heading_rad: float


@dataclass(frozen=True, slots=True)
class AppliedPush:
    """A completed push.

    Attributes:
        what, at_s, heading_rad: As for `DrawnPush`.
        lasted_s: Its duration [s].
        most_n: The largest force [N].
        moved_m: Displacement along its direction at its end [m].
    """

    what: Pushed
    at_s: float
    heading_rad: float
    lasted_s: float
    most_n: float
    moved_m: float

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


def draw_pushes(kinds: Sequence[Pushed], seed: int, between_s: tuple[float, float]) -> tuple[DrawnPush, ...]:
    """Draw one push of each kind by an episode's seed: the same for every policy.

    Args:
        kinds: What is pushed.
        seed: The episode's.
        between_s: Earliest and latest begin of a push [s].
    """
    found = []
    for kind in kinds:
        rng = np.random.default_rng((seed, *f"push {kind}".encode()))
        at_s, heading_rad = rng.uniform(*between_s), rng.uniform(-np.pi, np.pi)
        found.append(DrawnPush(kind, round(float(at_s), 3), round(float(heading_rad), 4)))
    return tuple(sorted(found, key=lambda push: push.at_s))


class Pusher:
    """Applies an episode's pushes.

    Args:
        pushes: The pushes to come.
        item: Id of the item, for pushes of one; None for a task without an item, which is then not pushed.

    Attributes:
        applied: Completed pushes.
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
        """Push when it is time; called before every physics step."""
        if self._first_s is None:
            self._first_s = world.time_s
        if not self._waiting or world.time_s - self._first_s < self._waiting[0].at_s:
            return
        push = self._waiting[0]
        name = ROBOT if push.what == "base" else str(self._item)
        place_m, speed_m_s = _motion(world, name)
        if self._began_s is None:
            self._began_s, self._from_m, self._most_n = world.time_s, place_m[:2], 0.0
        direction = np.array([np.cos(push.heading_rad), np.sin(push.heading_rad)])
        moved_m, lasted_s = float((place_m[:2] - self._from_m) @ direction), world.time_s - self._began_s
        if moved_m >= DISTANCE_M[push.what] or lasted_s >= LONGEST_S[push.what]:
            at_s = self._began_s - self._first_s
            numbers = (round(value, 4) for value in (at_s, push.heading_rad, lasted_s, self._most_n, moved_m))
            self.applied.append(AppliedPush(push.what, *numbers))
            self._waiting.pop(0)
            self._began_s = None
            return
        slower_m_s = SPEED_M_S[push.what] - float(speed_m_s[:2] @ direction)
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
        world.push(name, np.array([*(force_n * direction), 0.0]), place_m)


def _motion(world: World, name: str) -> tuple[Array, Array]:
    """Return where a thing or the robot's base is (3,), in m, and its velocity (3,), in m/s."""
    if name == ROBOT:
        velocity = np.asarray(world.robot.get_qvel(), dtype=float)
        return world.T_world_link(ROBOT)[:3, 3], np.array([velocity[0], velocity[1], 0.0])
    return world.T_world_link(name)[:3, 3], world.velocity_m_s(name)
