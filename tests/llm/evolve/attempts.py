"""Invented attempts for the supervisor's tests: what an inspector would have written of a failed step."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from typing import Any

import oag
from llm.evolve import Miss, Situation
from oag.measurements import (
    AtomMeasured,
    GripLoss,
    GripMeasured,
    HandMeasured,
    JointMotion,
    MeasuredEvidence,
    Measurement,
    Measurements,
    MoveMeasured,
    SupportDrive,
    UnmeantContact,
    Unmet,
    Unplanned,
)
from oag.model.actions import ActionFlow
from oag.revision import Attempt, Critique, History
from tests.oag.paper import scene, task_json

PAPER_SUBTASKS = [
    (name, index) for name, count in (("T1", 4), ("T2", 4), ("T3", 2), ("T4", 2)) for index in range(count)
]


def paper_task(name: str) -> oag.Task:
    """Return one of the paper's tasks with its initial flows."""
    return oag.Task.from_json(task_json(name), scene=scene(name))


_PLAIN: tuple[Measurement, ...] = (
    JointMotion("hinge", "rigid arc", 0.0, 0.0, 0.0, 0.0),
    GripMeasured(),
    SupportDrive("support"),
    HandMeasured((0.0, 0.0, 0.0)),
    MoveMeasured(eef_moved_m=0.0),
    UnmeantContact("panda_hand", "something", "body", 9.0),
    GripLoss(time_s=1.0),
    Unplanned(),
)


def measured(**numbers: Any) -> Measurements:
    """Return the records that have some of these numbers; what is not given has a plain value."""
    own = ((record, {f.name: numbers[f.name] for f in fields(record) if f.name in numbers}) for record in _PLAIN)
    return tuple(replace(record, **given) for record, given in own if given)


def failed(
    flow: ActionFlow,
    step: int,
    failure: str = "",
    *,
    measurements: Mapping[str, Any] | None = None,
    failure_measurements: Mapping[str, Any] | None = None,
    unmet: Mapping[str, Mapping[str, object]] | None = None,
    misses: Iterable[Miss] = (),
) -> Attempt:
    """Return an attempt in which one step is found at fault.

    Args:
        flow: What was run.
        step: The faulty step.
        failure: Its kind; empty when the step ran and did not bring what it should.
        measurements, failure_measurements: What was measured, as for `measured`.
        unmet, misses: Further evidence of its critique.
    """
    critique = Critique(
        step=step,
        primitive=flow[step].primitive,
        motion_verified=not failure,
        state_reached=False,
        text=f"{flow[step]} went wrong.",
        evidence=MeasuredEvidence(
            measurements=measured(**(measurements or {})),
            failure=failure,
            failure_measurements=measured(**(failure_measurements or {})),
            unmet=tuple(Unmet(name, AtomMeasured(**numbers)) for name, numbers in (unmet or {}).items()),
            misses=tuple(misses),
        ),
    )
    return Attempt(
        flow=flow,
        outcome="failed",
        failed_step=step if failure else None,
        failure=failure or "goal-not-reached",
        message="it went wrong",
        critiques=(critique,),
    )


def situation(name: str, subtask: int, attempt: Attempt, history: History | None = None) -> Situation:
    """Return what a supervisor is told of an attempt at a paper's subtask."""
    return Situation(paper_task(name), subtask, scene(name), attempt, history or History(subtask))
