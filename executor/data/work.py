"""Make one unit: scene, task, distractors, the rollout, its metadata, and what self-evolution corrected.

Corrections are recovery as data: what failed in a unit's self-evolution, why, the revision, and the failed motion. The
correction's own motion is that of the next attempt from the same start. It is either a failed one that is kept, too, or
the final one in the unit's samples. No motion leads *out of* a failure: an evolution goes back to the beginning of the
subtask, or of an earlier one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache, lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bddl
import llm
from bddl.errors import Scene2DemoError
from executor.assets import library
from executor.assets.library import asset_for, asset_hash
from executor.campaign.planning_model import Plan, plan_offline
from executor.campaign.versions import LIBRARIES, library_versions
from executor.data import samples
from executor.data.store import SAMPLES
from executor.data.units import (
    UNVARIED,
    DemoSeries,
    DemoUnit,
    apply_perturbations,
    draw_perturbations,
    draw_physics,
    scene_key,
)
from executor.data.views import RenderedViews
from executor.records import Rollout, StepRecord, SubtaskRecord, Trajectory, action_text
from executor.rollouts.evolution_record import Evolution
from executor.rollouts.evolve import evolve
from executor.rollouts.recording import repeat_subtask
from executor.rollouts.rollout import RunConditions, rollout
from executor.rollouts.run_record import attempt_after, describe_rollout, filled_task, pairs
from executor.rollouts.scene_repairs import Judged, repaired
from executor.scenes.file import scene_for
from executor.scenes.generators.families import pair_of, scene_name_for_seed, varies_with_seed, with_paper_flows
from executor.scenes.generators.long_horizon import PANTRY
from executor.scenes.pair import LayoutChanges, NotDrawn
from executor.scenes.placement import Clearance, PlaceSpec, place
from executor.scenes.room import NoRoom, Perturbation, Room
from executor.scenes.vary import vary
from executor.sim.engine import STANDARD, Physics
from executor.sim.robot.description import drives
from executor.skills.trajectories import CommandNoise
from executor.system.files import plain
from executor.system.workers import HandoverRefused
from llm.errors import RefusalCode
from llm.offline.reader import paraphrases
from oag import ObjectActionGraph, Scene, SceneObject, Task, compose
from oag.model.robots import PAPER_ROBOT, record_of_robot
from oag.model.scene import FLOOR
from oag.model.symbols import Kind
from oag.sizes import Sizing, resized_targets

PREFIX = "distractor_"
"""Prefix of their ids."""

_CLEAR = Clearance(other_m=0.06)  # The same gap as between loose items in household rooms.


def with_distractors(scene: Scene, task: Task, most: int, rng: np.random.Generator) -> Scene:
    """Add one to `most` distractors to a scene, fewer where there is no room; none resembles what is there.

    They stand on furniture that the task does not use.

    Args:
        scene: Scene before sizes are adjusted and physics has settled it.
        task: Its furniture is left alone.
        most: Maximum number.
        rng: Random generator.
    """
    room = Room(scene.name, "", rng, 0.0, 0.0)
    room.objects.update({name: thing for name, thing in scene.objects.items() if thing.category != FLOOR})
    for fact in scene.facts:
        if isinstance(fact, bddl.Atom) and fact.predicate in ("ontop", "inside") and fact.args[1] in scene.objects:
            room.relate(fact.predicate, *fact.args)
    used = {name for part in task.subtasks for name in (part.target, part.support_init, part.support_goal)}
    tops = [name for name, thing in room.objects.items() if name not in used and _has_top(thing)]
    there = {_short_name(thing.category) for thing in scene.objects.values()}
    models = [model for model in PANTRY if _short_name(library.entry(model).category) not in there]
    count = int(rng.integers(1, most + 1))
    added: dict[str, str] = {}
    for model in rng.permutation(models)[:count]:
        thing = room.draw(str(model), f"{PREFIX}{len(added)}")
        for support in rng.permutation(tops):
            try:
                added[place(room, thing, PlaceSpec(str(support), clear=_CLEAR))] = str(support)
                break
            except NoRoom:
                continue
    rooms = {fact.args[1] for fact in scene.facts if isinstance(fact, bddl.Atom) and fact.predicate == "inroom"}
    facts = [bddl.Atom("ontop", pair) for pair in added.items()]
    facts += [bddl.Atom("inroom", (name, kind)) for name in added for kind in sorted(rooms)[:1]]
    objects = {**scene.objects, **{name: room.objects[name] for name in added}}
    return Scene(scene.name, scene.robot, objects, (*scene.facts, *facts), scene.closed, scene.variation)


def distractors_in(scene: Scene) -> dict[str, Any]:
    """Return the model of each added thing."""
    return {name: thing.model for name, thing in scene.objects.items() if name.startswith(PREFIX)}


def _has_top(thing: SceneObject) -> bool:
    if thing.kind is Kind.ITEM:
        return False
    regions = asset_for(thing).regions
    return bool(regions) and any(region.kind == "surface" and region.name == "top" for region in regions)


def _short_name(category: str) -> str:
    """Return the shortest name of a category: a half apple is an apple."""
    return category.rsplit("_", 1)[-1]


_SENTENCE_REFUSALS: tuple[RefusalCode, ...] = ("empty", "too-long", "not-understood", "unknown-action")
"""Refusals that do not depend on the room."""

_SEEDS_COMPARED = 16


class NotPlannable(Scene2DemoError, ValueError):
    """A sentence cannot be planned, whatever the seed."""

    exit_code = 1


@dataclass(frozen=True, slots=True)
class Prepared:
    """Task and scene of a unit.

    Attributes:
        query: The sentence.
        graph: The composed task, in its concrete scene.
        perturbations: Target's id -> its deviation from the unperturbed scene.
        repaired: The feasible plan, with the changes of the scene, where these were asked for and found.
    """

    query: str
    graph: ObjectActionGraph
    perturbations: Mapping[str, Perturbation] = field(default_factory=dict)
    repaired: Judged | None = None


@dataclass(frozen=True, slots=True)
class Made:
    """An executed unit.

    Attributes:
        of: The prepared unit.
        graph: The composed task that was run.
        rollout: The rollout.
        story: The revisions, where flows evolve.
    """

    of: Prepared
    graph: ObjectActionGraph
    rollout: Rollout
    story: Evolution | None = None


def prepare_unit(unit: DemoUnit, plan: Plan = plan_offline) -> Prepared:
    """Prepare a unit's task and scene.

    Args:
        unit: The unit.
        plan: What plans it; scenes are drawn, and repaired, with the offline planner all the same.

    Raises:
        NotDrawn: No room could be drawn for this seed.
        HandoverRefused: The scene is not the unit's, as after a change of its file.
        QueryError, SceneError: The sentence cannot be planned in the scene, or the scene is invalid.
        AnswersRefused, ModelError: The model that plans it gave no plan.
    """
    distracted = _distractor_adder(unit) if unit.variation.distractors else None
    if unit.origin.family is not None:
        pair = pair_of(
            unit.origin.family,
            unit.seed,
            unit.index,
            keep_sizes=unit.keep_sizes,
            robot=unit.robot_name or PAPER_ROBOT.name,
            changes=LayoutChanges(unit.draws if unit.variation.target else None, distracted),
        )
        if unit.repair is not None:
            return _repaired(unit, pair.query, pair.scene, Sizing(keep=True), pair.perturbations)
        if unit.model is not None:
            # What the offline plan takes has its size already.
            task = plan(pair.query, pair.scene, Sizing(keep=True))
            return Prepared(pair.query, compose(task, scene=pair.scene), pair.perturbations)
        task = pair.task if unit.flows == "planned" else with_paper_flows(pair.task, unit.origin.family)
        return Prepared(pair.query, compose(task, scene=pair.scene), pair.perturbations)
    origin = unit.origin
    nominal = _scene(origin.query, scene_name_for_seed(origin.scene, unit.seed), origin.scene_key, unit.robot_name)
    perturbations: dict[str, Perturbation] = {}
    if unit.variation.target:
        perturbations = draw_perturbations(nominal, llm.propose(unit.origin.query, nominal).task, unit.draws)
        nominal = apply_perturbations(nominal, perturbations)
    if distracted is not None:
        nominal = distracted(nominal, llm.propose(unit.origin.query, nominal).task)
    sizing = Sizing(unit.seed, unit.keep_sizes)
    if unit.repair is not None:
        return _repaired(unit, origin.query, vary(nominal, unit.seed), sizing, perturbations)
    task = plan(unit.origin.query, nominal, sizing)
    scene = vary(nominal.with_scales(task.scales), unit.seed)
    # Sizes are already in the scene; scales in the task would apply twice.
    return Prepared(unit.origin.query, compose(replace(task, scales={}), scene=scene), perturbations)


def _repaired(
    unit: DemoUnit, query: str, scene: Scene, sizing: Sizing, perturbations: Mapping[str, Perturbation]
) -> Prepared:
    """Return a unit in the nearest scene in which it is feasible; in its own where none was found."""
    judged = repaired(
        replace(scene, variation={}), lambda other: llm.propose(query, other, sizing=sizing).task, unit.seed
    )
    if judged.refusal is not None:
        raise judged.refusal
    assert judged.report is not None
    task = judged.report.task if judged.found is None else judged.found.task
    graph = compose(replace(task, scales={}), scene=judged.scene.with_scales(task.scales))
    return Prepared(query, graph, perturbations, judged if judged.feasible else None)


def check_plannable(first: DemoUnit) -> None:
    """Refuse a sentence that no seed can make an episode of.

    Where each seed draws its own room, a sentence that is understood is left to the seeds.

    Args:
        first: Unit of the first seed.

    Raises:
        NotPlannable: It is one.
        SceneError: The scene is invalid.
    """
    if first.origin.family is not None or first.model is not None:
        # What a model understands is seen once it is asked.
        return
    left_to_seeds = varies_with_seed(first.origin.scene)
    try:
        # Perturbations and distractors depend on the seed, and are added to a scene that can be planned.
        report = prepare_unit(replace(first, variation=UNVARIED)).graph.verify()
    except NotDrawn:
        return
    except llm.QueryError as refusal:
        if left_to_seeds and refusal.code not in _SENTENCE_REFUSALS:
            return
        raise NotPlannable(str(refusal)) from None
    if not report and not left_to_seeds:
        raise NotPlannable(f'"{first.origin.query}" in {first.origin.scene}: the plan is not proved\n{report}')


def starts_alike(series: DemoSeries) -> bool:
    """Decide whether a series' episodes differ only in the planner's choices; of many, some are compared.

    Raises:
        SceneError: The scene is invalid.
    """
    first, axes = series.first, series.first.variation
    looks = (axes.surfaces or axes.lights or axes.cameras) and bool(first.recording.views)
    if looks or axes.target or axes.distractors or axes.physics or axes.noise_m:
        return False
    if series.episodes < 2 or first.origin.family is not None or varies_with_seed(first.origin.scene):
        return False
    units = (replace(unit, repair=None, model=None) for unit in islice(series.units(), _SEEDS_COMPARED))
    scenes = (prepare_unit(unit).graph.scene for unit in units)
    try:
        nominal = next(scenes)
        return all(scene == nominal for scene in scenes)
    except llm.QueryError:
        return False  # Drawn sizes decide whether the task can be planned.


def _distractor_adder(unit: DemoUnit) -> Callable[[Scene, Task], Scene]:
    """Return the function that adds a unit's distractors to a layout."""
    return lambda scene, task: with_distractors(scene, task, unit.variation.distractors, unit.draws("distractors"))


@lru_cache(maxsize=4)
def _scene(query: str, name: str, key: str, robot: str) -> Scene:
    scene = scene_for(query, name, robot=robot)
    if key and (found := scene_key(scene)) != key:
        raise HandoverRefused(
            f"the scene {name} is not what it was when its episodes were asked for (key {found}, not {key}): its "
            "file was changed meanwhile, or this machine has another one; start the same command again"
        )
    return scene


def make_unit(unit: DemoUnit, plan: Plan = plan_offline) -> Made:
    """Execute a unit.

    Raises:
        PlanRefused: The plan is not proved, so nothing moved.
        NotDrawn, QueryError, SceneError, AnswersRefused, ModelError: As for `prepare_unit`.
    """
    todo = prepare_unit(unit, plan)
    graph = todo.graph
    rate_hz = float(unit.recording.rate_hz)
    conditions = RunConditions(rate_hz, physics=physics_of(unit), noise=noise_of(unit), stances=unit.stances)
    if todo.repaired is not None and todo.repaired.found is not None:
        conditions = replace(todo.repaired.found.conditions(conditions), scene_fixes=todo.repaired.fixes)
    if unit.evolve:
        story = evolve(graph, graph.scene, unit.seed, vary=False, conditions=conditions)
        return Made(todo, graph, story.rollout, story)
    return Made(todo, graph, rollout(graph, graph.scene, unit.seed, vary=False, conditions=conditions))


def physics_of(unit: DemoUnit) -> Physics:
    """Return the physics of a unit; a replay needs the same."""
    return draw_physics(unit.draws("physics")) if unit.variation.physics else STANDARD


def noise_of(unit: DemoUnit) -> CommandNoise:
    """Return the command noise of a unit; a replay needs the same."""
    return CommandNoise(float(unit.variation.noise_m), int(unit.draws("noise").integers(2**31)))


def drawn_values(unit: DemoUnit, scene: Scene, perturbations: Mapping[str, Perturbation]) -> dict[str, Any]:
    """Return the drawn values of a unit, axis by axis, of the axes that affect its motion."""
    axes: dict[str, Any] = {}
    if unit.variation.target:
        axes["target"] = {name: asdict(perturbation) for name, perturbation in perturbations.items()}
    if unit.variation.distractors:
        axes["distractors"] = distractors_in(scene)
    if unit.variation.physics:
        axes["physics"] = asdict(physics_of(unit))
    if unit.variation.noise_m:
        axes["noise"] = asdict(noise_of(unit))
    return axes


def meta_of(made: Made) -> dict[str, Any]:
    """Return the content of a unit's `unit.json` about a rollout; `docs/datasets.md` documents each key."""
    done, robot = made.rollout, made.rollout.scene.robot.model
    task = filled_task(done)
    report = compose(task, scene=made.graph.scene).verify()
    return {
        **describe_rollout(done),
        "query": made.of.query,
        "paraphrases": list(paraphrases(made.of.query)),
        "task": task.to_json(),
        "detours": [asdict(detour) for detour in done.detours],
        **done.scene_fixes_json,
        "scene": done.scene.to_json(),
        "assets": {name: asset_hash(thing) for name, thing in done.scene.objects.items()},
        "verdict": report.verdict.name,
        "certificate": None if report.certificate is None else report.certificate.task_hash,
        "subtasks": [_subtask(done, record) for record in done.subtasks],
        "scaled": [change.to_json() for change in resized_targets(made.graph.task, done.scene)],
        "record_hz": done.record_hz,
        "object_ids": list(done.trajectory.object_poses),
        "joint_ids": list(done.trajectory.joint_positions),
        "robot": {**record_of_robot(robot), "drives": [list(drive) for drive in drives(robot)]},
        "versions": versions(),
    }


@cache
def versions() -> dict[str, str]:
    """Return the versions of the program and of the libraries that affect episodes."""
    return library_versions(("scene2demo", *LIBRARIES))


def _subtask(done: Rollout, record: SubtaskRecord) -> dict[str, Any]:
    planned = done.task.subtasks[record.index]
    return {
        "name": record.name,
        "detail": planned.detail,
        "init": bddl.format(planned.init),
        "goal": bddl.format(planned.goal),
        "succeeded": record.succeeded,
        "span": _span(done.trajectory.subtask == record.index),
        "steps": [
            describe_step(step, (done.trajectory.subtask == record.index) & (done.trajectory.step == step.step))
            for step in record.steps
        ],
        "moved_m": dict(record.moved_m),
    }


def describe_step(step: StepRecord, rows: NDArray[np.bool_]) -> dict[str, Any]:
    """Describe a step as plain data, with the samples taken during it.

    Args:
        step: The step.
        rows: (N,) whether each sample was taken during it.
    """
    return {
        "primitive": step.primitive,
        "text": action_text(step.primitive, step.action),
        "action": step.action,
        "span": _span(rows),
        "start_s": step.start_s,
        "end_s": step.end_s,
        "failure": None if step.failure is None else step.failure.to_json(),
    }


def _span(chosen: Any) -> list[int] | None:
    """Return the first sample and the one after the last; None without samples."""
    rows = np.flatnonzero(chosen)
    return [int(rows[0]), int(rows[-1]) + 1] if len(rows) else None


MotionRenderer = Callable[[Trajectory, Path], RenderedViews]
"""Renders a motion into a folder."""


def write_corrections(
    folder: Path, story: Evolution, physics: Physics, noise: CommandNoise, draw: MotionRenderer | None = None
) -> list[dict[str, Any]]:
    """Write the motion of every revised attempt, and return what failed in each and its revision.

    Args:
        folder: The unit's folder; the motions become `attempt-<subtask>-<number>.xz`, both counted from 1, and their
            pictures go into folders of the same name.
        story: The unit's evolution.
        physics, noise: Those of the unit's execution.
        draw: Renders their pictures; None for no pictures.

    Returns:
        One mapping per revision, of the form of `executor.rollouts.evolution_record.pairs`. It has the file's name as
        `samples`, the steps that ran as `steps`, and the pictures' description as `pictures`. `corrected_by` is the
        file with the motion of the revised flow, or null.

    Raises:
        OSError: The folder cannot be written.
    """
    records = {
        (entry.history.subtask, number): record
        for entry in story.stories
        for number, record in enumerate(entry.records)
    }
    found = []
    for pair in pairs(story):
        context: Any = pair["context"]
        place = context["subtask"], context["attempt"] - 1
        record, name = records[place], _name(*place)
        motion = repeat_subtask(
            story.rollout.scene, record, story.rollout.record_hz, faults=story.faults, physics=physics, noise=noise
        )
        before: list[tuple[()]] = [()] * record.index
        arrays = samples.motion_columns(motion, [*before, record.commands])
        entry: dict[str, Any] = {**pair, "samples": f"{name}.xz", "corrected_by": corrected_by(story, *place)}
        # A repetition does not record steps; each took its samples after its begin, up to its end.
        times_s = motion.time_s
        entry["steps"] = [
            describe_step(step, (step.start_s < times_s) & (times_s <= step.end_s)) for step in record.steps
        ]
        if draw is not None:
            (folder / name).mkdir()
            rendered = draw(motion, folder / name)
            entry["pictures"] = rendered.described
            arrays |= rendered.poses
        (folder / f"{name}.xz").write_bytes(samples.packed(arrays))
        found.append(plain(entry))
    return found


def _name(subtask: int, number: int) -> str:
    return f"attempt-{subtask + 1}-{number + 1}"


def corrected_by(story: Evolution, subtask: int, number: int) -> str | None:
    """Return the file with the motion of an attempt's revised flow; None where it was not kept.

    The last attempt at a subtask is part of the episode; of those before it, the revised ones are kept.

    Args:
        story: The unit's evolution.
        subtask, number: The attempt, both from 0.
    """
    after = attempt_after(story, subtask, number)
    if after is None:
        return None
    attempts = next(attempts for attempts in story.stories if attempts.history.subtask == after[0])
    if after[1] + 1 == len(attempts.records):
        return SAMPLES
    attempt, revision = attempts.history.iterations[after[1]]
    return None if attempt.succeeded or revision is None else f"{_name(*after)}.xz"
