"""The files of an evolution: failures, critiques and corrections as data (docs/evolution.md).

`evolution_json` has all attempts of an episode. `pairs` has one line for each revision, fit for training a
failure-aware model: what somebody would be told who is to correct the flow (context, failing flow, measured failure,
critiques, frames), what was answered (cause, revised flow, reason), what became of it, and how to make both motions
again; `evolution_pairs.schema.json` is the form.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from executor.evolution.record import Evolution, SubtaskStory
from executor.machine.files import write_text
from executor.results.run_record import subtask_json
from executor.rollouts.running import failure_of
from executor.world.faults import fault_json
from oag import Attempt, Revision, flow_to_json
from oag.revision.history import Iteration

EVOLUTION_SCHEMA, PAIR_SCHEMA = "scene2demo-evolution/2", "scene2demo-pair/1"
SCHEMA_FILE = Path(__file__).with_name("evolution_pairs.schema.json")

PictureFiles = Mapping[tuple[int, int], list[str]]
"""(Subtask, attempt) -> files of the failed step's pictures, relative to the folder of the pairs."""


def evolution_json(evolution: Evolution) -> dict[str, object]:
    """Returns an evolution as plain data; every attempt can be run again from it."""
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
    """Yields one mapping for each revision of an episode, in order of subtasks and attempts.

    Args:
        evolution: The episode.
        frames: Pictures of failed attempts, where they were drawn.
    """
    for story in evolution.stories:
        for number, (attempt, revision) in enumerate(story.history.iterations):
            if revision is not None and not attempt.succeeded:
                drawn = (frames or {}).get((story.history.subtask, number), [])
                yield _pair(evolution, story, number, attempt, revision, drawn)


def write_pairs(path: Path, evolution: Evolution, frames: PictureFiles | None = None) -> Path:
    """Writes the pairs as JSON lines; an episode that needed no revision leaves an empty file."""
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
    """Returns what became of a revision: of the next attempt at the revised subtask, and of the episode."""
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
    """Returns which attempt ran a revised flow: of which subtask, and which of its attempts, both from 0.

    Args:
        evolution: The episode.
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
