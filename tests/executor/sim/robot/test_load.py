"""The robot in the physics: it stands still where it is told, and furniture stops it."""

from __future__ import annotations

import numpy as np
import pytest

from executor.sim.engine import ROBOT
from executor.sim.robot.description import FINGER_DRIVE
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import MakeWorld, at, settle

pytestmark = pytest.mark.physics


def test_joints_come_in_the_named_order(make_world: MakeWorld) -> None:
    robot = make_world("kitchen_t1").robot
    assert tuple(joint.name for joint in robot.active_joints) == PAPER_ROBOT.joint_names


def test_joints_have_no_friction_of_their_own(make_world: MakeWorld) -> None:
    assert all(joint.friction == 0.0 for joint in make_world("kitchen_t1").robot.active_joints)


def test_drives_have_a_panda_s_torques_at_the_fourth_power_of_the_size(make_world: MakeWorld) -> None:
    limits = [joint.force_limit for joint in make_world("kitchen_t1").robot.active_joints]
    wanted = [350.0, 350.0, 100.0, *[87 * 0.7**4] * 4, *[12 * 0.7**4] * 3, 30.0, 30.0]
    assert limits == pytest.approx(wanted, rel=1e-6)


def test_fingers_give_way_to_nothing_from_the_side(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    left = world.robot.find_link_by_name("panda_leftfinger")
    for joint in world.robot.active_joints[-2:]:
        joint.set_drive_target(0.015)
    settle(world, 0.5)
    for _ in range(100):
        left.add_force_at_point(
            20.0 * world.T_world_link(ROBOT, PAPER_ROBOT.tip_link)[:3, 1], left.entity_pose.p, "force"
        )
        world.step()
    one, other = world.robot.get_qpos()[-2:]
    assert abs(one - other) < 5e-4


def test_it_stays_at_its_start_pose(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    before = world.robot.get_qpos().copy()
    assert before[:2] == pytest.approx(world.scene.robot.position[:2])
    settle(world, 1.0)
    assert np.abs(world.robot.get_qpos() - before).max() < 1e-3


def test_the_hand_s_frame_points_forward_and_closes_sideways(make_world: MakeWorld) -> None:
    T_world_eef = make_world("kitchen_t1").T_world_link(ROBOT, PAPER_ROBOT.tip_link)
    approach, closing = T_world_eef[:3, 2], T_world_eef[:3, 1]
    assert approach[0] > 0.7 and abs(approach[1]) < 0.01
    assert abs(closing[1]) > 0.99


def test_fingers_close_to_nothing_and_open_again(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    for target in (0.0, 0.028):
        for joint in world.robot.active_joints[-2:]:
            joint.set_drive_target(target)
        settle(world, 0.6)
        assert world.robot.get_qpos()[-2:] == pytest.approx([target, target], abs=5e-4)


def test_a_table_stops_the_base(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    y_of_table_edge = -1.25 + 0.25
    for step in range(500):
        world.robot.active_joints[1].set_drive_target(-0.1 - min(1.0, step / 250))
        world.step()
    assert world.robot.get_qpos()[1] > y_of_table_edge
    pressed = [c for c in world.contacts({"table_0"}) if c.a.owner == ROBOT and c.impulse_ns > 0]
    assert pressed


def test_a_closed_gripper_holds_a_glass_in_the_air(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    position = world.T_world_link(ROBOT, PAPER_ROBOT.tip_link)[:3, 3]
    glass = world.T_world_link("glass_0")
    for step in range(200):
        world.set_object_pose("glass_0", at(*position))
        for joint in world.robot.active_joints[-2:]:
            joint.set_drive_target(0.028 * (1 - min(1.0, step / 50)))
        world.step()
    held = world.T_world_link("glass_0")[:3, 3]
    settle(world, 2.0)
    assert np.linalg.norm(world.T_world_link("glass_0")[:3, 3] - held) < 0.003
    assert glass[2, 3] < 0.7 < held[2]
    assert FINGER_DRIVE[2] >= 10.0
