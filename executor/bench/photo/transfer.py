"""Plans that are made in a reconstruction, executed in the room that it was made of.

The query is planned and proved in the reconstruction, and rehearsed there by physics, which fills in the numbers of its
flows. They are then executed in the true room by true physics. Where to stand and how to take hold of a thing the
primitives see in the true room, as at every execution; what is done to what, in which order, how far and how wide comes
from the reconstruction. Beside it the same query is planned in the true room.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import bddl
import llm
from executor.bench.photo.drawn import DrawnRoom, each_once
from executor.bench.photo.matching import matched
from executor.bench.photo.measure import category_in
from executor.bench.photo.sensor import MockedDetector
from executor.bench.photo.tracks import Track, input_of
from executor.bench.photo.truth import MOST_PICTURES, TASK_SIZE_PX, NoPlace, Shot, photograph_for, photographer
from executor.evolution.evolve import evolve
from executor.photo.pipeline import reconstructed
from executor.photo.refusal import PhotoRefused
from executor.records.rollout import PlanRefused, Rollout
from executor.rollouts.running import failure_of, rollout
from executor.scenes.pair import NotDrawn, ScenePair
from oag import ObjectActionGraph, RobotPose, Scene, Task, compose
from oag.task.sizes import Sizing

SCHEMA = "scene2demo-photo-transfer/1"
_STREAM = 181  # Keeps these draws apart from those of the rooms and of other tracks.
CAMERA = (
    f"photographed for the task ({TASK_SIZE_PX[0]} x {TASK_SIZE_PX[1]}): the first of at most {MOST_PICTURES} places, "
    "drawn from a seed around what it names, from which all of that and some floor are seen, else the one that shows "
    "most"
)
"""How the photographs are taken, for the table's title."""

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


def transfer(
    folder: Path,
    rooms: Sequence[DrawnRoom],
    detector: MockedDetector,
    told: Callable[[Mapping[str, Any]], None],
    track: Track,
) -> Iterator[dict[str, Any]]:
    """Yields what became of every pair, measured where it has no file yet.

    Args:
        folder: Where the files of the pairs are.
        rooms: The pairs.
        detector: The quality of the mocked detector.
        told: Is told of every pair.
        track: What the reconstruction is given.
    """
    with photographer():
        yield from each_once(folder, f"transfer-{track}", rooms, lambda one: _measured(one, detector, track), told)


def _measured(unit: DrawnRoom, detector: MockedDetector, track: Track) -> dict[str, Any]:
    began = time.process_time()
    base: dict[str, Any] = {"schema": SCHEMA, "pair": unit.name, "family": unit.family, "track": track}
    try:
        pair = unit.pair()
    except NotDrawn as problem:
        return {**base, "not_drawn": str(problem)}
    named = {name for subtask in pair.task.subtasks for name in subtask.roles if name is not None}
    base |= {"family": pair.family, "query": pair.query, "named": sorted(named)}
    straight = rollout(compose(pair.task, scene=pair.scene), pair.scene, unit.seed, vary=False)
    base["in_true_room"] = _outcome(straight)
    try:
        shot, looked = photograph_for(pair.scene, named, unit.camera_seed)
    except NoPlace as problem:
        return {**base, "not_seen": sorted(named), **_ended("photograph", str(problem))}
    base |= {"pictures_looked_at": looked, "not_seen": sorted(named - shot.visible().keys())}
    attempt = _attempted(unit, pair, shot, detector, track)
    return {**base, **attempt, "cpu_s": time.process_time() - began}


def _attempted(unit: DrawnRoom, pair: ScenePair, shot: Shot, detector: MockedDetector, track: Track) -> dict[str, Any]:
    """What becomes of the query by way of the photograph, stage by stage; the last one is that at which it ended."""
    rng = np.random.default_rng([*unit.entropy, _STREAM])
    masks = shot.visible()
    try:
        given = input_of(track, pair.id, shot, {name: category_in(pair.scene, name) for name in masks}, detector, rng)
        result = reconstructed(given.given, variations=False)
    except PhotoRefused as problem:
        return _ended("photograph", str(problem))
    if result.made.scene is None or result.made.refused:
        return _ended("scene", result.made.refused)
    names = {made: true for true, made in matched(shot.visible(least_px=1), given.boxes, result)[0].items()}
    scene = replace(result.made.scene, robot=_robot_seen(pair.scene.robot, shot))
    try:
        graph = compose(llm.propose(pair.query, scene, sizing=Sizing(unit.seed)).task, scene=scene)
        rehearsed = rollout(graph, scene, unit.seed, vary=False)
    except llm.QueryError as problem:
        return _ended("query", str(problem))
    except PlanRefused as refused:
        return _ended("plan", str(refused))
    evolved = False
    if not rehearsed.succeeded:
        evolved, failed = True, rehearsed
        rehearsed = evolve(graph, scene, unit.seed, vary=False).rollout
        if not rehearsed.succeeded:
            return {**_ended("rehearsal", _outcome(failed)["failure"]), "evolved_rehearsal": True}
    try:
        moved = compose(renamed(with_numbers(rehearsed), scene, names, pair), scene=pair.scene)
    except KeyError as missing:
        return _ended("names", f"the plan is about {missing.args[0]}, which stands for nothing that counts")
    return {**_executed(moved, pair, unit.seed, evolved), "evolved_rehearsal": evolved}


def _executed(graph: ObjectActionGraph, pair: ScenePair, seed: int, evolved: bool) -> dict[str, Any]:
    """What becomes of a plan in the true room, at once, and revised where it fails.

    What fails in physics self-evolution revises; what is refuted takes the checker's first fix that proves it and
    states no fact of the room.
    """
    try:
        done = rollout(graph, pair.scene, seed, vary=False)
    except PlanRefused as refused:
        fix, ended = refused.report.sure_fix, _ended("true plan", str(refused))
        if fix is None:
            return ended
        mended = compose(replace(fix.apply(graph.task), scene=pair.scene), scene=pair.scene)
        story = evolve(mended, pair.scene, seed, vary=False)
        return {**ended, "evolved": story.succeeded, "revisions": 1 + story.revisions, "fix": fix.summary}
    if done.succeeded:
        stage = ("rehearsal", "it succeeded after self-evolution") if evolved else ("", "")
        return {**_ended(*stage), "transferred": not evolved, "evolved": True}
    story = evolve(graph, pair.scene, seed, vary=False)
    return {**_ended("execution", _outcome(done)["failure"]), "evolved": story.succeeded, "revisions": story.revisions}


def _ended(stage: str, why: str) -> dict[str, Any]:
    return {"stage": stage, "why": why, "transferred": False, "evolved": False}


def _outcome(done: Rollout) -> dict[str, Any]:
    failure = failure_of(done)
    return {
        "succeeded": done.succeeded,
        "failure": "" if failure is None else f"{failure.kind.value}: {failure.message}",
    }


def with_numbers(done: Rollout) -> Task:
    """Returns a task with the numbers that were run."""
    filled = (replace(one, flow=record.flow) for one, record in zip(done.task.subtasks, done.subtasks, strict=True))
    return replace(done.task, subtasks=tuple(filled))


def renamed(task: Task, scene: Scene, names: Mapping[str, str], pair: ScenePair) -> Task:
    """Returns a task of a reconstruction as one of the true room, with the goal and the sizes that it truly has there.

    Args:
        task: In the reconstruction.
        scene: The reconstruction.
        names: id in the reconstruction -> id in the true room.
        pair: The true room.

    Raises:
        KeyError: It is about something that stands for nothing in the true room.
    """

    def word(found: re.Match[str]) -> str:
        return names[found[0]] if found[0] in scene.objects else found[0]

    def formula(told: bddl.Formula) -> bddl.Formula:
        return bddl.parse_formula(_WORD.sub(word, bddl.format(told)))

    def role(told: str | None) -> str | None:
        return None if told is None else names[told]

    subtasks = tuple(
        replace(
            one,
            target=names[one.target],
            support_init=role(one.support_init),
            support_goal=role(one.support_goal),
            init=formula(one.init),
            goal=formula(one.goal),
        )
        for one in task.subtasks
    )
    meant = pair.task
    return replace(task, subtasks=subtasks, goal=meant.goal, goal_given=True, scales=meant.scales, scene=pair.scene)


def _robot_seen(robot: RobotPose, shot: Shot) -> RobotPose:
    """The robot in the frame of the reconstruction: it knows where it stands beside the camera."""
    T = shot.T_level_world
    x, y, z = (float(value) for value in (T @ [*robot.position, 1.0])[:3])
    return replace(robot, position=(x, y, z), yaw_rad=robot.yaw_rad + math.atan2(T[1, 0], T[0, 0]))


def transfer_rows(units: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Returns the lines of the table over some pairs, as names and texts."""
    undrawn = sum("not_drawn" in unit for unit in units)
    units = [unit for unit in units if "not_drawn" not in unit]
    seen = [unit for unit in units if not unit["not_seen"]]
    rows = [("no such room could be drawn", str(undrawn))] if undrawn else []
    rows += [("pairs", str(len(units))), ("pairs in which all that the task is about is seen", str(len(seen)))]
    for name, members in (("all pairs", units), ("all is seen", seen)):
        rows += [
            (f"{name}: planned in the reconstruction", _share(members, lambda unit: bool(unit["transferred"]))),
            (
                f"{name}: the same, with self-evolution and proved fixes",
                _share(members, lambda unit: bool(unit["evolved"])),
            ),
            (
                f"{name}: planned in the true room",
                _share(members, lambda unit: bool(unit["in_true_room"]["succeeded"])),
            ),
        ]
    for stage in ("photograph", "scene", "query", "plan", "rehearsal", "names", "true plan", "execution"):
        count = sum(unit["stage"] == stage for unit in seen)
        if count:
            rows.append((f"all is seen, ended at: {stage}", str(count)))
    return rows


def _share(members: Sequence[Mapping[str, Any]], holds: Callable[[Mapping[str, Any]], bool]) -> str:
    good = sum(holds(one) for one in members)
    return f"{100 * good / len(members):.1f} % ({good} of {len(members)})" if members else "none"
