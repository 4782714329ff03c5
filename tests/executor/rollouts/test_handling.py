"""What counts as put down and as picked up, in situations that are set up in the physics."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import bddl
from bddl import Atom
from executor.assets.library import sample
from executor.geometry import Array, rotation_z
from executor.planning.picks import HIGH_LIFTS_M
from executor.rollouts.goals import PICKED_UP_M, STANDS_DEG, as_failure, judge, picked_up, put_down, tilt_deg
from executor.sim.world import World
from tests.executor.helpers import MakeWorld, at, on_a_shelf, scene_at_paper_size, scene_of, settle

pytestmark = pytest.mark.physics
LYING = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
ON_TABLE = Atom("ontop", ("glass_0", "table_0"))
GLASS_HALF_M = 0.12 * 0.71 / 2
TABLE_M, RADIUS_M = 0.60, 0.07 * 0.71 / 2


def tilted(degrees: float) -> Array:
    s, c = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def test_a_glass_that_fell_over_is_on_the_table_and_not_put_down(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    world.set_object_pose("glass_0", at(0.0, -1.25, TABLE_M + RADIUS_M + 0.001, LYING))
    settle(world, 0.3)
    readings = judge(ON_TABLE, world)
    assert [reading.value for reading in readings] == [False]
    assert readings[0].measurements.tilted_deg == pytest.approx(90.0, abs=1.0)
    failure = as_failure(readings, "put_glass_on_table")
    assert failure is not None and failure.measurements[0].measurements.tilted_deg == pytest.approx(90.0, abs=1.0)
    # It is on the table all the same: who wanted it away does not have it away.
    assert [reading.satisfied for reading in judge(bddl.Not(ON_TABLE), world)] == [False]
    assert not judge(bddl.parse_formula("(exists (?x - water_glass) (ontop ?x table_0))"), world)[0].satisfied
    assert not judge(bddl.parse_formula("(forall (?x - water_glass) (not (ontop ?x table_0)))"), world)[0].satisfied


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 180.0])
def test_a_glass_that_stands_is_put_down_however_it_is_turned(turn_deg: float, make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    turn = rotation_z(math.radians(turn_deg))
    world.set_object_pose("glass_0", at(0.0, -1.25, TABLE_M + GLASS_HALF_M + 0.001, turn))
    settle(world, 0.3)
    assert [reading.satisfied for reading in judge(ON_TABLE, world)] == [True]
    assert judge(bddl.parse_formula("(exists (?x - water_glass) (ontop ?x table_0))"), world)[0].satisfied


@pytest.mark.parametrize(("degrees", "stands"), [(0.0, True), (STANDS_DEG - 1, True), (STANDS_DEG + 1, False)])
def test_a_tilt_is_told_from_how_a_thing_stood(degrees: float, stands: bool, make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    world.set_object_pose("glass_0", at(0.0, -1.25, 1.0, rotation_z(1.0) @ tilted(degrees)))
    assert tilt_deg(world, "glass_0") == pytest.approx(degrees, abs=1e-3)
    assert put_down(ON_TABLE, world).as_meant is stands
    assert bool(put_down(ON_TABLE, world).measured.reason) is not stands


@pytest.mark.parametrize(
    ("noun", "extent_m", "stands"), [("die", (0.04, 0.04, 0.04), True), ("carton", (0.04, 0.06, 0.08), False)]
)
def test_a_cube_stands_on_each_of_its_faces(noun: str, extent_m: tuple[float, float, float], stands: bool) -> None:
    thing, scene = replace(sample(noun, 0, "thing_0"), bbox_extent=extent_m), scene_at_paper_size("kitchen_t1")
    on_table = Atom("ontop", ("thing_0", "table_0"))
    with World(replace(scene, objects={**scene.objects, "thing_0": thing})) as world:
        for R in (tilted(90.0), rotation_z(0.4) @ tilted(90.0) @ rotation_z(math.pi / 2)):
            world.set_object_pose("thing_0", at(0.0, 0.0, 2.0, R))
            assert put_down(on_table, world).as_meant is stands
        world.set_object_pose("thing_0", at(0.0, 0.0, 2.0, tilted(40.0)))
        assert not put_down(on_table, world).as_meant, "nothing stands on an edge"


def test_what_lay_may_lie_or_be_set_upright_and_stands_on_no_other_side() -> None:
    scene = scene_at_paper_size("kitchen_t1")
    glass, half = scene.objects["glass_0"], math.sqrt(0.5)
    lying = replace(glass, orientation=(half, 0.0, half, 0.0))
    with World(replace(scene, objects={**scene.objects, "glass_0": lying})) as world:
        world.set_object_pose("glass_0", at(0.0, -1.25, 1.0, rotation_z(0.7) @ tilted(90.0)))
        assert put_down(ON_TABLE, world).as_meant
        rolled = tilted(90.0) @ rotation_z(1.2)
        world.set_object_pose("glass_0", at(0.0, -1.25, 1.0, rolled))
        assert put_down(ON_TABLE, world).as_meant, "it is round: rolled about its own axis it lies as it lay"
        world.set_object_pose("glass_0", at(0.0, -1.25, 1.0, rotation_z(2.0)))
        assert put_down(ON_TABLE, world).as_meant and tilt_deg(world, "glass_0") == pytest.approx(0.0, abs=1e-3)
        for degrees in (40.0, 180.0):
            world.set_object_pose("glass_0", at(0.0, -1.25, 1.0, tilted(degrees)))
            assert not put_down(ON_TABLE, world).as_meant


def test_what_has_sides_lies_as_it_lay_only_on_the_same_one(make_world: MakeWorld) -> None:
    book = {"category": "book", "model": "book", "bbox_extent": [0.2, 0.14, 0.03], "position": [0.0, 0.0, 1.0]}
    half = math.sqrt(0.5)
    world = make_world(scene_of({"book_0": book | {"orientation": [half, 0.0, half, 0.0]}}))
    for R, meant in ((tilted(90.0), True), (np.eye(3), True), (tilted(90.0) @ rotation_z(math.pi / 2), False)):
        world.set_object_pose("book_0", at(0.0, 0.0, 1.0, R))
        assert put_down(Atom("ontop", ("book_0", "table_0")), world).as_meant is meant


def test_what_stood_on_a_shelf_is_picked_up_once_it_is_out_from_between_the_boards(make_world: MakeWorld) -> None:
    world = make_world(on_a_shelf(0.12))
    held, stood = Atom("inside", ("can_0", "gripper")), world.T_world_link("can_0")[:3, 3]
    for off_m, up_m, counts in ((0.0, 0.03, False), (0.1, 0.03, False), (0.2, 0.03, True), (0.3, -0.4, True)):
        world.set_object_pose("can_0", at(*(stood + [-off_m, 0.0, up_m])))
        assert picked_up(held, world).as_meant is counts, (off_m, up_m)


def test_what_rolls_has_no_upright_and_what_is_in_a_bowl_may_lean(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    in_bowl = Atom("inside", ("apple_0", "bowl_0"))
    world.set_object_pose("apple_0", at(0.0, 0.0, 1.0, tilted(90.0)))
    assert put_down(in_bowl, world).as_meant
    world = make_world("kitchen_t1")
    in_fridge = Atom("inside", ("glass_0", "refrigerator_0"))
    world.set_object_pose("glass_0", at(0.0, 0.0, 1.0, tilted(30.0)))
    assert not put_down(in_fridge, world).as_meant
    assert put_down(Atom("inside", ("glass_0", "gripper")), world).as_meant


@pytest.mark.parametrize(("up_m", "counts"), [(0.03, False), (0.099, False), (0.101, True), (min(HIGH_LIFTS_M), True)])
def test_what_is_held_less_than_ten_centimetres_up_is_not_picked_up(
    up_m: float, counts: bool, make_world: MakeWorld
) -> None:
    world = make_world("kitchen_t1")
    start = world.T_world_link("glass_0")
    world.set_object_pose("glass_0", at(*(start[:3, 3] + [0.2, 0.1, up_m])))
    found = picked_up(Atom("inside", ("glass_0", "gripper")), world)
    assert found.as_meant is counts
    assert found.measured.lifted_m == pytest.approx(up_m, abs=1e-3)
    assert pytest.approx(0.10) == PICKED_UP_M
    assert picked_up(ON_TABLE, world).as_meant


def test_what_was_inside_something_is_picked_up_once_it_is_out(make_world: MakeWorld) -> None:
    scene = scene_at_paper_size("kitchen_t3")
    bowl = scene.objects["bowl_0"].position
    inside = replace(scene.objects["apple_0"], position=(bowl[0], bowl[1], bowl[2] + 0.01))
    facts = (*scene.facts, Atom("inside", ("apple_0", "bowl_0")))
    with World(replace(scene, objects={**scene.objects, "apple_0": inside}, facts=facts)) as world:
        held = Atom("inside", ("apple_0", "gripper"))
        settle(world, 0.3)
        assert not picked_up(held, world).as_meant
        world.set_object_pose("apple_0", at(bowl[0] + 0.4, bowl[1], bowl[2] + 0.05))
        assert picked_up(held, world).as_meant
