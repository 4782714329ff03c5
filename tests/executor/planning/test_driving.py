"""Ways of the base round long furniture."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from executor.planning.collision import CollisionOracle
from executor.planning.paths import segment
from executor.planning.planner import Planner
from executor.sim.world import World
from oag import Scene, SceneObject
from oag.model.robots import PAPER_ROBOT
from oag.model.scene import RobotPose


@pytest.mark.physics
@pytest.mark.parametrize("shift_m", [pytest.param(0.0, marks=pytest.mark.slow), 1.5])
def test_a_way_leads_round_what_is_longer_than_the_floor_between_start_and_goal(shift_m: float) -> None:
    bed = SceneObject("bed_0", "cabinet", "closed", (0.0, shift_m, 0.3), (1, 0, 0, 0), (0.9, 4.4, 0.6), (1, 1, 1), {})
    scene = Scene(name="bed", robot=RobotPose(position=(-1.2, 0.0, 0.0)), objects={"bed_0": bed})
    with World(scene) as world, World(scene, oracle=True) as still:
        planner = Planner(CollisionOracle(still))
        planner.start_subtask(world, 0, 0)
        start = np.concatenate([[-1.2, 0.0, 0.0], PAPER_ROBOT.home])
        path = planner.base_path(start, np.array([1.2, 0.0, 3.0]))
        assert path is not None
        np.testing.assert_allclose(path[-1][:2], [1.2, 0.0])
        rows = np.concatenate([segment(PAPER_ROBOT, a, b) for a, b in pairwise(path)])
        assert planner.oracle.is_path_free(rows)
