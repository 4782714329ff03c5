"""The actions of a flow as models write them.

The paper's form `[18, {"15": 0.3}, {"19": [0.0, 0.6]}, 5]` mixes integers and objects, which schemas of the wire cannot
say; on the wire each action is `{"primitive": 15, "parameters": [0.3]}`. Both are read.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from llm.answers.base import Answer
from oag import Action, FlowError, Primitive
from oag.model.actions import action_from_json

_LONGEST_PROBLEM = 240
_OWN_KEYS = ("primitive", "parameters", "parameter")
# What may hold a number that is none of the motion.
_BESIDE = (*_OWN_KEYS, "step", "index", "number", "id")
_NO_NUMBERS: tuple[object, ...] = (None, [], {})


class WrittenAction(Answer):
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
    own = isinstance(item, Mapping) and any(key in item for key in _OWN_KEYS)
    written: object = _own_form(item) if own and isinstance(item, Mapping) else _with_id(item)
    try:
        action = action_from_json(written)
    except FlowError as error:
        hint = f"; did you mean {' or '.join(error.near)}?" if error.near else ""
        raise _refused(error.code, error.problem, hint) from None
    values = action.parameter if isinstance(action.parameter, tuple) else (action.parameter,)
    return {"primitive": int(action.primitive), "parameters": [value for value in values if value is not None]}


def _refused(code: str, problem: str, hint: str = "") -> PydanticCustomError:
    short = problem if len(problem) <= _LONGEST_PROBLEM else f"{problem[:_LONGEST_PROBLEM]}..."
    return PydanticCustomError(code, "{problem}", {"problem": short + hint})


def _own_form(item: Mapping[str, object]) -> object:
    """Returns the paper's form of an action that has the form of the wire, mistakes included."""
    if "primitive" not in item:
        raise _refused("flow/unknown-primitive", f"the field primitive is missing; got {', '.join(map(repr, item))}")
    primitive = item["primitive"]
    numbers = item.get("parameters", item.get("parameter"))
    if numbers in _NO_NUMBERS:
        # A number that stands elsewhere would be lost, and another motion run than was meant.
        astray = [key for key, value in item.items() if key not in _BESIDE and not isinstance(value, str | None)]
        if astray:
            raise _refused("flow/parameter", f"numbers stand under parameters, not under {astray[0]!r}")
        return _id(primitive)
    if not isinstance(numbers, list):
        numbers = [numbers]
    return {str(_id(primitive)): numbers[0] if len(numbers) == 1 else numbers}


def _with_id(item: object) -> object:
    if isinstance(item, Mapping) and len(item) == 1:
        ((key, value),) = item.items()
        return _id(key) if value in _NO_NUMBERS else {str(_id(key)): value}
    return _id(item) if isinstance(item, str) else item


def _id(primitive: object) -> object:
    """Returns a primitive's ID where its name is given; what is neither as a text that can be shown."""
    if isinstance(primitive, str):
        name = "_".join(primitive.upper().split())
        return int(Primitive[name]) if name in Primitive.__members__ else primitive
    return primitive if isinstance(primitive, int) else repr(primitive)


WireStep = Annotated[WrittenAction, BeforeValidator(_step)]
