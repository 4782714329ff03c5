"""What the executor's monitors say of a policy: they end a planned motion, and here they only take note."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from executor.geometry import inverse
from executor.motion.articulation.work import handle_contacts
from executor.motion.planning.oracle import NOTHING, Allowed, Carried, fingers_may_touch, held_may_touch
from executor.primitives.monitors import Bystanders, Monitor, stall
from executor.records.rollout import Failure
from executor.robot.kinematics import Kinematics
from executor.world.detectors import fingers_touching, touching_bodies
from executor.world.engine import ROBOT
from executor.world.world import World
from oag import Task

STALLED_LOOKS = 5
"""In a row, half a second at ten a second: a robot that is told to move fast lags behind for less."""


class MonitorWatch:
    """Follows one episode.

    Args:
        world: Where things are.
        task: What is to be done: what its subtasks are about may be touched.

    Attributes:
        seen: Kind of a failure, as `executor.records.rollout.FailureKind` names them -> when it was first seen, in
            simulated time since the world was built [s].
    """

    def __init__(self, world: World, task: Task) -> None:
        self._world = world
        self._targets = tuple(dict.fromkeys(part.target for part in task.subtasks))
        kinematics = Kinematics(world.robot)
        self._monitor = Monitor(world, kinematics, allowed=_meant(world, self._targets))
        # A task of several subtasks moves several things on purpose.
        self._bystanders = Bystanders(world, self._targets[0]) if len(self._targets) == 1 else None
        self._kinematics = kinematics
        self._behind = 0
        self.seen: dict[str, float] = {}

    def look(self, target: np.ndarray) -> None:
        """Looks at the world once an action.

        Args:
            target: (12,) where the drives are to hold the robot by now.
        """
        world, q = self._world, np.asarray(self._world.robot.get_qpos(), dtype=float)
        self._note(self._monitor.check())
        self._note(self._bystanders.check() if self._bystanders is not None else None)
        behind = stall(q, target[:10])
        self._behind = 0 if behind is None else self._behind + 1
        if self._behind >= STALLED_LOOKS:
            self._note(behind)
        item = self._targets[-1]
        if self._monitor.carried is None and item in world.dynamic_ids and fingers_touching(world, item) == 2:
            T_eef_item = inverse(self._kinematics.forward(q)) @ world.T_world_link(item)
            supports = [body for body in touching_bodies(world, item) if body != ROBOT]
            allowed = self._monitor.allowed | held_may_touch(supports)
            self._monitor = replace(self._monitor, carried=Carried(item, T_eef_item), allowed=allowed)

    def _note(self, failure: Failure | None) -> None:
        if failure is not None:
            self.seen.setdefault(failure.kind.value, round(self._world.time_s, 2))


def _meant(world: World, targets: tuple[str, ...]) -> Allowed:
    """Returns the contacts that dealing with some things means."""
    allowed = NOTHING
    for name in targets:
        allowed |= fingers_may_touch(name, hand=True) if name in world.dynamic_ids else NOTHING
        for handle in world.assets[name].handles:
            allowed |= handle_contacts(name, handle)
    return allowed
