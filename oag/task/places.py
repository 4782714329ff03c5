"""How places in a plan are named: `T3 put_glass_into_refrigerator, step 4 UNGRASP`, or `T3.4` for short."""

from __future__ import annotations

from oag.task.task import Task


def label(subtask: int, step: int) -> str:
    """Returns the short name of a step, such as `T3.4`; both indices count from 0."""
    return f"T{subtask + 1}.{step + 1}"


def subtask_place(task: Task, subtask: int) -> str:
    """Returns the name of a subtask with its number."""
    return f"T{subtask + 1} {task.subtasks[subtask].name}"


def step_place(task: Task, subtask: int, step: int) -> str:
    """Returns the full name of a step."""
    flow = task.subtasks[subtask].flow or ()
    return f"{subtask_place(task, subtask)}, step {step + 1} {flow[step].primitive.name}"
