"""Regressed goals: what each subtask has to reach for the rest of the plan to go through.

R_k, the regression of the task goal and of all later preconditions back to the boundary after subtask k, is read off
the causal links: it is the set of conditions whose link crosses that boundary. A state that satisfies them lets the
rest of the plan run to the task goal, since no step in between writes what they speak of. In a refuted plan, literals
that fail are left out.

Source: docs/semantics.md, Regressed goals.
"""

from __future__ import annotations

from collections.abc import Iterable

import bddl
from oag.model.facts import Condition
from oag.progression.obligations import Link, Obligation
from oag.progression.progress import Trace
from oag.task.task import Task


def crossing(trace: Trace, count: int) -> tuple[tuple[Condition, ...], ...]:
    """Returns, for the boundary after each of `count` subtasks, the conditions that cross it, robot ones included."""
    sets: list[dict[Condition, None]] = [{} for _ in range(count)]
    for obligation in trace.obligations:
        for link in obligation.links:
            if not link.condition.grade(link.value):
                continue
            for boundary in range(_born(link, obligation, trace), min(obligation.subtask, count)):
                sets[boundary].setdefault(link.condition)
    return tuple(tuple(conditions) for conditions in sets)


def regressed_goals(task: Task, trace: Trace) -> tuple[bddl.Formula, ...]:
    """Returns for each subtask its own goal together with R_k.

    Conditions about the robot alone, such as an empty hand, have no BDDL form and are left out.
    """
    crossings = crossing(trace, len(task.subtasks))
    return tuple(conjunction(s.goal, c) for s, c in zip(task.subtasks, crossings, strict=True))


def conjunction(goal: bddl.Formula, conditions: Iterable[Condition]) -> bddl.Formula:
    """Returns a goal and the conditions that BDDL can say, each once."""
    parts = dict.fromkeys(bddl.conjuncts(goal))
    for condition in conditions:
        literal = condition.literal()
        if literal is not None:
            parts.setdefault(literal)
    return next(iter(parts)) if len(parts) == 1 else bddl.And(tuple(parts))


def _born(link: Link, obligation: Obligation, trace: Trace) -> int:
    """Returns the index of the subtask in which a link's fact got its value; the start counts as subtask 0."""
    if link.producer <= 0:
        return 0
    if link.producer % 2 == 0:
        return trace.steps[link.producer // 2 - 1].subtask
    about_start = any(
        a.time == link.producer and a.condition == link.condition and a.about_start for a in trace.assumptions
    )
    return 0 if about_start else obligation.subtask
