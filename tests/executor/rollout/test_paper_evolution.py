"""The paper's literal flows with faults: each of these seeds failed once, or took more revisions than it had to."""

from __future__ import annotations

import pytest

from benchmarks.evolution_episode import faults_of, task_of
from executor.evolution import evolve
from executor.evolution_record import Evolution
from oag import compose, flow_to_json

pytestmark = [pytest.mark.physics, pytest.mark.slow]


def evolved(name: str, fault: str, seed: int) -> Evolution:
    """Returns the evolution of one of the paper's tasks under a fault."""
    task, scene = task_of(name)
    return evolve(compose(task, scene=scene), scene, seed, faults=faults_of(fault, task, seed) or ())


@pytest.mark.parametrize("fault", ["pose", "grip"])
def test_an_apple_taken_after_a_retreat_needs_one_slide_at_most(fault: str) -> None:
    told = evolved("T2", fault, 16100)
    assert told.succeeded and told.revisions <= 1
    flow = flow_to_json(told.evolved.subtasks[1].flow or ())
    assert flow[:2] == [17, 6] and len(flow) <= 6 + 2 * told.revisions


def test_an_episode_fails_with_its_last_subtask_and_not_after_it() -> None:
    """A glass that leans on a finger in the end is corrected, for no subtask counts as reached while it does."""
    told = evolved("T4", "grip", 16100)
    assert told.succeeded and told.revisions <= 1
    last = told.stories[-1].records[-1]
    touching = [reading.measurements.get("fingers_touching") for reading in last.readings]
    assert touching == [0], "the last subtask is read as the task's goal is: with the fingers off the glass"


def test_a_palm_that_meets_an_apple_believed_too_small_stays_back() -> None:
    told = evolved("T3", "scale", 16100)
    assert told.succeeded and told.revisions <= 2
    first = told.stories[0].history.revisions[0]
    assert first.cause == "the fingers missed" and "the palm met apple_0" in first.explanation
