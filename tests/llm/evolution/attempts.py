"""Invented attempts for the supervisor's tests: what an inspector would have written of a failed step."""

from __future__ import annotations

from typing import Any

import oag
from llm.evolution import Situation
from tests.oag.paper import scene, task_json

PAPER_SUBTASKS = [
    (name, index) for name, count in (("T1", 4), ("T2", 4), ("T3", 2), ("T4", 2)) for index in range(count)
]


def paper_task(name: str) -> oag.Task:
    """Returns one of the paper's tasks with its initial flows."""
    return oag.Task.from_json(task_json(name), scene=scene(name))


def failed(flow: oag.ActionFlow, step: int, failure: str = "", **evidence: Any) -> oag.Attempt:
    """Returns an attempt in which one step is found at fault.

    Args:
        flow: What was run.
        step: The faulty step.
        failure: Its kind; empty when the step ran and did not bring what it should.
        evidence: Further evidence of its critique.
    """
    critique = oag.Critique(
        step=step,
        primitive=flow[step].primitive,
        motion_verified=not failure,
        state_reached=False,
        text=f"{flow[step]} went wrong.",
        evidence=({"failure": failure} if failure else {}) | evidence,
    )
    return oag.Attempt(
        flow=flow,
        outcome="failed",
        failed_step=step if failure else None,
        failure=failure or "goal-not-reached",
        message="it went wrong",
        critiques=(critique,),
    )


def situation(name: str, subtask: int, attempt: oag.Attempt, history: oag.History | None = None) -> Situation:
    """Returns what a supervisor is told of an attempt at a paper's subtask."""
    return Situation(paper_task(name), subtask, scene(name), attempt, history or oag.History(subtask))
