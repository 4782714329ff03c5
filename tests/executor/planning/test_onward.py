"""Whether the pitch of a grasp is one at which the item can be put down later."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from executor.assets.library import sample
from executor.geometry import pitch_of
from executor.planning.collision import CollisionOracle
from executor.planning.grasps import item_goals
from executor.planning.place_lookahead import LOOKED_AT, PlacementLookahead
from executor.planning.planner import Planner
from executor.planning.stances import HandGoal
from executor.sim.world import World
from oag import Scene, SceneObject
from oag.model.robots import PAPER_ROBOT
from oag.model.scene import RobotPose

TABLE_M = 0.60


@pytest.fixture
def worlds() -> Iterator[list[World]]:
    """Worlds to be closed at the end."""
    made: list[World] = []
    yield made
    for world in made:
        world.close()


def _block(name: str, x_m: float, height_m: float) -> SceneObject:
    extent = (0.6, 0.8, height_m)
    return SceneObject(name, "cabinet", "closed", (x_m, 0.0, height_m / 2), (1, 0, 0, 0), extent, (1, 1, 1), {})


def _pitches_that_lead_on(top_m: float, worlds: list[World]) -> dict[int, bool]:
    """Grasp pitches in degrees of half an apple on a table, and which of them lead on to a top."""
    apple, counter = sample("half_apple", 0, "apple_0"), sample("counter_plain", 0, "counter_0")
    scale = 0.05 / apple.bbox_extent[0]
    apple = replace(
        apple,
        scale=(scale,) * 3,
        position=(-1.2, 0.0, TABLE_M + scale * apple.bbox_extent[2] / 2),
        orientation=(1, 0, 0, 0),
    )
    length, width, _ = counter.bbox_extent
    extent, place = (length, width, top_m), (1.2, 0.0, top_m / 2)
    counter = replace(counter, bbox_extent=extent, position=place, orientation=(1, 0, 0, 0))
    objects = {o.id: o for o in (_block("table_0", -1.4, TABLE_M), apple, counter)}
    scene = Scene(name="onward", robot=RobotPose(position=(0.0, 0.0, 0.0)), objects=objects)
    world, oracle = World(scene), World(scene, oracle=True)
    worlds += [world, oracle]
    planner = Planner(CollisionOracle(oracle))
    planner.start_subtask(world, 0, 0)
    goals = item_goals(PAPER_ROBOT.hand, world.assets["apple_0"], world.T_world_link("apple_0"))
    regions = list(world.assets["counter_0"].regions)
    onward = PlacementLookahead(planner, world, "apple_0", goals, "counter_0", regions, np.zeros(3))
    found = {round(np.rad2deg(pitch_of(g.T_world_eef))): onward.allows_placement(g.T_world_eef) for g in goals}
    assert planner.oracle.carried is None
    return found


@pytest.mark.physics
@pytest.mark.slow
def test_a_hand_from_straight_above_leads_onto_low_tops_but_not_onto_high_ones(worlds: list[World]) -> None:
    assert _pitches_that_lead_on(0.60, worlds)[82]
    high = _pitches_that_lead_on(0.70, worlds)
    assert not high[82], high
    assert high[60] or high[45], high


@pytest.mark.slow
@pytest.mark.physics
def test_where_no_pitch_leads_on_none_is_held_back(worlds: list[World]) -> None:
    assert all(_pitches_that_lead_on(1.40, worlds).values())


@pytest.mark.physics
def test_ways_are_looked_for_longer_where_none_is_found_at_once(
    worlds: list[World], monkeypatch: pytest.MonkeyPatch
) -> None:
    usual, asked = _pitches_that_lead_on(0.60, worlds), []

    def can_be_put(_: PlacementLookahead, goal: HandGoal, looked_at: int) -> tuple[bool, bool]:
        asked.append(looked_at)
        return looked_at > LOOKED_AT and round(np.rad2deg(pitch_of(goal.T_world_eef))) == 82, False

    monkeypatch.setattr(PlacementLookahead, "_can_be_put", can_be_put)
    assert _pitches_that_lead_on(0.60, worlds) == {pitch: pitch == 82 for pitch in usual}
    assert asked == sorted(asked) and len(asked) <= 2 * len(usual), "each pitch is asked once for each number"
