"""Measure reconstructions of known rooms, and the transfer of plans from a reconstruction to its true room.

Known rooms are rendered, degraded like true pictures, reconstructed and compared.

Transfer: the query is planned and proved in the reconstruction, and rehearsed there by physics, which fills in the
numbers of its flows. The plan is then executed in the true room by true physics. The primitives choose stance and grasp
in the true room, as at every execution. Objects, order, distances and openings come from the reconstruction. The same
query is also planned in the true room.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import bddl
import llm
from executor.assets.importers.store import Imported
from executor.assets.library import LIBRARY
from executor.bench.photo.rooms import CATEGORY, DrawnRoom, each_once, foreign_models, with_foreign_items
from executor.bench.photo.score import compare_thing, in_level_frame, match_things, support_counts
from executor.bench.photo.tracks import MOCKED, ORACLE, MockedDetector, TrackName, input_of
from executor.bench.photo.truth import (
    MOST_PICTURES,
    TASK_SIZE_PX,
    NoPlace,
    Shot,
    photograph,
    photograph_for,
    photographer,
)
from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.annotations import Detector
from executor.photo.pipeline import PhotoResult, reconstruct_scene
from executor.records import PlanRefused, Rollout
from executor.rollouts.evolve import evolve
from executor.rollouts.rollout import failure_of, rollout
from executor.scenes.pair import NotDrawn, ScenePair
from oag import ObjectActionGraph, Scene, Task, compose
from oag.model.scene import RobotPose
from oag.sizes import Sizing

ROOM_SCHEMA = "scene2demo-photo-room/1"
_ROOM_STREAM = 180  # Keeps these draws apart from those of the rooms.


def measure(
    folder: Path,
    rooms: Sequence[DrawnRoom],
    detector: MockedDetector,
    on_progress: Callable[[Mapping[str, Any]], None],
    track: TrackName = "B",
    detect: Detector | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield the result of every room, measured if it has no file yet.

    Args:
        folder: Folder of the rooms' files.
        rooms: Which ones.
        detector: The quality of the mocked detector.
        on_progress: Called with every result.
        track: The track.
        detect: The detector of track F.
    """
    with photographer(), foreign_models(folder / "foreign") if track == "G" else nullcontext(()) as foreign:

        def measured(room: DrawnRoom) -> dict[str, Any]:
            return _room(room, detector, track, foreign, detect)

        yield from each_once(folder, f"room-{track}", rooms, measured, on_progress)


def _room(
    room: DrawnRoom, detector: MockedDetector, track: TrackName, foreign: Sequence[Imported], detect: Detector | None
) -> dict[str, Any]:
    base: dict[str, Any] = {"schema": ROOM_SCHEMA, "room": room.name, "family": room.family, "track": track}
    base["boxes"] = {"A": ORACLE, "F": "a detector's"}.get(track, MOCKED)
    try:
        scene = room.pair().scene
        if foreign:
            scene = with_foreign_items(scene, foreign, np.random.default_rng([*room.entropy, _ROOM_STREAM + 1]))
        items = [thing.id for thing in scene.objects.values() if thing.category == CATEGORY]
        # A picture of the whole room shows too little of such small objects.
        shot = photograph_for(scene, items, room.camera_seed)[0] if foreign else photograph(scene, room.camera_seed)
    except (NotDrawn, NoPlace) as problem:
        return {**base, "not_photographed": str(problem), "refused": str(problem), "things": []}
    rng = np.random.default_rng([*room.entropy, _ROOM_STREAM])
    masks = shot.visible()
    categories = {name: category_in(shot.scene, name) for name in masks}
    counted = {name: mask for name, mask in masks.items() if not foreign or categories[name] == CATEGORY}
    began, worked = time.perf_counter(), time.process_time()
    try:
        made = input_of(track, room.name, shot, categories, detector, rng, detect)
        result = reconstruct_scene(made.given, variations=False)
    except PhotoRefused as problem:
        things = [_compared(shot, name, categories[name], masks, None, None).to_json() for name in counted]
        return {**base, "refused": str(problem), "kind": problem.kind, "things": things}
    took = {"took_s": time.perf_counter() - began, "cpu_s": time.process_time() - worked}
    # A fit of a hardly visible object is not invented.
    ids, invented = match_things(shot.visible(least_px=1), made.boxes, result)
    things = [_compared(shot, name, categories[name], masks, result, ids.get(name)).to_json() for name in counted]
    return {
        **base,
        **took,
        "settled": not result.made.refused,
        "refused": result.made.refused,
        "camera": {"height_error_m": result.floor.height_m - float(shot.T_world_camera[2, 3])},
        "supports": support_counts(*_supports(shot.scene, result, ids)),
        "invented": [next(one.fit.guess.entry.model for one in result.found.things if one.id == k) for k in invented],
        "things": things,
    }


def category_in(scene: Scene, name: str) -> str:
    """Return the library's category of an object, or its own if the library has none."""
    thing = scene.objects[name]
    return LIBRARY[thing.model].category if thing.model in LIBRARY else thing.category


def _compared(
    shot: Shot,
    name: str,
    category: str,
    masks: Mapping[str, Any],
    result: PhotoResult | None,
    made_id: str | None,
) -> Any:
    true = in_level_frame(shot, name)
    points: Array = np.zeros((0, 3))
    made, confidence = None, None
    if result is not None:
        # Without depth there are no points to draw a box around.
        visible = masks[name] & result.observation.measured
        points = result.observation.points_m[visible]
        thing = next((one for one in result.found.things if one.id == made_id), None)
        if thing is not None:
            confidence = thing.fit.confidence
            scene = result.made.scene
            made = thing.fit.guess.as_object(thing.id) if scene is None else scene.objects[thing.id]
    return compare_thing(true, category, int(masks[name].sum()), made, confidence, points)


def _supports(
    scene: Scene, result: PhotoResult, ids: Mapping[str, str]
) -> tuple[Sequence[tuple[str, str]], Sequence[tuple[str, str]]]:
    """Return pairs (object, support) of found objects, by their true names."""
    names = {made: name for name, made in ids.items()}
    true = [(a, b) for a, b in _carried(scene) if a in ids and b in ids]
    made = [] if result.made.scene is None else _carried(result.made.scene)
    return true, [(names[a], names[b]) for a, b in made if a in names and b in names]


def _carried(scene: Scene) -> list[tuple[str, str]]:
    literals = (literal for fact in scene.facts for literal in bddl.literals(fact) or ())
    return [
        (literal.atom.args[0], literal.atom.args[1])
        for literal in literals
        if literal.value and literal.atom.predicate in ("ontop", "inside")
    ]


TRANSFER_SCHEMA = "scene2demo-photo-transfer/1"
_TRANSFER_STREAM = 181  # Keeps these draws apart from those of the rooms and of other tracks.
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
    on_progress: Callable[[Mapping[str, Any]], None],
    track: TrackName,
) -> Iterator[dict[str, Any]]:
    """Yield the result of every pair, measured if it has no file yet.

    Args:
        folder: Folder of the pairs' files.
        rooms: The pairs.
        detector: The quality of the mocked detector.
        on_progress: Called with every result.
        track: The track of the reconstruction's input.
    """
    with photographer():
        yield from each_once(
            folder, f"transfer-{track}", rooms, lambda one: _measured(one, detector, track), on_progress
        )


def _measured(unit: DrawnRoom, detector: MockedDetector, track: TrackName) -> dict[str, Any]:
    began = time.process_time()
    base: dict[str, Any] = {"schema": TRANSFER_SCHEMA, "pair": unit.name, "family": unit.family, "track": track}
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


def _attempted(
    unit: DrawnRoom, pair: ScenePair, shot: Shot, detector: MockedDetector, track: TrackName
) -> dict[str, Any]:
    """Plan a query by way of the photograph, stage by stage; return the stage at which it ended."""
    rng = np.random.default_rng([*unit.entropy, _TRANSFER_STREAM])
    masks = shot.visible()
    try:
        given = input_of(track, pair.id, shot, {name: category_in(pair.scene, name) for name in masks}, detector, rng)
        result = reconstruct_scene(given.given, variations=False)
    except PhotoRefused as problem:
        return _ended("photograph", str(problem))
    if result.made.scene is None or result.made.refused:
        return _ended("scene", result.made.refused)
    names = {made: true for true, made in match_things(shot.visible(least_px=1), given.boxes, result)[0].items()}
    scene = replace(result.made.scene, robot=_robot_in_level_frame(pair.scene.robot, shot))
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
        moved = compose(to_true_room(with_numbers(rehearsed), scene, names, pair), scene=pair.scene)
    except KeyError as missing:
        return _ended("names", f"the plan is about {missing.args[0]}, which stands for nothing that counts")
    return {**_executed(moved, pair, unit.seed, evolved), "evolved_rehearsal": evolved}


def _executed(graph: ObjectActionGraph, pair: ScenePair, seed: int, evolved: bool) -> dict[str, Any]:
    """Execute a plan in the true room, and revise it if it fails.

    Self-evolution revises failures in physics; a refuted plan takes the checker's first fix that proves it and states
    no fact of the room.
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
    """Return a task with its executed flows."""
    filled = (replace(one, flow=record.flow) for one, record in zip(done.task.subtasks, done.subtasks, strict=True))
    return replace(done.task, subtasks=tuple(filled))


def to_true_room(task: Task, scene: Scene, names: Mapping[str, str], pair: ScenePair) -> Task:
    """Return a task of a reconstruction as one of the true room, with the true goal and sizes.

    Args:
        task: In the reconstruction.
        scene: The reconstruction.
        names: id in the reconstruction -> id in the true room.
        pair: The true room.

    Raises:
        KeyError: It is about something without an object in the true room.
    """

    def word(found: re.Match[str]) -> str:
        return names[found[0]] if found[0] in scene.objects else found[0]

    def formula(original: bddl.Formula) -> bddl.Formula:
        return bddl.parse_formula(_WORD.sub(word, bddl.format(original)))

    def role(original: str | None) -> str | None:
        return None if original is None else names[original]

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


def _robot_in_level_frame(robot: RobotPose, shot: Shot) -> RobotPose:
    """Return the robot in the frame of the reconstruction: its place relative to the camera is known."""
    T = shot.T_level_world
    x, y, z = (float(value) for value in (T @ [*robot.position, 1.0])[:3])
    return replace(robot, position=(x, y, z), yaw_rad=robot.yaw_rad + math.atan2(T[1, 0], T[0, 0]))


def transfer_rows(units: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Return the lines of the table over some pairs, as names and texts."""
    undrawn = sum("not_drawn" in unit for unit in units)
    units = [unit for unit in units if "not_drawn" not in unit]
    fully_visible = [unit for unit in units if not unit["not_seen"]]
    rows = [("no such room could be drawn", str(undrawn))] if undrawn else []
    rows += [("pairs", str(len(units))), ("pairs in which all that the task is about is seen", str(len(fully_visible)))]
    for name, members in (("all pairs", units), ("all is seen", fully_visible)):
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
        count = sum(unit["stage"] == stage for unit in fully_visible)
        if count:
            rows.append((f"all is seen, ended at: {stage}", str(count)))
    return rows


def _share(members: Sequence[Mapping[str, Any]], holds: Callable[[Mapping[str, Any]], bool]) -> str:
    good = sum(holds(one) for one in members)
    return f"{100 * good / len(members):.1f} % ({good} of {len(members)})" if members else "none"
