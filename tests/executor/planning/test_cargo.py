"""What rides in or on a thing moves with it in collision queries, and takes up room there."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from executor.geometry import inverse
from executor.planning.cargo import Carried, cargo_of, carried_by, touching_any
from executor.planning.collision import CollisionOracle, held_may_touch
from executor.planning.planner import Planner
from executor.sim.detectors import box_around
from executor.sim.world import World
from executor.skills.control import Monitor
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import at, scene_at_paper_size, settle

pytestmark = pytest.mark.physics

FREE = np.array([-0.3, -0.1, 0.0, *PAPER_ROBOT.home])
FAR_M = at(0.0, 0.0, 0.10)
"""Of the bowl's frame from the hand's: along the fingers."""


@pytest.fixture(scope="module")
def worlds() -> Iterator[tuple[World, CollisionOracle]]:
    """kitchen_t3 with its apple in its bowl, at rest, and an oracle of it."""
    scene = scene_at_paper_size("kitchen_t3")
    world, mirror = World(scene), World(scene, oracle=True)
    world.set_object_pose("apple_0", world.T_world_link("bowl_0") @ at(0.0, 0.0, 0.02))
    settle(world)
    oracle = CollisionOracle(mirror)
    oracle.synchronize(world)
    yield world, oracle
    world.close()
    mirror.close()


def test_cargo_is_what_lies_in_a_bowl_and_nothing_else(worlds: tuple[World, CollisionOracle]) -> None:
    world, _ = worlds
    assert cargo_of(world, "bowl_0") == ("apple_0",)
    assert cargo_of(world, "apple_0") == ()
    assert "apple_0" not in touching_any(world, ("bowl_0", "apple_0"))
    assert set(touching_any(world, ("bowl_0", "apple_0"))) == set(touching_any(world, ("bowl_0",))) - {"apple_0"}


def test_poses_in_the_hand_are_those_of_the_world(worlds: tuple[World, CollisionOracle]) -> None:
    world, _ = worlds
    T_world_eef = world.T_world_link("bowl_0") @ inverse(FAR_M)
    carried = carried_by(world, "bowl_0", T_world_eef)
    assert carried.ids == ("bowl_0", "apple_0")
    for name, T_eef_object in carried.poses:
        np.testing.assert_allclose(T_world_eef @ T_eef_object, world.T_world_link(name), atol=1e-9)


def test_a_bowl_takes_its_apple_along_and_both_are_where_they_were_once_it_is_let_go_of(
    worlds: tuple[World, CollisionOracle],
) -> None:
    world, oracle = worlds
    oracle.carried = carried_by(world, "bowl_0", world.T_world_link("bowl_0") @ inverse(FAR_M))
    try:
        assert not oracle.hits(FREE), "neither bowl nor apple is in the way of the other"
        hand = oracle.kinematics.forward(FREE)
        for name, T_eef_object in oracle.carried.poses:
            np.testing.assert_allclose(oracle.world.T_world_link(name), hand @ T_eef_object, atol=1e-4)
        oracle.carried = Carried("bowl_0", oracle.carried.T_eef_object)
        oracle.hits(FREE)
        np.testing.assert_allclose(oracle.world.T_world_link("apple_0"), world.T_world_link("apple_0"), atol=1e-4)
    finally:
        oracle.carried = None
    oracle.hits(FREE)
    np.testing.assert_allclose(oracle.world.T_world_link("bowl_0"), world.T_world_link("bowl_0"), atol=1e-4)


def test_cargo_that_would_meet_something_is_a_hit(worlds: tuple[World, CollisionOracle]) -> None:
    world, oracle = worlds
    # The bowl is in the free hand; its apple is held out to where the table is.
    hand = oracle.kinematics.forward(FREE)
    centre, half = box_around(world, "table_0")
    top = at(*centre[:2], centre[2] + half[2])
    oracle.carried = Carried("bowl_0", FAR_M, (("apple_0", inverse(hand) @ top),))
    try:
        met = oracle.hits(FREE)
        assert {(hit.mover, hit.other.split("/")[0]) for hit in met} == {("held object", "table_0")}
        assert not oracle.hits(FREE, allowed=held_may_touch(["table_0"]))
    finally:
        oracle.carried = None


def test_a_monitor_takes_no_offence_at_cargo_pressing_on_its_carrier(worlds: tuple[World, CollisionOracle]) -> None:
    world, oracle = worlds
    carried = carried_by(world, "bowl_0", world.T_world_link("bowl_0") @ inverse(FAR_M))
    resting = held_may_touch(touching_any(world, carried.ids))
    for _ in range(20):
        world.step()
        contacts = Monitor(world, oracle.kinematics, carried=carried, allowed=resting)._contacts()
        assert contacts is None


def test_a_carrier_with_cargo_is_not_turned_over(worlds: tuple[World, CollisionOracle]) -> None:
    world, oracle = worlds
    planner = Planner(oracle)
    planner.start_subtask(world, 0, 0)
    flat = carried_by(world, "bowl_0", world.T_world_link("bowl_0") @ inverse(FAR_M))
    leaning = np.array(PAPER_ROBOT.home)
    leaning[5] += np.deg2rad(40.0)  # The wrist, which pitches the hand.
    turned = np.array(PAPER_ROBOT.home)
    turned[0] += np.deg2rad(40.0)  # About the vertical.
    try:
        oracle.carried = Carried(flat.object_id, flat.T_eef_object)
        assert planner.arm_path(FREE, leaning) is not None
        oracle.carried = flat
        assert planner.arm_path(FREE, leaning) is None
        assert planner.arm_path(FREE, turned) is not None
    finally:
        oracle.carried = None
