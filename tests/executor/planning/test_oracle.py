"""The collision oracle tells free configurations from others, with what is carried and with doors that move."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from executor.assets.model import Joint
from executor.geometry import Array, inverse
from executor.planning.articulation import ArticulationTask, end_fractions
from executor.planning.articulation_stances import rigid_stances
from executor.planning.cargo import Carried
from executor.planning.collision import CollisionOracle, fingers_may_touch, held_may_touch
from executor.planning.paths import polyline
from executor.planning.picks import Pick
from executor.planning.planner import Planner
from executor.sim.world import World
from oag import Action, Primitive
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import scene_at_paper_size

pytestmark = pytest.mark.physics

HINGE = Joint("hinge", "revolute", "body", "door", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 2.0))


@pytest.fixture(scope="module")
def scene_world() -> Iterator[tuple[World, Planner]]:
    """kitchen_t1, settled, with a planner."""
    scene = scene_at_paper_size("kitchen_t1")
    world, oracle_world = World(scene), World(scene, oracle=True)
    for _ in range(100):
        world.step()
    planner = Planner(CollisionOracle(oracle_world))
    planner.start_subtask(world, 0, 0)
    yield world, planner
    world.close()
    oracle_world.close()


def _at(x: float, y: float, yaw: float = 0.0) -> Array:
    return np.array([x, y, yaw, *PAPER_ROBOT.home])


def test_free_floor_is_free_and_furniture_is_not(scene_world: tuple[World, Planner]) -> None:
    oracle = scene_world[1].oracle
    assert oracle.hits(_at(-0.3, -0.1)) == []
    through = oracle.hits(_at(0.9, 0.0))
    assert {hit.other.split("/")[0] for hit in through} == {"refrigerator_0"}
    assert "base_body" in {hit.mover for hit in through}
    assert all(hit.separation_m < 0 for hit in through)


def test_margins_see_what_contact_does_not(scene_world: tuple[World, Planner]) -> None:
    oracle = scene_world[1].oracle
    x = next(x for x in np.arange(0.0, 0.9, 0.005) if oracle.hits(_at(float(x), 0.0), margin_m=0.02))
    assert not oracle.hits(_at(float(x) - 0.02, 0.0), margin_m=0.0)


def test_the_base_stands_on_the_floor_and_the_arm_keeps_off_it() -> None:
    with World(scene_at_paper_size("kitchen_t1").with_robot("ur5-lift"), oracle=True) as world:
        oracle = CollisionOracle(world)
        home = np.array(world.model.start(-0.3, -0.1, 0.0))
        assert oracle.hits(home) == []
        # The arm leans forward from its mount, at the lift's lower end, until the upper arm meets the floor.
        shoulder = next(k for k, name in enumerate(world.model.joint_names) if name == "shoulder_lift_joint")
        low = home.copy()
        low[3], low[shoulder] = 0.0, 1.3
        assert "ground/ground" in {hit.other for hit in oracle.hits(low)}


def test_a_moved_door_is_in_the_way_only_where_it_is(scene_world: tuple[World, Planner]) -> None:
    oracle = scene_world[1].oracle
    beside = _at(0.15, 0.3, 0.0)
    assert oracle.hits(beside) == []
    opened = oracle.hits(beside, joints={("refrigerator_0", "door_hinge"): 1.5})
    assert any("door" in hit.other or "door" in hit.mover for hit in opened)
    assert oracle.hits(beside) == [], "asking about a moved door must not move it"


def test_what_is_carried_collides_and_may_be_allowed_to(scene_world: tuple[World, Planner]) -> None:
    world, planner = scene_world
    oracle, kinematics = planner.oracle, planner.kinematics
    stance = next(Pick(planner, world, "glass_0", (), np.array([-0.3, -0.1, 0.0])).stances())
    oracle.carried = Carried("glass_0", inverse(kinematics.forward(stance.q)) @ world.T_world_link("glass_0"))
    try:
        standing = oracle.hits(stance.q, margin_m=0.001)
        assert {(hit.mover, hit.other.split("/")[0]) for hit in standing} == {("held object", "table_0")}
        assert not oracle.hits(stance.q, margin_m=0.001, allowed=held_may_touch(["table_0"]))
    finally:
        oracle.carried = None
    assert not oracle.hits(stance.q, allowed=fingers_may_touch(PAPER_ROBOT, "glass_0"))


def test_what_is_released_rests_where_the_hand_has_it_and_is_carried_on_after(
    scene_world: tuple[World, Planner],
) -> None:
    world, planner = scene_world
    oracle, q = planner.oracle, _at(-0.3, -0.1)
    T_eef = planner.kinematics.forward(q)
    start = world.T_world_link("glass_0")
    oracle.carried = Carried("glass_0", inverse(T_eef) @ T_eef)
    try:
        for x in (-0.3, 0.1):
            there = _at(x, -0.1)
            with oracle.released_at(there):
                oracle.hits(q)
                wanted = planner.kinematics.forward(there)[:3, 3]
                assert oracle.world.T_world_link("glass_0")[:3, 3] == pytest.approx(wanted, abs=1e-4)
    finally:
        oracle.carried = None
    oracle.hits(q)
    assert oracle.world.T_world_link("glass_0")[:3, 3] == pytest.approx(start[:3, 3], abs=1e-4)


def test_stances_at_the_handle_reach_it_within_limits(scene_world: tuple[World, Planner]) -> None:
    world, planner = scene_world
    handle = world.assets["refrigerator_0"].handles[0]
    opening = Action(Primitive.ARTICULATE_OPEN)
    work = ArticulationTask(planner, world, "refrigerator_0", handle, opening)
    stance = next(rigid_stances(work, np.array([-0.3, -0.1, 0.0])))
    T_world_door = world.T_world_link("refrigerator_0", handle.link)
    bar = (T_world_door @ np.array([*handle.position_m, 1.0]))[:3]
    hand = planner.kinematics.forward(stance.q)
    offset = hand[:3, 3] - bar
    assert np.hypot(*offset[:2]) < 1e-3
    assert abs(offset[2]) < handle.length_m / 2
    assert planner.kinematics.margin(stance.approach[:, PAPER_ROBOT.arm]) == pytest.approx(stance.margin_rad)
    assert stance.margin_rad > 0.1
    np.testing.assert_allclose(stance.approach[-1], stance.q)


def test_equal_questions_get_equal_answers(scene_world: tuple[World, Planner]) -> None:
    world, planner = scene_world

    def ask() -> Array:
        planner.start_subtask(world, 7, 1)
        return next(Pick(planner, world, "glass_0", (), np.array([-0.3, -0.1, 0.0])).stances()).approach

    np.testing.assert_array_equal(ask(), ask())


def test_lines_are_straight_and_unreachable_ones_say_how_far_off(scene_world: tuple[World, Planner]) -> None:
    planner = scene_world[1]
    q = _at(-0.3, -0.1)
    T = planner.kinematics.forward(q)
    up = T.copy()
    up[2, 3] += 0.1
    line = planner.line(q, up)
    assert line.path is not None
    hands = np.array([planner.kinematics.forward(row)[:3, 3] for row in line.path])
    assert np.abs(hands[:, :2] - T[:2, 3]).max() < 2e-3
    assert hands[-1, 2] == pytest.approx(up[2, 3], abs=1e-3)
    far = T.copy()
    far[0, 3] += 1.0
    beyond = planner.line(q, far)
    assert beyond.path is None
    assert beyond.residual_m > 0.2


def test_base_paths_go_around_and_refuse_blocked_goals(scene_world: tuple[World, Planner]) -> None:
    planner = scene_world[1]
    path = planner.base_path(_at(-0.3, -0.1), np.array([0.0, -2.0, 1.0]))
    assert path is not None
    assert planner.oracle.first_hit(polyline(PAPER_ROBOT, path)) is None
    assert planner.base_path(_at(-0.3, -0.1), np.array([0.95, 0.0, 0.0])) is None


@pytest.mark.parametrize(
    ("primitive", "interval", "now", "wanted"),
    [
        (Primitive.ARTICULATE_OPEN, (0.0, 0.7), 0.0, (0.7,)),
        (Primitive.ARTICULATE_CLOSE, (0.0, 0.5), 0.85, (0.35,)),
        (Primitive.ARTICULATE_CLOSE, (0.0, 0.6), 0.5, (0.0,)),
        (Primitive.ARTICULATE_CLOSE, None, 0.85, (0.0,)),
        (Primitive.ARTICULATE_OPEN, None, 0.7, (0.85, 0.75)),
        (Primitive.ARTICULATE_OPEN, (0.0, 1.5), 0.0, (0.75,)),
        (Primitive.ARTICULATE_OPEN, (0.0, 6.0), 0.0, (1.0,)),
    ],
)
def test_where_an_articulation_ends(
    primitive: Primitive, interval: tuple[float, float] | None, now: float, wanted: tuple[float, ...]
) -> None:
    assert end_fractions(PAPER_ROBOT, Action(primitive, interval), HINGE, now) == pytest.approx(wanted)
