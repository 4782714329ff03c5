"""What the detectors read, in situations that are set up in the physics."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bddl import Atom
from executor.assets.asset_geometry import bounds
from executor.geometry import Array, hand_rotation, rotation_z
from executor.scenes.library import load
from executor.sim.detectors import UnknownObject, read
from executor.sim.engine import ROBOT
from executor.sim.world import World
from oag import Scene, SceneObject
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import BOARD, MakeWorld, at, on_a_shelf, scene_at_paper_size, scene_of, settle

pytestmark = pytest.mark.physics
LYING = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
GLASS_HALF_M = 0.12 * 0.71 / 2


def value(world: World, predicate: str, *names: str) -> bool | None:
    return read(Atom(predicate, names), world).value


def shelf_center(world: World, name: str) -> Array:
    """Return the centre of a compartment's floor in the world."""
    region = next(r for r in world.assets["refrigerator_0"].regions if r.name == name)
    local = np.asarray(region.center_m) - [0, 0, region.half_extents_m[2]]
    return (world.T_world_link("refrigerator_0", region.link) @ [*local, 1.0])[:3]


def test_facts_of_the_scenes_are_read(make_world: MakeWorld) -> None:
    first, third = make_world("kitchen_t1"), make_world("kitchen_t3")
    for world in (first, third):
        settle(world, 0.2)
    assert value(first, "ontop", "glass_0", "table_0") is True
    assert value(first, "open", "refrigerator_0") is False
    assert value(first, "inside", "glass_0", "refrigerator_0") is False
    assert value(first, "ontop", "glass_0", "refrigerator_0") is False
    assert value(third, "ontop", "apple_0", "cabinet_0") is True
    assert value(third, "ontop", "bowl_0", "table_0") is True
    assert value(third, "inside", "apple_0", "bowl_0") is False
    for relation in ("inside", "ontop", "nextto", "touching", "under"):
        assert value(third, relation, "bowl_0", "bowl_0") is False


def test_ontop_holds_while_everything_sleeps(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    settle(world, 4.0)
    assert value(world, "ontop", "glass_0", "table_0") is True


def test_what_is_held_up_against_a_part_of_its_support_is_not_on_it(make_world: MakeWorld) -> None:
    """A can that the hand presses against the board above, or holds against the shelf's side, is off its board."""
    world = make_world(on_a_shelf(0.17))
    room_m = next(region for region in world.assets["shelf_0"].regions if region.name == BOARD).height_m - 0.17
    stood = world.T_world_link("can_0")
    side = world.assets["shelf_0"].extent_m[1] / 2 - 0.018 - 0.025
    for up_m, y_m, is_on in (
        (0.0, 0.1, True),
        (0.0, side, True),
        (room_m + 0.0005, 0.1, False),
        (0.03, side + 0.0005, False),
    ):
        world.set_object_pose("can_0", at(stood[0, 3], y_m, stood[2, 3] + up_m))
        world.step()
        found = read(Atom("ontop", ("can_0", "shelf_0")), world)
        assert (found.value, found.measurements.touching) == (is_on, True), (up_m, y_m, found)


@pytest.mark.parametrize("turn_deg", [0, 30, 45, 77])
def test_ontop_holds_for_things_that_fell_over_or_rolled(turn_deg: float, make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    tumbled = LYING @ rotation_z(math.radians(turn_deg))
    world.set_object_pose("glass_0", at(0.0, -1.25, 0.60 + 0.07 * 0.71 / 2 + 0.001, tumbled))
    settle(world, 0.3)
    reading = read(Atom("ontop", ("glass_0", "table_0")), world)
    assert reading.value is True
    assert reading.measurements.height_above_surface_m == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("width_m", "on", "within"),
    [(0.075, True, False), pytest.param(0.045, False, True, id="one that falls in is in it")],
)
def test_a_ball_that_hangs_into_the_mouth_of_a_cup_is_on_it(
    width_m: float, on: bool, within: bool, make_world: MakeWorld
) -> None:
    upright: dict[str, object] = {"orientation": [1, 0, 0, 0]}
    cup = {"category": "cup", "model": "cup", "position": [0.8, 0.0, 0.045], "bbox_extent": [0.061, 0.061, 0.09]}
    ball = {"category": "apple", "model": "red_apple", "position": [0.8, 0.0, 0.14], "bbox_extent": [width_m] * 3}
    world = make_world(scene_of({"cup_0": cup | upright, "apple_0": ball | upright}))
    settle(world, 1.0)
    reading = read(Atom("ontop", ("apple_0", "cup_0")), world)
    assert (reading.value, value(world, "inside", "apple_0", "cup_0")) == (on, within)
    if on:
        assert reading.measurements.height_above_surface_m == pytest.approx(0.0, abs=0.003)


def test_ontop_is_false_in_the_air_beside_and_below(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    world.set_object_pose("glass_0", at(0.0, -1.12, 0.60 + GLASS_HALF_M + 0.01))
    world.step()
    reading = read(Atom("ontop", ("glass_0", "table_0")), world)
    assert reading.value is False
    assert reading.measurements.height_above_surface_m == pytest.approx(0.01, abs=1e-3)
    world.set_object_pose("glass_0", at(0.0, -1.25, GLASS_HALF_M))
    settle(world, 0.2)
    assert value(world, "ontop", "glass_0", "table_0") is False
    assert value(world, "ontop", "glass_0", "floor") is True
    measured = read(Atom("ontop", ("glass_0", "floor")), world).measurements
    assert measured.centre_beyond_edge_m is None and measured.height_above_surface_m is not None
    assert value(world, "under", "glass_0", "table_0") is True


def test_touching_a_table_from_below_is_not_on_it(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    world.set_object_pose("glass_0", at(0.0, -1.25, 0.57 - GLASS_HALF_M))
    world.step()
    assert value(world, "touching", "glass_0", "table_0") is True
    assert value(world, "ontop", "glass_0", "table_0") is False


def test_leaning_against_a_table_s_edge_is_not_on_it(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    world.set_object_pose("glass_0", at(0.0, -1.0 + 0.07 * 0.71 / 2, 0.58))
    world.step()
    assert value(world, "touching", "glass_0", "table_0") is True
    assert value(world, "ontop", "glass_0", "table_0") is False


@pytest.mark.parametrize("shelf", ["bottom", "shelf_1", "shelf_2"])
@pytest.mark.parametrize("door_rad", [0.0, 1.8])
def test_inside_a_refrigerator_on_every_shelf(shelf: str, door_rad: float, make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    world.set_joint_position("refrigerator_0", "door_hinge", door_rad)
    world.set_object_pose("glass_0", at(*shelf_center(world, shelf)) @ at(0, 0, GLASS_HALF_M + 0.002))
    settle(world, 0.3)
    reading = read(Atom("inside", ("glass_0", "refrigerator_0")), world)
    assert reading.value is True
    assert reading.measurements.region == shelf
    assert reading.measurements.supported_by == ("refrigerator_0",)
    assert value(world, "open", "refrigerator_0") is (door_rad > 0)


def test_on_a_refrigerator_is_not_inside_it(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    x, y, _ = world.scene.objects["refrigerator_0"].position
    world.set_object_pose("glass_0", at(x + 0.05, y, 1.2 + GLASS_HALF_M))
    settle(world, 0.2)
    assert value(world, "inside", "glass_0", "refrigerator_0") is False
    assert value(world, "ontop", "glass_0", "refrigerator_0") is True


def test_in_front_of_the_shelf_is_not_inside(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    world.set_joint_position("refrigerator_0", "door_hinge", 1.8)
    place = shelf_center(world, "shelf_2")
    for back_m, expected in ((0.18, True), (0.30, False)):
        world.set_object_pose("glass_0", at(*place) @ at(-back_m, 0, GLASS_HALF_M + 0.001))
        world.step()
        assert value(world, "inside", "glass_0", "refrigerator_0") is expected


def test_an_apple_dropped_into_a_bowl_is_inside_it(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    bowl = world.T_world_link("bowl_0")[:3, 3]
    world.set_object_pose("apple_0", at(bowl[0] + 0.015, bowl[1], bowl[2] + 0.06))
    settle(world, 1.5)
    assert value(world, "inside", "apple_0", "bowl_0") is True
    assert value(world, "ontop", "apple_0", "cabinet_0") is False
    assert value(world, "ontop", "bowl_0", "table_0") is True


@pytest.mark.parametrize("turned_deg", [0.0, 15.0, 90.0])
@pytest.mark.parametrize(("category", "inside"), [("apple", True), ("plate", False)])
def test_a_ball_that_fills_a_cup_is_in_it_however_it_is_turned(category: str, inside: bool, turned_deg: float) -> None:
    kitchen = load("kitchen_t1")
    upright, one, top_m = (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.60
    cup = SceneObject("cup_0", "cup", "cup", (0.0, -1.3, top_m + 0.041), upright, (0.078, 0.078, 0.082), one, {})
    model, size = ("red_apple", (0.066,) * 3) if inside else ("plate", (0.10, 0.10, 0.012))
    thing = SceneObject(f"{category}_0", category, model, (0.5, -1.3, top_m + 0.04), upright, size, one, {})
    with World(replace(kitchen, objects={**kitchen.objects, "cup_0": cup, thing.id: thing})) as world:
        turn = Rotation.from_euler("y", turned_deg if inside else 0.0, degrees=True).as_matrix()
        height_m = top_m + 0.038 if inside else top_m + 0.082 + size[2] / 2
        world.set_object_pose(thing.id, at(0.0, -1.3, height_m, turn))
        settle(world, 0.3)
        assert value(world, "inside", thing.id, "cup_0") is inside


@pytest.mark.parametrize(
    ("off_m", "up_m", "tilted_deg", "inside"),
    [
        (0.0, 0.0, 0.0, True),
        (0.0, 0.10, 0.0, False),
        (0.077, 0.075, 0.0, False),
        (0.0, 0.0, 90.0, False),
    ],
    ids=["stands in it", "is over it", "stands on its wall", "lies across it"],
)
def test_what_stands_in_a_box_is_in_it_however_far_it_stands_out(
    off_m: float, up_m: float, tilted_deg: float, inside: bool, make_world: MakeWorld
) -> None:
    kitchen = load("kitchen_t1")
    upright, one, top_m = (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.60
    box = SceneObject("box_0", "box", "open_box", (0.0, -1.3, top_m + 0.04), upright, (0.16, 0.15, 0.08), one, {})
    size = (0.06, 0.06, 0.24)
    bottle = SceneObject("bottle_0", "bottle", "bottle", (0.5, -1.3, top_m + 0.12), upright, size, one, {})
    scene = replace(kitchen, objects={**kitchen.objects, "box_0": box, "bottle_0": bottle})
    with World(scene) as world:
        floor_m = world.assets["box_0"].regions[0].floor_m[2] + top_m + 0.04
        turn = Rotation.from_euler("y", tilted_deg, degrees=True).as_matrix()
        low_m = bounds(world.assets["bottle_0"], turn)[0][2]
        height_m = floor_m - low_m + 0.0005 if not tilted_deg else top_m + 0.08 - low_m
        world.set_object_pose("bottle_0", at(off_m, -1.3, height_m + up_m, turn))
        world.step()
        reading = read(Atom("inside", ("bottle_0", "box_0")), world)
        assert reading.value is inside, reading
        assert ((reading.measurements.centre_depth_m or 0.0) >= 0.0) is inside


def test_a_thing_that_a_box_stands_on_is_not_in_it(make_world: MakeWorld) -> None:
    kitchen = load("kitchen_t1")
    upright, one, top_m = (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.60
    can = SceneObject("can_0", "can", "can", (0.0, -1.3, top_m + 0.05), upright, (0.06, 0.06, 0.10), one, {})
    box = SceneObject("box_0", "box", "open_box", (0.0, -1.3, top_m + 0.141), upright, (0.16, 0.15, 0.08), one, {})
    with World(replace(kitchen, objects={**kitchen.objects, "box_0": box, "can_0": can})) as world:
        for _ in range(40):
            world.step()
        assert value(world, "ontop", "box_0", "can_0") is True
        assert value(world, "inside", "can_0", "box_0") is False
        assert value(world, "under", "can_0", "box_0") is True


@pytest.mark.parametrize("drawer", [1, 2, 3, 4])
def test_what_stands_in_a_drawer_is_in_that_drawer(drawer: int, make_world: MakeWorld) -> None:
    """The drawers above it are open at the top as well, and its foot is between their walls."""
    kitchen = load("kitchen_t1")
    upright, one, size = (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.6, 0.6, 0.9)
    place, drawers = (0.0, -1.3, 0.45), {"drawers": 4}
    chest = SceneObject("cabinet_0", "bottom_cabinet", "cabinet_drawers", place, upright, size, one, drawers)
    can = SceneObject("can_0", "can", "can", (1.5, -1.3, 0.05), upright, (0.06, 0.06, 0.10), one, {})
    with World(replace(kitchen, objects={"cabinet_0": chest, "can_0": can}, facts=frozenset())) as world:
        region = next(one for one in world.assets["cabinet_0"].regions if one.name == f"drawer_{drawer}")
        floor = world.T_world_link("cabinet_0", region.link) @ np.array([*region.floor_m, 1.0])
        world.set_object_pose("can_0", at(float(floor[0]), float(floor[1]), float(floor[2]) + 0.0505, np.eye(3)))
        world.step()
        reading = read(Atom("inside", ("can_0", "cabinet_0")), world)
        assert reading.value is True and reading.measurements.region == f"drawer_{drawer}"


def test_an_apple_in_the_air_above_a_bowl_is_not_inside_it(make_world: MakeWorld) -> None:
    """LIBERO's reading, two boxes that overlap in the plane, holds here."""
    world = make_world("kitchen_t3")
    bowl = world.T_world_link("bowl_0")[:3, 3]
    # At 22 mm its centre is below the rim, but nothing carries it and it sticks out.
    for height_m in (0.022, 0.05, 0.10, 0.30):
        world.set_object_pose("apple_0", at(bowl[0], bowl[1], bowl[2] + height_m))
        world.step()
        assert value(world, "inside", "apple_0", "bowl_0") is False
        assert value(world, "ontop", "apple_0", "bowl_0") is False


def test_an_apple_beside_a_bowl_is_next_to_it(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    bowl = world.T_world_link("bowl_0")[:3, 3]
    world.set_object_pose("apple_0", at(bowl[0] + 0.125, bowl[1], 0.60 + 0.0248))
    settle(world, 0.3)
    assert value(world, "inside", "apple_0", "bowl_0") is False
    assert value(world, "nextto", "apple_0", "bowl_0") is True
    assert value(world, "nextto", "bowl_0", "apple_0") is True
    assert value(world, "nextto", "apple_0", "cabinet_0") is False
    assert value(world, "nextto", "bowl_0", "table_0") is False


@pytest.mark.parametrize(("fraction", "expected"), [(0.0, False), (0.049, False), (0.051, True), (1.0, True)])
def test_open_begins_at_five_percent(fraction: float, expected: bool, make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    low, high = world.assets["refrigerator_0"].joint("door_hinge").limits
    world.set_joint_position("refrigerator_0", "door_hinge", low + fraction * (high - low))
    reading = read(Atom("open", ("refrigerator_0",)), world)
    assert reading.value is expected
    assert reading.measurements.open_fraction == pytest.approx(fraction, abs=1e-6)
    assert reading.measurements.angle_deg == pytest.approx(math.degrees(fraction * high), abs=1e-4)


def test_a_thing_between_the_fingers_is_inside_the_gripper(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    position = world.T_world_link(ROBOT, PAPER_ROBOT.tip_link)[:3, 3]
    assert value(world, "inside", "glass_0", "gripper") is False
    for step in range(200):
        world.set_object_pose("glass_0", at(*position))
        for joint in world.robot.active_joints[-2:]:
            joint.set_drive_target(0.028 * (1 - min(1.0, step / 50)))
        world.step()
    settle(world, 0.3)
    reading = read(Atom("inside", ("glass_0", "gripper")), world)
    assert reading.value is True and reading.measurements.fingers_touching == 2
    assert value(world, "ontop", "glass_0", "table_0") is False
    assert value(world, "touching", "gripper", "glass_0") is True
    assert value(world, "touching", "glass_0", "robot") is True


def test_what_cannot_be_told_is_none_with_a_reason(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    for atom in (
        Atom("inroom", ("glass_0", "kitchen")),
        Atom("cooked", ("glass_0",)),
        Atom("open", ("robot",)),
        Atom("ontop", ("robot", "floor")),
        Atom("inside", ("robot", "refrigerator_0")),
        Atom("nextto", ("robot", "glass_0")),
    ):
        reading = read(atom, world)
        assert reading.value is None and reading.measurements.reason


def test_what_has_no_joint_is_not_open(make_world: MakeWorld) -> None:
    """A proved plan may say so: `(not (open table_0))` holds by what kind of thing a table is."""
    reading = read(Atom("open", ("table_0",)), make_world("kitchen_t1"))
    assert reading.value is False and reading.measurements.reason == "table_0 has no joint"


def in_rooms(scene: Scene) -> Scene:
    rooms = {"refrigerator_0": "kitchen", "table_0": "dining_room", "glass_0": "dining_room"}
    return replace(scene, facts=(*scene.facts, *(Atom("inroom", pair) for pair in rooms.items())))


def test_a_thing_is_in_the_room_whose_furniture_is_nearest(make_world: MakeWorld) -> None:
    world = make_world(in_rooms(scene_at_paper_size("kitchen_t1")))
    world.step()
    assert value(world, "inroom", "refrigerator_0", "kitchen") is True
    assert value(world, "inroom", "glass_0", "dining_room") is True
    assert value(world, "inroom", "glass_0", "kitchen") is False
    x, y, _ = world.scene.objects["refrigerator_0"].position
    world.set_object_pose("glass_0", at(x - 0.6, y, 0.1))
    assert value(world, "inroom", "glass_0", "kitchen") is True
    world.set_object_pose("glass_0", at(x + 9.0, y, 0.1))
    reading = read(Atom("inroom", ("glass_0", "kitchen")), world)
    assert reading.value is False and reading.measurements.nearest_room == "kitchen"
    assert value(world, "inroom", "gripper", "kitchen") is value(world, "inroom", "robot", "kitchen")
    assert value(world, "inroom", "glass_0", "bathroom") is None


def test_an_unknown_object_is_named_with_near_ones(make_world: MakeWorld) -> None:
    with pytest.raises(UnknownObject, match=r"\(open fridge_0\): no object 'fridge_0'; did you mean refrigerator_0"):
        read(Atom("open", ("fridge_0",)), make_world("kitchen_t1"))


def test_hand_orientation_helper_agrees_with_the_robot_s_frame(make_world: MakeWorld) -> None:
    rotation = make_world("kitchen_t1").T_world_link(ROBOT, PAPER_ROBOT.tip_link)[:3, :3]
    level = hand_rotation(0.0, 0.0)
    assert float(rotation[:, 2] @ level[:, 2]) > 0.7
