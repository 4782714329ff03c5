"""NAVIGATE_TO_SUPPORT: drive to where the flow's next moves put the held thing into or onto its support.

Numbers that the flow gives are kept, open ones are chosen here. Where the given numbers lead to no free spot from
anywhere, the robot stands before the support at a nominal place and the numbers run all the same.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from executor.geometry import heading_of
from executor.motion.placing.place import leaning_rad
from executor.motion.placing.search import PlacePlan, PlaceSearch
from executor.motion.planning.carry import Drive, drive_to
from executor.primitives.driving import (
    CANDIDATES,
    elsewhere_first,
    follow_legs,
    moves_before,
    planned_moves,
    regions_for,
    support_of,
)
from executor.primitives.leave import leave
from executor.primitives.session import Outcome, Session
from executor.records.rollout import Failure, FailureKind
from oag import Action, Primitive
from oag.revision.measurements import SupportDrive

NOMINAL = "nominal: the flow's numbers reach no free spot"
NOMINAL_GAPS_M = (0.30, 0.40, 0.20, 0.50)
SIDES = tuple(np.array(side, dtype=float) for side in ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0)))


def navigate_to_support(session: Session, action: Action) -> Outcome:
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
    chosen = _placement(session, search, moves) if holds else None
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
