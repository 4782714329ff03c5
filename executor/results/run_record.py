"""The record of one run, for its report and its output folder, and its JSON."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from executor.evolution.frames import AttemptPictures
from executor.evolution.record import Evolution
from executor.records.rollout import Failure, Rollout, SubtaskRecord
from llm.answers.spending import Spending
from oag import Action, ObjectActionGraph, Report, Task, compose
from oag.revision.grounds import GoalReading
from oag.revision.measurements import measurements_json
from oag.task.sizes import Resizing, handled_sizes, resized, resizings
from oag.task.task import label

Outcome = Literal["succeeded", "failed", "interrupted", "not-run"]


@dataclass(frozen=True, slots=True)
class RunRecord:
    """One run, however far it got.

    Attributes:
        graph: The composed task: the plan that was asked for, and once something moved, the one that ran.
        report: What `verify` decided of it.
        query: What was asked for; None when a task file was given.
        proposal: The proposal's JSON; None when a task file was given.
        notes: What the proposer took on trust, left out or scaled.
        rollout: What was executed; None when nothing was allowed to move.
        interrupted: Whether Ctrl-C ended it.
        pictures: Why there are no pictures, or what drew them; empty when nobody asked for any.
        wall_s: Part of the run -> wall time in seconds.
        command: The command line that repeats the run; empty when it was no command.
        evolution: How failing flows were revised; None when they were not to be.
        attempts: What was drawn of the attempts.
        spending: What its models took; None where none was asked.
        stopped: Why the model that judges gave no more answers; empty where that ended nothing.
    """

    graph: ObjectActionGraph
    report: Report
    query: str | None = None
    proposal: Mapping[str, object] | None = None
    notes: tuple[str, ...] = ()
    rollout: Rollout | None = None
    interrupted: bool = False
    pictures: str = ""
    wall_s: Mapping[str, float] = field(default_factory=dict)
    command: str = ""
    evolution: Evolution | None = None
    attempts: AttemptPictures = field(default_factory=AttemptPictures)
    spending: Spending | None = None
    stopped: str = ""

    def as_ran(self) -> RunRecord:
        """Returns the record with the plan that ran, its numbers and insertions, and what `verify` says of it."""
        if self.rollout is None:
            return self
        graph = compose(filled_task(self.rollout), scene=self.graph.scene)
        return replace(self, graph=graph, report=graph.verify())

    @property
    def outcome(self) -> Outcome:
        """How it ended."""
        if self.interrupted:
            return "interrupted"
        if self.rollout is None:
            return "not-run"
        return "succeeded" if self.rollout.succeeded else "failed"

    @property
    def sizes(self) -> tuple[Resizing, ...]:
        """What is handled, or would be, at another size than it is drawn or described with."""
        task = self.graph.task
        if self.rollout is None:
            return resizings(task.scales, self.graph.scene)
        return handled_sizes(task, self.rollout.scene)


def numbered(task: Task) -> tuple[str, ...]:
    """Returns the steps that have numbers written in, such as "T1.5 ARTICULATE_OPEN"."""
    return tuple(
        f"{label(index, step)} {action.primitive.name}"
        for index, subtask in enumerate(task.subtasks)
        for step, action in enumerate(subtask.flow or ())
        if action.parameter is not None
    )


def opened(task: Task) -> Task:
    """Returns the task with all numbers of its flows left to the planner: `filled_task` the other way round."""
    return replace(
        task,
        subtasks=tuple(
            replace(subtask, flow=subtask.flow and tuple(Action(action.primitive) for action in subtask.flow))
            for subtask in task.subtasks
        ),
    )


def filled_task(rollout: Rollout) -> Task:
    """Returns the task with the flows that were run, numbers included; subtasks that did not run keep theirs."""
    flows = {record.index: record.flow for record in rollout.subtasks}
    subtasks = tuple(
        replace(subtask, flow=flows.get(index, subtask.flow)) for index, subtask in enumerate(rollout.task.subtasks)
    )
    return replace(rollout.task, subtasks=subtasks)


def rollout_json(rollout: Rollout) -> dict[str, object]:
    """Returns a rollout as plain data, without the sampled motion (that is in the episode)."""
    return {
        "task": rollout.task.name,
        "detours": [asdict(detour) for detour in rollout.detours],
        "seed": rollout.seed,
        "succeeded": rollout.succeeded,
        "failure": _failure_json(rollout.failure),
        "state_hash": rollout.state_hash,
        "simulated_s": rollout.simulated_s,
        "planning_wall_s": rollout.planning_wall_s,
        "simulation_wall_s": rollout.simulation_wall_s,
        "samples": len(rollout.trajectory.time_s),
        "penetration": asdict(rollout.penetration),
        "peaks": asdict(rollout.peaks),
        "goal_readings": [_reading_json(reading) for reading in rollout.goal_readings],
        "subtasks": [subtask_json(record) for record in rollout.subtasks],
        "scaled": [change.to_json() for change in resized(rollout.scene)],
        "scene": rollout.scene.to_json(),
    }


def subtask_json(record: SubtaskRecord) -> dict[str, object]:
    """Returns one subtask's record as plain data; its checkpoint is enough to run it again."""
    return {
        "index": record.index,
        "name": record.name,
        "succeeded": record.succeeded,
        "steps": [
            {
                "step": step.step,
                "primitive": step.primitive,
                "action": step.action,
                "start_s": step.start_s,
                "end_s": step.end_s,
                "planning_wall_s": step.planning_wall_s,
                "measurements": measurements_json(step.measurements),
                "failure": _failure_json(step.failure),
            }
            for step in record.steps
        ],
        "readings": [_reading_json(reading) for reading in record.readings],
        "moved_m": dict(record.moved_m),
        "state_hash": record.state_hash,
        "checkpoint": base64.b64encode(record.checkpoint).decode("ascii"),
    }


def _failure_json(failure: Failure | None) -> dict[str, Any] | None:
    return None if failure is None else failure.to_json()


def _reading_json(reading: GoalReading) -> dict[str, object]:
    return {
        "literal": reading.literal,
        "wanted": reading.wanted,
        "value": reading.value,
        "measurements": reading.measurements.to_json(),
    }
