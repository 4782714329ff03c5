"""Taking hold and letting go: APPROACH, CONVERGE, GRASP and UNGRASP.

APPROACH moves to the pre-grasp pose, CONVERGE straight onto the handle or the item. GRASP closes until both fingers
press, UNGRASP opens until neither does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bddl import Atom, atoms
from executor.assets.model import Handle
from executor.geometry import Array, inverse, rotation_z
from executor.planning.articulation import handle_contacts
from executor.planning.cargo import HELD, cargo_of, touching_any
from executor.planning.collision import Allowed, fingers_may_touch, held_may_touch
from executor.planning.drives import drive_to
from executor.planning.openings import gripped_handle
from executor.planning.picks import in_the_way
from executor.planning.planner import BASE_HEADINGS_RAD
from executor.records import Failure, FailureKind
from executor.sim.detectors import fingers_touching
from executor.skills.navigate import follow_legs, grip_width_m, misfit, with_stance
from executor.skills.session import Hand, Plan, Session, StepResult
from oag import Action, Primitive
from oag.measurements import GripMeasured, HandMeasured, ReleaseMeasured, Unplanned

RELEASE_SETTLE_S = 0.6  # What is let go of has fallen and come to rest.
FALL_M = 0.10  # More than planning accepts, 6 cm; less than off a table.
SQUEEZE_M = 0.015
"""How far beyond each other the fingers are sent around a wall or a bar: so they press with all their force."""

SET_DOWN_M, SET_DOWN_STEP_M = (0.025, 0.010), 0.0005
"""How far down a thing is lowered onto what is below it before it is let go of; the farther one that the arm reaches.

A medicine bottle that falls by 4 mm lands with the edge of its cap on a finger, and goes along as the hand leaves.
"""

SET_DOWN_SPEED = 0.2  # It touches what is below.
OPEN_ENOUGH_M = 0.001  # Fingers settle by less.
OPENED_CLEARANCE_M = 0.002  # Of the fingers as they open.
CONVERGE_SPEED = 0.5  # Half, since the fingers are next to the thing.
AT_PRE_GRASP_RAD = 0.02  # Of any joint; metres of the base.
NO_OFFSET_M = 1e-6
# Allowed between NAVIGATE_TO_TARGET and APPROACH besides slides; the motion of a RETREAT does not count as a slide.
_KEEPING = frozenset({*BASE_HEADINGS_RAD, Primitive.RETREAT})


def handle_in_use(session: Session) -> Handle | None:
    """Return the planned handle, else the one between the fingers, else the first; None without any."""
    if session.plan.swing is not None:
        return session.plan.swing.handle
    target = session.subtask.target
    handles = session.world.assets[target].handles
    return (gripped_handle(session.world, target) or handles[0]) if handles else None


def target_contacts(session: Session) -> Allowed:
    """Return the intended contacts of holding the target: its handle's link, or the item."""
    robot, target, handle = session.planner.robot, session.subtask.target, handle_in_use(session)
    return handle_contacts(robot, target, handle) if handle is not None else fingers_may_touch(robot, target)


def grasp(session: Session, action: Action) -> StepResult:
    """Close the gripper on the target and measure whether both fingers press on it."""
    target, handled = session.subtask.target, session.handled | {session.subtask.target}
    asset = session.world.assets[target]
    if session.plan.is_push:
        session.control.grip(0.0)
        pushing = replace(session.hand, released=target_contacts(session))
        return replace(session, hand=pushing, handled=handled).done(action, GripMeasured(motion="push"))
    if (failure := misfit(target, asset, session.gripper)) is not None:
        return session.done(action, failure=failure)
    cargo = cargo_of(session.world, target) if asset.motion == "dynamic" else ()
    supports = [body for body in touching_any(session.world, (target, *cargo)) if body != "robot"]
    planned_hold, at_rim = _planned_hold(session), session.plan.at_rim
    swing = session.plan.swing
    # A bar that is to turn between the fingers is pressed by what the spring of their drives gives, some 20 N.
    turning = swing is not None and swing.share is not None and swing.share.hold < 1.0
    squeezed = at_rim or (asset.motion != "dynamic" and not turning)
    fingers = session.control.grip(-SQUEEZE_M if squeezed else 0.0)
    touching = fingers_touching(session.world, target)
    measured = GripMeasured(
        fingers_touching=touching,
        opening_m=round(float(fingers.sum()), 4),
        target_width_m=round(asset.rim.thickness_m if at_rim and asset.rim else grip_width_m(asset), 4),
    )
    if touching < len(session.world.model.finger_links):
        message = f"{touching} of 2 fingers touch {target} after closing to {fingers.sum() * 1000:.0f} mm"
        return session.done(action, measured, failure=Failure(FailureKind.GRASP_MISSED, message, (measured,)))
    if asset.motion != "dynamic":
        holding = replace(session.hand, gripped=target, released=target_contacts(session))
        session = replace(session, hand=holding, handled=handled)
        session.sync_planner()
        return session.done(action, measured)
    upward = tuple(map(float, session.planner.kinematics.forward(session.control.q)[2, :3])) if cargo else None
    may_touch = held_may_touch(supports), fingers_may_touch(session.planner.robot, target)
    holding = Hand(target, session.hand.gripped, *may_touch, cargo, upward)
    session = replace(session, hand=holding, handled=handled)
    session.sync_planner()
    measured = replace(measured, grip_force_n=round(_grip_force_n(session), 2))
    return session.done(action, _with_hold_offset(session, planned_hold, measured))


def _planned_hold(session: Session) -> Array | None:
    """Return (4, 4) the planned pose of the item in the hand, without the flow's own corrections."""
    stance, target = session.plan.stance, session.subtask.target
    if stance is None or session.world.assets[target].motion != "dynamic":
        return None
    q = stance.q.copy()
    q[:2] -= session.plan.aside_m
    T_eef_target: Array = inverse(session.planner.kinematics.forward(q)) @ session.believed.T_world_link(target)
    return T_eef_target


def _with_hold_offset(session: Session, planned_hold: Array | None, measured: GripMeasured) -> GripMeasured:
    """Add the offset of the held item from its planned pose in the hand, in the base's directions.

    Across the fingers it counts as nothing, since they centre what they close on.
    """
    carried = session.planner.oracle.carried
    if planned_hold is None or carried is None:
        return measured
    off = carried.T_eef_object[:3, 3] - planned_hold[:3, 3]
    off[1] = 0.0
    in_world = session.planner.kinematics.forward(session.control.q)[:3, :3] @ off
    forward, left, up = rotation_z(float(session.q[2])).T @ in_world
    return replace(
        measured,
        held_off_m=round(float(np.linalg.norm(off)), 4),
        held_forward_m=round(float(forward), 4),
        held_left_m=round(float(left), 4),
        held_up_m=round(float(up), 4),
    )


def _grip_force_n(session: Session) -> float:
    """Return the force of the finger that presses less."""
    world, target = session.world, session.subtask.target
    forces = dict.fromkeys(world.model.finger_links, 0.0)
    for contact in world.contacts({target}):
        for near, far in ((contact.a, contact.b), (contact.b, contact.a)):
            if near.owner == "robot" and near.link in forces and far.owner == target:
                forces[near.link] += contact.impulse_ns / world.timestep_s
    return min(forces.values())


def ungrasp(session: Session, action: Action) -> StepResult:
    """Lower what is held onto what is below it, open the gripper and wait until it is at rest."""
    held = session.hand.held
    if held is not None and not session.planner.robot.keeps_order and not _over_a_hollow(session):
        _set_down(session)
    before = session.world.T_world_link(held)[:3, 3] if held is not None else np.zeros(3)
    session.control.grip(session.planner.kinematics.finger_upper_m)
    session = replace(session, hand=session.hand.empty)
    session.control.settle(RELEASE_SETTLE_S)
    session.sync_planner()
    if held is None:
        return session.done(action)
    fell_m = float(before[2] - session.world.T_world_link(held)[2, 3])
    moved_m = float(np.linalg.norm(session.world.T_world_link(held)[:2, 3] - before[:2]))
    measured = ReleaseMeasured(round(fell_m, 4), round(moved_m, 4))
    failure = None
    if fell_m > FALL_M:
        message = f"{held} fell {fell_m * 100:.0f} cm when the gripper opened"
        failure = Failure(FailureKind.DROPPED, message, (measured,))
    return session.done(action, measured, failure=failure)


def _over_a_hollow(session: Session) -> bool:
    """Return whether the target is put into a bowl or box: where it ends was found out for a fall from here."""
    target, support = session.subtask.target, session.subtask.support_goal
    return support in session.world.dynamic_ids and Atom("inside", (target, support)) in atoms(session.subtask.goal)


def _set_down(session: Session) -> None:
    """Lower what is held until it touches what is below it, where that is near and the opening fingers have room."""
    session.sync_planner()
    planner, q = session.planner, session.q
    oracle, T = planner.oracle, planner.kinematics.forward(q)
    for down_m in SET_DOWN_M:
        T_down = T.copy()
        T_down[2, 3] -= down_m
        line = planner.line(q, T_down).path
        if line is not None:
            break
    else:
        return
    shares = np.linspace(0.0, 1.0, round(down_m / SET_DOWN_STEP_M) + 1)
    rows = np.linspace(0.0, 1.0, len(line))
    way = np.stack([np.interp(shares, rows, line[:, joint]) for joint in range(line.shape[1])], axis=1)
    with oracle.leaving(q):
        met = next(((row, hits) for row, q in enumerate(way) if (hits := oracle.hits(q))), None)
    if met is None or any(hit.mover != HELD for hit in met[1]):
        return
    lowest, touched = way[: met[0] + 1], held_may_touch(hit.other.split("/")[0] for hit in met[1])
    opened_m, end = planner.kinematics.finger_upper_m, lowest[-1]
    if len(lowest) > 2 and not oracle.hits(end, opening_m=opened_m, margin_m=OPENED_CLEARANCE_M, allowed=touched):
        session.control.follow(lowest, speed=SET_DOWN_SPEED, monitor=session.monitor(touched))


def approach(session: Session, action: Action) -> StepResult:
    """Move the hand to the pre-grasp pose, with fingers no wider than there is room for.

    It drives there first where the flow did not navigate.
    """
    planned = with_stance(session) if session.plan.stance is None else session
    if isinstance(planned, Failure):
        return session.done(action, failure=planned)
    session = replace(planned, plan=_with_base_moves(planned))
    stance, journey = session.plan.stance, session.plan.journey
    if stance is None:
        raise RuntimeError("a stance must have been planned")
    start = stance.approach[0]
    if journey is not None and not np.allclose(journey.legs[0][1][0], session.q, atol=1e-6):
        # The flow has moved the robot since the journey was planned.
        journey = None
    if journey is None and not _is_at(session.q, start):
        session.sync_planner()
        journey = drive_to(session.planner, session.q, start)
        if journey is None:
            return session.done(action, failure=_no_path_failure(session, start))
    failure = None if journey is None else follow_legs(session, journey.legs)
    plan = replace(session.plan, journey=None)
    if failure is None:
        # The journey may have counted the base's yaw in another turn than the stance did.
        plan = replace(plan, stance=stance.turned(float(session.q[2] - start[2])))
        widest_m = session.planner.kinematics.finger_upper_m
        narrow = not session.planner.robot.keeps_order and session.fingers_m < widest_m - OPEN_ENOUGH_M
        if stance.opening_m is not None or narrow:
            # An approach before this one may have ended with narrowed fingers.
            session.control.grip(widest_m if stance.opening_m is None else stance.opening_m)
    return replace(session, plan=plan).done(action, _hand(session), failure=failure)


def _no_path_failure(session: Session, start: Array) -> Failure:
    blockers = in_the_way(session.planner, session.q, start[:2])
    found = Unplanned(target=session.subtask.target, in_the_way=blockers)
    return Failure(FailureKind.NO_PATH, "no free way leads to the pre-grasp pose", (found,))


def converge(session: Session, action: Action) -> StepResult:
    """Move the hand straight from the pre-grasp pose to the grasp."""
    stance = session.plan.stance
    if stance is None or not _is_at(session.q, stance.approach[0]):
        message = f"the hand is not at the pre-grasp pose of {session.subtask.target}"
        return session.done(action, failure=Failure(FailureKind.PRECONDITION, message))
    session.sync_planner()
    off = _aim_offset(session)
    path = np.concatenate([session.q[None], stance.approach])
    failure = session.control.follow(path, speed=CONVERGE_SPEED, monitor=session.monitor(target_contacts(session)))
    wanted = session.planner.kinematics.forward(stance.q)[:3, 3]
    reached = session.planner.kinematics.forward(session.control.q)[:3, 3]
    measured = replace(_hand(session), residual_m=round(float(np.linalg.norm(wanted - reached)), 5))
    if off is not None:
        forward, left, up = (round(float(way), 4) for way in off)
        measured = replace(measured, target_forward_m=forward, target_left_m=left, target_up_m=up)
    return session.done(action, measured, failure=failure)


def _with_base_moves(session: Session) -> Plan:
    """Shift the stance by the flow's base slides since NAVIGATE_TO_TARGET: corrections, to be kept."""
    before, plan = session.step - 1, session.plan
    slid = False
    while before >= 0 and session.flow[before].primitive in _KEEPING:
        slid = slid or session.flow[before].primitive in BASE_HEADINGS_RAD
        before -= 1
    moved = slid and before >= 0 and session.flow[before].primitive is Primitive.NAVIGATE_TO_TARGET
    if not moved or plan.stance is None:
        return plan
    by = session.q[:2] - plan.arrived_m
    return replace(plan, stance=plan.stance.shifted(by), aside_m=(float(by[0]), float(by[1])))


def _aim_offset(session: Session) -> Array | None:
    """Return the target's offset (3,) from its believed pose, in the base's directions; None where it is zero."""
    target, aside = session.subtask.target, np.array([*session.plan.aside_m, 0.0])
    off = session.world.T_world_link(target)[:3, 3] - session.believed.T_world_link(target)[:3, 3] - aside
    if np.abs(off).max() < NO_OFFSET_M:
        return None
    return np.asarray(rotation_z(float(session.q[2])).T @ off)


def _is_at(q: Array, start: Array) -> bool:
    difference = q - start
    difference[2] = (difference[2] + np.pi) % (2 * np.pi) - np.pi
    return bool(np.abs(difference).max() < AT_PRE_GRASP_RAD)


def _hand(session: Session) -> HandMeasured:
    position = session.planner.kinematics.forward(session.control.q)[:3, 3]
    return HandMeasured(tuple(round(float(v), 4) for v in position))
