"""The decision: obligations in order, their grades, and the verdict with its diagnostics.

Source: docs/semantics.md, Verdicts; docs/proposition.md, Proposition 1'.
"""

from __future__ import annotations

from functools import partial

from oag.explain.findings import all_findings
from oag.flows.completion import complete
from oag.flows.noflow import no_flow
from oag.model.scene import Scene
from oag.progression.compiled import compile_plan
from oag.progression.exact import Undecided, decide, left_open, unroll
from oag.progression.obligations import NOTHING_DECIDED, Decision
from oag.progression.progress import Trace
from oag.repairs.repair import find_fixes
from oag.report import Report, Verdict
from oag.table.library import needed
from oag.table.state import start_state
from oag.task.edits import Fix
from oag.task.task import Task
from oag.task.wellformed import check


def verify(task: Task, scene: Scene, searched: tuple[int, ...] = (), *, exact: bool = False) -> Report:
    """Decides whether a plan reaches its goal from every start state that is consistent with what is known.

    Args:
        task: The plan.
        scene: Its objects and what is known of the start.
        searched: Indices of the subtasks whose flow was searched; each gets a note.
        exact: Decide everything by a solver, also what is decided without; the verdict is the same.

    Returns:
        A report whose verdict is REFUTED when the plan is not well formed or an obligation fails, CONDITIONAL when one
        needs something unknown or the plan says too much to be decided, and PROVED when all hold.
    """
    malformed = check(task, scene)
    if malformed:
        # What is too much to be decided is no mistake.
        wrong = any(finding.severity == "error" for finding in malformed)
        ordered = sorted(malformed, key=lambda finding: finding.severity != "error")
        verdict = Verdict.REFUTED if wrong else Verdict.CONDITIONAL
        return Report(task, scene, verdict, partial(tuple, ordered), None, repair=_repair)
    trace = follow(task, scene, exact=exact)
    # A choice among unknown alternatives may be the wrong one, and then says nothing of what can be reached.
    proof = None if trace.chose else no_flow(task, scene, trace)
    if trace.failures or proof is not None:
        verdict = Verdict.REFUTED
    else:
        undecided = trace.assumptions or trace.undecided_from is not None
        verdict = Verdict.CONDITIONAL if undecided else Verdict.PROVED
    explain = partial(all_findings, task, scene, trace, proof, searched)
    return Report(task, scene, verdict, explain, trace, proof, _repair)


def _repair(report: Report) -> tuple[Fix, ...]:
    """Returns the verified repairs of a report's plan; a subtask that lacks a flow has one searched."""
    return find_fixes(report, lambda task, scene: verify(complete(task, scene).task, scene))


def follow(task: Task, scene: Scene, *, exact: bool = False) -> Trace:
    """Returns the progression of a well-formed plan, exact where three-valued progression alone would not be.

    Args:
        task: The plan.
        scene: Its scene.
        exact: Decide everything exactly, what progression alone decides included.
    """
    subtasks, goal = compile_plan(task.subtasks, scene), needed(task.goal)
    start = start_state(scene, task.subtasks[0].target if task.subtasks else None)

    def progressed(decision: Decision, *, chose: bool = False) -> Trace:
        trace = Trace(start, scene.categories, decision, chose=chose)
        trace.run(subtasks, goal)
        return trace

    trace = progressed(NOTHING_DECIDED)
    if not exact and not left_open(trace):
        return trace
    unrolled = unroll(trace, subtasks, goal, scene.categories, every=exact)
    try:
        decision = decide(unrolled)
    except Undecided as problem:
        if left_open(trace):
            trace.leave_open(str(problem))
        return trace
    if decision.fails is None and not (decision.given or trace.assumptions or trace.failures):
        return trace
    # What is given is what one run that goes on has in common with others; there may be runs that go on without.
    return progressed(decision, chose=trace.chose or bool(decision.given))
