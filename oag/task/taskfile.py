"""Formulas and flows of tasks: in a file a planner's mistakes are kept as diagnostics, in memory they are errors."""

from __future__ import annotations

import re

import bddl
from oag.model.actions import Action, ActionFlow, action_from_json, flow_from_json
from oag.model.codes import eai_label
from oag.model.diagnostic import Diagnostic
from oag.model.errors import FlowError, TaskError
from oag.model.jsonfile import Node, shown

# Stands for a formula that could not be read; the task then carries the reason as an issue.
UNREADABLE: bddl.Formula = bddl.And(())
# A thousand literals have some 30,000 characters; longer ones are no plan of anybody's, and take seconds to refuse.
LONGEST_CONDITION = 40_000

_CODES = {
    "unknown-predicate": "bddl/unknown-predicate",
    "unknown-object": "bddl/unknown-object",
    "unknown-category": "bddl/unknown-category",
    "wrong-arity": "bddl/arity",
}


def subtask_nodes(root: Node) -> list[Node]:
    """Returns the subtasks in order, from the list `sub_tasks` or from the keys `sub_task_1`, `sub_task_2`, ...

    Raises:
        InputError: There are neither, or both, of which one would be lost.
    """
    listed = root.get("sub_tasks")
    matches = [(re.fullmatch(r"sub_task_(\d{1,9})", key), node) for key, node in root.items()]
    numbered = [(int(match[1]), node) for match, node in matches if match is not None]
    if listed is not None:
        if numbered:
            raise listed.fail(
                f"the subtasks are listed here, and {numbered[0][1].place} stands beside the list",
                "write all of them under sub_tasks, or each under sub_task_1, sub_task_2, ...",
            )
        return listed.elements()
    if not numbered:
        return root.require("sub_tasks").elements()
    return [node for _, node in sorted(numbered, key=lambda pair: pair[0])]


def read_formula(node: Node, place: str) -> tuple[bddl.Formula, tuple[Diagnostic, ...]]:
    """Returns a formula and no issue, or a stand-in and what is wrong with the text."""
    text = node.string()
    if len(text) > LONGEST_CONDITION:
        message = f"A condition of {len(text)} characters is not read; at most {LONGEST_CONDITION} are."
        return UNREADABLE, (Diagnostic("bddl/syntax", "error", message, place, eai_label=eai_label("bddl/syntax")),)
    try:
        return bddl.parse_formula(text), ()
    except bddl.BDDLError as problem:
        return UNREADABLE, syntax_issues(problem, place)


def formula_of(given: object, place: str) -> bddl.Formula:
    """Returns a formula, or the one that a text says, where a task is built in memory.

    Raises:
        TaskError: It is neither, or the text says none.
    """
    if isinstance(given, bddl.Formula):
        return given
    if not isinstance(given, str):
        raise TaskError(f"expected a formula or its text, got {shown(given)}", source="(argument)", place=place)
    try:
        return bddl.parse_formula(given)
    except bddl.BDDLError as problem:
        raise TaskError(problem.first_messages, source="(argument)", place=place) from problem


def flow_of(given: object) -> ActionFlow:
    """Returns a flow of actions, of which some may be in the JSON form, where a task is built in memory.

    Raises:
        FlowError: It is no list, or an item is no action.
    """
    if not isinstance(given, list | tuple):
        return flow_from_json(given)
    return tuple(
        item if isinstance(item, Action) else action_from_json(item, index) for index, item in enumerate(given)
    )


def syntax_issues(problem: bddl.BDDLError, place: str) -> tuple[Diagnostic, ...]:
    """Returns what a parser found wrong with a text, as diagnostics of the plan."""
    return tuple(_syntax_issue(found, place) for found in problem.diagnostics)


def _syntax_issue(found: bddl.Diagnostic, place: str) -> Diagnostic:
    """Returns a parser's diagnostic as one of the plan's; codes without a counterpart here are syntax."""
    code = _CODES.get(found.code, "bddl/syntax")
    return Diagnostic(
        code=code,
        severity="error",
        message=f"{found.message} (line {found.line}, column {found.column}; {found.code})",
        place=place,
        hint=found.hint or None,
        excerpt=found.excerpt or None,
        eai_label=eai_label(code),
    )


def read_flow(node: Node | None) -> tuple[ActionFlow | None, tuple[Diagnostic, ...]]:
    """Returns the actions that can be read, and one issue for each that cannot; no flow at all is None."""
    if node is None:
        return None, ()
    actions: list[Action] = []
    issues: list[Diagnostic] = []
    for index, element in enumerate(node.elements()):
        try:
            actions.append(action_from_json(element.value))
        except FlowError as problem:
            issues.append(
                Diagnostic(
                    code=problem.code,
                    severity="error",
                    message=problem.problem,
                    place=f"step {index + 1}",
                    step=index,
                    hint=f"did you mean {' or '.join(problem.near)}?" if problem.near else None,
                    eai_label=eai_label(problem.code),
                )
            )
    return tuple(actions), tuple(issues)
