"""Module 1's answer: the query in terms of the scene, and the task goal.

Source: the paper's Semantic Expansion; `goal` is a departure (docs/proposition.md).
"""

from __future__ import annotations

from pydantic import Field

from llm.answers.base import ActivityName, Answer, Line, Text


class Understanding(Answer):
    """The query in terms of the scene.

    Attributes:
        problem: Why the query cannot be done here, in one sentence; empty when it can.
        task_name: The wish with every object named by its id, such as "put glass_0 into refrigerator_0".
        task_activity_name: The same as an identifier.
        task_message_detail: The description, step by step.
        goal: The task goal G as a BDDL formula; empty when there is a problem.
    """

    problem: Text = Field(description="why the query cannot be done in this scene, one sentence; empty if it can")
    task_name: Line = Field(description="the wish in one line, every object named by its id")
    task_activity_name: ActivityName = Field(description="the same in words joined by underscores")
    task_message_detail: Text = Field(description="where things are and what is done, step by step")
    goal: Text = Field(description="BDDL formula that holds when the wish is fulfilled")
