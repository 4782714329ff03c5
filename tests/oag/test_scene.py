"""Scenes: reading, writing, scaling, and one clear message for each malformed file."""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path
from typing import Any

import pytest

import bddl
import oag
from oag.model.symbols import Kind, Primitive, applicable, carries_things, is_known, kind_of
from oag.wellformed import kind_problem
from tests.json_edits import altered
from tests.oag.paper import DATA, NAMES, scene


def minimal(**changes: Any) -> dict[str, Any]:
    """A small scene's JSON."""
    objects = {
        "glass_0": {"category": "water_glass", "position": [1.0, 0.2, 0.75], "bbox_extent": [0.07, 0.07, 0.12]},
        "table_0": {"category": "table", "position": [1.0, 0.2, 0.3], "bbox_extent": [0.6, 0.9, 0.6]},
    }
    return {"name": "k", "objects": objects, "facts": ["(ontop glass_0 table_0)"], "closed": ["ontop"], **changes}


@pytest.mark.parametrize("name", NAMES)
def test_json_round_trip(name: str) -> None:
    first = scene(name)
    assert oag.Scene.from_json(first.to_json()) == first
    assert oag.Scene.from_json(json.loads(json.dumps(first.to_json()))) == first


def test_defaults() -> None:
    glass = oag.Scene.from_json(minimal())["glass_0"]
    assert (glass.model, glass.orientation, glass.scale) == ("water_glass", (1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    assert glass.role == "B"
    assert oag.Scene.from_json(minimal())["table_0"].role == "A"


@pytest.mark.parametrize("key", ["glass.n.01_1", "0", "_x", "Top-Cabinet_3", "floors"])
def test_ids_may_have_letters_digits_and_three_signs(key: str) -> None:
    thing = minimal()["objects"]["glass_0"]
    assert oag.Scene.from_json({"objects": {key: thing}})[key].id == key


def test_scenes_travel_between_processes() -> None:
    first = scene("T1")
    assert pickle.loads(pickle.dumps(first)) == first


def test_scaling_keeps_the_bottom_in_place() -> None:
    before = scene("T1")
    after = before.with_scales({"glass_0": 0.5})
    old, new = before["glass_0"], after["glass_0"]
    assert new.extent_m == pytest.approx((0.035, 0.035, 0.06))
    assert new.bbox_extent == old.bbox_extent
    assert new.position[2] - new.height_m / 2 == pytest.approx(old.position[2] - old.height_m / 2)
    assert new.position[:2] == old.position[:2]
    assert before["glass_0"] == old and after["table_0"] == before["table_0"]


def test_scaling_of_a_lying_object_uses_its_height_in_the_world() -> None:
    data = minimal()
    quarter = math.sqrt(0.5)
    data["objects"]["glass_0"]["orientation"] = [quarter, quarter, 0.0, 0.0]
    glass = oag.Scene.from_json(data)["glass_0"]
    assert glass.height_m == pytest.approx(0.07)
    assert glass.scaled(0.5).position[2] == pytest.approx(0.75 - 0.0175)


def test_scales_name_an_object_and_are_positive() -> None:
    with pytest.raises(oag.SceneError, match=r"no object 'glas_0' \(did you mean glass_0\?\)"):
        scene("T1").with_scales({"glas_0": 0.5})
    with pytest.raises(oag.SceneError, match="glass_0: expected a scale greater than 0, got -1"):
        scene("T1").with_scales({"glass_0": -1.0})


def broken(*keys: str, value: Any) -> dict[str, Any]:
    """The small scene with one value replaced; `...` removes it."""
    data = minimal()
    at = data
    for key in keys[:-1]:
        at = at[key]
    if value is ...:
        del at[keys[-1]]
    else:
        at[keys[-1]] = value
    return data


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (broken("objects", value=...), "the field 'objects' is missing"),
        (broken("objects", value=[]), "objects: expected an object, got []"),
        (broken("objects", "glass_0", value=7), "objects.glass_0: expected an object, got 7"),
        (broken("objects", "glass_0", "category", value=...), "objects.glass_0: the field 'category' is missing"),
        (
            broken("objects", "glass_0", "bbox_extent", value=[0.07, 0.07]),
            "objects.glass_0.bbox_extent: expected 3 numbers (x y z in metres, all > 0), got [0.07, 0.07]",
        ),
        (
            broken("objects", "glass_0", "bbox_extent", value=[0.07, 0, 1]),
            "objects.glass_0.bbox_extent[1]: expected a number greater than 0, got 0",
        ),
        (
            broken("objects", "glass_0", "position", value=[1, "2", 3]),
            'objects.glass_0.position[1]: expected a number, got "2"',
        ),
        (
            broken("objects", "glass_0", "position", value=[1, math.nan, 3]),
            "objects.glass_0.position[1]: expected a number, got NaN",
        ),
        (
            broken("objects", "glass_0", "orientation", value=[0, 0, 0, 0]),
            "objects.glass_0.orientation: expected a quaternion w x y z that is not zero",
        ),
        (broken("objects", "gripper", value={}), "objects.gripper: the id 'gripper' is reserved"),
        (broken("objects", "robot", value={}), "objects.robot: the id 'robot' is reserved"),
        (broken("objects", "ground", value={}), "objects.ground: the id 'ground' is reserved"),
        (broken("objects", "floor", value={}), "the id 'floor' is reserved: gripper, robot, ground and floor are in"),
        (
            broken("objects", "a b", value={}),
            "objects.a b: the id 'a b' cannot be used; expected letters a to z, digits",
        ),
        (broken("objects", "", value={}), "the id '' cannot be used"),
        (broken("objects", "*", value={}), "the id '*' cannot be used"),
        (broken("objects", "../x", value={}), "the id '../x' cannot be used"),
        (broken("objects", "-x", value={}), "not starting with '.' or '-', such as glass_0"),
        (broken("objects", "x\n", value={}), "the id 'x\\n' cannot be used"),
        (broken("objects", "größe", value={}), "the id 'größe' cannot be used"),
        (broken("facts", value="(open x)"), 'facts: expected a list, got "(open x)"'),
        (
            broken("facts", value=["(ontop glas_0 table_0)"]),
            "facts[0]: unknown object 'glas_0' (did you mean glass_0?)",
        ),
        (broken("facts", value=["(ontop glass_0)"]), "facts[0]: `ontop` takes 2 names"),
        (broken("facts", value=["(on glass_0 table_0)"]), "facts[0]: The profile `scene` has no predicate `on`"),
        (broken("facts", value=["(or (open table_0) (open glass_0))"]), "facts[0]: a fact must be a literal"),
        (
            broken("facts", value=["(open table_0)", "(not (open table_0))"]),
            "facts[1]: contradicts an earlier fact about (open table_0)",
        ),
        (broken("closed", value=["on"]), "closed[0]: unknown predicate 'on' (did you mean ontop?)"),
        (broken("robot", value={"yaw": "north"}), 'robot.yaw: expected a number, got "north"'),
    ],
)
def test_one_clear_message_for_each_malformed_scene(data: dict[str, Any], message: str) -> None:
    with pytest.raises(oag.SceneError) as caught:
        oag.Scene.from_json(data)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"objects": {},}', "is not valid JSON: "),
        ('{"objects": {}\n "name": 1}', "at line 2, column 2"),
        ('{"objects": {"a": 1, "a": 2}}', "the key 'a' appears twice in one object"),
        ('{"objects": NaN}', "NaN is no JSON number"),
        ("[]", "expected an object, got []"),
        ("", "is not valid JSON"),
    ],
)
def test_malformed_files_say_where(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "kitchen.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(oag.SceneError) as caught:
        oag.Scene.from_json(path)
    assert "kitchen.json" in str(caught.value)
    assert message in str(caught.value)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(oag.SceneError, match="cannot be read: No such file"):
        oag.Scene.from_json(tmp_path / "none.json")
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(oag.SceneError, match="is not UTF-8 text"):
        oag.Scene.from_json(tmp_path / "binary.json")


def test_a_byte_order_mark_is_no_mistake(tmp_path: Path) -> None:
    path = tmp_path / "kitchen.json"
    path.write_bytes(b"\xef\xbb\xbf" + (DATA / "T1_scene.json").read_bytes())
    assert oag.Scene.from_json(path) == scene("T1")


@pytest.mark.parametrize(
    ("category", "side_m", "kind"),
    [
        ("fridge", 0.7, Kind.ARTICULATED),
        ("bottom_cabinet_no_top", 0.7, Kind.ARTICULATED),
        ("fridge.n.01", 0.7, Kind.ARTICULATED),
        ("breakfast_table", 0.9, Kind.SUPPORT),
        ("water_glass", 0.07, Kind.ITEM),
        ("half_apple", 0.07, Kind.ITEM),
        ("knives", 0.02, Kind.ITEM),
        ("gizmo", 0.1, Kind.ITEM),
        ("gizmo", 0.5, Kind.ARTICULATED),
    ],
)
def test_kinds_of_categories(category: str, side_m: float, kind: Kind) -> None:
    assert kind_of(category, side_m) is kind


@pytest.mark.parametrize("orientation", [[0, 1e6, 0, 1], [0.3, 0.3, 0.3, 0.8], [1, 2, 3, 4], [0.7, 0, 0, 0.7]])
def test_a_turn_that_was_read_is_read_again_as_it_was(orientation: list[float]) -> None:
    data = scene("T1").to_json()
    first = oag.Scene.from_json(altered(data, ("objects", "glass_0", "orientation"), orientation))
    assert oag.Scene.from_json(first.to_json()) == first


@pytest.mark.parametrize(
    "category", ["black_dust_bin", "dust_bin", "tall_coffee_tables", "fridge.n.01", "gadget", "red_gadget"]
)
def test_a_category_is_known_where_no_size_changes_its_kind(category: str) -> None:
    assert is_known(category) is (kind_of(category, 0.01) is kind_of(category, 1.0))


def test_what_is_fixed_is_neither_taken_nor_a_place() -> None:
    objects = {
        key: {"category": category, "position": [x, 0.0, 0.5], "bbox_extent": [0.1, 0.1, 0.1]}
        for key, category, x in (("mug_0", "mug", 1.0), ("clock_0", "clock", 2.0))
    }
    scene = oag.Scene.from_json({"objects": objects})
    assert scene["clock_0"].kind is Kind.ITEM and "fixed" not in str(scene.to_json())
    hung = oag.Scene.from_json({"objects": {**objects, "clock_0": {**objects["clock_0"], "fixed": True}}})
    assert hung["clock_0"].kind is Kind.FIXED and hung["clock_0"].role == "A"
    assert oag.Scene.from_json(hung.to_json()) == hung
    assert not applicable(Primitive.GRASP, Kind.FIXED) and not carries_things("table", Kind.FIXED)
    for predicate in ("ontop", "inside"):
        problem = kind_problem(bddl.Atom(predicate, ("mug_0", "clock_0")), hung)
        assert problem is not None and "it is fixed to the room" in problem.message
        assert kind_problem(bddl.Atom(predicate, ("mug_0", "clock_0")), scene) is None
