"""The decision: obligations in order, their grades, and the verdict with its diagnostics.

Source: docs/semantics.md, Verdicts; docs/proposition.md, Proposition 1'.
"""

from __future__ import annotations

from oag.compiled import articulated_ids, compile_subtask
from oag.explain import Explainer
from oag.facts import Condition
from oag.library import needed
from oag.locality import locality_findings
from oag.progress import Trace
from oag.report import Report, Verdict
from oag.scene import Scene
from oag.start import scene_facts, start_knowledge
from oag.task import Task
from oag.vacuous import no_flow_finding, vacuous_findings
from oag.wellformed import check, unfilled_notes


def verify(task: Task, scene: Scene) -> Report:
    """Decides whether a plan reaches its goal from every start state that is consistent with what is known.

    Args:
        task: The plan.
        scene: Its objects and what is known of the start.

    Returns:
        A report whose verdict is REFUTED when the plan is not well formed or an obligation fails, CONDITIONAL when one
        needs something unknown, and PROVED when all hold.
    """
    malformed = check(task, scene)
    if malformed:
        return Report(task, scene, Verdict.REFUTED, malformed, None)
    trace = follow(task, scene)
    explainer = Explainer(task, scene, trace)
    diagnostics = [*explainer.failures(), *explainer.assumptions(), *no_flow_finding(task, trace)]
    if trace.failures:
        verdict = Verdict.REFUTED
    else:
        verdict = Verdict.CONDITIONAL if diagnostics else Verdict.PROVED
        diagnostics.extend(explainer.goal_gaps())
        diagnostics.extend(vacuous_findings(task, trace))
    diagnostics.extend(locality_findings(task, trace))
    diagnostics.extend(unfilled_notes(task))
    return Report(task, scene, verdict, tuple(diagnostics), trace)


def follow(task: Task, scene: Scene) -> Trace:
    """Returns the progression of a well-formed plan.

    Where a step needs one of several unknown things, the first is assumed. If a later step forces another of them, the
    first was not needed: the plan is followed again, and what is forced anyway serves both. So no assumption that is
    listed can be left out.
    """
    trace = _follow(task, scene, frozenset())
    if trace.chose and trace.forced:
        trace = _follow(task, scene, frozenset(trace.forced))
    return trace


def _follow(task: Task, scene: Scene, preferred: frozenset[Condition]) -> Trace:
    articulated = articulated_ids(scene)
    first_target = task.subtasks[0].target if task.subtasks else None
    trace = Trace(
        start_knowledge(scene_facts(scene), first_target),
        {key: thing.category for key, thing in scene.objects.items()},
        preferred,
    )
    trace.run((compile_subtask(subtask, scene, articulated) for subtask in task.subtasks), needed(task.goal))
    return trace
