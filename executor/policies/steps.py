"""Steps of a plan as numbers: which subtask of the task, and which primitive of its flow.

To drive to the refrigerator and to drive to the glass are the same primitive, and not the same deed: so a policy is
told both. In a task of one subtask a step's number is its primitive's.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from oag import Task
from oag.model.primitives import Primitive

Count = TypeVar("Count", int, NDArray[np.int64])

_EACH = 100  # More than there are primitives.

DRIVES = (Primitive.NAVIGATE_TO_TARGET, Primitive.NAVIGATE_TO_SUPPORT)
"""What ends with the base standing where the arm can do what comes next."""


def step_number(subtask: Count, primitive: Count) -> Count:
    """Returns the number of a primitive of a subtask; of arrays one of each."""
    return _EACH * subtask + primitive


def subtask_of(step: Count) -> Count:
    """Returns the index of the subtask that a step is of; of an array one of each."""
    return step // _EACH


def primitive_of(step: int) -> Primitive:
    """Returns the primitive that a step is.

    Raises:
        ValueError: There is none of this number.
    """
    return Primitive(step % _EACH)


def plan_of(task: Task, first: int = 0) -> list[int]:
    """Returns the numbers of the steps of a task's flows, in order, from a subtask on."""
    return [
        step_number(index, action.primitive.value)
        for index, subtask in enumerate(task.subtasks)
        if index >= first
        for action in subtask.flow or ()
    ]
