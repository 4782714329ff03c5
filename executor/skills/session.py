"""The session of a running subtask: an immutable value that each primitive takes and returns updated.

`Plan` is what navigation has planned ahead, `Hand` what is between the fingers; a primitive reads what earlier ones
have left there. Only the world and the planner's copy of it are mutable.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from executor.geometry import Array
from executor.planning.articulation import Swing
from executor.planning.cargo import carried_by
from executor.planning.choices import Choice
from executor.planning.collision import NOTHING, Allowed
from executor.planning.drives import Drive
from executor.planning.picks import Lift
from executor.planning.planner import Planner
from executor.planning.stances import Stance
from executor.records import Failure
from executor.sim.belief import BelievedWorld, has_belief_fault
from executor.sim.faults import Fault, NavigationOffset
from executor.sim.world import World
from executor.skills.control import Controller, Monitor
from oag import Action, SimpleTask
from oag.measurements import Measurement, Measurements
from oag.model.actions import ActionFlow
from oag.sizes import Gripper

PRESSED_M = 0.002
"""A base that ends farther than this from its target has met something, and presses on it."""


@dataclass(frozen=True, slots=True)
class Hand:
    """What is in the gripper, or was just let go of.

    Attributes:
        held: Id of the item in the gripper, or None.
        gripped: Id of the fixture whose handle is in the gripper, or None.
        lifted_from: Contacts that the held item had where it was taken.
        released: What the fingers may touch while they leave.
        cargo: Ids of the held item's cargo, as it was taken.
        upward: Direction in the hand's frame that pointed up then; None without cargo.
    """

    held: str | None = None
    gripped: str | None = None
    lifted_from: Allowed = NOTHING
    released: Allowed = NOTHING
    cargo: tuple[str, ...] = ()
    upward: tuple[float, ...] | None = None

    @property
    def empty(self) -> Hand:
        """The hand once it has let go."""
        return replace(self, held=None, gripped=None, cargo=(), upward=None)


@dataclass(frozen=True, slots=True)
class Plan:
    """Decisions made ahead for the primitives that come next.

    Attributes:
        stance: Where to stand and how to take the target, from NAVIGATE_TO_TARGET or APPROACH; None before them. Its
            follow-up is a `Lift` of the target, or a `Swing` of its joint.
        journey: The legs to the stance that are not driven yet.
        numbers: The flow's open numbers with their fillings, by step index.
        arrived_m: Where the base was when NAVIGATE_TO_TARGET ended.
        aside_m: How far the flow has slid the base since then, for APPROACH to keep.
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
        """Whether the grasp is at the target's wall, not around all of it."""
        return self.stance is not None and isinstance(self.stance.followup, Lift) and self.stance.followup.at_rim

    def without_swing(self) -> Plan:
        """Return the plan once its joint has moved: another articulation has numbers of its own."""
        if self.stance is None or self.swing is None:
            return self
        return replace(self, stance=replace(self.stance, followup=None))

    def with_numbers(self, steps: Iterable[int], filled: Iterable[Action]) -> Plan:
        """Return the plan with the numbers of filled actions, for the primitives that will run these steps."""
        amounts = zip(steps, (action.parameter for action in filled), strict=True)
        numbers = {step: float(amount) for step, amount in amounts if isinstance(amount, float | int)}
        return replace(self, numbers=MappingProxyType({**self.numbers, **numbers}))


@dataclass(frozen=True, slots=True)
class Session:
    """State of a subtask's execution.

    Attributes:
        world: The physical world.
        control: Moves the robot.
        planner: Plans; its oracle mirrors the world.
        subtask: What is to be done.
        flow: The subtask's action flow as given.
        later: The subtasks that come after: the purpose of an opening.
        faults: Deliberate faults of an experiment.
        step: Index of the running step.
        hand: What is in the gripper.
        plan: Decisions made ahead.
        handled: Ids of the things that the hand has held: where they are is known.
        stances: Number of plans for each stance or placement, each by a seed of its own from 0 on. The one with the arm
            nearest to home is taken; 1 takes the one that the episode's seed gives.
        avoided: Objects' ids, each with a joint that is opened only where the object has no other.
        kept: What a dry run chose for the subtask's steps.
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
    avoided: frozenset[tuple[str, str]] = frozenset()
    kept: tuple[Choice, ...] = ()

    def kept_for_step(self) -> tuple[Choice, ...]:
        """Return what a dry run chose for the running step."""
        return tuple(choice for choice in self.kept if choice.step == self.step)

    @property
    def q(self) -> Array:
        """Commanded position of the robot, (Q,): paths start here, so that nothing jumps."""
        return self.control.target.copy()

    @property
    def gripper(self) -> Gripper:
        """The sizes that the hand can hold."""
        return Gripper.of(self.world.scene.robot)

    @property
    def is_home(self) -> bool:
        """Whether the arm is in its home posture."""
        robot = self.planner.robot
        return bool(np.abs(self.q[robot.arm] - np.array(robot.home)).max() < 1e-3)

    @property
    def believed(self) -> World:
        """The world as planning believes it to be; the same as `world` but for faults of belief."""
        if not has_belief_fault(self.faults):
            return self.world
        # It has the interface of a world, and differs in its answers.
        return cast(World, BelievedWorld(self.world, self.faults, self.handled))

    def drift(self, start: Array) -> float | None:
        """Apply the fault of navigation to the base; return by how many metres it moved, or None without a fault.

        Args:
            start: (Q,) where the drive began.
        """
        drift_m = None
        for fault in self.faults:
            if isinstance(fault, NavigationOffset):
                goal = self.q
                ended = fault.end(start, goal)
                self.control.follow(np.stack([goal, ended]))
                if np.hypot(*(self.control.q[:2] - ended[:2])) > PRESSED_M:
                    self.control.rest()
                drift_m = round(float(np.hypot(*(self.q[:2] - goal[:2]))), 4)
        return drift_m

    def sync_planner(self) -> None:
        """Synchronise the planner with the world, the place of the held object and its cargo in the hand included."""
        self.planner.oracle.synchronize(self.believed)
        qpos = np.asarray(self.world.robot.get_qpos(), dtype=float)
        self.planner.oracle.opening_m = self.fingers_m
        self.planner.oracle.carried = None
        held = self.hand.held
        if held is not None:
            T_world_eef = self.planner.kinematics.forward(qpos)
            upward = None if self.hand.upward is None else np.array(self.hand.upward)
            self.planner.oracle.carried = carried_by(self.believed, held, T_world_eef, self.hand.cargo, upward)

    @property
    def fingers_m(self) -> float:
        """How far each finger is open [m], on average."""
        return float(np.asarray(self.world.robot.get_qpos(), dtype=float)[self.planner.robot.fingers].mean())

    def monitor(self, allowed: Allowed = NOTHING, *, gripped: str | None = None, bar_m: float | None = None) -> Monitor:
        """Return a monitor for a motion that starts now."""
        carried = self.planner.oracle.carried
        return Monitor(self.world, self.planner.kinematics, carried, gripped, bar_m, allowed)

    def done(self, action: Action, *measurements: Measurement, failure: Failure | None = None) -> StepResult:
        """Return the outcome of a primitive with this session."""
        return StepResult(self, action, measurements, failure)


@dataclass(frozen=True, slots=True)
class StepResult:
    """Outcome of a primitive.

    Attributes:
        session: The session after it.
        action: The action with its number filled in.
        measurements: Evidence.
        failure: Why it ended early, or None.
    """

    session: Session
    action: Action
    measurements: Measurements = ()
    failure: Failure | None = None
