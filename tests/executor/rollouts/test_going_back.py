"""Causes in an earlier subtask, in the physics: the loop goes back, revises there, and runs forward again."""

from __future__ import annotations

import pytest

import oag
from executor.rollouts.evolution_record import Evolution
from executor.rollouts.evolve import evolve
from executor.rollouts.rollout import RunConditions
from executor.sim.faults import Fault, PoseError, WeakGrip
from oag.measurements import measurements_json
from tests.executor.rollouts.tasks import T1_ROLES, graph, into_an_open_refrigerator

pytestmark = [pytest.mark.physics, pytest.mark.slow]

SEED = 16002
# 2 cm off its middle, and a tenth of a sound grip.
TAKEN_BADLY: tuple[Fault, ...] = (PoseError.drawn("glass_0", 0.02, SEED), WeakGrip(3.0))


@pytest.fixture(scope="module")
def carried() -> Evolution:
    """A glass that was taken badly, and slips when it is carried."""
    return evolve(into_an_open_refrigerator(), seed=SEED, conditions=RunConditions(faults=TAKEN_BADLY))


def test_what_slips_in_the_next_subtask_is_taken_anew(carried: Evolution) -> None:
    assert carried.succeeded
    picking, placing = carried.stories
    first = picking.history.iterations[0]
    assert first.attempt.failure == "blamed-later" and first.attempt.hindsight is not None
    assert first.attempt.hindsight.subtask == 1 and "slipped" in first.attempt.hindsight.message
    grasp = first.attempt.critiques[3]
    assert grasp.finds_fault and "In hindsight: the item was taken badly." in grasp.text
    measured = measurements_json(grasp.evidence.measurements or ())
    assert measured["held_off_m"] > 0.01 and measured["grip_force_n"] < 5.0
    assert first.revision is not None
    names = [action.primitive.name for action in first.revision.flow]
    slides = names[1 : names.index("APPROACH")]
    assert names[0] == "NAVIGATE_TO_TARGET" and "MOVE_BASE_FORWARD" in slides
    assert all(name.startswith("MOVE_BASE") for name in slides)
    assert placing.history.iterations[0].revision == first.revision
    assert placing.history.iterations[0].revision.subtask == 0


def test_attempts_after_going_back_start_from_elsewhere(carried: Evolution) -> None:
    picking, placing = carried.stories
    assert len({attempt.start for attempt, _ in picking.history.iterations}) == 1
    starts = [attempt.start for attempt, _ in placing.history.iterations]
    assert starts[0] != starts[1] == starts[-1]
    assert placing.records[0].checkpoint != placing.records[1].checkpoint
    assert [len(story.records) for story in carried.stories] == [len(s.history.iterations) for s in carried.stories]


def test_what_was_evolved_runs_by_itself_to_the_same_states(carried: Evolution) -> None:
    scene = into_an_open_refrigerator().scene
    alone = evolve(
        oag.compose(carried.evolved, scene=scene),
        scene,
        SEED,
        conditions=RunConditions(faults=TAKEN_BADLY),
        limit=0,
    )
    assert alone.succeeded_at_once and alone.rollout.state_hash == carried.rollout.state_hash


def test_a_door_that_was_opened_too_little_is_opened_further() -> None:
    flows = [[1, 2, 3, {"4": [0.0, 0.25]}, 5], [17, 1, 2, 3, {"7": 0.2}], [18, {"13": 0.4}, {"9": 0.1}, 5]]
    task = graph("kitchen_t1", T1_ROLES[:3], flows, "(inside glass_0 refrigerator_0)", {"glass_0": 0.71})
    told = evolve(task, seed=16000)
    assert told.succeeded and told.revisions == 1
    assert [len(story.records) for story in told.stories] == [2, 2, 2]
    revision = told.stories[0].history.revisions[0]
    assert (revision.subtask, revision.cause) == (0, "the door was opened too little")
    superseded = told.stories[1].history.iterations[0]
    assert superseded.attempt.succeeded and superseded.revision == revision
    assert all(story.solved for story in told.stories)
