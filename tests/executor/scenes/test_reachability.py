"""The rule of reach: yes where the arm has postures on free floor, no with the joint or the obstacle where not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import llm
from executor.geometry import hand_rotation, transform
from executor.planning.stances import HandGoal
from executor.records import MissingFlow
from executor.scenes.generators.long_horizon import draw
from executor.scenes.placement import PlaceSpec, place
from executor.scenes.reachability import MARGIN_RAD, Floor, Reach, ReachSearch, reach
from executor.scenes.room import Room, against, stand
from executor.sim.robot.kinematics import Kinematics
from executor.sim.world import World
from oag import Scene
from oag.model.scene import RobotPose


def a_room() -> Room:
    return Room("a_room", "kitchen", np.random.default_rng(12000), depth_m=3.6, width_m=3.8)


def asked(scene: Scene, query: str) -> Reach:
    task = llm.propose(query, scene).task
    fitted = scene.with_scales(task.scales)
    return reach(fitted, task)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["T1", "T3"])
def test_drawn_scenes_pass_and_every_part_has_its_numbers(family: str) -> None:
    pair = draw(family, 12000)
    found = reach(pair.scene, pair.task)
    assert found.reachable and not found.reason
    assert found.margin_rad is not None and found.margin_rad >= MARGIN_RAD
    whats = [part.what for part in found.parts]
    assert len(whats) == {"T1": 4, "T3": 2}[family]
    assert all(part.best is not None and 0.3 <= part.best.reach_m <= 0.6 for part in found.parts)
    assert family != "T3" or reach(pair.scene, pair.task) == found


@pytest.mark.slow
def test_a_thing_too_high_is_refused_for_the_arm() -> None:
    room = a_room()
    stand(room, room.draw("table_four_legs"), -0.8, 0.0)
    shelf = room.draw("shelf_open", extent_m={"z": 1.5})
    against(room, "north", shelf, 0.0)
    place(room, room.draw("can"), PlaceSpec(shelf.id, region="top"))
    found = asked(room.scene(), "put the can on the table")
    assert not found.reachable
    assert found.reason.startswith("pick_up_can: can_0 ")
    assert "out of the arm's reach" in found.reason or "limit" in found.reason
    assert "1.5" in found.reason


def test_a_thing_behind_furniture_is_refused_for_what_stands_in_the_way() -> None:
    room = a_room()
    counters = {"x": 1.2, "y": 1.2, "z": 0.75}
    stand(room, room.draw("counter_plain", extent_m=counters), 0.0, 0.0)
    place(room, room.draw("can"), PlaceSpec("countertop_0", at=(0.0, 0.0)))
    against(room, "west", room.draw("nightstand"), 0.0)
    found = asked(room.scene(), "pick up the can")
    assert not found.reachable
    assert "countertop_0 stands" in found.reason
    (part,) = found.parts
    assert part.best is not None and part.best.blocker == "countertop_0"


def test_nothing_passes_because_nothing_is_asked() -> None:
    room = a_room()
    against(room, "north", room.draw("cabinet_one_door"), 0.0)
    scene = room.scene()
    task = llm.propose("open the cabinet", scene).task
    assert reach(scene, task).parts
    unplanned = replace(task, subtasks=tuple(replace(subtask, flow=None) for subtask in task.subtasks))
    with pytest.raises(MissingFlow, match="no action flow for open_cabinet"):
        reach(scene, unplanned)


def test_a_door_without_a_handle_is_out_of_reach() -> None:
    room = a_room()
    against(room, "north", room.draw("cabinet_one_door"), 0.0)
    closed = replace(room.objects["cabinet_0"], model="plain", parameters={})
    scene = replace(room.scene(), objects={"cabinet_0": closed})
    found = asked(scene, "open the cabinet")
    assert not found.reachable and found.reason.endswith("a handle of cabinet_0 does not exist")


def test_a_pose_that_only_exists_beyond_a_joint_limit_names_the_joint() -> None:
    """For a level hand just above the floor the shoulder would have to bend too far."""
    level = HandGoal(transform(hand_rotation(0.0, 0.0), [1.0, 0.0, 0.05]), 0.0)
    steep = HandGoal(transform(hand_rotation(0.0, np.deg2rad(45.0)), [1.0, 0.0, 0.5]), 0.0)
    with World(Scene("empty", RobotPose(), {})) as world:
        search = ReachSearch(Kinematics(world.robot), Floor(Scene("empty", RobotPose(), {})))
        miss, found = search.best([level]), search.best([level, steep])
    assert not miss.reachable and miss.blocker is None
    assert miss.margin_rad is not None and miss.margin_rad < MARGIN_RAD
    assert miss.joint == "panda_joint2"
    assert found.reachable and found.pitch_rad == pytest.approx(np.deg2rad(45.0))


def test_the_base_stands_under_a_table_but_not_in_a_cabinet() -> None:
    room = a_room()
    stand(room, room.draw("table_four_legs", extent_m={"x": 1.2, "y": 0.8}), 0.0, 0.0)
    against(room, "east", room.draw("cabinet_drawers"), 0.0)
    floor = Floor(room.scene())
    assert floor.blocker(np.array([0.0, 0.0, 0.0])) is None
    assert floor.blocker(np.array([0.55, 0.35, 0.0])) == "table_0"
    assert floor.blocker(np.array([room.objects["cabinet_0"].position[0], 0.0, 0.0])) == "cabinet_0"
