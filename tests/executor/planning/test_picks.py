"""From where an item is taken when most of the floor around it is not to be had."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from executor.assets.library import sample
from executor.geometry import heading_of, wrap_angle
from executor.planning.collision import CollisionOracle
from executor.planning.picks import LIFTS_M, LOW_LIFTS_M, OUT_M, TURNS_RAD, Pick, lifts_out_m
from executor.planning.planner import Planner
from executor.planning.stances import Stance
from executor.sim.detectors import read
from executor.sim.world import World
from executor.skills.navigate import ELSEWHERE_M, LOOKED_AT, distinct_first
from oag import Action, Primitive, Scene, SceneObject
from oag.model.robots import PAPER_ROBOT
from oag.model.scene import RobotPose
from tests.executor.helpers import at, on_a_shelf, scene_of

ASKEW_RAD = np.pi / 4


def _stance(x_m: float, y_m: float) -> Stance[None]:
    q = np.array([x_m, y_m, *np.zeros(8)])
    return Stance(PAPER_ROBOT, q, q[None], 1.0, 0.02, None, 1.0)


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), max_size=40))
def test_stances_near_one_that_no_way_led_to_come_last(places: list[tuple[float, float]]) -> None:
    stances = [_stance(*place) for place in places]
    places_of = {id(stance): rank for rank, stance in enumerate(stances)}
    offered = list(distinct_first(iter(stances)))
    assert sorted(map(id, offered)) == sorted(map(id, stances[:LOOKED_AT])), (
        "each once, and not more than are looked at"
    )
    near = [
        any(np.hypot(*(stance.q[:2] - before.q[:2])) < ELSEWHERE_M for before in offered[:index])
        for index, stance in enumerate(offered)
    ]
    assert near == sorted(near), "those from elsewhere come first"
    for group in (False, True):
        ranks = [places_of[id(stance)] for stance, is_near in zip(offered, near, strict=True) if is_near is group]
        assert ranks == sorted(ranks), "else in their order"


@pytest.fixture
def worlds() -> Iterator[list[World]]:
    """Worlds to be closed at the end."""
    made: list[World] = []
    yield made
    for world in made:
        world.close()


def _block(name: str, centre: tuple[float, float], extent: tuple[float, float, float]) -> SceneObject:
    return SceneObject(name, "cabinet", "closed", (*centre, extent[2] / 2), (1, 0, 0, 0), extent, (1, 1, 1), {})


@pytest.mark.physics
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_stands_askew_beside_a_bed_is_taken_by_a_base_that_faces_elsewhere(
    side: float, worlds: list[World]
) -> None:
    stand = _block("stand_0", (0.95, 0.0), (0.4, 0.4, 0.55))
    bed = _block("bed_0", (0.2, side * -0.72), (1.9, 1.0, 0.5))
    wall = _block("wall_0", (1.35, 0.0), (0.3, 3.0, 1.5))
    bear = sample("teddy_bear", 0, "bear_0")
    scale = 0.05 / bear.bbox_extent[0]
    # Its sides, which the fingers close on, look along the bed's diagonal.
    yaw = side * ASKEW_RAD
    bear = replace(
        bear,
        position=(0.84, 0.0, 0.55 + scale * bear.bbox_extent[2] / 2),
        orientation=(float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))),
        scale=(scale, scale, scale),
    )
    objects = {obj.id: obj for obj in (stand, bed, wall, bear)}
    scene = Scene(name="beside a bed", robot=RobotPose(position=(-0.4, side * 0.4, 0.0)), objects=objects)
    world, oracle = World(scene), World(scene, oracle=True)
    worlds += [world, oracle]
    world.step()
    planner = Planner(CollisionOracle(oracle))
    planner.start_subtask(world, 0, 0)
    lift = (Action(Primitive.LIFT_EEF_UP),)
    stance = next(Pick(planner, world, "bear_0", lift, np.array([-0.4, side * 0.4, 0.0])).stances())
    hand = planner.kinematics.forward(stance.q)
    turned_rad = wrap_angle(float(stance.q[2]) - heading_of(hand[:3, 2]))
    assert abs(turned_rad) > max(TURNS_RAD)
    assert planner.oracle.is_path_free(stance.approach[:1]), "the way to the bear begins free"


@pytest.mark.physics
@pytest.mark.parametrize(
    ("height_m", "most_m"),
    [
        pytest.param(0.12, 0.088, marks=pytest.mark.slow),
        (0.17, 0.038),
        pytest.param(0.19, 0.018, marks=pytest.mark.slow),
    ],
)
def test_under_a_board_a_thing_is_lifted_no_higher_than_there_is_room(
    height_m: float, most_m: float, worlds: list[World]
) -> None:
    scene = on_a_shelf(height_m)
    world, oracle = World(scene), World(scene, oracle=True)
    worlds += [world, oracle]
    world.step()
    planner = Planner(CollisionOracle(oracle))
    planner.start_subtask(world, 0, 0)
    pick = Pick(planner, world, "can_0", (Action(Primitive.LIFT_EEF_UP),), np.zeros(3), LOW_LIFTS_M)
    (action,) = next(pick.stances()).followup.moves
    assert isinstance(action.parameter, float) and 0.0 < action.parameter < most_m


@pytest.mark.physics
@pytest.mark.parametrize(
    ("model", "extent"),
    [("porcelain_bowl", (0.18, 0.18, 0.055)), ("open_box", (0.3, 0.3, 0.1)), ("open_box", (0.3, 0.3, 0.25))],
)
def test_a_lift_out_of_a_bowl_or_a_box_ends_out_of_it(
    model: str, extent: tuple[float, float, float], worlds: list[World]
) -> None:
    category = model.rpartition("_")[2]
    thing = {"category": category, "model": model, "bbox_extent": extent, "position": [0.0, 0.0, extent[2] / 2]}
    apple = {"category": "apple", "model": "apple", "bbox_extent": [0.05] * 3, "position": [0.0, 0.0, 0.04]}
    upright = {"orientation": [1, 0, 0, 0]}
    world = World(scene_of({f"{category}_0": thing | upright, "apple_0": apple | upright}))
    worlds.append(world)
    inside = bddl.Atom("inside", ("apple_0", f"{category}_0"))
    region = world.assets[f"{category}_0"].regions[0]
    start = at(0.0, 0.0, extent[2] / 2 + region.floor_m[2] + 0.024)
    world.set_object_pose("apple_0", start)
    world.step()
    assert read(inside, world).value is True
    world.set_object_pose("apple_0", start)
    found = lifts_out_m(LIFTS_M, world, "apple_0")
    assert found and set(found) <= {*LIFTS_M, max(found)}
    for lift_m in {*found, *LIFTS_M}:
        world.set_object_pose("apple_0", at(0.0, 0.0, start[2, 3] + lift_m))
        depth_m = read(inside, world).measurements.centre_depth_m
        assert depth_m is not None and (lift_m in found) is (depth_m < -OUT_M + 0.002), lift_m


def test_what_is_in_nothing_may_be_lifted_as_before(worlds: list[World]) -> None:
    world = World(on_a_shelf(0.1))
    worlds.append(world)
    assert lifts_out_m(LIFTS_M, world, "can_0") == LIFTS_M
