"""Poses of all links for many configurations at once are those of the engine."""

from __future__ import annotations

import numpy as np
import pytest

from executor.sim.robot.kinematics import Kinematics
from executor.sim.robot.link_frames import LinkFrames
from executor.sim.world import World
from oag import Scene
from oag.model.robots import ROBOTS, Robot
from oag.model.scene import RobotPose

pytestmark = pytest.mark.physics


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=lambda robot: robot.name)
def test_link_poses_are_those_of_the_engine(robot: Robot) -> None:
    with World(Scene("empty", RobotPose(name=robot.name), {}), oracle=True) as world:
        kinematics, rng = Kinematics(world.robot, robot), np.random.default_rng(0)
        limits = np.clip(kinematics.lower, -3.0, 3.0), np.clip(kinematics.upper, -3.0, 3.0)
        path, opening_m = rng.uniform(*limits, (5, robot.movers)), 0.4 * kinematics.finger_upper_m
        links = [link.name for link in world.robot.links if link.collision_shapes]
        found, hands = LinkFrames(robot).at(path, opening_m, links)
        for number, q in enumerate(path):
            np.testing.assert_allclose(hands[number], kinematics.forward(q), atol=1e-5)
            world.robot.set_qpos(np.array([*q, opening_m, opening_m], dtype=np.float32))
            world.step()
            for k, link in enumerate(links):
                np.testing.assert_allclose(found[k, number], world.T_world_link("robot", link), atol=1e-4)
