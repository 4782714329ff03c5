"""What a running rollout tells whoever watches it, such as the command line's progress display."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened.

    Attributes:
        kind: What began or ended, or that a flow was revised.
        subtask: Index of the subtask, from 0.
        subtask_count: How many subtasks the task has.
        step: Index of the step in its flow, or -1 for subtask events.
        name: Name of the subtask or primitive.
        simulated_s: Simulated time so far.
        message: A short remark, such as a failure's sentence or a revision's reason; empty when all went well.
    """

    kind: Literal["subtask-start", "step-start", "step-end", "subtask-end", "revision"]
    subtask: int
    subtask_count: int
    step: int
    name: str
    simulated_s: float
    message: str = ""


Listener = Callable[[Event], None]


def ignore(event: Event) -> None:
    """Listens to nothing; the default listener."""
