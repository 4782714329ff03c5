"""Faults for experiments: wrong beliefs of the robot, and drives that do not do what they should.

Faults are plain data and part of an experiment's description; no contact, friction or mass is ever changed.
`docs/models.md` explains each fault and what can correct it. `belief` applies them to planning.

Source: the paper's reasons for initial failures, "imperfect scene reconstruction, object-size mismatch, navigation
offsets".
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from bddl.errors import Scene2DemoError
from executor.geometry import Array, rotation_z


class FaultUnfit(Scene2DemoError, ValueError):
    """A fault does not apply to a scene, such as a blocked door where there is none."""


@dataclass(frozen=True, slots=True)
class PoseError:
    """An item is believed to stand elsewhere; once the hand has held it, its place is known.

    Attributes:
        dx_m, dy_m: Believed place less true place, in the world.
    """

    object_id: str
    dx_m: float
    dy_m: float

    @classmethod
    def drawn(cls, object_id: str, size_m: float, seed: int) -> PoseError:
        """Return an error of a size, in a direction that the seed samples."""
        angle_rad = float(np.random.default_rng([seed, 101]).uniform(-np.pi, np.pi))
        return cls(object_id, round(size_m * float(np.cos(angle_rad)), 4), round(size_m * float(np.sin(angle_rad)), 4))


@dataclass(frozen=True, slots=True)
class NavigationOffset:
    """The base misses the end of its drive by this much for every metre driven, and by no more than that.

    Attributes:
        forward_m, left_m: In the base's own frame.
        yaw_deg: Counter-clockwise.
    """

    forward_m: float
    left_m: float
    yaw_deg: float = 0.0

    @classmethod
    def drawn(cls, size_m: float, seed: int) -> NavigationOffset:
        """Return an offset of a size, in a direction that the seed samples."""
        angle_rad = float(np.random.default_rng([seed, 102]).uniform(-np.pi, np.pi))
        return cls(round(size_m * float(np.cos(angle_rad)), 4), round(size_m * float(np.sin(angle_rad)), 4))

    def end(self, start: Array, goal: Array) -> Array:
        """Return (Q,) where a drive ends.

        Args:
            start: (Q,) where it began.
            goal: (Q,) where it was to end.
        """
        share = min(float(np.hypot(*(goal[:2] - start[:2]))), 1.0)
        moved = rotation_z(float(goal[2])) @ np.array([self.forward_m, self.left_m, 0.0])
        ended = goal.copy()
        ended[:2] += share * moved[:2]
        ended[2] += share * np.deg2rad(self.yaw_deg)
        return ended


@dataclass(frozen=True, slots=True)
class WrongScale:
    """An item is believed to be larger or smaller than it is, about the middle of its bottom.

    Attributes:
        factor: Believed size by true size.
    """

    object_id: str
    factor: float

    def __post_init__(self) -> None:
        if not self.factor > 0.0:
            raise ValueError(f"a size is multiplied by more than 0, got {self.factor}")


@dataclass(frozen=True, slots=True)
class BlockedDoor:
    """An unknown obstacle stands where a hinged door swings, near its hinge.

    Attributes:
        fraction: Where in its range the door meets it.
    """

    object_id: str
    fraction: float

    def __post_init__(self) -> None:
        if not 0.0 < self.fraction <= 1.0:
            raise ValueError(f"a door is blocked between 0 and 1 of its range, got {self.fraction}")


@dataclass(frozen=True, slots=True)
class WeakGrip:
    """The fingers press with less force than they should.

    Attributes:
        force_n: The force limit of each finger's drive; a sound gripper has 30 N.
    """

    force_n: float

    def __post_init__(self) -> None:
        if not self.force_n > 0.0:
            raise ValueError(f"a grip has more than 0 N, got {self.force_n}")


Fault = PoseError | NavigationOffset | WrongScale | BlockedDoor | WeakGrip

KINDS: dict[str, type[Fault]] = {
    "pose": PoseError,
    "navigation": NavigationOffset,
    "scale": WrongScale,
    "door": BlockedDoor,
    "grip": WeakGrip,
}
"""Every fault by its name on the command line and in records."""


def fault_json(fault: Fault) -> dict[str, object]:
    """Return a fault as JSON values: its kind, and its fields."""
    kind = next(word for word, known in KINDS.items() if isinstance(fault, known))
    return {"kind": kind, **asdict(fault)}
