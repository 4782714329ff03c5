"""Module 3: the initial state and the goal of each simple task, as BDDL formulas.

The objects and their categories are written around them from the scene.

Source: the paper's BDDL Generation, and its table of initial and goal states for T1 to T4.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

import bddl
from llm.answers.base import MOST_SUBTASKS, Answer, Formula, SubtaskAnswer
from llm.answers.conversation import finding
from llm.answers.describe import predicate_table, subtask_table
from llm.answers.prompting import fenced
from llm.modules.blame import is_of_roles
from llm.modules.context import Asked, bare_task
from llm.modules.understand import Understood
from oag import Diagnostic, Scene, SimpleTask
from oag.task.reading import syntax_issues
from oag.task.task import subtask_place
from oag.task.wellformed import check as check_form


class SubtaskConditions(SubtaskAnswer):
    """Where one simple task starts and where it ends."""

    init: Formula = Field(description="BDDL formula that holds when the subtask starts")
    goal: Formula = Field(description="BDDL formula that holds when the subtask has succeeded")


class Conditions(Answer):
    """The conditions of all simple tasks, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskConditions] = Field(min_length=1, max_length=MOST_SUBTASKS)

    def added_to(self, subtasks: Sequence[SimpleTask]) -> tuple[SimpleTask, ...]:
        """Returns simple tasks with these conditions."""
        return tuple(
            replace(subtask, init=bddl.parse_formula(entry.init), goal=bddl.parse_formula(entry.goal))
            for subtask, entry in zip(subtasks, self.sub_tasks, strict=True)
        )


def instantiate(asked: Asked, understood: Understood, subtasks: Sequence[SimpleTask]) -> tuple[SimpleTask, ...]:
    """Returns module 2's simple tasks with their initial states and goals, or raises as `Asked.ask` does."""
    places = {
        "task": understood.text(),
        "subtasks": fenced("subtasks", subtask_table(subtasks, conditions=False)),
        "predicates": predicate_table(),
    }
    return asked.ask(
        3, Conditions, lambda given: _wrong(given, subtasks, asked.scene), places, entries=len(subtasks)
    ).added_to(subtasks)


def _wrong(answer: Conditions, subtasks: Sequence[SimpleTask], scene: Scene) -> Iterator[Diagnostic]:
    """Yields mistakes of language, then those of form, then conditions that are about something else."""
    task = bare_task(scene, subtasks)
    unreadable = False
    for index, entry in enumerate(answer.sub_tasks):
        for which, text in (("init", entry.init), ("goal", entry.goal)):
            try:
                bddl.parse_formula(text)
            except bddl.BDDLError as error:
                unreadable = True
                issues = syntax_issues(error, f"{subtask_place(task, index)}, {which}")
                yield from (replace(issue, subtask=index) for issue in issues)
    if unreadable:
        return
    written = answer.added_to(subtasks)
    plan = bare_task(scene, written)
    # What lies in the roles is module 2's to mend; the verdict on the plan takes it there.
    yield from (found for found in check_form(plan, scene) if not is_of_roles(found, plan))
    for index, subtask in enumerate(written):
        for which, formula in (("init", subtask.init), ("goal", subtask.goal)):
            names = {name for atom in bddl.atoms(formula) for name in atom.args}
            # A quantified formula speaks of objects that it does not name.
            if subtask.target not in names and not any(name.startswith("?") for name in names):
                message = f"the {which} {bddl.format(formula)[:200]} does not speak of the target {subtask.target}"
                place = f"{subtask_place(task, index)}, {which}"
                yield finding("answer/off-target", message, place, subtask=index)
