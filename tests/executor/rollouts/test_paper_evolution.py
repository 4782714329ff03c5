"""The paper's literal flows with faults: what goes wrong on these seeds, and the change that corrects it."""

from __future__ import annotations

import pytest

from benchmarks.evolution_episode import faults_of, task_of
from executor.rollouts.evolution_record import Evolution
from executor.rollouts.evolve import evolve
from executor.rollouts.rollout import RunConditions
from oag import compose
from oag.model.actions import flow_to_json

pytestmark = [pytest.mark.physics, pytest.mark.slow]


def evolved(name: str, fault: str, seed: int) -> Evolution:
    """Return the evolution of one of the paper's tasks under a fault."""
    task, scene = task_of(name)
    return evolve(
        compose(task, scene=scene), scene, seed, conditions=RunConditions(faults=faults_of(fault, task, seed) or ())
    )


@pytest.mark.parametrize("fault", ["pose", "grip"])
def test_an_apple_taken_after_a_retreat_needs_one_slide(fault: str) -> None:
    told = evolved("T2", fault, 16200)
    assert told.succeeded and told.revisions == 1
    revision = told.stories[1].history.revisions[0]
    assert revision.cause == "the fingers missed" and "which is what the aim was off by" in revision.explanation
    flow = flow_to_json(told.evolved.subtasks[1].flow or ())
    assert flow[:2] == [17, 6] and flow[4:] == [1, 2, 3, {"7": 0.2}]
    slides = [next(iter(move.items())) for move in flow[2:4] if isinstance(move, dict)]
    assert [primitive for primitive, _ in slides] == ["16", "14"]
    # A finger comes to a stop on the apple: what the hand is off by is what it was believed off by, 2 cm.
    assert sum(float(way) ** 2 for _, way in slides) ** 0.5 == pytest.approx(0.02, abs=0.002)


def test_a_palm_that_meets_an_apple_believed_too_small_stays_back() -> None:
    told = evolved("T3", "scale", 16100)
    assert told.succeeded and [len(story.records) for story in told.stories] == [2, 2]
    first = told.stories[0].history.revisions[0]
    assert first.cause == "the fingers missed" and "the palm met apple_0" in first.explanation
    assert flow_to_json(first.flow) == [17, {"14": 0.008}, 1, 2, 3, {"7": 0.2}]


def test_a_base_beside_a_place_that_no_number_leads_to_gets_both_corrections_at_once() -> None:
    told = evolved("T3", "navigation", 16200)
    assert told.succeeded and told.revisions <= 2
    first = told.stories[1].history.revisions[0]
    assert flow_to_json(first.flow) == [18, {"14": 0.1}, 18, {"13": 0.4}, {"9": 0.1}, {"8": None}, 5]
