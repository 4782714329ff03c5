"""`scene2demo recheck`: of this task and this scene, and of files that say two things."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from executor.cli import app
from tests.executor.cli.conftest import ROOT

DATA = ROOT / "tests" / "data"


@pytest.fixture
def certificate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """The file of T1's certificate."""
    file = tmp_path / "certificate.json"
    assert app.run(["verify", str(DATA / "T1.json"), "--certificate", str(file)]) == 0
    capsys.readouterr()
    return str(file)


def test_it_is_about_this_task_in_this_scene(certificate: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--task", str(DATA / "T1.json"), "--scene", str(DATA / "T1_scene.json")]
    assert app.run(["recheck", certificate, *words]) == 0
    assert capsys.readouterr().out.startswith("CONFIRMED  PROVED")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--task", str(DATA / "T2.json")], "it is about another task"),
        (["--scene", "kitchen_t2"], "it is about another scene"),
        (["--task", str(DATA / "T1.json"), "--scene", str(DATA / "T4_scene.json")], "it is about another scene"),
    ],
)
def test_of_another_one_it_is_rejected(
    words: list[str], said: str, certificate: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run(["recheck", certificate, *words]) == 1
    assert said in capsys.readouterr().out
    assert app.run(["recheck", certificate, *words, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["ok"] is False


@pytest.mark.parametrize("words", [["--task", "absent.json"], ["--scene", "kitchn_t1"], ["--scene", "absent.json"]])
def test_what_it_is_asked_about_must_be_there(
    words: list[str], certificate: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run(["recheck", certificate, *words]) == 2
    assert capsys.readouterr().err


def test_a_scene_of_another_form_is_refused_with_what_to_do(
    certificate: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "scene_0_info.json"
    file.write_text('{"cam_pose": [[0, 0, 1], [0, 0, 0, 1]], "objects": {}}')
    assert app.run(["recheck", certificate, "--scene", str(file)]) == 2
    said = capsys.readouterr().err
    assert "Digital Cousins" in said and "scene2demo scenes" in said and "--out" in said


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"verdict":', '"verdict": "REFUTED", "verdict":', "the key 'verdict' appears twice"),
        ('"schema":', '"extra": NaN, "schema":', "NaN is no JSON number"),
    ],
)
def test_a_file_that_says_two_things_is_bad_input(
    old: str, new: str, said: str, certificate: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = Path(certificate)
    text = file.read_text()
    assert text.count(old) == 1
    file.write_text(text.replace(old, new))
    assert app.run(["recheck", certificate]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
