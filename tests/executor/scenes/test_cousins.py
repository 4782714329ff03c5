"""Scenes of Digital Cousins: sizes and places stay, heights follow from what carries what, the rest is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import bddl
import executor
import oag
from executor.assets.footprint import Footprint, yaw_of
from executor.assets.library import LIBRARY, asset_for
from executor.scenes.digital_cousins import from_cousins
from executor.scenes.file import load_scene
from executor.scenes.library import holds_cousins
from executor.scenes.models import FLAT, NoMatchingModel, category_of, model_for, shaped, written_category
from executor.scenes.placement import WALKWAY_M, robot_footprint
from executor.scenes.validation import settle
from llm import propose
from tests.executor.scenes.reconstructions import CAMERA_M, kitchen, thing, write


def test_a_kitchen_is_taken_over_with_its_sizes_places_and_facts(tmp_path: Path) -> None:
    scene = load_scene(str(write(tmp_path, kitchen())))
    assert scene.name == "scene_0"
    assert list(scene.objects) == ["fridge_0", "cabinet_0", "microwave_0", "table_0", "glass_0", "apple_0"]
    assert {key: obj.category for key, obj in scene.objects.items()} == {
        "fridge_0": "refrigerator",
        "cabinet_0": "bottom_cabinet",
        "microwave_0": "microwave",
        "table_0": "breakfast_table",
        "glass_0": "water_glass",
        "apple_0": "apple",
    }
    assert scene["fridge_0"].bbox_extent == pytest.approx((0.70, 0.64, 1.42))
    assert scene["fridge_0"].position == pytest.approx((0.0, -0.9, 0.71))
    assert scene["cabinet_0"].model == "cabinet_two_doors", "as wide as one with two doors"
    assert {bddl.format(fact) for fact in scene.facts} == {
        "(ontop glass_0 table_0)",
        "(ontop apple_0 table_0)",
        "(ontop microwave_0 cabinet_0)",
        "(not (open fridge_0))",
        "(not (open cabinet_0))",
        "(not (open microwave_0))",
    }
    assert oag.Scene.from_json(scene.to_json()) == scene


def test_fronts_that_the_camera_saw_face_it(tmp_path: Path) -> None:
    objects = kitchen()
    # An asset whose front is at its own -y: that is where the camera is.
    objects["cabinet_0"] = thing("bottom_cabinet", (0.88, 0.60, 0.82), (0.0, 0.4, 0.43), (0.0, 0.0, math.pi / 2))
    # One whose front is at +x, seen from the side.
    objects["fridge_0"] = thing("fridge", (0.70, 0.64, 1.42), (0.0, -1.6, 0.73), (0.0, 0.0, 1.2))
    found = from_cousins(write(tmp_path, objects))
    assert yaw_of(found.scene["cabinet_0"]) == pytest.approx(math.pi, abs=1e-6)
    assert found.scene["cabinet_0"].bbox_extent == pytest.approx((0.60, 0.88, 0.82))
    assert "cabinet_0 has its front at -y, where the camera was" in found.notes
    assert yaw_of(found.scene["fridge_0"]) == pytest.approx(1.2 - math.pi)


def test_what_lies_on_its_side_in_its_own_frame_is_set_upright(tmp_path: Path) -> None:
    objects = kitchen()
    # Its own y is up, as in assets whose files have y up: 12 cm high, not wide.
    objects["glass_0"] = thing("water_glass", (0.07, 0.12, 0.07), (0.45, 1.85, 0.75), (math.pi / 2, 0.0, 0.4))
    objects["apple_0"] = thing("apple", (0.075, 0.075, 0.075), (0.42, 2.2, 0.73), (0.0, -math.pi / 2, 0.4))
    scene = from_cousins(write(tmp_path, objects)).scene
    assert scene["glass_0"].bbox_extent == pytest.approx((0.07, 0.07, 0.12))
    assert scene["apple_0"].bbox_extent == pytest.approx((0.075, 0.075, 0.075))


def test_things_stand_on_what_carries_them_and_overlap_nothing_in_physics(tmp_path: Path) -> None:
    objects = kitchen()
    objects["glass_0"] = thing("water_glass", (0.07, 0.07, 0.12), (0.54, 1.85, 0.76))
    objects["apple_0"] = thing("apple", (0.076, 0.076, 0.076), (0.50, 1.56, 0.73))
    objects["mug_0"] = thing("coffee_cup", (0.10, 0.08, 0.09), (0.50, 1.58, 0.72))
    found = from_cousins(write(tmp_path, objects))
    glass, top_m = found.scene["glass_0"], 0.68
    assert glass.position[2] - glass.extent_m[2] / 2 == pytest.approx(top_m)
    assert glass.position[0] + 0.035 <= 0.2 + 0.35, "it was over the edge"
    assert any(note.startswith("glass_0 was moved by") and "to be on table_0" in note for note in found.notes)
    assert any(note.startswith(("mug_0 was moved by", "apple_0 was moved by")) for note in found.notes)
    settled = settle(found.scene)
    assert settled.objects.keys() == found.scene.objects.keys()


def test_the_robot_starts_on_free_floor_near_the_camera_and_faces_the_room(tmp_path: Path) -> None:
    objects = kitchen()
    scene = from_cousins(write(tmp_path, objects)).scene
    assert scene.robot.position[:2] == pytest.approx(CAMERA_M[:2])
    objects["table_1"] = thing("coffee_table", (0.9, 0.6, 0.42), (2.5, -0.2, 0.21))
    crowded = from_cousins(write(tmp_path, objects)).scene
    body = robot_footprint(*crowded.robot.position[:2], crowded.robot.yaw_rad)
    assert min(body.gap_m(Footprint.of(obj)) for obj in crowded.objects.values()) >= WALKWAY_M
    assert np.hypot(*np.subtract(crowded.robot.position[:2], CAMERA_M[:2])) < 1.5


def test_what_flat_things_carried_stands_on_what_is_below_them(tmp_path: Path) -> None:
    objects = kitchen() | {"rug_0": thing("rug", (2.0, 2.0, 0.01), (0.2, 2.0, 0.005))}
    found = from_cousins(write(tmp_path, objects))
    assert found.scene["table_0"].position[2] == pytest.approx(0.34)
    assert "rug_0 was left out: nothing meets a rug" in found.notes


def test_what_hangs_on_a_wall_stays_at_its_height(tmp_path: Path) -> None:
    objects = kitchen() | {"cabinet_1": thing("top_cabinet", (0.56, 0.8, 0.72), (0.0, 0.4, 1.9), floor=False)}
    found = from_cousins(write(tmp_path, objects))
    assert found.scene["cabinet_1"].position == pytest.approx((0.0, 0.4, 1.9))
    assert not any("cabinet_1" in bddl.format(fact) and "ontop" in bddl.format(fact) for fact in found.scene.facts)


def test_everything_without_a_likeness_is_named_at_once(tmp_path: Path) -> None:
    objects = kitchen() | {
        "toilet_0": thing("toilet", (0.3, 0.3, 1.5), (0.5, 1.0, 0.75)),
        "fridge_1": thing("fridge", (0.05, 0.05, 0.05), (-1.0, 1.0, 0.02)),
        "chair_0": thing("chair", (0.42, 0.42, 0.85), (1.0, 1.0, 0.4), (0.9, 0.0, 0.0)),
        "glass 0": thing("water_glass", (0.07, 0.07, 0.12), (0.3, 1.7, 0.75)),
    }
    with pytest.raises(oag.SceneError) as caught:
        load_scene(str(write(tmp_path, objects)))
    lines = str(caught.value).splitlines()
    assert lines[0].endswith(
        "scene_0_info.json: 4 of 11 objects cannot be taken over; without them in its `objects` it can be read:"
    )
    assert lines[1] == "  - toilet_0: the library has nothing of the category 'toilet'"
    assert lines[2].startswith("  - object fridge_1 (refrigerator): its x extent is 0.050 m; the family needs")
    assert lines[3] == "  - chair_0: leans by 38 degrees"
    assert lines[4] == "  - glass 0: another object is called glass_0 too"
    assert len(lines) == 5


def test_what_cannot_be_placed_is_named(tmp_path: Path) -> None:
    objects = kitchen()
    objects["fridge_1"] = thing("fridge", (0.70, 0.64, 1.42), (0.0, -0.9, 0.73))
    with pytest.raises(oag.SceneError, match=r"fridge_\d: overlaps fridge_\d, with no free place within 0.3 m"):
        from_cousins(write(tmp_path, objects))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"objects": {}}, "objects: has no object"),
        ({"cam_pose": [[0, 0, 1]]}, r"cam_pose: expected a position x y z and a quaternion x y z w"),
        ({"cam_pose": [[0, 0, 1], [0, 0, 0, 2]]}, r"cam_pose\[1\]: expected a unit quaternion x y z w"),
        ({"objects": {"a_0": {"category": "apple", "bbox_extent": [1, 1, 1]}}}, "field 'tf_from_cam' is missing"),
        (
            {"objects": {"a_0": {"category": "apple", "bbox_extent": [1, 1, 1], "tf_from_cam": [[1, 0, 0, 0]] * 4}}},
            "objects.a_0.tf_from_cam: expected a rigid 4 x 4 pose",
        ),
        (
            {"objects": {"a_0": {"category": "apple", "bbox_extent": [1, 1, 1], "tf_from_cam": [[1, 0, 0, 0]]}}},
            "objects.a_0.tf_from_cam: expected a rigid 4 x 4 pose",
        ),
    ],
)
def test_a_malformed_file_is_refused_with_its_place(tmp_path: Path, change: dict[str, object], message: str) -> None:
    path = write(tmp_path, kitchen())
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(oag.SceneError, match=message):
        from_cousins(path)


def test_a_file_with_all_scenes_of_a_photograph_names_them(tmp_path: Path) -> None:
    info = json.loads(write(tmp_path, kitchen()).read_text())
    path = tmp_path / "step_3_output_info.json"
    path.write_text(json.dumps({"scene_0": info, "scene_1": info}))
    with pytest.raises(oag.SceneError, match="holds the scenes scene_0, scene_1"):
        load_scene(path)


def test_only_its_own_form_is_taken_for_a_reconstruction(tmp_path: Path) -> None:
    assert holds_cousins(write(tmp_path, kitchen()))
    for text in ("{}", "[]", "not JSON", json.dumps(load_scene("kitchen_t1").to_json())):
        (tmp_path / "other.json").write_text(text)
        assert not holds_cousins(tmp_path / "other.json")
    assert not holds_cousins(tmp_path / "absent.json")


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        ("fridge", "refrigerator"),
        ("electric_refrigerator.n.01", "refrigerator"),
        ("bottom_cabinet_no_top", "bottom_cabinet"),
        ("top_cabinet", "bottom_cabinet"),
        ("breakfast_table", "table"),
        ("straight_chair", "chair"),
        ("bottle_of_water", "bottle"),
        ("can_of_soda", "can"),
        ("half_apple", "half_apple"),
        ("pill_bottle", "medicine_bottle"),
        ("teddy_bear", "teddy_bear"),
    ],
)
def test_categories_of_behavior_find_the_library_s(theirs: str, ours: str) -> None:
    assert category_of(theirs) == ours


@pytest.mark.parametrize("theirs", ["ceiling_fan", "bathtub", "toilet", "of", ""])
def test_a_category_without_likeness_is_refused(theirs: str) -> None:
    with pytest.raises(NoMatchingModel, match="the library has nothing of the category"):
        category_of(theirs)


@pytest.mark.parametrize("model", LIBRARY)
def test_a_size_of_a_model_s_own_finds_a_model_that_it_builds(model: str) -> None:
    sampled = LIBRARY[model].sample(12)
    chosen = model_for(sampled.category, sampled.bbox_extent)
    size = shaped(chosen, sampled.bbox_extent)
    assert chosen.category == sampled.category
    assert size == pytest.approx(sampled.bbox_extent, rel=0.5)
    assert category_of(written_category(sampled.category, chosen)) == sampled.category
    obj = LIBRARY[chosen.model].sample(12)
    assert asset_for(obj).extent_m == pytest.approx(obj.extent_m)
    assert sampled.category not in FLAT


@pytest.mark.slow
def test_the_glass_of_a_reconstructed_kitchen_comes_into_its_refrigerator(tmp_path: Path) -> None:
    scene = load_scene(write(tmp_path, kitchen()))
    task = propose("put the glass into the fridge", scene).task
    done = executor.rollout(oag.compose(task, scene=scene), scene, seed=0)
    assert done.succeeded, done.failure
