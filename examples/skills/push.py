"""Give the robot a primitive of your own, down to the physics: PUSH a thing until it stands next to another one.

The row of PUSH is in `examples/domains/next_to.toml`, so that plans with it are proved. `push` is its skill, made of
what `executor.skills.push` has: the fingers go behind the thing, one on each side of its middle, and press it straight
towards the other one. A detector reads whether it got there. Needs the extra `sim`.

    python examples/skills/push.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import oag
from bddl import Atom
from executor import add_skill, feasible, rollout
from executor.records import Failure, FailureKind
from executor.scenes.file import complete_scene
from executor.sim.detectors import box_around, read
from executor.skills.navigate import adopt_first, follow_legs
from executor.skills.push import BEHIND_M, PushSearch, Stroke, let_go, press_on
from executor.skills.session import Session, StepResult
from oag.measurements import Unplanned
from oag.model.domain import own_of

TURNS_DEG = (0.0, 15.0, -15.0, 30.0, -30.0)
"""Directions of the push off the straight one, which comes first."""

APART_M = 0.010  # What is left between the two.
STEP_M = 0.005


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
    return Stroke(direction, centre + last * direction, last) if gap_m(last) <= near_m else None


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
    search = PushSearch(session, [stroke for stroke in found if stroke is not None])
    planned = adopt_first(session, lambda _: iter([search.stances()]))
    if not isinstance(planned, Session):
        count = len(search.strokes)
        message = f"no free path to a place from which {thing} can be pushed to {other} ({count} directions)"
        unplanned = Unplanned(target=thing, support=other, stances_tried=planned)
        return session.done(action, failure=Failure(FailureKind.NO_PATH, message, (unplanned,)))
    return _pushed(planned, action, other)


def _pushed(session: Session, action: oag.Action, other: str) -> StepResult:
    thing, stance, journey = session.subtask.target, session.plan.stance, session.plan.journey
    assert stance is not None and journey is not None
    stroke: Stroke = stance.followup
    failure = follow_legs(session, journey.legs)
    if failure is None:
        failure = session.control.follow(np.concatenate([session.q[None], stance.approach]), monitor=session.monitor())
    if failure is None:
        failure = press_on(session, stroke, BEHIND_M + stroke.distance_m)
    measured = read(Atom("nextto", (thing, other)), session.world).measurements
    return let_go(session).done(action, measured, failure=failure)


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
