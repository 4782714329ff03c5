"""Makes one unit: scene and task, the rollout, and what is to be said of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache, lru_cache
from importlib import metadata
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bddl
import llm
from executor.bench.paper import with_paper_flows
from executor.bench.units import pair_of
from executor.bench.work import described
from executor.datasets.distractors import distractors_in, with_distractors
from executor.datasets.units import DemoSeries, DemoUnit, scene_key
from executor.datasets.variation import UNVARIED, drawn_physics, strayed, with_strays
from executor.evolution.evolve import evolve
from executor.evolution.record import Evolution
from executor.machine.workers.process import HandoverRefused
from executor.primitives.noise import CommandNoise
from executor.records.captions import action_text
from executor.records.rollout import Rollout, StepRecord, SubtaskRecord
from executor.results.run_record import filled_task
from executor.robot.description import drives
from executor.rollouts.running import rollout
from executor.scenes.drawn import is_of_seeds, of_seed
from executor.scenes.pair import Changes, NotDrawn
from executor.scenes.reading import scene_for
from executor.scenes.rooms.room import Stray
from executor.scenes.vary import vary
from executor.world.physics import STANDARD, Physics
from llm.errors import RefusalCode
from llm.paraphrase import paraphrases
from oag import ObjectActionGraph, Scene, Task, compose
from oag.task.sizes import Sizing, handled_sizes

_LIBRARIES = ("scene2demo", "sapien", "numpy", "scipy", "trimesh", "example-robot-data")


_OF_THE_SENTENCE: tuple[RefusalCode, ...] = ("empty", "too-long", "not-understood", "unknown-action")
"""Refusals that no other room would change."""

_SEEDS_COMPARED = 16


class NotPlannable(ValueError):
    """A sentence cannot be planned, whatever an episode's seed."""


class NotNeeded(RuntimeError):
    """There is nothing to show in a unit, such as where a policy did by itself what it was to be corrected in."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """What is to be done for a unit.

    Attributes:
        query: What a person would type.
        graph: The composed task, in its concrete scene.
        strays: Target's id -> how it differs from what the scene has without that.
    """

    query: str
    graph: ObjectActionGraph
    strays: Mapping[str, Stray] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Made:
    """A unit that was executed.

    Attributes:
        of: What was to be done.
        graph: The composed task that was to be run: after a takeover, what was left of it.
        rollout: What happened.
        story: The revisions, where flows evolve.
        takeover: What is said of whoever acted before, and of where the planner began; None from an episode's start.
    """

    of: Prepared
    graph: ObjectActionGraph
    rollout: Rollout
    story: Evolution | None = None
    takeover: Mapping[str, Any] | None = None


def prepared(unit: DemoUnit) -> Prepared:
    """Returns what is to be done for a unit.

    Raises:
        NotDrawn: No room could be made of this seed.
        HandoverRefused: The scene is not the one that the unit is of, as after a change of its file.
        QueryError, SceneError: The sentence cannot be planned in the scene, or the scene cannot be.
    """
    distracted = _distracted(unit) if unit.variation.distractors else None
    if unit.origin.family is not None:
        pair = pair_of(
            unit.origin.family,
            unit.seed,
            unit.index,
            keep_sizes=unit.keep_sizes,
            full_size=unit.full_size,
            changes=Changes(unit.draws if unit.variation.target else None, distracted),
        )
        task = pair.task if unit.flows == "planned" else with_paper_flows(pair.task, unit.origin.family)
        return Prepared(pair.query, compose(task, scene=pair.scene), pair.strays)
    origin = unit.origin
    nominal = _scene(origin.query, of_seed(origin.scene, unit.seed), origin.scene_key, full_size=unit.full_size)
    strays: dict[str, Stray] = {}
    if unit.variation.target:
        strays = strayed(nominal, llm.propose(unit.origin.query, nominal).task, unit.draws)
        nominal = with_strays(nominal, strays)
    if distracted is not None:
        nominal = distracted(nominal, llm.propose(unit.origin.query, nominal).task)
    task = llm.propose(unit.origin.query, nominal, sizing=Sizing(unit.seed, unit.keep_sizes)).task
    scene = vary(nominal.with_scales(task.scales), unit.seed)
    # Things have their sizes in the scene; who executes the task would scale them once more.
    return Prepared(unit.origin.query, compose(replace(task, scales={}), scene=scene), strays)


def check_plannable(first: DemoUnit) -> None:
    """Refuse a sentence that no seed can make an episode of.

    Where each seed draws a room of its own, a sentence that is understood is left to the seeds.

    Args:
        first: The unit of the first seed.

    Raises:
        NotPlannable: It is one.
        SceneError: The scene cannot be.
    """
    if first.origin.family is not None:
        return
    left_to_seeds = is_of_seeds(first.origin.scene)
    try:
        # What strays or is added depends on the seed, and comes to a scene in which the sentence can be planned.
        report = prepared(replace(first, variation=UNVARIED)).graph.verify()
    except NotDrawn:
        return
    except llm.QueryError as refusal:
        if left_to_seeds and refusal.code not in _OF_THE_SENTENCE:
            return
        raise NotPlannable(str(refusal)) from None
    if not report and not left_to_seeds:
        raise NotPlannable(f'"{first.origin.query}" in {first.origin.scene}: the plan is not proved\n{report}')


def start_alike(series: DemoSeries) -> bool:
    """Decide whether a series' episodes differ in nothing but the planner's choices; of many, some are compared.

    Raises:
        SceneError: The scene cannot be.
    """
    first, axes = series.first, series.first.variation
    looks = (axes.surfaces or axes.lights or axes.cameras) and bool(first.recording.views)
    if looks or axes.target or axes.distractors or axes.physics or axes.noise_m:
        return False
    if series.episodes < 2 or first.origin.family is not None or is_of_seeds(first.origin.scene):
        return False
    scenes = (prepared(unit).graph.scene for unit in islice(series.units(), _SEEDS_COMPARED))
    try:
        nominal = next(scenes)
        return all(scene == nominal for scene in scenes)
    except llm.QueryError:
        return False  # A size that a seed draws has a say in what can be done.


def _distracted(unit: DemoUnit) -> Callable[[Scene, Task], Scene]:
    """Returns what adds a unit's distractors to a layout."""
    return lambda scene, task: with_distractors(scene, task, unit.variation.distractors, unit.draws("distractors"))


@lru_cache(maxsize=4)
def _scene(query: str, name: str, key: str, *, full_size: bool) -> Scene:
    scene = scene_for(query, name, full_size=full_size)
    if key and (found := scene_key(scene)) != key:
        raise HandoverRefused(
            f"the scene {name} is not what it was when its episodes were asked for (key {found}, not {key}): its "
            "file was changed meanwhile, or this machine has another one; start the same command again"
        )
    return scene


def make(unit: DemoUnit) -> Made:
    """Returns what happens when a unit is executed.

    Raises:
        PlanRefused: The plan is not proved, so nothing was moved.
        NotDrawn, QueryError, SceneError: As for `prepared`.
    """
    todo = prepared(unit)
    graph = todo.graph
    how: dict[str, Any] = {
        "vary": False,
        "record_hz": float(unit.recording.rate_hz),
        "physics": physics_of(unit),
        "noise": noise_of(unit),
        "stances": unit.stances,
    }
    if unit.evolve:
        story = evolve(graph, graph.scene, unit.seed, **how)
        return Made(todo, graph, story.rollout, story)
    return Made(todo, graph, rollout(graph, graph.scene, unit.seed, **how))


def physics_of(unit: DemoUnit) -> Physics:
    """Returns the physics that a unit is executed with; a replay needs the same."""
    return drawn_physics(unit.draws("physics")) if unit.variation.physics else STANDARD


def noise_of(unit: DemoUnit) -> CommandNoise:
    """Returns the noise that a unit is executed with; a replay needs the same."""
    return CommandNoise(float(unit.variation.noise_m), int(unit.draws("noise").integers(2**31)))


def drawn_values(unit: DemoUnit, scene: Scene, strays: Mapping[str, Stray]) -> dict[str, Any]:
    """Returns what was drawn for a unit, axis by axis, of what decides how it goes."""
    axes: dict[str, Any] = {}
    if unit.variation.target:
        axes["target"] = {name: asdict(stray) for name, stray in strays.items()}
    if unit.variation.distractors:
        axes["distractors"] = distractors_in(scene)
    if unit.variation.physics:
        axes["physics"] = asdict(physics_of(unit))
    if unit.variation.noise_m:
        axes["noise"] = asdict(noise_of(unit))
    return axes


def meta_of(made: Made) -> dict[str, Any]:
    """Returns what a unit's `unit.json` says of a rollout; `docs/datasets.md` documents each key."""
    done, scale = made.rollout, made.rollout.scene.robot.scale
    task = filled_task(done)
    report = compose(task, scene=made.graph.scene).verify()
    return {
        **described(done),
        "query": made.of.query,
        "paraphrases": list(paraphrases(made.of.query)),
        "task": task.to_json(),
        "detours": [asdict(detour) for detour in done.detours],
        "scene": done.scene.to_json(),
        "verdict": report.verdict.name,
        "certificate": None if report.certificate is None else report.certificate.task_hash,
        "subtasks": [_subtask(done, record) for record in done.subtasks],
        "scaled": [change.to_json() for change in handled_sizes(made.graph.task, done.scene)],
        "record_hz": done.record_hz,
        "object_ids": list(done.trajectory.object_poses),
        "joint_ids": list(done.trajectory.joint_positions),
        "robot": {"scale": scale, "drives": [list(drive) for drive in drives(scale)]},
        "versions": versions(),
        **({} if made.takeover is None else {"takeover": made.takeover}),
    }


@cache
def versions() -> dict[str, str]:
    """Returns the versions of what decides how an episode goes."""
    found = {}
    for name in _LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "missing"
    return found


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
            step_told(step, (done.trajectory.subtask == record.index) & (done.trajectory.step == step.step))
            for step in record.steps
        ],
        "moved_m": dict(record.moved_m),
    }


def step_told(step: StepRecord, rows: NDArray[np.bool_]) -> dict[str, Any]:
    """Returns what is said of a step, with the samples that were taken while it ran.

    Args:
        step: The step.
        rows: (N,) whether each sample was.
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
    """Returns the first sample and the one after the last; None where there is none."""
    rows = np.flatnonzero(chosen)
    return [int(rows[0]), int(rows[-1]) + 1] if len(rows) else None
