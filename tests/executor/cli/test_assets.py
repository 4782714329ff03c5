"""`scene2demo assets`: the library as text and as JSON; `assets import` makes a model whose lines make a scene."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import trimesh

from executor.assets.library import LIBRARY
from executor.sim.world import World
from oag import Scene
from tests.executor.cli.conftest import Command


def test_every_model_is_listed_with_its_category(command: Command) -> None:
    answer = command("assets")
    assert answer.code == 0 and answer.err == ""
    for model, entry in LIBRARY.items():
        line = next(line for line in answer.out.splitlines() if line.split(" ")[0] == model)
        assert entry.category in line and entry.synset in line


def test_programs_get_ranges(command: Command) -> None:
    answer = command("assets", "--json")
    listed = {asset["model"]: asset for asset in json.loads(answer.out)["assets"]}
    assert answer.code == 0 and set(listed) == set(LIBRARY)
    drawers = listed["cabinet_drawers"]
    assert drawers["role"] == "A" and drawers["size"]["x"] == {"low": 0.56, "high": 0.66, "unit": "m"}
    assert {"name": "drawers", "low": 2, "high": 4, "default": 3, "whole": True} in drawers["parameters"]
    assert listed["mug"]["role"] == "B"
    assert {"name": "hinge", "words": ["left", "right"], "default": "left"} in listed["fridge_one_door"]["parameters"]


@pytest.fixture
def flask(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SCENE2DEMO_ASSETS", str(tmp_path / "assets"))
    file = tmp_path / "flask.stl"
    trimesh.creation.cylinder(radius=0.025, height=0.16, sections=24).export(file)
    return file


def test_the_printed_lines_make_a_scene(command: Command, flask: Path) -> None:
    answer = command("assets", "import", flask, "--category", "bottle")
    assert answer.code == 0 and "imported/flask  bottle (item)  0.050 x 0.050 x 0.160 m" in answer.out
    assert "50 mm between the fingers" in answer.out
    line = answer.out.splitlines()[-1].strip()
    objects = json.loads("{" + line + "}")
    with World(Scene.from_json({"objects": objects, "facts": []})) as world:
        assert world.dynamic_ids == ("bottle_0",)


def test_programs_get_all_of_it(command: Command, flask: Path) -> None:
    found = command("assets", "import", flask, "--name", "thermos", "--category", "bottle", "--json").data["asset"]
    assert found["model"] == "imported/thermos" and found["kind"] == "item"
    assert Path(found["path"]).parent.name == "assets" and found["handles"] == []


def test_bad_files_end_in_one_sentence(command: Command, flask: Path) -> None:
    answer = command("assets", "import", flask.with_suffix(".step"))
    assert answer.code == 2 and "No such file or directory" in answer.err
    flask.with_suffix(".step").write_text("ISO-10303")
    answer = command("assets", "import", flask.with_suffix(".step"), "--json")
    assert answer.code == 2 and "is of no known kind (.step)" in answer.data["error"]["message"]
