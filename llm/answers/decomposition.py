"""Module 2's answer: the simple tasks in their order, each with the roles of its objects.

Source: the paper's Subtask Decomposition.
"""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from llm.answers.base import (
    MOST_SUBTASKS,
    ActivityName,
    Answer,
    MaybeLine,
    MaybeObjectId,
    Number,
    ObjectId,
    Sentence,
)


class SubtaskRoles(Answer):
    """One simple task before it has formulas.

    Attributes:
        sub_task: Its number, from 1.
        task_activity_name: What is done, such as `pick_up_glass`.
        task_detail_message: The same for people, in a sentence or two.
        target: Id of the object it acts on (o_t).
        support_init: Id of what the target stands in or on at first (o_s1); empty for none.
        support_goal: Id of what it shall stand in or on (o_s2); empty for none.
        bddl_category: The target's category, as the scene has it; empty where it is not said.
    """

    sub_task: Number = Field(description="1, 2, 3 and so on")
    task_activity_name: ActivityName = Field(description="such as pick_up_glass")
    task_detail_message: Sentence = Field(description="what the robot does, one or two sentences")
    target: ObjectId = Field(description="id of the object that is acted on")
    support_init: MaybeObjectId = Field(
        default="", description="id of what the target stands in or on at first; empty if none"
    )
    support_goal: MaybeObjectId = Field(
        default="", description="id of what the target shall stand in or on; empty if none"
    )
    bddl_category: MaybeLine = Field(default="", description="category of the target, as in the scene")


class Decomposition(Answer):
    """The simple tasks of a task, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskRoles] = Field(min_length=1, max_length=MOST_SUBTASKS)
