"""`scene2demo scenes FILE`: what is in a scene's file, and a reconstruction as a scene of this program."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from executor.cli import app
from executor.scenes import library
from executor.scenes.digital_cousins import from_cousins
from oag import Scene
from tests.executor.cli.conftest import ROOT
from tests.executor.scenes.reconstructions import kitchen, thing, write

T1 = ROOT / "tests" / "data" / "T1.json"


def test_a_reconstruction_is_told_and_written_as_a_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = write(tmp_path, kitchen()), tmp_path / "new" / "kitchen.json"
    assert app.run(["scenes", str(file), "--out", str(out)]) == 0
    told = capsys.readouterr()
    assert "fridge_0     refrigerator (upright_one_door), 0.70 x 0.64 x 1.42 m" in told.out
    assert "note: picture_0 was left out: nothing meets a picture" in told.err
    assert Scene.from_json(out) == from_cousins(file).scene
    assert app.run(["scenes", str(file), "--out", str(out)]) == 2
    capsys.readouterr()
    assert app.run(["scenes", str(out), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["notes"] == [] and Scene.from_json(again["scene"]) == from_cousins(file).scene


def test_what_is_not_taken_over_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write(tmp_path, kitchen() | {"piano_0": thing("grand_piano", (1.5, 1.5, 1.0), (0.5, 1.0, 0.5))})
    query = "open the fridge"
    assert app.run(["run", query, "--scene", str(file), "--out", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err
    assert "1 of 8 objects cannot be taken over" in message and "- piano_0: the library has nothing" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("words", [["--out", "scene.json"], ["absent.json"]])
def test_a_file_must_be_there(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["scenes", *words]) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("name", library.names())
def test_a_scene_of_the_package_is_told_by_its_name(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["scenes", name, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert Scene.from_json(told["scene"]) == library.load(name) and told["warnings"] == []


def test_a_misspelt_name_gets_the_near_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["scenes", "kitchn_t1"]) == 2
    assert "did you mean kitchen_t1" in capsys.readouterr().err


def _file(folder: Path, **changes: Any) -> str:
    data = library.load("kitchen_t1").to_json() | changes
    (folder / "mine.json").write_text(json.dumps(data))
    return str(folder / "mine.json")


def _glass(**changes: Any) -> dict[str, Any]:
    objects: Any = library.load("kitchen_t1").to_json()["objects"]
    return {"objects": {**objects, "glass_0": {**objects["glass_0"], **changes}}}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (_glass(category="flute", model="flute"), "objects.glass_0: the library has nothing of the category 'flute'"),
        (_glass(colour="red"), "objects.glass_0: has a key 'colour' that nothing reads"),
        (_glass(positon=[0, 0, 0]), "has a key 'positon' that nothing reads (did you mean position?)"),
        ({"lights": []}, "has a key 'lights' that nothing reads"),
        ({"robot": {"positions": [0, 0, 0]}}, "robot: has a key 'positions' that nothing reads"),
        (_glass(position=[0.0, -1.12, 1.9]), "glass_0 is in mid-air: 124.0 cm above table_0"),
        ({"facts": ["(inside glass_0 refrigerator_0)"]}, "glass_0 is not in refrigerator_0 by its position"),
    ],
)
def test_a_scene_that_cannot_be_is_bad_input(
    changes: dict[str, Any], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = _file(tmp_path, **changes), tmp_path / "out.json"
    assert app.run(["scenes", file, "--out", str(out)]) == 2
    told = capsys.readouterr()
    assert said in " ".join(told.err.split()) and told.out == "" and not out.exists()


def test_a_warning_is_told_and_the_scene_is_good(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["scenes", _file(tmp_path, facts=[])]) == 0
    assert "warning: glass_0 is on table_0 by its position" in " ".join(capsys.readouterr().err.split())


def test_what_nobody_can_build_is_told_before_anything_is_planned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = _file(tmp_path, **_glass(category="flute", model="flute"))
    words = ["--scene", file, "--out", str(tmp_path / "r")]
    for command in (["run", "open the refrigerator", *words], ["rollout", str(T1), "--scene", file]):
        assert app.run(command) == 2
        told = capsys.readouterr()
        assert "objects.glass_0: the library has nothing of the category 'flute'" in told.err
        assert "proved" not in told.err + told.out
    assert not (tmp_path / "r").exists()
