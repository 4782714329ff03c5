"""NAVIGATE_TO_SUPPORT: drive to where the flow's next moves put the held thing into or onto a support.

Numbers that the flow gives are kept, open ones are chosen here. Where given numbers lead to no free spot from anywhere,
the robot stands before the support at a nominal place and the numbers run all the same.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from executor.geometry import Array, heading_of
from executor.planning.drives import Drive, drive_to
from executor.planning.place_search import PlacePlan, PlaceSearch
from executor.planning.placements import leaning_rad
from executor.planning.planner import MOVES
from executor.planning.whereabouts import ends_at_side
from executor.records import Failure, FailureKind
from executor.skills.navigate import (
    CANDIDATES,
    Step,
    distinct_first,
    follow_legs,
    leave,
    nearest_home,
    regions_for,
    support_of,
)
from executor.skills.session import Session, StepResult
from oag import Action, Primitive
from oag.measurements import SupportDrive

NOMINAL = "nominal: the flow's numbers reach no free spot"
NOMINAL_GAPS_M = (0.30, 0.40, 0.20, 0.50)  # From the hand to the place, the preferred one first.
SIDES = tuple(np.array(side, dtype=float) for side in ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0)))
_CORRECTING = (
    Primitive.MOVE_EEF_FORWARD,
    Primitive.MOVE_EEF_BACKWARD,
    Primitive.MOVE_EEF_LEFT,
    Primitive.MOVE_EEF_RIGHT,
)


def moves_before(session: Session, primitive: Primitive) -> list[Step]:
    """Return the parameterised moves between the running step and the next action of a kind, with step indices."""
    moves: list[Step] = []
    for index in range(session.step + 1, len(session.flow)):
        if session.flow[index].primitive is primitive:
            return moves
        if session.flow[index].primitive in MOVES:
            moves.append((index, session.flow[index]))
    return []


def planned_moves(moves: list[Step]) -> list[Step]:
    """Return the moves that planning ahead counts: all but the corrections.

    Straight sideways or forward moves of the hand between two LIFT_EEF_DOWN are corrections of the place, made over it.
    Counted in, they would be planned away: the base would stand elsewhere, and the thing would end where it did before.
    """
    lowered = [place for place, (_, action) in enumerate(moves) if action.primitive is Primitive.LIFT_EEF_DOWN]
    return [
        (index, action)
        for place, (index, action) in enumerate(moves)
        if not lowered
        or not lowered[0] < place < lowered[-1]
        or action.primitive not in _CORRECTING
        or not isinstance(action.parameter, int | float)
    ]


def _arm_at_place(chosen: tuple[PlacePlan, Drive] | None) -> Array | None:
    return None if chosen is None else np.asarray(chosen[0].entry[chosen[0].robot.arm])


def navigate_to_support(session: Session, action: Action) -> StepResult:
    """Drive to where the flow's next moves put the held thing into or onto the support."""
    support = support_of(session.subtask)
    left = leave(session)
    if left.failure is not None:
        return replace(left, action=action)
    session = left.session
    session.sync_planner()
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
        is_open = holds and any(move.parameter is None for move in moves)
        if is_open and not session.planner.robot.keeps_order:
            # What has no place is not driven before one: the next move would have no number.
            measured = measured if search.stays_nowhere else replace(measured, stance=NOMINAL)
            return session.done(action, measured, failure=search.explain_failure(moves))
        nominal = _nominal(session, support)
        if nominal is None:
            message = f"no free place to stand before {support}"
            return session.done(action, measured, failure=Failure(FailureKind.NO_PATH, message, (measured,)))
        journey = nominal
        if is_open:
            session = replace(session, plan=replace(session.plan, unplaced=search.explain_failure(moves)))
        measured = replace(measured, stance=NOMINAL)
    start = session.q
    failure = follow_legs(session, journey.legs)
    if failure is None:
        measured = replace(measured, beside_m=session.drift(start))
    return session.done(action, measured, failure=failure)


def _search(session: Session, support: str) -> PlaceSearch:
    regions, assets = regions_for(session.world, session.subtask), session.believed.assets
    later = {one.target for one in session.later if one.support_goal == support} - {session.subtask.target}
    to_come_m = max((max(assets[name].extent_m[:2]) for name in later if name in assets), default=0.0)
    where, item = session.subtask.where, session.subtask.target
    ends = ends_at_side(session.believed, item, where) if where is not None and where.other else None
    return PlaceSearch(session.planner, session.believed, support, regions, session.q, to_come_m, ends)


def _placement(session: Session, search: PlaceSearch, moves: tuple[Action, ...]) -> tuple[PlacePlan, Drive] | None:
    """Return the first good placement that a free path leads to, what the dry run chose before all others; or None."""
    anchor = session.believed.T_world_link(search.support)
    for choice in session.kept_for_step():
        with session.planner.narrowed_to(choice, anchor):
            found = _first_placed(session, search, moves)
        if found is not None:
            return found
    return _first_placed(session, search, moves)


def _first_placed(session: Session, search: PlaceSearch, moves: tuple[Action, ...]) -> tuple[PlacePlan, Drive] | None:
    for plan in itertools.islice(distinct_first(search.plans(moves)), CANDIDATES):
        journey = drive_to(session.planner, session.q, plan.entry)
        if journey is not None:
            session.planner.choose(session.step, plan.path[-1], session.believed.T_world_link(search.support))
            return plan, journey
    return None


def _nominal(session: Session, support: str) -> Drive | None:
    world, planner, q = session.believed, session.planner, session.q
    regions = regions_for(session.world, session.subtask)
    if not regions:
        return None
    T = world.T_world_link(support, regions[0].link)
    centre = (T @ np.array([*regions[0].center_m, 1.0]))[:3]
    half = np.array(regions[0].half_extents_m)
    opening = np.array(regions[0].opening)
    T_base_eef = planner.kinematics.forward(np.concatenate([np.zeros(3), q[3:]]))  # Lift and arm as they are.
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
