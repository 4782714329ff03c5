"""The same wrong decompositions three times: executed as they are, executed where they are proved, and repaired first.

What an unchecked run is judged by is what the right plan has to come to, at rest, when all its flows have run; the
conditions that the wrong decomposition gives its subtasks are not judged, as nobody has checked what they are worth.
"""

from __future__ import annotations

from dataclasses import replace

import bddl
from executor.baselines.mistakes import with_mistake
from executor.bench.units import Unit
from executor.bench.work import prepare
from executor.records.rollout import PlanRefused, Rollout, ignore, require_flows
from executor.rollouts.running import RECORD_HZ, Run, rollout
from executor.scenes.pair import ScenePair
from oag import ObjectActionGraph, compose

_ANYTHING = bddl.parse_formula("(and)")


class UncheckedRun(Run):
    """An episode of whatever a task says; only a step that fails ends it before its last flow is done."""

    def change(self, graph: ObjectActionGraph) -> None:
        """Takes a task as it is.

        Raises:
            MissingFlow: A subtask has no flow.
        """
        require_flows(graph.task)
        self._graph, self.task = graph, graph.task
        self.goals = tuple(_ANYTHING for _ in graph.task.subtasks)


def mistaken(unit: Unit) -> tuple[str, ScenePair, ObjectActionGraph]:
    """Returns the kind of a mistake, a unit's pair and its decomposition with it; the same for all three ways."""
    pair, graph = prepare(unit)
    kind, task = with_mistake(graph.task, pair.scene, pair.id)
    return kind, pair, compose(task, scene=pair.scene)


def unchecked(unit: Unit, pair: ScenePair, graph: ObjectActionGraph) -> Rollout:
    """Returns what comes of executing the decomposition as it is."""
    right = compose(pair.task, scene=pair.scene).verify()
    parts = dict.fromkeys((*bddl.conjuncts(pair.task.goal), *bddl.conjuncts(right.regressed_goals[-1])))
    task = replace(graph.task, goal=bddl.And(tuple(parts)))
    return UncheckedRun(compose(task, scene=pair.scene), pair.scene, unit.seed, ignore, RECORD_HZ).from_start()


def checked(unit: Unit, pair: ScenePair, graph: ObjectActionGraph) -> Rollout:
    """Returns what comes of executing the decomposition if it is proved.

    Raises:
        PlanRefused: It is not; nothing was moved.
    """
    return rollout(graph, pair.scene, unit.seed, vary=False)


def repaired(unit: Unit, pair: ScenePair, graph: ObjectActionGraph) -> Rollout:
    """Returns what comes of executing the decomposition, or where it is refuted the first fix that is proved.

    Fixes that state a fact of the scene are passed over: nobody looks whether it is so.

    Raises:
        PlanRefused: It is not proved, and no fix proves it; nothing was moved.
    """
    report = graph.verify()
    if report:
        return checked(unit, pair, graph)
    fix = report.sure_fix
    if fix is None:
        raise PlanRefused(report)
    task = replace(fix.apply(graph.task), scene=graph.task.scene)
    return checked(unit, pair, compose(task, scene=pair.scene))
