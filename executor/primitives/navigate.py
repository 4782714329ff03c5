"""NAVIGATE_TO_TARGET and NAVIGATE_TO_SUPPORT: drive to where the rest of the flow can be done.

Both look ahead. The stance at a target is chosen with the grasp and what follows it; the stance at a support is
chosen so that the flow's own numbers, or numbers found for the open ones, end over a free spot.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from bddl import atoms
from executor.assets.model import Region
from executor.geometry import Array, heading_of
from executor.motion.carry import Drive, drive_to
from executor.motion.moves import MOVES
from executor.motion.place import place_plans
from executor.motion.reach import Lift, articulation_stances, pick_stances
from executor.motion.stance import Stance
from executor.primitives.fit import misfit
from executor.primitives.leave import leave
from executor.records import Failure, FailureKind, JsonValue
from executor.session import Outcome, Session
from oag import Action, Primitive

CANDIDATES = 6
"""How many stances or placements are tried for a free way before giving up."""

DRIVE_SPEED = 1.0
ARM_SPEED = 0.8
NOMINAL_GAPS_M = (0.30, 0.40, 0.20, 0.50)


def navigate_to_target(session: Session, action: Action) -> Outcome:
    """Drives to a stance from which the target can be taken hold of, and what the flow does next can be done."""
    away = leave(session)
    if away is not None and away.failure is not None:
        return Outcome(action, away.measurements, away.failure)
    failure = plan_stance(session)
    if failure is not None:
        return Outcome(action, {}, failure)
    return _drive_pending(session, action)


def plan_stance(session: Session) -> Failure | None:
    """Chooses the session's stance at the target and the journey to it; returns why there is none, or None."""
    session.look()
    world, planner, target = session.world, session.planner, session.subtask.target
    asset = world.assets[target]
    stances: Iterator[Stance[Any]]
    articulation = _next(session, Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)
    if articulation is not None and asset.handles:
        where = f"the handle of {target}"
        stances = articulation_stances(planner, world, target, asset.handles[0], articulation[1], session.q[:3])
    elif asset.motion == "dynamic":
        if (failure := misfit(target, asset)) is not None:
            return failure
        where = target
        moves = _moves_after(session, Primitive.GRASP)
        stances = pick_stances(planner, world, target, tuple(a for _, a in moves), session.q[:3])
    else:
        return Failure(
            FailureKind.PRECONDITION,
            f"{target} has no handle and is no item: the hand has nothing to go to",
            {"target": target},
        )
    tried = 0
    for stance in stances:
        tried += 1
        journey = drive_to(planner, session.q, stance.approach[0])
        if journey is not None:
            _adopt(session, stance, journey)
            return None
        if tried == CANDIDATES:
            break
    if not tried:
        message = f"no stance reaches {where} with what the flow does next"
        return Failure(FailureKind.UNREACHABLE, message, {"target": target, "oracle_queries": planner.oracle.queries})
    message = f"{tried} stances reach {where}, but no free way leads to any of them"
    return Failure(FailureKind.NO_PATH, message, {"target": target, "stances_tried": tried})


def _adopt(session: Session, stance: Stance[Any], journey: Drive) -> None:
    # The journey may count the base's yaw in another turn than the stance did.
    shift = float(journey.end[2] - stance.approach[0][2])
    approach = stance.approach.copy()
    approach[:, 2] += shift
    q = stance.q.copy()
    q[2] += shift
    session.stance = Stance(q, approach, stance.margin_rad, stance.followup, stance.score)
    session.pending = journey
    if isinstance(stance.followup, Lift):
        indices = [index for index, _ in _moves_after(session, Primitive.GRASP)]
        for index, move in zip(indices, stance.followup.moves, strict=True):
            if isinstance(move.parameter, float | int):
                session.filled[index] = float(move.parameter)


def _drive_pending(session: Session, action: Action) -> Outcome:
    """Drives the journey's legs but the last posture change, which belongs to APPROACH."""
    journey = session.pending
    if journey is None or session.stance is None:
        raise RuntimeError("a stance must be planned before it is driven to")
    legs = list(journey.legs)
    last = legs[-1:] if legs[-1][0] == "take up the goal posture" else []
    failure = follow_legs(session, legs[: len(legs) - len(last)])
    session.pending = Drive(tuple(last)) if last else None
    measurements: dict[str, JsonValue] = {
        "base_x_m": round(float(session.q[0]), 4),
        "base_y_m": round(float(session.q[1]), 4),
        "base_yaw_deg": round(float(np.rad2deg(session.q[2])), 2),
        "joint_margin_deg": round(float(np.rad2deg(session.stance.margin_rad)), 1),
        "legs": len(journey.legs),
    }
    return Outcome(action, measurements, failure)


def follow_legs(session: Session, legs: list[tuple[str, Array]]) -> Failure | None:
    """Moves along the legs of a journey; returns why one ended early, or None."""
    for name, path in legs:
        speed = DRIVE_SPEED if name == "drive" else ARM_SPEED
        allowed = session.lifted_from if name == "back out" else frozenset()
        failure = session.control.follow(path, speed=speed, monitor=session.monitor(allowed))
        if failure is not None:
            return failure
    return None


def navigate_to_support(session: Session, action: Action) -> Outcome:
    """Drives to where the flow's next moves put the held thing into or onto the support."""
    support = session.subtask.support_goal or session.subtask.support_init or session.subtask.target
    if session.held is None:
        away = leave(session)
        if away is not None and away.failure is not None:
            return Outcome(action, away.measurements, away.failure)
    session.look()
    planner, world = session.planner, session.world
    moves = _moves_before(session, Primitive.UNGRASP)
    measurements: dict[str, JsonValue] = {"support": support}
    if session.held is not None:
        plans = place_plans(planner, world, support, _regions(session, support), tuple(a for _, a in moves), session.q)
        for tried, plan in enumerate(plans):
            journey = drive_to(planner, session.q, plan.entry)
            if journey is not None:
                failure = follow_legs(session, list(journey.legs))
                for (index, _), move in zip(moves, plan.moves, strict=True):
                    if isinstance(move.parameter, float | int):
                        session.filled[index] = float(move.parameter)
                measurements |= {
                    "region": plan.region,
                    "joint_margin_deg": round(float(np.rad2deg(plan.margin_rad)), 1),
                }
                return Outcome(action, measurements, failure)
            if tried + 1 == CANDIDATES:
                break
    # The numbers of the flow lead to no free spot from anywhere: stand before the support and let them run.
    nominal = _nominal(session, support)
    if nominal is None:
        message = f"no free place to stand before {support}"
        return Outcome(action, measurements, Failure(FailureKind.NO_PATH, message, {"support": support}))
    failure = follow_legs(session, list(nominal.legs))
    return Outcome(action, measurements | {"stance": "nominal: the flow's numbers reach no free spot"}, failure)


def _nominal(session: Session, support: str) -> Drive | None:
    """Returns a journey to a place that faces the support with the arm as it is, or None."""
    world, planner, q = session.world, session.planner, session.q
    regions = _regions(session, support)
    if not regions:
        return None
    T = world.T_world_link(support, regions[0].link)
    centre = (T @ np.array([*regions[0].center_m, 1.0]))[:3]
    half = np.array(regions[0].half_extents_m)
    opening = np.array(regions[0].opening)
    T_base_eef = planner.kinematics.forward(np.concatenate([np.zeros(3), q[3:]]))
    sides = (
        [opening] if abs(opening[2]) < 0.5 else [np.array(s) for s in ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0))]
    )
    for gap_m in NOMINAL_GAPS_M:
        for side in sides:
            outward = T[:3, :3] @ side
            yaw = heading_of(-outward)
            hand = centre + outward * (float(half @ np.abs(side)) + gap_m)
            reach = np.hypot(*T_base_eef[:2, 3])
            base = np.array([hand[0] - reach * np.cos(yaw), hand[1] - reach * np.sin(yaw), yaw])
            journey = drive_to(planner, q, np.concatenate([base, q[3:]]))
            if journey is not None:
                return journey
    return None


def _regions(session: Session, support: str) -> list[Region]:
    """Returns the support's regions that the goal is about: interiors for `inside`, else surfaces."""
    inside = any(a.predicate == "inside" and support in a.args[1:] for a in atoms(session.subtask.goal))
    kind = "interior" if inside else "surface"
    return [region for region in session.world.assets[support].regions if region.kind == kind]


def _next(session: Session, *primitives: Primitive) -> tuple[int, Action] | None:
    """Returns the next action of one of some kinds with its step index, the running step included, or None."""
    for index in range(session.step, len(session.flow)):
        if session.flow[index].primitive in primitives:
            return index, session.flow[index]
    return None


def _moves_after(session: Session, primitive: Primitive) -> list[tuple[int, Action]]:
    """Returns the unbroken run of parameterised moves after the next action of a kind, with step indices."""
    found = _next(session, primitive)
    moves: list[tuple[int, Action]] = []
    if found is not None:
        for index in range(found[0] + 1, len(session.flow)):
            if session.flow[index].primitive not in MOVES:
                break
            moves.append((index, session.flow[index]))
    return moves


def _moves_before(session: Session, primitive: Primitive) -> list[tuple[int, Action]]:
    """Returns the parameterised moves between the running step and the next action of a kind, with step indices."""
    moves: list[tuple[int, Action]] = []
    for index in range(session.step + 1, len(session.flow)):
        if session.flow[index].primitive is primitive:
            return moves
        if session.flow[index].primitive in MOVES:
            moves.append((index, session.flow[index]))
    return []

