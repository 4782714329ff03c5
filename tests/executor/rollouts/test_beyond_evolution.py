"""How far evolution comes with weak fingers, a door that something stops, a thing believed too large; and its end."""

from __future__ import annotations

from typing import Any

import pytest

from executor.rollouts.evolution_record import Evolution
from executor.rollouts.evolve import evolve
from executor.rollouts.rollout import RunConditions
from executor.sim.faults import BlockedDoor, Fault, WeakGrip, WrongScale
from oag.model.actions import flow_to_json
from tests.executor.rollouts.tasks import T1_PAPER_FLOWS, T1_ROLES, graph, t1

pytestmark = pytest.mark.physics

SEED = 16100


def opened(*faults: Fault) -> Evolution:
    """Return the evolution of opening the refrigerator."""
    flow: list[Any] = [1, 2, 3, {"4": None}, 5]
    task = graph("kitchen_t1", T1_ROLES[:1], [flow], "(open refrigerator_0)", {})
    return evolve(task, seed=SEED, conditions=RunConditions(faults=faults))


@pytest.mark.slow
def test_fingers_with_half_their_force_pull_the_door_open() -> None:
    told = opened(WeakGrip(15.0))
    assert told.succeeded and told.revisions == 0


@pytest.mark.parametrize("force_n", [pytest.param(2.0, marks=pytest.mark.slow), 12.0])
def test_fingers_that_do_not_move_a_door_end_it_with_what_it_would_take(force_n: float) -> None:
    told = opened(WeakGrip(force_n))
    gave_up = told.stories[0].gave_up
    assert not told.succeeded and told.revisions == 1 and gave_up is not None
    assert gave_up.cause == "the grip was lost" and "fingers that press harder" in gave_up.needed


@pytest.mark.slow
def test_a_door_that_something_stops_ajar_is_opened_to_there() -> None:
    told = opened(BlockedDoor("refrigerator_0", 0.04))
    assert told.succeeded and told.revisions == 2
    assert flow_to_json(told.evolved.subtasks[0].flow or ()) == [1, 2, 3, {"4": [0.0, 0.06]}, 5]


def test_a_thing_believed_wider_than_the_hand_ends_it_before_it_is_touched() -> None:
    told = evolve(t1(), seed=SEED, conditions=RunConditions(faults=(WrongScale("glass_0", 1.3),)))
    assert not told.succeeded and told.revisions == 0
    gave_up = told.stories[-1].gave_up
    assert gave_up is not None and "its size measured anew" in gave_up.needed
    assert "glass_0 is 65 mm wide, the gripper opens to 56 mm" in gave_up.reason


@pytest.mark.slow
def test_a_glass_does_not_get_past_such_a_door() -> None:
    told = evolve(
        t1(T1_PAPER_FLOWS), seed=SEED, conditions=RunConditions(faults=(BlockedDoor("refrigerator_0", 0.04),))
    )
    assert not told.succeeded and [story.solved for story in told.stories] == [True, True, False]
    gave_up = told.stories[-1].gave_up
    assert gave_up is not None and "a free door" in gave_up.needed
    assert "the door of refrigerator_0 ends at 0.06 of its range however far it is to be opened" in gave_up.reason
