"""What the actions of a certificate's flows are, and that a robot could be told to do them.

Part of the independent check: it knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any

from oag.checker.cases import Rejected, require
from oag.model.primitives import ARTICULATIONS, Parameter, Primitive, parameter_problem

# A flow has primitives by number, or as the one key of a mapping.
PRIMITIVES: dict[Any, Primitive] = {key: p for p in Primitive for key in (int(p), str(int(p)))}


def action_of(item: Any) -> tuple[Primitive, Parameter]:
    """Returns the primitive of an action of a flow, with its number."""
    if type(item) is int:
        return PRIMITIVES[item], None
    ((key, value),) = item.items()
    return PRIMITIVES[key], (value[0], value[1]) if isinstance(value, list) else value


def check_flow(index: int, subtask: Mapping[str, Any], items: Collection[str], articulated: Collection[str]) -> None:
    """Checks that every action of a subtask's flow can be meant: about its objects' kinds, by a number that it takes.

    Args:
        index: Of the subtask, for the reason.
        subtask: As the certificate has it.
        items, articulated: Objects that can be taken, and that have a joint.

    Raises:
        Rejected: One is not.
    """
    fixture, item = subtask["target"] in articulated, subtask["target"] in items
    illegal: dict[Primitive, str] = {} if fixture else dict.fromkeys(ARTICULATIONS, "what has no joint")
    if not (fixture or item):
        illegal[Primitive.GRASP] = "furniture"
    if subtask["support_goal"] is None:
        illegal[Primitive.NAVIGATE_TO_SUPPORT] = "no support"
    for action in subtask["flow"] or ():
        if type(action) is int:
            primitive = PRIMITIVES[action]
        else:
            ((key, value),) = action.items()
            primitive = PRIMITIVES[key]
            _check_parameter(primitive, value)
        if primitive in illegal:
            raise Rejected(f"subtask {index}: {primitive.name} is about {illegal[primitive]}")


def _check_parameter(primitive: Primitive, value: Any) -> None:
    """Checks that a primitive takes a number, or a pair of numbers; null leaves it to the executor."""
    if value is None:
        return
    numbers = value if type(value) is list else [value]
    # What is no number, such as a truth value, is taken for one that no primitive takes.
    parameter = [float(number) if type(number) in (int, float) else math.nan for number in numbers]
    require(len(parameter) == (2 if type(value) is list else 1), f"{primitive.name} takes no such list: {value!r:.60}")
    problem = parameter_problem(primitive, (parameter[0], parameter[1]) if type(value) is list else parameter[0])
    require(problem is None, f"{primitive.name} {problem}")
