"""The way out of a hollow leads over its rim, though a finger fits between the base's steps before and behind it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from executor.geometry import hand_rotation, transform
from executor.planning.collision import CollisionOracle, fingers_may_touch
from executor.planning.drives import can_withdraw, withdraw
from executor.planning.paths import segment
from executor.planning.planner import Planner
from executor.sim.world import World
from oag import Scene, SceneObject
from oag.model.robots import PAPER_ROBOT
from oag.model.scene import RobotPose

TOP_M = 0.83
WIDTH_M, HEIGHT_M = 0.157, 0.063
PITCH_DEG, TIPS_M = 30.0, 0.037
"""How the hand is tilted, and how far above the bowl's middle its tips are."""


def _scene() -> Scene:
    upright, own = (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    counter = SceneObject("cabinet_0", "cabinet", "closed", (0.3, 0.0, TOP_M / 2), upright, (0.6, 1.2, TOP_M), own, {})
    middle = (0.15, 0.0, TOP_M + HEIGHT_M / 2 + 0.001)
    bowl = SceneObject("bowl_0", "bowl", "default", middle, upright, (WIDTH_M, WIDTH_M, HEIGHT_M), own, {})
    robot = RobotPose(position=(-0.25, 0.0, 0.0))
    return Scene(name="bowl", robot=robot, objects={"cabinet_0": counter, "bowl_0": bowl})


@pytest.mark.physics
def test_a_hand_in_a_hollow_leaves_it_over_the_rim() -> None:
    scene = _scene()
    with World(scene) as world, World(scene, oracle=True) as still:
        planner = Planner(CollisionOracle(still))
        planner.start_subtask(world, 0, 0)
        point = world.T_world_link("bowl_0")[:3, 3] + [0.0, 0.0, TIPS_M]
        hand, base = transform(hand_rotation(0.0, np.deg2rad(PITCH_DEG)), point), np.array([point[0] - 0.38, 0.0, 0.0])
        arms = [solution.arm for solution in planner.kinematics.solve(hand, base)]
        inside = [q for q in (np.concatenate([base, arm]) for arm in arms) if planner.oracle.is_free(q)]
        assert inside
        plan = withdraw(planner, inside[0])
        assert plan is not None
        way = np.concatenate([plan.back_off, plan.home])
        dense = np.concatenate(
            [segment(PAPER_ROBOT, a, b, 0.01, base_share=0.1) for a, b in pairwise(way) if np.abs(a - b).max()]
        )
        planner.oracle.base_clearance_m = planner.oracle.arm_clearance_m = 0.0
        assert planner.oracle.is_path_free(dense)


@pytest.mark.physics
def test_a_hand_lets_go_where_it_takes_nothing_along() -> None:
    scene = _scene()
    with World(scene) as world, World(scene, oracle=True) as still:
        planner = Planner(CollisionOracle(still))
        planner.start_subtask(world, 0, 0)
        planner.oracle.opening_m = planner.kinematics.finger_upper_m
        fingers = fingers_may_touch(PAPER_ROBOT, "bowl_0/bowl", hand=True)
        beside = transform(hand_rotation(0.0, 0.0), world.T_world_link("bowl_0")[:3, 3] - [0.20, 0.0, 0.0])
        within = beside.copy()
        within[0, 3] += 0.18
        found = []
        for hand in (beside, within):
            base = np.array([hand[0, 3] - 0.45, 0.0, 0.0])
            arm = planner.kinematics.solve(hand, base)[0].arm
            found.append(can_withdraw(planner, np.concatenate([base, arm]), allowed=fingers))
    # Both may touch the bowl; where the palm is in its wall, every way off takes the bowl along.
    assert found == [True, False]
