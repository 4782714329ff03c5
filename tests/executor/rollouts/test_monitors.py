"""Bystanders must stay where they are; robots must be where they were told to be."""

from __future__ import annotations

import numpy as np
import pytest

from executor.records import FailureKind
from executor.skills.control import Bystanders, stall
from oag.measurements import RobotStall, measurements_json
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import MakeWorld, at, settle


@pytest.mark.physics
def test_a_bystander_that_moves_is_a_side_effect(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    settle(world)
    watch, own = Bystanders(world, "apple_0"), Bystanders(world, "bowl_0")
    assert watch.check() is None
    moved = world.T_world_link("bowl_0") @ at(0.08, 0.0, 0.0)
    world.set_object_pose("bowl_0", moved)
    failure = watch.check()
    assert failure is not None
    assert failure.kind is FailureKind.SIDE_EFFECT
    assert measurements_json(failure.measurements)["moved_m"] == pytest.approx(0.08, abs=1e-3)
    assert own.check() is None, "the subtask's own target may move"


@pytest.mark.physics
def test_what_is_in_a_moved_bowl_goes_along_but_the_bowl_of_a_moved_apple_stays(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    world.set_object_pose("apple_0", world.T_world_link("bowl_0") @ at(0.0, 0.0, 0.02))
    settle(world)
    of_bowl, of_apple = Bystanders(world, "bowl_0"), Bystanders(world, "apple_0")
    for name in ("bowl_0", "apple_0"):
        world.set_object_pose(name, at(0.0, 0.0, 0.3) @ world.T_world_link(name))
    assert of_bowl.check() is None
    failure = of_apple.check()
    assert failure is not None and measurements_json(failure.measurements)["object"] == "bowl_0"
    assert "bowl_0 moved 30 cm" in failure.message


@pytest.mark.physics
def test_cargo_that_falls_off_what_is_moved_is_a_side_effect(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    world.set_object_pose("apple_0", world.T_world_link("bowl_0") @ at(0.0, 0.0, 0.02))
    settle(world)
    of_bowl, of_apple = Bystanders(world, "bowl_0"), Bystanders(world, "apple_0")
    world.set_object_pose("apple_0", at(0.0, 0.0, 0.3) @ world.T_world_link("apple_0"))
    world.step()
    assert of_apple.check() is None
    failure = of_bowl.check()
    assert failure is not None and failure.kind is FailureKind.SIDE_EFFECT
    assert failure.message == "apple_0 fell off bowl_0"
    assert measurements_json(failure.measurements)["moved_m"] == pytest.approx(0.3, abs=1e-3)


def test_a_stall_says_how_far_short_it_is() -> None:
    target = np.zeros(10)
    near, far = target.copy(), target.copy()
    near[0], near[4] = 0.01, 0.01
    far[1], far[5] = 0.05, np.deg2rad(10.0)
    assert stall(PAPER_ROBOT, near, target) is None
    turned = target.copy()
    turned[2] = np.deg2rad(20.0)
    blocked_turn = stall(PAPER_ROBOT, turned, target)
    assert blocked_turn is not None and measurements_json(blocked_turn.measurements)["yaw_short_deg"] == 20.0
    whole_turn = target.copy()
    whole_turn[2] = 2 * np.pi
    assert stall(PAPER_ROBOT, whole_turn, target) is None
    failure = stall(PAPER_ROBOT, far, target)
    assert failure is not None and failure.kind is FailureKind.STALLED
    assert failure.measurements == (RobotStall(0.05, 0.0, 10.0),)
