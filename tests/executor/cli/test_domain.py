"""`--domain FILE` of `verify`, `plan`, `recheck`, `scenes` and `graph`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import oag
from executor.cli import app

DOMAIN = """
name = "lamps"
[predicates]
lit = ["lamp"]
[primitives.LIGHT]
objects = { "?lamp" = "item" }
needs = ["(near ?lamp)", "(handempty)"]
writes = ["(lit ?lamp)"]
"""
SCENE: dict[str, Any] = {
    "name": "s",
    "objects": {
        "table_0": {"category": "table", "position": [1, 0]},
        "lamp_0": {"category": "can", "on": "table_0"},
        "lamp_1": {"category": "can", "on": "table_0"},
    },
    "facts": ["(lit lamp_1)"],
}
TASK: dict[str, Any] = {
    "goal": "(and (lit lamp_0) (lit lamp_1))",
    "sub_tasks": [{"target": "lamp_0", "init": "(not (lit lamp_0))", "goal": "(lit lamp_0)", "flow": [17, "LIGHT"]}],
}


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A scene, a task in it, and their domain, in the current folder."""
    monkeypatch.chdir(tmp_path)
    facts = [*SCENE["facts"], "(not (lit lamp_0))"]
    Path("scene.json").write_text(json.dumps(SCENE | {"facts": facts}), encoding="utf-8")
    Path("task.json").write_text(json.dumps(TASK), encoding="utf-8")
    Path("lamps.toml").write_text(DOMAIN, encoding="utf-8")


def test_a_plan_in_an_own_domain_is_proved_and_rechecked(files: None, capsys: pytest.CaptureFixture[str]) -> None:
    domain = ["--domain", "lamps.toml"]
    assert app.run(["verify", "task.json", *domain, "--certificate", "certificate.json"]) == 0
    assert capsys.readouterr().out.startswith("PROVED")
    assert app.run(["recheck", "certificate.json", "--task", "task.json", *domain]) == 0
    # Without the domain its words are unknown.
    assert app.run(["verify", "task.json"]) == 2
    assert "scene.json" in capsys.readouterr().err


def test_a_goal_is_planned_and_what_has_no_skill_is_not_gone_through(
    files: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run(["plan", "--scene", "scene.json", "--goal", TASK["goal"], "--domain", "lamps.toml", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == "PROVED" and found["feasibility"] is None and "LIGHT" in found["not_asked"]
    assert "LIGHT" in found["plan"]["sub_tasks"][0]["flow"]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("absent.toml", None, "cannot be read"),
        ("bad.toml", "x =", "cannot be read"),
        ("bad.toml", 'name = "d"\nrows = 1', "rows"),
    ],
)
@pytest.mark.parametrize(
    "command", [["verify", "task.json"], ["plan", "--scene", "scene.json", "--goal", "(lit lamp_0)"]]
)
def test_a_domain_that_cannot_be_used_is_one_message(
    name: str, text: str | None, said: str, command: list[str], files: None, capsys: pytest.CaptureFixture[str]
) -> None:
    if text is not None:
        Path(name).write_text(text, encoding="utf-8")
    assert app.run([*command, "--domain", name]) == 2
    message = capsys.readouterr().err
    assert f"domain {name}" in message and said in message and "Traceback" not in message


def test_a_certificate_is_compared_with_the_domain_alone(files: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["verify", "task.json", "--domain", "lamps.toml", "--certificate", "certificate.json"]) == 0
    Path("other.toml").write_text(DOMAIN.replace('"(near ?lamp)", ', ""), encoding="utf-8")
    assert app.run(["recheck", "certificate.json", "--domain", "lamps.toml"]) == 0
    assert app.run(["recheck", "certificate.json"]) == 0
    capsys.readouterr()
    assert app.run(["recheck", "certificate.json", "--domain", "other.toml"]) == 1
    assert "another domain" in capsys.readouterr().out


def test_a_domain_without_the_21_has_the_facts_of_its_own_predicates(files: None) -> None:
    row = DOMAIN.replace('"(near ?lamp)", "(handempty)"', "")
    Path("bare.toml").write_text(f"inherits = false\n{row}", encoding="utf-8")
    lit = {"target": "lamp_0", "init": "(and)", "goal": "(lit lamp_0)", "flow": ["LIGHT"]}
    Path("task.json").write_text(json.dumps({"sub_tasks": [lit]}), encoding="utf-8")
    certified = ["--certificate", "certificate.json"]
    assert app.run(["verify", "task.json", "--domain", "bare.toml", *certified]) == 0
    assert app.run(["scenes", "scene.json", "--domain", "bare.toml", "--out", "whole.json"]) == 0
    whole = json.loads(Path("whole.json").read_text(encoding="utf-8"))
    assert whole["closed"] == [] and all("lit" in fact for fact in whole["facts"])
    assert app.run(["recheck", "certificate.json", "--task", "task.json", "--scene", "whole.json"]) == 0
    assert app.run(["scenes", "kitchen_t1", "--domain", "bare.toml", "--out", "named.json"]) == 0
    assert json.loads(Path("named.json").read_text(encoding="utf-8"))["facts"] == []


def test_a_scene_is_written_whole_and_drawn_as_a_graph_in_its_domain(
    files: None, capsys: pytest.CaptureFixture[str]
) -> None:
    domain = ["--domain", "lamps.toml"]
    assert app.run(["verify", "task.json", *domain, "--certificate", "certificate.json"]) == 0
    capsys.readouterr()
    recheck = ["recheck", "certificate.json", "--task", "task.json", "--scene"]
    assert app.run([*recheck, "scene.json", *domain]) == 2
    assert "--domain DOMAIN.toml --out SCENE.json" in capsys.readouterr().err
    assert app.run(["scenes", "scene.json", *domain, "--check"]) == 0
    assert app.run(["scenes", "scene.json", *domain, "--out", "whole.json"]) == 0
    assert app.run([*recheck, "whole.json", *domain]) == app.run([*recheck, "whole.json"]) == 0
    # A written scene has its domain.
    assert app.run(["verify", "task.json", "--scene", "whole.json"]) == 0
    assert app.run(["graph", "task.json", *domain, "--format", "mermaid"]) == 0
    assert "LIGHT" in capsys.readouterr().out
    assert app.run(["scenes", *domain]) == 2


def test_a_scene_in_words_is_verified_drawn_and_rechecked_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    # The library has no towel, and nothing has a place.
    here = oag.scene({"shelf_0": "shelf", "towel_0": "towel"}, ["(ontop towel_0 shelf_0)"], "all")
    task = oag.task(here, steps=[oag.pick("towel_0")])
    for name, one in (("scene", here), ("task", task)):
        Path(f"{name}.json").write_text(json.dumps(one.to_json()), encoding="utf-8")
    assert app.run(["verify", "task.json", "--certificate", "certificate.json"]) == 0
    assert app.run(["recheck", "certificate.json", "--task", "task.json", "--scene", "scene.json"]) == 0
    assert app.run(["graph", "task.json"]) == 0
    # What moves needs places.
    assert app.run(["plan", "--scene", "scene.json", "--goal", "(inside towel_0 gripper)"]) == 2
    assert "shelf_0: has no place" in capsys.readouterr().err
