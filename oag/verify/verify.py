"""Decision of a plan: obligations in order, their grades, and the verdict with its diagnostics.

Source: docs/semantics.md, Verdicts and Proposition 1'.
"""

from __future__ import annotations

from functools import partial

from oag.exact import Undecided, decide, needs_exact_decision, unroll
from oag.flows import complete, prove_no_flow
from oag.model.scene import Scene
from oag.primitives.state import start_state
from oag.primitives.table import needed
from oag.progression import NOTHING_DECIDED, Decision, Trace, compile_plan
from oag.task import Task
from oag.verify.diagnose import all_findings
from oag.verify.edits import Fix
from oag.verify.fixes import find_fixes
from oag.verify.report import Report, Verdict
from oag.wellformed import check


def verify(task: Task, scene: Scene, searched: tuple[int, ...] = (), *, exact: bool = False) -> Report:
    """Decide whether a plan reaches its goal from every start state that is consistent with what is known.

    Args:
        task: The plan.
        scene: Its objects and what is known of the start.
        searched: Indices of the subtasks whose flow was searched; each gets a note.
        exact: Decide everything by a solver, even what progression decides; the verdict is the same.

    Returns:
        A report. Its verdict is REFUTED when the plan is not well formed or an obligation fails. It is CONDITIONAL when
        an obligation needs an unknown fact, or the plan is too large to be decided. It is PROVED when all obligations
        hold.
    """
    malformed = check(task, scene)
    if malformed:
        # A plan that is too large to be decided is no mistake.
        wrong = any(finding.severity == "error" for finding in malformed)
        ordered = sorted(malformed, key=lambda finding: finding.severity != "error")
        verdict = Verdict.REFUTED if wrong else Verdict.CONDITIONAL
        return Report(task, scene, verdict, partial(tuple, ordered), None, repair=_repair)
    trace = follow(task, scene, exact=exact)
    # A choice among unknown alternatives may be wrong, and then proves nothing about reachability.
    proof = None if trace.chose else prove_no_flow(task, scene, trace)
    if trace.failures or proof is not None:
        verdict = Verdict.REFUTED
    else:
        undecided = trace.assumptions or trace.undecided_from is not None
        verdict = Verdict.CONDITIONAL if undecided else Verdict.PROVED
    explain = partial(all_findings, task, scene, trace, proof, searched)
    return Report(task, scene, verdict, explain, trace, proof, _repair)


def _repair(report: Report) -> tuple[Fix, ...]:
    """Return the verified repairs of a report's plan; the missing flow of a subtask is searched."""
    return find_fixes(report, lambda task, scene: verify(complete(task, scene).task, scene))


def follow(task: Task, scene: Scene, *, exact: bool = False) -> Trace:
    """Return the progression of a well-formed plan, exact where three-valued progression alone would not be.

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
    if not exact and not needs_exact_decision(trace):
        return trace
    unrolled = unroll(trace, subtasks, goal, scene.categories, every=exact)
    try:
        decision = decide(unrolled)
    except Undecided as problem:
        if needs_exact_decision(trace):
            trace.leave_open(str(problem))
        return trace
    if decision.fails is None and not (decision.given or trace.assumptions or trace.failures):
        return trace
    # The given values are sufficient, not necessary: other runs may succeed without them.
    return progressed(decision, chose=trace.chose or bool(decision.given))
