"""Module 2: the simple tasks of a task, in their order, with the roles of their objects.

Source: the paper's Subtask Decomposition.
"""

from __future__ import annotations

from collections.abc import Iterator
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
    SubtaskAnswer,
)
from llm.answers.conversation import finding
from llm.modules.context import Asked, bare_task, numbering
from llm.modules.understand import Understood
from oag import Diagnostic, Scene, SimpleTask
from oag.task.reading import UNREADABLE
from oag.task.wellformed import check as check_form


class SubtaskRoles(SubtaskAnswer):
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

    def subtasks(self) -> tuple[SimpleTask, ...]:
        """Returns the simple tasks, without formulas and flows yet."""
        return tuple(
            SimpleTask(
                name=entry.task_activity_name,
                detail=entry.task_detail_message,
                target=entry.target,
                support_init=entry.support_init or None,
                support_goal=entry.support_goal or None,
                init=UNREADABLE,
                goal=UNREADABLE,
            )
            for entry in self.sub_tasks
        )


def decompose(asked: Asked, understood: Understood) -> tuple[SimpleTask, ...]:
    """Returns the simple tasks of a task that module 1 has understood, or raises as `Asked.ask` does."""
    answer = asked.ask(2, Decomposition, lambda given: _wrong(given, asked.scene), {"task": understood.text()})
    return answer.subtasks()


def _wrong(answer: Decomposition, scene: Scene) -> Iterator[Diagnostic]:
    """Yields wrong numbers, unknown objects, roles that exclude each other, and categories that are not the scene's."""
    yield from numbering(answer.sub_tasks)
    yield from check_form(bare_task(scene, answer.subtasks()), scene)
    for index, entry in enumerate(answer.sub_tasks):
        thing = scene.objects.get(entry.target)
        said = entry.bddl_category
        if said and thing is not None and said.lower() != " ".join(thing.category.lower().split()):
            message = f"the scene calls {thing.id} a {thing.category[:80]!r}, not a {said[:80]!r}"
            place = f"T{index + 1} {entry.task_activity_name}, bddl_category"
            yield finding("answer/category", message, place, subtask=index)
