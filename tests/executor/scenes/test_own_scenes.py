"""Twenty scene files as somebody writes them who has read docs/scenes.md: each is good, or one change makes it so."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import bddl
import llm
from executor.cli import app
from executor.scenes import library
from executor.scenes.file import complete_scene, load_scene, scene_for
from executor.scenes.generators import families
from executor.scenes.validation import issues
from executor.sim.render import stage
from executor.system.vulkan import Renderer, RendererNotFound
from oag import Scene, SceneError, Task, Verdict, compose
from oag.model.forms import json_schema
from tests.source_tree import ROOT

FILES = {path.stem: path for path in sorted((ROOT / "tests" / "data" / "scenes").glob("*.json"))}
GOOD = [name for name in FILES if name < "11"]
Change = Callable[[dict[str, Any]], object]
# What each of the others is refused with, and the change that it asks for.
REFUSED: dict[str, tuple[str, Change]] = {
    "11_unknown_key": ("objects.glass_0: has a key 'colour' that nothing reads", lambda o: o["glass_0"].pop("colour")),
    "12_unknown_category": (
        "objects.table_0: the library has nothing of the category 'tabel'; near it: table",
        lambda o: o["table_0"].update(category="table"),
    ),
    "13_height_of_the_bottom": (
        "table_0 is 32.5 cm deep in the floor; on the floor its middle is at z = 0.325; or give x y only",
        lambda o: o["table_0"].update(position=[1.0, 0.0]),
    ),
    "14_glass_in_the_table": (
        'drawers_0 and glass_0 overlap by 9.0 cm; with "on": "drawers_0" glass_0 stands on top of it',
        lambda o: o["glass_0"].update(on="drawers_0"),
    ),
    "15_in_the_air": (
        "can_0 is in mid-air: 69.6 cm above table_0; with its middle at z = 0.704 it stands there",
        lambda o: o["can_0"].update(position=[0.8, 0.0, 0.704]),
    ),
    "16_no_place": (
        'objects.mug_0: has no place (add "position": [x, y], or "on": the id of what it stands on)',
        lambda o: o["mug_0"].update(on="table_0"),
    ),
    "17_two_truths": (
        "the facts say (inside glass_0 microwave_0); by its position: (ontop glass_0 table_0)",
        lambda o: o["glass_0"].update({"in": o["glass_0"].pop("on").replace("table", "microwave")}),
    ),
    "18_centimetres": (
        "objects.glass_0: is 7 x 7 x 12 m; its like are 0.06 x 0.06 x 0.09 to 0.08 x 0.08 x 0.14 m",
        lambda o: o["glass_0"].update(bbox_extent=[0.07, 0.07, 0.12]),
    ),
    "19_on_a_misspelt_table": (
        "objects.glass_0: there is no object 'tabel_0' to put it on or in (did you mean table_0?)",
        lambda o: o["glass_0"].update(on="table_0"),
    ),
    "20_microwave_on_a_nightstand": (
        "objects.microwave_0: is too large for nightstand_0 (top): 46 x 51 cm on 38 x 48 cm",
        lambda o: o["nightstand_0"].update(bbox_extent=[0.6, 0.6, 0.56]),
    ),
}


def facts(name: str) -> set[str]:
    """The facts of a good file's scene."""
    return {bddl.format(fact) for fact in load_scene(FILES[name]).facts}


def checked(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    """What `--check` says of a file, and its exit code."""
    code = app.run(["scenes", str(path), "--check", "--json"])
    said = json.loads(capsys.readouterr().out)
    assert isinstance(said, dict)
    return code, said


def test_there_are_twenty() -> None:
    assert len(FILES) == 20 and [*GOOD, *REFUSED] == list(FILES)


@pytest.mark.parametrize("name", GOOD)
def test_a_good_file_is_taken_at_the_first_try(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, said = checked(FILES[name], capsys)
    assert (code, said["errors"], said["warnings"]) == (0, [], [])
    jsonschema.validate(json.loads(FILES[name].read_text()), json_schema())


@pytest.mark.parametrize("name", REFUSED)
def test_a_mistake_is_told_with_the_change_that_mends_it(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said, change = REFUSED[name]
    code, found = checked(FILES[name], capsys)
    assert code == 2 and len(found["errors"]) == 1 and said in found["errors"][0]
    data = json.loads(FILES[name].read_text())
    change(data["objects"])
    (tmp_path / "mended.json").write_text(json.dumps(data))
    code, found = checked(tmp_path / "mended.json", capsys)
    assert (code, found["errors"], found["warnings"]) == (0, [], [])


def test_facts_follow_from_geometry() -> None:
    assert facts("01_kitchen") == {
        "(ontop microwave_0 counter_0)",
        "(ontop glass_0 table_0)",
        "(ontop mug_0 table_0)",
        "(inside apple_0 microwave_0)",
        "(ontop can_0 drawers_0)",
        "(not (open microwave_0))",
        "(not (open drawers_0))",
    }
    assert {"(open fridge_0)", "(inside carton_0 fridge_0)", "(inside orange_0 fridge_0)"} <= facts("05_open_fridge")
    in_bowl = facts("06_apple_in_bowl")
    assert {"(inside apple_0 bowl_0)", "(ontop orange_0 plate_0)", "(ontop bowl_0 cabinet_0)"} <= in_bowl
    assert not [fact for fact in in_bowl if fact.startswith("(ontop apple_0")]
    assert {"(ontop die_0 floor)", "(ontop can_0 floor)", "(ontop book_0 shelf_0)"} == facts("07_floor")
    assert load_scene(FILES["01_kitchen"]).closed == {"ontop", "inside", "open"}


def completed(form: dict[str, Any]) -> Scene:
    found = complete_scene(form)
    assert found.scene is not None, found.problems
    return found.scene


def test_neighbours_that_a_file_closes_are_read_by_detectors() -> None:
    lot: dict[str, Any] = {
        "objects": {
            "table_0": {"category": "table", "position": [1.3, 0.0]},
            "bowl_0": {"category": "bowl", "on": "table_0"},
            "apple_0": {"category": "apple", "in": "bowl_0"},
            "dresser_0": {"category": "dresser", "position": [1.3, 2.0]},
        },
        "facts": ["(not (touching table_0 bowl_0))"],
        "closed": ["nextto", "touching", "under"],
    }
    scene = completed(lot)
    facts = set(map(str, scene.facts))
    assert {"(touching bowl_0 table_0)", "(touching apple_0 bowl_0)", "(under bowl_0 apple_0)"} <= facts
    assert "(touching table_0 bowl_0)" not in facts, "what the file says is kept"
    state = compose(Task.from_json({"sub_tasks": []}, scene=scene)).verify().state_after(0)
    assert state is not None and state.holds("(nextto table_0 dresser_0)") is False
    assert completed(lot | {"closed": ["ontop"]}).facts == tuple(map(bddl.parse_formula, lot["facts"]))


def test_fixed_things_touch_where_they_stand_side_by_side() -> None:
    objects = {
        "dresser_0": {"category": "dresser", "position": [1.5, 0.0], "bbox_extent": [0.5, 0.8, 0.8]},
        "dresser_1": {"category": "dresser", "position": [1.5, 0.8], "bbox_extent": [0.5, 0.8, 0.8]},
        "dresser_2": {"category": "dresser", "position": [1.5, -0.85], "bbox_extent": [0.5, 0.8, 0.8]},
    }
    facts = set(map(str, completed({"objects": objects, "closed": ["touching"]}).facts))
    assert facts == {"(touching dresser_0 dresser_1)", "(touching dresser_1 dresser_0)"}


def test_a_file_that_lists_closed_says_everything_itself() -> None:
    assert load_scene(FILES["09_old_form"]) == Scene.from_json(FILES["09_old_form"])


@pytest.mark.parametrize("name", GOOD)
def test_what_is_written_is_read_as_it_was(name: str, tmp_path: Path) -> None:
    assert app.run(["scenes", str(FILES[name]), "--out", str(tmp_path / "whole.json")]) == 0
    assert load_scene(tmp_path / "whole.json") == Scene.from_json(tmp_path / "whole.json") == load_scene(FILES[name])


def test_all_that_is_wrong_is_said_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = json.loads(FILES["01_kitchen"].read_text())
    objects = data["objects"]
    objects["glass_0"]["color"] = "red"
    objects["mug_0"] = {"category": "mugg", "on": "table_0"}
    objects["plate_0"] = {"category": "plate", "on": "tabel_0"}
    objects["orange_0"] = {"category": "orange", "position": [1.2, 1.3, 2.0]}
    data["lights"] = []
    data["facts"] = ["(ontop can_0 shelf_0)"]
    (tmp_path / "bad.json").write_text(json.dumps(data))
    code, said = checked(tmp_path / "bad.json", capsys)
    assert code == 2
    for part in ("unknown object 'shelf_0'", "'color'", "'lights'", "'mugg'", "'tabel_0'", "orange_0 is in mid-air"):
        assert sum(part in error for error in said["errors"]) == 1, (part, said["errors"])
    assert len(said["errors"]) == 6
    with pytest.raises(SceneError, match="5 things are wrong"):
        load_scene(tmp_path / "bad.json")


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"on": "table_0", "in": "microwave_0"}, "has both 'on' and 'in'"),
        ({"on": "floor"}, "has no place on the floor"),
        ({"position": [0, 0], "at": [0, 0], "on": "table_0"}, "'at' is a point of what 'on' or 'in' names"),
        ({"on": "table_0", "heading_deg": 3, "orientation": [1, 0, 0, 0]}, "has both 'orientation' and 'heading_deg'"),
        ({"on": "table_0", "at": [3.0, 0.0]}, "too near to the edge of table_0 (top), or over it"),
        ({"in": "table_0"}, "nothing can be put in table_0 (table)"),
        ({"on": "x_0"}, "x_0 stands on or in it in turn"),
        ({"position": [0.5]}, "expected 3 numbers (x y z in metres), got [0.5]"),
        ({"on": "table_0", "model": "tumbleer"}, "no model 'tumbleer'; did you mean tumbler?"),
    ],
)
def test_places_that_cannot_be(entry: dict[str, Any], said: str, tmp_path: Path) -> None:
    data = json.loads(FILES["01_kitchen"].read_text())
    data["objects"]["x_0"] = {"category": "water_glass", **entry}
    (tmp_path / "x.json").write_text(json.dumps(data))
    with pytest.raises(SceneError) as caught:
        load_scene(tmp_path / "x.json")
    assert said in str(caught.value)


TABLE = {"table_0": {"category": "table", "position": [1.0, 0.0]}}


@pytest.mark.parametrize(
    ("data", "robot"),
    [
        ({"objects": TABLE}, "panda-lift"),
        ({"objects": TABLE, "robot": {"position": [-0.6, 0.0]}}, "panda-lift"),
        ({"objects": TABLE, "robot": {"name": "paper"}}, "paper"),
        ({"objects": TABLE, "robot": {"scale": 1}}, "panda"),
        ({"objects": TABLE, "robot": {"position": [-0.6, 0.0]}, "closed": []}, "paper"),
    ],
)
def test_a_file_that_names_no_robot_is_for_the_one_on_a_lift(data: dict[str, Any], robot: str) -> None:
    """But for a file that states all: it may be one that was written before robots had names."""
    scene = complete_scene(data).scene
    assert scene is not None and scene.robot.name == robot
    again = complete_scene(scene.to_json()).scene
    assert again is not None and again.robot == scene.robot
    assert {library.load(name).robot.name for name in library.names()} == {"paper"}


@pytest.mark.slow
def test_a_table_is_full_at_some_time(tmp_path: Path) -> None:
    cups = {f"cup_{n}": {"category": "cup", "on": "table_0"} for n in range(80)}
    data = {"objects": {"table_0": {"category": "table", "position": [1.0, 0.0]}, **cups}}
    (tmp_path / "x.json").write_text(json.dumps(data))
    with pytest.raises(SceneError, match=r"cup_79: found no free place on table_0 \(top\)") as caught:
        load_scene(tmp_path / "x.json")
    assert "cup_9:" not in str(caught.value)


def test_a_robot_has_a_place_of_its_own(tmp_path: Path) -> None:
    scene = load_scene(FILES["10_furniture_at_the_origin"])
    assert scene.robot.position[:2] != (0.0, 0.0) and not issues(scene)
    data = json.loads(FILES["10_furniture_at_the_origin"].read_text()) | {"robot": {"position": [0.0, 0.0]}}
    (tmp_path / "x.json").write_text(json.dumps(data))
    assert [issue.object_id for issue in issues(load_scene(tmp_path / "x.json")) if issue.error] == ["robot"]
    (tmp_path / "x.json").write_text(json.dumps(data | {"robot": {"scale": 1}}))
    assert load_scene(tmp_path / "x.json").robot == replace(scene.robot, name="panda")


def test_the_published_schema_is_that_of_the_models() -> None:
    """`scene2demo scenes --schema > docs/scene.schema.json` writes it anew."""
    assert json.loads((ROOT / "docs" / "scene.schema.json").read_text()) == json_schema()


def test_the_schema_refuses_what_is_refused() -> None:
    data = json.loads(FILES["11_unknown_key"].read_text())
    with pytest.raises(jsonschema.ValidationError, match="colour"):
        jsonschema.validate(data, json_schema())
    mended = copy.deepcopy(data)
    del mended["objects"]["glass_0"]["colour"], mended["objects"]["glass_0"]["category"]
    with pytest.raises(jsonschema.ValidationError, match="category"):
        jsonschema.validate(mended, json_schema())


def test_the_page_s_scene_is_good(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs" / "scenes.md").read_text()
    (tmp_path / "page.json").write_text(page.split("```json\n", 1)[1].split("```", 1)[0])
    code, said = checked(tmp_path / "page.json", capsys)
    assert (code, said["errors"], said["warnings"]) == (0, [], [])


@pytest.mark.parametrize(
    ("query", "name"),
    [
        ("put the can on the table", "01_kitchen"),
        ("put the apple on the table", "01_kitchen"),
        ("put the can on the floor", "01_kitchen"),
        ("put the can on the shelf", "07_floor"),
        ("put the book on the floor", "03_bedroom"),
        ("put the bear on the ground", "03_bedroom"),
        ("put the mug into the drawers", "01_kitchen"),
    ],
)
def test_a_sentence_in_a_scene_of_one_s_own_is_proved(query: str, name: str) -> None:
    scene = scene_for(query, FILES[name])
    assert compose(llm.propose(query, scene).task, scene=scene).verify().verdict is Verdict.PROVED


def test_only_a_sentence_about_the_floor_brings_it_into_a_named_scene() -> None:
    assert "floor" in scene_for("put the glass on the floor.", "kitchen_t1").objects
    assert scene_for("put the glass on the table", "kitchen_t1") == library.load("kitchen_t1")


@pytest.mark.slow
@pytest.mark.slow
@pytest.mark.physics
@pytest.mark.parametrize("query", ["put the can on the shelf", "put the book on the floor"])
def test_things_are_taken_from_the_floor_and_put_on_it(query: str, tmp_path: Path) -> None:
    words = ["--scene", str(FILES["07_floor"]), "--no-video", "--out", str(tmp_path / "r")]
    assert app.run(["run", query, *words]) == 0


def test_a_picture_is_a_file_that_is_named_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["scenes", "kitchen_t1", "--picture", "picture.txt"]) == 2
    assert "a file that ends in .png" in " ".join(capsys.readouterr().err.split())


def test_without_a_renderer_the_message_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> None:
        raise RendererNotFound.of(Renderer("none", why="there is no Vulkan driver", remedy="Install one."))

    monkeypatch.setattr(stage, "activate", fail)
    words = ["scenes", str(FILES["02_smallest"]), "--check", "--picture", str(tmp_path / "p.png")]
    assert app.run(words) == 2
    told = capsys.readouterr()
    assert "nothing is wrong" in told.out and "no Vulkan driver" in told.err and not (tmp_path / "p.png").exists()


@pytest.mark.slow
@pytest.mark.render
def test_a_picture_shows_the_things(tmp_path: Path) -> None:
    from PIL import Image

    shown = tmp_path / "new" / "p.png"
    assert app.run(["scenes", str(FILES["01_kitchen"]), "--check", "--picture", str(shown)]) == 0
    with Image.open(shown) as picture:
        assert picture.size == stage.SIZE_PX
        assert len(picture.convert("RGB").getcolors(2**24) or ()) > 1000


def test_drawn_scenes_are_listed_by_family(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["scenes", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert len(said["rooms"]) == 102 and len({room["name"] for room in said["rooms"]}) == 102
    assert {scene["name"] for scene in said["scenes"]} == set(library.names())
    assert "t1-12000" in {kitchen["name"] for kitchen in said["kitchens"]}


@pytest.mark.parametrize("name", ["kitchen99-a", "kitchen02-d", "t5-1", "t1-99999999999", "kitchen02-9999999999-a"])
def test_a_name_that_no_scene_has(name: str) -> None:
    with pytest.raises(library.SceneNotFound):
        library.load(name)


@pytest.mark.slow
@pytest.mark.physics
@pytest.mark.parametrize(
    ("name", "called"),
    [("kitchen02-b", "kitchen02-13000-b"), ("kitchen02-13001-b", "kitchen02-13001-b"), ("t3-7", "t3_000007")],
)
def test_a_drawn_scene_is_had_by_its_name(name: str, called: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert families.draw_named(name) == library.load(called)
    assert app.run(["scenes", name, "--check"]) == 0
    query = next((one.query for one in families.rooms() if one.name == name), None)
    if query is not None:
        assert app.run(["plan", query, "--scene", name]) == 0


@pytest.mark.parametrize("fact", ["(ontop glass_0 glass_0)", "(nextto glass_0 glass_0)", "(under glass_0 glass_0)"])
def test_a_thing_that_is_related_to_itself_is_refused(fact: str) -> None:
    scene = load_scene("kitchen_t1")
    broken = replace(scene, facts=(*scene.facts, bddl.parse_formula(fact)))
    predicate = fact[1:].split()[0]
    assert [str(issue) for issue in issues(broken)] == [f"glass_0 cannot be {predicate} itself, as the facts have it"]
    denied = replace(scene, facts=(*scene.facts, bddl.parse_formula(f"(not {fact})")))
    assert not any("itself" in str(issue) for issue in issues(denied))
