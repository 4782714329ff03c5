"""How places in a plan are named: `T3 put_glass_into_refrigerator, step 4 UNGRASP`, or `T3.4` for short."""

from __future__ import annotations

from oag.knowledge import START
from oag.progress import Trace
from oag.task import Task


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


def producer_place(trace: Trace, time: int) -> str:
    """Returns who wrote at a time: `the start`, or `T2 step 4 GRASP`."""
    if time == START or time % 2:
        return "the start"
    step = trace.steps[time // 2 - 1]
    return f"T{step.subtask + 1} step {step.position + 1} {step.primitive.name}"
