"""The dry run: it finds the states that physics finds, refuses what cannot be done with the reason, and ends."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import bddl
import executor
import llm
import oag
from executor.geometry import transform
from executor.records import Event, FailureKind
from executor.rollouts import feasibility
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.goals import judge
from executor.scenes.file import complete_scene
from executor.scenes.generators import any_task
from executor.scenes.library import load
from executor.scenes.placement import AtEdge, PlaceSpec, place, stand_robot
from executor.scenes.room import Room, stand
from executor.sim.robot.kinematics import Kinematics
from executor.skills import library
from executor.skills.control import Controller
from executor.skills.dry_run import DryController, DryWorld, at_rest_within
from executor.system.effort import Effort, SearchExhausted
from oag import Scene, SceneObject
from oag.model.robots import LIFTED
from oag.sizes import Sizing
from tests.executor.wishes import pursued

pytestmark = pytest.mark.physics
QUERY = "put the glass into the refrigerator"


def planned(scene: Scene, query: str = QUERY) -> oag.ObjectActionGraph:
    return oag.compose(llm.propose(query, scene).task, scene=scene)


def with_things(scene: Scene, **things: SceneObject) -> Scene:
    return replace(scene, objects={**scene.objects, **things})


def chair(x_m: float, y_m: float) -> SceneObject:
    upright = (1.0, 0.0, 0.0, 0.0)
    size = (0.43, 0.42, 0.85)
    return SceneObject("chair_0", "chair", "chair_wooden", (x_m, y_m, size[2] / 2), upright, size, (1.0, 1.0, 1.0))


@pytest.fixture(scope="module")
def kitchen() -> Scene:
    return load("kitchen_t1")


def test_the_whole_plan_is_feasible_with_a_stance_and_a_margin_for_every_subtask(kitchen: Scene) -> None:
    graph = planned(kitchen)
    heard: list[Event] = []
    found = executor.feasible(graph, kitchen, 0, listen=heard.append)
    assert found and not found.reason and found.failure is None
    assert [part.record.name for part in found.subtasks] == [one.name for one in graph.task.subtasks]
    assert all(part.record.succeeded and (part.margin_deg or 0.0) > 0.0 for part in found.subtasks)
    assert [event.kind for event in heard].count("subtask-end") == len(graph.task.subtasks)


def test_a_door_that_meets_a_chair_is_named_with_the_chair(kitchen: Scene) -> None:
    blocked = with_things(kitchen, chair_0=chair(0.25, 0.0))
    found = executor.feasible(planned(blocked), blocked, 0, vary=False)
    assert not found and len(found.subtasks) == 1 and found.primitive == "NAVIGATE_TO_TARGET"
    assert found.failure is not None and found.failure.kind is FailureKind.NO_PATH
    assert "chair_0" in found.reason and found.to_json()["failed"] == found.subtasks[0].record.name


@pytest.mark.slow
def test_equal_seeds_give_equal_choices(kitchen: Scene) -> None:
    graph = planned(kitchen, "open the refrigerator")
    one, other = (executor.feasible(graph, kitchen, 3).subtasks[0] for _ in range(2))
    assert one.base == other.base and one.record.flow == other.record.flow


def test_no_robot_of_the_physics_is_driven(kitchen: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    def moved(*_: Any, **__: Any) -> None:
        raise AssertionError("a robot of the physics moved")

    monkeypatch.setattr(Controller, "follow", moved)
    assert executor.feasible(planned(kitchen, "open the refrigerator"), kitchen, 0)


def test_what_the_fingers_close_on_goes_along_and_comes_down_again(kitchen: Scene) -> None:
    start = Checkpoint.at_start(kitchen)
    with DryWorld(kitchen, start.packed) as world:
        control = DryController(world, np.array(start.target), start.finger_target_m)
        before = world.T_world_link("glass_0")
        state = world.state
        lifted = before.copy()
        lifted[2, 3] += 0.07
        world.put("glass_0", lifted)
        world.come_down(("glass_0",))
        assert np.abs(world.T_world_link("glass_0") - before).max() < 1e-3
        tilted = before.copy()
        c, s = np.cos(0.2), np.sin(0.2)
        tilted[:3, :3] = before[:3, :3] @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        tilted[2, 3] += 0.03
        world.put("glass_0", tilted)
        world.come_down(("glass_0",))
        assert world.T_world_link("glass_0")[2, 2] == pytest.approx(1.0, abs=1e-6)
        assert control.grip(0.0).max() < 1e-3 and not world.along, "there is nothing between the fingers"
        world.restore(state)
        assert np.array_equal(world.T_world_link("glass_0"), before)


def test_fingers_stop_at_the_walls_of_a_hollow_mug(kitchen: Scene) -> None:
    size = (0.109, 0.077, 0.086)
    mug = SceneObject("mug_0", "mug", "mug", (-2.0, -2.0, size[2] / 2), (1.0, 0.0, 0.0, 0.0), size, (1.0, 1.0, 1.0))
    scene = with_things(kitchen, mug_0=mug)
    start = Checkpoint.at_start(scene)
    with DryWorld(scene, start.packed) as world:
        control = DryController(world, np.array(start.target), start.finger_target_m)
        control.grip(0.04)
        # Upright as the hand sees it, its body between the fingers, which reach 15 mm below its rim.
        T_eef_mug = np.diag([1.0, -1.0, -1.0, 1.0])
        T_eef_mug[0, 3], T_eef_mug[2, 3] = 0.012, size[2] / 2 - 0.015
        world.put("mug_0", Kinematics(world.robot, world.model).forward(control.q) @ T_eef_mug)
        assert control.grip(0.0).sum() == pytest.approx(size[1], abs=2e-3)
        assert world.along == ("mug_0",)


def test_what_falls_onto_a_bowls_wall_slides_down_it_and_what_falls_beside_it_does_not(kitchen: Scene) -> None:
    def standing(name: str, category: str, x_m: float, size: tuple[float, float, float]) -> SceneObject:
        place, upright = (x_m, -2.0, size[2] / 2), (1.0, 0.0, 0.0, 0.0)
        return SceneObject(name, category, category, place, upright, size, (1.0, 1.0, 1.0))

    bowl, die = standing("bowl_0", "bowl", -2.0, (0.16, 0.16, 0.06)), standing("die_0", "die", -1.5, (0.04, 0.04, 0.04))
    scene = with_things(kitchen, bowl_0=bowl, die_0=die)
    with DryWorld(scene, Checkpoint.at_start(scene).packed) as world:
        off_m = {}
        for x_m in (-1.955, -1.8):
            pose = world.T_world_link("die_0")
            pose[:3, 3] = (x_m, -2.0, 0.11)
            world.put("die_0", pose)
            world.come_down(("die_0",))
            off_m[x_m] = float(world.T_world_link("die_0")[0, 3]) - x_m
    assert -0.035 < off_m[-1.955] < -0.008, "as far as the bowl's foot"
    assert off_m[-1.8] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("aside_m", "stays"),
    [(0.0, True), pytest.param(0.03, False, id="it tumbles"), pytest.param(0.085, False, id="it falls beside")],
)
def test_how_a_thing_ends_in_a_bowl_is_found_without_changing_the_world(
    kitchen: Scene, aside_m: float, stays: bool
) -> None:
    upright, size = (1.0, 0.0, 0.0, 0.0), (0.16, 0.16, 0.06)
    bowl = SceneObject("bowl_0", "bowl", "bowl", (-2.0, -2.0, 0.03), upright, size, (1.0, 1.0, 1.0))
    # No cube: that one stands on each of its faces.
    carton = SceneObject("box_0", "box", "carton", (-1.5, -2.0, 0.03), upright, (0.04, 0.04, 0.06), (1.0, 1.0, 1.0))
    scene = with_things(kitchen, bowl_0=bowl, box_0=carton)
    with DryWorld(scene, Checkpoint.at_start(scene).packed) as world:
        before, released = world.T_world_link("box_0"), world.T_world_link("box_0")
        released[:3, 3] = (-2.0 + aside_m, -2.0, 0.11)
        with at_rest_within(world, {"box_0": released}, "bowl_0") as rested:
            assert set(rested.assets) == {"bowl_0", "box_0"}
            (reading,) = judge(bddl.Atom("inside", ("box_0", "bowl_0")), rested)
        assert reading.satisfied is stays
        assert np.array_equal(world.T_world_link("box_0"), before)


@pytest.mark.parametrize(
    ("below", "above", "stays"),
    [
        pytest.param(("cup", (0.061, 0.061, 0.09)), ("red_apple", (0.074, 0.074, 0.074)), True, id="in the rim"),
        pytest.param(
            ("porcelain_bowl", (0.15, 0.15, 0.06)), ("porcelain_bowl", (0.16, 0.16, 0.06)), False, id="it nests"
        ),
        pytest.param(("can", (0.061, 0.061, 0.11)), ("can", (0.058, 0.058, 0.09)), True, id="on the flat top"),
    ],
)
def test_a_thing_is_put_onto_a_rim_or_a_flat_top_if_it_stays_there(
    below: tuple[str, tuple[float, float, float]], above: tuple[str, tuple[float, float, float]], stays: bool
) -> None:
    room = Room("stacked", "kitchen", np.random.default_rng(4), depth_m=3.6, width_m=4.0)
    table = room.draw("table_four_legs")
    stand(room, table, 0.0, 0.0, yaw_rad=0.0)
    keys = []
    for along_m, (model, size) in zip((-0.15, 0.15), (below, above), strict=True):
        thing = room.draw(model, extent_m=dict(zip("xyz", size, strict=True)))
        keys.append(place(room, thing, PlaceSpec(table.id, at=AtEdge("-x", (0.12, 0.13), (along_m, along_m + 0.01)))))
    stand_robot(room)
    scene = room.scene().with_robot(LIFTED.name)
    found = executor.feasible(planned(scene, f"put {keys[1]} onto {keys[0]}"), scene, vary=False)
    assert found.feasible is stays, found.reason
    assert stays or "it would not stay there" in found.reason


@pytest.mark.parametrize(
    ("second", "size", "word", "fits"),
    [
        pytest.param("half_apple", (0.066, 0.066, 0.03), "half apple", True, marks=pytest.mark.slow),
        ("bottle", (0.06, 0.06, 0.20), "bottle", True),
    ],
)
def test_an_apple_and_another_thing_go_into_a_box_that_is_hardly_large_enough(
    second: str, size: tuple[float, float, float], word: str, fits: bool
) -> None:
    room = Room("two_in_a_box", "kitchen", np.random.default_rng(4), depth_m=3.6, width_m=4.0)
    table = room.draw("table_four_legs")
    stand(room, table, 0.0, 0.0, yaw_rad=0.0)
    sizes = {"open_box": (0.147, 0.131, 0.074), "red_apple": (0.066, 0.066, 0.066), second: size}
    things = {name: room.draw(name, extent_m=dict(zip("xyz", size, strict=True))) for name, size in sizes.items()}
    for along_m, thing in zip((-0.2, 0.0, 0.2), things.values(), strict=True):
        place(room, thing, PlaceSpec(table.id, at=AtEdge("-x", (0.12, 0.13), (along_m, along_m + 0.01))))
    stand_robot(room)
    scene = room.scene().with_robot(LIFTED.name)
    found = executor.feasible(planned(scene, f"put the apple and the {word} into the box"), scene, vary=False)
    assert found.feasible is fits, found.reason


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "because"),
    [
        (78017, "a carton that was taken steeply is taken again level, for a low compartment"),
        (78056, "a bowl that is partly below the top of its drawer comes out before it is raised"),
        (78059, "what comes first goes to the back, and a bowl is taken sideways along its rim"),
        (78099, "in an exchange the place is free after what stands there has gone"),
    ],
)
def test_wishes_that_a_person_calls_possible_are_feasible(seed: int, because: str) -> None:
    wish = any_task.draw(seed)
    task = llm.propose(wish.query, wish.scene, sizing=Sizing(keep=True)).task
    found = executor.feasible(oag.compose(task, scene=wish.scene), wish.scene, seed, vary=False)
    assert found, f"{because}: {found.reason}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "because"),
    [
        (91005, "on another branch of the arm the door opens less far, and then has to be pushed on"),
        (90084, "a shorter push ends elsewhere than a longer one passes, and the elbow met a table"),
    ],
)
def test_a_run_makes_the_choices_of_its_forecast(seed: int, because: str) -> None:
    done = pursued(seed)
    assert done.succeeded, f"{because}: {done.failure}"


def test_a_joint_takes_along_what_its_link_carries(kitchen: Scene) -> None:
    start = Checkpoint.at_start(kitchen)
    with DryWorld(kitchen, start.packed) as world:
        joint = world.assets["refrigerator_0"].joints[0]
        world.move_joint("refrigerator_0", joint.name, joint.position(0.5))
        assert joint.fraction(world.joint_position("refrigerator_0", joint.name)) == pytest.approx(0.5, abs=1e-6)
        contacts = world.contacts({"refrigerator_0"})
        assert not any(contact.impulse_ns > 0.0 for contact in contacts)


@pytest.mark.parametrize(("height_m", "closes"), [(0.08, True), (0.30, False)])
def test_a_drawer_does_not_close_with_what_stands_out_of_it(height_m: float, closes: bool) -> None:
    things = {
        "cabinet_0": {"category": "bottom_cabinet", "model": "cabinet_drawers", "position": [1.0, 0.0]},
        "can_0": {"category": "can", "position": [-1.0, -1.0, height_m / 2], "bbox_extent": [0.06, 0.06, height_m]},
    }
    scene = complete_scene({"robot": {"position": [-1.0, 0.0]}, "objects": things}).scene
    assert scene is not None
    with DryWorld(scene, Checkpoint.at_start(scene).packed) as world:
        asset = world.assets["cabinet_0"]
        region = next(region for region in asset.regions if region.name == "drawer_1")
        joint = next(joint for joint in asset.joints if joint.child == region.link)
        assert world.carry("cabinet_0", joint.name, joint.position(0.9)) is None
        floor_m = world.T_world_link("cabinet_0", region.link) @ (*region.floor_m, 1.0)
        world.put("can_0", transform(np.eye(3), floor_m[:3] + [0.0, 0.0, height_m / 2]))
        failure = world.carry("cabinet_0", joint.name, joint.position(0.0))
        assert (failure is None) is closes, failure
        shut = 0.0 if closes else 0.9
        assert joint.fraction(world.joint_position("cabinet_0", joint.name)) == pytest.approx(shut, abs=1e-6)
        if failure is not None:
            assert "can_0 and cabinet_0/" in failure.message


def test_a_search_without_an_end_ends_with_what_met_most_often(kitchen: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "MOST_EFFORT_S", 0.05)
    found = executor.feasible(planned(kitchen), kitchen, 0)
    assert not found and found.failure is not None and found.failure.kind is FailureKind.NO_ANSWER
    assert "no answer in the time" in found.reason and "configurations" in found.reason
    assert not found.decided and found.to_json()["feasible"] is None
    assert not found.known, "what was not found in the time is no fact"


def test_a_forecast_ends_in_its_time_and_says_neither_yes_nor_no(
    kitchen: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    lifted = kitchen.with_robot(LIFTED.name)
    monkeypatch.setattr(feasibility, "MOST_FORECAST_S", 0.3)
    found = executor.feasible(planned(lifted), lifted, 0, vary=False)
    assert not found and not found.decided and found.effort_s < 0.5
    blocked = with_things(lifted, chair_0=chair(0.25, 0.0))
    refused = executor.feasible(planned(blocked), blocked, 0, vary=False)
    assert refused.decided and refused.to_json()["feasible"] is False, "a reason that was found in the time counts"


def test_effort_counts_within_its_limit_alone() -> None:
    effort = Effort()
    effort.add(100.0)
    with effort.limited(1.0):
        effort.add(0.9)
        with effort.limited(5.0), pytest.raises(SearchExhausted):
            effort.add(0.2)
    effort.add(100.0)


def test_what_is_impossible_is_a_fact_by_which_another_plan_is_taken(kitchen: Scene) -> None:
    blocked = with_things(kitchen, chair_0=chair(0.25, 0.0)).with_robot("panda")
    either = "(or (open refrigerator_0) (not (ontop glass_0 table_0)))"
    first = oag.plan(blocked, either).task
    assert first is not None and [one.name for one in first.subtasks] == ["open_refrigerator_0"]
    found = executor.feasible(oag.compose(first, scene=blocked), blocked, 0, vary=False)
    assert found and [one.target for one in found.task.subtasks] == ["glass_0"]
    assert [(one.kind, one.thing) for one in found.known] == [("open", "refrigerator_0")]
    assert "chair_0" in found.known[0].reason and "another plan is taken" in found.detours[0].reason
    refused = executor.feasible(planned(blocked, "open the refrigerator"), blocked, 0, vary=False)
    assert not refused and len(refused.known) == 1
    again = oag.compose(refused.task, scene=blocked.knowing(refused.known)).verify()
    assert [error.code for error in again.errors] == ["task/infeasible"]
