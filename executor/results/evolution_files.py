"""The JSON form of an evolution: failures, critiques and corrections as data (docs/evolution.md)."""

from __future__ import annotations

from executor.evolution.record import Evolution, SubtaskStory
from executor.results.run_folder import subtask_json
from executor.rollouts.running import failure_of
from executor.world.faults import fault_json

SCHEMA = "scene2demo-evolution/2"


def evolution_json(evolution: Evolution) -> dict[str, object]:
    """Returns an evolution as plain data; every attempt can be run again from it."""
    rollout = evolution.rollout
    failure = None if evolution.succeeded else failure_of(rollout)
    return {
        "schema": SCHEMA,
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
