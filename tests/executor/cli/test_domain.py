"""`--domain FILE` of `verify`, `plan` and `recheck`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

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
    assert found["verdict"] == "PROVED" and found["feasibility"] is None
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
