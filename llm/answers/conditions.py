"""Module 3's answer: the initial state and the goal of each simple task, as BDDL formulas.

Source: the paper's BDDL Generation. The objects and their categories are written around them from the scene.
"""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from llm.answers.base import MOST_SUBTASKS, Answer, Formula, Number


class SubtaskConditions(Answer):
    """Where one simple task starts and where it ends."""

    sub_task: Number = Field(description="number of the subtask")
    init: Formula = Field(description="BDDL formula that holds when the subtask starts")
    goal: Formula = Field(description="BDDL formula that holds when the subtask has succeeded")


class Conditions(Answer):
    """The conditions of all simple tasks, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskConditions] = Field(min_length=1, max_length=MOST_SUBTASKS)
