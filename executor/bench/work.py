"""Run one unit: make its scene, roll the task out, and return the result as plain data."""

from __future__ import annotations

import gc
import os
import resource
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from executor.bench.units import Unit
from executor.campaign.planning_model import ModelPlan, Plan, model_failure, plan_offline, planned_by
from executor.campaign.versions import outcome_version
from executor.records import PlanRefused, Rollout
from executor.rollouts.evolution_record import Evolution
from executor.rollouts.evolve import evolve
from executor.rollouts.rollout import rollout
from executor.rollouts.run_record import describe_rollout
from executor.scenes.generators.families import pair_of, with_paper_flows
from executor.scenes.pair import ScenePair
from executor.system.files import content_key, json_text
from llm import AnswersRefused, ModelError, QueryError
from oag import ObjectActionGraph, compose
from oag.sizes import Sizing, resized_targets

_MB = 1024 * 1024
_PAGES = Path("/proc/self/statm")


@dataclass
class Stopwatch:
    """Wall time by part.

    Attributes:
        spent_s: Part -> seconds.
    """

    spent_s: dict[str, float] = field(default_factory=dict)
    _began: float = field(default_factory=time.perf_counter)

    def lap(self, part: str) -> None:
        """Add the time since the last lap to a part."""
        now = time.perf_counter()
        self.spent_s[part] = self.spent_s.get(part, 0.0) + now - self._began
        self._began = now


def prepare(unit: Unit, plan: Plan = plan_offline) -> tuple[ScenePair, ObjectActionGraph]:
    """Return a unit's scene-task pair and the composed task, with the unit's flows.

    Args:
        unit: The unit.
        plan: What plans it, where its setting has a model.

    Raises:
        NoPaperFlow: The unit requests flows that the paper does not print.
        QueryError, AnswersRefused, ModelError: The model that plans it gave no plan.
    """
    pair = _drawn(unit)
    return pair, _planned(unit, pair, plan)


def _drawn(unit: Unit) -> ScenePair:
    setting = unit.setting
    return pair_of(unit.family, unit.seed, unit.index, keep_sizes=setting.keep_sizes, robot=setting.robot_name)


def _planned(unit: Unit, pair: ScenePair, plan: Plan) -> ObjectActionGraph:
    task = pair.task if unit.setting.flows == "planned" else with_paper_flows(pair.task, unit.family)
    if unit.setting.model is not None:
        # What the offline plan takes has its size already.
        task = plan(pair.query, pair.scene, Sizing(keep=True))
    return compose(task, scene=pair.scene)


def execute(unit: Unit, pair: ScenePair, graph: ObjectActionGraph) -> tuple[Rollout, Evolution | None]:
    """Execute a unit: the rollout, and its revisions where flows evolve.

    Raises:
        PlanRefused: The plan is not proved, so nothing moved.
    """
    if not unit.setting.evolve:
        return rollout(graph, pair.scene, unit.seed, vary=False), None
    story = evolve(graph, pair.scene, unit.seed, vary=False)
    return story.rollout, story


Execute = Callable[[Unit, ScenePair, ObjectActionGraph], tuple[Rollout, Evolution | None]]


def run_unit(
    unit: Unit,
    *,
    ready: tuple[ScenePair, ObjectActionGraph] | None = None,
    run: Execute = execute,
    plan: Plan = plan_offline,
) -> dict[str, Any]:
    """Run one unit and return its result as plain data; a failed rollout is a result, too.

    Args:
        unit: The unit.
        ready: Pair and graph, if they are not those of `prepare`.
        run: Executes the unit.
        plan: What plans it, where its setting has a model.
    """
    watch = Stopwatch()
    pair = _drawn(unit) if ready is None else ready[0]
    watch.lap("scene")
    result: dict[str, Any] = {
        "pair": pair.id,
        "query": pair.query,
        "scene": pair.scene.name,
        "scene_hash": content_key(json_text(pair.scene.to_json())),
    }
    try:
        graph = _planned(unit, pair, plan) if ready is None else ready[1]
    except (QueryError, AnswersRefused, ModelError) as problem:
        if unit.setting.model is None:
            raise
        watch.lap("model")
        failed = {"ended": "failed", "failure": {"kind": "not-planned", "message": str(problem)}}
        why = failed if isinstance(problem, QueryError) else model_failure(problem)
        return {**result, "proved": False, **why, **planned_by(plan), "wall_s": watch.spent_s, **_memory()}
    if unit.setting.model is not None:
        watch.lap("model")
        result |= {"proved": bool(graph.verify()), **planned_by(plan)}
    result |= {
        "task_hash": content_key(json_text(graph.task.to_json())),
        "subtask_names": [subtask.name for subtask in graph.task.subtasks],
        "scaled": [change.to_json() for change in resized_targets(graph.task, pair.scene)],
    }
    try:
        done, story = run(unit, pair, graph)
    except PlanRefused as refused:
        watch.lap("verify")
        failure = {"kind": "plan-refused", "message": str(refused), "measurements": {}}
        return {**result, "ended": "failed", "failure": failure, "wall_s": watch.spent_s, **_memory()}
    watch.lap("rollout")
    result |= describe_rollout(done) | {"taken_twice": len(done.detours)}
    if story is not None:
        result |= {"revisions": story.revisions, "succeeded_at_once": story.succeeded_at_once}
    planning_s, physics_s = done.planning_wall_s, done.simulation_wall_s
    watch.spent_s |= {"planning": planning_s, "physics": physics_s}
    del done, story
    return {**result, "wall_s": watch.spent_s, **_memory()}


def _memory() -> dict[str, Any]:
    """Return the process's memory now, after the unit is released, and its peak."""
    gc.collect()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    try:
        resident = int(_PAGES.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        # Only Linux reports the present memory.
        resident = peak
    return {"rss_mb": round(resident / _MB, 1), "peak_rss_mb": round(peak / _MB, 1)}


@dataclass(frozen=True, slots=True)
class UnitReplay:
    """A unit that was run again.

    Attributes:
        pair: Its scene and task.
        graph: The composed task.
        rollout: The new rollout.
        story: The revisions, where flows evolve.
        recorded: The unit's record in the benchmark.
    """

    pair: ScenePair
    graph: ObjectActionGraph
    rollout: Rollout
    story: Evolution | None
    recorded: Mapping[str, Any]

    @property
    def same(self) -> bool | None:
        """Whether the states are equal, bit by bit; None when the benchmark has no states to compare."""
        recorded = self.recorded.get("state_hash")
        return None if recorded is None else bool(recorded == self.rollout.state_hash)

    @property
    def verdict(self) -> str:
        """The comparison as a sentence."""
        if self.same is None:
            return f"the unit {self.recorded['ended']} when it was measured, so there are no states to compare with"
        if self.same:
            return "the same states as when it was measured, to the last bit"
        why = "with the same program, so this kind of machine computes otherwise"
        if self.recorded.get("version") != outcome_version():
            why = "the program has changed since then"
        return f"OTHER states than when it was measured: {why}"


def replay(recorded: Mapping[str, Any], answers: Path) -> UnitReplay:
    """Run a unit again; a model is not asked again.

    Args:
        recorded: The unit's file.
        answers: What a model answered for it, where one planned it.

    Raises:
        PlanRefused: The plan is not proved; nothing moved then either.
        QueryError, AnswersRefused, ModelError: The model gave no plan then either.
    """
    unit = Unit.from_json(recorded)
    model = unit.setting.model
    pair, graph = prepare(unit, plan_offline if model is None else ModelPlan.repeated(model, answers))
    done, story = execute(unit, pair, graph)
    return UnitReplay(pair, graph, done, story, recorded)
