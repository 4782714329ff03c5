"""PRESS and TURN: switch an appliance on or off by its button or its knob, as the domain of appliances has it.

A button is pressed by the closed fingers, straight along its axis, until it gives way no farther; its latch does the
rest. A knob is taken by its bar, and the whole hand turns about the knob's axis. Both are planned as one motion from
the stance on, so that nothing is in the way of the hand before it, during it and after it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from bddl import Atom
from executor.assets.model import Control, Vector
from executor.geometry import Array, heading_of, transform
from executor.planning.collision import Allowed, fingers_may_touch
from executor.planning.stances import HandGoal, Stance, search_stances
from executor.records import Failure, FailureKind
from executor.sim.detectors import read
from executor.skills.control import Monitor
from executor.skills.navigate import adopt_first, follow_legs
from executor.skills.session import Session, StepResult
from executor.system.effort import NAMED
from oag import Action
from oag.measurements import JointMotion, Unplanned
from oag.model.domain import own_of

TILTS_DEG = (0.0, 25.0, -25.0, 45.0, -45.0, 60.0, -60.0)
"""How far the hand leans from a button's or knob's axis, about the line along which the fingers close."""

TILT_COST = 0.1  # In rad of joint margin for a radian.
UPWARD = 0.1  # A hand that comes from below has the arm in the furniture.
ROUND = 8  # Directions in which the fingers may close, before a button.
BEFORE_M = 0.020  # The closed fingers are so far before a button at first.
BEYOND_M = 0.004  # The hand would go on so far beyond a button's travel, and is stopped by the force.
PRESS_N = 15.0
"""The hand stops at this force: more than any button's spring, less than what marks a panel."""

MOST_PRESSES = 2
PRESS_SPEED, TURN_SPEED = 0.06, 0.3
TURN_STEP_RAD = 0.05
AWAY_SHARE = 0.05  # A knob is turned back to this share of its range, just off its end.
SETTLE_S = 0.2  # A button springs to its rest.
HOLDING_M = 0.001  # Between a finger and the bar of a knob, where a path is checked.


@dataclass(frozen=True, slots=True)
class Operation:
    """What is to be done to a button or a knob.

    Attributes:
        target: Id of its object.
        control: The joint.
        now: Its position, [rad] or [m].
        wanted: The position at which it is to rest.
        T_world_link: (4, 4) the moving link's frame.
    """

    target: str
    control: Control
    now: float
    wanted: float
    T_world_link: Array

    @property
    def outward(self) -> Array:
        """(3,) unit vector in the world, out of the face."""
        return self._turned(self.control.grip.outward)

    @property
    def grip_m(self) -> Array:
        """(3,) in the world: the middle of the face, or of the bar."""
        return self._turned(self.control.grip.position_m) + self.T_world_link[:3, 3]

    @property
    def along(self) -> Array:
        """(3,) unit vector in the world along the bar."""
        return self._turned(self.control.grip.axis)

    @property
    def link(self) -> str:
        """What the fingers may touch, as "id/link"."""
        return f"{self.target}/{self.control.child}"

    @property
    def bar_m(self) -> float:
        """How thick the bar is."""
        return self.control.grip.thickness_m

    def _turned(self, vector: Vector) -> Array:
        return np.asarray(self.T_world_link[:3, :3] @ np.asarray(vector))


@dataclass
class ForceLimit(Monitor):
    """A monitor that also ends a motion at a force on a button.

    Attributes:
        link: The button, as "id/link".
        reached: The failure that ended the motion so; None before.
    """

    link: str = ""
    reached: Failure | None = None

    def check(self) -> Failure | None:
        """Return why the motion has to stop now, or None."""
        failure = super().check()
        if failure is None and self.force_n() > PRESS_N:
            self.reached = failure = Failure(FailureKind.STALLED, f"{self.link} gives way no farther")
        return failure

    def force_n(self) -> float:
        """Return the force on the button [N]."""
        owner, _, child = self.link.partition("/")
        pressing = (
            contact.impulse_ns
            for contact in self.world.contacts({owner})
            if child in (contact.a.link, contact.b.link) and "robot" in (contact.a.owner, contact.b.owner)
        )
        return sum(pressing) / self.world.timestep_s


def press(session: Session, action: Action) -> StepResult:
    """Press the target's button, so that it is switched as the action's row writes it."""
    return _operate(session, action, button=True)


def turn(session: Session, action: Action) -> StepResult:
    """Turn the target's knob, so that it is switched as the action's row writes it."""
    return _operate(session, action, button=False)


def _operate(session: Session, action: Action, *, button: bool) -> StepResult:
    session.sync_planner()
    operation = _operation(session, action, button=button)
    if isinstance(operation, str):
        unplanned = Unplanned(target=session.subtask.target)
        return session.done(action, failure=Failure(FailureKind.PRECONDITION, operation, (unplanned,)))
    planned = adopt_first(session, lambda _: iter((_stances(session, operation),)))
    if not isinstance(planned, Session):
        part = f"the {operation.control.child} of {operation.target}"
        met = _met_most(session)
        often = f"; most often {next(iter(met))} meet" if met else ""
        message = f"no free path to a place from which {part} can be {'pressed' if button else 'turned'}{often}"
        unplanned = Unplanned(target=operation.target, stances_tried=planned, in_the_way=met or None)
        return session.done(action, failure=Failure(FailureKind.NO_PATH, message, (unplanned,)))
    session, stance, journey = planned, planned.plan.stance, planned.plan.journey
    if stance is None or journey is None:
        raise RuntimeError("a stance must be planned before it is driven to")
    failure = follow_legs(session, journey.legs)
    if failure is None:
        path = np.concatenate([session.q[None], stance.approach])
        failure = session.control.follow(path, monitor=session.monitor(_may_touch(session, operation)))
    if failure is None:
        failure = _pressed(session, operation, stance) if button else _turned(session, operation)
    session = replace(session, hand=replace(session.hand, released=_may_touch(session, operation)))
    return _judged(session, action, operation, failure)


def _met_most(session: Session) -> dict[str, int]:
    """Return the pairs that met most often while planning, with counts: first those with what can be moved aside."""
    items, met = set(session.world.dynamic_ids), session.planner.effort.met
    loose = {pair for pair in met if items & {part.partition("/")[0] for part in pair.split(" and ")}}
    ranked = sorted(met, key=lambda pair: (pair not in loose, -met[pair]))
    return {pair: met[pair] for pair in ranked[:NAMED]}


def _operation(session: Session, action: Action, *, button: bool) -> Operation | str:
    """Return what an action asks for, or why it cannot be done to its target."""
    own, world, target = own_of(action.primitive), session.believed, session.subtask.target
    found = [one for one in world.assets[target].controls if one.is_button is button]
    holds = session.hand.held or session.hand.gripped
    if holds is not None:
        return f"the hand holds {holds}"
    if own is None or not found:
        return f"{target} has no {'button' if button else 'knob'}"
    control, names = found[0], own.names(target, session.subtask.support_goal)
    on = any(
        literal.value
        for literal in own.row.writes
        if literal.atom.predicate == "toggled_on" and names.get(literal.atom.args[0]) == target
    )
    now = world.joint_position(target, control.name)
    if control.is_on(now) is on:
        return f"{target} is switched {'on' if on else 'off'} already"
    away = 0.0 if button else control.position(AWAY_SHARE)
    return Operation(target, control, now, control.set_to if on else away, world.T_world_link(target, control.child))


def _may_touch(session: Session, operation: Operation) -> Allowed:
    """Return the intended contacts: of the fingers with the button or knob."""
    return fingers_may_touch(session.planner.robot, operation.link)


def _stances(session: Session, operation: Operation) -> Iterator[Stance[Operation]]:
    """Yield stances from which the arm can make the whole motion with nothing in the way."""
    planner, touch = session.planner, _may_touch(session, operation)
    button = operation.control.is_button
    opening_m = 0.0 if button else operation.bar_m / 2 + HOLDING_M

    def validate(q: Array) -> tuple[Operation, float] | None:
        path = _press_path(session, operation, q) if button else _turn_path(session, operation, q)
        if path is None or planner.oracle.first_hit(path, opening_m=opening_m, allowed=touch):
            return None
        if planner.oracle.hits(path[0 if button else -1], opening_m=planner.kinematics.finger_upper_m, allowed=touch):
            return None  # The fingers open there.
        return operation, 0.0

    goals = [*_button_goals(session, operation)] if button else [*_knob_goals(operation)]
    here = session.q[planner.robot.base]
    return search_stances(planner, goals, here, validate=validate, allowed=touch)


def _button_goals(session: Session, operation: Operation) -> Iterator[HandGoal]:
    """Yield hand poses before a button, the point between the fingertips on its axis."""
    hand, inward = session.planner.robot.hand, -operation.outward
    first = np.cross(inward, operation.along)
    closings = [Rotation.from_rotvec(k * np.pi / ROUND * inward).apply(first) for k in range(ROUND)]
    for closing in closings:
        for tilt_rad in np.deg2rad(TILTS_DEG):
            ahead_m = hand.fingertip_m * np.cos(tilt_rad) + hand.finger_half_m * abs(np.sin(tilt_rad))
            point = operation.grip_m - (BEFORE_M + ahead_m) * inward
            yield from _facing(Rotation.from_rotvec(tilt_rad * closing).apply(inward), closing, point, tilt_rad)


def _knob_goals(operation: Operation) -> Iterator[HandGoal]:
    """Yield hand poses around the bar of a knob."""
    inward = -operation.outward
    closing = np.cross(operation.along, inward)
    for tilt_rad in np.deg2rad(TILTS_DEG):
        approach = Rotation.from_rotvec(tilt_rad * closing).apply(inward)
        yield from _facing(approach, closing, operation.grip_m, tilt_rad)


def _facing(approach: Array, closing: Array, point: Array, tilt_rad: float) -> Iterator[HandGoal]:
    """Yield a hand pose with the headings of a robot that faces it: two for a hand from above."""
    if approach[2] > UPWARD:
        return
    R = np.stack([np.cross(closing, approach), closing, approach], axis=1)
    from_above = np.hypot(*approach[:2]) < UPWARD
    for direction in (R[:, 0], -R[:, 0]) if from_above else (approach,):
        yield HandGoal(transform(R, point), heading_of(direction), TILT_COST * abs(float(tilt_rad)))


def _press_path(session: Session, operation: Operation, q: Array) -> Array | None:
    """Return the (N, Q) path from before a button to the end of its travel, or None where the arm does not reach."""
    stroke_m = BEFORE_M + operation.control.limits[1] - operation.now + BEYOND_M
    T = session.planner.kinematics.forward(q)
    T[:3, 3] -= stroke_m * operation.outward
    return session.planner.line(q, T).path


def _turn_path(session: Session, operation: Operation, q: Array) -> Array | None:
    """Return the (N, Q) path that turns the hand about a knob's axis, or None where the arm cannot."""
    T = session.planner.kinematics.forward(q)
    by_rad, middle = operation.wanted - operation.now, operation.T_world_link[:3, 3]
    poses = []
    for angle_rad in np.linspace(0.0, by_rad, max(int(abs(by_rad) / TURN_STEP_RAD), 1) + 1)[1:]:
        turn = Rotation.from_rotvec(-angle_rad * operation.outward).as_matrix()
        poses.append(transform(turn @ T[:3, :3], turn @ (T[:3, 3] - middle) + middle))
    path, _ = session.planner.tracker.track(q, poses)
    return None if path is None else np.concatenate([q[None], path])


def _pressed(session: Session, operation: Operation, stance: Stance[Operation]) -> Failure | None:
    """Press a button with closed fingers and leave it; return why it could not be pressed, or None."""
    control, touch = session.control, _may_touch(session, operation)
    control.grip(0.0)
    failure: Failure | None = None
    carries = (operation.target, operation.control.name, operation.wanted)
    for _ in range(MOST_PRESSES):
        path = _press_path(session, operation, session.q)
        if path is None:
            message = f"the arm does not reach on to the button of {operation.target}"
            return Failure(FailureKind.UNREACHABLE, message, (Unplanned(target=operation.target),))
        limit = ForceLimit(session.world, session.planner.kinematics, allowed=touch, link=operation.link)
        failure = control.follow(path, speed=PRESS_SPEED, monitor=limit, carries=carries)
        failure = None if failure is limit.reached else failure
        back = session.planner.line(session.q, session.planner.kinematics.forward(stance.q)).path
        if failure is None and back is not None:
            failure = control.follow(back, speed=PRESS_SPEED, monitor=session.monitor(touch))
        control.settle(SETTLE_S)
        if failure is not None or _is_done(session, operation):
            break
    control.grip(session.planner.kinematics.finger_upper_m)
    return failure


def _turned(session: Session, operation: Operation) -> Failure | None:
    """Take a knob, turn it and let go; return why it could not be turned, or None."""
    control, touch = session.control, _may_touch(session, operation)
    path = _turn_path(session, operation, session.q)
    if path is None:
        message = f"the wrist does not turn on with the knob of {operation.target}"
        return Failure(FailureKind.UNREACHABLE, message, (Unplanned(target=operation.target),))
    control.grip(0.0)
    monitor = session.monitor(touch, gripped=operation.target)
    carries = (operation.target, operation.control.name, operation.wanted)
    failure = control.follow(path, speed=TURN_SPEED, monitor=monitor, carries=carries)
    control.grip(session.planner.kinematics.finger_upper_m)
    control.settle(SETTLE_S)
    return failure


def _is_done(session: Session, operation: Operation) -> bool:
    position = session.world.joint_position(operation.target, operation.control.name)
    return operation.control.is_on(position) is operation.control.is_on(operation.wanted)


def _judged(session: Session, action: Action, operation: Operation, failure: Failure | None) -> StepResult:
    """Return the outcome with what the joint has done."""
    control = operation.control
    reached = session.world.joint_position(operation.target, control.name)
    measured = JointMotion(
        joint=control.name,
        motion="press" if control.is_button else "turn",
        fraction_before=round(control.fraction(operation.now), 4),
        fraction_asked=round(control.fraction(operation.wanted), 4),
        fraction_reached=round(control.fraction(reached), 4),
        joint_reached=round(reached, 5),
    )
    if failure is None and not _is_done(session, operation):
        state = read(Atom("toggled_on", (operation.target,)), session.world).value
        message = f"{operation.target} stays switched {'on' if state else 'off'}"
        failure = Failure(FailureKind.STALLED, message, (measured,))
    return session.done(action, measured, failure=failure)
