"""Baseline in the manner of GenSim2: one hand pose from constraints, and fixed motions before and after it.

Kept from GenSim2: the hand's place and direction follow from a keypoint of the thing alone. The keypoint is the middle
of a handle's bar along its outward direction, an item's grasp point from the robot's side, or the middle of a place.
The hand comes in a straight line from `BEFORE_M` behind. It opens and shuts things by one straight stroke of
`STROKE_M`, and sets things down by the same numbers everywhere. There is one try. The constraints leave open the turn
about an upright thing and the arm's posture; the first that the arm reaches with a free begin of the straight line is
taken. Neither the line nor the grasp or what follows is checked ahead, and nothing is grasped again.

More favourable than GenSim2: the base stands straight before the pose at the first usual reach with room. Paths of base
and arm to the begin are the executor's, free of collisions, as is the hand's withdrawal. The handle and the plan are
given. A base that drives the stroke replaces an arm that may not reach so far.

Source: GenSim2 (CoRL 2024), its constraint files: a pose by point and axis constraints, `pre_actuation_motions` of 0.15
m along the hand, and `post_actuation_motions` of 0.5 m along one axis for a refrigerator. Own code.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from benchmarks.baselines.base_stances import approach_by, drive_to_stance, stance_before, unreachable_failure
from executor.assets.asset_geometry import bounds
from executor.assets.model import Region
from executor.geometry import Array, heading_of, rotation_z, transform, wrap_angle
from executor.planning.articulation import Swing, end_fractions, handle_contacts, interval
from executor.planning.grasps import handle_goals, heading_of_hand, item_goals, rim_goals
from executor.planning.openings import handles_to_close, handles_to_open
from executor.planning.paths import base_move
from executor.planning.picks import Lift
from executor.planning.planner import undo_moves
from executor.planning.stances import HandGoal, Stance
from executor.records import Failure, FailureKind
from executor.skills.grasp import handle_in_use
from executor.skills.library import LIBRARY, Runner
from executor.skills.navigate import (
    fits_between,
    leave,
    misfit,
    moves_after,
    next_of,
    regions_for,
    support_of,
)
from executor.skills.navigate_to_support import moves_before
from executor.skills.session import Session, StepResult
from oag import Action, Primitive
from oag.measurements import JointMotion, SupportDrive

BEFORE_M = 0.15  # GenSim2's, along the hand.
STROKE_M = 0.5  # GenSim2's for the door of a refrigerator.
STROKE_SPEED = 0.6  # As the executor moves doors.
SETTLE_S = 0.2
OVER_M = 0.02  # Height of release above the place: exactly there the thing would be pressed into it.
FROM_THE_EDGE_M = 0.12  # Distance from the near edge of a top: middles of tables are out of reach.
_SIDES = tuple(np.array(side, dtype=float) for side in ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0)))

FIXED_M: Mapping[Primitive, float] = MappingProxyType(
    {
        Primitive.LIFT_EEF_UP: 0.105,  # Height that counts as picked up, plus the arm's error.
        Primitive.LIFT_EEF_DOWN: 0.05,
        Primitive.MOVE_EEF_FORWARD: 0.10,
        Primitive.MOVE_BASE_FORWARD: 0.30,  # From before a compartment into it.
    }
)
"""Distances of moves whose number the flow leaves open."""


def navigate_to_target(session: Session, action: Action) -> StepResult:
    """Drive to where the hand is straight before the one pose of the constraints."""
    left = leave(session)
    if left.failure is not None:
        return replace(left, action=action)
    session = left.session
    session.sync_planner()
    stance = _constrained_stance(session)
    if isinstance(stance, Failure):
        return session.done(action, failure=stance)
    plan = replace(session.plan, stance=stance, journey=None)
    if isinstance(stance.followup, Lift):
        plan = plan.with_numbers((step for step, _ in moves_after(session, Primitive.GRASP)), stance.followup.moves)
    return drive_to_stance(replace(session, plan=plan), stance.approach[0], action)


def stroke(session: Session, action: Action) -> StepResult:
    """Move the hand that holds a handle straight along the handle's direction, or against it, whatever it meets.

    An early end is no failure: the goal judges the joint's position.
    """
    target, handle = session.subtask.target, handle_in_use(session)
    if handle is None or session.hand.gripped != target:
        message = f"the gripper does not hold a handle of {target}"
        return session.done(action, failure=Failure(FailureKind.PRECONDITION, message))
    world = session.world
    joint = world.assets[target].joint(handle.joint)
    before = joint.fraction(world.joint_position(target, joint.name))
    outward = world.T_world_link(target, handle.link)[:3, :3] @ np.array(handle.outward)
    sign = 1.0 if action.primitive is Primitive.ARTICULATE_OPEN else -1.0
    session.sync_planner()
    monitor = session.monitor(handle_contacts(session.planner.robot, target, handle), gripped=target)
    path = base_move(session.q, STROKE_M, heading_of(sign * outward))
    if session.control.follow(path, speed=STROKE_SPEED, monitor=monitor) is not None:
        session.control.rest()
    session.control.settle(SETTLE_S)
    position = world.joint_position(target, joint.name)
    reached = joint.fraction(position)
    measured = JointMotion(
        joint=joint.name,
        motion="stroke",
        fraction_before=round(before, 4),
        fraction_asked=round(end_fractions(session.planner.robot, action, joint, before)[0], 4),
        fraction_reached=round(reached, 4),
        joint_reached=round(position, 4),
    )
    session = replace(session, plan=session.plan.without_swing())
    return session.done(replace(action, parameter=interval(before, reached)), measured)


def navigate_to_support(session: Session, action: Action) -> StepResult:
    """Drive to where the fixed moves that follow bring the held item over the middle of its place."""
    support = support_of(session.subtask)
    session.sync_planner()
    measured = SupportDrive(support)
    goals = _placing(session, support)
    if isinstance(goals, Failure):
        return session.done(action, measured, failure=goals)
    steps = moves_before(session, Primitive.UNGRASP)
    moves = _with_fixed_numbers([move for _, move in steps])
    stance = stance_before(session, goals, 0.0, None)
    entry = None if stance is None else undo_moves(session.planner, stance.q, list(moves))
    if entry is None:
        return session.done(action, measured, failure=unreachable_failure(session, support))
    plan = session.plan.with_numbers((step for step, _ in steps), moves)
    return drive_to_stance(replace(session, plan=plan), entry, action, measured)


LIBRARY_OF_CONSTRAINTS: Mapping[Primitive, Runner] = MappingProxyType(
    {
        **LIBRARY,
        Primitive.NAVIGATE_TO_TARGET: navigate_to_target,
        Primitive.APPROACH: approach_by(navigate_to_target),
        Primitive.ARTICULATE_OPEN: stroke,
        Primitive.ARTICULATE_CLOSE: stroke,
        Primitive.NAVIGATE_TO_SUPPORT: navigate_to_support,
    }
)
"""Every primitive with its runner in the manner of GenSim2."""


def _constrained_stance(session: Session) -> Stance[Any] | Failure:
    """Return the stance whose hand satisfies the target's constraints, or the reason why there is none."""
    world, target = session.believed, session.subtask.target
    asset = world.assets[target]
    articulation = next_of(session, Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)
    if articulation is not None and asset.handles:
        action = articulation[1]
        opens = action.primitive is Primitive.ARTICULATE_OPEN
        handle = (handles_to_open(world, target, session.later) if opens else handles_to_close(world, target))[0]
        joint = asset.joint(handle.joint)
        now = joint.fraction(world.joint_position(target, joint.name))
        followup: Swing | Lift = Swing(end_fractions(session.planner.robot, action, joint, now)[0], handle)
        goals = handle_goals(handle, world.T_world_link(target, handle.link))[:1]
    elif asset.motion == "dynamic":
        if (failure := misfit(target, asset, session.gripper)) is not None:
            return failure
        fits, T_item = fits_between(asset, session.gripper), world.T_world_link(target)
        goals = _facing_robot(
            item_goals(session.planner.robot.hand, asset, T_item) if fits else rim_goals(asset, T_item),
            session.q,
            T_item,
        )
        followup = Lift(
            _with_fixed_numbers([move for _, move in moves_after(session, Primitive.GRASP)]), at_rim=not fits
        )
    else:
        message = f"{target} has no handle and is no item: the hand has nothing to go to"
        return Failure(FailureKind.PRECONDITION, message)
    stance = stance_before(session, goals, BEFORE_M, followup)
    return stance if stance is not None else unreachable_failure(session, target)


def _facing_robot(goals: list[HandGoal], q: Array, T_item: Array) -> list[HandGoal]:
    """Return the hand poses of the preferred tilt, those that face the robot first: the turn is free."""
    heading, preferred = heading_of(T_item[:2, 3] - q[:2]), min((goal.cost for goal in goals), default=0.0)
    kept = [goal for goal in goals if goal.cost == preferred]
    return sorted(kept, key=lambda goal: abs(wrap_angle(goal.heading_rad - heading)))


def _with_fixed_numbers(moves: list[Action]) -> tuple[Action, ...]:
    return tuple(
        move if move.parameter is not None else replace(move, parameter=FIXED_M.get(move.primitive, 0.1))
        for move in moves
    )


def _placing(session: Session, support: str) -> list[HandGoal] | Failure:
    """Return the hand poses with the held item over the middle of its place, as it is in the hand; or a failure."""
    carried, regions = session.planner.oracle.carried, regions_for(session.world, session.subtask)
    if carried is None or not regions:
        message = "nothing is held" if carried is None else f"{support} has no place for anything"
        return Failure(FailureKind.PRECONDITION, message)
    T_eef = session.planner.kinematics.forward(session.q)
    T_item = T_eef @ carried.T_eef_object
    came_from = heading_of_hand(T_eef, T_eef[:3, 3] + rotation_z(float(session.q[2]))[:, 0])
    goals = []
    for point, heading in _keypoints(session, support, max(regions, key=lambda r: float(np.prod(r.half_extents_m)))):
        turn = rotation_z(heading - came_from)
        lowest_m = float(bounds(session.world.assets[carried.object_id], turn @ T_item[:3, :3])[0][2])
        place = point - np.array([0.0, 0.0, lowest_m - OVER_M])
        hand = place - turn @ (T_item[:3, 3] - T_eef[:3, 3])
        goals.append(HandGoal(transform(turn @ T_eef[:3, :3], hand), heading))
    return goals


def _keypoints(session: Session, support: str, region: Region) -> list[tuple[Array, float]]:
    """Return points (3,) on the floor of a place, each with the heading that leads there.

    A place that opens to the side has one. One that opens upwards is reached from four sides, the robot's first.
    """
    T = session.world.T_world_link(support, region.link)
    half = np.array(region.half_extents_m)
    floor = (T @ np.array([*region.center_m, 1.0]))[:3] - np.array([0.0, 0.0, half[2]])
    opening = np.array(region.opening)
    if region.kind == "interior" and abs(opening[2]) < 0.5:
        return [(floor, heading_of(-(T[:3, :3] @ opening)))]
    to_robot = session.q[:2] - floor[:2]
    found = []
    for side in sorted(_SIDES, key=lambda s: -float((T[:3, :3] @ s)[:2] @ to_robot)):
        outward = T[:3, :3] @ side
        aside_m = max(float(half @ np.abs(side)) - FROM_THE_EDGE_M, 0.0) if region.kind == "surface" else 0.0
        found.append((floor + aside_m * outward, heading_of(-outward)))
    return found
