"""What is judged is at rest: an item that still falls or rolls is waited for, one that lies still costs nothing."""

from __future__ import annotations

import numpy as np
import pytest

from executor.skills.control import LONGEST_WAIT_S, Controller, settle_to_rest
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import MakeWorld

pytestmark = pytest.mark.physics
DURATION_S = 0.2


def controller(make_world: MakeWorld, raised_m: float) -> Controller:
    """A robot at rest in the kitchen of T3, the apple above its place by some metres."""
    world = make_world("kitchen_t3")
    pose = world.scene.robot
    start = np.array([pose.position[0], pose.position[1], pose.yaw_rad, *PAPER_ROBOT.home])
    world.robot.set_qpos(np.array([*start, 0.04, 0.04]))
    T = world.T_world_link("apple_0")
    T[2, 3] += raised_m
    world.set_object_pose("apple_0", T)
    return Controller(world, start, 0.04, lambda: None)


def test_a_world_at_rest_is_not_waited_for(make_world: MakeWorld) -> None:
    control = controller(make_world, 0.0)
    control.settle(1.0)
    began_s = control.world.time_s
    assert settle_to_rest(control, DURATION_S) == pytest.approx(0.0)
    assert control.world.time_s - began_s == pytest.approx(DURATION_S)


def test_what_falls_is_waited_for_until_it_lies_still(make_world: MakeWorld) -> None:
    control = controller(make_world, 0.4)
    assert 0.0 < settle_to_rest(control, DURATION_S) < LONGEST_WAIT_S
    before = control.world.T_world_link("apple_0")[:3, 3]
    control.settle(0.5)
    assert np.linalg.norm(control.world.T_world_link("apple_0")[:3, 3] - before) < 0.005


def test_what_never_rests_is_given_up(make_world: MakeWorld) -> None:
    control = controller(make_world, 500.0)
    assert settle_to_rest(control, DURATION_S) == pytest.approx(LONGEST_WAIT_S, abs=0.11)
