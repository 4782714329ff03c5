"""Every baseline by its name: what makes a unit's plan, and what runs it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from executor.baselines.checking import checked, mistaken, repaired, unchecked
from executor.baselines.constraint_pose import LIBRARY_OF_CONSTRAINTS
from executor.baselines.one_demonstration import replayed
from executor.baselines.sampled_grasp import LIBRARY_OF_SAMPLES
from executor.bench.units import BASELINE_VERSION, Baseline, Unit, outcome_version
from executor.bench.work import run_unit
from executor.evolution.record import Evolution
from executor.records.rollout import Rollout, ignore
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.running import RECORD_HZ, Run
from executor.scenes.pair import ScenePair
from oag import ObjectActionGraph, Primitive

Way = Callable[[Unit, ScenePair, ObjectActionGraph], Rollout]

_MISTAKEN: dict[Baseline, Way] = {"unchecked": unchecked, "checked": checked, "repaired": repaired}


class OneTry(Run):
    """An episode that takes nothing again: where no place can be got to, it ends."""

    def _regrasped(self, index: int, start: Checkpoint, samples: int) -> None:
        return None


class ByConstraints(OneTry):
    """An episode in the manner of GenSim2."""

    library = LIBRARY_OF_CONSTRAINTS


class BySamples(OneTry):
    """An episode in the manner of RoboGen."""

    library = LIBRARY_OF_SAMPLES


def _by(run: type[Run]) -> Way:
    """Returns the way that runs a right plan as an episode of some kind."""
    return lambda unit, pair, graph: run(graph, pair.scene, unit.seed, ignore, RECORD_HZ).from_start()


_RIGHT: dict[Baseline, Way] = {"constraint-pose": _by(ByConstraints), "sampled-grasp": _by(BySamples)}


def baseline_version() -> str:
    """Returns 16 hexadecimal digits that change when a result of a baseline may not be repeated exactly."""
    return outcome_version(BASELINE_VERSION)


def run_baseline(unit: Unit) -> dict[str, Any]:
    """Returns the result of a unit whose setting names a baseline, in the form of any other unit's."""
    baseline = unit.setting.baseline
    if baseline is None:
        raise ValueError(f"{unit.name} names no baseline")
    if baseline in _MISTAKEN:
        kind, pair, graph = mistaken(unit)
        return {"mistake": kind, **_counted(unit, _MISTAKEN[baseline], (pair, graph))}
    if baseline in _RIGHT:
        return _counted(unit, _RIGHT[baseline])
    return replayed(unit)


def _counted(unit: Unit, way: Way, ready: tuple[ScenePair, ObjectActionGraph] | None = None) -> dict[str, Any]:
    """Returns a unit's result with how many grasps were tried, and how many had both fingers press."""
    grasps: list[bool] = []

    def run(unit: Unit, pair: ScenePair, graph: ObjectActionGraph) -> tuple[Rollout, Evolution | None]:
        done = way(unit, pair, graph)
        steps = (step for record in done.subtasks for step in record.steps)
        grasps.extend(step.failure is None for step in steps if step.primitive == Primitive.GRASP.name)
        return done, None

    return {**run_unit(unit, ready=ready, run=run), "grasps_tried": len(grasps), "grasps_held": sum(grasps)}
