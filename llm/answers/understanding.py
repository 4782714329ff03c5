"""Module 1's answer: the query in terms of the scene, and the task goal.

Source: the paper's Semantic Expansion; `goal` is a departure (docs/proposition.md).
"""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import Field

from llm.answers.base import ActivityName, Answer, Line, MaybeText, Remark, Text
from llm.answers.nothing import says_nothing

# Who says that a query cannot be done has no task to name.
_NO_TASK = {"task_name": "nothing", "task_activity_name": "nothing", "task_message_detail": "", "goal": ""}


class Understanding(Answer):
    """The query in terms of the scene.

    Attributes:
        problem: Why the query cannot be done here, in one sentence; empty when it can.
        task_name: The wish with every object named by its id, such as "put glass_0 into refrigerator_0".
        task_activity_name: The same as an identifier.
        task_message_detail: The description, step by step.
        goal: The task goal G as a BDDL formula; empty when there is a problem.
    """

    problem: Remark = Field(
        default="", description="why the query cannot be done in this scene, one sentence; empty if it can"
    )
    task_name: Line = Field(description="the wish in one line, every object named by its id")
    task_activity_name: ActivityName = Field(description="the same in words joined by underscores")
    task_message_detail: Text = Field(description="where things are and what is done, step by step")
    goal: MaybeText = Field(default="", description="BDDL formula that holds when the wish is fulfilled")

    @classmethod
    def _as_asked(cls, data: Mapping[str, object]) -> dict[str, object]:
        """Returns an object in the form asked for: with a problem, nothing else is needed."""
        plain = super()._as_asked(data)
        problem = plain.get("problem")
        if isinstance(problem, str) and not says_nothing(problem):
            return {**_NO_TASK, **{key: value for key, value in plain.items() if value not in ("", None)}}
        return plain
