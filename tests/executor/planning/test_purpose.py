"""Which of several doors and drawers to open for what is to be put inside, and why there is no place for it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

import oag
from bddl import And, Atom
from executor.assets.library import sample
from executor.assets.model import Handle
from executor.geometry import inverse
from executor.planning.articulation_stances import OPENING, articulation_stances
from executor.planning.cargo import Carried
from executor.planning.collision import CollisionOracle
from executor.planning.grasps import item_goals
from executor.planning.openings import Purpose, first_item_put_inside
from executor.planning.place_search import PlaceSearch
from executor.planning.planner import Planner
from executor.records import FailureKind
from executor.sim.world import World
from executor.skills.navigate import regions_for
from oag import Action, Primitive, Scene, SceneObject
from oag.model.robots import PAPER_ROBOT
from oag.model.scene import RobotPose

HERE = np.array([-0.4, 0.0, 0.0])
TABLE_M = 0.6
OPEN = Action(Primitive.ARTICULATE_OPEN)


def _scene(fixture: SceneObject, item: SceneObject) -> Scene:
    """A fixture before the robot, and behind it a table with an item."""
    depth, _, height = fixture.extent_m
    extent = (0.6, 0.8, TABLE_M)
    scale = 0.05 / min(item.bbox_extent[:2])
    above_m = TABLE_M + scale * item.bbox_extent[2] / 2
    objects = (
        replace(fixture, position=(0.75 + depth / 2, 0.0, height / 2)),
        SceneObject("table_0", "cabinet", "closed", (-1.4, 0.0, TABLE_M / 2), (1, 0, 0, 0), extent, (1, 1, 1), {}),
        replace(item, scale=(scale,) * 3, position=(-1.2, 0.0, above_m), orientation=(1, 0, 0, 0)),
    )
    return Scene(name="purpose", robot=RobotPose(position=tuple(HERE)), objects={o.id: o for o in objects})


@pytest.fixture
def worlds() -> Iterator[list[World]]:
    """Worlds to be closed at the end."""
    made: list[World] = []
    yield made
    for world in made:
        world.close()


def _planner(model: str, item: str, worlds: list[World]) -> tuple[World, Planner]:
    return _planner_in(_scene(sample(model, 0, "fixture_0"), sample(item, 0, "item_0")), worlds)


def _planner_in(scene: Scene, worlds: list[World]) -> tuple[World, Planner]:
    world, oracle = World(scene), World(scene, oracle=True)
    worlds += [world, oracle]
    world.step()
    planner = Planner(CollisionOracle(oracle))
    planner.start_subtask(world, 0, 0)
    return world, planner


def _verdicts(model: str, item: str, worlds: list[World], *, put: bool = True) -> dict[str, bool]:
    world, planner = _planner(model, item, worlds)
    purpose = Purpose(planner, world, "fixture_0", OPEN, "item_0" if put else None, HERE)
    joints = {joint.name: planner.oracle.joint_position(("fixture_0", joint.name)) for joint in _joints(world)}
    found = {handle.joint: purpose.serves(handle) for handle in world.assets["fixture_0"].handles}
    assert planner.oracle.carried is None
    assert joints == {name: planner.oracle.joint_position(("fixture_0", name)) for name in joints}
    return found


def _joints(world: World) -> tuple[object, ...]:
    return world.assets["fixture_0"].joints


@pytest.mark.slow
@pytest.mark.physics
@pytest.mark.parametrize("item", ["tumbler", "red_apple"])
def test_a_deep_drawer_near_the_floor_is_not_opened_for_what_no_hand_can_put_there(
    item: str, worlds: list[World]
) -> None:
    assert _verdicts("fridge_freezer_drawer", item, worlds) == {"door_hinge": True, "freezer_drawer_slide": False}


@pytest.mark.slow
@pytest.mark.physics
def test_of_three_drawers_the_lowest_alone_is_too_low_for_a_glass(worlds: list[World]) -> None:
    cabinet = sample("cabinet_drawers", 0, "fixture_0")
    cabinet = replace(cabinet, bbox_extent=(0.6, 0.5, 0.8), parameters={**cabinet.parameters, "drawers": 3})
    glass = replace(sample("tumbler", 0, "item_0"), bbox_extent=(0.07, 0.07, 0.12))
    world, planner = _planner_in(_scene(cabinet, glass), worlds)
    purpose = Purpose(planner, world, "fixture_0", OPEN, "item_0", HERE)
    handles = world.assets["fixture_0"].handles
    assert handles[0].joint == "drawer_3_slide", "the largest would be opened if none served"
    assert {handle.joint: purpose.serves(handle) for handle in handles} == {
        "drawer_3_slide": False,
        "drawer_2_slide": True,
        "drawer_1_slide": True,
    }


@pytest.mark.physics
def test_an_opening_for_nothing_in_particular_is_served_by_all(worlds: list[World]) -> None:
    assert all(_verdicts("fridge_freezer_drawer", "tumbler", worlds, put=False).values())


def test_what_a_later_subtask_puts_inside(worlds: list[World]) -> None:
    def subtask(target: str, *goal: Atom) -> oag.SimpleTask:
        return oag.SimpleTask("do", "", target, None, None, And(()), And(goal))

    world = World(_scene(sample("fridge_freezer_drawer", 0, "fixture_0"), sample("tumbler", 0, "item_0")))
    worlds.append(world)
    put = subtask("item_0", Atom("inside", ("item_0", "fixture_0")))
    shut = subtask("fixture_0", Atom("inside", ("item_0", "fixture_0")))
    assert first_item_put_inside(world, "fixture_0", [shut, put]) == "item_0"
    assert first_item_put_inside(world, "table_0", [put]) is None
    assert first_item_put_inside(world, "fixture_0", [shut]) is None


@pytest.mark.physics
def test_what_does_not_serve_is_tried_last_and_left_out_nowhere(
    worlds: list[World], monkeypatch: pytest.MonkeyPatch
) -> None:
    world, planner = _planner("fridge_freezer_drawer", "tumbler", worlds)
    handles = world.assets["fixture_0"].handles
    asked: list[str] = []

    def serves(handle: Handle) -> bool:
        return handle.joint == "door_hinge"

    def way(work: object, *_: object, **__: object) -> Iterator[str]:
        asked.append(work.handle.joint)  # type: ignore[attr-defined]
        return iter(())

    ways = tuple((way, partial) for _, partial in OPENING)
    monkeypatch.setattr("executor.planning.articulation_stances.OPENING", ways)
    list(articulation_stances(planner, world, "fixture_0", handles, OPEN, HERE, serves=serves))
    assert asked == ["door_hinge"] * len(OPENING) + ["freezer_drawer_slide"] * len(OPENING)
    asked.clear()
    list(articulation_stances(planner, world, "fixture_0", handles, OPEN, HERE, serves=lambda _: False))
    assert asked == ["door_hinge", "freezer_drawer_slide"] * len(OPENING), "where none serves, the order is the usual"
    asked.clear()
    list(articulation_stances(planner, world, "fixture_0", handles[1:], OPEN, HERE, serves=serves))
    assert asked == ["freezer_drawer_slide"] * len(OPENING)


@pytest.mark.slow
@pytest.mark.physics
def test_where_no_place_is_found_it_says_what_meets(worlds: list[World]) -> None:
    world, planner = _planner("fridge_freezer_drawer", "tumbler", worlds)
    goal = item_goals(PAPER_ROBOT.hand, world.assets["item_0"], world.T_world_link("item_0"))[0].T_world_eef
    planner.oracle.carried = Carried("item_0", inverse(goal) @ world.T_world_link("item_0"))
    regions = [r for r in world.assets["fixture_0"].regions if r.joint == "door_hinge"]
    moves = (Action(Primitive.MOVE_BASE_FORWARD), Action(Primitive.LIFT_EEF_DOWN))
    q = np.concatenate([HERE, PAPER_ROBOT.home])
    failure = PlaceSearch(planner, world, "fixture_0", regions, q).explain_failure(moves)
    assert failure.kind is FailureKind.NO_PATH
    assert failure.message.startswith("no place for item_0 at fixture_0 was found: ")
    assert "fixture_0/door meet" in failure.message
    none = PlaceSearch(planner, world, "fixture_0", [], q).explain_failure(moves)
    assert none.message.endswith("no spot is free on which it would stand")


def test_things_are_put_behind_what_stands_open(worlds: list[World]) -> None:
    world = World(_scene(sample("fridge_freezer_drawer", 0, "fixture_0"), sample("tumbler", 0, "item_0")))
    worlds.append(world)
    goal = And((Atom("inside", ("item_0", "fixture_0")),))
    put = oag.SimpleTask("put", "", "item_0", None, "fixture_0", And(()), goal)
    shut = [region.joint for region in regions_for(world, put)]
    assert {"door_hinge", "freezer_drawer_slide"} <= set(shut)
    drawer = world.assets["fixture_0"].joint("freezer_drawer_slide")
    world.set_joint_position("fixture_0", drawer.name, drawer.position(0.8))
    assert [region.joint for region in regions_for(world, put)] == [drawer.name]
