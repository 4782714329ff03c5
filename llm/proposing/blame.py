"""Assign each finding of the graph to the modules that can correct it: by its verified fix, else by its code.

A model cannot change facts of the scene. It can change the task goal only where no plan can reach it. Fixes of
these kinds are not shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bddl
from llm.structured.prompting import CHANGEABLE
from oag import Diagnostic, Fix, Report, Task, Verdict
from oag.model.diagnostics import SCALES, TASK_GOAL

_NOT_OFFERED = frozenset({"add-fact", "change-task-goal"})
_BY_FIX = {
    "insert-subtask": 2,
    "delete-subtask": 2,
    "move-subtask": 2,
    "swap-subtasks": 2,
    "change-role": 2,
    "change-object": 3,
    "change-condition": 3,
    "change-scale": 4,
    "insert-step": 5,
    "delete-step": 5,
    "replace-step": 5,
    "move-step": 5,
    "set-flow": 5,
}
# The likeliest module first; the next one is asked if that one confirms its answer.
_BY_CODE = {
    "task/role-scope": (2, 3),
    "task/contradictory": (3,),
    "task/vacuous": (2, 3),
    "task/size": (4,),
    "flow/kind": (5, 2),
    "flow/no-flow": (2, 3),
    "context/start": (3, 2),
    "context/refuted": (2, 3),
    "context/open": (2, 3),
    "goal/not-reached": (2, 3, 1),
    "goal/undone": (2, 3, 1),
    "locality/outside-scope": (5, 2),
}
# Warnings worth a question; plans with the others work.
_DOUBTS = ("context/open", "task/vacuous")
_LAST_SYMBOLIC = 3


@dataclass(frozen=True, slots=True)
class Charge:
    """A finding and the modules that can correct it, the likeliest first; empty if none can."""

    finding: Diagnostic
    modules: tuple[int, ...]


def charges(report: Report, *, searched: bool) -> tuple[Charge, ...]:
    """Return the findings of a verdict with the modules they are assigned to.

    Args:
        report: The verdict on the plan.
        searched: True when the flows come from a search: then only modules 1 to 3 can be at fault. Otherwise these
            have passed already, so that a failure is first of all one of a flow or a size.
    """
    if report.verdict is Verdict.REFUTED:
        offered = [fix for fix in report.fixes if fix.kind not in _NOT_OFFERED and not fix.assumption]
        return tuple(
            _charge(error, [fix for fix in offered if fix.cause == index], report.task, searched)
            for index, error in enumerate(report.errors)
        )
    doubts = [found for found in report.diagnostics if found.severity == "warning" and found.code in _DOUBTS]
    return tuple(_charge(found, (), report.task, searched) for found in doubts)


def concerns_roles(found: Diagnostic, task: Task) -> bool:
    """Decide whether a finding about a subtask's conditions is caused by its roles.

    Examples: a goal that puts the target elsewhere than on its support_goal; a target to be opened that has no door.
    """
    return found.code == "task/role-scope" or _opens_its_target(found, task)


def _opens_its_target(found: Diagnostic, task: Task) -> bool:
    """Decide whether a finding of kind is about a subtask's own target, which module 2 has chosen."""
    if found.code != "bddl/kind" or found.subtask is None:
        return False
    subtask = task.subtasks[found.subtask]
    opened = bddl.Atom("open", (subtask.target,))
    return any(opened in bddl.atoms(formula) for formula in (subtask.init, subtask.goal))


def _charge(found: Diagnostic, fixes: Sequence[Fix], task: Task, searched: bool) -> Charge:
    finding = replace(found, fixes=tuple(map(str, fixes)))
    by_fix = [_BY_FIX[fix.kind] for fix in fixes if fix.kind in _BY_FIX]
    by_code = _by_place(found) or _BY_CODE.get(found.code, (5,) if found.code.startswith("flow/") else ())
    named = (2, 3) if _opens_its_target(found, task) else tuple(dict.fromkeys((*by_fix, *by_code)))
    if searched:
        # No plan reaches what no primitive changes.
        if not by_fix and found.place == TASK_GOAL and {a.predicate for a in bddl.atoms(task.goal)} - CHANGEABLE:
            return Charge(finding, (1,))
        known = tuple(module for module in named if module <= _LAST_SYMBOLIC)
        return Charge(finding, known or (3, 2))
    last = tuple(module for module in named if module > _LAST_SYMBOLIC)
    rest = tuple(module for module in named if module <= _LAST_SYMBOLIC)
    return Charge(finding, tuple(dict.fromkeys((*(last or (5,)), *rest))))


def _by_place(found: Diagnostic) -> tuple[int, ...]:
    """Return the module that wrote a malformed text, by its place."""
    if not found.code.startswith("bddl/"):
        return ()
    if found.subtask is not None and found.field is not None:
        return (3,)
    if found.place == SCALES:
        return (4,)
    return (1,) if found.place == TASK_GOAL else (2,)
