"""ARTICULATE_OPEN and ARTICULATE_CLOSE: move a joint by the planned motion, in as many stages as it takes."""

from __future__ import annotations

from dataclasses import replace

from executor.assets.model import Handle
from executor.geometry import Array
from executor.planning.articulation import (
    ArticulationTask,
    Swing,
    carry_joint,
    driving_carries,
    end_fractions,
    handle_contacts,
    interval,
    step_back,
)
from executor.planning.articulation_stances import (
    articulation_stances,
    explain_failure,
    motion_from_grasp,
    tracked_path,
)
from executor.planning.collision import NOTHING
from executor.planning.openings import handle_of, handles_to_close, open_joints
from executor.records import Failure, FailureKind
from executor.skills.control import Monitor
from executor.skills.grasp import approach, converge, grasp, handle_in_use, ungrasp
from executor.skills.navigate import adopt_first, leave
from executor.skills.session import Session, StepResult
from oag import Action, Primitive
from oag.measurements import FollowedInPart, JointMotion, StageCount, Unplanned

SPEED = 0.6  # Of the limits: a door that passes its neighbour by 2 mm moves by less than that in a step of the physics.
SETTLE_S = 0.2  # A door swings a little on.
TOLERANCE = 0.04
"""How far short of the asked fraction of the joint's range counts as a stall."""

WIDE_ENOUGH = 0.5
"""From this fraction on, an opening whose size the flow leaves open is wide enough."""

MOST_STAGES = 6  # More means that something else is wrong.


def articulate(session: Session, action: Action) -> StepResult:
    """Move the target's joint to the action's end, measured at the joint.

    Closing continues with every other open joint of the target. A joint that one motion moves only partly is regrasped,
    or pushed where it stands ajar.
    """
    target = session.subtask.target
    handle = handle_in_use(session)
    if handle is None or (session.hand.gripped != target and not session.plan.is_push):
        message = f"the gripper does not hold a handle of {target}"
        return session.done(action, failure=Failure(FailureKind.PRECONDITION, message, (Unplanned(target=target),)))
    stages: list[JointMotion] = []
    failure: Failure | None = None
    done: set[str] = set()
    while failure is None and handle is not None:
        partial = session.plan.swing is not None and session.plan.swing.partial
        session, measured, failure = _stage(session, action, handle)
        stages.append(measured)
        if not partial:
            done.add(handle.joint)
        if failure is not None:
            break
        going_on = partial and not _is_enough(action, measured)
        own = handle_of(session.world, target, handle.joint) or handle
        handles = (own,) if going_on else _next_handles(session, action, done)
        if not handles:
            break
        refused: Failure | None = _unfinished(target, measured)
        if len(stages) < MOST_STAGES:
            session, refused = _regrasp(session, action, handles, going_on=going_on)
        if refused is not None and not (going_on and action.parameter is None and _opens(action)):
            failure = replace(refused, measurements=(*refused.measurements, StageCount(len(stages))))
        handle = None if refused is not None else handle_in_use(session)
    measured = stages[-1]
    first, last = stages[0].fraction_before, measured.fraction_asked
    if len(stages) > 1:
        measured = replace(measured, stages=tuple(stages))
        first, last = (first, last) if _opens(action) else _widest(stages)
    filled = action if action.parameter is not None else replace(action, parameter=interval(first, last))
    return session.done(filled, measured, failure=failure)


def _stage(session: Session, action: Action, handle: Handle) -> tuple[Session, JointMotion, Failure | None]:
    """Move one joint by one motion; return the measurement and why it ended early, or None."""
    target, world, swing = session.subtask.target, session.world, session.plan.swing
    joint = world.assets[target].joint(handle.joint)
    start = world.joint_position(target, joint.name)
    now = joint.fraction(start)
    session.sync_planner()
    work = ArticulationTask(session.planner, world, target, handle, action)
    swing = swing or (None if driving_carries(joint, work.T_root) else motion_from_grasp(work, session.q))
    end = swing.end_fraction if swing is not None else end_fractions(session.planner.robot, action, joint, now)[0]
    motion = swing.motion if swing is not None else "rigid arc" if driving_carries(joint, work.T_root) else "none"
    path, failure = _path(work, session.q, swing, joint.position(end))
    session = replace(session, plan=session.plan.without_swing())
    if path is not None:
        pushing = swing is not None and swing.motion == "push"
        robot = session.planner.robot
        # Stored results of the paper's robot ended where one finger came off.
        bar_m = None if robot.keeps_order else handle.thickness_m
        gripped = None if pushing else target
        monitor = session.monitor(handle_contacts(robot, target, handle), gripped=gripped, bar_m=bar_m)
        carries = (target, joint.name, joint.position(end))
        failure = session.control.follow(path, speed=SPEED, monitor=monitor, carries=carries)
        session.control.settle(SETTLE_S)
        if pushing and failure is None:
            session, failure = _retract_from_panel(session, monitor)
    position = world.joint_position(target, joint.name)
    reached = joint.fraction(position)
    measured = JointMotion(
        joint=joint.name,
        motion=motion,
        fraction_before=round(now, 4),
        fraction_asked=round(end, 4),
        fraction_reached=round(reached, 4),
        joint_reached=round(position, 4),
    )
    if failure is None and abs(reached - end) > TOLERANCE:
        message = f"{joint.name} stalled at {reached:.2f} of its range, {end:.2f} was asked"
        failure = Failure(FailureKind.STALLED, message, (measured,))
    elif failure is not None:
        message = f"{failure.message}; {joint.name} is at {reached:.2f} of its range, {end:.2f} was asked"
        failure = Failure(failure.kind, message, (measured, *failure.measurements))
    return session, measured, failure


def _path(work: ArticulationTask, q: Array, swing: Swing | None, end: float) -> tuple[Array | None, Failure | None]:
    if swing is not None and swing.share is not None:
        tracked, residual_m = tracked_path(work, q, swing)
        if tracked.complete:
            return tracked.trajectory.path, None
        reached = work.joint.fraction(next(iter(tracked.trajectory.joints[-1].values())))
        message = f"the arm follows {work.joint.name} to {reached:.2f} of its range"
        followed = FollowedInPart(round(residual_m, 4), round(reached, 4))
        return None, Failure(FailureKind.UNREACHABLE, message, (followed,))
    if not driving_carries(work.joint, work.T_root):
        message = f"neither driving nor the arm follows {work.joint.name} from here"
        return None, Failure(FailureKind.UNREACHABLE, message)
    return carry_joint(work.planner.robot, q, work.object_id, work.joint, work.T_root, work.now, end).path, None


def _retract_from_panel(session: Session, monitor: Monitor) -> tuple[Session, Failure | None]:
    """Move the closed gripper off the panel, so that opening it catches nothing; return why it stopped, or None."""
    path = step_back(session.planner, session.q)
    if path is None:
        return session, None
    failure = session.control.follow(path, speed=SPEED, monitor=monitor)
    return replace(session, hand=replace(session.hand, released=NOTHING)), failure


def _next_handles(session: Session, action: Action, done: set[str]) -> tuple[Handle, ...]:
    """Return the handles of the remaining open joints when closing, without those already handled."""
    target = session.subtask.target
    if _opens(action) or not open_joints(session.world, target):
        return ()
    return tuple(handle for handle in handles_to_close(session.world, target) if handle.joint not in done)


def _regrasp(
    session: Session, action: Action, handles: tuple[Handle, ...], *, going_on: bool
) -> tuple[Session, Failure | None]:
    """Let go, move to one of some handles, or before its panel, and grasp; return why not, or None.

    Args:
        handles: Those that will do, the preferred one first.
        going_on: Whether an earlier stage has moved the joint part of its range.
    """
    target = session.subtask.target
    left = leave(ungrasp(session, Action(Primitive.UNGRASP)).session)
    session = left.session
    if left.failure is not None:
        return session, left.failure
    session = replace(session, plan=replace(session.plan, stance=None, journey=None))
    session.sync_planner()
    planner, world, here = session.planner, session.believed, session.q[session.planner.robot.base]
    planned = adopt_first(
        session, lambda _: articulation_stances(planner, world, target, handles, action, here, going_on=going_on)
    )
    if not isinstance(planned, Session):
        return session, explain_failure(ArticulationTask(planner, world, target, handles[0], action), here)
    session = planned
    for step, primitive in ((approach, Primitive.APPROACH), (converge, Primitive.CONVERGE), (grasp, Primitive.GRASP)):
        outcome = step(session, Action(primitive))
        session = outcome.session
        if outcome.failure is not None:
            return session, outcome.failure
    return session, None


def _unfinished(target: str, measured: JointMotion) -> Failure:
    message = f"{target} is not where it was asked to be after {MOST_STAGES} motions; the last one was of "
    message += f"{measured.joint}, to {measured.fraction_reached} of its range"
    return Failure(FailureKind.STALLED, message, (measured,))


def _opens(action: Action) -> bool:
    return action.primitive is Primitive.ARTICULATE_OPEN


def _is_enough(action: Action, measured: JointMotion) -> bool:
    """Return whether an opening whose size the flow leaves open is wide enough."""
    return action.parameter is None and _opens(action) and measured.fraction_reached >= WIDE_ENOUGH


def _widest(stages: list[JointMotion]) -> tuple[float, float]:
    """Return the first and last fraction of the joint that was closed the farthest, over all its stages."""
    spans: dict[str, tuple[float, float]] = {}
    for stage in stages:
        first = spans.get(stage.joint, (stage.fraction_before, 0.0))[0]
        spans[stage.joint] = first, stage.fraction_asked
    return max(spans.values(), key=lambda span: span[0] - span[1])
