"""What rides in or on a thing moves with it in collision queries, and takes up room there."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from executor.assets.library import asset_for
from executor.geometry import inverse
from executor.planning.cargo import Carried, cargo_of, carried_by, touching_any
from executor.planning.collision import CollisionOracle, held_may_touch
from executor.planning.planner import Planner
from executor.records import FailureKind
from executor.sim.detectors import box_around
from executor.sim.engine import BodyRef, Contact
from executor.sim.world import World
from executor.skills import control
from executor.skills.control import Monitor
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import at, scene_at_paper_size, scene_of, settle

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


Size = tuple[float, float, float]


def _thing(category: str, model: str, size_m: Size, x_m: float, y_m: float, bottom_m: float) -> dict[str, object]:
    """Return an upright thing as scenes have it."""
    position = [x_m, y_m, bottom_m + size_m[2] / 2 + 0.0005]
    of = {"category": category, "model": model, "bbox_extent": list(size_m)}
    return {**of, "position": position, "orientation": [1, 0, 0, 0]}


TABLE = _thing("table", "table", (1.2, 1.2, 0.6), 0.9, 0.0, 0.0)
SHELF = _thing("shelf", "shelf_open", (0.35, 0.9, 1.2), 1.1, 0.0, 0.0) | {"parameters": {"boards": 4}}
BOWL, PLATE, APPLE = (0.153, 0.153, 0.051), (0.185, 0.185, 0.022), (0.06, 0.06, 0.06)


@pytest.mark.parametrize(
    ("things", "cargo"),
    [
        pytest.param(
            {
                "bowl_0": _thing("bowl", "porcelain_bowl", BOWL, 0.9, 0.0, 0.6),
                "apple_0": _thing("apple", "red_apple", (0.05, 0.05, 0.05), 0.9, -0.026, 0.615),
                "orange_0": _thing("orange", "orange", (0.05, 0.05, 0.05), 0.9, 0.026, 0.615),
            },
            {"bowl_0": {"apple_0", "orange_0"}, "apple_0": set()},
            id="two that touch each other",
        ),
        pytest.param(
            {
                "plate_0": _thing("plate", "plate", PLATE, 0.9, 0.0, 0.6),
                "plate_1": _thing("plate", "plate", PLATE, 0.9, 0.0, 0.623),
                "apple_0": _thing("apple", "red_apple", APPLE, 0.9, 0.0, 0.646),
            },
            {"plate_0": {"plate_1", "apple_0"}, "plate_1": {"apple_0"}},
            id="two plates one in the other",
        ),
        pytest.param(
            {
                "bowl_0": _thing("bowl", "porcelain_bowl", BOWL, 0.9, 0.0, 0.6),
                "bottle_0": _thing("bottle", "medicine_bottle", (0.041, 0.041, 0.12), 0.9, 0.0, 0.61),
            },
            {"bowl_0": {"bottle_0"}},
            id="taller than its bowl",
        ),
        pytest.param(
            {
                "box_0": _thing("box", "carton", (0.1, 0.1, 0.1), 0.9, 0.0, 0.6),
                "bottle_0": _thing("bottle", "medicine_bottle", (0.05, 0.05, 0.15), 0.975, 0.0, 0.6),
            },
            {"box_0": set(), "bottle_0": set()},
            id="next to each other",
        ),
    ],
)
def test_cargo_is_what_rests_on_nothing_else(things: dict[str, dict[str, object]], cargo: dict[str, set[str]]) -> None:
    world = World(scene_of({"table_0": TABLE, **things}))
    try:
        settle(world)
        assert {name: set(cargo_of(world, name)) for name in cargo} == cargo
    finally:
        world.close()


def test_what_stands_on_the_board_above_is_no_cargo() -> None:
    boards = {r.name: 0.6 + r.floor_m[2] for r in asset_for(scene_of({"shelf_0": SHELF})["shelf_0"]).regions}
    below, above = boards["board_shelf_2"], boards["board_shelf_3"]
    things = {
        "box_0": _thing("box", "carton", (0.1, 0.05, 0.1), 1.02, 0.1, below),
        "apple_0": _thing("apple", "red_apple", APPLE, 1.02, 0.1, above),
    }
    world = World(scene_of({"shelf_0": SHELF, **things}))
    try:
        settle(world)
        assert cargo_of(world, "box_0") == ()
    finally:
        world.close()


def test_the_cargo_of_a_bowl_is_its_apple(worlds: tuple[World, CollisionOracle]) -> None:
    world, _ = worlds
    assert cargo_of(world, "bowl_0") == ("apple_0",)
    assert cargo_of(world, "apple_0") == ()
    assert set(touching_any(world, ("bowl_0", "apple_0"))) == set(touching_any(world, ("bowl_0",))) - {"apple_0"}


def test_poses_in_the_hand_are_those_of_the_world(worlds: tuple[World, CollisionOracle]) -> None:
    world, _ = worlds
    T_world_eef = world.T_world_link("bowl_0") @ inverse(FAR_M)
    carried = carried_by(world, "bowl_0", T_world_eef, ("apple_0",))
    assert carried.ids == ("bowl_0", "apple_0")
    for name, T_eef_object in carried.poses:
        np.testing.assert_allclose(T_world_eef @ T_eef_object, world.T_world_link(name), atol=1e-9)


def test_a_bowl_takes_its_apple_along_and_both_are_where_they_were_once_it_is_let_go_of(
    worlds: tuple[World, CollisionOracle],
) -> None:
    world, oracle = worlds
    oracle.carried = carried_by(world, "bowl_0", world.T_world_link("bowl_0") @ inverse(FAR_M), ("apple_0",))
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


@pytest.mark.parametrize(
    ("near", "far", "met"),
    [
        (BodyRef("apple_0", "apple"), BodyRef("bowl_0", "bowl"), False),
        (BodyRef("robot", "panda_leftfinger"), BodyRef("apple_0", "apple"), False),
        (BodyRef("robot", "panda_link4"), BodyRef("apple_0", "apple"), True),
        (BodyRef("apple_0", "apple"), BodyRef("table_0", "table"), True),
        (BodyRef("robot", "base_body"), BodyRef("ground", "ground"), False),
        (BodyRef("robot", "panda_link2"), BodyRef("ground", "ground"), True),
    ],
)
def test_a_monitor_lets_cargo_touch_its_carrier_and_the_gripper_and_the_base_the_floor_alone(
    near: BodyRef, far: BodyRef, met: bool, worlds: tuple[World, CollisionOracle], monkeypatch: pytest.MonkeyPatch
) -> None:
    world, oracle = worlds
    carried = carried_by(world, "bowl_0", world.T_world_link("bowl_0") @ inverse(FAR_M), ("apple_0",))
    hard = Contact(near, far, -0.001, 60.0 * world.timestep_s)
    monkeypatch.setattr(world, "contacts", lambda owners=None: (hard,))
    monkeypatch.setattr(control, "fingers_touching", lambda *_: 2)
    monkeypatch.setattr(Monitor, "offset_in_hand", lambda *_: np.zeros(3))
    failure = Monitor(world, oracle.kinematics, carried=carried).check()
    assert (failure is not None) is met
    assert failure is None or failure.kind is FailureKind.COLLISION


def test_a_carrier_with_cargo_is_not_turned_over(worlds: tuple[World, CollisionOracle]) -> None:
    world, oracle = worlds
    planner = Planner(oracle)
    planner.start_subtask(world, 0, 0)
    upward = planner.kinematics.forward(FREE)[2, :3]
    cargo = (("apple_0", FAR_M),)
    flat = Carried("bowl_0", FAR_M, cargo, upward)
    postures = [np.array(PAPER_ROBOT.home) for _ in range(3)]
    for posture, lean_deg in zip(postures, (18.0, 36.0, 0.0), strict=True):
        posture[5] += np.deg2rad(lean_deg)  # The wrist, which pitches the hand.
    postures[2][0] += np.deg2rad(40.0)  # About the vertical.
    little, more, turned = postures
    try:
        oracle.carried = Carried("bowl_0", FAR_M)
        assert planner.arm_path(FREE, more) is not None
        oracle.carried = flat
        assert planner.arm_path(FREE, turned) is not None
        first = planner.arm_path(FREE, little)
        assert first is not None
        assert planner.arm_path(first[-1], more) is None, "two small leans are a large one"
    finally:
        oracle.carried = None
