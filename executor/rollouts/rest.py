"""Waits until what was let go of has come to rest: a glass that lies on its side may roll for seconds.

What is judged, and what the next subtask begins with, is a world at rest: what moves then is moved by the robot.
"""

from __future__ import annotations

import numpy as np

from executor.geometry import Array
from executor.primitives.control import Controller
from executor.world.world import World

STILL_M = 0.001
LONGEST_WAIT_S = 5.0
_LOOK_EVERY_S = 0.1


def settle_to_rest(control: Controller, duration_s: float) -> float:
    """Holds the robot still for some simulated time, and on until no item moves; returns the seconds of waiting.

    An item rests when it moved by less than `STILL_M` in the last tenth of a second: velocities do not tell, since
    contacts make resting things tremble. After `LONGEST_WAIT_S` of waiting things are left as they are.

    Args:
        control: The robot's controller.
        duration_s: How long in any case, at least a tenth of a second.
    """
    world = control.world
    control.settle(duration_s - _LOOK_EVERY_S)
    waited_s = -_LOOK_EVERY_S
    moved_m = np.inf
    while moved_m > STILL_M and waited_s < LONGEST_WAIT_S:
        before = _positions(world)
        control.settle(_LOOK_EVERY_S)
        waited_s += _LOOK_EVERY_S
        moved_m = max(
            (float(np.linalg.norm(after - p)) for p, after in zip(before, _positions(world), strict=True)), default=0.0
        )
    return waited_s


def _positions(world: World) -> list[Array]:
    return [world.T_world_link(name)[:3, 3] for name in world.dynamic_ids]
