"""Module 3: the initial state and the goal of each simple task.

Source: the paper's BDDL Generation, and its table of initial and goal states for T1 to T4.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

import bddl
from llm.answers.base import MOST_SUBTASKS, Answer, Formula, Number
from llm.answers.conversation import finding
from llm.answers.describe import predicate_table, subtask_table
from llm.answers.prompting import fenced
from llm.modules.blame import is_of_roles
from llm.modules.context import Context, bare_task, numbering
from llm.modules.decompose import task_text
from llm.modules.understand import Understood
from oag import Diagnostic, Scene, SimpleTask
from oag.task.places import subtask_place
from oag.task.taskfile import syntax_issues
from oag.task.wellformed import check as check_form


def instantiate(context: Context, understood: Understood, subtasks: Sequence[SimpleTask]) -> tuple[SimpleTask, ...]:
    """Returns the simple tasks with their initial states and goals.

    Args:
        context: Who is asked.
        understood: What module 1 said.
        subtasks: What module 2 said.

    Raises:
        AnswersRefused: No answer held.
        ModelError: There is no reply.
    """
    places = {
        "task": task_text(understood),
        "subtasks": fenced("subtasks", subtask_table(subtasks, conditions=False)),
        "predicates": predicate_table(),
    }
    answer = context.ask(3, Conditions, lambda given: tuple(_wrong(given, subtasks, context.scene)), places)
    return _with_conditions(answer, subtasks)


def _with_conditions(answer: Conditions, subtasks: Sequence[SimpleTask]) -> tuple[SimpleTask, ...]:
    return tuple(
        replace(subtask, init=bddl.parse_formula(entry.init), goal=bddl.parse_formula(entry.goal))
        for subtask, entry in zip(subtasks, answer.sub_tasks, strict=True)
    )


def _wrong(answer: Conditions, subtasks: Sequence[SimpleTask], scene: Scene) -> Iterator[Diagnostic]:
    """Yields mistakes of language, then those of form, then conditions that are about something else."""
    misnumbered = numbering(answer.sub_tasks, len(subtasks))
    yield from misnumbered
    if misnumbered:
        return
    task = bare_task(scene, subtasks)
    unreadable = False
    for index, entry in enumerate(answer.sub_tasks):
        for which, text in (("init", entry.init), ("goal", entry.goal)):
            issues = _unreadable(text, index, f"{subtask_place(task, index)}, {which}")
            unreadable = unreadable or bool(issues)
            yield from issues
    if unreadable:
        return
    written = _with_conditions(answer, subtasks)
    plan = bare_task(scene, written)
    # What lies in the roles is module 2's to mend; the verdict on the plan takes it there.
    yield from (found for found in check_form(plan, scene) if not is_of_roles(found, plan))
    for index, subtask in enumerate(written):
        for which, formula in (("init", subtask.init), ("goal", subtask.goal)):
            if not any(subtask.target in atom.args for atom in bddl.atoms(formula)) and not _quantified(formula):
                message = f"the {which} {bddl.format(formula)[:200]} does not speak of the target {subtask.target}"
                place = f"{subtask_place(task, index)}, {which}"
                yield finding("answer/off-target", message, place, subtask=index)


def _unreadable(text: str, index: int, place: str) -> tuple[Diagnostic, ...]:
    try:
        bddl.parse_formula(text)
    except bddl.BDDLError as error:
        return tuple(replace(issue, subtask=index) for issue in syntax_issues(error, place))
    return ()


def _quantified(formula: bddl.Formula) -> bool:
    return any(name.startswith("?") for atom in bddl.atoms(formula) for name in atom.args)


class SubtaskConditions(Answer):
    """Where one simple task starts and where it ends."""

    sub_task: Number = Field(description="number of the subtask")
    init: Formula = Field(description="BDDL formula that holds when the subtask starts")
    goal: Formula = Field(description="BDDL formula that holds when the subtask has succeeded")


class Conditions(Answer):
    """The conditions of all simple tasks, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskConditions] = Field(min_length=1, max_length=MOST_SUBTASKS)
