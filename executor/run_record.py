"""Everything that one run of the pipeline has to tell, gathered for its report and its output folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from executor.evolution_pictures import AttemptPictures
from executor.evolution_record import Evolution
from executor.records import Rollout
from oag import ObjectActionGraph, Report, Task

Outcome = Literal["succeeded", "failed", "interrupted", "not-run"]


@dataclass(frozen=True, slots=True)
class RunRecord:
    """One run, however far it got.

    Attributes:
        graph: The composed task.
        report: What `verify` decided.
        query: What was asked for; None when a task file was given.
        proposal: The proposal's JSON; None when a task file was given.
        notes: What the proposer took on trust.
        rollout: What was executed; None when nothing was allowed to move.
        interrupted: Whether Ctrl-C ended it.
        pictures: Why there are no pictures, or what drew them; empty when nobody asked for any.
        wall_s: Part of the run -> wall time in seconds.
        command: The command line that repeats the run; empty when it was no command.
        evolution: How failing flows were revised; None when they were not to be.
        attempts: What was drawn of the attempts.
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

    @property
    def outcome(self) -> Outcome:
        """How it ended."""
        if self.interrupted:
            return "interrupted"
        if self.rollout is None:
            return "not-run"
        return "succeeded" if self.rollout.succeeded else "failed"


def filled_task(rollout: Rollout) -> Task:
    """Returns the task with the flows that were run, numbers included; subtasks that did not run keep theirs."""
    flows = {record.index: record.flow for record in rollout.subtasks}
    subtasks = tuple(
        replace(subtask, flow=flows.get(index, subtask.flow)) for index, subtask in enumerate(rollout.task.subtasks)
    )
    return replace(rollout.task, subtasks=subtasks)
