"""Faults for experiments: what the robot believes is not what is there, or it does not get to where it drives.

Faults are plain data and part of an experiment's description; the physics itself is never changed. `docs/evolution.md`
says what each one stands for.

Source: the paper's reasons for initial failures, "imperfect scene reconstruction" and "navigation offsets".
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from executor.geometry import Array, rotation_z
from executor.world import World


@dataclass(frozen=True, slots=True)
class PoseError:
    """An item is believed to stand beside where it stands; once the hand has held it, it is known where it is.

    Attributes:
        object_id: The item.
        dx_m, dy_m: Where it is believed to be, less where it is, in the world.
    """

    object_id: str
    dx_m: float
    dy_m: float

    @classmethod
    def drawn(cls, object_id: str, size_m: float, seed: int) -> PoseError:
        """Returns an error of a size, in a direction that the seed draws."""
        angle_rad = float(np.random.default_rng([seed, 101]).uniform(-np.pi, np.pi))
        return cls(object_id, round(size_m * float(np.cos(angle_rad)), 4), round(size_m * float(np.sin(angle_rad)), 4))


@dataclass(frozen=True, slots=True)
class NavigationOffset:
    """The base ends beside where it drives, by this much for every metre driven, and by no more than that.

    Attributes:
        forward_m, left_m: In the base's own frame.
        yaw_deg: Counter-clockwise.
    """

    forward_m: float
    left_m: float
    yaw_deg: float = 0.0

    def end(self, start: Array, goal: Array) -> Array:
        """Returns (10,) where a drive ends.

        Args:
            start: (10,) where it began.
            goal: (10,) where it was to end.
        """
        share = min(float(np.hypot(*(goal[:2] - start[:2]))), 1.0)
        moved = rotation_z(float(goal[2])) @ np.array([self.forward_m, self.left_m, 0.0])
        ended = goal.copy()
        ended[:2] += share * moved[:2]
        ended[2] += share * np.deg2rad(self.yaw_deg)
        return ended


Fault = PoseError | NavigationOffset


class BelievedWorld:
    """A world as it is believed to be: the same but for the places of some items.

    Args:
        world: The world.
        errors: Which items are believed elsewhere.
    """

    def __init__(self, world: World, errors: Iterable[PoseError]) -> None:
        self._world = world
        self._errors = {error.object_id: np.array([error.dx_m, error.dy_m, 0.0]) for error in errors}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._world, name)

    def T_world_link(self, object_id: str, link: str | None = None) -> Array:
        """Returns where a link is believed to be."""
        T = self._world.T_world_link(object_id, link).copy()
        T[:3, 3] += self._errors.get(object_id, 0.0)
        return T
