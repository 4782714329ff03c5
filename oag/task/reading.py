"""Formulas and flows of tasks: in a file a planner's mistakes are kept as diagnostics, in memory they are errors."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from typing import Annotated, NamedTuple

import bddl
from oag.model.actions import Action, ActionFlow, action_from_json, flow_from_json
from oag.model.diagnostic import TASK_GOAL, Diagnostic
from oag.model.errors import FlowError, TaskError
from oag.model.facts import GRIPPER
from oag.model.jsonfile import Document, ReadBy, missing, number, shown
from oag.model.scenefile import SCALES
from oag.table.library import RESTING, placement_of

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
_FIELDS = {"init": "init", "goal": "goal", TASK_GOAL: "goal"}


@dataclass(frozen=True, slots=True)
class TaskForm:
    """What is read of a task's file; the subtasks may also stand under `sub_task_1`, `sub_task_2`, ..."""

    sub_tasks: list[object] | None = None
    task_activity_name: str | None = None
    task_detail_message: str | None = None
    task_message_detail: str | None = None
    goal: str | None = None
    scales: dict[str, Annotated[float, ReadBy(partial(number, low=SCALES[0], high=SCALES[1]))]] | None = None


@dataclass(frozen=True, slots=True)
class SubtaskForm:
    """What is read of a subtask in a task's file; what its texts and its flow say is judged later."""

    init: str
    goal: str
    task_activity_name: str | None = None
    task_detail_message: str | None = None
    task_message_detail: str | None = None
    target: str | None = None
    support_init: str | None = None
    support_goal: str | None = None
    flow: list[object] | None = None


def subtask_places(document: Document, form: TaskForm) -> list[tuple[str | int, ...]]:
    """Returns the paths of the subtasks in order: in the list `sub_tasks`, or at `sub_task_1`, `sub_task_2`, ...

    Raises:
        InputError: There are neither, or both, of which one would be lost.
    """
    matches = (re.fullmatch(r"sub_task_(\d{1,9})", key) for key in document.at())
    numbered = [(int(match[1]), match[0]) for match in matches if match is not None]
    if form.sub_tasks is None and not numbered:
        raise document.fail((), *missing("sub_tasks", document.at()))
    if form.sub_tasks is None:
        return [(key,) for _, key in sorted(numbered, key=lambda pair: pair[0])]
    if numbered:
        problem = f"the subtasks are listed here, and {numbered[0][1]} stands beside the list"
        hint = "write all of them under sub_tasks, or each under sub_task_1, sub_task_2, ..."
        raise document.fail(("sub_tasks",), problem, hint)
    return [("sub_tasks", index) for index in range(len(form.sub_tasks))]


def read_formula(text: str, place: str) -> tuple[bddl.Formula, tuple[Diagnostic, ...]]:
    """Returns a formula and no issue, or a stand-in and what is wrong with the text."""
    if len(text) > LONGEST_CONDITION:
        message = f"A condition of {len(text)} characters is not read; at most {LONGEST_CONDITION} are."
        return UNREADABLE, (Diagnostic("bddl/syntax", "error", message, place, field=_FIELDS[place]),)
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
        field=_FIELDS.get(place),
    )


def unreadable_step(problem: FlowError, place: str, subtask: int | None, step: int | None) -> Diagnostic:
    """Returns the finding for an action, or a whole flow, that cannot be read."""
    hint = f"did you mean {' or '.join(problem.near)}?" if problem.near else None
    return Diagnostic(problem.code, "error", problem.problem, place, subtask, step, hint=hint, meant=problem.meant)


def read_flow(items: list[object] | None) -> tuple[ActionFlow | None, tuple[Diagnostic, ...]]:
    """Returns the actions that can be read, and one issue for each that cannot; no flow at all is None."""
    if items is None:
        return None, ()
    actions: list[Action] = []
    issues: list[Diagnostic] = []
    for index, item in enumerate(items):
        try:
            actions.append(action_from_json(item))
        except FlowError as problem:
            issues.append(unreadable_step(problem, f"step {index + 1}", None, index))
    return tuple(actions), tuple(issues)


# Stands for a target that could not be inferred; the task then carries the reason as an issue.
NO_TARGET = ""


class Roles(NamedTuple):
    """The three objects of a simple task; `problem` says why the target could not be told, and is empty if it could."""

    target: str
    support_init: str | None
    support_goal: str | None
    problem: str = ""


def infer_roles(init: bddl.Formula, goal: bddl.Formula, target: str | None = None) -> Roles:
    """Returns the roles that an initial state and a goal imply.

    Args:
        init: Where the subtask starts.
        goal: Where it ends.
        target: The target, where it is known.

    Returns:
        The target is the one object that stands first in what the goal says beyond the initial state. When that is no
        object, or more than one, `target` is empty and `problem` says so.

    Example:
        >>> import bddl
        >>> infer_roles(bddl.parse_formula("(ontop cup_0 table_0)"), bddl.parse_formula("(not (ontop cup_0 table_0))"))
        Roles(target='cup_0', support_init='table_0', support_goal=None, problem='')
    """
    if target is None:
        subjects = _subjects(init, goal)
        if len(subjects) != 1:
            return Roles(NO_TARGET, None, None, _ambiguous(subjects))
        target = subjects[0]
    placement = placement_of(goal, target)
    return Roles(target, _support_before(init, goal, target), None if placement is None else placement.support)


def _subjects(init: bddl.Formula, goal: bddl.Formula) -> tuple[str, ...]:
    """Returns the objects that the goal says something new about; if it says nothing new, all that it speaks of."""
    literals = bddl.literals(goal)
    if literals is None:
        ordered = sorted(bddl.atoms(goal), key=str)
        return tuple(dict.fromkeys(atom.args[0] for atom in ordered if atom.args and not atom.args[0].startswith("?")))
    before = {(literal.atom, literal.value) for literal in bddl.literals(init) or ()}
    spoken = dict.fromkeys(literal.atom.args[0] for literal in literals if literal.atom.args)
    fresh = [literal for literal in literals if (literal.atom, literal.value) not in before]
    return tuple(dict.fromkeys(literal.atom.args[0] for literal in fresh if literal.atom.args)) or tuple(spoken)


def _ambiguous(subjects: tuple[str, ...]) -> str:
    if not subjects:
        return "the goal speaks of no object, so it cannot be told what the subtask is about"
    named = f"{', '.join(subjects[:-1])} and {subjects[-1]}"
    return f"the goal changes {named}, so it cannot be told which of them the subtask is about"


def _support_before(init: bddl.Formula, goal: bddl.Formula, target: str) -> str | None:
    """Returns what the target rests on or in at first, from the initial state, or from what the goal takes away."""
    for formula, value in ((init, True), (goal, False)):
        for literal in bddl.literals(formula) or ():
            atom = literal.atom
            rests = atom.predicate in RESTING and len(atom.args) == 2 and atom.args[1] != GRIPPER
            if rests and atom.args[0] == target and literal.value is value:
                return atom.args[1]
    return None
