"""Settling: what physics bears out comes back, and what it does not is refused with the thing and the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bddl
from executor.scenes.file import complete_scene
from executor.scenes.placement import PlaceSpec, place, stand_robot
from executor.scenes.room import Room, against, row, stand
from executor.scenes.validation import Unsettled, settle
from oag import Scene
from oag.model.scene import RobotPose


def a_kitchen() -> Scene:
    room = Room("a_kitchen", "kitchen", np.random.default_rng(12000), depth_m=3.4, width_m=3.8)
    pieces = [room.draw("counter_plain"), room.draw("fridge_one_door", parameters={"hinge": "left", "shelves": 2})]
    row(room, "east", pieces)
    stand(room, room.draw("table_four_legs"), -1.0, -1.0)
    place(room, room.draw("tumbler"), PlaceSpec("table_0"))
    place(room, room.draw("porcelain_bowl"), PlaceSpec("table_0"))
    place(room, room.draw("can"), PlaceSpec("refrigerator_0", region="door_shelf_1"))
    stand_robot(room)
    return room.scene()


def moved(scene: Scene, object_id: str, by_m: tuple[float, float, float]) -> Scene:
    obj = scene.objects[object_id]
    x, y, z = (value + offset for value, offset in zip(obj.position, by_m, strict=True))
    return replace(scene, objects={**scene.objects, object_id: replace(obj, position=(x, y, z))})


def test_a_room_that_holds_comes_back_as_it_is() -> None:
    scene = a_kitchen()
    settled = settle(scene)
    assert settled.facts == scene.facts
    for name, obj in scene.objects.items():
        assert settled.objects[name].position == pytest.approx(obj.position, abs=1e-3)
    assert settle(scene) == settled


def test_a_thing_in_the_air_is_refused() -> None:
    with pytest.raises(Unsettled, match=r"glass_0 moved \d+ mm") as caught:
        settle(moved(a_kitchen(), "glass_0", (0.0, 0.0, 0.10)))
    assert (caught.value.kind, caught.value.object_id) == ("moved", "glass_0")


def test_a_thing_inside_another_is_refused() -> None:
    scene = a_kitchen()
    glass, bowl = scene.objects["glass_0"], scene.objects["bowl_0"]
    x, y, z = (b - a for a, b in zip(glass.position, bowl.position, strict=True))
    with pytest.raises(Unsettled, match="overlaps") as caught:
        settle(moved(scene, "glass_0", (x, y, z)))
    assert caught.value.kind == "overlap"


def test_furniture_inside_furniture_is_refused_though_neither_can_move() -> None:
    scene = a_kitchen()
    with pytest.raises(Unsettled, match="countertop_0 overlaps refrigerator_0") as caught:
        settle(moved(scene, "countertop_0", (0.0, -0.02, 0.0)))
    assert caught.value.kind == "overlap"


def test_a_door_that_cannot_swing_is_refused() -> None:
    room = Room("a_corner", "kitchen", np.random.default_rng(1), depth_m=3.4, width_m=3.8)
    against(room, "east", room.draw("fridge_one_door", parameters={"hinge": "left"}), 0.0)
    fridge = room.objects["refrigerator_0"]
    stand(room, room.draw("counter_plain"), fridge.position[0] - 0.9, 0.0)
    room.robot = RobotPose((-1.2, 1.0, 0.0))
    with pytest.raises(Unsettled, match=r"refrigerator_0 meets countertop_0 when its door is open by \d+ degrees") as e:
        settle(room.scene())
    assert e.value.kind == "door-blocked"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("(ontop glass_0 table_0)", "(ontop glass_0 countertop_0)"),
        ("(inside can_0 refrigerator_0)", "(inside can_0 countertop_0)"),
        ("(not (open refrigerator_0))", "(open refrigerator_0)"),
    ],
)
def test_facts_that_the_detectors_do_not_read_are_refused(old: str, new: str) -> None:
    scene = a_kitchen()
    facts = tuple(bddl.parse_formula(new) if bddl.format(fact) == old else fact for fact in scene.facts)
    assert facts != scene.facts
    with pytest.raises(Unsettled, match="by the detectors") as caught:
        settle(replace(scene, facts=facts))
    assert caught.value.kind == "fact"


def test_a_fact_that_is_left_out_of_a_closed_predicate_is_refused() -> None:
    scene = a_kitchen()
    facts = tuple(fact for fact in scene.facts if bddl.format(fact) != "(ontop glass_0 table_0)")
    with pytest.raises(Unsettled, match="glass_0 is ontop table_0 by the detectors"):
        settle(replace(scene, facts=facts))


def test_a_saucer_is_in_no_cup_that_stands_on_it() -> None:
    objects = {
        "table_0": {"category": "table", "model": "table_four_legs", "position": [1.5, 0.0]},
        "plate_0": {"category": "plate", "on": "table_0", "at": [0.0, 0.0]},
        "cup_0": {"category": "cup", "on": "plate_0", "at": [0.0, 0.0]},
    }
    scene = complete_scene({"name": "coffee", "objects": objects}).scene
    assert scene is not None
    facts = {bddl.format(fact) for fact in scene.facts}
    assert {"(ontop plate_0 table_0)", "(ontop cup_0 plate_0)"} <= facts
    assert not any(fact.startswith("(inside") for fact in facts)
    assert settle(scene).facts == scene.facts
