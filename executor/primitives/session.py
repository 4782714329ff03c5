"""One subtask while it runs: an immutable value that each primitive takes and returns anew.

What a navigation has planned ahead is the `Plan`, what is between the fingers the `Hand`; a primitive reads what the
ones before it have left there. The world and the planner's picture of it are what moves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from executor.geometry import Array, inverse
from executor.motion.articulation.work import Swing
from executor.motion.grasping.reach import Lift
from executor.motion.planning.carry import Drive
from executor.motion.planning.oracle import NOTHING, Allowed, Carried
from executor.motion.planning.planner import Planner
from executor.motion.planning.stance import Stance
from executor.primitives.control import Controller
from executor.primitives.monitors import Monitor
from executor.records.rollout import Failure
from executor.robot.description import ARM_HOME
from executor.robot.kinematics import ARM
from executor.world.belief import BelievedWorld, believes_otherwise
from executor.world.faults import Fault, NavigationOffset
from executor.world.world import World
from oag import Action, ActionFlow, SimpleTask
from oag.revision.measurements import Measurement, Measurements
from oag.task.sizes import Gripper

PRESSED_M = 0.002
"""A base that ends farther than this from where it was told to be has met something, and presses on it."""


@dataclass(frozen=True, slots=True)
class Hand:
    """What is in the gripper, or was just let go of.

    Attributes:
        held: Id of the item in the gripper, or None.
        gripped: Id of the fixture whose handle is in the gripper, or None.
        lifted_from: Contacts that the held item had where it was taken.
        released: What the fingers may touch while they leave.
    """

    held: str | None = None
    gripped: str | None = None
    lifted_from: Allowed = NOTHING
    released: Allowed = NOTHING


@dataclass(frozen=True, slots=True)
class Plan:
    """What was decided ahead for the primitives that come next.

    Attributes:
        stance: Where to stand and how to take the target, from NAVIGATE_TO_TARGET or APPROACH; None before them. Its
            follow-up is a `Lift` of the target, or a `Swing` of its joint.
        journey: The legs to the stance that are not driven yet.
        numbers: What open numbers of the flow were filled with, by step index.
        arrived_m: Where the base was when NAVIGATE_TO_TARGET ended.
        aside_m: By how much the flow has slid the base since then, for APPROACH to keep.
        unplaced: Why NAVIGATE_TO_SUPPORT found no place and so chose no numbers, or None.
    """

    stance: Stance[Any] | None = None
    journey: Drive | None = None
    numbers: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))
    arrived_m: tuple[float, float] = (0.0, 0.0)
    aside_m: tuple[float, float] = (0.0, 0.0)
    unplaced: Failure | None = None

    @property
    def swing(self) -> Swing | None:
        """The motion of a joint that the stance was chosen for; None where it was not, or where that is done."""
        followup = self.stance.followup if self.stance is not None else None
        return followup if isinstance(followup, Swing) else None

    @property
    def is_push(self) -> bool:
        """Whether the closed gripper is to push a panel, so that there is nothing to grasp."""
        return self.swing is not None and self.swing.motion == "push"

    @property
    def at_rim(self) -> bool:
        """Whether the grasp is around the target's wall, not around all of it."""
        return self.stance is not None and isinstance(self.stance.followup, Lift) and self.stance.followup.at_rim

    def without_swing(self) -> Plan:
        """Returns the plan once its joint has moved: another articulation has numbers of its own."""
        if self.stance is None or self.swing is None:
            return self
        return replace(self, stance=replace(self.stance, followup=None))

    def with_numbers(self, steps: Iterable[int], filled: Iterable[Action]) -> Plan:
        """Returns the plan with the numbers of filled actions, for the primitives that will run these steps."""
        amounts = zip(steps, (action.parameter for action in filled), strict=True)
        numbers = {step: float(amount) for step, amount in amounts if isinstance(amount, float | int)}
        return replace(self, numbers=MappingProxyType({**self.numbers, **numbers}))


@dataclass(frozen=True, slots=True)
class Session:
    """How a subtask's execution stands.

    Attributes:
        world: The physical world.
        control: Moves the robot.
        planner: Plans; its oracle mirrors the world.
        subtask: What is to be done.
        flow: The subtask's action flow as given.
        later: The subtasks that come after: what an opening is for.
        faults: What is wrong on purpose, in experiments.
        step: Index of the running step.
        hand: What is in the gripper.
        plan: What was decided ahead.
        handled: Ids of the things that the hand has held: where they are is known.
        stances: How many are planned wherever a stance or a placement is chosen, each by a seed of its own from 0 on,
            of which the one with the arm nearest to home is taken; 1 takes the one that the episode's seed gives.
    """

    world: World
    control: Controller
    planner: Planner
    subtask: SimpleTask
    flow: ActionFlow
    later: tuple[SimpleTask, ...] = ()
    faults: tuple[Fault, ...] = ()
    step: int = 0
    hand: Hand = Hand()
    plan: Plan = field(default_factory=Plan)
    handled: frozenset[str] = frozenset()
    stances: int = 1

    @property
    def q(self) -> Array:
        """Where the robot was told to be, (10,): paths start here, so that nothing jumps."""
        return self.control.target.copy()

    @property
    def gripper(self) -> Gripper:
        """What the hand takes."""
        return Gripper.of(self.world.scene.robot)

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
        held = self.hand.held
        if held is not None:
            T_eef_object = inverse(self.planner.kinematics.forward(qpos)) @ self.world.T_world_link(held)
            self.planner.oracle.carried = Carried(held, T_eef_object)

    def monitor(self, allowed: Allowed = NOTHING, *, gripped: str | None = None) -> Monitor:
        """Returns a monitor for a motion that starts now."""
        return Monitor(
            self.world, self.planner.kinematics, carried=self.planner.oracle.carried, gripped=gripped, allowed=allowed
        )

    def done(self, action: Action, *measurements: Measurement, failure: Failure | None = None) -> StepResult:
        """Returns the outcome of a primitive that leaves things like this."""
        return StepResult(self, action, measurements, failure)


@dataclass(frozen=True, slots=True)
class StepResult:
    """What a primitive did.

    Attributes:
        session: How things stand after it.
        action: The action with its number filled in.
        measurements: Evidence.
        failure: Why it ended early, or None.
    """

    session: Session
    action: Action
    measurements: Measurements = ()
    failure: Failure | None = None
