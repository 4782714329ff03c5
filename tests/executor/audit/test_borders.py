"""Each predicate of the second geometry, by physics without a robot's help: things moved into and out of a relation."""

from __future__ import annotations

import numpy as np
import pytest

import bddl
from executor.audit.decision import decide
from executor.audit.geometry import Snapshot
from executor.sim.world import World
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


@pytest.mark.parametrize("beyond_m", [-0.1, -0.02, 0.02, 0.1])
def test_on_a_table_as_long_as_its_middle_is_over_it(beyond_m: float) -> None:
    with table_with_can() as world:
        world.set_object_pose("can_0", at(1.0 + 0.4 + beyond_m, 0.0, TOP_M + 0.051))
        settle(world, 1.0)
        assert value(world, "(ontop can_0 table_0)") is (beyond_m < 0)
        assert value(world, "(not (ontop can_0 table_0))") is (beyond_m > 0)
        assert value(world, "(ontop can_0 floor)") in (False, beyond_m > 0)


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


def test_a_predicate_without_a_geometry_is_undecided() -> None:
    with table_with_can() as world:
        assert value(world, "(frozen can_0)") is None
        assert value(world, "(and (frozen can_0) (ontop can_0 table_0))") is None
        assert value(world, "(and (frozen can_0) (not (ontop can_0 table_0)))") is False
