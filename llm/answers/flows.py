"""Module 5's answer: the action flow of each simple task.

The paper's form `[18, {"15": 0.3}, {"19": [0.0, 0.6]}, 5]` mixes integers and objects, which schemas of the wire cannot
say; on the wire each action is `{"primitive": 15, "parameters": [0.3]}`. Both are read.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from llm.answers.base import MOST_ACTIONS, MOST_SUBTASKS, Answer, Number
from oag import Action, FlowError, Primitive
from oag.actions import action_from_json

_LONGEST_PROBLEM = 240


class Step(Answer):
    """One action: the ID of its primitive, and its numbers, which may be left out for the executor to fill in."""

    primitive: int = Field(description="ID of the primitive, 1 to 21")
    parameters: list[float] = Field(
        max_length=2, description="empty, one number (m or degrees), or two (joint limits), as the table says"
    )

    def action(self) -> Action:
        """Returns the action; whether its numbers suit the primitive is for `verify` to say."""
        numbers = tuple(self.parameters)
        parameter = None if not numbers else numbers[0] if len(numbers) == 1 else (numbers[0], numbers[1])
        return Action(Primitive(self.primitive), parameter)


def _step(item: object) -> object:
    """Returns an action in the form of the wire, whichever of the two forms it has."""
    own = isinstance(item, Mapping) and ("primitive" in item or "parameters" in item)
    written: object = _own_form(item) if own and isinstance(item, Mapping) else item
    try:
        action = action_from_json(written)
    except FlowError as error:
        # The message repeats what the model wrote, however long that is.
        problem = error.problem if len(error.problem) <= _LONGEST_PROBLEM else f"{error.problem[:_LONGEST_PROBLEM]}..."
        hint = f"; did you mean {' or '.join(error.near)}?" if error.near else ""
        raise PydanticCustomError(error.code, "{problem}", {"problem": problem + hint}) from None
    values = action.parameter if isinstance(action.parameter, tuple) else (action.parameter,)
    return {"primitive": int(action.primitive), "parameters": [value for value in values if value is not None]}


def _own_form(item: Mapping[str, object]) -> object:
    """Returns the paper's form of an action that has the form of the wire, mistakes included."""
    primitive, numbers = item.get("primitive"), item.get("parameters")
    if not isinstance(primitive, int | str):
        primitive = repr(primitive)
    if isinstance(primitive, str) and primitive in Primitive.__members__:
        primitive = int(Primitive[primitive])
    if numbers is None or numbers == []:
        return primitive
    if not isinstance(numbers, list):
        numbers = [numbers]
    return {str(primitive): numbers[0] if len(numbers) == 1 else numbers}


WireStep = Annotated[Step, BeforeValidator(_step)]


class SubtaskFlow(Answer):
    """The flow of one simple task."""

    sub_task: Number = Field(description="number of the subtask")
    flow: list[WireStep] = Field(min_length=1, max_length=MOST_ACTIONS)


class Flows(Answer):
    """The flows of all simple tasks, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskFlow] = Field(min_length=1, max_length=MOST_SUBTASKS)
