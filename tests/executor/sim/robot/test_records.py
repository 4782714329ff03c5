"""Every robot's record fits its description: names and order of joints, links by role, lift, and what follows of it."""

from __future__ import annotations

import pickle
import typing

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oag
from executor.cli.options import RobotName
from executor.data.units import DemoUnit, Origin
from executor.planning.collision import CollisionOracle
from executor.planning.paths import segment
from executor.planning.stances import HandGoal, base_candidates
from executor.sim.robot.actions import hand_actions, hand_numbers, joint_limits
from executor.sim.robot.description import armatures, drives
from executor.sim.robot.kinematics import Kinematics, LineTracker
from executor.sim.world import World
from executor.skills.trajectories import acceleration_limits, speed_limits, time_path
from oag import Scene
from oag.model.robots import LIFTED, ROBOTS, Robot, record_of_robot, robot_of_record
from oag.model.scene import RobotPose

every_robot = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
DT_S = 1 / 250


def bare(robot: Robot) -> Scene:
    """Return an empty scene with a robot somewhere."""
    return Scene("bare", RobotPose((0.4, -0.3, 0.0), 0.7, robot.name), {}, (), frozenset())


@pytest.mark.physics
@every_robot
def test_joints_and_links_are_those_of_the_loaded_robot(robot: Robot) -> None:
    with World(bare(robot)) as world:
        assert tuple(joint.name for joint in world.robot.active_joints) == robot.joint_names
        links = {link.name for link in world.robot.links}
        assert {*robot.arm_links, *robot.gripper_links, robot.tip_link} <= links
        assert len(drives(robot)) == len(armatures(robot)) == len(robot.joint_names) == len(joint_limits(robot))
        assert np.allclose(world.robot.get_qpos()[: robot.movers], robot.start(0.4, -0.3, 0.7))
        limits = joint_limits(robot)[robot.arm]
        assert (limits[:, 0] < robot.home).all() and (robot.home < limits[:, 1]).all()
        assert len(robot.home) == len(robot.torques_nm) == len(robot.arm_joints)
        assert not robot.mirrored or len(robot.mirrored) == len(robot.arm_joints)


@pytest.mark.physics
@every_robot
def test_the_arm_at_home_is_free_of_base_and_mast_wherever_the_lift_is(robot: Robot) -> None:
    with World(bare(robot), oracle=True) as world:
        low = np.array(robot.start(0.4, -0.3, 0.7))
        high = low.copy()
        high[robot.base][3:] = robot.lift_m
        oracle = CollisionOracle(world)
        assert oracle.hits(low, margin_m=0.01) == oracle.hits(high, margin_m=0.01) == []


@pytest.mark.physics
@every_robot
def test_a_hand_pose_is_solved_at_every_height_of_the_lift_alike(robot: Robot) -> None:
    with World(bare(robot)) as world:
        kinematics = Kinematics(world.robot, robot)
        base = np.array(robot.start(0.4, -0.3, 0.7))[robot.base]
        T_base_eef = np.linalg.inv(kinematics.base_transform(base)) @ kinematics.forward(
            np.concatenate([base, robot.home])
        )
        raised = base.copy()
        raised[3:] = robot.lift_m
        found = kinematics.solve(kinematics.base_transform(raised) @ T_base_eef, raised)
        assert found and np.allclose(found[0].arm.shape, len(robot.arm_joints))
        q = np.concatenate([raised, found[0].arm])
        assert np.allclose(kinematics.forward(q), kinematics.base_transform(raised) @ T_base_eef, atol=2e-3)
        lifted = kinematics.forward(q)
        lifted[2, 3] -= 0.02
        path, _ = LineTracker(kinematics).track(q, [lifted])
        assert path is not None and np.array_equal(path[-1][robot.base], raised)


@every_robot
@given(st.data())
def test_paths_keep_the_steps_and_limits_of_every_joint(robot: Robot, data: st.DataObject) -> None:
    rows = st.lists(st.floats(-0.5, 0.5), min_size=robot.movers, max_size=robot.movers)
    ends = np.array([data.draw(rows), data.draw(rows)])
    way = np.vstack([ends[:1], segment(robot, *ends)])
    steps = np.abs(np.diff(way, axis=0)).max(axis=0)
    assert (steps[[0, 1]] <= 0.02 + 1e-9).all() and (steps[robot.base][3:] <= 0.02 + 1e-9).all()
    assert (steps[robot.arm] <= 0.05 + 1e-9).all()
    _, velocities = time_path(robot, ends, DT_S)
    if len(velocities):
        assert (np.abs(velocities) <= 1.001 * speed_limits(robot)).all()
        still = np.zeros((1, robot.movers))
        accelerations = np.diff(np.concatenate([still, velocities, still]), axis=0) / DT_S
        assert (np.abs(accelerations) <= 1.01 * acceleration_limits(robot)).all()


@pytest.mark.parametrize("height_m", [0.1, 0.75, 0.95, 1.6])
def test_bases_come_with_a_height_within_the_lift(height_m: float) -> None:
    level = np.array([[0.0, 0.0, 1.0, 1.2], [0.0, 1.0, 0.0, 0.1], [-1.0, 0.0, 0.0, height_m], [0.0, 0.0, 0.0, 1.0]])
    for robot in ROBOTS.values():
        here = np.array(robot.start(0.0, 0.0, 0.0))
        found = list(base_candidates(robot, [HandGoal(level, 0.0)], here, (0.0,)))
        bases = np.stack([candidate.base for candidate in found])
        assert bases.shape[1] == len(robot.base_joints)
        assert (bases[:, 3:] >= 0.0).all() and (bases[:, 3:] <= robot.lift_m).all()
        costs = [candidate.cost for candidate in found]
        assert costs == sorted(costs)


@pytest.mark.physics
@every_robot
def test_hand_actions_have_the_bases_motion_in_its_own_axes(robot: Robot) -> None:
    before = np.array([*robot.start(0.0, 0.0, np.pi / 2), 0.02, 0.02])
    after = before.copy()
    after[:2] += [0.0, 0.1]
    after[robot.base][3:] += 0.05
    (action,) = hand_actions(robot, before, after)
    assert len(action) == hand_numbers(robot) and np.allclose(action[:6], 0.0, atol=1e-9)
    assert np.allclose(action[7:], [0.1, 0.0, 0.0, *[0.05] * bool(robot.lift_m)], atol=1e-9)


def test_scenes_records_and_units_name_their_robot_and_old_ones_are_understood() -> None:
    for robot in ROBOTS.values():
        assert Scene.from_json(bare(robot).to_json()) == bare(robot) and bare(robot).robot.model is robot
        assert robot_of_record(record_of_robot(robot)) is robot and pickle.loads(pickle.dumps(robot)) is robot
        unit = DemoUnit(Origin(family="T1"), 0, robot=robot.name)
        # A family's own robot is not named: one request has one id.
        named = "" if robot is ROBOTS["paper"] else robot.name
        assert DemoUnit.from_json(unit.to_json()) == unit and unit.robot_name == named
    assert bare(ROBOTS["panda"]).to_json()["robot"] == {"position": [0.4, -0.3, 0.0], "yaw": 0.7, "scale": 1.0}
    assert robot_of_record({"scale": 0.7}).name == "paper" and robot_of_record({"scale": 1.0}).name == "panda"
    named, flagged = (DemoUnit(Origin(family="T1"), 0, **asked) for asked in ({"robot": "panda"}, {"full_size": True}))
    assert named.id("v") == flagged.id("v") and "robot" not in flagged.to_json()
    with pytest.raises(oag.SceneError, match=r"expected the name of a robot.*paper, panda, panda-lift"):
        Scene.from_json({"robot": {"position": [0, 0], "name": "hal"}, "objects": {}})
    with pytest.raises(oag.SceneError, match="both 'name' and 'scale'"):
        Scene.from_json({"robot": {"position": [0, 0], "name": LIFTED.name, "scale": 1.0}, "objects": {}})
    with pytest.raises(ValueError, match="no robot is named 'hal'"):
        DemoUnit.from_json({"origin": {"family": "T1"}, "seed": 0, "robot": "hal"})


def test_commands_offer_every_robot() -> None:
    choices = typing.get_args(typing.get_args(typing.get_args(RobotName)[0])[0])
    assert choices == tuple(ROBOTS)
