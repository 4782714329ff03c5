"""Building blocks of rooms: what stands against walls, on tops and in compartments, and what is refused."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import bddl
from executor.assets.footprint import Footprint, yaw_of
from executor.assets.library import asset_for
from executor.geometry import transform_from_quaternion
from executor.scenes.placement import (
    WALKWAY_M,
    AtEdge,
    Clearance,
    PlaceSpec,
    place,
    robot_footprint,
    scatter,
    stand_robot,
)
from executor.scenes.room import (
    BEHIND_M,
    WALLS,
    NoRoom,
    Perturbation,
    Room,
    Units,
    against,
    build_walls,
    row,
    row_length_m,
    stand,
)
from oag import SceneObject
from oag.sizes import PAPER_GRIPPER, Sizing

SEEDS = range(12000, 12020)


def a_room(seed: int) -> Room:
    return Room("a_room", "kitchen", np.random.default_rng(seed), depth_m=3.4, width_m=3.8)


@pytest.mark.parametrize("wall", WALLS)
def test_furniture_against_a_wall_looks_into_the_room_and_has_its_back_at_the_wall(wall: str) -> None:
    room = a_room(1)
    against(room, wall, room.draw("wardrobe_two_doors", "thing"), 0.3)
    obj = room.objects["thing"]
    front = -transform_from_quaternion(obj.position, obj.orientation)[:2, 0]
    towards_middle = -np.array(obj.position[:2])
    assert front @ towards_middle > 0.0
    axis = int(np.argmax(np.abs(front)))
    half_room = (room.depth_m / 2, room.width_m / 2)[axis]
    back = float(np.abs(Footprint.of(obj).corners_m[:, axis]).max())
    assert 0.0 < half_room - back < 0.02


def test_an_id_that_is_taken_changes_nothing_that_is_known_of_it() -> None:
    room = a_room(1)
    stand(room, room.draw("table_four_legs"), 0.0, 0.0)
    stand(room, room.draw("nightstand"), 1.2, 1.2)
    place(room, room.draw("can"), PlaceSpec("table_0"))
    before = room.scene()
    with pytest.raises(NoRoom, match="a thing of this id already"):
        place(
            room,
            room.draw("can", "can_0"),
            PlaceSpec("stand_0" if "stand_0" in room.objects else "nightstand_0"),
        )
    assert room.scene() == before


def test_left_along_a_wall_is_left_for_who_faces_it() -> None:
    for wall, yaw in WALLS.items():
        room = a_room(2)
        against(room, wall, room.draw("nightstand", "thing"), 0.8)
        x, y, _ = room.objects["thing"].position
        left_of_heading = np.array([-np.sin(yaw), np.cos(yaw)])
        assert float(left_of_heading @ [x, y]) == pytest.approx(0.8)


def test_a_row_is_in_order_and_has_the_gaps_that_were_asked_for() -> None:
    room = a_room(3)
    pieces = [room.draw("cabinet_drawers"), room.draw("fridge_one_door"), room.draw("counter_plain")]
    names = row(room, "north", pieces, gaps_m=[0.0, 0.04])
    prints = [Footprint.of(room.objects[name]) for name in names]
    assert prints[0].gap_m(prints[1]) == pytest.approx(0.0, abs=1e-9)
    assert prints[1].gap_m(prints[2]) == pytest.approx(0.04)
    assert prints[0].x_m < prints[1].x_m < prints[2].x_m  # Left of who faces north is west.


@pytest.mark.parametrize("turned_rad", [0.26, -0.26])
def test_a_target_that_strays_has_the_room_in_a_row_that_its_turn_needs(turned_rad: float) -> None:
    def pieces(room: Room) -> list[SceneObject]:
        return [
            room.draw("cabinet_drawers"),
            room.draw("fridge_one_door", "fridge", target=True),
            room.draw("counter_plain"),
        ]

    usual, other = a_room(3), a_room(3)
    other = Room("a_room", "kitchen", other.rng, 3.4, 3.8, lambda thing: Perturbation(1.1, 0.9, 1.05, turned_rad))
    mine = pieces(other)
    row(usual, "east", pieces(usual))
    names = row(other, "east", mine, gaps_m=[0.0, 0.04])
    before, after = usual.objects["fridge"], other.objects["fridge"]
    assert after.extent_m == pytest.approx(np.array(before.extent_m) * [1.1, 0.9, 1.05])
    assert asset_for(after).extent_m == pytest.approx(after.extent_m)
    assert yaw_of(after) == pytest.approx(yaw_of(before) + turned_rad)
    assert after.position[2] == pytest.approx(after.extent_m[2] / 2)
    left, middle, right = (Footprint.of(other.objects[name]).corners_m for name in names)
    assert 1.7 - middle[:, 0].max() == pytest.approx(BEHIND_M)
    assert left[:, 1].min() - middle[:, 1].max() == pytest.approx(0.0, abs=1e-9)
    assert middle[:, 1].min() - right[:, 1].max() == pytest.approx(0.04)
    assert left[:, 1].max() - right[:, 1].min() == pytest.approx(row_length_m(other, mine, [0.04]))
    assert other.perturbations == {"fridge": Perturbation(1.1, 0.9, 1.05, turned_rad)} and not usual.perturbations


def test_units_of_a_kitchen_share_height_and_depth() -> None:
    room = a_room(4)
    units = Units.drawn(room)
    drawn = [units.draw(room, model) for model in units.models]
    assert {obj.extent_m[2] for obj in drawn} == {units.height_m}
    assert {obj.extent_m[0] for obj in drawn} == {units.depth_m}
    for obj in drawn:
        assert asset_for(obj).extent_m == pytest.approx(obj.extent_m)


def test_overlapping_furniture_is_refused_with_both_names() -> None:
    room = a_room(5)
    against(room, "east", room.draw("oven_bottom_hinge"), 0.0)
    with pytest.raises(NoRoom, match=r"dishwasher_0: overlaps oven_0") as caught:
        against(room, "east", room.draw("dishwasher_bottom_hinge"), 0.2)
    assert caught.value.object_id == "dishwasher_0"
    with pytest.raises(NoRoom, match="reaches beyond the west wall"):
        against(room, "west", room.draw("counter_plain"), 1.9)


@pytest.mark.parametrize("seed", SEEDS)
def test_things_on_a_table_stay_on_it_and_apart(seed: int) -> None:
    room = a_room(seed)
    table = stand(room, room.draw("table_four_legs"), -0.4, 0.2, yaw_rad=0.4)
    place(room, room.draw("tumbler"), PlaceSpec(table, at=AtEdge("+y", (0.08, 0.16))))
    names = scatter(
        room,
        ["can", "carton", "book_lying", "bottle", "mug"],
        PlaceSpec(table, clear=Clearance(other_m=0.03)),
        count=5,
    )
    assert names
    top = Footprint.of(room.objects[table])
    T = transform_from_quaternion(room.objects[table].position, room.objects[table].orientation)
    things = [room.objects[name] for name in ("glass_0", *names)]
    for obj in things:
        assert obj.position[2] - obj.extent_m[2] / 2 == pytest.approx(top.high_m)
        local = (Footprint.of(obj).corners_m - T[:2, 3]) @ T[:2, :2]
        assert (np.abs(local) <= [top.half_x_m - 0.019, top.half_y_m - 0.019]).all()
    for one, other in itertools.combinations(things, 2):
        assert Footprint.of(one).gap_m(Footprint.of(other)) >= 0.03 - 1e-9


def test_things_go_into_compartments_and_under_shelves_only_where_they_are_low_enough() -> None:
    room = a_room(6)
    fridge = room.draw("fridge_one_door", parameters={"shelves": 1})
    against(room, "east", fridge, 0.0)
    place(room, room.draw("can"), PlaceSpec(fridge.id, region="door_shelf_1", at=AtEdge("-x", (0.06, 0.12))))
    assert bddl.Atom("inside", ("can_0", fridge.id)) in room.scene().facts
    with pytest.raises(NoRoom, match="has no place 'attic'; it has door_bottom, door_shelf_1"):
        place(room, room.draw("can"), PlaceSpec(fridge.id, region="attic"))
    with pytest.raises(NoRoom, match=r"no place of .* is high enough"):
        place(room, room.draw("can", extent_m={"z": 1.3}), PlaceSpec(fridge.id))
    with pytest.raises(NoRoom, match=r"refrigerator_0 \(door_shelf_1\)"):
        place(room, room.draw("plate", extent_m={"x": 0.9, "y": 0.9}), PlaceSpec(fridge.id, region="door_shelf_1"))


def test_facts_say_what_is_open_what_rests_where_and_which_room() -> None:
    room = a_room(7)
    against(room, "east", room.draw("counter_plain", "counter_0"), 0.0)
    against(room, "north", room.draw("cabinet_drawers", parameters={"open_fraction": 0.5}), 0.0)
    place(room, room.draw("microwave_side_hinge"), PlaceSpec("counter_0", at=(0.0, 0.0), yaw_rad=0.0))
    facts = {bddl.format(fact) for fact in room.scene().facts}
    assert {
        "(ontop microwave_0 counter_0)",
        "(open cabinet_0)",
        "(not (open microwave_0))",
        "(inroom counter_0 kitchen)",
        "(inroom microwave_0 kitchen)",
    } <= facts
    assert not any("open counter_0" in fact for fact in facts)
    assert room.scene().closed == {"ontop", "inside", "open"}


@pytest.mark.parametrize("seed", SEEDS)
def test_the_robot_starts_on_free_floor_inside_the_room(seed: int) -> None:
    room = a_room(seed)
    row(room, "east", [room.draw("fridge_one_door"), room.draw("counter_plain")])
    stand(room, room.draw("table_round"), -0.7, -0.5)
    build_walls(room)
    stand_robot(room)
    body = robot_footprint(*room.robot.position[:2], room.robot.yaw_rad)
    assert (np.abs(body.corners_m) <= [room.depth_m / 2, room.width_m / 2]).all()
    assert all(body.gap_m(Footprint.of(obj)) >= WALKWAY_M - 1e-9 for obj in room.objects.values())


def test_walls_are_built_behind_what_stands_against_them_and_no_others() -> None:
    room = a_room(8)
    against(room, "east", room.draw("counter_plain"), 0.0)
    against(room, "north", room.draw("shelf_open"), 0.0)
    assert set(build_walls(room)) == {"wall_east", "wall_north"}
    east = room.objects["wall_east"]
    assert east.role == "A" and east.position[0] - east.extent_m[0] / 2 == pytest.approx(room.depth_m / 2)


def test_equal_generators_and_calls_give_equal_rooms() -> None:
    def laid_out() -> object:
        room = a_room(9)
        row(room, "east", [room.draw("fridge_one_door"), room.draw("cabinet_two_doors")])
        scatter(room, ["can", "bottle", "orange"], PlaceSpec("cabinet_0"), count=2)
        stand_robot(room)
        return room.scene()

    assert laid_out() == laid_out()


@pytest.mark.parametrize("model", ["half_apple", "orange", "tumbler", "cup", "bottle"])
def test_what_is_asked_for_can_be_taken_once_its_size_is_adjusted(model: str) -> None:
    for seed in range(40):
        assert Sizing(seed).unfit(a_room(seed).draw(model, "thing_0"), PAPER_GRIPPER) is None
