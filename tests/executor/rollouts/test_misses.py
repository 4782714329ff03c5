"""How far an item is from its place: nothing in it, else the vector that brings it there, in the robot's directions."""

from __future__ import annotations

import numpy as np
import pytest

from bddl import Atom
from executor.geometry import rotation_z
from executor.rollouts.goals import misses
from executor.sim.detectors import read
from tests.executor.helpers import MakeWorld, at

pytestmark = pytest.mark.physics

ONTOP = Atom("ontop", ("apple_0", "table_0"))
INSIDE = Atom("inside", ("apple_0", "bowl_0"))


def test_an_item_on_its_place_misses_nothing(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    on_cabinet = Atom("ontop", ("apple_0", "cabinet_0"))
    world.step()
    assert read(on_cabinet, world).value is True
    (miss,) = misses([on_cabinet], world, 0.0)
    assert miss.distance_m == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, -2.5])
def test_moving_an_item_by_its_miss_brings_it_to_its_place(make_world: MakeWorld, yaw_rad: float) -> None:
    world = make_world("kitchen_t3")
    start = world.T_world_link("table_0")[:3, 3] + [0.9, -0.7, 0.6]
    world.set_object_pose("apple_0", at(*start))
    (miss,) = misses([ONTOP], world, yaw_rad)
    assert miss.distance_m > 0.3
    by = rotation_z(yaw_rad) @ np.array([miss.forward_m, miss.left_m, miss.up_m])
    world.set_object_pose("apple_0", at(*(start + by)))
    (left,) = misses([ONTOP], world, yaw_rad)
    assert left.distance_m == pytest.approx(0.0, abs=1e-3)


def test_the_middle_is_straight_above_the_bowl(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    bowl = world.T_world_link("bowl_0")[:3, 3]
    world.set_object_pose("apple_0", at(bowl[0] + 0.05, bowl[1] - 0.08, bowl[2] + 0.3))
    (miss,) = misses([INSIDE], world, 0.0)
    assert (miss.centre_forward_m, miss.centre_left_m) == pytest.approx((-0.05, 0.08), abs=5e-3)
    assert miss.up_m < -0.2


def test_what_is_no_place_is_left_out(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    atoms = [Atom("open", ("cabinet_0",)), Atom("inside", ("apple_0", "gripper")), Atom("ontop", ("table_0", "bowl_0"))]
    assert misses(atoms, world, 0.0) == ()
