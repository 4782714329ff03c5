"""Things that are in something, from the sentence to the physics: planned, proved, taken out, put down, doors shut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import executor
import llm
import oag
from executor.records import Rollout
from executor.scenes.placement import AtEdge, PlaceSpec, place, stand_robot
from executor.scenes.room import Room, against, stand
from oag import Scene, SceneObject, Task
from tests.executor.helpers import on_a_shelf

pytestmark = pytest.mark.physics

SEED = 3
NEAR_THE_FRONT = AtEdge("-x", (0.10, 0.14), (-0.1, 0.1))


def a_room(seed: int = SEED) -> Room:
    return Room("taking_out", "kitchen", np.random.default_rng(seed), depth_m=3.6, width_m=4.0)


def small(room: Room, model: str, height_m: float) -> SceneObject:
    return room.draw(model, extent_m={"x": 0.05, "y": 0.05, "z": height_m})


def refrigerator(room: Room) -> str:
    fridge = room.draw("fridge_one_door", parameters={"hinge": "right", "shelves": 2})
    against(room, "east", fridge, 0.9)
    return fridge.id


def furnished(room: Room) -> Scene:
    stand(room, room.draw("table_four_legs"), -0.6, -1.1, yaw_rad=0.0)
    stand_robot(room)
    return room.scene()


def can_in_a_refrigerator() -> Scene:
    room = a_room()
    place(room, small(room, "can", 0.09), PlaceSpec(refrigerator(room), region="door_shelf_1", at=NEAR_THE_FRONT))
    return furnished(room)


def die_in_a_drawer() -> Scene:
    room = a_room()
    cabinet = room.draw("cabinet_drawers", parameters={"drawers": 3})
    against(room, "east", cabinet, 0.0)
    place(
        room,
        room.draw("die", extent_m=dict.fromkeys("xyz", 0.04)),
        PlaceSpec(cabinet.id, region="drawer_1", at=(0.0, 0.05)),
    )
    return furnished(room)


def apple_in_a_refrigerator_and_a_bowl_in_a_cabinet() -> Scene:
    room = a_room()
    place(
        room,
        small(room, "red_apple", 0.05),
        PlaceSpec(refrigerator(room), region="door_shelf_1", at=NEAR_THE_FRONT),
    )
    cabinet = room.draw("cabinet_one_door", parameters={"shelves": 0, "hinge": "left"})
    against(room, "east", cabinet, -0.9)
    bowl = room.draw("porcelain_bowl", extent_m={"x": 0.15, "y": 0.15, "z": 0.055})
    place(room, bowl, PlaceSpec(cabinet.id, region="door_bottom", at=AtEdge("-x", (0.12, 0.16), (-0.05, 0.05))))
    return furnished(room)


def planned(query: str, scene: Scene) -> Task:
    """The offline plan for a query, which has to be proved."""
    task = llm.propose(query, scene).task
    assert oag.compose(task).verify()
    return task


def assert_withdrawn_and_put(done: Rollout, item: str) -> None:
    """Asserts that everything succeeded, and that the thing was out when picking it up ended."""
    assert done.succeeded, done.failure
    picked = next(part for part in done.subtasks if part.name == f"pick_up_{item.rpartition('_')[0]}")
    assert [step.primitive for step in picked.steps][-2:] == ["LIFT_EEF_UP", "RETREAT"]
    inside = {reading.literal: reading.value for reading in picked.readings if reading.literal.startswith("(inside")}
    assert {literal: value for literal, value in inside.items() if not literal.endswith("gripper)")} != {}
    assert all(value is literal.endswith("gripper)") for literal, value in inside.items())


@pytest.mark.parametrize(
    ("robot", "feasible"), [("panda-lift", True), pytest.param("panda", False, marks=pytest.mark.slow)]
)
def test_what_stands_at_the_back_is_taken_out_by_an_arm_that_stretches(robot: str, feasible: bool) -> None:
    room = a_room()
    size = {"x": 0.70, "y": 0.70, "z": 1.40}
    fridge = room.draw("fridge_one_door", extent_m=size, parameters={"hinge": "right", "shelves": 1})
    against(room, "east", fridge, 0.0)
    at = AtEdge("+x", (0.04, 0.05), (-0.05, 0.05))
    place(room, small(room, "can", 0.09), PlaceSpec(fridge.id, region="door_shelf_1", at=at))
    scene = furnished(room).with_robot(robot)
    found = executor.feasible(oag.compose(planned("take the can out of the refrigerator", scene)), scene, vary=False)
    assert found.feasible is feasible, found.reason
    if not feasible:
        return
    readings = {reading.literal: reading.value for reading in found.subtasks[-1].record.readings}
    assert readings["(inside can_0 gripper)"] and not any(
        value for literal, value in readings.items() if literal.endswith(f"{fridge.id})")
    )


@pytest.mark.slow
def test_out_of_a_refrigerator_onto_a_table() -> None:
    scene = can_in_a_refrigerator()
    task = planned("take the can out of the refrigerator and put it on the table", scene)
    assert_withdrawn_and_put(executor.rollout(oag.compose(task), scene), "can_0")


@pytest.mark.slow
def test_out_of_a_drawer_onto_a_table_by_flows_that_were_searched() -> None:
    scene = die_in_a_drawer()
    task = planned("take the die out of the cabinet and put it on the table", scene)
    bare = replace(task, subtasks=tuple(replace(subtask, flow=None) for subtask in task.subtasks))
    assert_withdrawn_and_put(executor.rollout(oag.compose(bare), scene), "die_0")


@pytest.mark.slow
def test_out_of_a_closed_refrigerator_into_a_bowl_in_a_closed_cabinet() -> None:
    scene = apple_in_a_refrigerator_and_a_bowl_in_a_cabinet()
    task = planned("put the apple into the bowl", scene)
    assert len(task.subtasks) == 6
    assert_withdrawn_and_put(executor.rollout(oag.compose(task), scene), "apple_0")


@pytest.mark.slow
def test_out_of_a_refrigerator_in_one_subtask_that_carries_it_away_at_once() -> None:
    scene = can_in_a_refrigerator()
    task = planned("take the can out of the refrigerator and put it on the table", scene)
    opening, pick, put, closing = task.subtasks
    carrying = replace(put, init=pick.init, support_init=pick.support_init, flow=None)
    done = executor.rollout(oag.compose(replace(task, subtasks=(opening, carrying, closing))), scene)
    assert done.succeeded, done.failure


@pytest.mark.parametrize(
    ("query", "height_m"),
    [
        ("pick up the can", 0.13),
        pytest.param("put the can onto the table", 0.17, marks=pytest.mark.slow),
        pytest.param("put the can onto the table", 0.195, marks=pytest.mark.slow),
    ],
)
def test_off_a_board_under_another_one(query: str, height_m: float) -> None:
    """However little room there is above it, it ends off the board, as was proved."""
    scene = on_a_shelf(height_m)
    done = executor.rollout(oag.compose(planned(query, scene)), scene)
    assert done.succeeded, done.failure
    picked = done.subtasks[0]
    assert [step.primitive for step in picked.steps][-2:] == ["LIFT_EEF_UP", "RETREAT"]
    read = {reading.literal: reading.value for reading in picked.readings}
    assert read["(ontop can_0 shelf_0)"] is False and read["(inside can_0 gripper)"] is True


@pytest.mark.slow
def test_off_a_board_by_a_flow_that_only_lifts() -> None:
    """A plan of somebody else's, which is proved too, ends as the detectors read it."""
    scene = on_a_shelf(0.17)
    task = planned("put the can onto the table", scene)
    pick, put = task.subtasks
    assert pick.flow is not None
    lifts = replace(task, subtasks=(replace(pick, flow=pick.flow[:-1]), put))
    done = executor.rollout(oag.compose(lifts), scene)
    assert done.succeeded, done.failure
