"""Conditions and flows that are given as texts or in the JSON form.

Of a file, what is wrong is kept as diagnostics, with what could be read. Built in memory, it is an error.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bddl
from oag.model.actions import Action, ActionFlow, action_from_json, flow_from_json
from oag.model.codec import expected, shown
from oag.model.diagnostics import TASK_GOAL, Diagnostic, FlowError, SceneError, TaskError
from oag.model.domain import BUILT_IN, Domain
from oag.model.where import Where

# Stands for an unreadable formula; the task then carries the reason as an issue.
UNREADABLE: bddl.Formula = bddl.And(())
# A thousand literals have some 30,000 characters; no real plan has longer ones, and refusing them takes seconds.
LONGEST_CONDITION = 40_000

_CODES = {
    "unknown-predicate": "bddl/unknown-predicate",
    "unknown-object": "bddl/unknown-object",
    "unknown-category": "bddl/unknown-category",
    "wrong-arity": "bddl/arity",
}
_FIELDS = {"init": "init", "goal": "goal", TASK_GOAL: "goal"}


def read_formula(text: str, place: str, domain: Domain = BUILT_IN) -> tuple[bddl.Formula, tuple[Diagnostic, ...]]:
    """Return a formula and no issue, or a stand-in and what is wrong with the text."""
    if len(text) > LONGEST_CONDITION:
        message = f"A condition of {len(text)} characters is not read; at most {LONGEST_CONDITION} are."
        return UNREADABLE, (Diagnostic("bddl/syntax", "error", message, place, field=_FIELDS[place]),)
    try:
        return domain.formula(text), ()
    except bddl.BDDLError as problem:
        return UNREADABLE, syntax_issues(problem, place)


def formula_of(given: object, place: str, domain: Domain = BUILT_IN) -> bddl.Formula:
    """Return a formula, or the formula of a text, where a task is built in memory; raises TaskError for others."""
    if isinstance(given, bddl.Formula):
        return given
    if not isinstance(given, str):
        raise TaskError(f"expected a formula or its text, got {shown(given)}", source="(argument)", place=place)
    try:
        return domain.formula(given)
    except bddl.BDDLError as problem:
        raise TaskError(problem.first_messages, source="(argument)", place=place, hint=problem.first_hint) from problem


def facts_of(given: object) -> tuple[Any, ...]:
    """Return the facts of a scene that is built in memory; the scene reads those that are texts."""
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise SceneError(expected("a list of facts", given), source="(argument)", place="facts")
    return tuple(given)


def where_of(given: object) -> Where:
    try:
        return Where.parse(given)
    except ValueError as problem:
        raise TaskError(f"{problem}, got {shown(given)}", source="(argument)", place="where") from None


def flow_of(given: object, domain: Domain = BUILT_IN) -> ActionFlow:
    """Return a flow of actions, of which some may be in the JSON form, where a task is built in memory."""
    if not isinstance(given, list | tuple):
        return flow_from_json(given)
    return tuple(
        item if isinstance(item, Action) else action_from_json(item, index, domain) for index, item in enumerate(given)
    )


def syntax_issues(problem: bddl.BDDLError, place: str) -> tuple[Diagnostic, ...]:
    """Return the diagnostics of a parser as diagnostics of the plan."""
    return tuple(_syntax_issue(found, place) for found in problem.diagnostics)


def _syntax_issue(found: bddl.Diagnostic, place: str) -> Diagnostic:
    code = _CODES.get(found.code, "bddl/syntax")
    return Diagnostic(
        code=code,
        severity="error",
        message=f"{found.message} (line {found.line}, column {found.column}; {found.code})",
        place=place,
        hint=found.hint or None,
        excerpt=found.excerpt or None,
        field=_FIELDS.get(place),
    )


def unreadable_step(problem: FlowError, place: str, subtask: int | None, step: int | None) -> Diagnostic:
    """Return the finding for an action, or a whole flow, that cannot be read."""
    hint = f"did you mean {' or '.join(problem.near)}?" if problem.near else None
    return Diagnostic(problem.code, "error", problem.problem, place, subtask, step, hint=hint, meant=problem.meant)


def read_flow(
    items: list[object] | None, domain: Domain = BUILT_IN
) -> tuple[ActionFlow | None, tuple[Diagnostic, ...]]:
    """Return the actions that can be read, and one issue for each that cannot; None for a missing flow."""
    if items is None:
        return None, ()
    actions: list[Action] = []
    issues: list[Diagnostic] = []
    for index, item in enumerate(items):
        try:
            actions.append(action_from_json(item, None, domain))
        except FlowError as problem:
            issues.append(unreadable_step(problem, f"step {index + 1}", None, index))
    return tuple(actions), tuple(issues)
