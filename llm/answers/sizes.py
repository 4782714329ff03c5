"""Module 4's answer: the factor by which the target of each simple task is scaled.

Source: the paper's Object Size Adjustment; of several factors for one object the first one counts.
"""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from llm.answers.base import MOST_SUBTASKS, Answer, Number, ObjectId


class SubtaskSize(Answer):
    """The factor of one simple task's target."""

    sub_task: Number = Field(description="number of the subtask")
    target: ObjectId = Field(description="id of its target")
    scale: float = Field(gt=0.0, le=100.0, description="factor; 1.0 leaves the object as it is")


class Sizes(Answer):
    """The factors of all simple tasks' targets, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskSize] = Field(min_length=1, max_length=MOST_SUBTASKS)
