"""Which door, how far, and where hand and base go while it moves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oag
from bddl import And
from executor.assets.asset_geometry import joint_transform
from executor.assets.library import asset_for, sample
from executor.assets.model import Joint
from executor.geometry import inverse
from executor.planning.articulation import (
    PULLED_OUT,
    ArticulationTask,
    Share,
    carry_joint,
    course,
    driving_carries,
    end_fractions,
    first_obstruction,
    interval,
    smaller_fractions,
)
from executor.planning.articulation_stances import explain_failure, rigid_stances, tracked_stances
from executor.planning.collision import CollisionOracle
from executor.planning.grasps import panel_of, tilted_goals
from executor.planning.openings import handles_to_close, handles_to_open, open_joints
from executor.planning.planner import Planner
from executor.records import FailureKind
from executor.sim.world import World
from llm.structured.prompting import primitives_text
from oag import Action, Primitive, Scene, SceneObject
from oag.measurements import measurements_json
from oag.model.robots import LIFTED, PAPER_ROBOT, Robot
from oag.model.scene import RobotPose
from tests.executor.helpers import at

OPEN, CLOSE = Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE
SLIDE = Joint("slide", "prismatic", "body", "drawer", (0.0, 0.0, 0.3), (-1.0, 0.0, 0.0), (0.0, 0.4))
UPRIGHT = Joint("hinge", "revolute", "body", "door", (0.1, 0.3, 0.5), (0.0, 0.0, -1.0), (0.0, 1.9))
FOLDING = Joint("hinge", "revolute", "body", "door", (0.1, 0.0, 0.12), (0.0, -1.0, 0.0), (0.0, 1.5))
fractions = st.floats(0.0, 1.0)


@pytest.mark.parametrize(
    ("primitive", "given_interval", "now", "wanted"),
    [
        (OPEN, None, 0.0, (0.45, 0.35, 0.25, 0.15)),
        (OPEN, (0.0, 0.5), 0.0, (0.35, 0.25, 0.15)),
        (OPEN, (0.0, 0.3), 0.2, ()),
        (CLOSE, None, 0.7, (0.15, 0.25, 0.35, 0.45, 0.55)),
        (CLOSE, (0.0, 0.3), 0.7, (0.55,)),
    ],
)
def test_a_first_stage_ends_between_here_and_what_was_asked(
    primitive: Primitive, given_interval: tuple[float, float] | None, now: float, wanted: tuple[float, ...]
) -> None:
    assert smaller_fractions(PAPER_ROBOT, Action(primitive, given_interval), SLIDE, now) == wanted


@pytest.mark.parametrize(
    ("robot", "joint", "widest"), [(LIFTED, SLIDE, PULLED_OUT), (LIFTED, UPRIGHT, 0.85), (PAPER_ROBOT, SLIDE, 0.85)]
)
def test_a_drawer_is_pulled_out_where_stored_results_need_not_repeat(robot: Robot, joint: Joint, widest: float) -> None:
    assert end_fractions(robot, Action(OPEN), joint, 0.0)[0] == widest
    assert end_fractions(robot, Action(OPEN, (0.0, 0.5)), joint, 0.0) == (0.5,), "what is asked for is done"


@given(fractions, fractions)
def test_the_interval_that_is_written_down_asks_for_what_was_done(start: float, end: float) -> None:
    opening = interval(min(start, end), max(start, end))
    assert end_fractions(PAPER_ROBOT, Action(OPEN, opening), SLIDE, start)[0] == pytest.approx(
        max(start, end), abs=0.011
    )
    assert str(opening[0])[0] != "-"


@pytest.mark.parametrize("joint", [SLIDE, UPRIGHT, FOLDING])
def test_a_hand_that_holds_on_keeps_its_place_at_the_handle(joint: Joint) -> None:
    T_root, hand = at(0.4, -0.2, 0.1), at(-0.2, -0.3, 0.6)
    along = course(hand, np.array([-0.6, -0.3, 0.0]), joint, T_root, 0.1, 0.35, Share(0.5, 0.5))
    held = inverse(T_root @ joint_transform(joint, 0.1)) @ hand
    assert along.positions[-1] == pytest.approx(0.35)
    for position, T in zip(along.positions, along.hands, strict=True):
        np.testing.assert_allclose(inverse(T_root @ joint_transform(joint, position)) @ T, held, atol=1e-9)


def test_a_base_that_takes_the_whole_share_drives_the_rigid_arc() -> None:
    T_root, hand, q = at(0.4, -0.2, 0.1), at(-0.2, -0.3, 0.6), np.zeros(10)
    q[:3] = (-0.6, -0.4, 0.2)
    along = course(hand, q[:3], UPRIGHT, T_root, 0.0, 1.2, Share(1.0, 1.0))
    arc = carry_joint(PAPER_ROBOT, q, "x", UPRIGHT, T_root, 0.0, 1.2)
    np.testing.assert_allclose(along.bases[-1], arc.path[-1, :3], atol=1e-9)


def test_a_hand_that_does_not_hold_on_keeps_its_orientation() -> None:
    along = course(at(-0.2, 0.0, 0.6), np.zeros(3), FOLDING, np.eye(4), 0.0, 1.2, Share(0.8, 0.0, 0.0))
    np.testing.assert_allclose(along.hands[-1][:3, :3], np.eye(3), atol=1e-9)
    assert along.hands[-1][2, 3] < 0.6
    moved = along.hands[-1][0, 3] - along.hands[0][0, 3]
    assert along.bases[-1][0] == pytest.approx(0.8 * moved)


def test_driving_carries_upright_hinges_and_level_slides_only() -> None:
    assert [driving_carries(joint, np.eye(4)) for joint in (SLIDE, UPRIGHT, FOLDING)] == [True, True, False]


def _scene(model: str, **more: SceneObject) -> Scene:
    return _scene_of(sample(model, 0, "fixture_0"), **more)


def _scene_of(fixture: SceneObject, **more: SceneObject) -> Scene:
    depth, _, height = fixture.extent_m
    return Scene(
        name="articulation",
        robot=RobotPose(position=(-0.4, 0.2, 0.0)),
        objects={"fixture_0": replace(fixture, position=(0.75 + depth / 2, 0.0, height / 2)), **more},
    )


@pytest.fixture
def worlds() -> Iterator[list[World]]:
    """Worlds to be closed at the end."""
    made: list[World] = []
    yield made
    for world in made:
        world.close()


def _planner(scene: Scene, worlds: list[World]) -> tuple[World, Planner]:
    world, oracle = World(scene), World(scene, oracle=True)
    worlds += [world, oracle]
    world.step()
    planner = Planner(CollisionOracle(oracle))
    planner.start_subtask(world, 0, 0)
    return world, planner


@pytest.mark.physics
def test_what_lies_in_a_drawer_decides_which_one_is_opened(worlds: list[World]) -> None:
    die = sample("die", 0, "die_0")
    world = World(_scene("cabinet_drawers", die_0=die))
    worlds.append(world)
    region = next(r for r in world.assets["fixture_0"].regions if r.name == "drawer_1")
    place = (world.T_world_link("fixture_0", region.link) @ [*region.center_m, 1.0])[:3]
    place[2] += die.extent_m[2] / 2 - region.half_extents_m[2]
    world.set_object_pose("die_0", at(*place))
    for _ in range(50):
        world.step()
    take = oag.SimpleTask("take", "", "die_0", None, None, And(()), And(()))
    assert [h.joint for h in handles_to_open(world, "fixture_0", [take])] == ["drawer_1_slide"]
    assert handles_to_open(world, "fixture_0", []) == world.assets["fixture_0"].handles


@pytest.mark.physics
def test_closing_takes_what_stands_open_the_widest_first(worlds: list[World]) -> None:
    world = World(_scene("cabinet_two_doors"))
    worlds.append(world)
    names = [joint.name for joint in world.assets["fixture_0"].joints]
    world.set_joint_position("fixture_0", names[0], 0.3)
    assert [joint.name for joint in open_joints(world, "fixture_0")] == names[:1]
    world.set_joint_position("fixture_0", names[1], 0.9)
    assert [handle.joint for handle in handles_to_close(world, "fixture_0")] == [names[1], names[0]]


def test_a_panel_is_pushed_from_outside_or_from_inside() -> None:
    asset = asset_for(sample("fridge_one_door", 0, "fridge_0"))
    outer, inner = (panel_of(asset, asset.handles[0], inner=inside) for inside in (False, True))
    assert outer is not None and inner is not None
    np.testing.assert_allclose(outer.normal, asset.handles[0].outward)
    np.testing.assert_allclose(inner.normal, -outer.normal)
    assert outer.center_m[0] < inner.center_m[0]
    # The free edge is on the handle's side of the panel.
    assert float(outer.sides[0] @ (np.array(asset.handles[0].position_m) - outer.center_m)) > 0.1


@pytest.mark.physics
def test_the_hand_at_an_oven_comes_from_above_the_bar(worlds: list[World]) -> None:
    world = World(_scene("oven_bottom_hinge"))
    worlds.append(world)
    handle = world.assets["fixture_0"].handles[0]
    T_root, T_door = world.T_world_link("fixture_0"), world.T_world_link("fixture_0", handle.link)
    goals = tilted_goals(handle, T_root, T_door, facing=handle.outward)
    first = goals[0].T_world_eef
    assert first[2, 2] == pytest.approx(-np.sin(np.deg2rad(50.0)), abs=1e-6)
    assert first[0, 2] > 0.0 and abs(first[1, 1]) < 1e-6, "it looks at the front and its fingers close across the bar"


@pytest.mark.slow
@pytest.mark.physics
def test_an_oven_is_no_matter_of_driving_but_of_the_whole_body(worlds: list[World]) -> None:
    world, planner = _planner(_scene("oven_bottom_hinge"), worlds)
    work = ArticulationTask(planner, world, "fixture_0", world.assets["fixture_0"].handles[0], Action(OPEN))
    here = np.array([-0.4, 0.2, 0.0])
    assert next(rigid_stances(work, here), None) is None
    swing = next(tracked_stances(work, here)).followup
    assert swing.motion == "whole-body arc" and swing.end_fraction >= 0.55


@pytest.mark.physics
def test_a_door_that_meets_a_wall_says_where_and_what(worlds: list[World]) -> None:
    wall = SceneObject("wall_0", "cabinet", "test", (0.2, 0.0, 0.6), (1, 0, 0, 0), (0.3, 1.6, 1.2), (1, 1, 1), {})
    world, planner = _planner(_scene("fridge_one_door", wall_0=wall), worlds)
    work = ArticulationTask(planner, world, "fixture_0", world.assets["fixture_0"].handles[0], Action(OPEN, (0.0, 0.9)))
    meets = first_obstruction(work)
    assert meets is not None and meets[1].startswith("wall_0/") and 0.1 < meets[0] < 0.9
    failure = explain_failure(work, np.array([-0.4, 0.2, 0.0]))
    assert failure.kind is FailureKind.NO_PATH and "meets wall_0" in failure.message


@pytest.mark.physics
@pytest.mark.parametrize("model", ["dishwasher_bottom_hinge", "oven_bottom_hinge", "cabinet_one_door"])
def test_a_door_passes_the_units_that_stand_flush_beside_it(model: str, worlds: list[World]) -> None:
    depth_m, width_m, height_m = sample(model, 0, "fixture_0").extent_m
    sides = {}
    for name, side in (("left_0", 1.0), ("right_0", -1.0)):
        # Lengths are rounded to millimetres, so what stands flush is half of one off.
        aside_m = side * ((width_m + 0.5) / 2 - 0.0005)
        centre, extent = (0.75 + depth_m / 2, aside_m, height_m / 2), (depth_m, 0.5, height_m)
        sides[name] = SceneObject(name, "counter", "closed", centre, (1, 0, 0, 0), extent, (1, 1, 1), {})
    world, planner = _planner(_scene(model, **sides), worlds)
    for handle in world.assets["fixture_0"].handles:
        assert (
            first_obstruction(ArticulationTask(planner, world, "fixture_0", handle, Action(OPEN, (0.0, 0.85)))) is None
        ), handle.joint


@pytest.mark.physics
@pytest.mark.parametrize(("primitive", "asked"), [(CLOSE, None), (CLOSE, (0.0, 0.3)), (OPEN, (0.0, 0.0))])
def test_a_door_that_is_where_it_should_be_is_no_mistake(
    primitive: Primitive, asked: tuple[float, float] | None, worlds: list[World]
) -> None:
    world, planner = _planner(_scene("oven_bottom_hinge"), worlds)
    work = ArticulationTask(planner, world, "fixture_0", world.assets["fixture_0"].handles[0], Action(primitive, asked))
    assert work.now == 0.0
    swing = next(tracked_stances(work, np.array([-0.4, 0.2, 0.0]))).followup
    assert swing.end_fraction == 0.0


@pytest.mark.physics
def test_a_handle_out_of_reach_says_by_how_much(worlds: list[World]) -> None:
    scene = _scene("oven_bottom_hinge")
    oven = scene.objects["fixture_0"]
    x, y, z = oven.position
    high = replace(scene, objects={"fixture_0": replace(oven, position=(x, y, z + 0.9))})
    world, planner = _planner(high, worlds)
    work = ArticulationTask(planner, world, "fixture_0", world.assets["fixture_0"].handles[0], Action(OPEN))
    failure = explain_failure(work, np.array([-0.4, 0.2, 0.0]))
    assert failure.kind is FailureKind.UNREACHABLE and "off its handle" in failure.message
    # The bar is 1.59 m high, and nothing above 1.1 m can be reached.
    assert 0.35 < measurements_json(failure.measurements)["residual_m"] < 0.75
    assert {"residual_deg", "joints_at_limit"} <= set(measurements_json(failure.measurements))


@pytest.mark.physics
def test_a_door_that_stands_as_near_to_a_neighbour_as_it_may_can_be_shut(worlds: list[World]) -> None:
    wall = SceneObject("wall_0", "cabinet", "test", (0.2, 0.0, 0.6), (1, 0, 0, 0), (0.3, 1.6, 1.2), (1, 1, 1), {})
    world, planner = _planner(_scene("fridge_one_door", wall_0=wall), worlds)
    handle = world.assets["fixture_0"].handles[0]
    met = first_obstruction(ArticulationTask(planner, world, "fixture_0", handle, Action(OPEN, (0.0, 0.9))))
    assert met is not None
    world.set_joint_position("fixture_0", handle.joint, world.assets["fixture_0"].joint(handle.joint).position(met[0]))
    planner.oracle.synchronize(world)
    assert first_obstruction(ArticulationTask(planner, world, "fixture_0", handle, Action(CLOSE))) is None
    on = first_obstruction(ArticulationTask(planner, world, "fixture_0", handle, Action(OPEN, (0.0, 0.9))))
    assert on is not None and on[1] == met[1] and on[0] < 0.9, "nearer it may not come"


def test_the_prompt_tells_an_interval_as_it_is_run() -> None:
    """A model that writes numbers is told that closing goes by the interval's length, with these examples."""
    told = primitives_text()
    for limits, left in (((0.0, 0.5), 0.3), ((0.0, 0.9), 0.0)):
        action = Action(Primitive.ARTICULATE_CLOSE, limits)
        assert end_fractions(PAPER_ROBOT, action, SLIDE, 0.8) == pytest.approx((left,))
        assert str(list(limits)) in told
    assert end_fractions(PAPER_ROBOT, Action(OPEN, (0.2, 0.6)), SLIDE, 0.0) == (0.6,)


def _drawer_with(height_m: float, open_by: float, worlds: list[World], robot: str = LIFTED.name) -> ArticulationTask:
    """A low drawer that stands open, with a can of some height behind its front."""
    can = replace(sample("can", 0, "can_0"), bbox_extent=(0.05, 0.05, height_m))
    cabinet = replace(sample("cabinet_drawers", 0, "fixture_0"), bbox_extent=(0.6, 0.5, 0.8))
    scene = _scene_of(replace(cabinet, parameters={**cabinet.parameters, "drawers": 3}), can_0=can).with_robot(robot)
    world, oracle = World(scene), World(scene, oracle=True)
    worlds += [world, oracle]
    handle = next(h for h in world.assets["fixture_0"].handles if h.joint == "drawer_2_slide")
    joint = world.assets["fixture_0"].joint(handle.joint)
    world.set_joint_position("fixture_0", joint.name, joint.position(open_by))
    region = next(r for r in world.assets["fixture_0"].regions if r.joint == joint.name)
    x, y, z = (world.T_world_link("fixture_0", region.link) @ [*region.center_m, 1.0])[:3]
    front_m = x - region.half_extents_m[0] + 0.05
    world.set_object_pose("can_0", at(front_m, y, z - region.half_extents_m[2] + height_m / 2 + 0.0005))
    world.step()
    planner = Planner(CollisionOracle(oracle))
    planner.start_subtask(world, 0, 0)
    return ArticulationTask(planner, world, "fixture_0", handle, Action(CLOSE))


def _over(work: ArticulationTask, item: str) -> np.ndarray:
    """A configuration with the fingers straight down around the top of an item."""
    planner, T_item = work.planner, work.world.T_world_link(item)
    top_m = T_item[2, 3] + work.world.assets[item].extent_m[2] / 2
    down = np.diag([1.0, -1.0, -1.0])
    base = np.array([T_item[0, 3] - 0.5, T_item[1, 3], 0.0, 0.3])
    arm = planner.kinematics.solve(at(T_item[0, 3], T_item[1, 3], top_m - 0.01, down), base)[0].arm
    return np.concatenate([base, arm])


@pytest.mark.physics
def test_what_lies_in_a_drawer_goes_along_with_it(worlds: list[World]) -> None:
    work = _drawer_with(0.12, 0.9, worlds)
    oracle, slide = work.planner.oracle, ("fixture_0", work.joint.name)
    q = _over(work, "can_0")

    def met(q: np.ndarray, joints: dict[tuple[str, str], float] | None = None) -> bool:
        return any(hit.other.startswith("can_0/") for hit in oracle.hits(q, opening_m=0.0, joints=joints))

    half = work.joint.position(0.5)
    along = q.copy()
    along[:2] += (half - work.now) * np.array(work.joint.axis)[:2]
    assert met(q) and not met(along)
    assert not met(q, {slide: half}) and met(along, {slide: half}), "it is where the drawer takes it"
    assert met(q) and not met(along), "asking about a moved drawer must not move what lies in it"
    oracle.set_joint(slide, half)
    assert not met(q) and met(along)
    oracle.synchronize(work.world)
    assert met(q) and not met(along)


@pytest.mark.slow
@pytest.mark.physics
def test_a_drawer_is_shut_by_its_handle_with_something_tall_behind_its_front(worlds: list[World]) -> None:
    work = _drawer_with(0.12, 0.97, worlds)
    assert first_obstruction(work) is None
    swing = next(rigid_stances(work, np.array([-0.4, 0.2, 0.0, 0.0]))).followup
    assert swing.end_fraction == 0.0


@pytest.mark.physics
@pytest.mark.parametrize(("robot", "met"), [(LIFTED.name, "can_0"), (PAPER_ROBOT.name, None)])
def test_what_is_higher_than_the_room_of_its_drawer_keeps_it_from_shutting(
    robot: str, met: str | None, worlds: list[World]
) -> None:
    obstruction = first_obstruction(_drawer_with(0.3, 0.9, worlds, robot))
    assert (obstruction and obstruction.item) == met, "stored results of the paper's robot were found without"
    if obstruction is not None:
        assert obstruction.met.startswith("fixture_0/") and 0.1 < obstruction.fraction < 0.9
        failure = explain_failure(_drawer_with(0.3, 0.9, worlds, robot), np.array([-0.4, 0.2, 0.0, 0.0]))
        assert "can_0, which goes along with drawer_2_slide" in failure.message
