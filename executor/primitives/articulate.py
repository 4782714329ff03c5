"""ARTICULATE_OPEN and ARTICULATE_CLOSE: move a joint by the motion that was planned, in as many stages as it takes."""

from __future__ import annotations

from dataclasses import replace

from executor.assets.model import Handle
from executor.geometry import Array
from executor.motion.articulation.doors import handle_of, handles_to_close, standing_open
from executor.motion.articulation.joint_motion import carry_joint, driving_carries
from executor.motion.articulation.stances import improvised, tracked_path
from executor.motion.articulation.ways import articulation_stances, why_not
from executor.motion.articulation.work import Swing, Work, end_fractions, handle_contacts, interval, step_back
from executor.motion.planning.oracle import NOTHING
from executor.primitives.driving import leave
from executor.primitives.grasp import approach, converge, grasp, handle_in_use, ungrasp
from executor.primitives.monitors import Monitor
from executor.primitives.navigate import adopt_first
from executor.primitives.session import Session, StepResult
from executor.records.rollout import Failure, FailureKind
from oag import Action, Primitive
from oag.revision.measurements import FollowedInPart, JointMotion, StageCount, Unplanned

SPEED = 0.6  # Of the limits: a door that passes its neighbour by 2 mm moves by less than that in a step of the physics.
SETTLE_S = 0.2  # A door swings a little on.
TOLERANCE = 0.04
"""How far short of the asked fraction of the joint's range counts as a stall."""

WIDE_ENOUGH = 0.5
"""From this fraction on, an opening whose size the flow leaves open is left at that."""

MOST_STAGES = 6  # More means that something else is wrong.


def articulate(session: Session, action: Action) -> StepResult:
    """Moves the target's joint to where the action says, measured at the joint.

    Closing goes on with every other joint of the target that stands open. A joint that one motion brings only part of
    the way is taken up again, by a push where it stands ajar.
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
            session, refused = _take_up(session, action, handles, going_on=going_on)
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
    """Moves one joint by one motion; returns what was measured and why it ended early, or None."""
    target, world, swing = session.subtask.target, session.world, session.plan.swing
    joint = world.assets[target].joint(handle.joint)
    start = world.joint_position(target, joint.name)
    now = joint.fraction(start)
    session.look()
    work = Work(session.planner, world, target, handle, action)
    swing = swing or (None if driving_carries(joint, work.T_root) else improvised(work, session.q))
    end = swing.end_fraction if swing is not None else end_fractions(action, joint, now)[0]
    motion = swing.motion if swing is not None else "rigid arc" if driving_carries(joint, work.T_root) else "none"
    path, failure = _path(work, session.q, swing, joint.position(end))
    session = replace(session, plan=session.plan.without_swing())
    if path is not None:
        pushing = swing is not None and swing.motion == "push"
        monitor = session.monitor(handle_contacts(target, handle), gripped=None if pushing else target)
        failure = session.control.follow(path, speed=SPEED, monitor=monitor)
        session.control.settle(SETTLE_S)
        if pushing and failure is None:
            session, failure = _off_the_panel(session, monitor)
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


def _path(work: Work, q: Array, swing: Swing | None, end: float) -> tuple[Array | None, Failure | None]:
    """Returns the robot's path (N, 10), or why there is none."""
    if swing is not None and swing.share is not None:
        tracked, residual_m = tracked_path(work, q, swing)
        if tracked.complete:
            return tracked.way.path, None
        reached = work.joint.fraction(next(iter(tracked.way.joints[-1].values())))
        message = f"the arm follows {work.joint.name} to {reached:.2f} of its range"
        followed = FollowedInPart(round(residual_m, 4), round(reached, 4))
        return None, Failure(FailureKind.UNREACHABLE, message, (followed,))
    if not driving_carries(work.joint, work.T_root):
        message = f"neither driving nor the arm follows {work.joint.name} from here"
        return None, Failure(FailureKind.UNREACHABLE, message)
    return carry_joint(q, work.object_id, work.joint, work.T_root, work.now, end).path, None


def _off_the_panel(session: Session, monitor: Monitor) -> tuple[Session, Failure | None]:
    """Takes the closed gripper off the panel, so that opening it catches nothing; returns why it stopped, or None."""
    path = step_back(session.planner, session.q)
    if path is None:
        return session, None
    failure = session.control.follow(path, speed=SPEED, monitor=monitor)
    return replace(session, hand=replace(session.hand, released=NOTHING)), failure


def _next_handles(session: Session, action: Action, done: set[str]) -> tuple[Handle, ...]:
    """Returns the handles of what still stands open when closing, those joints left out that were seen to."""
    target = session.subtask.target
    if _opens(action) or not standing_open(session.world, target):
        return ()
    return tuple(handle for handle in handles_to_close(session.world, target) if handle.joint not in done)


def _take_up(
    session: Session, action: Action, handles: tuple[Handle, ...], *, going_on: bool
) -> tuple[Session, Failure | None]:
    """Lets go, goes to one of some handles, or before its panel, and takes hold; returns why not, or None.

    Args:
        session: The subtask.
        action: The articulation.
        handles: Those that will do, the preferred one first.
        going_on: Whether an earlier stage has brought the joint part of the way.
    """
    target = session.subtask.target
    left = leave(ungrasp(session, Action(Primitive.UNGRASP)).session)
    session = left.session
    if left.failure is not None:
        return session, left.failure
    session = replace(session, plan=replace(session.plan, stance=None, journey=None))
    session.look()
    planner, world, here = session.planner, session.believed, session.q[:3]
    ways = articulation_stances(planner, world, target, handles, action, here, going_on=going_on)
    planned = adopt_first(session, ways)
    if not isinstance(planned, Session):
        return session, why_not(Work(planner, world, target, handles[0], action), here)
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
    """Decides whether an opening whose size the flow leaves open is wide enough to leave it at that."""
    return action.parameter is None and _opens(action) and measured.fraction_reached >= WIDE_ENOUGH


def _widest(stages: list[JointMotion]) -> tuple[float, float]:
    """Returns from where to where the joint was closed, over all its stages, that had the longest way."""
    ways: dict[str, tuple[float, float]] = {}
    for stage in stages:
        first = ways.get(stage.joint, (stage.fraction_before, 0.0))[0]
        ways[stage.joint] = first, stage.fraction_asked
    return max(ways.values(), key=lambda way: way[0] - way[1])
