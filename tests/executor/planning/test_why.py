"""A thing that cannot be taken has a measured reason: how far off the hand stays, or what is in the way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from executor.planning.collision import CollisionOracle
from executor.planning.grasps import item_goals
from executor.planning.picks import explain_pick_failure, in_the_way
from executor.planning.planner import Planner
from executor.planning.stances import TURN_M_PER_RAD, BaseCandidate, HandGoal, nearest_miss
from executor.records import FailureKind
from executor.sim.robot.kinematics import Kinematics
from executor.sim.world import World
from oag.measurements import measurements_json
from oag.model.robots import PAPER_ROBOT
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
    goals = item_goals(PAPER_ROBOT.hand, world.assets["glass_0"], world.T_world_link("glass_0"))
    failure = explain_pick_failure(planner, "glass_0", goals, HERE)
    assert failure.kind is FailureKind.UNREACHABLE
    assert measurements_json(failure.measurements)["residual_m"] > 0.3
    assert all(name.startswith("panda_joint") for name in measurements_json(failure.measurements)["joints_at_limit"])
    assert "deg off glass_0" in failure.message


def test_in_a_shut_refrigerator_the_door_is_in_the_way(scene_world: tuple[World, Planner]) -> None:
    world, planner = scene_world
    centre = world.T_world_link("refrigerator_0")[:3, 3]
    world.set_object_pose("glass_0", at(centre[0] - 0.05, centre[1], 0.78))
    planner.start_subtask(world, 0, 0)
    goals = item_goals(PAPER_ROBOT.hand, world.assets["glass_0"], world.T_world_link("glass_0"))
    failure = explain_pick_failure(planner, "glass_0", goals, HERE)
    assert failure.kind is FailureKind.NO_PATH
    assert any("refrigerator_0" in pair for pair in measurements_json(failure.measurements)["in_the_way"])


def test_what_stands_on_the_straight_way_is_named(scene_world: tuple[World, Planner]) -> None:
    world, planner = scene_world
    planner.start_subtask(world, 0, 0)
    q = np.array([*HERE, *PAPER_ROBOT.home])
    through = in_the_way(planner, q, np.array([3.0, 0.0]))
    assert any("refrigerator_0" in pair for pair in through)
    assert in_the_way(planner, q, np.array([-1.5, 0.0])) == ()


def _off_m(kinematics: Kinematics, arm: np.ndarray, wanted: np.ndarray) -> float:
    """How far a posture's hand is off a pose, the direction counted as a length; the base stands in the origin."""
    T = kinematics.forward(np.concatenate([np.zeros(3), arm]))
    turn = Rotation.from_matrix(T[:3, :3].T @ wanted[:3, :3]).magnitude()
    return float(np.hypot(np.linalg.norm(T[:3, 3] - wanted[:3, 3]), TURN_M_PER_RAD * turn))


@pytest.mark.parametrize(
    "height_m", [pytest.param(1.5, marks=pytest.mark.slow), 1.2, pytest.param(0.0, marks=pytest.mark.slow)]
)
def test_no_posture_that_is_drawn_comes_nearer_than_the_nearest_miss(
    scene_world: tuple[World, Planner], height_m: float
) -> None:
    kinematics = scene_world[1].kinematics
    wanted = at(0.5, 0.0, height_m)
    wanted[:3, :3] = [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]
    miss = nearest_miss(kinematics, [BaseCandidate(HandGoal(wanted, 0.0, 0.0), np.zeros(3), 0.0)])
    assert kinematics.margin(miss.arm) > 0.0
    assert miss.off_m == pytest.approx(_off_m(kinematics, miss.arm, wanted), abs=1e-6)
    drawn = np.random.default_rng(1).uniform(kinematics.arm_lower, kinematics.arm_upper, (4000, 7))
    assert miss.off_m <= min(_off_m(kinematics, arm, wanted) for arm in drawn) + 0.01


def test_a_pose_that_is_reached_is_missed_by_nothing(scene_world: tuple[World, Planner]) -> None:
    kinematics = scene_world[1].kinematics
    wanted = kinematics.forward(np.array([0.2, -0.1, 0.4, 0.3, -0.5, 0.2, -2.0, 0.1, 2.2, 0.5]))
    miss = nearest_miss(kinematics, [BaseCandidate(HandGoal(wanted, 0.0, 0.0), np.array([0.2, -0.1, 0.4]), 0.0)])
    assert miss.residual_m < 1e-4 and miss.residual_rad < 1e-3
