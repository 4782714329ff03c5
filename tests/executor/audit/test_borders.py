"""Each predicate of the second geometry, by physics without a robot's help: things moved into and out of a relation."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from numpy.typing import NDArray

import bddl
from executor.assets.families.controls import BUTTON_TRAVEL_M, KNOB_RANGE_RAD
from executor.assets.footprint import region_frame
from executor.assets.library import asset_for
from executor.audit.decision import decide
from executor.audit.geometry import Snapshot
from executor.sim.detectors import read
from executor.sim.world import World
from oag.model.where import Side, Where
from tests.executor.appliances import appliance
from tests.executor.helpers import at, on_a_shelf, scene_at_paper_size, scene_of, settle

pytestmark = pytest.mark.physics
Thing = dict[str, object]
TABLE: Thing = {
    "category": "table",
    "model": "table_four_legs",
    "position": [1.0, 0.0, 0.35],
    "bbox_extent": [0.8, 0.6, 0.7],
}
CAN: Thing = {"category": "can", "model": "can", "bbox_extent": [0.06, 0.06, 0.1]}
BOWL: Thing = {"category": "bowl", "model": "porcelain_bowl", "bbox_extent": [0.18, 0.18, 0.06]}
APPLE: Thing = {"category": "apple", "model": "red_apple", "bbox_extent": [0.07, 0.07, 0.07]}
UPRIGHT: Thing = {"orientation": [1, 0, 0, 0]}
TOP_M = 0.7


def value(world: World, goal: str, before: Snapshot | None = None) -> bool | None:
    now = Snapshot(world, world.pack())
    return decide(bddl.parse_formula(goal), world.scene, before or now, now).value


def table_with_can() -> World:
    can: Thing = CAN | UPRIGHT | {"position": [1.0, 0.0, TOP_M + 0.0505]}
    return World(scene_of({"table_0": TABLE | UPRIGHT, "can_0": can}))


@pytest.mark.parametrize("share", [0.0, 0.49, 0.51, 1.0])
def test_switched_on_from_half_of_a_knob_s_range_on_and_no_door_is_open_by_it(share: float) -> None:
    with World(appliance("oven", "knob", 0)) as world:
        world.set_joint_position("oven_0", "knob_hinge", share * KNOB_RANGE_RAD)
        settle(world, 0.2)
        assert value(world, "(toggled_on oven_0)") is (share > 0.5)
        assert value(world, "(open oven_0)") is False
        assert value(world, "(toggled_on floor)") is None, "of what is no object nothing is known"


@pytest.mark.parametrize("share", [0.0, 0.49, 0.5, 0.51, 0.6])
def test_both_geometries_read_one_border_of_a_button(share: float) -> None:
    with World(appliance("microwave", "button", 0)) as world:
        for name in ("microwave_0", "counter_0", "floor"):
            world.set_joint_position("microwave_0", "button_slide", share * BUTTON_TRAVEL_M + 1e-9)
            found = Snapshot(world, world.pack())
            world.set_joint_position("microwave_0", "button_slide", share * BUTTON_TRAVEL_M + 1e-9)
            atom = bddl.Atom("toggled_on", (name,))
            assert decide(atom, world.scene, found, found).value is read(atom, world).value


@pytest.mark.parametrize("beyond_m", [-0.1, -0.02, 0.02, 0.1])
def test_on_a_table_as_long_as_its_middle_is_over_it(beyond_m: float) -> None:
    with table_with_can() as world:
        world.set_object_pose("can_0", at(1.0 + 0.4 + beyond_m, 0.0, TOP_M + 0.051))
        settle(world, 1.0)
        assert value(world, "(ontop can_0 table_0)") is (beyond_m < 0)
        assert value(world, "(not (ontop can_0 table_0))") is (beyond_m > 0)
        assert value(world, "(ontop can_0 floor)") in (False, beyond_m > 0)


@pytest.mark.parametrize(
    ("x_m", "y_m", "sides"),
    [
        (0.0, 0.10, {"next to", "left of"}),
        (0.0, -0.10, {"next to", "right of"}),
        (0.10, 0.0, {"next to", "behind"}),
        (-0.10, 0.0, {"next to", "in front of"}),
        (0.09, 0.09, {"next to", "left of", "behind"}),
        (0.0, 0.25, set()),
    ],
)
def test_a_side_is_as_seen_from_the_start_and_near(x_m: float, y_m: float, sides: set[str]) -> None:
    things: dict[str, Thing] = {
        "table_0": TABLE,
        "can_0": CAN | {"position": [1.0, 0.0, TOP_M + 0.0505]},
        "apple_0": APPLE | {"position": [1.0 + x_m, y_m, TOP_M + 0.0355]},
    }
    goal = bddl.parse_formula("(ontop apple_0 table_0)")
    with World(scene_of({name: thing | UPRIGHT for name, thing in things.items()})) as world:
        settle(world)
        now = Snapshot(world, world.pack())
        for relation in get_args(Side):
            spots = {"apple_0": Where(relation, "can_0")}
            found = decide(goal, world.scene, now, now, spots)
            assert found.value is (relation in sides), relation
            assert found.missing == (() if found.value else (f"apple_0 {relation} can_0",))
        part = decide(goal, world.scene, now, now, {"apple_0": Where(which="top", part="shelf")})
        assert part.value is None, "parts are not decided, and not taken for granted"


@pytest.mark.parametrize(("above_m", "holds"), [(0.001, True), (0.004, True), (0.012, False), (0.1, False)])
def test_in_the_air_above_a_table_is_not_on_it(above_m: float, holds: bool) -> None:
    with table_with_can() as world:
        world.set_object_pose("can_0", at(1.0, 0.0, TOP_M + 0.05 + above_m))
        assert value(world, "(ontop can_0 table_0)") is holds


def test_what_fell_over_is_neither_on_its_place_nor_gone_from_it() -> None:
    with table_with_can() as world:
        before = Snapshot(world, world.pack())
        R = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        world.set_object_pose("can_0", at(1.0, 0.0, TOP_M + 0.031, R))
        settle(world, 0.5)
        assert value(world, "(ontop can_0 table_0)", before) is False
        assert value(world, "(not (ontop can_0 table_0))", before) is False


@pytest.mark.parametrize(("aside_m", "holds"), [(0.0, True), (0.03, True), (0.16, False), (0.25, False)])
def test_in_a_bowl_or_beside_it(aside_m: float, holds: bool) -> None:
    things: dict[str, Thing] = {
        "table_0": TABLE | UPRIGHT,
        "bowl_0": BOWL | UPRIGHT | {"position": [1.0, 0.0, TOP_M + 0.0305]},
        "apple_0": APPLE | UPRIGHT | {"position": [1.0, -0.25, TOP_M + 0.0355]},
    }
    with World(scene_of(things)) as world:
        settle(world, 0.3)
        bowl = world.T_world_link("bowl_0")[:3, 3]
        world.set_object_pose("apple_0", at(float(bowl[0]), float(bowl[1]) + aside_m, TOP_M + 0.08))
        settle(world, 1.0)
        assert value(world, "(inside apple_0 bowl_0)") is holds
        assert value(world, "(ontop apple_0 bowl_0)") in (False, holds)


@pytest.mark.parametrize(("fraction", "holds"), [(0.0, False), (0.04, False), (0.06, True), (0.9, True)])
def test_open_beyond_a_twentieth_of_its_range(fraction: float, holds: bool) -> None:
    with World(scene_at_paper_size("kitchen_t1")) as world:
        joint = world.assets["refrigerator_0"].joints[0]
        world.set_joint_position("refrigerator_0", joint.name, joint.position(fraction))
        assert value(world, "(open refrigerator_0)") is holds


@pytest.mark.parametrize(("off_m", "under"), [(0.0, True), (0.5, False)])
def test_on_a_board_with_boards_above_or_out_of_the_shelf(off_m: float, under: bool) -> None:
    with World(on_a_shelf(0.12)) as world:
        T = world.T_world_link("can_0").copy()
        T[0, 3] -= off_m
        world.set_object_pose("can_0", T)
        assert value(world, "(under can_0 shelf_0)") is under
        assert value(world, "(ontop can_0 shelf_0)") is under


@pytest.mark.parametrize(("gap_m", "holds"), [(0.01, True), (0.3, False)])
def test_next_to_within_a_sixth_of_the_extents(gap_m: float, holds: bool) -> None:
    cans: dict[str, Thing] = {name: CAN | UPRIGHT for name in ("can_0", "can_1")}
    places = {"can_0": [1.0, 0.0, TOP_M + 0.0505], "can_1": [1.0, 0.06 + gap_m, TOP_M + 0.0505]}
    things: dict[str, Thing] = {name: can | {"position": places[name]} for name, can in cans.items()}
    table = TABLE | UPRIGHT | {"bbox_extent": [0.8, 0.8, 0.7]}
    with World(scene_of({"table_0": table, **things})) as world:
        settle(world, 0.3)
        assert value(world, "(nextto can_0 can_1)") is holds


FRIDGE: Thing = {
    "category": "refrigerator",
    "model": "upright_one_door",
    "position": [1.0, 0.0, 0.6],
    "bbox_extent": [0.68, 0.6, 1.2],
    "parameters": {"hinge": "left", "shelf_heights_m": [0.42, 0.72], "handle_height_m": 0.75, "open_fraction": 0.9},
}
DRAWERS: Thing = {
    "category": "bottom_cabinet",
    "model": "cabinet_drawers",
    "position": [1.0, 0.0, 0.4],
    "bbox_extent": [0.6, 0.45, 0.8],
    "parameters": {"open_fraction": 0.8},
}


def in_a_fixture(fixture: Thing) -> tuple[World, NDArray[np.float64]]:
    """Return a world with a can on the highest floor in a fixture, and the floor's middle."""
    can: Thing = CAN | UPRIGHT | {"bbox_extent": [0.05, 0.05, 0.08], "position": [0.0, -1.0, 0.0405]}
    scene = scene_of({"box_0": fixture | UPRIGHT, "can_0": can})
    floors = [region_frame(scene["box_0"], one) for one in asset_for(scene["box_0"]).regions if one.kind == "interior"]
    T, _ = max(floors, key=lambda floor: float(floor[0][2, 3]))
    world = World(scene)
    world.set_object_pose("can_0", at(*(T[:3, 3] + [0.0, 0.0, 0.0405])))
    settle(world, 0.5)
    return world, T[:3, 3]


@pytest.mark.parametrize(("beyond_m", "holds"), [(-0.2, True), (-0.01, True), (0.02, False), (0.2, False)])
def test_inside_a_refrigerator_until_it_reaches_out_of_it(beyond_m: float, holds: bool) -> None:
    world, (_, y, z) = in_a_fixture(FRIDGE)
    with world:
        assert value(world, "(inside can_0 box_0)") is True
        front_m = min(float(points[:, 0].min()) for points in Snapshot(world, world.pack()).root_hulls["box_0"])
        world.set_object_pose("can_0", at(front_m + 0.025 - beyond_m, y, z + 0.0405))
        assert value(world, "(inside can_0 box_0)") is holds


@pytest.mark.parametrize(("above_m", "holds"), [(-0.03, True), (0.0, False), (0.1, False)])
def test_inside_an_open_drawer_until_it_is_above_its_rim(above_m: float, holds: bool) -> None:
    world, (x, y, _) = in_a_fixture(DRAWERS)
    with world:
        assert value(world, "(inside can_0 box_0)") is True
        rim_m = max(points[:, 2].max() for _, points in Snapshot(world, world.pack()).drawers["box_0"])
        world.set_object_pose("can_0", at(x, y, float(rim_m) + above_m + 0.04))
        assert value(world, "(inside can_0 box_0)") is holds


@pytest.mark.parametrize(("gap_m", "holds"), [(0.0, True), (0.001, True), (0.01, False)])
def test_touching_within_two_millimetres(gap_m: float, holds: bool) -> None:
    places = {"can_0": [1.0, 0.0, TOP_M + 0.0505], "can_1": [1.0, 0.06 + gap_m, TOP_M + 0.0505]}
    cans: dict[str, Thing] = {name: CAN | UPRIGHT | {"position": place} for name, place in places.items()}
    with World(scene_of({"table_0": TABLE | UPRIGHT, **cans})) as world:
        assert value(world, "(touching can_0 can_1)") is holds
        assert value(world, "(touching can_0 table_0)") is True


def test_a_predicate_without_a_geometry_is_undecided() -> None:
    with table_with_can() as world:
        assert value(world, "(frozen can_0)") is None
        assert value(world, "(and (frozen can_0) (ontop can_0 table_0))") is None
        assert value(world, "(and (frozen can_0) (not (ontop can_0 table_0)))") is False


@pytest.mark.parametrize(("beyond_m", "up_m"), [(-0.1, 0.0), (-0.1, 0.3), (0.1, 0.0), (0.1, 0.05)])
def test_a_thing_has_left_its_table_once_its_middle_is_beyond_the_edge(beyond_m: float, up_m: float) -> None:
    with table_with_can() as world:
        before = Snapshot(world, world.pack())
        world.set_object_pose("can_0", at(1.0 + 0.4 + beyond_m, 0.0, TOP_M + 0.051 + up_m))
        assert Snapshot(world, world.pack()).has_left("can_0", before) is (beyond_m > 0)
