"""NAVIGATE_TO_TARGET and NAVIGATE_TO_SUPPORT: drive to where what the flow does next can be done.

At a target the stance is chosen together with the grasp and with what comes after it: an arc of the door, or a lift.
At a support it is where the next moves put the held thing into or onto it. Numbers that the flow gives are kept, open
ones are chosen here; where given numbers lead to no free spot from anywhere, the robot stands before the support at a
nominal place and the numbers run all the same.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from executor.assets.model import Handle
from executor.geometry import Array, heading_of, wrap_angle
from executor.motion.articulation.doors import Purpose, handles_to_close, handles_to_open, put_inside
from executor.motion.articulation.ways import articulation_stances, why_not
from executor.motion.articulation.work import Work
from executor.motion.grasping.grasps import item_goals
from executor.motion.grasping.reach import (
    HIGH_LIFTS_M,
    LIFTS_M,
    LOW_LIFTS_M,
    Lift,
    Pick,
    in_the_way,
    why_not_by_its_rim,
    why_not_taken,
)
from executor.motion.placing.onward import Onward
from executor.motion.placing.place import leaning_rad
from executor.motion.placing.search import PlacePlan, PlaceSearch
from executor.motion.planning.carry import Drive, drive_to
from executor.motion.planning.stance import Stance
from executor.primitives.driving import (
    ARTICULATIONS_LOOKED_AT,
    CANDIDATES,
    LOOKED_AT,
    elsewhere_first,
    fits_between,
    follow_legs,
    leave,
    misfit,
    moves_after,
    moves_before,
    nearest_home,
    next_of,
    planned_moves,
    regions_for,
    support_of,
)
from executor.primitives.session import Session, StepResult
from executor.records.rollout import Failure, FailureKind
from executor.robot.kinematics import ARM
from oag import Action, Primitive
from oag.revision.measurements import SupportDrive, TargetDrive, Unplanned

_NOT_HELD_UP = frozenset({Primitive.RETREAT, Primitive.UNGRASP})
NOMINAL = "nominal: the flow's numbers reach no free spot"
NOMINAL_GAPS_M = (0.30, 0.40, 0.20, 0.50)  # From the hand to the place, the preferred one first.
SIDES = tuple(np.array(side, dtype=float) for side in ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0)))


def navigate_to_target(session: Session, action: Action) -> StepResult:
    """Drives to a stance from which the target can be taken hold of, and what the flow does next can be done."""
    left = leave(session)
    if left.failure is not None:
        return replace(left, action=action)
    planned = nearest_home(left.session, lambda: with_stance(left.session), _arm_at_target)
    return left.session.done(action, failure=planned) if isinstance(planned, Failure) else _drive(planned, action)


def _arm_at_target(planned: Session | Failure) -> Array | None:
    stance = planned.plan.stance if isinstance(planned, Session) else None
    return None if stance is None else np.asarray(stance.q[ARM])


def _arm_at_place(chosen: tuple[PlacePlan, Drive] | None) -> Array | None:
    return None if chosen is None else np.asarray(chosen[0].entry[ARM])


def with_stance(session: Session) -> Session | Failure:
    """Chooses a stance at the target and the journey to it; returns the session with both, or why there is none."""
    session.look()
    world, planner, target = session.believed, session.planner, session.subtask.target
    asset = world.assets[target]
    articulation = next_of(session, Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)
    if articulation is not None and asset.handles:
        action = articulation[1]
        handles = _handles_for(session, action)
        where = f"the handle of {target}"
        serves = _purpose(session, action).serves
        ways = articulation_stances(planner, world, target, handles, action, session.q[:3], serves=serves)
        planned = adopt_first(session, ways)
    elif asset.motion == "dynamic":
        if (failure := misfit(target, asset, session.gripper)) is not None:
            return failure
        where = target
        planned = adopt_first(session, _picks(session))
    else:
        message = f"{target} has no handle and is no item: the hand has nothing to go to"
        return Failure(FailureKind.PRECONDITION, message, (Unplanned(target=target),))
    if isinstance(planned, Session):
        return planned
    if planned == 0:
        if articulation is not None and asset.handles:
            return why_not(Work(planner, world, target, handles[0], articulation[1]), session.q[:3])
        if not fits_between(asset, session.gripper):
            return why_not_by_its_rim(planner, world, target, session.q[:3])
        return why_not_taken(planner, target, item_goals(asset, world.T_world_link(target)), session.q[:3])
    blockers = in_the_way(planner, session.q, world.T_world_link(target)[:2, 3])
    near = f"; on the straight way there {' and '.join(blockers)} meet" if blockers else ""
    message = f"{planned} stances reach {where}, but no free way leads to any of them{near}"
    found = Unplanned(target=target, stances_tried=planned, in_the_way=blockers)
    return Failure(FailureKind.NO_PATH, message, (found,))


def _picks(session: Session) -> Iterator[Iterator[Stance[Lift]]]:
    """Yields the ways to take the target: around all of it where that fits the fingers, by its rim, then hard ones."""
    world, target = session.believed, session.subtask.target
    moves = tuple(action for _, action in moves_after(session, Primitive.GRASP))
    pick = Pick(session.planner, world, target, moves, session.q[:3], _lifts_m(session))
    fits = fits_between(world.assets[target], session.gripper)
    if fits:
        yield pick.stances(_leads_on(session))
    yield pick.rim_stances()
    if fits:
        yield pick.last_stances()


def _lifts_m(session: Session) -> tuple[float, ...]:
    """Returns how far the target may be lifted: a little is enough for what is put elsewhere or backed out with."""
    goes_on = any(later.target == session.subtask.target for later in session.later)
    if any(action.primitive in _NOT_HELD_UP for action in session.flow[session.step :]):
        return LOW_LIFTS_M
    return LIFTS_M if goes_on else HIGH_LIFTS_M


def _leads_on(session: Session) -> Callable[[Array], bool] | None:
    """Returns what tells hands that can put the target where a later subtask wants it; None where none says so."""
    world, target = session.believed, session.subtask.target
    for later in session.later:
        if later.target == target and later.support_goal in session.world.assets:
            goals = item_goals(world.assets[target], world.T_world_link(target))
            regions = regions_for(session.world, later)
            onward = Onward(session.planner, world, target, goals, later.support_goal, regions, session.q[:3])
            return onward.leads_on
    return None


def _purpose(session: Session, action: Action) -> Purpose:
    """Returns what an opening is for: later subtasks may put something inside."""
    world, target = session.believed, session.subtask.target
    item = put_inside(world, target, session.later) if action.primitive is Primitive.ARTICULATE_OPEN else None
    return Purpose(session.planner, world, target, action, item, session.q[:3])


def _handles_for(session: Session, action: Action) -> tuple[Handle, ...]:
    """Returns the handles that an articulation of the target may take, the preferred one first."""
    target = session.subtask.target
    if action.primitive is Primitive.ARTICULATE_CLOSE:
        return handles_to_close(session.believed, target)
    return handles_to_open(session.believed, target, session.later)


def adopt_first(session: Session, ways: Iterator[Iterator[Stance[Any]]]) -> Session | int:
    """Plans the first stance that a free way leads to; returns the session with it, or how many stances there were."""
    tried = 0
    unreached: list[Array] = []
    looked_at = LOOKED_AT if session.subtask.target in session.world.dynamic_ids else ARTICULATIONS_LOOKED_AT
    for stances in ways:
        for stance in itertools.islice(elsewhere_first(stances, unreached, looked_at), CANDIDATES):
            tried += 1
            journey = drive_to(session.planner, session.q, stance.approach[0])
            if journey is not None:
                return _adopted(session, stance, journey)
    return tried


def _adopted(session: Session, stance: Stance[Any], journey: Drive) -> Session:
    # The journey may count the base's yaw in another turn than the stance did.
    turned = stance.turned(float(journey.end[2] - stance.approach[0, 2]))
    plan = replace(session.plan, stance=turned, journey=journey)
    if isinstance(stance.followup, Lift):
        plan = plan.with_numbers((step for step, _ in moves_after(session, Primitive.GRASP)), stance.followup.moves)
    return replace(session, plan=plan)


def _drive(session: Session, action: Action) -> StepResult:
    """Drives the journey's legs but the last posture change, which belongs to APPROACH."""
    journey, stance = session.plan.journey, session.plan.stance
    if journey is None or stance is None:
        raise RuntimeError("a stance must be planned before it is driven to")
    legs = journey.legs
    last = legs[-1:] if legs[-1][0] == "take up the goal posture" else ()
    start = session.q
    failure = follow_legs(session, legs[: len(legs) - len(last)])
    if failure is None:
        session.drift(start)
    measured = TargetDrive(
        base_x_m=round(float(session.q[0]), 4),
        base_y_m=round(float(session.q[1]), 4),
        base_yaw_deg=round(float(np.rad2deg(wrap_angle(float(session.q[2])))), 2),
        joint_margin_deg=round(float(np.rad2deg(stance.margin_rad)), 1),
        legs=len(journey.legs),
    )
    plan = replace(
        session.plan,
        journey=Drive(last) if last else None,
        arrived_m=(float(session.q[0]), float(session.q[1])),
        aside_m=(0.0, 0.0),
    )
    return replace(session, plan=plan).done(action, measured, failure=failure)


def navigate_to_support(session: Session, action: Action) -> StepResult:
    """Drives to where the flow's next moves put the held thing into or onto the support."""
    support = support_of(session.subtask)
    left = leave(session)
    if left.failure is not None:
        return replace(left, action=action)
    session = left.session
    session.look()
    steps = planned_moves(moves_before(session, Primitive.UNGRASP))
    moves = tuple(move for _, move in steps)
    measured = SupportDrive(support)
    carried, holds = session.planner.oracle.carried, session.hand.held is not None
    if carried is not None:
        leaning = leaning_rad(session.believed.assets[carried.object_id], carried)
        measured = replace(measured, leaning_deg=round(float(np.rad2deg(leaning)), 1))
    search = _search(session, support)
    chosen = nearest_home(session, lambda: _placement(session, search, moves), _arm_at_place) if holds else None
    if chosen is not None:
        placing, journey = chosen
        session = replace(session, plan=session.plan.with_numbers((step for step, _ in steps), placing.moves))
        margin_deg = round(float(np.rad2deg(placing.margin_rad)), 1)
        measured = replace(measured, region=placing.region, joint_margin_deg=margin_deg)
    else:
        nominal = _nominal(session, support)
        if nominal is None:
            message = f"no free place to stand before {support}"
            return session.done(action, measured, failure=Failure(FailureKind.NO_PATH, message, (measured,)))
        journey = nominal
        if holds and any(move.parameter is None for move in moves):
            session = replace(session, plan=replace(session.plan, unplaced=search.why_not(moves)))
        measured = replace(measured, stance=NOMINAL)
    start = session.q
    failure = follow_legs(session, journey.legs)
    if failure is None:
        measured = replace(measured, beside_m=session.drift(start))
    return session.done(action, measured, failure=failure)


def _search(session: Session, support: str) -> PlaceSearch:
    regions = regions_for(session.world, session.subtask)
    return PlaceSearch(session.planner, session.believed, support, regions, session.q)


def _placement(session: Session, search: PlaceSearch, moves: tuple[Action, ...]) -> tuple[PlacePlan, Drive] | None:
    """Returns the first good placement that a free way leads to, or None."""
    for plan in itertools.islice(elsewhere_first(search.plans(moves)), CANDIDATES):
        journey = drive_to(session.planner, session.q, plan.entry)
        if journey is not None:
            return plan, journey
    return None


def _nominal(session: Session, support: str) -> Drive | None:
    """Returns a journey to a place that faces the support with the arm as it is, or None."""
    world, planner, q = session.believed, session.planner, session.q
    regions = regions_for(session.world, session.subtask)
    if not regions:
        return None
    T = world.T_world_link(support, regions[0].link)
    centre = (T @ np.array([*regions[0].center_m, 1.0]))[:3]
    half = np.array(regions[0].half_extents_m)
    opening = np.array(regions[0].opening)
    T_base_eef = planner.kinematics.forward(np.concatenate([np.zeros(3), q[3:]]))
    sides = (opening,) if abs(opening[2]) < 0.5 else SIDES
    for gap_m, side in itertools.product(NOMINAL_GAPS_M, sides):
        outward = T[:3, :3] @ side
        yaw = heading_of(-outward)
        hand = centre + outward * (float(half @ np.abs(side)) + gap_m)
        reach = np.hypot(*T_base_eef[:2, 3])
        base = np.array([hand[0] - reach * np.cos(yaw), hand[1] - reach * np.sin(yaw), yaw])
        journey = drive_to(planner, q, np.concatenate([base, q[3:]]))
        if journey is not None:
            return journey
    return None
