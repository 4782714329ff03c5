"""What the primitives of one subtask share: the world, the plan so far, and what the gripper holds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from executor.geometry import Array, inverse
from executor.motion.planning.carry import Drive
from executor.motion.planning.contacts import NOTHING, Allowed
from executor.motion.planning.oracle import Carried
from executor.motion.planning.planner import Planner
from executor.motion.stances.stance import Stance
from executor.records.rollout import Failure
from executor.robot.description import ARM_HOME
from executor.robot.kinematics import ARM
from executor.session.control import Controller
from executor.session.monitors import Monitor
from executor.world.belief import BelievedWorld, believes_otherwise
from executor.world.faults import Fault, NavigationOffset
from executor.world.world import World
from oag import Action, ActionFlow, SimpleTask
from oag.revision.measurements import Measurements

PRESSED_M = 0.002
"""A base that ends farther than this from where it was told to be has met something, and presses on it."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a primitive did.

    Attributes:
        action: The action with its number filled in.
        measurements: Evidence.
        failure: Why it ended early, or None.
    """

    action: Action
    measurements: Measurements = ()
    failure: Failure | None = None


@dataclass
class Session:
    """The state of a subtask's execution.

    Attributes:
        world: The physical world.
        control: Moves the robot.
        planner: Plans; its oracle mirrors the world.
        subtask: What is to be done.
        flow: The subtask's action flow as given.
        step: Index of the running step.
        held: Id of the item in the gripper, or None.
        stance: The stance in use, from NAVIGATE_TO_TARGET or APPROACH.
        pending: The legs of the journey to the stance that are not driven yet.
        filled: Numbers that planning ahead has chosen, by step index.
        gripped: Id of the fixture whose handle is in the gripper, or None.
        lifted_from: Contacts of the held object that were there when it was taken.
        released: What the fingers may touch while they leave.
        arrived_m: Where the base was when NAVIGATE_TO_TARGET ended.
        aside_m: By how much the flow has slid the base since then, for APPROACH to keep.
        handled: Ids of the things that the hand has held: where they are is known.
        faults: What is wrong on purpose, in experiments.
        later: The subtasks that come after: what an opening is for.
        unplaced: Why NAVIGATE_TO_SUPPORT found no place and so chose no numbers, or None.
    """

    world: World
    control: Controller
    planner: Planner
    subtask: SimpleTask
    flow: ActionFlow
    step: int = 0
    held: str | None = None
    stance: Stance[Any] | None = None
    pending: Drive | None = None
    filled: dict[int, float] = field(default_factory=dict)
    gripped: str | None = None
    lifted_from: Allowed = NOTHING
    released: Allowed = NOTHING
    arrived_m: tuple[float, float] = (0.0, 0.0)
    aside_m: tuple[float, float] = (0.0, 0.0)
    handled: frozenset[str] = frozenset()
    faults: tuple[Fault, ...] = ()
    later: tuple[SimpleTask, ...] = ()
    unplaced: Failure | None = None

    @property
    def q(self) -> Array:
        """Where the robot was told to be, (10,): paths start here, so that nothing jumps."""
        return self.control.target.copy()

    @property
    def is_home(self) -> bool:
        """Whether the arm is in its home posture."""
        return bool(np.abs(self.q[ARM] - np.array(ARM_HOME)).max() < 1e-3)

    @property
    def believed(self) -> World:
        """The world as planning sees it; the same as `world` but for faults of belief."""
        if not believes_otherwise(self.faults):
            return self.world
        # It has everything that a world has, and differs in what it answers.
        return cast(World, BelievedWorld(self.world, self.faults, self.handled))

    def drift(self, start: Array) -> float | None:
        """Moves the base from where it drove to where it ends, and returns by how many metres; None without a fault.

        Args:
            start: (10,) where the drive began.
        """
        beside_m = None
        for fault in self.faults:
            if isinstance(fault, NavigationOffset):
                goal = self.q
                ended = fault.end(start, goal)
                self.control.follow(np.stack([goal, ended]))
                if np.hypot(*(self.control.q[:2] - ended[:2])) > PRESSED_M:
                    self.control.rest()
                beside_m = round(float(np.hypot(*(self.q[:2] - goal[:2]))), 4)
        return beside_m

    def look(self) -> None:
        """Brings the planner's picture of the world up to date, the held object's place in the hand included."""
        self.planner.oracle.synchronize(self.believed)
        qpos = np.asarray(self.world.robot.get_qpos(), dtype=float)
        self.planner.oracle.opening_m = float(qpos[10:12].mean())
        self.planner.oracle.carried = None
        if self.held is not None:
            T_eef_object = inverse(self.planner.kinematics.forward(qpos)) @ self.world.T_world_link(self.held)
            self.planner.oracle.carried = Carried(self.held, T_eef_object)

    def monitor(self, allowed: Allowed = NOTHING, *, gripped: str | None = None) -> Monitor:
        """Returns a monitor for a motion that starts now."""
        return Monitor(
            self.world, self.planner.kinematics, carried=self.planner.oracle.carried, gripped=gripped, allowed=allowed
        )
