"""Faults of belief and of driving: what they do by themselves, and that evolution corrects them."""

from __future__ import annotations

import numpy as np
import pytest

from executor.rollouts.evolve import evolve
from executor.rollouts.rollout import RunConditions
from executor.sim.belief import BelievedWorld
from executor.sim.faults import NavigationOffset, PoseError
from oag.measurements import UnmeantContact, first_of
from tests.executor.helpers import MakeWorld
from tests.executor.rollouts.tasks import t1, t3


def test_a_drawn_error_has_its_size_and_its_seeds_direction() -> None:
    one, again, other = (PoseError.drawn("glass_0", 0.02, seed) for seed in (1, 1, 2))
    assert one == again != other
    assert np.hypot(one.dx_m, one.dy_m) == pytest.approx(0.02, abs=1e-3)


@pytest.mark.parametrize(("way_m", "share"), [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0), (3.0, 1.0)])
def test_a_drive_ends_beside_its_goal_in_the_bases_own_frame(way_m: float, share: float) -> None:
    start, goal = np.zeros(10), np.zeros(10)
    goal[0], goal[2] = way_m, np.pi / 2
    ended = NavigationOffset(0.0, 0.1, 10.0).end(start, goal)
    assert ended[:2] == pytest.approx([way_m - 0.1 * share, 0.0])
    assert ended[2] == pytest.approx(np.pi / 2 + np.deg2rad(10.0) * share)
    assert (ended[3:] == goal[3:]).all()


@pytest.mark.physics
def test_only_the_named_item_is_believed_elsewhere(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    believed = BelievedWorld(world, [PoseError("glass_0", 0.02, -0.01)])
    off = believed.T_world_link("glass_0")[:3, 3] - world.T_world_link("glass_0")[:3, 3]
    assert off == pytest.approx([0.02, -0.01, 0.0])
    assert (believed.T_world_link("table_0") == world.T_world_link("table_0")).all()
    assert believed.dynamic_ids == world.dynamic_ids


@pytest.mark.slow
@pytest.mark.physics
def test_an_item_that_is_elsewhere_is_taken_after_a_slide_by_what_was_measured() -> None:
    evolution = evolve(t3(), seed=7002, conditions=RunConditions(faults=(PoseError.drawn("apple_0", 0.02, 7002),)))
    assert evolution.succeeded and evolution.revisions == 1
    revision = evolution.stories[0].history.revisions[0]
    assert revision.cause == "the fingers missed"
    assert [action.primitive.name for action in revision.flow[:4]] == [
        "NAVIGATE_TO_TARGET",
        "MOVE_BASE_RIGHT",
        "MOVE_BASE_BACKWARD",
        "APPROACH",
    ]


@pytest.mark.slow
@pytest.mark.physics
def test_a_base_that_ended_beside_its_goal_drives_again() -> None:
    evolution = evolve(t1(), seed=7002, conditions=RunConditions(faults=(NavigationOffset(0.0, 0.15),)))
    assert evolution.succeeded and evolution.revisions <= 2
    critique = evolution.stories[2].history.iterations[0].attempt.critiques[1]
    met = first_of(critique.evidence.failure_measurements, UnmeantContact)
    assert met is not None and met.mover.startswith("panda_link") and met.other == "refrigerator_0"
    revision = evolution.stories[2].history.revisions[0]
    names = [action.primitive.name for action in revision.flow[:3]]
    assert names == ["NAVIGATE_TO_SUPPORT", "MOVE_BASE_BACKWARD", "NAVIGATE_TO_SUPPORT"]
