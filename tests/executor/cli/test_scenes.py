"""`scene2demo scenes FILE`: what is in a scene's file, and a reconstruction as a scene of this program."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from executor.cli import main
from executor.scenes.cousins import from_cousins
from oag import Scene
from tests.executor.scenes.reconstructions import kitchen, thing, write


def test_a_reconstruction_is_told_and_written_as_a_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = write(tmp_path, kitchen()), tmp_path / "new" / "kitchen.json"
    assert main.run(["scenes", str(file), "--out", str(out)]) == 0
    told = capsys.readouterr()
    assert "fridge_0     refrigerator (upright_one_door), 0.70 x 0.64 x 1.42 m" in told.out
    assert "note: picture_0 was left out: nothing meets a picture" in told.err
    assert Scene.from_json(out) == from_cousins(file).scene
    assert main.run(["scenes", str(file), "--out", str(out)]) == 2
    capsys.readouterr()
    assert main.run(["scenes", str(out), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["notes"] == [] and Scene.from_json(again["scene"]) == from_cousins(file).scene


def test_what_is_not_taken_over_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write(tmp_path, kitchen() | {"lamp_0": thing("floor_lamp", (0.3, 0.3, 1.5), (0.5, 1.0, 0.75))})
    query = "open the fridge"
    assert main.run(["run", query, "--scene", str(file), "--out", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err
    assert "1 of 8 objects cannot be taken over" in message and "- lamp_0: the library has nothing" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("words", [["--out", "scene.json"], ["absent.json"]])
def test_a_file_must_be_there(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["scenes", *words]) == 2
    assert "Traceback" not in capsys.readouterr().err
