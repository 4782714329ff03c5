"""Pushing: a thing goes straight along what it stands on, until it is at the side of another one that a subtask names.

Nothing is taken, so that it may be wider than the gripper opens. APPROACH brings the hand over the place behind it,
CONVERGE down to there, and MOVE_EEF_FORWARD makes the stroke: the fingers, on both sides of its middle, press
it on. Ends are searched all around the other thing, the nearest first; the whole stroke has to be free for the hand and
for the thing, and its end on the surface.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from executor.assets.asset_geometry import bounds, rolls_freely
from executor.geometry import Array, hand_rotation, heading_of, inverse, rotation_z, transform, wrap_angle
from executor.planning.cargo import HELD, cargo_of, carried_by, touching_any
from executor.planning.collision import Allowed, fingers_may_touch, held_may_touch
from executor.planning.stances import HandGoal, Stance, search_stances
from executor.planning.whereabouts import is_at_side
from executor.records import Failure, FailureKind
from executor.sim.detectors import box_around
from executor.skills.session import Session, StepResult
from oag import Action, Primitive, SimpleTask
from oag.measurements import MoveMeasured, SideEffect, Unplanned

PITCHES_DEG = (75.0, 60.0, 85.0, 45.0)
"""Downward tilts of the hand, the preferred one first."""

FACING_DEG = (0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0)
"""Headings of the base off the push: from the side or the front of the thing, the hand reaches over it."""

BEHIND_M = 0.015  # The fingers come down so far behind the thing.
OFF_THE_SURFACE_M = 0.005
PUSHED_AT = 0.35  # Of the thing's height.
SLENDER = 0.3
"""The push is no higher than this share of the thing's depth: with a friction of up to 1.6 that tips nothing over."""

DIRECTIONS, MOST_STROKES_TRIED = 72, 5
OTHER_RAD = np.deg2rad(15.0)  # Pushes that differ by less share their obstacles.
ASKEW_RAD, ASKEW_M_PER_RAD = np.deg2rad(20.0), 0.3
"""How far off square to a thing's side a push may be, and which distance a radian of it counts for: between the fingers
the side turns square to the push. What is round has no side."""

MOST_M, LEAST_M = 0.6, 0.01
TIPPED_COSINE = 0.95  # Of 18 degrees.
APART_M = 0.015  # What is left between the two.
STEP_M = 0.005
STROKE_COST = 0.05  # In rad of joint margin, for each stroke that comes first.
CLEARANCE_M = 0.001
PASSING_M = 0.01  # Of the thing from others on its way: it turns a little between the fingers.
SPEED = 0.3
MOST_STROKES = 4  # A hollow thing is met later than its box.
BACK_M = 0.02
FOOT_OFF_M = 0.02  # Of the foot of what stands on a surface from its height: boards are ten times as far apart.
_MOST_NAMED = 3


@dataclass(frozen=True, slots=True)
class Stroke:
    """A straight push of a thing.

    Attributes:
        direction: (3,) unit vector in the world, level.
        end: (3,) where the middle of the thing's box is meant to come.
        distance_m: How far the thing goes.
    """

    direction: Array
    end: Array
    distance_m: float

    @property
    def heading_rad(self) -> float:
        """Where it leads."""
        return float(np.arctan2(self.direction[1], self.direction[0]))


def pushes(subtask: SimpleTask) -> bool:
    """Decide whether a subtask brings a thing beside another one without taking it."""
    primitives = {action.primitive for action in subtask.flow or ()}
    has_neighbour = subtask.where is not None and bool(subtask.where.other)
    return has_neighbour and Primitive.APPROACH in primitives and Primitive.GRASP not in primitives


def unpushable(session: Session) -> str | None:
    """Return why a thing is not pushed wherever the hand goes; None where it may be."""
    world, support = session.believed, session.subtask.support_goal
    if rolls_freely(world.assets[session.subtask.target]):
        return "it rolls, and does not stay where the hand leaves it"
    if support in world.dynamic_ids:
        return f"{support} is loose, and would go along with what is pushed on it"
    return None


def push_search(session: Session) -> PushSearch:
    """Return the search among the pushes that end at the named side of the other thing, whole on its surface.

    Items that bar a push are counted as met, so that they can be named and moved aside.
    """
    world, subtask = session.believed, session.subtask
    where, support = subtask.where, subtask.support_goal
    search = PushSearch(session, [])
    if where is None or support is None or unpushable(session) is not None:
        return search
    (at, half), (other, room) = (box_around(world, name) for name in (subtask.target, where.other))
    yaw_rad, found = world.scene.robot.yaw_rad, list[tuple[float, Stroke]]()
    for angle in 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        aside = np.array([np.cos(angle), np.sin(angle), 0.0])
        end = other + _apart_m(aside, half + room) * aside
        end[2] = at[2]
        distance_m = float(np.hypot(*(end - at)[:2]))
        is_meant = is_at_side(end, half, other, room, where, yaw_rad)
        if is_meant and LEAST_M <= distance_m <= MOST_M and _is_on(session, support, end, half):
            stroke = Stroke((end - at) / distance_m, end, distance_m)
            askew_rad = _askew_rad(session, stroke)
            if askew_rad <= ASKEW_RAD:
                found.append((distance_m + ASKEW_M_PER_RAD * askew_rad, stroke))
    for _, stroke in sorted(found, key=lambda each: each[0]):
        if len(search.strokes) == MOST_STROKES_TRIED:
            break
        if all(_turn_rad(stroke.heading_rad, one.heading_rad) > OTHER_RAD for one in search.strokes):
            barring = _barring(session, stroke, half)
            search.met.update(f"{subtask.target} and {name}" for name in barring)
            if not barring:
                search.strokes.append(stroke)
    return search


def _turn_rad(one: float, other: float) -> float:
    return abs(wrap_angle(one - other))


def _barring(session: Session, stroke: Stroke, half: Array) -> list[str]:
    """Return the items whose boxes a thing's own does not go past, which no search of a stance changes."""
    world, thing = session.believed, session.subtask.target
    left_m = np.linspace(stroke.distance_m, 0.0, int(stroke.distance_m / STEP_M) + 2)
    way = stroke.end - left_m[:, None] * stroke.direction
    beneath_m = way[0, 2] - half[2] + STEP_M
    found = []
    for name in world.dynamic_ids:
        middle, room = box_around(world, name)
        if name == thing or middle[2] + room[2] < beneath_m or name in cargo_of(world, thing):
            continue
        gaps_m = np.linalg.norm(np.maximum(np.abs(way - middle) - half - room, 0.0), axis=1)
        # What stands closer at first is left; it comes no closer.
        if gaps_m.min() < min(PASSING_M, gaps_m[0]):
            found.append(name)
    return found


def _askew_rad(session: Session, stroke: Stroke) -> float:
    """Return how far off square to the nearest side of the thing a push is; 0 for what is round from above."""
    thing = session.subtask.target
    if session.believed.assets[thing].symmetric_about_z:
        return 0.0
    off_rad = stroke.heading_rad - heading_of(session.believed.T_world_link(thing)[:3, 0])
    quarter = np.pi / 2
    return float(abs((off_rad + quarter / 2) % quarter - quarter / 2))


def _apart_m(aside: Array, reach: Array) -> float:
    """Return how far apart the middles of two boxes are in a direction when they leave each other `APART_M`."""
    away_m = np.arange(0.0, float(np.hypot(*reach[:2])) + 2 * APART_M, STEP_M / 2)
    gaps = np.maximum(np.abs(away_m[:, None] * aside[None, :2]) - reach[:2], 0.0)
    return float(away_m[np.argmax(np.hypot(*gaps.T) >= APART_M)])


def _is_on(session: Session, support: str, end: Array, half: Array) -> bool:
    """Return whether a box stands whole on a surface of a support."""
    world = session.believed
    for region in world.assets[support].regions:
        T_link_world = inverse(world.T_world_link(support, region.link))
        foot = (T_link_world @ np.array([end[0], end[1], end[2] - half[2], 1.0]))[:3]
        off = np.abs(foot - np.array(region.floor_m))
        spare = np.array(region.half_extents_m)[:2] - np.abs(T_link_world[:2, :2]) @ half[:2]
        if region.kind == "surface" and (off[:2] <= spare).all() and off[2] < FOOT_OFF_M:
            return True
    return False


@dataclass
class PushSearch:
    """Search for a stance from which the arm can push the subtask's target to where it belongs.

    Attributes:
        session: The execution's state, its planner synchronised.
        strokes: The pushes that will do, the preferred one first.
        met: The bodies that were in the way of strokes, with counts.
    """

    session: Session
    strokes: list[Stroke]
    met: Counter[str] = field(default_factory=Counter)

    def stances(self) -> Iterator[Stance[Stroke]]:
        """Yield stances for all strokes, good ones first."""
        session, thing, found = self.session, self.session.subtask.target, self.strokes
        planner, oracle, touch = session.planner, session.planner.oracle, may_touch(session)
        goals = [goal for rank, stroke in enumerate(found) for goal in _hand_goals(session, stroke, STROKE_COST * rank)]
        cargo = cargo_of(session.believed, thing)
        resting = held_may_touch(touching_any(session.believed, (thing, *cargo)))

        def validate(q: Array) -> tuple[Stroke, float] | None:
            T_hand = planner.kinematics.forward(q)
            stroke = min(found, key=lambda one: _turn_rad(one.heading_rad, heading_of(T_hand[:3, 2])))
            opening_m, T_touch = finger_m(session, stroke), moved(T_hand, BEHIND_M * stroke.direction)
            to_thing = planner.line(q, T_touch).path
            if to_thing is None or self._meets(to_thing, opening_m, touch):
                return None
            pushing = planner.line(to_thing[-1], moved(T_touch, stroke.distance_m * stroke.direction)).path
            if pushing is None:
                return None
            oracle.carried = carried_by(session.believed, thing, T_touch, cargo)
            try:
                return None if self._meets(pushing, opening_m, touch | resting) else (stroke, 0.0)
            finally:
                oracle.carried = None

        here = session.q[planner.robot.base]
        return search_stances(planner, goals, here, validate=validate, turns_rad=(0.0,))

    def _meets(self, path: Array, opening_m: float, allowed: Allowed) -> bool:
        """Return whether anything is too near on a path, and count what."""
        oracle = self.session.planner.oracle
        for q in path:
            for hit in oracle.hits(q, opening_m=opening_m, allowed=allowed, margin_m=PASSING_M):
                if hit.mover == HELD or hit.separation_m < CLEARANCE_M:
                    self.met[f"{hit.mover} and {hit.other}"] += 1
                    return True
        return False

    def explain_failure(self) -> Failure:
        """Return why no stance was found."""
        subtask, found = self.session.subtask, self.strokes
        where, thing, support = subtask.where, subtask.target, subtask.support_goal
        named = [name for name, _ in self.met.most_common()]
        if (reason := unpushable(self.session)) is not None:
            unplanned = Unplanned(target=thing, support=support)
            return Failure(FailureKind.PRECONDITION, f"{thing} is not pushed {where}: {reason}", (unplanned,))
        # The thing that the spot is beside stays: somewhere else it would be another spot.
        other = "" if where is None else str(where.other)
        movable = tuple(name for name in named if other not in (part.partition("/")[0] for part in name.split()))
        unplanned = Unplanned(target=thing, support=support, in_the_way=movable[:_MOST_NAMED] or None)
        if named:
            met = (movable or named)[0]
            return Failure(FailureKind.NO_PATH, f"no way to push {thing} {where}: {met} meet", (unplanned,))
        if not found:
            message = f"no straight push of at most {MOST_M:g} m along {support} brings {thing} {where}"
            return Failure(FailureKind.NO_PATH, message, (unplanned,))
        message = f"the arm reaches no place behind {thing} from which it pushes it {where} ({len(found)} directions)"
        return Failure(FailureKind.UNREACHABLE, message, (unplanned,))


def _hand_goals(session: Session, stroke: Stroke, stroke_cost: float) -> list[HandGoal]:
    """Return hand poses behind a thing, for a base that faces any way."""
    thing = session.subtask.target
    hand, T = session.planner.robot.hand, session.believed.T_world_link(thing)
    asset = session.believed.assets[thing]
    (behind_m, *_), (front_m, *_) = bounds(asset, rotation_z(-stroke.heading_rad) @ T[:3, :3])
    low, high = bounds(asset, T[:3, :3])
    push_m = min(PUSHED_AT * float(high[2] - low[2]), SLENDER * float(front_m - behind_m))
    goals = []
    for (rank, pitch), facing in product(enumerate(np.deg2rad(PITCHES_DEG)), np.deg2rad(FACING_DEG)):
        ahead_m = hand.finger_half_m * np.sin(pitch) + hand.fingertip_m * np.cos(pitch)
        drop_m = hand.fingertip_m * np.sin(pitch) + hand.finger_half_m * np.cos(pitch)
        point = T[:3, 3] + (behind_m - ahead_m - BEHIND_M) * stroke.direction
        point[2] = T[2, 3] + low[2] + max(OFF_THE_SURFACE_M + drop_m, push_m)
        cost = stroke_cost + 0.02 * rank + 0.05 * abs(float(facing))
        T_hand = transform(hand_rotation(stroke.heading_rad, float(pitch)), point)
        goals.append(HandGoal(T_hand, stroke.heading_rad + float(facing), cost))
    return goals


def finger_m(session: Session, stroke: Stroke) -> float:
    """Return the position of each finger [m]: a quarter of the thing's width off its middle, if it opens so far."""
    thing = session.subtask.target
    R = rotation_z(-stroke.heading_rad) @ session.believed.T_world_link(thing)[:3, :3]
    low, high = bounds(session.believed.assets[thing], R)
    return float(min((high[1] - low[1]) / 4.0, session.planner.kinematics.finger_upper_m))


def may_touch(session: Session) -> Allowed:
    """Return the intended contacts: of the fingers and the hand with the thing."""
    return fingers_may_touch(session.planner.robot, session.subtask.target, hand=True)


def moved(T: Array, by_m: Array) -> Array:
    """Return a pose moved in the world."""
    T = T.copy()
    T[:3, 3] += by_m
    return T


def push(session: Session, action: Action) -> StepResult:
    """Press the thing on by the planned stroke, or move the hand by the action's number, and back off a little."""
    stance, thing = session.plan.stance, session.subtask.target
    stroke = None if stance is None else stance.followup
    if not isinstance(stroke, Stroke):
        message = f"{action.primitive.name} pushes {thing}, and nothing was planned for it"
        return session.done(action, failure=Failure(FailureKind.PRECONDITION, message, (Unplanned(target=thing),)))
    given = action.parameter if isinstance(action.parameter, int | float) else None
    amount_m = BEHIND_M + stroke.distance_m if given is None else float(given)
    session.sync_planner()
    before = session.planner.kinematics.forward(session.control.q)[:3, 3]
    failure = press_on(session, stroke, amount_m, most_strokes=MOST_STROKES if given is None else 1)
    after = session.planner.kinematics.forward(session.control.q)[:3, 3]
    measured = MoveMeasured(asked_m=round(amount_m, 4), eef_moved_m=round(float(np.linalg.norm(after - before)), 4))
    return let_go(session).done(replace(action, parameter=round(amount_m, 4)), measured, failure=failure)


def press_on(session: Session, stroke: Stroke, amount_m: float, *, most_strokes: int = MOST_STROKES) -> Failure | None:
    """Press a thing on from behind it, and back off a little; return why that ended early, or None.

    Args:
        stroke: Where the thing goes.
        amount_m: How far the hand moves first; further strokes take the thing on to where it is meant to come.
        most_strokes: How many strokes are made at most.
    """
    thing = session.subtask.target
    up = session.world.T_world_link(thing)[:3, 2]
    session.control.grip(finger_m(session, stroke))
    failure, hand_m, thing_m = None, amount_m, max(amount_m - BEHIND_M, 0.0)
    for _ in range(most_strokes):
        failure = _stroke(session, stroke, hand_m, thing_m)
        turned = float(up @ session.world.T_world_link(thing)[:3, 2]) < TIPPED_COSINE
        if failure is None and turned and not rolls_freely(session.world.assets[thing]):
            failure = Failure(FailureKind.SIDE_EFFECT, f"{thing} tips over", (SideEffect(thing, 0.0, True),))
        hand_m = thing_m = float((stroke.end - box_around(session.world, thing)[0]) @ stroke.direction)
        if failure is not None or hand_m < STEP_M:
            break
    if failure is None:
        failure = _stroke(session, replace(stroke, direction=-stroke.direction), BACK_M, 0.0)
        session.control.grip(session.planner.kinematics.finger_upper_m)
    return failure


def let_go(session: Session) -> Session:
    """Return the session after a push, whose hand may touch the thing while it leaves."""
    hand = replace(session.hand, released=may_touch(session))
    return replace(session, hand=hand, handled=session.handled | {session.subtask.target})


def _stroke(session: Session, stroke: Stroke, hand_m: float, thing_m: float) -> Failure | None:
    """Move the hand straight by a distance, which is meant to take the thing along by another one."""
    thing = session.subtask.target
    T_hand = moved(session.planner.kinematics.forward(session.q), hand_m * stroke.direction)
    line = session.planner.line(session.q, T_hand)
    if line.path is None:
        message = f"the arm does not reach {hand_m:.2f} m on behind {thing}"
        return Failure(FailureKind.UNREACHABLE, message, (Unplanned(target=thing),))
    T_thing = moved(session.world.T_world_link(thing), thing_m * stroke.direction)
    monitor = session.monitor(may_touch(session))
    return session.control.follow(line.path, speed=SPEED, monitor=monitor, carries=(thing, T_thing))
