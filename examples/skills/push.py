"""Give the robot a primitive of your own, down to the physics: PUSH a thing until it stands next to another one.

The row of PUSH is in `examples/domains/next_to.toml`, so that plans with it are proved. `push` is its skill: the
fingers go behind the thing, one on each side of its middle, and press it straight towards the other one, whatever the
direction and whether or not the gripper could close around it. A detector reads whether it got there. Needs the extra
`sim`.

    python examples/skills/push.py
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

import oag
from bddl import Atom
from executor import add_skill, feasible, rollout
from executor.assets.asset_geometry import bounds
from executor.geometry import Array, hand_rotation, rotation_z, transform
from executor.planning.cargo import cargo_of, carried_by, touching_any
from executor.planning.collision import Allowed, fingers_may_touch, held_may_touch
from executor.planning.stances import HandGoal, Stance, search_stances
from executor.records import Failure, FailureKind
from executor.scenes.file import complete_scene
from executor.sim.detectors import box_around, read
from executor.skills.navigate import adopt_first, follow_legs
from executor.skills.session import Session, StepResult
from oag.measurements import SideEffect, Unplanned
from oag.model.domain import own_of

TURNS_DEG = (0.0, 15.0, -15.0, 30.0, -30.0)
"""Directions of the push off the straight one, which comes first."""

PITCHES_DEG = (75.0, 60.0, 85.0, 45.0)
"""Downward tilts of the hand, the preferred one first."""

FACING_DEG = (0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0)
"""Headings of the base off the push: from the side or the front of the thing, the hand reaches over it."""

BEHIND_M = 0.015  # The fingers come down so far behind the thing.
OFF_THE_SURFACE_M = 0.005
PUSHED_AT = 0.35  # Of the thing's height.
SLENDER = 0.3
"""The push is no higher than this share of the thing's depth: with a friction of up to 1.6 that tips nothing over."""

TIPPED_COSINE = 0.95  # Of 18 degrees.
APART_M = 0.010  # What is left between the two.
STEP_M = 0.005
CLEARANCE_M = 0.001
SPEED = 0.3
MOST_STROKES = 4  # A hollow thing is met later than its box.
BACK_M = 0.02


@dataclass(frozen=True, slots=True)
class Stroke:
    """A straight push of a thing.

    Attributes:
        direction: (3,) unit vector in the world, level.
        distance_m: How far the thing goes.
    """

    direction: Array
    distance_m: float

    @property
    def heading_rad(self) -> float:
        """Where it leads."""
        return float(np.arctan2(self.direction[1], self.direction[0]))


def stroke_towards(session: Session, thing: str, other: str, heading_rad: float, most_m: float) -> Stroke | None:
    """Return the push along a heading that ends with a thing next to another one, or None where it leads past it."""
    (centre, half), (end, room) = (box_around(session.believed, name) for name in (thing, other))
    direction = np.array([np.cos(heading_rad), np.sin(heading_rad), 0.0])
    near_m = float(np.mean(half + room)) / 3.0  # As the detector of `nextto` has it.

    def gap_m(distance_m: float) -> float:
        apart = np.abs(centre + distance_m * direction - end) - half - room
        return float(np.hypot(*np.maximum(apart[:2], 0.0)))

    last = 0.0
    for distance_m in np.arange(0.0, most_m + STEP_M / 2, STEP_M):
        if gap_m(distance_m) < APART_M:
            break
        last = float(distance_m)
    return Stroke(direction, last) if gap_m(last) <= near_m else None


def hand_goals(session: Session, thing: str, stroke: Stroke) -> list[HandGoal]:
    """Return hand poses behind a thing, for a base that faces any way."""
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
        cost = 0.02 * rank + 0.05 * abs(float(facing))
        T_hand = transform(hand_rotation(stroke.heading_rad, float(pitch)), point)
        goals.append(HandGoal(T_hand, stroke.heading_rad + float(facing), cost))
    return goals


def finger_m(session: Session, thing: str, stroke: Stroke) -> float:
    """Return the position of each finger [m]: a quarter of the thing's width off its middle, if it opens so far."""
    R = rotation_z(-stroke.heading_rad) @ session.believed.T_world_link(thing)[:3, :3]
    low, high = bounds(session.believed.assets[thing], R)
    return float(min((high[1] - low[1]) / 4.0, session.planner.kinematics.finger_upper_m))


def stances(session: Session, thing: str, stroke: Stroke) -> Iterator[Stance[Stroke]]:
    """Yield stances from which the arm can make a push with nothing in the way of the hand or of the thing."""
    planner, oracle = session.planner, session.planner.oracle
    opening_m, touch = finger_m(session, thing, stroke), may_touch(session, thing)
    cargo = cargo_of(session.believed, thing)
    resting = held_may_touch(touching_any(session.believed, (thing, *cargo)))

    def validate(q: Array) -> tuple[Stroke, float] | None:
        T_touch = moved(planner.kinematics.forward(q), BEHIND_M * stroke.direction)
        to_thing = planner.line(q, T_touch).path
        if to_thing is None or oracle.first_hit(to_thing, opening_m=opening_m, allowed=touch):
            return None
        pushing = planner.line(to_thing[-1], moved(T_touch, stroke.distance_m * stroke.direction)).path
        if pushing is None:
            return None
        oracle.carried = carried_by(session.believed, thing, T_touch, cargo)
        try:
            hit = oracle.first_hit(pushing, opening_m=opening_m, allowed=touch | resting, margin_m=CLEARANCE_M)
        finally:
            oracle.carried = None
        return None if hit else (stroke, 0.0)

    here = session.q[planner.robot.base]
    return search_stances(planner, hand_goals(session, thing, stroke), here, validate=validate, turns_rad=(0.0,))


def may_touch(session: Session, thing: str) -> Allowed:
    """Return the intended contacts: of the fingers and the hand with the thing."""
    return fingers_may_touch(session.planner.robot, thing, hand=True)


def moved(T: Array, by_m: Array) -> Array:
    """Return a pose moved in the world."""
    T = T.copy()
    T[:3, 3] += by_m
    return T


def push(session: Session, action: oag.Action) -> StepResult:
    """Push the target until it is next to the other thing that the row names, by at most the action's number."""
    own, thing = own_of(action.primitive), session.subtask.target
    assert own is not None
    other = own.names(thing, session.subtask.support_goal)["other"]
    most_m = action.parameter if isinstance(action.parameter, float) else own.row.number.most if own.row.number else 0.5
    action = replace(action, parameter=most_m)
    session.sync_planner()
    between = box_around(session.believed, other)[0] - box_around(session.believed, thing)[0]
    headings = float(np.arctan2(between[1], between[0])) + np.deg2rad(TURNS_DEG)
    found = (stroke_towards(session, thing, other, float(heading), most_m) for heading in headings)
    strokes = [stroke for stroke in found if stroke is not None]
    planned = adopt_first(session, lambda _: (stances(session, thing, stroke) for stroke in strokes))
    if not isinstance(planned, Session):
        message = f"no free path to a place from which {thing} can be pushed to {other} ({len(strokes)} directions)"
        unplanned = Unplanned(target=thing, support=other, stances_tried=planned)
        return session.done(action, failure=Failure(FailureKind.NO_PATH, message, (unplanned,)))
    return _pushed(planned, action, other)


def _pushed(session: Session, action: oag.Action, other: str) -> StepResult:
    thing, stance, journey = session.subtask.target, session.plan.stance, session.plan.journey
    assert stance is not None and journey is not None
    stroke: Stroke = stance.followup
    up = session.world.T_world_link(thing)[:3, 2]
    failure = follow_legs(session, journey.legs)
    if failure is None:
        failure = session.control.follow(np.concatenate([session.q[None], stance.approach]), monitor=session.monitor())
    if failure is None:
        session.control.grip(finger_m(session, thing, stroke))
        failure = _stroke(session, thing, stroke, BEHIND_M + stroke.distance_m)
    for _ in range(MOST_STROKES - 1):
        left = stroke_towards(session, thing, other, stroke.heading_rad, stroke.distance_m)
        tipped = float(up @ session.world.T_world_link(thing)[:3, 2]) < TIPPED_COSINE
        if tipped:
            failure = Failure(FailureKind.SIDE_EFFECT, f"{thing} tips over", (SideEffect(thing, 0.0, tipped),))
        if failure is not None or left is None or left.distance_m < 2 * STEP_M:
            break
        failure = _stroke(session, thing, left, left.distance_m)
    if failure is None:
        failure = _stroke(session, thing, Stroke(-stroke.direction, 0.0), BACK_M)
        session.control.grip(session.planner.kinematics.finger_upper_m)
    hand = replace(session.hand, released=may_touch(session, thing))
    session = replace(session, hand=hand, handled=session.handled | {thing})
    return session.done(action, read(Atom("nextto", (thing, other)), session.world).measurements, failure=failure)


def _stroke(session: Session, thing: str, stroke: Stroke, hand_m: float) -> Failure | None:
    """Move the hand straight by a distance, which is meant to take the thing along by the stroke's own."""
    T_hand = moved(session.planner.kinematics.forward(session.q), hand_m * stroke.direction)
    line = session.planner.line(session.q, T_hand)
    if line.path is None:
        message = f"the arm does not reach {hand_m:.2f} m on behind {thing}"
        return Failure(FailureKind.UNREACHABLE, message, (Unplanned(target=thing),))
    T_thing = moved(session.world.T_world_link(thing), stroke.distance_m * stroke.direction)
    monitor = session.monitor(may_touch(session, thing))
    return session.control.follow(line.path, speed=SPEED, monitor=monitor, carries=(thing, T_thing))


SCENE = {
    "name": "push",
    "robot": {"position": [-0.6, 0.0], "name": "panda-lift"},
    "objects": {
        "table_0": {"category": "table", "model": "table_four_legs", "position": [0.9, 0.0]},
        "box_0": {"category": "box", "on": "table_0", "at": [-0.1, -0.25]},
        "bowl_0": {"category": "bowl", "on": "table_0", "at": [-0.05, 0.15]},
    },
}


def main() -> None:
    """Prove the plan, go through it by geometry, and run it."""
    add_skill("PUSH", push)
    completed = complete_scene(SCENE)
    assert completed.scene is not None, completed.problems
    domain = oag.Domain.from_toml(Path(__file__).parent.parent / "domains" / "next_to.toml")
    scene = replace(completed.scene, domain=domain)
    task = oag.task(scene, goal="(nextto box_0 bowl_0)", steps=["PUSH box_0 bowl_0 table_0"])
    graph = oag.compose(task)
    print(graph.verify())
    found = feasible(graph, scene, 0)
    print("feasible" if found else f"infeasible: {found.reason}")
    done = rollout(graph, scene, 0, conditions=found.conditions())
    print(f"{'succeeded' if done.succeeded else done.failure} after {done.simulated_s:.0f} s")
    for reading in done.goal_readings:
        print(f"  {reading.literal} is {reading.value}")
    if not done.succeeded:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
