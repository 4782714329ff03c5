"""Baselines by name, and the three that execute wrong decompositions: unchecked, checked by proof, or repaired first.

A mistake is one change to a right decomposition; it is no language model and imitates none. The first four kinds are
those of the noise model of the canonical form (`benchmarks/noise.py`). The last two are mistakes of order and of a
flow. The task goal stays: it comes from the sentence, apart from the decomposition.

An unchecked run is judged by the right plan's final conditions, at rest, after all flows have run. The conditions of
the wrong decomposition's subtasks are not judged, since nothing has checked them.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import bddl
from bddl import Not, format, parse_formula
from benchmarks.baselines.constraint_pose import LIBRARY_OF_CONSTRAINTS
from benchmarks.baselines.one_demonstration import run_one_demonstration
from benchmarks.baselines.sampled_grasp import LIBRARY_OF_SAMPLES
from executor.bench.units import Unit
from executor.bench.work import prepare, run_unit
from executor.campaign.versions import outcome_version
from executor.records import PlanRefused, Rollout, require_flows
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.evolution_record import Evolution
from executor.rollouts.rollout import Run, rollout
from executor.scenes.pair import ScenePair
from oag import ObjectActionGraph, Primitive, Scene, SimpleTask, Task, compose

BASELINE_VERSION = 1
"""Raised by hand whenever a change alters what a baseline does with an episode."""
BASELINES = {
    "unchecked": "one mistake, unchecked",
    "checked": "one mistake, checked",
    "repaired": "one mistake, repaired",
    "constraint-pose": "like GenSim2 (own code)",
    "sampled-grasp": "like RoboGen (own code)",
    "one-demonstration": "like MimicGen (own code)",
}
"""Baseline -> its label in the table."""

Subtasks = tuple[SimpleTask, ...]
Spoil = Callable[[Subtasks, Scene, random.Random], Subtasks | None]
"""Return wrong subtasks, or None where this kind of mistake does not fit."""


def with_mistake(task: Task, scene: Scene, seed: str) -> tuple[str, Task]:
    """Return a kind of mistake, and the task with it.

    Args:
        task: A right decomposition, with flows.
        scene: Its objects may be confused.
        seed: Decides everything; every kind that fits the task is equally likely.
    """
    rng = random.Random(seed)
    for kind in rng.sample(sorted(MISTAKES), len(MISTAKES)):
        subtasks = MISTAKES[kind](task.subtasks, scene, rng)
        if subtasks is not None and subtasks != task.subtasks:
            return kind, replace(task, subtasks=subtasks)
    raise ValueError(f"{task.name} has no place for any mistake")


def _dropped_subtask(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    if len(subtasks) < 2:
        return None
    at = rng.randrange(len(subtasks))
    return subtasks[:at] + subtasks[at + 1 :]


def _wrong_object(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    at = rng.randrange(len(subtasks))
    roles = sorted({role for role in subtasks[at].roles if role is not None})
    others = [name for name in scene.objects if name not in roles]
    if not others:
        return None
    wrong, other = rng.choice(roles), rng.choice(others)
    return _replace_at(subtasks, at, _with_other_object(subtasks[at], wrong, other))


def _flipped_goal(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    at = rng.randrange(len(subtasks))
    goal = subtasks[at].goal
    return _replace_at(subtasks, at, replace(subtasks[at], goal=goal.body if isinstance(goal, Not) else Not(goal)))


def _swapped_roles(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    found = list(_swaps(subtasks))
    return _replace_at(subtasks, *rng.choice(found)) if found else None


def _swaps(subtasks: Subtasks) -> Iterator[tuple[int, SimpleTask]]:
    for at, subtask in enumerate(subtasks):
        for role in ("support_init", "support_goal"):
            support = getattr(subtask, role)
            if support is not None and support != subtask.target:
                yield at, replace(subtask, **{"target": support, role: subtask.target})
        if subtask.support_init != subtask.support_goal:
            yield at, replace(subtask, support_init=subtask.support_goal, support_goal=subtask.support_init)


def _wrong_order(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    if len(subtasks) < 2:
        return None
    at = rng.randrange(len(subtasks) - 1)
    return (*subtasks[:at], subtasks[at + 1], subtasks[at], *subtasks[at + 2 :])


def _dropped_step(subtasks: Subtasks, scene: Scene, rng: random.Random) -> Subtasks | None:
    at = rng.randrange(len(subtasks))
    flow = subtasks[at].flow or ()
    if len(flow) < 2:
        return None
    step = rng.randrange(len(flow))
    return _replace_at(subtasks, at, replace(subtasks[at], flow=flow[:step] + flow[step + 1 :]))


MISTAKES: dict[str, Spoil] = {
    "dropped subtask": _dropped_subtask,
    "wrong object": _wrong_object,
    "flipped goal": _flipped_goal,
    "swapped roles": _swapped_roles,
    "wrong order": _wrong_order,
    "dropped step": _dropped_step,
}
"""Kind of mistake -> the function that makes it."""


def _replace_at(subtasks: Subtasks, at: int, changed: SimpleTask) -> Subtasks:
    return (*subtasks[:at], changed, *subtasks[at + 1 :])


def _with_other_object(subtask: SimpleTask, wrong: str, other: str) -> SimpleTask:
    """Replace an object by another one in a subtask's roles and conditions."""

    def role(name: str | None) -> str | None:
        return other if name == wrong else name

    def formula(text: str) -> str:
        return re.sub(rf"(?<![\w-]){re.escape(wrong)}(?![\w-])", other, text)

    return replace(
        subtask,
        target=other if subtask.target == wrong else subtask.target,
        support_init=role(subtask.support_init),
        support_goal=role(subtask.support_goal),
        init=parse_formula(formula(format(subtask.init))),
        goal=parse_formula(formula(format(subtask.goal))),
    )


_ANYTHING = bddl.parse_formula("(and)")


class UncheckedRun(Run):
    """Episode of an unverified task; only a failing step ends it before its last flow is done."""

    def change(self, graph: ObjectActionGraph) -> None:
        """Take a task as it is.

        Raises:
            MissingFlow: A subtask has no flow.
        """
        require_flows(graph.task)
        self._graph, self.task = graph, graph.task
        self.goals = tuple(_ANYTHING for _ in graph.task.subtasks)


def prepare_mistaken(unit: Unit) -> tuple[str, ScenePair, ObjectActionGraph]:
    """Return a mistake's kind, a unit's pair and the wrong decomposition; the same for all three baselines."""
    pair, graph = prepare(unit)
    kind, task = with_mistake(graph.task, pair.scene, pair.id)
    return kind, pair, compose(task, scene=pair.scene)


def run_unchecked(unit: Unit, pair: ScenePair, graph: ObjectActionGraph) -> Rollout:
    """Execute the decomposition as it is."""
    right = compose(pair.task, scene=pair.scene).verify()
    parts = dict.fromkeys((*bddl.conjuncts(pair.task.goal), *bddl.conjuncts(right.regressed_goals[-1])))
    task = replace(graph.task, goal=bddl.And(tuple(parts)))
    return UncheckedRun(compose(task, scene=pair.scene), pair.scene, unit.seed).from_start()


def run_checked(unit: Unit, pair: ScenePair, graph: ObjectActionGraph) -> Rollout:
    """Execute the decomposition if it is proved.

    Raises:
        PlanRefused: It is not; nothing moved.
    """
    return rollout(graph, pair.scene, unit.seed, vary=False)


def run_repaired(unit: Unit, pair: ScenePair, graph: ObjectActionGraph) -> Rollout:
    """Execute the decomposition, or where it is refuted the first fix that is proved.

    Fixes that state a fact of the scene are skipped: nothing checks whether the fact is true.

    Raises:
        PlanRefused: It is not proved, and no fix proves it; nothing moved.
    """
    report = graph.verify()
    if report:
        return run_checked(unit, pair, graph)
    fix = report.sure_fix
    if fix is None:
        raise PlanRefused(report)
    task = replace(fix.apply(graph.task), scene=graph.task.scene)
    return run_checked(unit, pair, compose(task, scene=pair.scene))


UnitRunner = Callable[[Unit, ScenePair, ObjectActionGraph], Rollout]

_MISTAKEN: dict[str, UnitRunner] = {"unchecked": run_unchecked, "checked": run_checked, "repaired": run_repaired}


class SingleAttemptRun(Run):
    """Episode without a second grasp: where no place is reachable, it ends."""

    def _regrasped(self, index: int, start: Checkpoint, samples: int) -> None:
        return None


class ConstraintPoseRun(SingleAttemptRun):
    """Episode in the manner of GenSim2."""

    skills = LIBRARY_OF_CONSTRAINTS


class SampledGraspRun(SingleAttemptRun):
    """Episode in the manner of RoboGen."""

    skills = LIBRARY_OF_SAMPLES


def _run_as(run: type[Run]) -> UnitRunner:
    """Return the runner of a right plan as an episode of some class."""
    return lambda unit, pair, graph: run(graph, pair.scene, unit.seed).from_start()


_RIGHT: dict[str, UnitRunner] = {
    "constraint-pose": _run_as(ConstraintPoseRun),
    "sampled-grasp": _run_as(SampledGraspRun),
}


def baseline_version() -> str:
    """Return 16 hexadecimal digits that change when a baseline's result may not be repeated exactly."""
    return outcome_version(BASELINE_VERSION)


def run_baseline(unit: Unit) -> dict[str, Any]:
    """Return the result of a unit whose setting names a baseline, in the form of any other unit's."""
    baseline = unit.setting.baseline
    if baseline not in BASELINES:
        raise ValueError(f"{unit.name} names no baseline")
    if baseline in _MISTAKEN:
        kind, pair, graph = prepare_mistaken(unit)
        return {"mistake": kind, **_run_counting_grasps(unit, _MISTAKEN[baseline], (pair, graph))}
    if baseline in _RIGHT:
        return _run_counting_grasps(unit, _RIGHT[baseline])
    return run_one_demonstration(unit)


def _run_counting_grasps(
    unit: Unit, runner: UnitRunner, ready: tuple[ScenePair, ObjectActionGraph] | None = None
) -> dict[str, Any]:
    """Return a unit's result with the numbers of tried grasps, and of grasps with both fingers in contact."""
    grasps: list[bool] = []

    def run(unit: Unit, pair: ScenePair, graph: ObjectActionGraph) -> tuple[Rollout, Evolution | None]:
        done = runner(unit, pair, graph)
        steps = (step for record in done.subtasks for step in record.steps)
        grasps.extend(step.failure is None for step in steps if step.primitive == Primitive.GRASP.name)
        return done, None

    return {**run_unit(unit, ready=ready, run=run), "grasps_tried": len(grasps), "grasps_held": sum(grasps)}
