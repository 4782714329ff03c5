"""Record of one run for its report and its folder, its JSON, and the files of an evolution (docs/models.md).

`evolution_json` has all attempts of an episode. `pairs` has one line for each revision, fit for training a
failure-aware model: the input of a corrector (context, failing flow, measured failure, critiques, frames), its
answer (cause, revised flow, reason), the outcome, and how to make both motions again; `evolution_pairs.schema.json`
is the form.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from executor.records import Failure, Rollout, SceneFix, SubtaskRecord
from executor.rollouts.evolution_record import AttemptPictures, Evolution, SubtaskStory
from executor.rollouts.feasibility import Feasibility
from executor.rollouts.rollout import failure_of
from executor.sim.faults import fault_json
from executor.system.files import write_text
from llm.structured.conversation import Spending
from oag import Action, ObjectActionGraph, Report, Task, compose
from oag.measurements import GoalReading, measurements_json
from oag.model.actions import flow_to_json
from oag.revision import Attempt, Iteration, Revision
from oag.sizes import Resizing, planned_resizings, resized_targets, scaled_objects
from oag.task_definition import label

Outcome = Literal["succeeded", "failed", "interrupted", "not-run"]


@dataclass(frozen=True, slots=True)
class RunRecord:
    """One run, however far it got.

    Attributes:
        graph: The composed task: the requested plan and, once something moved, the one that ran.
        report: The report of `verify` about it.
        query: The sentence; None when a task file was given.
        proposal: The proposal's JSON; None when a task file was given.
        notes: What the proposer took on trust, left out or scaled.
        rollout: What was executed; None when nothing was allowed to move.
        interrupted: Whether Ctrl-C ended it.
        pictures: Why there are no pictures, or what drew them; empty when none were requested.
        wall_s: Part of the run -> wall time in seconds.
        command: The command line that repeats the run; empty when it was no command.
        evolution: How failing flows were revised; None when they were not to be.
        attempts: Pictures of the attempts.
        spending: Usage of its models; None without a model.
        stopped: Why the model that judges gave no more answers; empty where that ended nothing.
        feasibility: What the dry run of the plan said; None where it was not asked.
        scene_fixes: Changes of the scene, where these were asked for.
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
    feasibility: Feasibility | None = None
    scene_fixes: tuple[SceneFix, ...] = ()

    def as_ran(self) -> RunRecord:
        """Return the record with the plan that ran, its numbers and insertions, and its report of `verify`."""
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
        """Which things are handled, or would be, at another size than drawn or described."""
        task = self.graph.task
        if self.rollout is None:
            return planned_resizings(task.scales, self.graph.scene)
        return resized_targets(task, self.rollout.scene)


def numbered_steps(task: Task) -> tuple[str, ...]:
    """Return the steps that have numbers written in, such as "T1.5 ARTICULATE_OPEN"."""
    return tuple(
        f"{label(index, step)} {action.primitive.name}"
        for index, subtask in enumerate(task.subtasks)
        for step, action in enumerate(subtask.flow or ())
        if action.parameter is not None
    )


def with_open_numbers(task: Task) -> Task:
    """Return the task with all numbers of its flows left to the planner: the inverse of `filled_task`."""
    return replace(
        task,
        subtasks=tuple(
            replace(subtask, flow=subtask.flow and tuple(Action(action.primitive) for action in subtask.flow))
            for subtask in task.subtasks
        ),
    )


def filled_task(rollout: Rollout) -> Task:
    """Return the task with the flows that were run, numbers included; subtasks that did not run keep theirs."""
    flows = {record.index: record.flow for record in rollout.subtasks}
    subtasks = tuple(
        replace(subtask, flow=flows.get(index, subtask.flow)) for index, subtask in enumerate(rollout.task.subtasks)
    )
    return replace(rollout.task, subtasks=subtasks)


def rollout_json(rollout: Rollout) -> dict[str, object]:
    """Return a rollout as plain data, without the sampled motion (that is in the episode)."""
    return {
        "task": rollout.task.name,
        "detours": [asdict(detour) for detour in rollout.detours],
        **rollout.scene_fixes_json,
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
        "goal_readings": [reading_json(reading) for reading in rollout.goal_readings],
        "subtasks": [subtask_json(record) for record in rollout.subtasks],
        "scaled": [change.to_json() for change in scaled_objects(rollout.scene)],
        "scene": rollout.scene.to_json(),
    }


def subtask_json(record: SubtaskRecord) -> dict[str, object]:
    """Return one subtask's record as plain data; its checkpoint is enough to run it again."""
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
        "readings": [reading_json(reading) for reading in record.readings],
        "moved_m": dict(record.moved_m),
        "state_hash": record.state_hash,
        "checkpoint": base64.b64encode(record.checkpoint).decode("ascii"),
    }


def _failure_json(failure: Failure | None) -> dict[str, Any] | None:
    return None if failure is None else failure.to_json()


def reading_json(reading: GoalReading) -> dict[str, object]:
    """Return a reading as plain data."""
    return {
        "literal": reading.literal,
        "wanted": reading.wanted,
        "value": reading.value,
        "measurements": reading.measurements.to_json(),
    }


EVOLUTION_SCHEMA, PAIR_SCHEMA = "scene2demo-evolution/2", "scene2demo-pair/1"

PictureFiles = Mapping[tuple[int, int], list[str]]
"""(Subtask, attempt) -> files of the failed step's pictures, relative to the folder of the pairs."""


def evolution_json(evolution: Evolution) -> dict[str, object]:
    """Return an evolution as plain data; every attempt can be run again from it."""
    rollout = evolution.rollout
    failure = None if evolution.succeeded else failure_of(rollout)
    return {
        "schema": EVOLUTION_SCHEMA,
        "task": evolution.original.name,
        "seed": rollout.seed,
        "succeeded": evolution.succeeded,
        "succeeded_at_once": evolution.succeeded_at_once,
        "revisions": evolution.revisions,
        "failure": None if failure is None else {"kind": failure.kind.value, "message": failure.message},
        "state_hash": rollout.state_hash,
        "faults": [fault_json(fault) for fault in evolution.faults],
        "original": evolution.original.to_json(),
        "evolved": evolution.evolved.to_json(),
        "subtasks": [_story(story) for story in evolution.stories],
        "scene": rollout.scene.to_json(),
    }


def _story(story: SubtaskStory) -> dict[str, object]:
    return {
        "name": story.records[-1].name,
        "solved": story.solved,
        "revisions": story.revisions,
        "gave_up": None if story.gave_up is None else story.gave_up.to_json(),
        "history": story.history.to_json(),
        "records": [subtask_json(record) for record in story.records],
    }


def pairs(evolution: Evolution, frames: PictureFiles | None = None) -> Iterator[dict[str, object]]:
    """Yield one mapping for each revision of an episode, in order of subtasks and attempts.

    Args:
        frames: Pictures of failed attempts, where they were drawn.
    """
    for story in evolution.stories:
        for number, (attempt, revision) in enumerate(story.history.iterations):
            if revision is not None and not attempt.succeeded:
                drawn = (frames or {}).get((story.history.subtask, number), [])
                yield _pair(evolution, story, number, attempt, revision, drawn)


def write_pairs(path: Path, evolution: Evolution, frames: PictureFiles | None = None) -> Path:
    """Write the pairs as JSON lines; an episode that needed no revision leaves an empty file."""
    lines = [json.dumps(pair, sort_keys=True, allow_nan=False) + "\n" for pair in pairs(evolution, frames)]
    return write_text(path, "".join(lines))


def _pair(
    evolution: Evolution, story: SubtaskStory, number: int, attempt: Attempt, revision: Revision, drawn: list[str]
) -> dict[str, object]:
    index = story.history.subtask
    revised = index if revision.subtask is None else revision.subtask
    task, record = evolution.original, story.records[number]
    roles = task.subtasks[index].to_json()
    return {
        "schema": PAIR_SCHEMA,
        "id": f"{task.name}/{evolution.rollout.seed}/T{index + 1}/{number + 1}",
        "context": {
            "task": task.name,
            "detail": task.detail,
            "goal": task.to_json()["goal"],
            "scene": evolution.rollout.scene.name,
            "subtask": index,
            "roles": {key: roles[key] for key in ("target", "support_init", "support_goal", "init", "goal")},
            "faults": [fault_json(fault) for fault in evolution.faults],
            "attempt": number + 1,
        },
        "failing_flow": flow_to_json(attempt.flow),
        "run_flow": flow_to_json(attempt.filled or attempt.flow),
        "failure": {"kind": attempt.failure, "message": attempt.message, "step": attempt.failed_step},
        "hindsight": None if attempt.hindsight is None else attempt.hindsight.to_json(),
        "critiques": [critique.to_json() for critique in attempt.critiques],
        "frames": drawn,
        "revision": {**revision.to_json(), "subtask": revised},
        "outcome": _outcome(evolution, story, number),
        "reproduce": {
            "seed": evolution.rollout.seed,
            "record_hz": evolution.rollout.record_hz,
            "checkpoint": base64.b64encode(record.checkpoint).decode("ascii"),
            "state_hash": record.state_hash,
        },
    }


def _outcome(evolution: Evolution, story: SubtaskStory, number: int) -> dict[str, object]:
    """Return the outcome of a revision: of the next attempt at the revised subtask, and of the episode."""
    place = attempt_after(evolution, story.history.subtask, number)
    after = None if place is None else _attempt(evolution, *place)
    return {
        "subtask_reached": after is not None and (after.succeeded or after.hindsight is not None),
        "stood": after is not None and after.succeeded,
        "failure": None if after is None or after.succeeded else {"kind": after.failure, "message": after.message},
        "episode_succeeded": evolution.succeeded,
    }


def _attempt(evolution: Evolution, subtask: int, number: int) -> Attempt:
    return next(s for s in evolution.stories if s.history.subtask == subtask).history.iterations[number].attempt


def attempt_after(evolution: Evolution, subtask: int, number: int) -> tuple[int, int] | None:
    """Return which attempt ran a revised flow: subtask and attempt, both from 0.

    Args:
        subtask, number: The attempt that was revised.

    Returns:
        None when the episode ended before it.
    """
    iterations = {story.history.subtask: story.history.iterations for story in evolution.stories}
    revision = iterations[subtask][number].revision
    assert revision is not None
    revised = subtask if revision.subtask is None else revision.subtask
    # An earlier subtask's history has the same revision, after the attempt that turned out to be to blame.
    made = number if revised == subtask else _place(iterations[revised], revision)
    return None if made is None or made + 1 >= len(iterations[revised]) else (revised, made + 1)


def _place(iterations: Sequence[Iteration], revision: Revision) -> int | None:
    return next((n for n, (_, made) in enumerate(iterations) if made == revision), None)


def describe_rollout(done: Rollout) -> dict[str, Any]:
    """Return a rollout's entries in the file of a benchmark's or data set's unit."""
    return {
        "ended": "succeeded" if done.succeeded else "failed",
        "failure": _failure_entry(done),
        "subtasks": [_subtask_entry(record) for record in done.subtasks],
        "state_hash": done.state_hash,
        "simulated_s": done.simulated_s,
        "bystanders_moved_m": max((far for record in done.subtasks for far in record.moved_m.values()), default=0.0),
        "penetration": asdict(done.penetration),
        "peaks": asdict(done.peaks),
        "samples": len(done.trajectory.time_s),
    }


def _failure_entry(done: Rollout) -> dict[str, Any] | None:
    failure = None if done.succeeded else failure_of(done)
    if failure is None:
        return None
    step = next((s for record in done.subtasks for s in record.steps if s.failure is failure), None)
    where: Mapping[str, Any] = {}
    if step is not None:
        where = {
            "subtask": step.subtask,
            "subtask_name": done.task.subtasks[step.subtask].name,
            "step": step.step,
            "primitive": step.primitive,
            "action": step.action,
            "time_s": step.end_s,
        }
    return {**failure.to_json(), **where}


def _subtask_entry(record: SubtaskRecord) -> dict[str, Any]:
    return {
        "name": record.name,
        "succeeded": record.succeeded,
        "steps": len(record.steps),
        "planning_s": sum(step.planning_wall_s for step in record.steps),
    }
