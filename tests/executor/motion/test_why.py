"""A thing that cannot be taken has a measured reason: how far off the hand stays, or what is in the way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from executor.motion.grasps import item_goals
from executor.motion.oracle import CollisionOracle
from executor.motion.planner import Planner
from executor.motion.why import in_the_way, why_not_taken
from executor.records import FailureKind
from executor.robot.description import ARM_HOME
from executor.world import World
from tests.executor.helpers import at, scene_at_paper_size, settle

pytestmark = pytest.mark.physics

HERE = np.array([-0.3, -0.1, 0.0])


@pytest.fixture
def scene_world() -> Iterator[tuple[World, Planner]]:
    scene = scene_at_paper_size("kitchen_t1")
    with World(scene) as world, World(scene, oracle=True) as oracle_world:
        settle(world, 0.1)
        yield world, Planner(CollisionOracle(oracle_world))


def test_out_of_reach_names_the_residual_and_the_joints(scene_world: tuple[World, Planner]) -> None:
    world, planner = scene_world
    world.set_object_pose("glass_0", at(0.0, -1.12, 1.9))
    planner.start_subtask(world, 0, 0)
    goals = item_goals(world.assets["glass_0"], world.T_world_link("glass_0"))
    failure = why_not_taken(planner, "glass_0", goals, HERE)
    assert failure.kind is FailureKind.UNREACHABLE
    assert failure.measurements["residual_m"] > 0.3
    assert all(name.startswith("panda_joint") for name in failure.measurements["joints_at_limit"])
    assert "cm off glass_0" in failure.message


def test_in_a_shut_refrigerator_the_door_is_in_the_way(scene_world: tuple[World, Planner]) -> None:
    world, planner = scene_world
    centre = world.T_world_link("refrigerator_0")[:3, 3]
    world.set_object_pose("glass_0", at(centre[0] - 0.05, centre[1], 0.78))
    planner.start_subtask(world, 0, 0)
    goals = item_goals(world.assets["glass_0"], world.T_world_link("glass_0"))
    failure = why_not_taken(planner, "glass_0", goals, HERE)
    assert failure.kind is FailureKind.NO_PATH
    assert any("refrigerator_0" in pair for pair in failure.measurements["in_the_way"])


def test_what_stands_on_the_straight_way_is_named(scene_world: tuple[World, Planner]) -> None:
    world, planner = scene_world
    planner.start_subtask(world, 0, 0)
    q = np.array([*HERE, *ARM_HOME])
    through = in_the_way(planner, q, np.array([3.0, 0.0]))
    assert any("refrigerator_0" in pair for pair in through)
    assert in_the_way(planner, q, np.array([-1.5, 0.0])) == ()
